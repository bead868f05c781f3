"""Energy balance: the uniform light that a half-solved room still lacks.

    B <- B + rho a,    a = sum_i A_i r_i / sum_i A_i (rho - rho F rho)_i

r is the residual. After it the room as a whole absorbs what it emits. In the inner product
sum_i A_i x_i y_i / rho_i, in which I - rho F is symmetric, this is the Galerkin projection on
the one vector rho: the error never grows by it, and the slow mode that makes bright closed
rooms converge like albedo^k is gone. Classical relaxation has no such step.

References: M. Cohen, S. Chen, J. Wallace and D. Greenberg, SIGGRAPH 1988, section 5 (the
ambient term as unshot energy over what the room absorbs).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from torch import Tensor

from torchradiometry.numerics import guarded_divide
from torchradiometry.solve.operators import AbstractOperator

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Balance", "balance_of"]


class Balance(NamedTuple):
    """What the balance needs to know of a room.

    Attributes:
        area: A, m2, with a channel axis.
        arriving: F rho, what arrives when every patch reflects 1 W/m2 of ambient light.
        lost: rho - rho F rho: by how much the residual falls for 1 W/m2 of ambient light.
        absorbed: A - F^T (A rho), m2: how much of its radiosity a patch loses for the room.
    """

    area: Float[Tensor, "*batch patch 1"]
    arriving: Float[Tensor, "*batch patch channel"]
    lost: Float[Tensor, "*batch patch channel"]
    absorbed: Float[Tensor, "*batch patch channel"]

    def ambient(
        self, residual: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch 1 channel"]:
        """a of a residual, W/m2."""
        return guarded_divide(_total(self.area * residual), _total(self.area * self.lost))

    def ambient_of(
        self,
        exitance: Float[Tensor, "*batch patch channel"],
        radiosity: Float[Tensor, "*batch patch channel"],
    ) -> Float[Tensor, "*batch 1 channel"]:
        """a of a radiosity, W/m2, without a product.

        sum_i A_i r_i = sum_i A_i M_i - sum_j (A - F^T (A rho))_j B_j
        """
        missing = _total(self.area * exitance - self.absorbed * radiosity)
        return guarded_divide(missing, _total(self.area * self.lost))


def balance_of(
    operator: AbstractOperator, albedo: Float[Tensor, "*batch patch channel"]
) -> Balance | None:
    """The balance of a room, None where areas are not known. Costs two products."""
    if operator.area is None:
        return None
    area, arriving = operator.area.unsqueeze(-1), operator(albedo)
    absorbed = area - operator.transposed(area * albedo)
    return Balance(area, arriving, albedo * (1 - arriving), absorbed)


def _total(x: Tensor) -> Float[Tensor, "*batch 1 channel"]:
    return x.sum(-2, keepdim=True)
