"""The exchange areas of a large scene as links between clusters, and exact near pairs.

    H = L + L^T + N + N^T,      L = sum over links of U_I K_IJ U_J^T

U_I are the shares of a cluster's members in its nodes times their areas (never formed: they
follow from the transfers from parent to child), K a 3 x 3 matrix per link, N the entries of
pairs of patches that lie too near each other. H is symmetric and has no negative entry.

The pairs of clusters are visited from the root down, a generation at a time, block by block
(`links` says what becomes of each). The numbers of links and near pairs follow from the
tolerance and the shape of the scene; with finer and finer patches only those along contacts
and shadow edges grow.

References: P. Hanrahan, D. Salzman and L. Aupperle, "A Rapid Hierarchical Radiosity
Algorithm", SIGGRAPH 1991.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import (
    OutOfRangeError,
    ResourceLimitError,
    require_kind,
    require_whole,
)
from torchradiometry.geometry.patches import Patches, check_patches
from torchradiometry.numerics import guarded_divide, wide
from torchradiometry.transport.cluster_nodes import ClusterNodes, cluster_nodes
from torchradiometry.transport.cluster_tree import ClusterTree, cluster_tree
from torchradiometry.transport.exchange import polygon_exchange
from torchradiometry.transport.link_visibility import (
    Seen,
    Sight,
    first_look,
    looked_again,
    may_be_blocked,
    sight,
)
from torchradiometry.transport.links import (
    Pairs,
    Refinement,
    children,
    damped,
    kernels,
    segments,
    single,
    sorted_out,
)
from torchradiometry.transport.rays import AbstractRayCaster

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["ExchangeLinks", "exchange_links"]

#: limits that were measured to keep the radiosity of rooms with blockers to half a percent (L1)
DEFAULT = Refinement()
#: pairs that are looked at at a time
BLOCK = 2**17
#: bytes of a patch (tree, nodes, transfers and what making them takes), a link, a near pair
PATCH_BYTES, LINK_BYTES, NEAR_BYTES = 2**12, 2 * 112, 3 * 48


class ExchangeLinks(NamedTuple):
    """H in few numbers.

    Attributes:
        area: of the patches, m2.
        leaf: cluster of each patch.
        parent: of each cluster, -1 of the root.
        levels: first cluster of each level, and the number of clusters at the end.
        transfer: share of the parent's nodes (last) at the nodes of each cluster.
        first, second, kernel: of links, cos cos / (pi r^2) between nodes, 1/m2.
        near_first, near_second, near_exchange: pairs of patches and their H, m2.
    """

    area: Float[Tensor, "patch"]
    leaf: Int[Tensor, "patch"]
    parent: Int[Tensor, "cluster"]
    levels: tuple[int, ...]
    transfer: Float[Tensor, "cluster 3 3"]
    first: Int[Tensor, "link"]
    second: Int[Tensor, "link"]
    kernel: Float[Tensor, "link 3 3"]
    near_first: Int[Tensor, "near"]
    near_second: Int[Tensor, "near"]
    near_exchange: Float[Tensor, "near"]


class _Found(NamedTuple):
    """Links with their kernels, pairs of leaves, and what both saw."""

    links: Pairs
    kernel: Float[Tensor, "link 3 3"]
    seen: Seen
    near: Pairs
    near_seen: Seen


class _World(NamedTuple):
    """What the visit of pairs reads."""

    tree: ClusterTree
    nodes: ClusterNodes
    view: Sight | None
    limits: Refinement


@torch.no_grad()
def exchange_links(
    patches: Patches,
    rays: AbstractRayCaster | None = None,
    limits: Refinement = DEFAULT,
    *,
    budget: int = 2**33,
    seed: int = 0,
) -> ExchangeLinks:
    """H of one-sided patches with blockers, before closing.

    Args:
        patches: triangles or planar convex quads, m.
        rays: what blocks; None if nothing does.
        limits: how finely pairs of clusters are split.
        budget: bytes that may be allocated.
        seed: of the shadow segments.

    Returns:
        float64, detached: links do not move with the corners.

    Raises:
        ShapeError: not triangles or quads.
        InvalidValueError: NaN corners.
        OutOfRangeError: negative limits.
        ResourceLimitError: links and patches would not fit into `budget`.
    """
    _check(patches, limits, budget)
    corners = wide(patches.corners)[0]
    middle, scale = _frame(corners)
    unit = Patches((corners - middle) / scale)
    tree = cluster_tree(unit)
    view = None
    if rays is not None:
        metres = tree._replace(
            centre=tree.centre * scale + middle,
            radius=tree.radius * scale,
            thick=tree.thick * scale,
            area=tree.area * scale**2,
        )
        view = sight(metres, Patches(corners), rays, seed)
    world = _World(tree, cluster_nodes(tree, unit), view, limits)
    found = _visited(world, budget - PATCH_BYTES * patches.count)
    i, j = (tree.order[tree.start[k]] for k in found.near)
    near = polygon_exchange(unit.corners[i], unit.corners[j], limits.near)
    seen, seen_near = _visibility(world, found, near)
    lit, left = seen > 0, near * seen_near > 0
    return ExchangeLinks(
        unit.area * scale**2,
        tree.leaf,
        tree.parent,
        tree.levels,
        world.nodes.transfer,
        *found.links.at(lit),
        found.kernel[lit] * seen[lit, None, None] / scale**2,
        i[left],
        j[left],
        (near * seen_near)[left] * scale**2,
    )


def _visibility(
    world: _World, found: _Found, near: Float[Tensor, "near"]
) -> tuple[Float[Tensor, "link"], Float[Tensor, "near"]]:
    """Of links and near pairs, after further segments where they help most."""
    seen, count = found.seen.joined(found.near_seen), len(found.kernel)
    if world.view is not None:
        area = world.tree.area
        contact = guarded_divide(near, area[found.near.first] * area[found.near.second])
        kernel = torch.cat((found.kernel.mean((1, 2)), contact))
        total = world.limits.more * int((seen.drawn > 0).sum())
        pairs = found.links.joined(found.near)
        seen = looked_again(world.view, pairs, seen, kernel, total)
    return seen.visibility.split((count, len(near)))


def _check(patches: Patches, limits: Refinement, budget: int) -> None:
    check_patches(patches)
    require_kind("limits", limits, Refinement)
    if not all(isinstance(value, float | int) and value >= 0 for value in limits):
        raise OutOfRangeError("limits", f"{limits}", "pass numbers >= 0")
    require_whole("limits.samples", limits.samples, 0, 2**16)
    require_whole("limits.more", limits.more, 0, 2**16)
    _afford(PATCH_BYTES * patches.count, budget, f"{patches.count} patches")


def _afford(needed: int, budget: int, what: str) -> None:
    if needed > budget:
        raise ResourceLimitError(
            "exchange_links",
            f"{what}, which need {needed} bytes of {budget}",
            "raise the tolerance or `budget`, or use larger patches",
        )


def _frame(corners: Tensor) -> tuple[Tensor, float]:
    """Middle and half extent of the scene: all else is done in this unit."""
    points = corners.reshape(-1, 3)
    if len(points) == 0:
        return corners.new_zeros(3), 1.0
    low, high = points.amin(0), points.amax(0)
    return (low + high) / 2, float((high - low).amax() / 2) or 1.0


def _visited(world: _World, budget: int) -> _Found:
    root = torch.zeros(min(1, len(world.tree.order)), dtype=torch.int64)
    root = root.to(world.tree.order.device)
    front, found = Pairs(root, root), []
    spent = 0
    while len(front.first):
        split = []
        for block in zip(*(t.split(BLOCK) for t in front), strict=True):
            fresh, more = _visit(world, Pairs(*block))
            found.append(fresh)
            split.append(more)
            spent += LINK_BYTES * len(fresh.kernel) + NEAR_BYTES * len(fresh.near.first)
            waiting = 16 * sum(len(t.first) for t in (front, *split))
            _afford(spent + waiting, budget, "links between clusters")
        front = split[0].joined(*split[1:])
    if not found:
        found = [_visit(world, front)[0]]
    links, kernel, seen, near, near_seen = zip(*found, strict=True)
    return _Found(
        links[0].joined(*links[1:]),
        torch.cat(kernel),
        seen[0].joined(*seen[1:]),
        near[0].joined(*near[1:]),
        near_seen[0].joined(*near_seen[1:]),
    )


def _visit(world: _World, pairs: Pairs) -> tuple[_Found, Pairs]:
    """What is found among pairs, and the pairs to visit next."""
    tree, nodes, view, limits = world
    share, linked, near, split = sorted_out(tree, pairs, limits)
    blocked = torch.zeros_like(linked)
    asked = torch.nonzero(linked | near).squeeze(-1)
    blocked[asked] = may_be_blocked(view, pairs.at(asked))
    alone = single(tree, pairs)
    coarse = linked & blocked & (share > limits.shadow) & ~alone
    linked, split = linked & ~coarse, split | coarse
    left, next_ones = pairs.at(near), children(tree, pairs.at(split))
    kernel = kernels(nodes, tree, pairs.at(linked))
    some = kernel.amax((1, 2)) > 0
    lit, kernel = torch.nonzero(linked).squeeze(-1)[some], kernel[some]
    links = pairs.at(lit)
    large = (share > limits.penumbra) & ~alone
    number = blocked * segments(share, large, limits)
    seen, near_seen = first_look(view, links, number[lit]), first_look(view, left, number[near])
    mixed = (seen.free > 0) & (seen.free < seen.valid) & large[lit]
    next_ones = next_ones.joined(children(tree, links.at(mixed)))
    links, kernel, seen = links.at(~mixed), kernel[~mixed], seen.at(~mixed)
    return _Found(links, damped(kernel, nodes, links), seen, left, near_seen), next_ones
