"""How much of each other clusters see, by rays between random points of both.

    V = (segments that are free) / (segments in front of both ends)

Every cluster has `POINTS` points, spread evenly over its area. A pair looks along few segments
first; then further ones are dealt out, in rounds, to where they help most: to the pairs with the
largest w s / n. With n segments the error of a link's light is w s / sqrt(n),

    w = K sqrt(A_I A_J (A_I + A_J)),      s = sqrt(m (1 - m)),      m = (free + p) / (valid + 1);

w^2 s^2 is what the link adds to sum_i A_i (error of F_i)^2 over the members i of both clusters.
p, the share that is expected before one looks, is that of all pairs with the same grandparents:
where all neighbours see each other, four free segments tell more than at the edge of a shadow.

Where few faces can block at all, a pair is looked along only if one of them may lie in between:
if its plane has not both clusters on one side, and its bounding sphere reaches into the capsule
about the two clusters.

References: J. Neyman, "On the two different aspects of the representative method", J. R. Stat.
Soc. 97 (1934).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import guarded_divide
from torchradiometry.transport.blockers import convex_blockers, possible_blockers
from torchradiometry.transport.cluster_tree import ClusterTree
from torchradiometry.transport.links import Pairs
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import sample_patches, sequence

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Seen", "Sight", "first_look", "looked_again", "may_be_blocked", "sight"]

#: points of a cluster, and the step that pairs those of two clusters
POINTS, STEP = 32, 13
#: most segments of a pair, and rounds in which they are dealt out
MOST, ROUNDS = 64, 4
#: segments that are drawn at a time
BLOCK = 2**19
#: faces up to which every pair is asked for each of them
FEW = 64
#: triangles x points up to which it is asked which triangles can block at all
WORTH_ASKING = 2**31


class Sight(NamedTuple):
    """What one needs to look from cluster to cluster.

    Attributes:
        tree: of the patches.
        position: `POINTS` points of every patch, in the order of the tree, lifted off it, m.
        normal: of the patches, unit.
        point: which of them are the points of each cluster.
        rays: the blockers.
        blockers: convex quads that can block; None if they are many.
        generator: of the random points.
    """

    tree: ClusterTree
    position: Float[Tensor, "point 3"]
    normal: Float[Tensor, "patch 3"]
    point: Int[Tensor, "cluster sample"]
    rays: AbstractRayCaster
    blockers: Float[Tensor, "blocker 4 3"] | None
    generator: torch.Generator


class Seen(NamedTuple):
    """What pairs saw.

    Attributes:
        free: segments that nothing blocks.
        valid: segments in front of both ends.
        drawn: segments; 0 of pairs that were not looked along: nothing lies between them.
        start: at which points of both the first one began.
    """

    free: Int[Tensor, "pair"]
    valid: Int[Tensor, "pair"]
    drawn: Int[Tensor, "pair"]
    start: Int[Tensor, "pair 2"]

    @property
    def visibility(self) -> Float[Tensor, "pair"]:
        """Share of free segments; 1 where none is valid."""
        free, valid = self.free.to(torch.float64), self.valid.to(torch.float64)
        return torch.where(valid > 0, guarded_divide(free, valid), 1)

    def at(self, which: Tensor) -> Seen:
        """Some of the pairs."""
        return Seen(*(t[which] for t in self))

    def joined(self, *others: Seen) -> Seen:
        """One list of all."""
        return Seen(*(torch.cat(t) for t in zip(self, *others, strict=True)))


def sight(tree: ClusterTree, patches: Patches, rays: AbstractRayCaster, seed: int) -> Sight | None:
    """Ready to look between the clusters of `patches` (m); None if nothing can block.

    Args:
        tree: of the patches, in m.
        patches: float64.
        rays: the blockers.
        seed: of the random points.
    """
    blockers, points = rays.corners.to(patches.corners.device), patches.corners.reshape(-1, 3)
    if len(blockers) * len(points) <= WORTH_ASKING:
        blockers = blockers[possible_blockers(blockers, points, rays.tolerance)]
        if len(blockers) == 0:
            return None
    corners, normal = (t[tree.order] for t in (patches.corners, patches.normal))
    generator = torch.Generator().manual_seed(seed)
    shift = torch.rand(len(corners), 1, 2, generator=generator, dtype=torch.float64)
    where = (sequence(POINTS, 2, corners) + shift.to(corners)).frac()
    position = rays.lift(sample_patches(corners.unsqueeze(1), where), normal.unsqueeze(1))
    few = convex_blockers(blockers) if len(blockers) <= 2 * FEW else None
    point = _points(tree, generator)
    return Sight(tree, position.flatten(0, 1), normal, point, rays, few, generator)


def _points(tree: ClusterTree, generator: torch.Generator) -> Int[Tensor, "cluster sample"]:
    """Points spread evenly over the area of each cluster, each on another place of its patch."""
    area = tree.area[tree.leaf][tree.order]
    reached = area.cumsum(0)
    first = tree.start.unsqueeze(-1)
    last = first + tree.size.unsqueeze(-1) - 1
    shift = torch.rand(len(tree.start), 1, generator=generator, dtype=torch.float64).to(area)
    share = (shift + sequence(POINTS, 1, area).squeeze(-1)).frac()
    begin = torch.where(first > 0, reached[(first - 1).clamp(min=0)], 0)
    place = torch.searchsorted(reached, begin + share * tree.area.unsqueeze(-1))
    place = torch.minimum(torch.maximum(place, first), last)
    return place * POINTS + torch.arange(POINTS, device=place.device)


@torch.no_grad()
def may_be_blocked(view: Sight | None, pairs: Pairs) -> Bool[Tensor, "pair"]:
    """False where certainly nothing lies between two clusters."""
    blocked = torch.zeros_like(pairs.first, dtype=torch.bool)
    if view is None:
        return blocked
    if view.blockers is None:
        return ~blocked
    tree = view.tree
    start, end = (tree.centre[k] for k in pairs)
    first, second = (tree.radius[k] for k in pairs)
    thick, along = torch.maximum(first, second), end - start
    square = along.square().sum(-1)
    for corners, normal in zip(view.blockers, Patches(view.blockers).normal, strict=True):
        here, there = ((c - corners[0]) @ normal for c in (start, end))
        above = torch.minimum(here - first, there - second) > 0
        below = torch.maximum(here + first, there + second) < 0
        middle = (corners.amin(0) + corners.amax(0)) / 2
        reach = (corners - middle).norm(dim=-1).amax()
        share = guarded_divide(((middle - start) * along).sum(-1), square).clamp(0, 1)
        gap = (start + share.unsqueeze(-1) * along - middle).norm(dim=-1)
        blocked = blocked | ~(above | below | (gap > reach + thick))
    return blocked


@torch.no_grad()
def first_look(view: Sight | None, pairs: Pairs, number: Int[Tensor, "pair"]) -> Seen:
    """What pairs see along `number` segments each; 0 of them: not looked."""
    none = torch.zeros_like(pairs.first, dtype=torch.int32)
    start = none.new_zeros(len(none), 2)
    if view is not None:
        start = torch.randint(POINTS, start.shape, generator=view.generator, dtype=torch.int32)
    return _more(view, pairs, Seen(none, none, none, start.to(none.device)), number)


@torch.no_grad()
def looked_again(
    view: Sight, pairs: Pairs, seen: Seen, kernel: Float[Tensor, "pair"], total: int
) -> Seen:
    """What pairs see when `total` further segments are dealt out to those that were looked along.

    Args:
        view: of the clusters.
        pairs: of clusters.
        seen: what they saw so far.
        kernel: their light, 1/m2.
        total: of further segments.
    """
    looked = torch.nonzero(seen.drawn).squeeze(-1)
    if len(looked) == 0:
        return seen
    part, near = pairs.at(looked), seen.at(looked)
    family = _families(view.tree, part)
    area, other = (view.tree.area[k] for k in part)
    weight = kernel[looked] * (area * other * (area + other)).sqrt()
    for _ in range(ROUNDS):
        near = _more(view, part, near, _dealt(near, weight * _doubt(near, family), total // ROUNDS))
    return Seen(*(t.index_copy(0, looked, u) for t, u in zip(seen, near, strict=True)))


def _families(tree: ClusterTree, pairs: Pairs) -> Int[Tensor, "pair"]:
    """The same number for pairs with the same grandparents."""
    above = tree.parent.clamp(min=0)
    first, second = (above[above[k]] for k in pairs)
    return torch.unique(first * len(above) + second, return_inverse=True)[1]


def _doubt(seen: Seen, family: Int[Tensor, "pair"]) -> Float[Tensor, "pair"]:
    """Standard deviation of a segment's answer."""
    free, valid = seen.free.to(torch.float64), seen.valid.to(torch.float64)
    all_free, all_valid = (
        t.new_zeros(len(t)).index_add(0, family, t)[family] for t in (free, valid)
    )
    expected = (all_free + 0.5) / (all_valid + 1)
    mean = (free + expected) / (valid + 1)
    return torch.where(valid > 0, mean * (1 - mean), 0).sqrt()


