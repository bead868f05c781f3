"""Three nodes that stand for a cluster of patches: light varies linearly over it.

Offsets from the centre, in the plane across the cluster's axis, are whitened by the area
weighted covariance S = L L^T:  xi = L^-1 T^T (x - c),  mean(xi) = 0,  mean(xi xi^T) = 1.

    node k       x_k = c + sqrt(2) T L e_k      e_k: three unit vectors 120 degrees apart
    share        l_k(xi) = 1/3 + sqrt(2)/3 e_k . xi,     l_k(x_j) = delta_kj,  sum l_k = 1
    mean over the cluster of f  =  1/3 sum_k f(x_k)      for f of degree 2 in the plane
    f at a member               =  sum_k l_k f(x_k)      for f of degree 1

The normals are fitted by a linear function of xi likewise, *not* made unit: the cosine of a
cluster is then the mean of its members' cosines. The nodes of a leaf stand on its patch. The
bases are nested: a parent's shares at its child's nodes (`transfer`) are all that is needed to
pass light up and down, in time proportional to the number of patches.

References: W. Hackbusch and S. Boerm, "H2-matrix approximation of integral operators by
interpolation", Appl. Numer. Math. 43 (2002).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.transport.cluster_tree import ClusterTree
from torchradiometry.transport.rules import patch_points

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["NODES", "ClusterNodes", "cluster_nodes"]

#: nodes of a cluster
NODES = 3
#: smallest relative width of a cluster across its longer side
NARROW = 2.0**-10
#: turn of the nodes from one cluster to the next, radians: no two grids fall together
TURN = math.pi * (3 - math.sqrt(5.0))


class ClusterNodes(NamedTuple):
    """The nodes of clusters.

    Attributes:
        position: m.
        normal: not unit.
        transfer: share of the parent's nodes (last) at the nodes of each cluster.
        spread: largest |xi| of a member's middle.
    """

    position: Float[Tensor, "cluster node 3"]
    normal: Float[Tensor, "cluster node 3"]
    transfer: Float[Tensor, "cluster node node"]
    spread: Float[Tensor, "cluster"]


@torch.no_grad()
def cluster_nodes(tree: ClusterTree, patches: Patches) -> ClusterNodes:
    """Nodes and transfers of all clusters.

    Args:
        tree: of `patches`.
        patches: float64, in units of about the size of the scene.
    """
    normal, covariance, mixed = _moments(tree, patches)
    first, second = _across(tree.axis)
    frame = torch.stack((first, second), -1)
    root = _root(frame.mT @ covariance @ frame)
    turn = TURN * torch.arange(len(tree.parent), dtype=normal.dtype, device=normal.device)
    angle = turn.unsqueeze(-1) + torch.arange(NODES).to(turn) * (2 * math.pi / NODES)
    unit = torch.stack((angle.cos(), angle.sin()), -1)
    offset = math.sqrt(2.0) * (unit @ root.mT @ frame.mT)
    position = tree.centre.unsqueeze(1) + offset
    back = torch.linalg.solve_triangular(root, frame.mT, upper=False)  # xi = back (x - c)
    slope = mixed @ back.mT
    direction = normal.unsqueeze(1) + math.sqrt(2.0) * (unit @ slope.mT)
    transfer = _shares(tree, position, back, unit)
    return ClusterNodes(position, direction, transfer, _spread(tree, transfer))


def _moments(tree: ClusterTree, patches: Patches) -> tuple[Tensor, Tensor, Tensor]:
    """Means of n, (x - c)(x - c)^T and n (x - c)^T, weighted by area, from the leaves up."""
    points = patch_points(patches.corners, 2)
    offset = points.position - tree.centre[tree.leaf].unsqueeze(1)
    sums = tree.centre.new_zeros(len(tree.parent), 7, 3)
    own = (points.weight.unsqueeze(-1) * offset).mT @ offset
    sums[tree.leaf, 0] = patches.normal
    sums[tree.leaf, 1:4] = own
    sums *= tree.area[:, None, None]
    for number in range(tree.depth - 1, 0, -1):
        level = tree.level(number)
        parent = tree.parent[level]
        away = (tree.centre[level] - tree.centre[parent]).unsqueeze(1)
        below = sums[level].clone()
        below[:, 1:4] += tree.area[level, None, None] * away.mT @ away
        below[:, 4:7] += below[:, :1].mT @ away
        sums.index_add_(0, parent, below)
    means = sums / tree.area[:, None, None]
    return means[:, 0], means[:, 1:4], means[:, 4:7]


def _across(axis: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors at right angles to unit vectors and to each other."""
    smallest = torch.nn.functional.one_hot(axis.abs().argmin(-1), 3).to(axis)
    first = torch.nn.functional.normalize(torch.linalg.cross(axis, smallest), dim=-1)
    return first, torch.linalg.cross(axis, first)


def _root(square: Float[Tensor, "cluster 2 2"]) -> Float[Tensor, "cluster 2 2"]:
    """Lower triangular L with L L^T = `square`, kept invertible."""
    a, b, c = square[:, 0, 0], square[:, 0, 1], square[:, 1, 1]
    floor = NARROW * (a + c).sqrt()
    floor = torch.where(floor > 0, floor, 1)
    left = torch.maximum(a.clamp(min=0).sqrt(), floor)
    below = b / left
    right = torch.maximum((c - below.square()).clamp(min=0).sqrt(), floor)
    zero = torch.zeros_like(left)
    return torch.stack((torch.stack((left, zero), -1), torch.stack((below, right), -1)), -2)


def _shares(tree: ClusterTree, position: Tensor, back: Tensor, unit: Tensor) -> Tensor:
    """l_k of the parent at the nodes of each cluster."""
    parent = tree.parent.clamp(min=0)
    xi = (position - tree.centre[parent].unsqueeze(1)) @ back[parent].mT
    return (1 + math.sqrt(2.0) * (xi @ unit[parent].mT)) / NODES


def _spread(tree: ClusterTree, transfer: Tensor) -> Tensor:
    """Largest |xi| of a member: |xi|^2 = 3 sum_k (l_k - 1/3)^2, along the chain of transfers."""
    spread = torch.zeros_like(tree.radius)
    share = torch.full((len(tree.leaf), NODES), 1 / NODES).to(transfer)
    for number in range(tree.depth - 1, -1, -1):
        cluster, patch = tree.members(number)
        here = share[patch]
        away = (NODES * (here - 1 / NODES).square().sum(-1)).sqrt()
        spread.scatter_reduce_(0, cluster, away, "amax")
        share[patch] = (here.unsqueeze(1) @ transfer[cluster]).squeeze(1)
    return spread
