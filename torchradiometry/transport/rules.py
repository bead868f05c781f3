"""Points on patches: symmetric quadrature rules, and stratified samples.

    mean over a patch of f  =  sum_k w_k f(x_k),   sum w_k = 1

Triangles use rules that are symmetric under exchange of corners; quads the product of
Gauss-Legendre rules in their bilinear coordinates, weighted by the Jacobian (constant on a
parallelogram). A rule of degree d is exact for polynomials up to d on triangles and
parallelograms: 1, 3 and 7 points on a triangle for degrees 1, 2 and 5, (d/2 + 1)^2 otherwise
(on triangles in collapsed coordinates). `split` applies the rule to split^2 similar parts.

References: A. Stroud and D. Secrest, *Gaussian Quadrature Formulas* (1966), for degree 2;
J. Radon (1948), degree 5 with 7 points; G. Golub and J. Welsch, Math. Comp. 23 (1969), for
points of any degree; M. Roberts, "The Unreasonable Effectiveness of
Quasirandom Sequences" (2018), for the additive sequence of the samples.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchradiometry.errors import (
    DTypeError,
    IndexRangeError,
    ShapeError,
    require_axes,
    require_kind,
    require_whole,
)
from torchradiometry.geometry.patches import Patches, subdivide
from torchradiometry.numerics import (
    guarded_divide,
    narrow,
    single,
)

if TYPE_CHECKING:
    from jaxtyping import Float, Int
    from numpy.typing import NDArray

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
#: nodes and weights on 0..1 by number of points
_LINE = {
    1: [(0.5, 1.0)],
    2: [(0.5 - math.sqrt(1 / 12), 0.5), (0.5 + math.sqrt(1 / 12), 0.5)],
    3: [(0.5 - math.sqrt(0.15), 5 / 18), (0.5, 4 / 9), (0.5 + math.sqrt(0.15), 5 / 18)],
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
    """Points and weights of a rule of `degree` on triangles or quads.

    Args:
        corners: of triangles or planar convex quads, m.
        degree: polynomials up to it are averaged exactly, 1...256.
        split: the patch is cut into split^2 similar parts first, 1...1024.

    Raises:
        DTypeError: no whole numbers.
        OutOfRangeError: others.

    Differentiable in: corners.
    Export: degrees 1, 2 and 5: compile yes, ONNX yes.

    >>> patch_points(torch.eye(3).unsqueeze(0), 1).position
    tensor([[[0.3333, 0.3333, 0.3333]]])
    """
    require_axes("corners", corners, None, None, 3)
    require_whole("degree", degree, 1, 2**8)
    require_whole("split", split, 1, 2**10)
    share, weight = corner_shares(corners.shape[-2], degree, corners, split)
    position = torch.einsum("kc,pcx->pkx", share, corners)
    if corners.shape[-2] == 3:
        return PatchPoints(position, weight.expand(len(corners), -1))
    return PatchPoints(position, _with_jacobian(corners, share, weight))


def corner_shares(
    sides: int, degree: int, like: Tensor, split: int = 1
) -> tuple[Float[Tensor, "point corner"], Float[Tensor, "point"]]:
    """The rule on the unit patch: how each point mixes the corners, and its weight.

    On a quad the weight is to be multiplied by the local area of the bilinear map.
    """
    triangle = sides == 3
    nodes, weights = _triangle_rule(degree) if triangle else _quad_rule(degree)
    square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    whole = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] if triangle else square
    share, weight, unit = (
        torch.tensor(rows, dtype=torch.float64, device=like.device)
        for rows in (nodes, weights, whole)
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
    if degree not in _CENTRE:
        return _collapsed_rule(degree // 2 + 1)
    share = [[1 / 3] * 3] if _CENTRE[degree] else []
    weight = [_CENTRE[degree]] if _CENTRE[degree] else []
    for one, each in _TRIANGLE[degree]:
        rest = (1 - one) / 2
        share += [[one, rest, rest], [rest, one, rest], [rest, rest, one]]
        weight += [each] * 3
    return share, weight


@cache
def _collapsed_rule(order: int) -> tuple[list[list[float]], list[float]]:
    """The square's product rule drawn together at one corner; degree 2 order - 1."""
    k = np.arange(order)
    diagonal = -1 / ((2 * k + 1) * (2 * k + 3))
    beside = np.sqrt(k[1:] * (k[1:] + 1)) / (2 * k[1:] + 1)
    # Gauss-Jacobi points of the weight 1 - x by Golub and Welsch (1969)
    value, vector = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
    across = [(0.5 + x / 2, w) for x, w in zip(value, vector[0] ** 2, strict=True)]
    nodes = [(u, (1 - u) * v, a * b) for u, a in across for v, b in _line(order)]
    return [[1 - u - v, u, v] for u, v, _ in nodes], [w for _, _, w in nodes]


