"""Exchange areas of unoccluded polygons, symmetric, to a relative error of choice.

    K_ij = A_i F_ij = 1/pi  int_i int_j  cos_i+ cos_j+ / r^2  dA dA = A_j F_ji      (m2)

Only the part of each polygon in front of the other's plane counts: pairs that such a plane cuts
are clipped first. Then a = (r - R_small) / R_large decides, r the distance of the centroids, R
the largest distance of a corner from its centroid:

* far: a product rule of degree d on both, the lowest with C_d a^-d (s + 1/a) <= `rtol`. s is the
  spread (max - min) / (max + min) of the heights of one polygon above the other's plane: where a
  polygon is seen at grazing incidence its brightness varies from 0, and rules lose one order.
  All terms are positive and nothing cancels, at any distance. The C_d are measured: no pair of
  24 000 random triangles and quads, slender and unequal ones among them, lies above them.
  Of the pairs of a matrix, most are far and not cut: blocks of them are done at once
  (`exchange_blocks`).
* near: the double contour integral (`contour`), with a tolerance that follows from `rtol` and
  from an estimate of K. Its rounding error is about 1e-16 |P_1| |P_2| / (2 pi), |P| the
  perimeters, so `rtol` = 1e-10 holds for K > 1e-6 |P_1| |P_2|: touching squares from 1 to 179
  degrees, and sizes up to about 10^4 apart. Slender polygons and small ones beside large ones,
  which exchange less, are done again where that is not enough (`slender`), if they (or what is
  left of those that a plane cuts) are a width or more away.

References: `contour`; P. J. Davis and P. Rabinowitz, *Methods of Numerical Integration* (1984),
5.6, product rules; M. Cohen and J. Wallace, *Radiosity and Realistic Image Synthesis* (1993),
ch. 4.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import ShapeError, require_between
from torchradiometry.geometry.patches import Patches, check_corners, check_patches
from torchradiometry.numerics import guarded_divide, wide
from torchradiometry.transport.contour import contour_exchange
from torchradiometry.transport.exchange_blocks import (
    RULES,
    dense_exchange,
    lowest_rule,
    surface_points,
)
from torchradiometry.transport.polygon_pairs import Polygon, PolygonPairs, norm, polygon_pairs
from torchradiometry.transport.slender import cancels, slender_exchange

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["RTOL", "polygon_exchange", "unoccluded_exchange"]

#: relative error of a pair unless asked otherwise
RTOL = 10.0**-10
#: pairs that are prepared at a time, and products of points that are held at a time
PAIRS, PRODUCTS = 2**13, 2**15


def polygon_exchange(
    first: Float[Tensor, "pair corner 3"],
    second: Float[Tensor, "pair other 3"],
    rtol: float = RTOL,
) -> Float[Tensor, "pair"]:
    """A_1 F_12 of pairs of one-sided polygons without blockers, m2, exactly symmetric.

    Args:
        first, second: triangles or planar convex quads, m, counter-clockwise seen from the
            front; any size and distance, touching, nearly touching or far away.
        rtol: relative error of every pair, 1e-12...0.1.

    Returns:
        m2, float64, >= 0; 0 where either has no area, lies behind the other, or in its plane
        (coincident faces see nothing of each other).

    Raises:
        ShapeError: not polygons, or not as many first as second.
        InvalidValueError: NaN or infinite corners.
        DTypeError, OutOfRangeError: an `rtol` that is no number between 0 and 1; lengths as of
            `form_factors`.

    Differentiable in: both (kinks where a corner crosses the other's plane and where edges
        meet; finite there).
    Export: no, the choice of rules depends on the data; `UnoccludedFormFactors` does.
    References: Sparrow (1963), see `contour`.

    >>> floor = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    >>> wall = torch.tensor([[[0.0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]]])
    >>> round(float(polygon_exchange(floor, wall)), 12)  # two faces of a cube
    0.200043776075
    """
    check_corners("first", first)
    check_corners("second", second)
    if len(first) != len(second):
        got = f"{len(first)} and {len(second)} polygons"
        raise ShapeError("first, second", got, "pass one of each for every pair")
    require_between("rtol", rtol, 0, 1, "a relative error such as 1e-10 or 1e-3")
    first, second = wide(first, second)
    every = torch.arange(len(first), device=first.device)
    return _exchange(first, second, every, every, rtol)


def unoccluded_exchange(patches: Patches, rtol: float = RTOL) -> Float[Tensor, "patch patch"]:
    """K_ij = A_i F_ij of one-sided patches without blockers, m2, symmetric to the last bit.

    Args:
        patches: triangles or planar convex quads, one-sided.
        rtol: relative error of every pair.

    Returns:
        m2, float64; the diagonal is 0.

    Raises:
        InvalidValueError: NaN or infinite corners.
        ShapeError: not triangles or quads.
        DTypeError, OutOfRangeError: an `rtol` that is no number between 0 and 1; lengths as of
            `form_factors`.

    Differentiable in: corners (kinks where a corner crosses another patch's plane).
    Export: no, see `polygon_exchange`.
    """
    check_patches(patches)
    require_between("rtol", rtol, 0, 1, "a relative error such as 1e-10 or 1e-3")
    corners = wide(patches.corners)[0]
    upper, i, j = dense_exchange(corners, rtol)
    upper = upper.index_put((i, j), _exchange(corners, corners, i, j, rtol))
    return upper + upper.mT


def _exchange(
    first: Tensor, second: Tensor, i: Tensor, j: Tensor, rtol: float
) -> Float[Tensor, "pair"]:
    """The pairs (first[i], second[j]), in blocks; near ones are collected and come last."""
    blocks, near = [first.new_zeros(0)], [i[:0]]
    for place in torch.arange(len(i), device=i.device).split(PAIRS):
        pairs = polygon_pairs(first[i[place]], second[j[place]])
        rule = _rule(pairs.first, pairs.second, rtol)
        near.append(place[(rule < 0) & pairs.facing])
        blocks.append(_far(pairs, rule))
    found = [first.new_zeros(0)]
    index = torch.cat(near)
    for place in index.split(PAIRS):
        found.append(_near(polygon_pairs(first[i[place]], second[j[place]]), rtol))
    return torch.cat(blocks).index_put((index,), torch.cat(found))


@torch.no_grad()
def _rule(first: Polygon, second: Polygon, rtol: float) -> Int[Tensor, "pair"]:
    """Which of `RULES` suffices; -1: none, the contour integral."""
    corners = (first.corner, second.corner)
    middle = [t.mean(1) for t in corners]
    radius = [norm(t - m.unsqueeze(1)).amax(0) for t, m in zip(corners, middle, strict=True)]
    gap = norm(middle[0] - middle[1]) - torch.minimum(*radius)
    away = guarded_divide(gap, torch.maximum(*radius), otherwise=math.inf)
    spread = torch.zeros_like(away)
    for side in (first, second):
        low, high = side.height.clamp(min=0).aminmax(dim=0)
        spread = torch.maximum(spread, guarded_divide(high - low, high + low))
    return lowest_rule(away, spread, rtol)


def _near(pairs: PolygonPairs, rtol: float) -> Float[Tensor, "pair"]:
    """By the contour integral, m2; clipped parts may turn out to be far from each other."""
    value = _attached_zeros(pairs)
    for index in _chosen(~pairs.cut):
        value = value.index_put((index,), _contour(*_sides(pairs, index), rtol))
    for index in _chosen(pairs.cut):
        first, second = (side.clipped() for side in _sides(pairs, index))
        rule = _rule(first, second, rtol)
        for number in rule.unique().tolist():
            (part,) = _chosen(rule == number)
            sides = (first.at(part), second.at(part))
            near, far = number < 0, RULES[max(number, 0)][0]
            found = _contour(*sides, rtol) if near else _fan_product(*sides, far)
            value = value.index_put((index[part],), found)
    return value * pairs.unit.square()


def _far(pairs: PolygonPairs, rule: Int[Tensor, "pair"]) -> Float[Tensor, "pair"]:
    """By the product rules, m2; 0 where none suffices."""
    value = _attached_zeros(pairs)
    for number, (degree, _) in enumerate(RULES):
        chosen = (rule == number) & pairs.facing
        for index in _chosen(chosen & ~pairs.cut):
            value = value.index_put((index,), _product(*_sides(pairs, index), degree))
        for index in _chosen(chosen & pairs.cut):
            first, second = (side.clipped() for side in _sides(pairs, index))
            value = value.index_put((index,), _fan_product(first, second, degree))
    return value * pairs.unit.square()


def _chosen(mask: Tensor) -> tuple[Tensor, ...]:
    """The indices of the true entries in blocks; none if there are none."""
    index = torch.nonzero(mask).squeeze(-1)
    return index.split(PAIRS) if len(index) else ()


def _attached_zeros(pairs: PolygonPairs) -> Float[Tensor, "pair"]:
    """Zeros that hang on the corners: pairs that see nothing have gradients too, of 0."""
    return 0 * (pairs.first.height.sum(0) + pairs.second.height.sum(0))


def _contour(first: Polygon, second: Polygon, rtol: float) -> Float[Tensor, "pair"]:
    """By the contour integral, or what it is no good for by `slender_exchange`."""
    here, there, tolerance = first.corner, second.corner, _tolerance(first, second, rtol)
    found = contour_exchange(here, there, tolerance).clamp(min=0)
    (thin,) = torch.nonzero(cancels(here, there, found, rtol), as_tuple=True)
    if len(thin):
        again = slender_exchange(here[..., thin], there[..., thin], rtol)
        found = found.index_put((thin,), again)
    return found


def _sides(pairs: PolygonPairs, index: Tensor) -> tuple[Polygon, Polygon]:
    return pairs.first.at(index), pairs.second.at(index)


def _fan_product(first: Polygon, second: Polygon, degree: int) -> Float[Tensor, "pair"]:
    """The product rule on all pairs of triangles of two polygons."""
    a, b = first.fan(), second.fan()
    shape = (a.corner.shape[2], b.corner.shape[2], a.corner.shape[3])
    a, b = (
        Polygon(
            side.corner.unsqueeze(axis).expand(3, 3, *shape).flatten(2),
            side.height.unsqueeze(axis - 1).expand(3, *shape).flatten(1),
        )
        for side, axis in ((a, 3), (b, 2))
    )
    return _product(a, b, degree).reshape(shape).sum((0, 1))


def _product(first: Polygon, second: Polygon, degree: int) -> Float[Tensor, "pair"]:
    """The product rule 1/pi sum_kl b_k b_l / r_kl^4, b = weight, area and height."""
    (here, bright), (there, other) = (weighted_points(side, degree) for side in (first, second))
    rows = max(1, PRODUCTS // (len(bright) * len(other)))
    blocks = zip(*(t.split(rows, -1) for t in (here, bright, there, other)), strict=True)
    return torch.cat([product_sum(*block) for block in blocks]) / math.pi


def weighted_points(polygon: Polygon, degree: int) -> tuple[Tensor, Tensor]:
    """Of a product rule: positions `3 point pair`, and weight x local area x height `point pair`.

    The height is linear over the polygon: it is mixed like the corners.
    """
    share, position, measure = surface_points(polygon.corner, degree)
    return position, (share @ polygon.height).clamp(min=0) * measure


def product_sum(here: Tensor, bright: Tensor, there: Tensor, other: Tensor) -> Tensor:
    """sum_kl b_k b_l / r_kl^4 of each pair; arguments as from `weighted_points`."""
    (ax, ay, az), (bx, by, bz) = here.unsqueeze(2).unbind(), there.unsqueeze(1).unbind()
    x, y, z = ax - bx, ay - by, az - bz
    square = torch.addcmul(torch.addcmul(x * x, y, y), z, z)
    return ((other / (square * square)).sum(1) * bright).sum(0)


@torch.no_grad()
def _tolerance(first: Polygon, second: Polygon, rtol: float) -> Float[Tensor, "pair"]:
    """Error of the mean logarithms that keeps `rtol`, from a coarse estimate of K."""
    points = [_drawn_in(side.corner, 1) for side in (first, second)]
    heights = [_drawn_in(side.height, 0).clamp(min=0) for side in (first, second)]
    square = norm(points[0].unsqueeze(2) - points[1].unsqueeze(1)).square()
    kernel = heights[0].unsqueeze(1) * heights[1] / square.square()
    areas = (first.area, second.area)
    estimate = areas[0] * areas[1] * kernel.nan_to_num().mean((0, 1)) / math.pi
    estimate = torch.minimum(estimate, torch.minimum(*areas))
    around = norm(first.edge).sum(0) * norm(second.edge).sum(0)
    share = guarded_divide(2 * math.pi * estimate, around) * (rtol / 8)
    return share.clamp(torch.finfo(share.dtype).eps / 2, 1e-2)


def _drawn_in(values: Tensor, axis: int) -> Tensor:
    """Corner values moved towards their mean: those of points inside."""
    mean = values.mean(axis, keepdim=True)
    return mean + (values - mean) / math.sqrt(3)
