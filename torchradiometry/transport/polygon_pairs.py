"""Pairs of polygons made ready for integration: ordered, centred, scaled, and clipped.

    height of x above polygon P   h = n_P . (x - c_P)       K = 1/pi int int h_1 h_2 / r^4 dA dA

Each pair is moved to its common middle and divided by its extent, so that scale and place do not
matter, and put in an order of its own, so that exchanging its members changes no bit. What lies
behind the other's plane is cut off: then no horizon crosses either polygon. Components and
corners come first, pairs last: whole planes of numbers are combined.

References: I. E. Sutherland and G. W. Hodgman, "Reentrant Polygon Clipping", CACM 17 (1974).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide, safe_sqrt

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["Polygon", "PolygonPairs", "polygon_pairs", "vector_area"]

#: heights below this many roundings of the extent count as 0
ROUNDINGS = 64


class Polygon(NamedTuple):
    """One side of the pairs.

    Attributes:
        corner: in units of the pair's extent, about its middle.
        height: of the corners above the other's plane.
    """

    corner: Float[Tensor, "3 corner pair"]
    height: Float[Tensor, "corner pair"]

    @property
    def vector_area(self) -> Float[Tensor, "3 pair"]:
        """Area times normal."""
        return vector_area(self.corner)

    @property
    def area(self) -> Float[Tensor, "pair"]:
        """In squares of the unit."""
        return norm(self.vector_area)

    @property
    def edge(self) -> Float[Tensor, "3 corner pair"]:
        """From each corner to the next."""
        return self.corner.roll(-1, 1) - self.corner

    def at(self, index: Tensor) -> Polygon:
        """Of some pairs."""
        return Polygon(self.corner[..., index], self.height[..., index])

    def clipped(self) -> Polygon:
        """The part with height >= 0 of convex polygons, one corner more, repeated as needed."""
        every = torch.cat((self.corner, self.height.unsqueeze(0)))
        following, beyond = every.roll(-1, 1), self.height.roll(-1, 0)
        inside = self.height >= 0
        crossing = inside != (beyond >= 0)
        share = guarded_divide(self.height, torch.where(crossing, self.height - beyond, 0))
        slots = torch.stack((every, every + share * (following - every)), 2).flatten(1, 2)
        kept = torch.stack((inside, crossing), 1).flatten(0, 1)
        order = torch.sort((~kept).to(torch.uint8), dim=0, stable=True).indices
        last = (kept.sum(0) - 1).clamp(min=0)
        place = torch.arange(len(inside) + 1, device=last.device).unsqueeze(1).minimum(last)
        chosen = slots.gather(1, order.gather(0, place).expand(4, -1, -1))
        return Polygon(chosen[:3], chosen[3])

    def fan(self) -> Polygon:
        """The triangles from the first corner: `pair` becomes `triangle pair`."""
        triangles = self.corner.shape[1] - 2
        corner, height = self
        return Polygon(
            torch.stack(
                (corner[:, :1].expand(-1, triangles, -1), corner[:, 1:-1], corner[:, 2:]), 1
            ),
            torch.stack((height[:1].expand(triangles, -1), height[1:-1], height[2:])),
        )


class PolygonPairs(NamedTuple):
    """Pairs with what decides how they are integrated.

    Attributes:
        first, second: the polygons.
        facing: some of each lies in front of the other.
        cut: some of one lies behind the other's plane.
        unit: m.
    """

    first: Polygon
    second: Polygon
    facing: Bool[Tensor, "pair"]
    cut: Bool[Tensor, "pair"]
    unit: Float[Tensor, "pair"]


def polygon_pairs(
    first: Float[Tensor, "pair corner 3"], second: Float[Tensor, "pair other 3"]
) -> PolygonPairs:
    """Order, centre and scale pairs, and measure the heights above each other's planes.

    Args:
        first, second: planar convex polygons, m, float64.

    Differentiable in: both (unit and middle are detached).
    """
    planes = (t.permute(2, 1, 0).contiguous() for t in (first, second))
    first, second, unit = _normalised(*_ordered(*planes))
    one, other = (Polygon(a, _heights(a, b)) for a, b in ((first, second), (second, first)))
    slack = torch.finfo(first.dtype).eps * ROUNDINGS
    low, high = one.height.detach().aminmax(dim=0)
    other_low, other_high = other.height.detach().aminmax(dim=0)
    facing = torch.minimum(high, other_high) > slack
    return PolygonPairs(one, other, facing, torch.minimum(low, other_low) < -slack, unit)


def norm(vector: Float[Tensor, "3 *batch"]) -> Float[Tensor, "*batch"]:
    """Euclidean length over the first axis, gradient 0 at 0."""
    x, y, z = vector.unbind()
    return safe_sqrt(x * x + y * y + z * z)


def _ordered(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """More corners first; of equally many, the smaller in the order of their coordinates."""
    if first.shape[1] != second.shape[1]:
        return (first, second) if first.shape[1] > second.shape[1] else (second, first)
    difference = (first - second).detach().flatten(0, 1)
    larger = torch.zeros_like(difference[0])
    for step in difference.flip(0).unbind():
        larger = torch.where(step != 0, step, larger)
    swap = larger > 0
    return torch.where(swap, second, first), torch.where(swap, first, second)


def _normalised(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """About the middle of all corners, and the largest coordinate, which becomes 1."""
    base = first.detach()[:, :1]
    first, second = first - base, second - base
    middle = first.detach().mean(1, keepdim=True) + second.detach().mean(1, keepdim=True)
    first, second = first - middle / 2, second - middle / 2
    unit = torch.maximum(*(t.detach().abs().amax((0, 1)) for t in (first, second)))
    unit = torch.where(unit > 0, unit, 1)
    return first / unit, second / unit, unit


def vector_area(corner: Tensor) -> Float[Tensor, "3 pair"]:
    """Area times normal of polygons `3 corner pair`.

    Each triangle of a fan by an edge and the shorter of its spokes: in needles one of the two is
    short, whichever corner comes first, and the product of two long ones would cancel.
    """
    spoke, edge = corner[:, 1:] - corner[:, :1], corner[:, 2:] - corner[:, 1:-1]
    square = spoke.detach().square().sum(0)
    spoke = torch.where(square[:-1] < square[1:], spoke[:, :-1], spoke[:, 1:])
    (ax, ay, az), (bx, by, bz) = spoke.unbind(), edge.unbind()
    return torch.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)).sum(1) / 2


def _heights(corner: Tensor, polygon: Tensor) -> Float[Tensor, "corner pair"]:
    area = vector_area(polygon)
    normal = guarded_divide(area, norm(area).expand_as(area)).unsqueeze(1)
    x, y, z = ((corner - polygon.mean(1, keepdim=True)) * normal).unbind()
    return x + y + z
