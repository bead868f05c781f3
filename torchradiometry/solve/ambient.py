"""What a truncated solve leaves out, taken as ambient light: calibrated instead of guessed.

    B <- B + r + rho a s,    a = argmin_a | rho (F r - a (s - F rho s)) |^2      (mean square)

r is the residual of B: the next bounce of a Neumann series, the light not yet shot of
progressive radiosity. It is reflected once more, and everything after that is taken as light
that arrives everywhere alike, a (W/m2), but for patches that see nothing (s = 0, otherwise 1).
The mean is taken over area where it is known. The new residual is rho (F r - a (s - F rho s)),
which a makes as small as it can; the bound is taken from that residual, so it stays rigorous.

References: M. Cohen, S. Chen, J. Wallace and D. Greenberg, "A Progressive Refinement Approach
to Fast Radiosity Image Generation", SIGGRAPH 1988, section 5 (ambient term).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide
from torchradiometry.solve.certificate import gamma
from torchradiometry.solve.operators import (
    AbstractOperator,
    require_system,
)
from torchradiometry.solve.solver import Approximation

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["ambient_tail", "with_ambient_tail"]


def ambient_tail(
    operator: AbstractOperator,
    albedo: Float[Tensor, "*batch patch channel"],
    rest: Float[Tensor, "*batch patch channel"],
) -> tuple[Float[Tensor, "*batch patch channel"], Float[Tensor, "*batch patch channel"]]:
    """What to add to B for its residual `rest`, and the residual that is then left, W/m2.

    Costs three products. Patches that see nothing reflecting receive none of it. In a closed room
    of albedo 1, where no a helps, a = 0.

    Differentiable in: all tensors.
    Export: compile yes, ONNX yes.
    """
    require_system(operator, ("albedo", albedo), ("rest", rest))
    arriving = operator(rest)
    sees = (operator(albedo) > 0).to(albedo)
    missing = sees - operator(albedo * sees)
    above_rounding = missing > gamma(operator.terms, operator.dtype)
    # shares of the whole albedo: squares of small ones underflow, and only ratios count
    share = guarded_divide(albedo, albedo.detach().sum(-2, keepdim=True))
    weight = torch.where(above_rounding, share.square() * missing, 0)
    if operator.area is not None:
        weight = weight * operator.area.unsqueeze(-1)
    ambient = guarded_divide(
        (weight * arriving).sum(-2, keepdim=True), (weight * missing).sum(-2, keepdim=True)
    )
    return rest + albedo * sees * ambient, albedo * (arriving - ambient * missing)


def with_ambient_tail(
    operator: AbstractOperator,
    albedo: Float[Tensor, "*batch patch channel"],
    found: Approximation,
    rest: Float[Tensor, "*batch patch channel"],
) -> Approximation:
    """`found` with the ambient tail of its residual `rest`.

    The residual left is kept where B is a plain sum of bounces, whose rounding is known.
    """
    tail, left = ambient_tail(operator, albedo, rest)
    bounces = found.bounces
    if bounces is not None:
        bounces = torch.cat((bounces, tail.unsqueeze(-3)), -3)
    return found._replace(
        radiosity=found.radiosity + tail,
        products=found.products + 3,
        residual=left if found.one_sign else None,
        one_sign=False,
        bounces=bounces,
    )
