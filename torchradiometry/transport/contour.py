"""The double contour integral of two polygons that lie wholly in front of each other.

    A_1 F_12 = 1/(2 pi) sum_e sum_f (e . f) L(e, f)
    L(e, f)  = int_0^1 int_0^1 ln |x_e(s) - y_f(t)| dt ds

e and f are the edges of both polygons, each counter-clockwise seen from its own front. The
inner integral is elementary: with p, q the ends of f seen from x, f = q - p,

    int_0^1 ln r dt = (q.f ln|q| - p.f ln|p| + |p x f| angle(p, q)) / |f|^2 - 1

The outer one is analytic except where r = 0 for complex s: at the ends c of f, s = foot of c on
e +- i (distance of c from e), and where the lines of e and f pass each other, s = foot +- i
(distance / sine). All lengths in units of |e|. Where these three lie far from 0..1 a
Gauss-Legendre rule of n points errs by rho^-2n, rho the sum of the half axes of the ellipse about
0..1 through the nearest of them; n follows from the tolerance. Otherwise 0..1 is cut at their
real parts and each part is mapped by s = s_k + D sinh(u), D the distance of the nearest
singularity from the cut s_k (P. Johnston and D. Elliott 2005); in u they lie about 1 away, however
near they were: shared edges, shared corners and gaps of any width cost 8 to 48 points a part.

The sum cancels: its rounding error is about 1e-16 |P_1| |P_2| / (2 pi), |P| the perimeters, so
this is the integral for near pairs; `exchange` takes product rules for far ones, and
`slender` for strips.

References: E. M. Sparrow, "A new and simpler formulation for radiative angle factors", J. Heat
Transfer 85 (1963), the double contour; P. Schroeder and P. Hanrahan, "On the form factor between
two polygons", SIGGRAPH 1993, its closed form by dilogarithms; P. R. Johnston and D. Elliott, "A
sinh transformation for evaluating nearly singular boundary element integrals", Int. J. Numer.
Meth. Eng. 62 (2005); L. N. Trefethen, *Approximation Theory and Approximation Practice* (2013),
ch. 19, for rho^-2n.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import angle_of, guarded_divide, safe_norm, safe_sqrt
from torchradiometry.transport.rules import line_rule

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = [
    "ORDERS",
    "PLAIN",
    "Pieces",
    "Singular",
    "contour_exchange",
    "graded_pieces",
    "graded_rule",
    "log_distance",
    "plain_order",
    "singularities",
]

#: orders of the Gauss-Legendre rules
ORDERS = (2, 3, 4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48)
#: an order beyond which the edge is cut and graded
PLAIN = 16
#: integrand values that are held at the same time
BLOCK = 2**15
#: singularities further than this from the edge, in its lengths, need no cut
AWAY = 0.5


class Singular(NamedTuple):
    """The singularities foot +- i height of the outer integrand, outer edge = 0..1."""

    foot: Float[Tensor, "row 3"]
    height: Float[Tensor, "row 3"]


def contour_exchange(
    first: Float[Tensor, "3 corner pair"],
    second: Float[Tensor, "3 other pair"],
    tolerance: Float[Tensor, "pair"],
) -> Float[Tensor, "pair"]:
    """A_1 F_12 of polygons that lie in front of each other's plane, in the square of their unit.

    Args:
        first, second: planar convex corners, counter-clockwise seen from the front, centred
            and in a unit of about their extent (ln r is then of order 1). Corners may repeat.
        tolerance: absolute error of the mean of ln r over an edge pair, > 0.

    Returns:
        The exchange area; its error is at most about `tolerance` |P_1| |P_2| / (2 pi).

    Differentiable in: first, second (the points of the rules are detached).
    Export: no, the number of points depends on the data; `UnoccludedFormFactors` does.
    References: Sparrow (1963).
    """
    edge, other = first.roll(-1, 1) - first, second.roll(-1, 1) - second
    weight = sum(a.unsqueeze(1) * b for a, b in zip(edge, other, strict=True))
    wanted = (edge != 0).any(0).unsqueeze(1) & (other != 0).any(0)
    if not weight.requires_grad:
        wanted = wanted & (weight != 0)
    e, f, pair = torch.nonzero(wanted, as_tuple=True)
    outer = torch.stack((first[:, e, pair], edge[:, e, pair]))
    inner = torch.stack((second[:, f, pair], other[:, f, pair]))
    swap = (outer[1].detach().square().sum(0) > inner[1].detach().square().sum(0)).expand_as(outer)
    outer, inner = torch.where(swap, inner, outer), torch.where(swap, outer, inner)
    mean = _mean_logarithm(outer, inner, tolerance[pair])
    terms = torch.zeros_like(weight).index_put((e, f, pair), mean) * weight
    return terms.sum((0, 1)) / (2 * math.pi)


def log_distance(
    start: Float[Tensor, "3 *batch"], end: Float[Tensor, "3 *batch"]
) -> Float[Tensor, "*batch"]:
    """Mean of ln r over an edge whose ends are seen at `start` and `end`, plus 1; components first.

    The constant is left out: it drops out of every closed contour.

    Differentiable in: both (kink on the edge, gradient 0 there).
    Export: compile yes, ONNX yes.
    """
    (px, py, pz), (qx, qy, qz) = start.unbind(), end.unbind()
    fx, fy, fz = qx - px, qy - py, qz - pz
    cross = (py * fz - pz * fy).square() + (pz * fx - px * fz).square()
    cross = cross + (px * fy - py * fx).square()
    near, far = px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz
    length = fx * fx + fy * fy + fz * fz
    # on the edge's own line only rounding is left of the cross product
    bend = safe_sqrt(torch.where(cross > _noise(near, far, length), cross, 0))
    along, beyond = px * fx + py * fy + pz * fz, qx * fx + qy * fy + qz * fz
    turn = bend * angle_of(bend, px * qx + py * qy + pz * qz)
    logs = beyond * _guarded_log(far) - along * _guarded_log(near)
    return guarded_divide(logs / 2 + turn, length)


def _noise(near: Tensor, far: Tensor, length: Tensor) -> Tensor:
    rounding = torch.finfo(near.dtype).eps ** 2
    return (torch.minimum(near, far) * length * rounding).detach()


def _guarded_log(square: Tensor) -> Tensor:
    positive = square > 0
    return torch.where(positive, torch.log(torch.where(positive, square, 1)), 0)


def _mean_logarithm(outer: Tensor, inner: Tensor, tolerance: Tensor) -> Float[Tensor, "row"]:
    """L(e, f) + 1 of every row; outer and inner are `(start, edge) 3 row`."""
    with torch.no_grad():
        singular = singularities(outer, inner)
        order = plain_order(singular, tolerance)
        plain = torch.nonzero(order <= PLAIN).squeeze(-1)
        graded = torch.nonzero(order > PLAIN).squeeze(-1)
        pieces = graded_pieces(Singular(*(s[graded] for s in singular)), tolerance[graded])
        row = graded[pieces.row]
    value = outer.new_zeros(outer.shape[-1])
    for n in ORDERS:
        if n <= PLAIN:
            chosen = plain[order[plain] == n]
            node, weight = line_rule(n, outer)
            for some in chosen.split(max(1, BLOCK // n)):
                found = _applied(outer[..., some], inner[..., some], node, weight)
                value = value.index_put((some,), found)
        chosen = torch.nonzero(pieces.order == n).squeeze(-1)
        for some in chosen.split(max(1, BLOCK // n)):
            node, weight = graded_rule(Pieces(*(p[some] for p in pieces)), n)
            at = row[some]
            found = _applied(outer[..., at], inner[..., at], node, weight)
            value = value.index_add(0, at, found)
    return value


def _applied(outer: Tensor, inner: Tensor, node: Tensor, weight: Tensor) -> Float[Tensor, "row"]:
    """The rule's sum over points of the outer edge of the inner integral."""
    start, edge = outer.unsqueeze(-1).unbind()
    corner, other = inner.unsqueeze(-1).unbind()
    near = (corner - start) - edge * node
    return (log_distance(near, near + other) * weight).sum(-1)


