"""How wrong can a radiosity be? A bound from its residual, rounding included.

    T = rho F,   r = M + T B - B,   e = B* - B = (I - T)^-1 r

    |e| <= |c_k| + |r_k| / (1 - q),     q = max_i rho_i sum_j F_ij         (largest norms)
    r_{k+1} = (r_k + T r_k) / 2,   c_{k+1} = c_k + r_k / 2,   r_0 = r,  c_0 = 0

since e = c_k + (I - T)^-1 r_k for every k. At k = 0 this is |r| / (1 - q); a residual that
changes sign between patches makes that pessimistic by up to (1 + q) / (1 - q). Averaging r
with its next bounce damps every mode of T but the slow one, for which the first bound is
sharp. With S = (I + T) / 2,

    c_k = (I - S^k) e,     r_k = S^k (I - T) e

and S^3 (I - T) = (I + 2 T - 2 T^3 - T^4) / 8: at q = 0.9 its norm is at most 0.615, that of
I - S^3 at most 1.61. With k = 3 the bound is thus at most 7.8 times the error up to q = 0.9,
whatever the room; k = 0 alone may reach 19 times.

A residual of one sign, as that of a plain Neumann series, needs none of it: e >= r >= 0, so
|r| / (1 - q) is at most |e| / (1 - q).

*Rounding.* A sum of n products in any order is off by gamma_n = n u / (1 - n u) times the sum
of their moduli (u the unit roundoff). As |M| + T|B| + |B| is at most 2|B| + |r| for B, M >= 0,
r is known to gamma (2|B| + |r|); entries below 0 add their share.

*Where q >= 1* (white patches in a room that absorbs elsewhere) any z with (I - T) z >= w > 0
bounds the inverse, |(I - T)^-1| <= max z / w, because it has no negative entry.

The bound is on the error of the *discrete* system; the error of the patches is not in it.

References: R. Varga, *Matrix Iterative Analysis* (1962), ch. 3; N. Higham, *Accuracy and
Stability of Numerical Algorithms* (2002), sections 3.1 and 7.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide
from torchradiometry.solve.operators import (
    AbstractOperator,
    as_operator,
    reflected,
    require_system,
)
from torchradiometry.solve.solution import Solution, Status

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["certified", "gamma", "inverse_norm"]

#: further roundings of one entry of r besides those of the product
FEW = 16


def gamma(terms: int | Tensor, dtype: torch.dtype) -> float | Tensor:
    """gamma_n = n u / (1 - n u): relative rounding of a sum of n products; inf if n u >= 1."""
    loss = terms * (torch.finfo(dtype).eps / 2)
    if isinstance(loss, Tensor):
        return torch.where(loss < 1, loss / (1 - loss), torch.inf)
    return loss / (1 - loss) if loss < 1 else torch.inf


def certified(
    operator: AbstractOperator | Float[Tensor, "*batch patch patch"],
    albedo: Float[Tensor, "*batch patch channel"],
    exitance: Float[Tensor, "*batch patch channel"],
    radiosity: Float[Tensor, "*batch patch channel"],
    residual: Float[Tensor, "*batch patch channel"] | None = None,
    iterations: int | Tensor = 0,
    *,
    steps: int = 3,
    norm: Float[Tensor, "*batch channel"] | None = None,
    converged: Bool[Tensor, "*batch channel"] | None = None,
) -> Solution:
    """The solution with its residual (computed unless given), bound and status.

    Args:
        operator: F.
        albedo: 0..1.
        exitance: M, W/m2.
        radiosity: B, W/m2.
        residual: r, known to the rounding of `iterations` products.
        iterations: products that were spent on B.
        steps: k, further products that sharpen the bound; 0 for a residual of one sign.
        norm: a bound on |(I - T)^-1|, in place of 1 / (1 - q).
        converged: False where an iteration stopped before its tolerance.

    Differentiable in: nothing but the radiosity, which is passed through.
    Export: compile yes, ONNX yes.
    """
    operator = as_operator(operator)
    require_system(operator, ("albedo", albedo), ("exitance", exitance), ("radiosity", radiosity))
    with torch.no_grad():
        terms: int | Tensor = operator.terms + FEW
        if residual is None:
            residual = exitance + reflected(operator, albedo, radiosity) - radiosity
            iterations = iterations + 1
        else:
            terms = terms + iterations
        loss = gamma(terms, operator.dtype)
        share = albedo * operator.row_sums().unsqueeze(-1) * (1 + loss)
        norm = _geometric(share.amax(-2)) if norm is None else norm
        slack = _rounding(loss, share, exitance, radiosity, residual)
        bound = _bound(operator, albedo, residual, slack, norm, loss, steps)
        status = _status(bound, residual, norm, share, converged)
        bound = torch.where(status == int(Status.NOT_FINITE), torch.inf, bound)
    return Solution(radiosity, residual.abs().amax(-2), bound, iterations + steps, status)


def inverse_norm(
    operator: AbstractOperator,
    albedo: Float[Tensor, "*batch patch channel"],
    above: Float[Tensor, "*batch patch channel"],
) -> Float[Tensor, "*batch channel"]:
    """max z / min (I - T) z >= |(I - T)^-1|, for any z = `above`; inf where that says nothing."""
    require_system(operator, ("albedo", albedo), ("above", above))
    loss = gamma(operator.terms + FEW, operator.dtype)
    lowest = (above - reflected(operator, albedo, above) - 2 * loss * above.abs()).amin(-2)
    usable = (lowest > 0) & (above > 0).all(-2)
    return torch.where(usable, guarded_divide(above.amax(-2), lowest), torch.inf)


def _geometric(contraction: Tensor) -> Tensor:
    """1 / (1 - q), inf from q = 1 on."""
    below = contraction < 1
    return torch.where(below, 1 / torch.where(below, 1 - contraction, 1), torch.inf)


def _rounding(
    loss: float | Tensor, share: Tensor, exitance: Tensor, radiosity: Tensor, residual: Tensor
) -> Float[Tensor, "*batch channel"]:
    """Largest difference between r and its computed value."""
    below = (-radiosity).relu().amax(-2, keepdim=True)
    moduli = 2 * radiosity.abs() + residual.abs() + 2 * (-exitance).relu() + 2 * share * below
    return loss * moduli.amax(-2)


def _bound(
    operator: AbstractOperator,
    albedo: Tensor,
    residual: Tensor,
    slack: Tensor,
    norm: Tensor,
    loss: float | Tensor,
    steps: int,
) -> Float[Tensor, "*batch channel"]:
    """The smallest of |c_k| + (|r_k| + rounding) norm over k = 0..steps."""
    correction = torch.zeros_like(residual)
    largest = residual.abs().amax(-2)
    bound = (largest + slack) * norm
    for _ in range(steps):
        slack = slack + 2 * loss * largest
        correction = correction + residual / 2
        residual = (residual + reflected(operator, albedo, residual)) / 2
        largest = residual.abs().amax(-2)
        bound = torch.minimum(bound, correction.abs().amax(-2) + (largest + slack) * norm)
    # 0 times an infinite norm: nothing is known of a patch that emits nothing but may ring
    return torch.where(torch.isfinite(norm), bound * (1 + loss), torch.inf)


def _status(
    bound: Tensor, residual: Tensor, norm: Tensor, share: Tensor, converged: Tensor | None
) -> Tensor:
    def code(where: Tensor, status: Status, otherwise: Tensor) -> Tensor:
        return torch.where(where, int(status), otherwise)

    status = torch.zeros_like(bound, dtype=torch.int64) + int(Status.BOUNDED)
    if converged is not None:
        status = code(~converged, Status.NOT_CONVERGED, status)
    status = code(torch.isinf(norm), Status.UNBOUNDED, status)
    if converged is not None:
        status = code(share.amin(-2) >= 1, Status.SINGULAR, status)
    finite = torch.isfinite(residual).all(-2)
    return code(~finite, Status.NOT_FINITE, status)
