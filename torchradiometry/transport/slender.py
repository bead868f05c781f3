"""Slender polygons, and small beside large ones, some way off: where the contour integral cancels.

    A_1 F_12 = 1/pi int_1 E_2(x) dA,    E_2 the irradiance of polygon 2 of radiance 1, exact

The double contour adds terms of the size of both perimeters; strips a thousand widths apart
exchange a billionth of that, and the roundings are what is left. Here nothing cancels: E_2 is
Lambert's sum, which keeps its digits (`polygon_irradiance`), and E_2 >= 0. The thinner polygon is
x(u, v), bilinear, u along it and v across. E_2 is analytic but at the outline of polygon 2:
across, a Gauss-Legendre rule does, as the outline is at least a width away; along, it does for
short ones, otherwise u is cut and graded at the feet of the outline's corners as in `contour`.

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
from torchradiometry.transport.polygon_pairs import norm
from torchradiometry.transport.rules import line_rule

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["cancels", "slender_exchange"]

#: points across: with the outline a width away they err by 4.2^-24, 1e-15
ACROSS = 12
#: widths that a polygon, or the larger one, is long at least: others that lose digits nearly lie
#: in one plane, may be many, and take fifty times as long here
LONG = 250.0
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
    chosen = torch.nonzero(doubtful).squeeze(-1)
    if len(chosen):
        strip, other = _thinner_first(first[..., chosen], second[..., chosen])
        start, end = strip[:, 0], strip[:, 1]
        wide = torch.maximum(norm(strip[:, 3] - start), norm(strip[:, 2] - end))
        longest = torch.maximum(norm(_axis(strip)[1]), norm(_axis(other)[1]))
        doubtful[chosen] = (longest > LONG * wide) & (wide <= _gap(strip, other))
    return doubtful


def slender_exchange(
    first: Float[Tensor, "3 corner pair"],
    second: Float[Tensor, "3 other pair"],
    rtol: float,
) -> Float[Tensor, "pair"]:
    """A_1 F_12 of polygons that lie in front of each other's plane, at most quads.

    Differentiable in: first, second (the points of the rules are detached).
    Export: no, the number of points depends on the data.
    """
    strip, other = _thinner_first(first, second)
    axis = _axis(strip)
    with torch.no_grad():
        edges = torch.stack((other, other.roll(-1, 1) - other))
        count = edges.shape[2]
        along = axis.unsqueeze(2).expand(-1, -1, count, -1)
        found = singularities(along.flatten(2), edges.flatten(2))
        feet = (t.unflatten(0, (count, -1)).movedim(0, 1).flatten(1) for t in found)
        singular = Singular(*feet)
        tolerance = torch.full_like(axis[0, 0], torch.finfo(axis.dtype).eps)
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
            value = value.index_add(0, row, mean)
    return value / math.pi


def _weighted(
    strip: Tensor, other: Tensor, u: Tensor, weight: Tensor, rtol: float
) -> Float[Tensor, "row"]:
    """The rule's sum of E times the area element over points `row u v`."""
    v, across = line_rule(ACROSS, strip)
    u, corners = u.unsqueeze(-1), strip.movedim(0, -1)[..., None, None, :]
    (a, b, c, d), s, t = corners.unbind(), u.unsqueeze(-1), v.unsqueeze(-1)
    point = (1 - t) * (a + s * (b - a)) + t * (d + s * (c - d))
    along = (1 - t) * (b - a) + t * (c - d)
    sideways = (1 - s) * (d - a) + s * (c - b)
    element = torch.linalg.cross(along, sideways)
    area = norm(element.movedim(-1, 0))
    normal = guarded_divide(element, area.unsqueeze(-1).expand_as(element))
    polygon = other.permute(2, 1, 0)[:, None, None].expand(*point.shape[:3], -1, 3)
    light = polygon_irradiance(point, normal, polygon, rounding=rtol / 64)
    return (light * area * weight.unsqueeze(-1) * across).sum((1, 2))


def _thinner_first(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """The thinner polygon as a quad `a b c d`, a b and d c along it; and the other."""
    quads = [_lengthwise(t) for t in (first, second)]
    width = [norm(q[:, 3] - q[:, 0]) + norm(q[:, 2] - q[:, 1]) for q in quads]
    swap = width[1] < width[0]
    return torch.where(swap, quads[1], quads[0]), torch.where(swap, quads[0], quads[1])


def _lengthwise(polygon: Tensor) -> Float[Tensor, "3 4 pair"]:
    """A quad (of a triangle, with the corner opposite the shortest edge twice) by its length."""
    edge = norm(polygon.detach().roll(-1, 1) - polygon.detach())
    if polygon.shape[1] == 3:
        start = edge.argmin(0)  # of the shortest edge: its end comes first, then the far corner
        order = torch.tensor([1, 2, 2, 0], device=edge.device).unsqueeze(1) + start
    else:
        turn = (edge[1] + edge[3] > edge[0] + edge[2]).long()
        order = torch.arange(4, device=edge.device).unsqueeze(1) + turn
    return polygon.gather(1, (order % polygon.shape[1]).expand(3, -1, -1))


def _axis(strip: Tensor) -> Float[Tensor, "2 3 pair"]:
    """Start and extent of the middle line."""
    start = (strip[:, 0] + strip[:, 3]).detach() / 2
    return torch.stack((start, (strip[:, 1] + strip[:, 2]).detach() / 2 - start))


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
