"""Links between clusters: the exchange areas of a large scene in few numbers.

    H = sum over links of U_I K U_J^T  +  the transpose  +  exact entries of near pairs

Every pair of patches belongs to at most one link or is a near pair. The pairs of clusters are
visited from the root down, a whole generation at once. A pair (I, J) is

* dropped if no member can face another. With w the direction between two points
  (n . w)(-n' . w) <= sin^2(angle(n, n') / 2), so that coplanar walls vanish at once;
* linked if the error of the light it carries is below `tolerance` / LINKS of all that the
  larger cluster sends: share F of the light times (r_I^2 + r_J^2) / d^2 + (t_I + t_J) / d.
  The nodes (`cluster_nodes`) follow the kernel to first order along the cluster, and not at all
  across it: t is how far its members lie off the plane through its centre;
* integrated exactly if both are single patches;
* split (the larger one) otherwise.

A pair that something may stand between is linked only below a share that a shadow may hide
in, and looked along (`link_visibility`): hidden pairs are dropped, mixed ones are split
further while they matter. What varies over a link is damped until no entry of
H is negative; its total stays.

References: P. Hanrahan, D. Salzman and L. Aupperle, SIGGRAPH 1991; B. Smits, J. Arvo and
D. Greenberg, SIGGRAPH 1994.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide, safe_acos
from torchradiometry.transport.cluster_nodes import NODES, ClusterNodes
from torchradiometry.transport.cluster_tree import ClusterTree

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Pairs", "Refinement"]

#: shares of light below this part of the accuracy are left out
NEGLIGIBLE = 2.0**-10
#: times that the first segments of a pair that can be split are doubled at most
DOUBLINGS = 2


class Refinement(NamedTuple):
    """How finely pairs of clusters are split.

    Attributes:
        error: largest share of light that may be wrong on a link.
        shadow: largest share of light on a link that something may stand between.
        penumbra: largest share of light on a link that is seen in part.
        near: relative error of the exact entries.
        samples, more: segments per link at first, and further ones in the mean.
    """

    error: float = 1.4e-4
    shadow: float = 3e-3
    penumbra: float = 3e-4
    near: float = 1e-3
    samples: int = 4
    more: int = 8


class Pairs(NamedTuple):
    """Pairs of clusters.

    Attributes:
        first, second: clusters.
    """

    first: Int[Tensor, "pair"]
    second: Int[Tensor, "pair"]

    def at(self, which: Tensor) -> Pairs:
        """Some of the pairs."""
        return Pairs(self.first[which], self.second[which])

    def joined(self, *others: Pairs) -> Pairs:
        """One list of all."""
        return Pairs(*(torch.cat(t) for t in zip(self, *others, strict=True)))


def shares(tree: ClusterTree, pairs: Pairs) -> tuple[Float[Tensor, "pair"], Float[Tensor, "pair"]]:
    """Share of light that the larger cluster sends at most, and how much of it is wrong."""
    i, j = pairs
    away = tree.centre[j] - tree.centre[i]
    square = away.square().sum(-1)
    distance = square.sqrt()
    reach = tree.radius[i] + tree.radius[j]
    ratio = torch.where(distance > reach, guarded_divide(reach, distance), 1)
    opening = torch.asin(ratio)
    axis = guarded_divide(away, distance.unsqueeze(-1))
    leaving = safe_acos((tree.axis[i] * axis).sum(-1))
    arriving = safe_acos(-(tree.axis[j] * axis).sum(-1))
    overlapping = ratio == 1
    product, partial = torch.ones_like(distance), overlapping
    for a, b, angle in ((i, j, leaving), (j, i, arriving)):
        least = angle - tree.cone[a] - opening
        cosine = torch.where(overlapping, 1, least.clamp(0, math.pi / 2).cos())
        product = product * torch.where(overlapping | (least < math.pi / 2), cosine, 0)
        # the lowest that a member of b can lie above the plane of a member of a
        tilt = tree.cone[a].clamp(max=math.pi / 2).sin() * (distance + reach)
        partial = partial | (distance * angle.cos() < tree.radius[b] + tilt)
    between = safe_acos((tree.axis[i] * tree.axis[j]).sum(-1)) + tree.cone[i] + tree.cone[j]
    product = torch.minimum(product, (between.clamp(max=math.pi) / 2).sin().square())
    area = torch.maximum(tree.area[i], tree.area[j])
    share = area * product / (math.pi * square + area)
    # a leaf stands for itself: light need not vary over it
    size, thick = (torch.where(tree.child < 0, 0, t) for t in (tree.radius.square(), tree.thick))
    bent = size[i] + size[j] + (thick[i] + thick[j]) * distance
    curve = torch.where(overlapping, 1, guarded_divide(bent, square))
    return share, torch.where(partial, ratio, curve + ratio**4)


def sorted_out(
    tree: ClusterTree, pairs: Pairs, limits: Refinement
) -> tuple[Float[Tensor, "pair"], Bool[Tensor, "pair"], Bool[Tensor, "pair"], Bool[Tensor, "pair"]]:
    """Share of light, and which pairs are linked, integrated exactly, and split."""
    share, wrong = shares(tree, pairs)
    alone = single(tree, pairs)
    own = pairs.first == pairs.second
    fine = share * wrong <= limits.error
    dark = (share <= limits.error * NEGLIGIBLE) | (own & (alone | fine))
    return share, fine & ~dark, alone & ~fine & ~dark, ~alone & ~fine & ~dark


def segments(
    share: Float[Tensor, "pair"], large: Bool[Tensor, "pair"], limits: Refinement
) -> Int[Tensor, "pair"]:
    """How many to look along at first: `samples`; of `large` pairs twice as many.

    Twice as many again for every time that their share of light is twice as large.
    """
    more = torch.zeros_like(share)
    for number in range(DOUBLINGS):
        more = more + (large & (share > limits.penumbra * 2**number))
    return limits.samples * (2**more).to(torch.int32)


def single(tree: ClusterTree, pairs: Pairs) -> Bool[Tensor, "pair"]:
    """True where both are one patch."""
    return (tree.child[pairs.first] < 0) & (tree.child[pairs.second] < 0)


def children(tree: ClusterTree, pairs: Pairs) -> Pairs:
    """The pairs that replace pairs of which at least one cluster has children."""
    i, j = pairs
    own = i == j
    one, two = tree.child[i[own]], tree.child[i[own]] + 1
    first = (tree.radius[i] >= tree.radius[j]) & (tree.child[i] >= 0) | (tree.child[j] < 0)
    left, right = first & ~own, ~first
    below, beside = tree.child[i[left]], j[left]
    above, under = i[right], tree.child[j[right]]
    return Pairs(
        torch.cat((one, one, two, below, below + 1, above, above)),
        torch.cat((one, two, two, beside, beside, under, under + 1)),
    )


def kernels(nodes: ClusterNodes, tree: ClusterTree, pairs: Pairs) -> Float[Tensor, "pair 3 3"]:
    """cos cos / (pi r^2) between the nodes of two clusters, 1/m2."""
    i, j = pairs
    away = nodes.position[j].unsqueeze(1) - nodes.position[i].unsqueeze(2)
    leaving = torch.einsum("lpqx,lpx->lpq", away, nodes.normal[i]).clamp(min=0)
    arriving = torch.einsum("lpqx,lqx->lpq", away, nodes.normal[j]).clamp(max=0)
    square = away.square().sum(-1)
    value = guarded_divide(-leaving * arriving, math.pi * square.square())
    most = 1 / torch.maximum(tree.area[i], tree.area[j])
    return torch.minimum(value, most[:, None, None])


def damped(kernel: Tensor, nodes: ClusterNodes, pairs: Pairs) -> Float[Tensor, "pair 3 3"]:
    """The same mean, with as much variation as keeps every member's exchange >= 0.

    k(xi, eta) = k0 + a.xi + b.eta + xi C eta is at least k0 - |a| R - |b| S - |C| R S.
    """
    mean = kernel.mean((-1, -2), keepdim=True)
    rows, columns = (kernel.mean(d, keepdim=True) - mean for d in (-1, -2))
    rest = kernel - mean - rows - columns
    r, s = nodes.spread[pairs.first], nodes.spread[pairs.second]
    # |a|^2 = 2/3 sum of squares of the three node values of a . xi
    sizes = [
        (t.square().sum((-1, -2)) * (2 / NODES) ** n).sqrt()
        for t, n in ((rows, 1), (columns, 1), (rest, 2))
    ]
    fall = sizes[0] * r + sizes[1] * s + sizes[2] * r * s
    level = mean[:, 0, 0]
    keep = torch.where(fall > level, guarded_divide(level, fall), 1)[:, None, None]
    return mean + keep * (kernel - mean)