def _quad_rule(degree: int) -> tuple[list[list[float]], list[float]]:
    line = _line(degree // 2 + 1)
    nodes = [(u, v, a * b) for u, a in line for v, b in line]
    share = [[(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v] for u, v, _ in nodes]
    return share, [w for _, _, w in nodes]


@cache
def _line(order: int) -> list[tuple[float, float]]:
    """Gauss-Legendre points on 0..1 with their weights."""
    if order in _LINE:
        return _LINE[order]
    node: NDArray = np.asarray(np.polynomial.legendre.leggauss(order)[0], dtype=np.longdouble)
    for _ in range(2):  # steps of Newton: the library's last digits are not all right
        below, value = node**0, node
        for k in range(1, order):
            below, value = value, ((2 * k + 1) * node * value - k * below) / (k + 1)
        slope = order * (below - node * value) / ((1 - node) * (1 + node))
        node = node - value / slope
    weight = 1 / ((1 - node) * (1 + node) * slope**2)
    return [(float((1 + x) / 2), float(w)) for x, w in zip(node, weight, strict=True)]


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


def line_rule(order: int, like: Tensor) -> tuple[Float[Tensor, "point"], Float[Tensor, "point"]]:
    """Gauss-Legendre points on 0..1 and their weights, which sum to 1; exact to degree 2n - 1.

    >>> line_rule(1, torch.zeros(1))
    (tensor([0.5000]), tensor([1.]))
    """
    points = torch.tensor(_line(order), dtype=torch.float64).to(like)
    return points[:, 0], points[:, 1]


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
    require_axes("corners", corners, None, 3)
    require_axes("where", where, 2)
    dtype = torch.promote_types(corners.dtype, where.dtype)
    corners, where = single(corners, where)
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
    return narrow(a + u.unsqueeze(-1) * (b - a) + v.unsqueeze(-1) * (c - a), dtype)


def pair_index(count: int, mask: Tensor) -> tuple[Int[Tensor, "pair"], Int[Tensor, "pair"]]:
    """Indices i < j of the true entries of a symmetric `count count` mask."""
    receiver, emitter = torch.nonzero(mask, as_tuple=True)
    upper = receiver < emitter
    return receiver[upper], emitter[upper]


def check_pairs(patches: int, receiver: Tensor, emitter: Tensor) -> None:
    """Raise a named error unless both index as many of so many patches."""
    require_kind("receiver", receiver, Tensor)
    require_kind("emitter", emitter, Tensor)
    if receiver.shape != emitter.shape or receiver.ndim != 1:
        got = f"shapes {tuple(receiver.shape)} and {tuple(emitter.shape)}"
        raise ShapeError("receiver, emitter", got, "pass as many of both in one row")
    for name, index in (("receiver", receiver), ("emitter", emitter)):
        if index.dtype not in (torch.int32, torch.int64):
            raise DTypeError(name, f"a tensor of {index.dtype}", "pass indices of patches, int64")
        wrong = index[(index < 0) | (index >= patches)]
        if len(wrong):
            raise IndexRangeError(name, f"{int(wrong[0])}", f"pass 0 to {patches - 1}")