def singularities(outer: Tensor, inner: Tensor) -> Singular:
    """Those of both ends of the inner edge, and of the place where the lines pass."""
    start, edge = outer.detach().unbind()
    corner, other = inner.detach().unbind()
    offset = corner - start
    square, length = edge.square().sum(0), other.square().sum(0)
    ends = torch.stack((offset, offset + other), -1)
    foot = (ends * edge.unsqueeze(-1)).sum(0) / square.unsqueeze(-1)
    height = safe_norm((ends - edge.unsqueeze(-1) * foot).movedim(0, -1)) / square.sqrt().unsqueeze(
        -1
    )
    normal, moment = (
        torch.linalg.cross(edge, other, dim=0),
        torch.linalg.cross(offset, other, dim=0),
    )
    sine = normal.square().sum(0)
    skew = sine > torch.finfo(edge.dtype).eps * square * length
    sine = torch.where(skew, sine, 1)
    passing = (moment * normal).sum(0) / sine
    apart = ((moment - passing * normal).square().sum(0) / sine).sqrt()
    along = ((edge * passing - offset) * other).sum(0) / length
    here = skew & (along > -0.1) & (along < 1.1)
    away = torch.full_like(apart, torch.inf)
    foot = torch.cat((foot, torch.where(here, passing, 0).unsqueeze(-1)), -1)
    return Singular(foot, torch.cat((height, torch.where(here, apart, away).unsqueeze(-1)), -1))


