"""How much of each other clusters see, by rays between random points of both.

    V = (segments that are free) / (segments in front of both ends)

Points are spread evenly over the area of a cluster, anew for every pair: errors of different
pairs do not add up. Pairs whose first segments disagree get more of them, and so do pairs that
exchange much light. The standard error
of V is at most sqrt(V (1 - V) / n).

Where few faces can block at all, a pair is looked along only if one of them may lie in between:
if its plane has not both clusters on one side, and its bounding sphere reaches into the capsule
about the two clusters.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import guarded_divide
from torchradiometry.transport.blockers import convex_blockers, possible_blockers
from torchradiometry.transport.cluster_tree import ClusterTree
from torchradiometry.transport.links import Pairs, Refinement
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import sample_patches, sequence

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Sight", "link_visibility", "may_be_blocked", "sight"]

#: faces up to which every pair is asked for each of them
FEW = 64
#: triangles x points up to which it is asked which triangles can block at all
WORTH_ASKING = 2**31


class Sight(NamedTuple):
    """What one needs to look from cluster to cluster.

    Attributes:
        tree: of the patches.
        corners: of the patches in the order of the tree, m.
        normal: unit.
        reached: area of all patches up to each place.
        rays: the blockers.
        blockers: convex quads that can block; None if they are many.
        generator: of the random points.
    """

    tree: ClusterTree
    corners: Float[Tensor, "patch corner 3"]
    normal: Float[Tensor, "patch 3"]
    reached: Float[Tensor, "patch"]
    rays: AbstractRayCaster
    blockers: Float[Tensor, "blocker 4 3"] | None
    generator: torch.Generator


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
    area = tree.area[tree.leaf][tree.order]
    generator = torch.Generator().manual_seed(seed)
    few = convex_blockers(blockers) if len(blockers) <= 2 * FEW else None
    return Sight(tree, corners, normal, area.cumsum(0), rays, few, generator)


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
def link_visibility(
    view: Sight, pairs: Pairs, large: Bool[Tensor, "pair"], limits: Refinement
) -> Float[Tensor, "pair"]:
    """Share of free segments.

    Args:
        view: of the clusters.
        pairs: of clusters.
        large: pairs that get all segments, whether the first ones disagree or not.
        limits: `samples` segments first, `more` in the second round.
    """
    shift = torch.rand(len(pairs.first), 1, 6, generator=view.generator, dtype=torch.float64)
    where = sequence(limits.samples + limits.more, 6, view.corners)
    shift = shift.to(where)
    free, valid = _segments(view, pairs, (shift + where[: limits.samples]).frac())
    again = torch.nonzero(large | ((free > 0) & (free < valid))).squeeze(-1)
    if limits.more:
        second = _segments(view, pairs.at(again), (shift[again] + where[limits.samples :]).frac())
        free, valid = (t.index_add(0, again, u) for t, u in zip((free, valid), second, strict=True))
    return torch.where(valid > 0, guarded_divide(free, valid), 1)


def _segments(
    view: Sight, pairs: Pairs, where: Float[Tensor, "pair sample 6"]
) -> tuple[Float[Tensor, "pair"], Float[Tensor, "pair"]]:
    """How many segments are free, and how many lie in front of both ends."""
    (here, a), (there, b) = (
        _points(view, cluster, numbers)
        for cluster, numbers in zip(pairs, where.split(3, -1), strict=True)
    )
    away = there - here
    valid = ((away * a).sum(-1) > 0) & ((away * b).sum(-1) < 0)
    free = valid.clone()
    origin, target = (view.rays.lift(x[valid], n[valid]) for x, n in ((here, a), (there, b)))
    free[valid] = view.rays.visible(origin, target)
    return free.sum(-1).to(here), valid.sum(-1).to(here)


def _points(
    view: Sight, cluster: Int[Tensor, "pair"], where: Float[Tensor, "pair sample 3"]
) -> tuple[Float[Tensor, "pair sample 3"], Float[Tensor, "pair sample 3"]]:
    """Points on clusters and the normals there."""
    first = view.tree.start[cluster].unsqueeze(-1)
    last = first + view.tree.size[cluster].unsqueeze(-1) - 1
    area = view.tree.area[cluster].unsqueeze(-1)
    begin = torch.where(first > 0, view.reached[(first - 1).clamp(min=0)], 0)
    place = torch.searchsorted(view.reached, (begin + where[..., 0] * area).contiguous())
    place = torch.minimum(torch.maximum(place, first), last)
    return sample_patches(view.corners[place], where[..., 1:]), view.normal[place]
