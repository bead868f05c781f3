"""A binary tree over patches: what lies together and looks the same way stands together.

Clusters are split level by level, all clusters of a level at once: by their normals (at the
middle of the component that varies most) while these differ much; then by their height along
the mean normal while this varies more than their normals explain (a lamp below a ceiling, the
tops of boxes); else at the median along their longest side. Walls thus fall apart from each
other first, and a cluster far down the tree is a small, nearly flat piece of surface. The
members of a cluster are neighbours in `order`; its two children follow each other.

    centre  c = sum A_i x_i / sum A_i        radius  r = max |corner - c|
                                             thick   t = max |a . (corner - c)|
    axis    a = sum A_i n_i / |...|          cone    max angle(n_i, a)

References: P. Hanrahan, D. Salzman and L. Aupperle, "A Rapid Hierarchical Radiosity
Algorithm", SIGGRAPH 1991; B. Smits, J. Arvo and D. Greenberg, "A Clustering Algorithm for
Radiosity in Complex Environments", SIGGRAPH 1994.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import guarded_divide, safe_acos, safe_normalize

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["ClusterTree", "cluster_tree"]

#: clusters whose normals differ by more than this in a component are split by it
NORMAL_SPREAD = 0.5
#: clusters less than this many times as long as their steps are high are split by height
FLATNESS = 64.0


class ClusterTree(NamedTuple):
    """Clusters, the root first, level by level.

    Attributes:
        order: the patches in the order of the tree.
        levels: first cluster of each level, and the number of clusters at the end.
        parent: -1 of the root.
        child: the first child; the second follows it. -1 of a leaf, which is one patch.
        start, size: the members are `order[start : start + size]`.
        leaf: the leaf of each patch.
        area: m2; degenerate patches count as the smallest other one.
        centre, radius, thick, axis, cone: see above; m, m, m, unit, radians.
    """

    order: Int[Tensor, "patch"]
    levels: tuple[int, ...]
    parent: Int[Tensor, "cluster"]
    child: Int[Tensor, "cluster"]
    start: Int[Tensor, "cluster"]
    size: Int[Tensor, "cluster"]
    leaf: Int[Tensor, "patch"]
    area: Float[Tensor, "cluster"]
    centre: Float[Tensor, "cluster 3"]
    radius: Float[Tensor, "cluster"]
    thick: Float[Tensor, "cluster"]
    axis: Float[Tensor, "cluster 3"]
    cone: Float[Tensor, "cluster"]

    def level(self, number: int) -> slice:
        """The clusters of a level."""
        return slice(self.levels[number], self.levels[number + 1])

    @property
    def depth(self) -> int:
        """Number of levels."""
        return len(self.levels) - 1

    def members(self, number: int) -> tuple[Int[Tensor, "member"], Int[Tensor, "member"]]:
        """All (cluster, patch) of a level."""
        level = self.level(number)
        place, owner = _places(self.start[level], self.size[level])
        return owner + level.start, self.order[place]


@torch.no_grad()
def cluster_tree(patches: Patches) -> ClusterTree:
    """The tree of patches, with bounds on place and direction of every cluster.

    Args:
        patches: triangles or quads, float64, in units of about the size of the scene.

    >>> square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]).double()
    >>> tree = cluster_tree(Patches(torch.stack([square, square + 3, square + 1])))
    >>> tree.size.tolist(), tree.levels
    ([3, 2, 1, 1, 1], (0, 1, 3, 5))
    """
    order, levels, parent, child, start, size = _split(patches)
    leaves = torch.nonzero(child < 0).squeeze(-1)
    leaf = torch.empty_like(order)
    leaf[order[start[leaves]]] = leaves
    empty = patches.corners.new_zeros(0)
    bare = ClusterTree(
        order, levels, parent, child, start, size, leaf, *(empty,) * 6
    )  # fmt: skip
    area, centre, axis = _means(bare, patches)
    radius, thick, cone = _reach(bare, patches, centre, axis)
    return bare._replace(area=area, centre=centre, radius=radius, thick=thick, axis=axis, cone=cone)


def _places(start: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
    """The places of all members of segments, and the segment that each belongs to."""
    owner = torch.repeat_interleave(size)
    first = torch.cumsum(size, 0) - size
    within = torch.arange(len(owner), device=owner.device) - first[owner]
    return start[owner] + within, owner


def _split(
    patches: Patches,
) -> tuple[Tensor, tuple[int, ...], Tensor, Tensor, Tensor, Tensor]:
    features = torch.cat((patches.normal, patches.centroid), -1)
    order = torch.arange(patches.count, device=features.device)
    start, size = order[:1], torch.full_like(order[:1], patches.count)
    parent = torch.full_like(start, -1)
    levels, clusters = [0], []
    while len(start):
        child = torch.full_like(start, -1)
        wide = torch.nonzero(size > 1).squeeze(-1)
        child[wide] = levels[-1] + len(start) + 2 * torch.arange(len(wide), device=wide.device)
        clusters.append((parent, child, start, size))
        place, owner = _places(start[wide], size[wide])
        cut, order = _cut(features, order, place, owner, size[wide])
        parent = (wide + levels[-1]).repeat_interleave(2)
        levels.append(levels[-1] + len(start))
        start, size = (
            torch.stack(pair, 1).flatten()
            for pair in ((start[wide], start[wide] + cut), (cut, size[wide] - cut))
        )
    joined = (torch.cat(t) for t in zip(*clusters, strict=True)) if clusters else (order,) * 4
    parent, child, start, size = joined
    return order, tuple(levels), parent, child, start, size


def _cut(
    features: Tensor, order: Tensor, place: Tensor, owner: Tensor, size: Tensor
) -> tuple[Tensor, Tensor]:
    """How many members go to the first child, and the order in which they then stand."""
    member = order[place]
    values = features[member]
    index = owner.unsqueeze(-1)
    facing = values.new_zeros(len(size), 3).index_add(0, owner, values[:, :3])
    height = (safe_normalize(facing)[owner] * values[:, 3:]).sum(-1, keepdim=True)
    values = torch.cat((values, height), -1)
    index = index.expand_as(values)
    low, high = (
        torch.full((len(size), 7), fill, dtype=values.dtype, device=values.device).scatter_reduce(
            0, index, values, reduction
        )
        for fill, reduction in ((torch.inf, "amin"), (-torch.inf, "amax"))
    )
    spread = high - low
    turned, longest, step = spread[:, :3].amax(-1), spread[:, 3:6].amax(-1), spread[:, 6]
    by_normal = turned > NORMAL_SPREAD
    by_height = step > longest * (1 / FLATNESS + turned)
    axis = torch.where(by_height, 6, 3 + spread[:, 3:6].argmax(-1))
    axis = torch.where(by_normal, spread[:, :3].argmax(-1), axis)
    lowest, extent = (t.gather(1, axis.unsqueeze(-1)).squeeze(-1) for t in (low, spread))
    value = values.gather(1, axis[owner].unsqueeze(-1)).squeeze(-1)
    share = guarded_divide(value - lowest[owner], extent[owner])
    # one key for both: the whole part is the cluster, the fraction the place in it
    ranked = torch.argsort(owner.to(share) + share * (1 - 2.0**-10), stable=True)
    below = torch.zeros_like(size).index_add(0, owner, (share <= 0.5).to(size))
    cut = torch.where(by_normal | by_height, below, size // 2)
    order = order.clone()
    order[place] = member[ranked]
    return cut, order


def _means(tree: ClusterTree, patches: Patches) -> tuple[Tensor, Tensor, Tensor]:
    """Area, centre and axis, from the leaves upwards."""
    area = patches.area
    positive = area[area > 0]
    area = torch.where(area > 0, area, positive.amin() if len(positive) else 1.0)
    sums = area.new_zeros(len(tree.parent), 7)
    sums[tree.leaf] = torch.cat(
        (area.unsqueeze(-1), *(area.unsqueeze(-1) * t for t in (patches.centroid, patches.normal))),
        -1,
    )
    for number in range(tree.depth - 1, 0, -1):
        level = tree.level(number)
        sums.index_add_(0, tree.parent[level], sums[level].clone())
    total, axis = sums[:, 0], safe_normalize(sums[:, 4:])
    nowhere = axis.new_tensor([0.0, 0.0, 1.0])
    axis = torch.where(axis.any(-1, keepdim=True), axis, nowhere)
    return total, sums[:, 1:4] / total.unsqueeze(-1), axis


def _reach(
    tree: ClusterTree, patches: Patches, centre: Tensor, axis: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Radius about the centre, reach along the axis, and opening of the cone of normals."""
    radius, thick = torch.zeros_like(centre[:, 0]), torch.zeros_like(centre[:, 0])
    cosine = torch.ones_like(radius)
    normal = patches.normal
    for number in range(tree.depth):
        cluster, patch = tree.members(number)
        away = patches.corners[patch] - centre[cluster].unsqueeze(1)
        reach = away.square().sum(-1).amax(-1).sqrt()
        height = (away * axis[cluster].unsqueeze(1)).sum(-1).abs().amax(-1)
        radius.scatter_reduce_(0, cluster, reach, "amax")
        thick.scatter_reduce_(0, cluster, height, "amax")
        cosine.scatter_reduce_(0, cluster, (normal[patch] * axis[cluster]).sum(-1), "amin")
    return radius, thick, safe_acos(cosine)
