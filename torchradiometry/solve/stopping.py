"""When is an iteration good enough?

    |r| <= max(tolerance (1 - q), 4 u) |B|      (largest norms, for every system by itself)

Then |B - B*| <= |r| / (1 - q) is below tolerance |B|, or the residual is down to the
rounding of B (u the spacing of numbers at 1) and no iteration makes it smaller.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import OutOfRangeError, require_whole
from torchradiometry.solve.operators import AbstractOperator

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["allowed_residual", "check_limits", "settled"]


@torch.no_grad()
def allowed_residual(
    operator: AbstractOperator, albedo: Float[Tensor, "*batch patch channel"], tolerance: float
) -> Float[Tensor, "*batch channel"]:
    """max(tolerance (1 - q), 4 u): the residual to reach, as a share of the largest radiosity."""
    contraction = (albedo * operator.row_sums().unsqueeze(-1)).amax(-2)
    return (tolerance * (1 - contraction)).clamp(min=4 * torch.finfo(contraction.dtype).eps)


def settled(
    residual: Float[Tensor, "*batch patch channel"],
    radiosity: Float[Tensor, "*batch patch channel"],
    allowed: Float[Tensor, "*batch channel"],
) -> Bool[Tensor, "*batch channel"]:
    """True for each system whose residual is small enough; NaN counts as settled."""
    return ~(residual.abs().amax(-2) > allowed * radiosity.abs().amax(-2))


def check_limits(tolerance: float, name: str, most: int) -> None:
    """Refuse a tolerance that is no share, and a count that is none."""
    if not (isinstance(tolerance, float | int) and math.isfinite(tolerance) and tolerance >= 0):
        raise OutOfRangeError("tolerance", f"{tolerance!r}", "pass a number >= 0, such as 1e-3")
    require_whole(name, most, 1)
