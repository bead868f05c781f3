"""Exchange areas of pairs that convex blockers hide in part, to eight digits and more.

    K = 1/pi int_first E(x) dA,    E(x): irradiance of the visible part of the second patch

E is exact at every point (`visible_parts`) and analytic in x except where a shadow's corner or
edge begins to touch the emitter's outline. Behind one convex blocker that happens on straight
lines, where the receiver meets the planes through

    a corner of the emitter and an edge of the blocker,
    an edge of the emitter and a corner of the blocker,        the blocker itself.

The receiver is cut along the parts of these lines that really are such places. Over the
convex cells between them Gauss-Legendre rules converge fast. Triangles of cells on which rules
of two degrees differ are cut into four, again and again: near edges where patches and blockers
touch, and along the curves on which edges of two blockers cross on an edge of the emitter,
which are not cut along.

References: R. Durand, G. Drettakis and C. Puech, "The Visibility Skeleton", SIGGRAPH 1997
(visual events); M. Duffy, SIAM J. Numer. Anal. 19 (1982) (rules in collapsed coordinates).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import ShapeError
from torchradiometry.geometry.patches import Patches, check_corners, vector_area
from torchradiometry.numerics import dot, guarded_divide, safe_normalize, wide
from torchradiometry.transport.blockers import possible_blockers
from torchradiometry.transport.convex_pieces import joined, split
from torchradiometry.transport.rules import patch_points
from torchradiometry.transport.visible_parts import visible_irradiance

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["OccludedExchange", "occluded_exchange"]

#: relative difference of the two rules that is aimed at (7e-9); the value is better than that
RTOL = 2.0**-27
#: degrees of the two rules: 16 and 36 points on a triangle
LOW, HIGH = 7, 11
#: a triangle may add this share of the tolerance
SHARE = 1 / 32
#: triangles are cut into four at most this often
ROUNDS = 24
#: triangles for each pair, and for all together, beyond which none is cut any more
MOST = 2**10
#: thinnest cell, in roundings of the largest coordinate
ROUNDINGS = 2**8
#: triangles that are integrated at a time
BLOCK = 2**11


class OccludedExchange(NamedTuple):
    """Exchange areas and what they may be off by.

    Attributes:
        exchange: K = A F, m2.
        error: sum of the differences between two rules over the cells, m2. Smooth cells are
            better than that by orders of magnitude.
    """

    exchange: Float[Tensor, "pair"]
    error: Float[Tensor, "pair"]


class _Pairs(NamedTuple):
    """Receivers in front of their emitters, and emitters above their receivers."""

    receiver: Float[Tensor, "pair corner 3"]
    normal: Float[Tensor, "pair 3"]
    emitter: Float[Tensor, "pair corner 3"]


def occluded_exchange(
    first: Float[Tensor, "pair corner 3"],
    second: Float[Tensor, "pair side 3"],
    blockers: Float[Tensor, "blocker edge 3"],
    rtol: float = RTOL,
) -> OccludedExchange:
    """A F of pairs of one-sided patches behind convex planar blockers, m2.

    Args:
        first: planar, convex, m, counter-clockwise seen from the front. E is integrated over it:
            the smaller one of the pair is the cheaper one.
        second: likewise.
        blockers: planar, convex, m; convex solids are their faces. The patches themselves may be
            among them.
        rtol: aimed at; see `error` for what was reached.

    Returns:
        K and its error, float64. Time and memory are bounded: a pair takes about a thousand
        triangles at most, where a hundred or two are common; `error` tells where they are too few.

    Raises:
        ShapeError: not polygons, or not as many first as second.
        InvalidValueError: NaN or infinite corners.
        OutOfRangeError: lengths as of `form_factors`.

    Differentiable in: all three.
    Export: no, the number of cells depends on the data.
    References: Durand, Drettakis and Puech (1997).

    >>> floor = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    >>> ceiling = floor.flip(1) + torch.tensor([0.0, 0, 1])
    >>> wall = torch.tensor([[[0.5, -9, 0], [0.5, 9, 0], [0.5, 9, 1], [0.5, -9, 1]]])
    >>> round(float(occluded_exchange(floor, ceiling, wall).exchange), 6)  # two halves apart
    0.116654
    """
    for name, corners in (("first", first), ("second", second), ("blockers", blockers)):
        check_corners(name, corners)
    if len(first) != len(second):
        got = f"{len(first)} and {len(second)} polygons"
        raise ShapeError("first, second", got, "pass one of each for every pair")
    first, second, blockers = wide(first, second, blockers)
    middle = torch.cat((first, second), 1).detach().reshape(-1, 3).mean(0)
    middle = middle if len(first) else torch.zeros_like(middle)
    first, second, screens = first - middle, second - middle, blockers - middle
    around = torch.cat((first, second), 1).detach().reshape(-1, 3)
    size = float(around.abs().max()) if len(around) else 0.0
    margin = ROUNDINGS * torch.finfo(around.dtype).eps * size
    screens = screens[possible_blockers(screens, around, margin)]
    pairs, index = _facing(first, second, margin)
    cells, owner = _cells(pairs, screens, margin)
    value, error = _integrated(pairs, screens, cells, owner, rtol)
    nothing = torch.zeros_like(first[:, 0, 0])
    return OccludedExchange(
        nothing.index_add(0, index, value / math.pi),
        nothing.detach().index_add(0, index, error / math.pi),
    )


def _above(polygon: Tensor, plane: Tensor, margin: float) -> tuple[Tensor, Tensor]:
    """The parts of polygons in front of the planes of others, and whose they are."""
    normal = safe_normalize(vector_area(plane)).unsqueeze(1)
    height = dot(polygon - plane[:, :1], normal).mT
    _, _, part, index = split(polygon.permute(2, 1, 0), height, margin)
    some = height.detach().amax(0)[index] > margin
    order = torch.nonzero(some).squeeze(-1)
    order = order[index[order].argsort()]
    return part[..., order].permute(2, 1, 0), index[order]


def _facing(first: Tensor, second: Tensor, margin: float) -> tuple[_Pairs, Int[Tensor, "pair"]]:
    emitter, index = _above(second, first, margin)
    receiver, kept = _above(first[index], second[index], margin)
    index = index[kept]
    normal = safe_normalize(vector_area(first[index]))
    return _Pairs(receiver, normal, emitter[kept]), index


def _cells(
    pairs: _Pairs, blockers: Tensor, margin: float
) -> tuple[Float[Tensor, "3 corner cell"], Int[Tensor, "cell"]]:
    """Receivers cut where E may have a kink, and whose part each cell is."""
    cells = pairs.receiver.permute(2, 1, 0)
    owner = torch.arange(cells.shape[2], device=cells.device)
    for blocker in blockers:
        every = blocker.expand(len(pairs.receiver), -1, -1)
        part, lower = _above(every, pairs.receiver, margin)
        part, upper = _above(part, pairs.emitter[lower], margin)
        index = lower[upper]
        if len(index) == 0:
            continue
        place = torch.full_like(pairs.normal[:, 0], -1, dtype=torch.int64)
        place[index] = torch.arange(len(index), device=index.device)
        lines = _events(_Pairs(*(t[index] for t in pairs)), part, blocker)
        for line in zip(*lines, strict=True):
            cells, owner = _cut(cells, owner, place, line, margin)
    return cells, owner


class _Events(NamedTuple):
    """Planes that cut receivers between two points of the receiver's plane."""

    normal: Float[Tensor, "plane pair 3"]
    start: Float[Tensor, "plane pair 3"]
    end: Float[Tensor, "plane pair 3"]
    bounded: Bool[Tensor, "plane pair"]


