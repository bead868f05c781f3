"""Slender polygons, and small beside large ones, some way off: where the contour integral cancels.

    A_1 F_12 = 1/pi int_1 E_2(x) dA,    E_2 the irradiance of polygon 2 of radiance 1, exact

The double contour adds terms of the size of both perimeters; strips a thousand widths apart
exchange a billionth of that, and the roundings are what is left. Here nothing cancels: E_2 is
Lambert's sum, which keeps its digits (`polygon_irradiance`), and E_2 >= 0. The thinner polygon is
cut into triangles x(u, v), u along them and v across. E_2 is analytic but at the outline of
polygon 2: across, a Gauss-Legendre rule does, as the outline is at least a width away; along, it
does for short ones, otherwise u is cut and graded at the feet of the outline's corners as in
`contour`. Each triangle has a normal of its own: by Stokes the sum is that of the outlines, also
where a quad's corners leave their plane, and so are the gradients.

References: `contour`; `geometry.polygon_irradiance`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.numerics import guarded_divide
from torchradiometry.transport.contour import (
    ORDERS,
    PLAIN,
    Pieces,
    Singular,
    graded_pieces,
    graded_rule,
    plain_order,
    singularities,
)
from torchradiometry.transport.polygon_pairs import norm, vector_area
from torchradiometry.transport.rules import line_rule

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["cancels", "slender_exchange"]

#: points across: with the outline a width away they err by 4.2^-24, 1e-15
ACROSS = 12
#: widths that a polygon, or the larger one, is long at least: others that lose digits nearly lie
#: in one plane, may be many, and take fifty times as long here
LONG = 250.0
#: how much less than the whole the rules along may err
SHARPER = 1024
#: points that are held at the same time
BLOCK = 2**12


@torch.no_grad()
def cancels(
    first: Float[Tensor, "3 corner pair"],
    second: Float[Tensor, "3 other pair"],
    value: Float[Tensor, "pair"],
    rtol: float,
) -> Bool[Tensor, "pair"]:
    """Whether the contour's `value` is not sure to `rtol`, and `slender_exchange` will be."""
    around = [norm(t.roll(-1, 1) - t).sum(0) for t in (first, second)]
    rounding = torch.finfo(value.dtype).eps / 2 * around[0] * around[1] / (2 * math.pi)
    doubtful = rounding > rtol / 2 * value
    (chosen,) = torch.nonzero(doubtful, as_tuple=True)
    strip, other = _thinner_first(first[..., chosen], second[..., chosen])
    parts = _lengthwise(strip)
    wide = norm(parts[:, 2] - parts[:, 0]).amax(0)
    long = torch.maximum(_extent(strip), _extent(other)) > LONG * wide
    apart = wide[long] <= _gap(strip[..., long], other[..., long])
    doubtful[chosen] = long.index_put((long,), apart)
    return doubtful


