"""Cutting a planar polygon at a plane, with an output of fixed size.

    keep the part with height >= 0,   cut = p_i + h_i / (h_i - h_{i+1}) (p_{i+1} - p_i)

`height` is any function that is linear over the polygon (the signed distance from the
receiver's horizon). Each edge gives two slots, its clipped start and end, so a polygon of n
corners always gives 2 n, whatever is cut: no data-dependent shapes. Slots with nothing of
their own to say hold a point *on the cut*, where a walk forth and back encloses nothing, so
every contour integral of the result (area, solid angle, irradiance) is that of the clipped
polygon, also when a non-convex one falls into several pieces.

References: I. E. Sutherland and G. W. Hodgman, "Reentrant Polygon Clipping", CACM 17 (1974).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from torchradiometry.errors import require_axes
from torchradiometry.numerics import guarded_divide

if TYPE_CHECKING:
    from jaxtyping import Bool, Float
    from torch import Tensor

__all__ = ["clip_polygon", "clip_slots"]


def clip_polygon(
    polygon: Float[Tensor, "*batch corner 3"], height: Float[Tensor, "*batch corner"]
) -> Float[Tensor, "*batch two_corners 3"]:
    """The part of a planar polygon where `height` >= 0, as 2 corners for each of its edges.

    Repeated corners and steps forth and back along the cut are part of the answer; a polygon
    wholly below collapses to one point (zero area).

    Args:
        polygon: corners in m, in either sense of rotation, convex or not.
        height: a linear function at the corners, in any unit; the kept side is >= 0.

    Returns:
        Corners in m, `2 * corner` of them, in the same sense.

    Differentiable in: polygon, height (kink where a corner crosses the plane).
    Export: compile yes, ONNX yes.
    References: Sutherland and Hodgman (1974).

    >>> square = torch.tensor([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    >>> clip_polygon(square, square[:, 1] - 1)[:, :2].unique(dim=0)
    tensor([[0., 1.],
            [0., 2.],
            [1., 1.],
            [2., 1.],
            [2., 2.]])
    """
    require_axes("polygon", polygon, None, 3)
    require_axes("height", height, None)
    slots = clip_slots(polygon.movedim((-1, -2), (0, 1)), height.movedim(-1, 0))
    return slots.movedim((0, 1), (-1, -2))


def clip_slots(
    polygon: Float[Tensor, "3 corner *batch"], height: Float[Tensor, "corner *batch"]
) -> Float[Tensor, "3 two_corners *batch"]:
    """`clip_polygon` with components and corners first, the layout that computes fast."""
    following, next_height = polygon.roll(-1, 1), height.roll(-1, 0)
    inside, next_inside = height >= 0, next_height >= 0
    crossing = inside != next_inside
    share = guarded_divide(height, torch.where(crossing, height - next_height, 0))
    cut = polygon + share * (following - polygon)
    anchor = _between(cut, crossing, polygon[:, :1])
    start = torch.where(inside, polygon, torch.where(next_inside, cut, anchor))
    end = torch.where(next_inside, following, torch.where(inside, cut, anchor))
    return torch.stack((start, end), 2).flatten(1, 2)


def _between(
    points: Float[Tensor, "3 corner *batch"],
    wanted: Bool[Tensor, "corner *batch"],
    otherwise: Float[Tensor, "3 1 *batch"],
) -> Float[Tensor, "3 1 *batch"]:
    """The mean of the wanted points, which lies on the line through them."""
    count = wanted.sum(0, keepdim=True)
    total = torch.where(wanted, points, 0).sum(1, keepdim=True)
    return torch.where(count > 0, total / count.clamp(min=1), otherwise)
