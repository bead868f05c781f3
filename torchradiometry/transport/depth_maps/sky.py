"""Sky visibility and the bent normal of every pixel of a depth map.

    V(x) = 1/pi  integral over the visible sky of  max(0, n . w) dw
    b(x) =       integral over the visible sky of  w max(0, n . w) dw,   normalised

V is the share of a uniform sky's irradiance that arrives (ambient occlusion), b the mean
direction that it arrives from. Along each azimuth both are closed forms of the horizon
(`horizons`).

The horizon is the steepest of the heights met. Only that one height takes part in gradients: where
another becomes the steepest the horizon is continuous and its gradient jumps.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from torchradiometry.geometry.image_space import HeightField
from torchradiometry.numerics import safe_normalize
from torchradiometry.transport.depth_maps.azimuths import directions, neighbours
from torchradiometry.transport.depth_maps.horizons import (
    SlicedPixels,
    below,
    cosine_moments,
    lit_share,
)

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["horizon", "open_sky"]


def horizon(
    field: HeightField, pixels: SlicedPixels, reach: int
) -> Float[Tensor, "azimuth pixel B"]:
    """c(x, a), cot theta of the horizon.

    Args:
        field: the map that `pixels` are of.
        pixels: all its pixels, cut by slices.
        reach: how many pixels far to look.

    Differentiable in: the heights, through the steepest of those met; the tangent plane.
    Export: compile yes, ONNX yes.
    """
    azimuths = pixels.step[0].shape[0]
    height = field.height.detach()
    held = torch.where(field.seen, height, below(height))
    held = functional.pad(held, (reach + 1,) * 4, value=below(height))
    nearest = torch.stack([_steepest(held, height, a, reach) for a in directions(azimuths)])
    count = nearest.flatten(2).mT
    slope = (_met(pixels, count) - pixels.own) / count
    return torch.maximum(pixels.tangent, pixels.slices.alpha * slope + pixels.slices.beta)


def _steepest(
    held: Float[Tensor, "B framed_H framed_W"],
    height: Float[Tensor, "B H W"],
    step: tuple[float, float],
    reach: int,
) -> Float[Tensor, "B H W"]:
    """The number of steps to the height that is seen steepest in one direction."""
    rows, columns = height.shape[-2:]
    slope, nearest = torch.full_like(height, -torch.inf), torch.ones_like(height)
    for count in range(1, reach + 1):
        right, low = reach + 1 + count * step[0], reach + 1 + count * step[1]
        left, top = math.floor(right), math.floor(low)
        columns_crossed = abs(step[0]) >= abs(step[1])
        share = low - top if columns_crossed else right - left
        first = held[:, top : top + rows, left : left + columns]
        top, left = (top + 1, left) if columns_crossed else (top, left + 1)
        second = held[:, top : top + rows, left : left + columns]
        # in place: nothing here has a gradient, and fresh memory costs more than the arithmetic
        found = torch.lerp(first, second, share).sub_(height).div_(count)
        nearest.masked_fill_(found > slope, count)
        slope = torch.maximum(slope, found)
    return nearest


def _met(pixels: SlicedPixels, count: Tensor) -> Tensor:
    """The heights that `count` steps meet, each pixel having its own count, with gradients."""
    step = tuple(t.unsqueeze(-1) for t in pixels.step)
    where = neighbours(pixels.size, tuple(t.unsqueeze(-1) for t in pixels.pixel), step, count)  # type: ignore[arg-type]
    ends = (pixels.heights.gather(0, index.flatten(0, 1)) for index in (where.first, where.second))
    first, second = ends
    share = where.share.flatten(0, 1)
    return torch.lerp(first, second, share).reshape(count.shape)


def open_sky(
    pixels: SlicedPixels, cot: Float[Tensor, "azimuth pixel B"]
) -> tuple[Float[Tensor, "pixel B"], Float[Tensor, "3 pixel B"]]:
    """V, 0..1, and the unit bent normal (the normal where no sky is seen is 0).

    Differentiable in: all.
    Export: compile yes, ONNX yes.
    """
    share = (lit_share(cot, pixels.normal) * pixels.weight).sum(0) / math.pi
    vertical, sideways = (m * pixels.weight for m in cosine_moments(cot, pixels.normal))
    eye, side = pixels.slices.eye, pixels.slices.side
    bent = torch.stack(
        [eye[k] * vertical.sum(0) + (side[k] * sideways).sum(0) for k in range(3)], -1
    )
    return share.clamp(max=1), safe_normalize(bent).movedim(-1, 0)