def slender_exchange(
    first: Float[Tensor, "3 corner pair"],
    second: Float[Tensor, "3 other pair"],
    rtol: float,
) -> Float[Tensor, "pair"]:
    """A_1 F_12 of convex polygons that lie in front of each other's plane; corners may repeat.

    Differentiable in: first, second (the points of the rules are detached).
    Export: no, the number of points depends on the data.
    """
    thinner, other = _thinner_first(first, second)
    parts = _lengthwise(thinner).flatten(2)
    (real,) = torch.nonzero(norm(vector_area(parts.detach())), as_tuple=True)
    pair = real % first.shape[-1]
    strip, other = parts[..., real], other[..., pair]
    axis = _axis(strip)
    with torch.no_grad():
        edges = torch.stack((other, other.roll(-1, 1) - other))
        sides = edges.shape[2]
        along = axis.unsqueeze(2).expand(-1, -1, sides, -1)
        found = singularities(along.flatten(2), edges.flatten(2))
        feet = (t.unflatten(0, (sides, -1)).movedim(0, 1).flatten(1) for t in found)
        singular = Singular(*feet)
        tolerance = torch.full_like(axis[0, 0], max(rtol / SHARPER, torch.finfo(axis.dtype).eps))
        plain = plain_order(singular, tolerance)
        long = torch.nonzero(plain > PLAIN).squeeze(-1)
        pieces = graded_pieces(Singular(*(t[long] for t in singular)), tolerance[long])
        pieces = pieces._replace(row=long[pieces.row])
    value = 0 * (first.sum((0, 1)) + second.sum((0, 1)))
    for order in ORDERS:
        size = max(1, BLOCK // (order * ACROSS))
        graded = torch.nonzero(pieces.order == order).squeeze(-1)
        rules = [
            (part.row, *graded_rule(part, order))
            for part in (Pieces(*(p[some] for p in pieces)) for some in graded.split(size))
        ]
        if order <= PLAIN:
            u, weight = (t.unsqueeze(0) for t in line_rule(order, axis))
            rules += [(r, u, weight) for r in torch.nonzero(plain == order).squeeze(-1).split(size)]
        for row, u, weight in rules:
            mean = _weighted(strip[..., row], other[..., row], u, weight, rtol)
            value = value.index_add(0, pair[row], mean)
    return value / math.pi


def _weighted(
    strip: Tensor, other: Tensor, u: Tensor, weight: Tensor, rtol: float
) -> Float[Tensor, "row"]:
    """The rule's sum of E times the area element over points `row u v`."""
    v, across = line_rule(ACROSS, strip)
    u, corners = u.unsqueeze(-1), strip.movedim(0, -1)[..., None, None, :]
    (a, b, c), s, t = corners.unbind(), u.unsqueeze(-1), v.unsqueeze(-1)
    along, sideways = b - a + t * (a - c), (1 - s) * (c - a)
    point = a + s * (b - a) + t * sideways
    element = torch.linalg.cross(along, sideways)
    area = norm(element.movedim(-1, 0))
    normal = guarded_divide(element, area.unsqueeze(-1).expand_as(element))
    polygon = other.permute(2, 1, 0)[:, None, None].expand(*point.shape[:3], -1, 3)
    light = polygon_irradiance(point, normal, polygon, rounding=rtol / 8)
    return (light * area * weight.unsqueeze(-1) * across).sum((1, 2))


def _thinner_first(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """The polygon of less area for its extent, and the other, with the same number of corners."""
    corners = max(first.shape[1], second.shape[1])
    pair = [
        torch.cat((t, t[:, -1:].expand(-1, corners - t.shape[1], -1)), 1) for t in (first, second)
    ]
    width = [guarded_divide(norm(vector_area(t)).detach(), _extent(t)) for t in pair]
    swap = width[1] < width[0]
    return torch.where(swap, pair[1], pair[0]), torch.where(swap, pair[0], pair[1])


def _extent(polygon: Tensor) -> Float[Tensor, "pair"]:
    """Largest distance of two corners."""
    corner = polygon.detach()
    return norm(corner.unsqueeze(1) - corner.unsqueeze(2)).amax((0, 1))


def _lengthwise(polygon: Tensor) -> Float[Tensor, "3 3 triangle pair"]:
    """The triangles from the first corner, each `a b c` with its shortest edge from c to a."""
    count = polygon.shape[1] - 2
    first = polygon[:, :1].expand(-1, count, -1)
    fan = torch.stack((first, polygon[:, 1:-1], polygon[:, 2:]), 1)
    edge = norm((fan.roll(-1, 1) - fan).detach())
    order = torch.arange(1, 4, device=edge.device)[:, None, None] + edge.argmin(0)
    return fan.gather(1, (order % 3).expand(3, -1, -1, -1))


def _axis(strip: Tensor) -> Float[Tensor, "2 3 row"]:
    """Start and extent of the middle line."""
    a, b, c = strip.detach().unbind(1)
    start = (a + c) / 2
    return torch.stack((start, b - start))


def _gap(strip: Tensor, other: Tensor) -> Float[Tensor, "pair"]:
    """Smallest distance of two outlines: at a corner, or where two edges pass each other."""
    edges = [torch.stack((t, t.roll(-1, 1) - t)) for t in (strip, other)]
    count = [t.shape[2] for t in edges]
    first = edges[0].unsqueeze(3).expand(-1, -1, -1, count[1], -1).flatten(2)
    second = edges[1].unsqueeze(2).expand(-1, -1, count[0], -1, -1).flatten(2)
    apart = torch.minimum(_apart(first, second), _apart(second, first))
    return apart.unflatten(0, (count[0] * count[1], -1)).amin(0)


def _apart(outer: Tensor, inner: Tensor) -> Float[Tensor, "row"]:
    """Smallest distance of the ends of `inner`, and of the place of passing, from `outer`."""
    length = norm(outer[1])
    foot, height = singularities(outer, inner)
    beyond = foot - foot.clamp(0, 1)
    apart = torch.hypot(beyond, height).amin(-1) * length
    return torch.where(length > 0, apart, torch.inf)  # a repeated corner is the end of others