def _dealt(seen: Seen, error: Float[Tensor, "pair"], total: int) -> Int[Tensor, "pair"]:
    """As many segments as before to the pairs that gain most, 0 to the others."""
    gain = torch.where(seen.drawn < MOST, error / seen.drawn, 0)
    order = gain.argsort(descending=True)
    cost = seen.drawn[order]
    given = (cost.cumsum(0) <= total) & (gain[order] > 0)
    return torch.zeros_like(cost).index_copy(0, order, torch.where(given, cost, 0))


def _more(view: Sight | None, pairs: Pairs, seen: Seen, number: Int[Tensor, "pair"]) -> Seen:
    """What pairs have seen after `number` further segments each."""
    free, valid = seen.free.clone(), seen.valid.clone()
    for count in number.unique().tolist():
        if view is None or count == 0:
            continue
        every = torch.nonzero(number == count).squeeze(-1)
        for which in every.split(max(1, BLOCK // count)):
            clear, front = _segments(view, pairs.at(which), seen.at(which), count)
            free[which] += clear
            valid[which] += front
    return Seen(free, valid, seen.drawn + number, seen.start)


def _segments(
    view: Sight, pairs: Pairs, seen: Seen, count: int
) -> tuple[Int[Tensor, "pair"], Int[Tensor, "pair"]]:
    """How many of `count` segments are free, and how many lie in front of both ends.

    The k-th one joins the k-th point of one cluster, counted from the start, to a point of the
    other `STEP` further than the one before; after a whole turn the partners are shifted by one.
    """
    k = seen.drawn.unsqueeze(-1) + torch.arange(count, device=seen.drawn.device)
    steps = (k, STEP * k + k // POINTS)
    (here, a), (there, b) = (
        _chosen(view, cluster, (start.unsqueeze(-1) + step) % POINTS)
        for cluster, start, step in zip(pairs, seen.start.unbind(-1), steps, strict=True)
    )
    away = there - here
    valid = ((away * a).sum(-1) > 0) & ((away * b).sum(-1) < 0)
    free = torch.zeros_like(valid)
    free[valid] = view.rays.visible(here[valid], there[valid])
    return free.sum(-1, dtype=torch.int32), valid.sum(-1, dtype=torch.int32)


def _chosen(
    view: Sight, cluster: Int[Tensor, "pair"], number: Int[Tensor, "pair sample"]
) -> tuple[Float[Tensor, "pair sample 3"], Float[Tensor, "pair sample 3"]]:
    """Points of clusters and the normals there."""
    point = view.point.flatten()[cluster.unsqueeze(-1) * POINTS + number]
    return view.position[point], view.normal[point // POINTS]
