"""Patches of different sizes: a grid on every face, whose cells are split in four where needed.

    (a, b, c)  ->  (a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab)

A point with weights (w_a, w_b, w_c) lies in the part of the corner whose weight is at least
1/2, otherwise in the middle one, whose own weights are 1 - 2 w. Finding a
point's patch is arithmetic on the grid and one look-up per level. Where a patch meets smaller
ones, the interpolated field has a small step along the shared edge.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.render.lattice import Lattice, locate

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Subdivision", "find", "refine", "unrefined"]


class Subdivision(NamedTuple):
    """Patches: the leaves of quadtrees that stand on the cells of a lattice.

    Attributes:
        lattice: the grid; its patches are the first nodes.
        child: first of the four children of a node, -1 for a leaf.
        leaf: which patch a node is, -1 for a split one.
        node: which node a patch is.
        corners: of the patches, m.
        face: which face a patch lies in.
        levels: how often the smallest patches were split.
    """

    lattice: Lattice
    child: Int[Tensor, "node"]
    leaf: Int[Tensor, "node"]
    node: Int[Tensor, "patch"]
    corners: Float[Tensor, "patch 3 3"]
    face: Int[Tensor, "patch"]
    levels: int


def unrefined(lattice: Lattice) -> Subdivision:
    """The cells of a lattice as they are."""
    number = torch.arange(len(lattice.triangle), device=lattice.triangle.device)
    whole = torch.full_like(number, -1)
    return Subdivision(lattice, whole, number, number, lattice.corners, lattice.triangle, 0)


def refine(patches: Subdivision, chosen: Bool[Tensor, "patch"]) -> Subdivision:
    """The chosen patches split in four; the others come first.

    Differentiable in: corners.
    """
    old, kept = patches.node[chosen], patches.node[~chosen]
    nodes = len(patches.child)
    added = torch.arange(4 * len(old), device=old.device)
    child = patches.child.index_copy(0, old, nodes + added[::4])
    child = torch.cat((child, torch.full_like(added, -1)))
    node = torch.cat((kept, nodes + added))
    leaf = torch.full_like(child, -1)
    leaf[node] = torch.arange(len(node), device=node.device)
    a, b, c = patches.corners[chosen].unbind(1)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    rows = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab))
    parts = torch.stack([torch.stack(row, 1) for row in rows], 1).reshape(-1, 3, 3)
    face = torch.cat((patches.face[~chosen], patches.face[chosen].repeat_interleave(4)))
    corners = torch.cat((patches.corners[~chosen], parts))
    return Subdivision(patches.lattice, child, leaf, node, corners, face, patches.levels + 1)


def find(
    patches: Subdivision, face: Int[Tensor, "ray"], barycentric: Float[Tensor, "ray 3"]
) -> tuple[Int[Tensor, "ray"], Float[Tensor, "ray 3"]]:
    """The patch that holds a point of a face, and the weights of the patch's corners."""
    node, weights = locate(patches.lattice, face, barycentric)
    for _ in range(patches.levels):
        child = patches.child[node]
        split = child >= 0
        largest, part = weights.detach().max(-1)
        part = torch.where(largest >= 0.5, part, 3)
        corner = 2 * weights - torch.nn.functional.one_hot(part, 4)[:, :3].to(weights)
        inner = torch.where((part == 3).unsqueeze(-1), 1 - 2 * weights, corner)
        weights = torch.where(split.unsqueeze(-1), inner, weights)
        node = torch.where(split, child + part, node)
    return patches.leaf[node], weights
