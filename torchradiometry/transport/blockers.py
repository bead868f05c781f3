"""Which planar pieces can block, and triangles made into convex quads.

    triangles (a, b, p) and (b, a, q) in one plane,  a q b p convex   ->   quad (a, q, b, p)

Half as many blockers, none of whose edges is a mere diagonal: cheaper to clip with, and a
patch behind both halves of a wall is seen to be hidden by one blocker. Triangles are paired
over their longest shared edges first; what finds no partner is a quad with a repeated corner.
A convex solid is represented by its faces. A piece whose plane has the whole scene on one side
(the wall of a convex room) blocks nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import require_axes
from torchradiometry.geometry.patches import vector_area
from torchradiometry.numerics import safe_normalize

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["convex_blockers", "possible_blockers"]

#: blockers x points whose heights are held at a time
BLOCK = 2**22
#: how far a corner may lie off the plane, over the largest centred coordinate: 16 roundings of
#: float32, in which scenes are stored
FLAT = 2.0**-20


def possible_blockers(
    corners: Float[Tensor, "blocker side 3"], points: Float[Tensor, "point 3"], margin: float
) -> Bool[Tensor, "blocker"]:
    """False for polygons whose plane has all `points` on one side, up to `margin` (m)."""
    require_axes("corners", corners, None, None, 3)
    require_axes("points", points, None, 3)
    corners = corners.detach().to(torch.float64)
    if len(corners) == 0 or len(points) == 0:
        return torch.zeros(len(corners), dtype=torch.bool, device=corners.device)
    normal = safe_normalize(vector_area(corners))
    lowest, highest = [], []
    offset = (normal * corners[:, 0]).sum(-1)
    rows = max(1, BLOCK // len(points))
    for n, o in zip(normal.split(rows), offset.split(rows), strict=True):
        height = n @ points.detach().to(normal).mT - o.unsqueeze(-1)
        lowest.append(height.amin(-1))
        highest.append(height.amax(-1))
    return (torch.cat(lowest) < -margin) & (torch.cat(highest) > margin)


def convex_blockers(triangles: Float[Tensor, "triangle 3 3"]) -> Float[Tensor, "blocker 4 3"]:
    """Convex planar quads that cover the same points as the triangles, as few as easily found.

    Args:
        triangles: m, in either sense of rotation. Those without area are left out.

    Returns:
        m; where the last two corners are equal it is a triangle.

    Differentiable in: triangles (the pairing is constant).
    Export: no, the number of quads depends on the data.

    >>> wall = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> convex_blockers(torch.stack((wall[[0, 1, 2]], wall[[0, 2, 3]]))).shape
    torch.Size([1, 4, 3])
    """
    require_axes("triangles", triangles, None, 3, 3)
    found = triangles.detach().to(torch.float64)
    a, b, c = found.unbind(1)
    solid = (torch.linalg.cross(b - a, c - a) != 0).any(-1)
    triangles, found = triangles[solid], found[solid]
    single = torch.cat((triangles, triangles[:, 2:]), 1)
    if len(triangles) < 2:
        return single
    first, second, corner = _neighbours(found)
    quads = triangles.reshape(-1, 3)[corner]
    good = _flat_and_convex(quads.detach().to(found), found)
    first, second, quads = first[good], second[good], quads[good]
    length = (quads[:, 0] - quads[:, 2]).detach().norm(dim=-1)
    chosen = _matching(first, second, length, len(triangles))
    alone = torch.ones(len(triangles), dtype=torch.bool, device=found.device)
    alone[first[chosen]] = alone[second[chosen]] = False
    return torch.cat((quads[chosen], single[alone]))


def _neighbours(
    triangles: Tensor,
) -> tuple[Int[Tensor, "pair"], Int[Tensor, "pair"], Int[Tensor, "pair 4"]]:
    """Triangles that share an edge with exactly one other, and the corners of their union."""
    _, vertex = triangles.reshape(-1, 3).unique(dim=0, return_inverse=True)
    ends = torch.stack((vertex, vertex.reshape(-1, 3).roll(-1, 1).reshape(-1)), -1)
    _, edge, uses = ends.sort(-1).values.unique(dim=0, return_inverse=True, return_counts=True)
    order = edge.argsort(stable=True)
    order = order[uses[edge[order]] == 2].reshape(-1, 2)
    side = order % 3
    start = order - side
    apex = start + (side + 2) % 3
    corner = (order[:, 0], apex[:, 1], start[:, 0] + (side[:, 0] + 1) % 3, apex[:, 0])
    return *(order // 3).unbind(1), torch.stack(corner, 1)


def _flat_and_convex(quads: Tensor, triangles: Tensor) -> Bool[Tensor, "pair"]:
    points = triangles.reshape(-1, 3)
    size = (points - (points.amax(0) + points.amin(0)) / 2).abs().max()
    a, q, b, p = quads.unbind(1)
    normal = safe_normalize(torch.linalg.cross(b - a, p - a))
    flat = ((q - a) * normal).sum(-1).abs() <= FLAT * size
    edge = quads.roll(-1, 1) - quads
    turn = torch.linalg.cross(edge.roll(1, 1), edge)
    return flat & ((turn * normal.unsqueeze(1)).sum(-1) > 0).all(-1)


def _matching(first: Tensor, second: Tensor, length: Tensor, count: int) -> Int[Tensor, "chosen"]:
    """Disjoint pairs: again and again those that are the longest for both their triangles."""
    rank = torch.empty_like(first)
    rank[length.argsort(stable=True)] = torch.arange(len(first), device=first.device)
    chosen = []
    left = torch.arange(len(first), device=first.device)
    while len(left):
        best = torch.full((count,), -1, device=first.device)
        for triangle in (first[left], second[left]):
            best = best.scatter_reduce(0, triangle, rank[left], "amax")
        taken = (best[first[left]] == rank[left]) & (best[second[left]] == rank[left])
        chosen.append(left[taken])
        used = torch.zeros(count, dtype=torch.bool, device=first.device)
        used[first[left[taken]]] = used[second[left[taken]]] = True
        left = left[~(used[first[left]] | used[second[left]])]
    return torch.cat(chosen) if chosen else left
