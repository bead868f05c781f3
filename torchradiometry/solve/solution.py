"""What every solver returns, and what its status means.

    residual  r = M + rho F B - B            W/m2
    error     |B - B*| <= |r| / (1 - q),     q = max_i rho_i sum_j F_ij       (largest norm)

The bound follows from B - B* = -(I - rho F)^-1 r and |rho F| <= q. It bounds the error of the
*discrete* system; the error of the patches themselves is not in it.

References: R. Varga, *Matrix Iterative Analysis* (1962), ch. 3.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["Solution", "Status", "advice", "certified", "reflected"]


class Status(IntEnum):
    """How a solve ended, per right-hand side."""

    BOUNDED = 0
    UNBOUNDED = 1
    NOT_FINITE = 2


_ADVICE = {
    Status.BOUNDED: "the error is at most `bound`; add bounces to make it smaller",
    Status.UNBOUNDED: (
        "some patch reflects all that it receives (albedo x row sum >= 1), so this bound is "
        "infinite; lower the albedo below 1 or open the scene"
    ),
    Status.NOT_FINITE: "the radiosity is NaN or infinite; check albedo, exitance and form factors",
}


class Solution(NamedTuple):
    """A radiosity and what is known about it.

    Attributes:
        radiosity: B, W/m2.
        residual: largest |M + rho F B - B| over the patches, W/m2.
        bound: largest |B - B*| is at most this, W/m2; infinite if q >= 1.
        iterations: products with F that were spent.
        status: `Status` codes; `advice(status)` says what to do.
    """

    radiosity: Float[Tensor, "*batch patch channel"]
    residual: Float[Tensor, "*batch channel"]
    bound: Float[Tensor, "*batch channel"]
    iterations: int
    status: Int[Tensor, "*batch channel"]


def advice(status: Int[Tensor, "..."] | int) -> str:
    """What the worst of the status codes means and what to do.

    >>> advice(2)
    'the radiosity is NaN or infinite; check albedo, exitance and form factors'
    """
    worst = int(status.max()) if isinstance(status, Tensor) and status.numel() else int(status)
    return _ADVICE[Status(worst)]


def reflected(
    form_factors: Float[Tensor, "*batch patch patch"],
    albedo: Float[Tensor, "*batch patch channel"],
    radiosity: Float[Tensor, "*batch patch channel"],
) -> Float[Tensor, "*batch patch channel"]:
    """rho F B: what the patches reflect of what all patches send, W/m2."""
    return albedo * (form_factors @ radiosity)


def certified(
    form_factors: Float[Tensor, "*batch patch patch"],
    albedo: Float[Tensor, "*batch patch channel"],
    exitance: Float[Tensor, "*batch patch channel"],
    radiosity: Float[Tensor, "*batch patch channel"],
    residual: Float[Tensor, "*batch patch channel"] | None = None,
    iterations: int = 0,
) -> Solution:
    """The solution with its residual (computed unless given) and its bound.

    Differentiable in: all tensors.
    Export: compile yes, ONNX yes.
    """
    if residual is None:
        residual = exitance + reflected(form_factors, albedo, radiosity) - radiosity
        iterations += 1
    largest = residual.abs().amax(-2)
    contraction = (albedo * form_factors.sum(-1, keepdim=True)).amax(-2)
    left = 1 - contraction
    bounded = left > 0
    bound = torch.where(bounded, guarded_divide(largest, torch.where(bounded, left, 1)), torch.inf)
    status = torch.where(bounded, int(Status.BOUNDED), int(Status.UNBOUNDED))
    finite = torch.isfinite(largest)
    status = torch.where(finite, status, int(Status.NOT_FINITE))
    return Solution(radiosity, largest, bound, iterations, status)