def plain_order(singular: Singular, tolerance: Tensor) -> Int[Tensor, "row"]:
    """Points that a single Gauss-Legendre rule needs, rounded up to one of `ORDERS`."""
    foot, height = singular
    axis = torch.hypot(foot, height) + torch.hypot(1 - foot, height)
    axis = axis.amin(-1).clamp(min=1)
    rate = torch.log(axis + ((axis - 1) * (axis + 1)).sqrt())
    return _rounded_up(-torch.log(tolerance) / (2 * rate))


def _rounded_up(needed: Tensor) -> Int[Tensor, "row"]:
    orders = torch.tensor(ORDERS, device=needed.device)
    place = torch.searchsorted(orders.to(needed), needed.clamp(max=ORDERS[-1]))
    return orders[place]


class Pieces(NamedTuple):
    """Parts of outer edges: from `origin` towards `origin + length`, graded with `scale`."""

    row: Int[Tensor, "piece"]
    origin: Float[Tensor, "piece"]
    length: Float[Tensor, "piece"]
    scale: Float[Tensor, "piece"]
    order: Int[Tensor, "piece"]


def graded_pieces(singular: Singular, tolerance: Tensor) -> Pieces:
    """0..1 cut at the feet of near singularities, each part graded from one or both ends."""
    foot, height = singular
    near = torch.where(height < AWAY, foot.clamp(0, 1), 0)
    ends = foot.new_tensor([0.0, 1.0]).expand(len(foot), 2)
    cut = torch.cat((ends, near), -1).sort(-1).values
    distance = torch.hypot(foot.unsqueeze(1) - cut.unsqueeze(-1), height.unsqueeze(1)).amin(-1)
    # below this the integrand, of order s ln s, adds less than the tolerance
    distance = torch.maximum(distance, (tolerance / 64).sqrt().unsqueeze(-1))
    width = cut.diff(dim=-1)
    low, high = distance[:, :-1], distance[:, 1:]
    share = torch.where(high >= width, 1.0, torch.where(low >= width, 0.0, 0.5))
    origin = torch.stack((cut[:, :-1], cut[:, 1:]), -1)
    length = torch.stack((share * width, (share - 1) * width), -1)
    scale = torch.stack((low, high), -1)
    row, place, side = torch.nonzero(length, as_tuple=True)
    origin, length, scale = (t[row, place, side] for t in (origin, length, scale))
    reach = torch.asinh(length.abs() / scale)
    beyond = 2 * math.log(2) / reach
    rate = torch.log(1 + beyond + (beyond * (2 + beyond)).sqrt())
    order = _rounded_up(-torch.log(tolerance[row]) / (2 * rate))
    return Pieces(row, origin, length, scale, order)


def graded_rule(pieces: Pieces, order: int) -> tuple[Tensor, Tensor]:
    """Points and weights `piece point` of s = origin +- scale sinh(u)."""
    node, weight = line_rule(order, pieces.origin)
    reach = torch.asinh(pieces.length.abs() / pieces.scale).unsqueeze(-1)
    # the scale is found again from the reach, whose rounding would change the length
    scale, u = pieces.length.unsqueeze(-1) / torch.sinh(reach), reach * node
    point = pieces.origin.unsqueeze(-1) + scale * torch.sinh(u)
    return point, (scale * reach).abs() * weight * torch.cosh(u)
