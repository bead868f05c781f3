"""Directions over a picture, and the heights met along them.

    e_a = (cos a, sin a) / max(|cos a|, |sin a|),     a = 2 pi (i + 1/2) / count

A step e moves one pixel along the longer axis, so k steps end on a column (or row) of pixel
centres, where heights are linear between two of them: `Neighbours` names the two and the share
of the second. A plane stays a plane, and no height is used twice in one step.

Pixels are numbered row by row; the number after the last one stands for everything outside.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["Neighbours", "azimuth_steps", "directions", "gathered", "neighbours"]


class Neighbours(NamedTuple):
    """Two pixels and the share of the second: where a line of pixels is crossed."""

    first: Int[Tensor, "*batch"]
    second: Int[Tensor, "*batch"]
    share: Float[Tensor, "*batch"]


def directions(count: int) -> list[tuple[float, float]]:
    """du and dv of `count` directions, evenly spread in angle.

    >>> directions(4)[0]
    (1.0, 1.0)
    """
    found = []
    for k in range(count):
        across, down = (f(math.tau * (k + 0.5) / count) for f in (math.cos, math.sin))
        longer = max(abs(across), abs(down))
        eighths, rest = divmod(8 * k + 4, count)
        if rest == 0 and eighths % 2:  # a diagonal, whatever the rounding of sine and cosine
            found.append((math.copysign(1, across), math.copysign(1, down)))
        else:
            found.append((across / longer, down / longer))
    return found


def azimuth_steps(
    count: int, like: Tensor
) -> tuple[Float[Tensor, "azimuth 1"], Float[Tensor, "azimuth 1"]]:
    """`directions` as tensors."""
    found = torch.tensor(directions(count), dtype=like.dtype, device=like.device)
    return found[:, :1], found[:, 1:]


def neighbours(
    size: tuple[int, int],
    pixel: tuple[Tensor, Tensor],
    step: tuple[Tensor, Tensor],
    count: Tensor | int,
) -> Neighbours:
    """The pixels between which `count` steps from each pixel end; all arguments broadcast.

    Args:
        size: height and width of the picture.
        pixel: u and v of the starts, at centres of pixels.
        step: du and dv, the longer of them +-1.
        count: how many steps, >= 1.

    Differentiable in: step (through the share).
    Export: compile yes, ONNX yes.
    """
    columns_crossed = step[0].abs() >= step[1].abs()
    column = pixel[0] - 0.5 + count * step[0]
    row = pixel[1] - 0.5 + count * step[1]
    # a step of the longer axis is +-1 up to rounding
    column = torch.where(columns_crossed, column.round(), column)
    row = torch.where(columns_crossed, row, row.round())
    left, top = column.detach().floor(), row.detach().floor()
    share = torch.where(columns_crossed, row - top, column - left)
    beside = columns_crossed.to(left.dtype)
    first = _numbered(size, left, top)
    return Neighbours(first, _numbered(size, left + 1 - beside, top + beside), share)


def gathered(values: Float[Tensor, "one_more k"], where: Neighbours) -> Float[Tensor, "*batch k"]:
    """Rows of `values`, linear between the two neighbours; its last row is what lies outside."""
    first = values.index_select(0, where.first.flatten())
    second = values.index_select(0, where.second.flatten())
    share = where.share.reshape(-1, 1)
    return torch.lerp(first, second, share).reshape(*where.first.shape, -1)


def _numbered(size: tuple[int, int], column: Tensor, row: Tensor) -> Tensor:
    height, width = size
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return torch.where(inside, row * width + column, height * width).to(torch.int64)
