"""Points on patches: symmetric quadrature rules, and stratified samples.

    mean over a patch of f  =  sum_k w_k f(x_k),   sum w_k = 1

Triangles use rules that are symmetric under exchange of corners; quads the product of
Gauss-Legendre rules in their bilinear coordinates, weighted by the Jacobian (constant on a
parallelogram). A rule of degree d is exact for polynomials up to d on triangles and
parallelograms. `split` applies the rule to split^2 similar parts.

References: A. Stroud and D. Secrest, *Gaussian Quadrature Formulas* (1966), for degree 2;
J. Radon (1948), degree 5 with 7 points; M. Roberts, "The Unreasonable Effectiveness of
Quasirandom Sequences" (2018), for the additive sequence of the samples.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import OutOfRangeError
from torchradiometry.geometry.patches import Patches, subdivide
from torchradiometry.numerics import guarded_divide

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["PatchPoints", "patch_points", "sample_patches", "sequence"]

_ROOT = math.sqrt(15.0)
#: barycentric orbit (share of one corner, weight of each of its three points) by degree
_TRIANGLE = {
    1: [],
    2: [(2 / 3, 1 / 3)],
    5: [
        ((9 + 2 * _ROOT) / 21, (155 - _ROOT) / 1200),
        ((9 - 2 * _ROOT) / 21, (155 + _ROOT) / 1200),
    ],
}
#: weight of the centroid by degree
_CENTRE = {1: 1.0, 2: 0.0, 5: 9 / 40}
#: nodes and weights on 0..1 by degree
_LINE = {
    1: [(0.5, 1.0)],
    2: [(0.5 - math.sqrt(1 / 12), 0.5), (0.5 + math.sqrt(1 / 12), 0.5)],
    5: [(0.5 - math.sqrt(0.15), 5 / 18), (0.5, 4 / 9), (0.5 + math.sqrt(0.15), 5 / 18)],
}


class PatchPoints(NamedTuple):
    """Quadrature points of patches.

    Attributes:
        position: m.
        weight: they sum to 1 over the points of a patch.
    """

    position: Float[Tensor, "patch point 3"]
    weight: Float[Tensor, "patch point"]


def patch_points(
    corners: Float[Tensor, "patch corner 3"], degree: int, split: int = 1
) -> PatchPoints:
    """Points and weights of the rule of `degree` 1, 2 or 5 on triangles or quads.

    Args:
        corners: of triangles or planar convex quads, m.
        degree: polynomials up to it are averaged exactly.
        split: the patch is cut into split^2 similar parts first.

    Differentiable in: corners.
    Export: compile yes, ONNX yes.

    >>> patch_points(torch.eye(3).unsqueeze(0), 1).position
    tensor([[[0.3333, 0.3333, 0.3333]]])
    """
    if degree not in _CENTRE:
        raise OutOfRangeError("degree", f"{degree}", f"use one of {sorted(_CENTRE)}")
    share, weight = _shares(corners.shape[-2], degree, split, corners)
    position = torch.einsum("kc,pcx->pkx", share, corners)
    if corners.shape[-2] == 3:
        return PatchPoints(position, weight.expand(len(corners), -1))
    return PatchPoints(position, _with_jacobian(corners, share, weight))


def _shares(sides: int, degree: int, split: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Corner shares `point corner` and weights `point` on the parts of the unit patch."""
    triangle = sides == 3
    nodes, weights = _triangle_rule(degree) if triangle else _quad_rule(degree)
    square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    share, weight, unit = (
        torch.tensor(rows, dtype=torch.float64, device=like.device)
        for rows in (nodes, weights, torch.eye(3).tolist() if triangle else square)
    )
    if split > 1:
        edge = float((unit.roll(-1, 0) - unit).norm(dim=-1).max()) / split
        parts = subdivide(Patches(unit.unsqueeze(0)), edge)[0].corners
        points = torch.einsum("kc,pcx->pkx", share, parts).reshape(-1, 3)
        weight = weight.repeat(len(parts)) / len(parts)
        u, v = points[:, 0], points[:, 1]
        corners = ((1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v)
        share = points if triangle else torch.stack(corners, -1)
    return share.to(like), weight.to(like)


def _triangle_rule(degree: int) -> tuple[list[list[float]], list[float]]:
    share = [[1 / 3] * 3] if _CENTRE[degree] else []
    weight = [_CENTRE[degree]] if _CENTRE[degree] else []
    for one, each in _TRIANGLE[degree]:
        rest = (1 - one) / 2
        share += [[one, rest, rest], [rest, one, rest], [rest, rest, one]]
        weight += [each] * 3
    return share, weight


def _quad_rule(degree: int) -> tuple[list[list[float]], list[float]]:
    nodes = [(u, v, a * b) for u, a in _LINE[degree] for v, b in _LINE[degree]]
    share = [[(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v] for u, v, _ in nodes]
    return share, [w for _, _, w in nodes]


def _with_jacobian(corners: Tensor, share: Tensor, weight: Tensor) -> Tensor:
    """Weights times the local area of the bilinear map, made to sum to 1 again."""
    u, v = share[:, 1] + share[:, 2], share[:, 2] + share[:, 3]
    a, b, c, d = (corner.unsqueeze(1) for corner in corners.unbind(1))
    along = (b - a) * (1 - v).unsqueeze(-1) + (c - d) * v.unsqueeze(-1)
    across = (d - a) * (1 - u).unsqueeze(-1) + (c - b) * u.unsqueeze(-1)
    normal = torch.linalg.cross(c - a, d - b)
    area = (torch.linalg.cross(along, across) * normal).sum(-1) * weight
    total = area.sum(-1, keepdim=True)
    return torch.where(total > 0, guarded_divide(area, total), weight)


def sequence(samples: int, axes: int, like: Tensor) -> Float[Tensor, "sample axis"]:
    """Evenly spread numbers 0..1: x_k = frac(1/2 + k g^-a), a = 1...axes, g^(axes+1) = g + 1."""
    golden = 2.0
    for _ in range(64):
        golden = (1 + golden) ** (1 / (axes + 1))
    step = torch.tensor([golden**-a for a in range(1, axes + 1)], dtype=torch.float64)
    index = torch.arange(1, samples + 1, dtype=torch.float64).unsqueeze(-1)
    return (0.5 + index * step).frac().to(device=like.device, dtype=like.dtype)


def sample_patches(
    corners: Float[Tensor, "*batch corner 3"], where: Float[Tensor, "*batch 2"]
) -> Float[Tensor, "*batch 3"]:
    """Points spread evenly over patches as `where` is over the unit square.

    Args:
        corners: triangles or planar convex quads, m.
        where: 0..1 each.
    """
    u, v = where.unbind(-1)
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    if corners.shape[-2] == 4:
        d = corners[..., 3, :]
        first = torch.linalg.cross(b - a, c - a).norm(dim=-1)
        second = torch.linalg.cross(c - a, d - a).norm(dim=-1)
        share = torch.where(first + second > 0, guarded_divide(first, first + second), 0.5)
        lower = u < share
        b, c = torch.where(lower.unsqueeze(-1), b, c), torch.where(lower.unsqueeze(-1), c, d)
        u = torch.where(lower, guarded_divide(u, share), guarded_divide(u - share, 1 - share))
    folded = u + v > 1
    u, v = torch.where(folded, 1 - u, u), torch.where(folded, 1 - v, v)
    return a + u.unsqueeze(-1) * (b - a) + v.unsqueeze(-1) * (c - a)


def pair_index(count: int, mask: Tensor) -> tuple[Int[Tensor, "pair"], Int[Tensor, "pair"]]:
    """Indices i < j of the true entries of a symmetric `count count` mask."""
    receiver, emitter = torch.nonzero(mask, as_tuple=True)
    upper = receiver < emitter
    return receiver[upper], emitter[upper]
