"""What every solver returns, and what its status means."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

from torch import Tensor

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["Solution", "Status", "advice"]


class Status(IntEnum):
    """How a solve ended, per right-hand side; the larger, the worse."""

    BOUNDED = 0
    NOT_CONVERGED = 1
    UNBOUNDED = 2
    SINGULAR = 3
    NOT_FINITE = 4


_ADVICE = {
    Status.BOUNDED: "the error is at most `bound`; add bounces to make it smaller",
    Status.NOT_CONVERGED: (
        "the iteration stopped before its tolerance; the error is at most `bound`: allow more "
        "iterations, or a larger tolerance"
    ),
    Status.UNBOUNDED: (
        "some patch reflects all that it receives (albedo x row sum >= 1), so this bound is "
        "infinite; lower the albedo below 1 or open the scene"
    ),
    Status.SINGULAR: (
        "no light is ever absorbed, so there is no solution; lower some albedo below 1 or open "
        "the scene"
    ),
    Status.NOT_FINITE: "the radiosity is NaN or infinite; check albedo, exitance and form factors",
}


class Solution(NamedTuple):
    """A radiosity and what is known about it.

    Attributes:
        radiosity: B, W/m2.
        residual: largest |M + rho F B - B| over the patches, W/m2.
        bound: largest |B - B*| is at most this, W/m2, rounding included; infinite if unknown.
        iterations: products with F that were spent.
        status: `Status` codes; `advice(status)` says what to do.
        bounces: on request, B by the number of reflections (the last entry holds the rest);
            they sum to `radiosity`, W/m2.
    """

    radiosity: Float[Tensor, "*batch patch channel"]
    residual: Float[Tensor, "*batch channel"]
    bound: Float[Tensor, "*batch channel"]
    iterations: int | Tensor
    status: Int[Tensor, "*batch channel"]
    bounces: Float[Tensor, "*batch bounce patch channel"] | None = None


def advice(status: Int[Tensor, "..."] | int) -> str:
    """What the worst of the status codes means and what to do.

    >>> advice(4)
    'the radiosity is NaN or infinite; check albedo, exitance and form factors'
    """
    worst = int(status.max()) if isinstance(status, Tensor) and status.numel() else int(status)
    return _ADVICE[Status(worst)]