def _events(pairs: _Pairs, screen: Float[Tensor, "pair edge 3"], blocker: Tensor) -> _Events:
    """The planes through corners and edges of emitter and blocker, and the blocker's own."""
    lamp = pairs.emitter.transpose(0, 1).unsqueeze(1)
    edge = screen.transpose(0, 1).unsqueeze(0)
    normal = pairs.normal
    origin = pairs.receiver[:, 0]

    def projected(corner: Tensor, point: Tensor) -> tuple[Tensor, Tensor]:
        high, low = dot(corner - origin, normal), dot(point - origin, normal)
        share = guarded_divide(high.expand_as(high - low), high - low)
        return corner + share.unsqueeze(-1) * (point - corner), (low < high).expand_as(share)

    near, far = edge, edge.roll(-1, 1)
    here, there = lamp, lamp.roll(-1, 0)
    cut = torch.linalg.cross(near - lamp, far - lamp), torch.linalg.cross(here - edge, there - edge)
    ends = (projected(lamp, near), projected(lamp, far), projected(here, edge))
    last = projected(there, edge)
    own = safe_normalize(vector_area(blocker)).expand_as(normal).unsqueeze(0)
    base = blocker[0].expand_as(normal).unsqueeze(0)
    planes = torch.cat([*(safe_normalize(c).flatten(0, 1) for c in cut), own])
    start, end = (
        torch.cat([a[0].flatten(0, 1), b[0].flatten(0, 1), base])
        for a, b in ((ends[0], ends[2]), (ends[1], last))
    )
    bounded = [(a[1] & b[1]).flatten(0, 1) for a, b in ((ends[0], ends[1]), (ends[2], last))]
    return _Events(planes, start, end, torch.cat([*bounded, torch.zeros_like(bounded[0][:1])]))


