"""Exchange areas of far patches that see each other wholly, as products of matrices.

    K_ij = 1/pi sum_kl  m_k h_j(x_k)  m_l h_i(y_l) / r_kl^4            (x_k on i, y_l on j)

m = weight times local area, h_i(y) = n_i . y - o_i the height above the plane of patch i. With
x' = (x, |x|^2, 1) and y' = (-2 y, 1, |y|^2) the squares r_kl^2 = x'_k . y'_l of a block of
patches against all others are one product of matrices, and so are the heights. Nothing is
prepared pair by pair. That saves time for the lowest degrees (`DENSE`), and where enough pairs of
a block ask for one (`PREPARED`); the rest is left to `exchange`.

All patches share one frame, about their middle, in units of their extent S. So r^2 is exact to
some eps S^2 and h to some eps S: pairs whose r^2 or h is not known to a small part of `rtol` are
left over as well. Heights below 64 roundings of S count as 0, as corners are not known better.

The lowest degree d with  C_d a^-d (s + 1/a) <= rtol  is taken, see `exchange`.

References: P. J. Davis and P. Rabinowitz, *Methods of Numerical Integration* (1984), 5.6.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import guarded_divide
from torchradiometry.transport.polygon_pairs import ROUNDINGS, norm
from torchradiometry.transport.rules import corner_shares

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["RULES", "dense_exchange", "lowest_rule", "surface_points"]

#: degree d and C_d of the product rules
RULES = ((2, 0.1), (5, 0.4), (7, 0.2), (9, 0.06), (11, 0.02), (13, 0.004))
#: nearer than this, in sizes, is near whatever `rtol`
NEAREST = 1.5
#: roundings of the frame, over `rtol`, that squares and heights must exceed
ROUNDINGS_KEPT = 2**10
#: how many of them are done in blocks: with more points the products cost more than preparation
DENSE = 2
#: pairs that are compared at a time, and products of points that are held at a time
PAIRS, PRODUCTS = 2**15, 2**17
#: columns of a block of products, at least; fewer rows are taken instead
COLUMNS = 64
#: preparing a pair alone costs as much as this many products
PREPARED = 700


class _Frame(NamedTuple):
    """Patches about their middle, in units of their extent."""

    corner: Float[Tensor, "3 corner patch"]
    plane: Float[Tensor, "5 patch"]  #: (n, 0, -o), to be multiplied with (x, |x|^2, 1)


class _Points(NamedTuple):
    """The points of one product rule on all patches."""

    place: Float[Tensor, "5 point patch"]  #: (x, |x|^2, 1)
    measure: Float[Tensor, "point patch"]  #: weight times local area


def dense_exchange(
    corners: Float[Tensor, "patch corner 3"], rtol: float
) -> tuple[Float[Tensor, "patch patch"], Int[Tensor, "left"], Int[Tensor, "left"]]:
    """A_i F_ij of the pairs i < j that are easy, and the pairs that are left to do.

    Args:
        corners: of triangles or planar convex quads, m, float64.
        rtol: relative error of every pair.

    Returns:
        m2, 0 where i >= j and where nothing was found, and the indices i < j of the pairs
        that see each other but are near, cut by a plane, or too few of a kind.

    Differentiable in: corners (the choice of rules is constant).
    Export: no, the choice of rules depends on the data.
    """
    count = len(corners)
    if count == 0:
        none = torch.zeros(0, dtype=torch.int64, device=corners.device)
        return corners.new_zeros(0, 0), none, none
    frame, unit = _frame(corners)
    points: dict[int, _Points] = {}
    blocks, left = [], []
    size = max(1, PAIRS // count)
    for start in range(0, count, size):
        rows = torch.arange(start, min(start + size, count), device=corners.device)
        facing, rule = _relations(frame, rows, rtol)
        value = corners.new_zeros(len(rows), count - start)
        for number, (degree, _) in enumerate(RULES[:DENSE]):
            wanted = rule == number
            if not bool(wanted.any()):
                continue
            if degree not in points:
                points[degree] = _points(frame, degree)
            found, done = _rows(frame, points[degree], rows, wanted)
            value, facing = value + found, facing & ~done
        blocks.append(torch.nn.functional.pad(value, (start, 0)))
        left.append(torch.nonzero(facing) + start)
    i, j = torch.cat(left).unbind(1)
    return torch.cat(blocks) * unit.square(), i, j


def lowest_rule(
    away: Float[Tensor, "*pair"], spread: Float[Tensor, "*pair"], rtol: float
) -> Int[Tensor, "*pair"]:
    """The first of `RULES` that keeps `rtol` at a distance of `away` sizes; -1: none."""
    rule = torch.full_like(away, -1, dtype=torch.int64)
    inverse = 1 / away.clamp(min=1)
    steps, scale = inverse.log(), (spread + inverse).log()
    for number, (degree, factor) in reversed(list(enumerate(RULES))):
        enough = (degree * steps + scale <= math.log(rtol / factor)) & (away > NEAREST)
        rule = torch.where(enough, number, rule)
    return rule


def surface_points(
    corner: Float[Tensor, "3 corner patch"], degree: int
) -> tuple[
    Float[Tensor, "point corner"], Float[Tensor, "3 point patch"], Float[Tensor, "point patch"]
]:
    """Of a product rule: how points mix the corners, their positions, weight times local area.

    The Jacobian is linear over the polygon: it is mixed like the corners.
    """
    share, weight = corner_shares(corner.shape[1], degree, corner)
    edge = corner.roll(-1, 1) - corner
    if corner.shape[1] == 3:
        local = norm(torch.linalg.cross(edge[:, 0], edge[:, 1], dim=0)) / 2
    else:
        local = share @ norm(torch.linalg.cross(edge.roll(1, 1), edge, dim=0))
    return share, share @ corner, local * weight.unsqueeze(-1)


def _frame(corners: Tensor) -> tuple[_Frame, Float[Tensor, ""]]:
    """The frame, and its unit in m."""
    fixed = corners.detach()
    middle = fixed.reshape(-1, 3).mean(0)
    extent = (fixed - middle).abs().amax()
    unit = torch.where(extent > 0, extent, 1)
    patches = Patches((corners - middle) / unit)
    offset = (patches.normal * patches.corners.mean(1)).sum(-1)
    plane = torch.stack((*patches.normal.unbind(1), 0 * offset, -offset))
    return _Frame(patches.corners.permute(2, 1, 0).contiguous(), plane), unit


def _lifted(position: Float[Tensor, "3 point patch"]) -> Float[Tensor, "5 point patch"]:
    square = position.square().sum(0, keepdim=True)
    return torch.cat((position, square, torch.ones_like(square)))


def _points(frame: _Frame, degree: int) -> _Points:
    _, position, measure = surface_points(frame.corner, degree)
    return _Points(_lifted(position), measure)


@torch.no_grad()
def _relations(
    frame: _Frame, rows: Int[Tensor, "row"], rtol: float
) -> tuple[Bool[Tensor, "row column"], Int[Tensor, "row column"]]:
    """Of `rows` with all patches from their first: which pairs face, and the rules of easy ones."""
    corner, plane, start = _lifted(frame.corner), frame.plane, int(rows[0])
    eps = torch.finfo(plane.dtype).eps
    above = _heights(plane[:, rows], corner[:, :, start:]).aminmax(dim=1)
    below = _heights_below(corner[:, :, rows], plane[:, start:]).aminmax(dim=1)
    lowest, highest = torch.minimum(above[0], below[0]), torch.minimum(above[1], below[1])
    spread = torch.maximum(_spread(*above), _spread(*below))
    centroid = frame.corner.mean(1)
    radius = norm(frame.corner - centroid.unsqueeze(1)).amax(0)
    centroid = centroid.mT.contiguous()
    distance = torch.cdist(centroid[rows], centroid[start:])
    sizes = (radius[rows].unsqueeze(1), radius[start:])
    away = guarded_divide(distance - torch.minimum(*sizes), torch.maximum(*sizes))
    known = eps * ROUNDINGS_KEPT / rtol
    easy = (lowest >= -eps * ROUNDINGS) & (highest > known) & (distance.square() > known)
    facing = (highest > eps * ROUNDINGS).triu(1)
    return facing, torch.where(facing & easy, lowest_rule(away, spread, rtol), -1)


def _spread(low: Tensor, high: Tensor) -> Float[Tensor, "row column"]:
    low = low.clamp(min=0)
    return guarded_divide(high - low, high + low)


def _heights(plane: Tensor, place: Tensor) -> Float[Tensor, "row point column"]:
    """Of the points of the columns above the planes of the rows."""
    return (plane.mT @ place.flatten(1)).unflatten(1, place.shape[1:])


def _heights_below(place: Tensor, plane: Tensor) -> Float[Tensor, "row point column"]:
    """Of the points of the rows above the planes of the columns."""
    return (place.permute(2, 1, 0).flatten(0, 1) @ plane).unflatten(0, (-1, place.shape[1]))


def _rows(
    frame: _Frame, points: _Points, rows: Int[Tensor, "row"], wanted: Bool[Tensor, "row column"]
) -> tuple[Float[Tensor, "row column"], Bool[Tensor, "row column"]]:
    """One rule on the pairs that are wanted, and for which of them it was worth the while."""
    products = len(points.measure) ** 2
    size = max(1, PRODUCTS // (products * COLUMNS))
    blocks, done = [], []
    for some, mask in zip(rows.split(size), wanted.split(size), strict=True):
        columns = torch.nonzero(mask.any(0)).squeeze(-1)
        dense = len(some) * len(columns) * products
        worth = dense <= int(mask.sum()) * (products + PREPARED)
        done.append(mask & worth)
        value = points.measure.new_zeros(mask.shape)
        step = max(1, PRODUCTS // (products * len(some)))
        for column in columns.split(step) if worth and len(columns) else ():
            found = _products(frame, points, some, column + int(rows[0]), mask[:, column])
            value = value.index_add(1, column, found)
        blocks.append(value)
    return torch.cat(blocks), torch.cat(done)


def _products(
    frame: _Frame,
    points: _Points,
    rows: Int[Tensor, "row"],
    columns: Int[Tensor, "column"],
    wanted: Bool[Tensor, "row column"],
) -> Float[Tensor, "row column"]:
    """1/pi sum_kl m_k h_k m_l h_l / r_kl^4 of a block, 0 where it is not wanted."""
    here, there = points.place[:, :, rows], points.place[:, :, columns]
    turned = torch.cat((-2 * there[:3], there[4:], there[3:4]))
    # wanted pairs have larger squares: their points are at least a fifth of the distance apart
    square = _heights_below(here, turned.flatten(1)).clamp(min=torch.finfo(here.dtype).eps)
    square = square.unflatten(2, there.shape[1:])
    leaving = _heights(frame.plane[:, rows], there).clamp(min=0) * points.measure[:, columns]
    leaving = torch.where(wanted.unsqueeze(1), leaving, 0)
    arriving = _heights_below(here, frame.plane[:, columns]).clamp(min=0)
    arriving = arriving * points.measure[:, rows].mT.unsqueeze(-1)
    kernel = (leaving.unsqueeze(1) / square.square()).sum(2)
    return (kernel * arriving).sum(1) / math.pi
