"""Radiosity bounce by bounce: the Neumann series, unrolled.

    B_0 = M,   B_k = M + rho F B_{k-1} = sum_{m<=k} (rho F)^m M

k bounces leave the residual r_k = (rho F)^(k+1) M, so the error falls at least as q^(k+1),
q = max_i rho_i sum_j F_ij. The number of bounces is a Python number: the graph is a fixed
chain of matrix products, which compiles, exports and differentiates as it stands.

*Ambient tail.* What the truncated bounces would have added is taken as light that arrives
everywhere alike, plus the next bounce:

    B = B_k + r_k + rho a,    a = argmin_a | rho (F r_k - a (1 - F rho)) |^2

a (W/m2) makes the residual of B smallest in the mean square. This is the ambient
approximation of the textbooks with its constant calibrated instead of guessed; the bound is
taken from the residual that B really has, so it stays rigorous.

References: J. Kajiya, "The Rendering Equation", SIGGRAPH 1986 (Neumann series); M. Cohen,
S. Chen, J. Wallace and D. Greenberg, "A Progressive Refinement Approach to Fast Radiosity
Image Generation", SIGGRAPH 1988, section 5 (ambient term).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import DTypeError, OutOfRangeError
from torchradiometry.numerics import guarded_divide
from torchradiometry.solve.solution import Solution, certified, reflected

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Neumann", "neumann_series"]


def neumann_series(
    form_factors: Float[Tensor, "*batch patch patch"],
    albedo: Float[Tensor, "*batch patch channel"],
    exitance: Float[Tensor, "*batch patch channel"],
    bounces: int,
) -> tuple[Float[Tensor, "*batch patch channel"], Float[Tensor, "*batch patch channel"]]:
    """B after `bounces` reflections, and the next bounce (its residual), both in W/m2.

    B_k = M + rho F B_{k-1},   r_k = rho F (B_k - B_{k-1})

    Args:
        form_factors: F[receiver, emitter], 0..1.
        albedo: 0..1.
        exitance: M, W/m2: what the patches emit (or reflect of sources that are no patches).
        bounces: >= 0; 0 leaves the emission alone.

    Differentiable in: all tensors.
    Export: compile yes, ONNX yes.
    """
    radiosity = bounce = exitance
    for _ in range(bounces):
        bounce = reflected(form_factors, albedo, bounce)
        radiosity = radiosity + bounce
    return radiosity, reflected(form_factors, albedo, bounce)


@final
@dataclass(frozen=True)
class Neumann:
    """A fixed number of bounces.

    Args:
        bounces: reflections that are followed, >= 0.
        ambient_tail: add the calibrated ambient term for all further ones (costs two more
            products with F).

    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])  # two patches that see only each other
    >>> half = torch.full((2, 1), 0.5)
    >>> Neumann(20).solve(F, half, half).radiosity.T  # M / (1 - rho)
    tensor([[1.0000, 1.0000]])
    """

    bounces: int
    ambient_tail: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.bounces, int) or isinstance(self.bounces, bool):
            raise DTypeError("bounces", f"{self.bounces!r}", "pass a whole number")
        if self.bounces < 0:
            raise OutOfRangeError("bounces", f"{self.bounces}", "pass 0 or more")

    def solve(
        self,
        form_factors: Float[Tensor, "*batch patch patch"],
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
    ) -> Solution:
        """B of B = M + rho F B, truncated, with its bound.

        Args:
            form_factors: F[receiver, emitter].
            albedo: 0..1; broadcasts against `exitance`.
            exitance: M, W/m2.

        Differentiable in: all tensors.
        Export: compile yes, ONNX yes.
        """
        radiosity, rest = neumann_series(form_factors, albedo, exitance, self.bounces)
        products = self.bounces + 1
        if not self.ambient_tail:
            return certified(form_factors, albedo, exitance, radiosity, rest, products)
        tail, left = _ambient_tail(form_factors, albedo, rest)
        return certified(form_factors, albedo, exitance, radiosity + tail, left, products + 2)


def _ambient_tail(
    form_factors: Tensor, albedo: Tensor, rest: Tensor
) -> tuple[Float[Tensor, "*batch patch channel"], Float[Tensor, "*batch patch channel"]]:
    """r + rho a, and the residual that is left after adding it."""
    arriving = form_factors @ rest
    missing = 1 - form_factors @ (albedo + torch.zeros_like(rest))
    weight = albedo.square() * missing
    ambient = guarded_divide(
        (weight * arriving).sum(-2, keepdim=True), (weight * missing).sum(-2, keepdim=True)
    )
    return rest + albedo * ambient, albedo * (arriving - ambient * missing)