def _cut(
    cells: Tensor, owner: Tensor, place: Tensor, line: tuple[Tensor, ...], margin: float
) -> tuple[Tensor, Tensor]:
    """Both parts of the cells that the bounded line crosses."""
    index = place[owner]
    concerned = index >= 0
    normal, start, end, bounded = (t[index.clamp(min=0)] for t in line)
    from_start = cells - start.mT.unsqueeze(1)
    height = (normal.mT.unsqueeze(1) * from_start).sum(0)
    along = (end - start).detach()
    share = torch.einsum("px,xcp->cp", along, from_start.detach())
    length = (along * along).sum(-1)
    missed = bounded & ((share.amax(0) <= 0) | (share.amin(0) >= length))
    height = torch.where(concerned & ~missed, height, 0)
    below, under, above, over = split(cells, height, margin)
    return joined([below, above]), owner[torch.cat((under, over))]


def _integrated(
    pairs: _Pairs, blockers: Tensor, cells: Tensor, owner: Tensor, rtol: float
) -> tuple[Float[Tensor, "pair"], Float[Tensor, "pair"]]:
    """int E dA over the cells of each pair, and the differences of the two rules."""
    part, owner = _fan(cells, owner)
    total = torch.zeros_like(pairs.normal[:, 0])
    error = torch.zeros_like(total).detach()
    learns = torch.is_grad_enabled() and any(t.requires_grad for t in (*pairs, blockers))
    left = MOST * (len(total) + 1)
    for number in range(ROUNDS + 1):
        with torch.no_grad():
            low, high = _by_rules(pairs, blockers, part, owner, (LOW, HIGH))
        difference = (high - low).abs()
        now = total.detach().index_add(0, owner, high)
        good = difference <= SHARE * rtol * now[owner]
        left -= len(part)
        good = good | (number == ROUNDS) | (4 * int((~good).sum()) > left)
        kept = high[good]
        if learns:  # only what counts holds a graph
            (kept,) = _by_rules(pairs, blockers, part[good], owner[good], (HIGH,))
        total = total.index_add(0, owner[good], kept)
        error = error.index_add(0, owner[good], difference[good])
        if bool(good.all()):
            break
        part, owner = _quartered(part[~good]), owner[~good].repeat_interleave(4)
    return total, error


def _fan(cells: Tensor, owner: Tensor) -> tuple[Float[Tensor, "part 3 3"], Int[Tensor, "part"]]:
    """Triangles of the cells."""
    corners = cells.permute(2, 1, 0)
    first = corners[:, :1].expand(-1, corners.shape[1] - 2, -1)
    parts = torch.stack((first, corners[:, 1:-1], corners[:, 2:]), 2).flatten(0, 1)
    owner = owner.repeat_interleave(corners.shape[1] - 2)
    solid = Patches(parts.detach()).area > 0
    return parts[solid], owner[solid]


def _quartered(part: Float[Tensor, "part 3 3"]) -> Float[Tensor, "four_parts 3 3"]:
    a, b, c = part.unbind(1)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab)]
    return torch.stack([torch.stack(t, 1) for t in four], 1).flatten(0, 1)


def _by_rules(
    pairs: _Pairs, blockers: Tensor, part: Tensor, owner: Tensor, degrees: tuple[int, ...]
) -> tuple[Float[Tensor, "part"], ...]:
    """int E dA over triangles by the rule of each degree."""
    values = [torch.zeros_like(part[:0, 0, 0]).expand(len(degrees), 0)]
    for triangles, own in zip(part.split(BLOCK), owner.split(BLOCK), strict=True):
        rules = [patch_points(triangles, degree) for degree in degrees]
        position = torch.cat([rule.position for rule in rules], 1)
        count = position.shape[1]
        seen = visible_irradiance(
            position.flatten(0, 1),
            pairs.normal[own].repeat_interleave(count, 0),
            pairs.emitter[own].repeat_interleave(count, 0),
            blockers,
        ).reshape(len(own), count)
        area, sizes = Patches(triangles).area, [rule.weight.shape[1] for rule in rules]
        means = zip(seen.split(sizes, 1), rules, strict=True)
        values.append(torch.stack([area * (e * rule.weight).sum(-1) for e, rule in means]))
    return torch.cat(values, 1).unbind()
