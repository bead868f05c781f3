"""Form factors of unoccluded patches as one graph of fixed shape, for export.

    F_ij = 1/(2 pi A_i) sum_e sum_f (e . f) L(e, f)          clipped at both planes, see `contour`

`exchange` chooses its rules by looking at the data, which no exported graph can do. Here every
pair of patches takes the same points: each outer edge is halved and graded towards its ends,
s = D sinh(u), so that shared edges and shared corners, the rule in a mesh, are met; from 30 sizes
on a product rule of degree 5 takes the place of the contour, whose digits cancel. Measured with
the default 24 points a half: a cube's squares and triangles within 1e-11 relative; random
triangles up to 10 sizes apart within 1e-9, from 30 to 10^4 sizes within 1e-10 (median 1e-12);
faces above each other at any gap within 1e-4, 1e-3 where they are shifted. Patches that pierce
each other, or touch in the middle of an edge, have a median error of 1e-7 but single ones, which
see little of each other, are off by up to a quarter: cut such patches along each other first.

References: as of `contour`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import OutOfRangeError
from torchradiometry.geometry.clipping import clip_slots
from torchradiometry.geometry.patches import vector_area
from torchradiometry.numerics import dot, guarded_divide, safe_norm, safe_normalize, wide
from torchradiometry.transport.contour import log_distance
from torchradiometry.transport.exchange import product_sum, weighted_points
from torchradiometry.transport.polygon_pairs import Polygon
from torchradiometry.transport.rules import line_rule

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["UnoccludedFormFactors", "unoccluded_form_factors"]

#: distance from an end of an edge, in edges, where the grading begins
GRADING = 2.0**-13
#: distance, in sizes, from which pairs take a product rule
DISTANT = 30.0


def graded_line(order: int) -> tuple[Float[Tensor, "point"], Float[Tensor, "point"]]:
    """2 `order` points on 0..1 that crowd at both ends, and their weights, float64."""
    node, weight = line_rule(order, torch.zeros(0, dtype=torch.float64))
    reach = math.asinh(0.5 / GRADING)
    half = GRADING * torch.sinh(reach * node)
    share = reach * weight * GRADING * torch.cosh(reach * node)
    return torch.cat((half, 1 - half)), torch.cat((share, share))


def unoccluded_form_factors(
    corners: Float[Tensor, "patch corner 3"],
    node: Float[Tensor, "point"],
    weight: Float[Tensor, "point"],
) -> Float[Tensor, "patch patch"]:
    """F[receiver, emitter] of one-sided patches without blockers, by one fixed rule.

    Args:
        corners: triangles or planar convex quads, m, counter-clockwise from the front.
        node, weight: of the outer edges, 0..1, from `graded_line`.

    Returns:
        0..1; rows and columns of degenerate patches are 0. Memory grows as patches^2 x points:
        100 triangles and 48 points took 3.7 GB.

    Differentiable in: corners (kinks where a corner crosses another patch's plane).
    Export: compile yes, ONNX yes, with a dynamic patch axis; float64 inside.
    References: as of `contour`.

    >>> floor = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> wall = torch.tensor([[0.0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    >>> unoccluded_form_factors(torch.stack((floor, wall)), *graded_line(24))
    tensor([[0.0000, 0.2000],
            [0.2000, 0.0000]])
    """
    dtype = corners.dtype
    corners, node, weight = wide(corners, node, weight)
    corners = corners - corners.detach().mean((0, 1))
    unit = corners.detach().abs().max()
    corners = corners / torch.where(unit > 0, unit, 1)
    # the part of patch j in front of patch i, at [..., i, j]; its transpose lies in front of j
    height = _heights(corners)
    height = _heights(corners)
    reached = height.amax(0) > 0
    near = _contour(clip_slots(corners.permute(2, 1, 0).unsqueeze(-2), height), node, weight)
    away = _away(corners.detach())
    total = torch.where(away, _product(corners, height, away), near)
    exchange = torch.where(reached & reached.mT, total + total.mT, 0).clamp(min=0) / 2
    return guarded_divide(exchange, safe_norm(vector_area(corners)).unsqueeze(1)).to(dtype)


def _contour(
    visible: Float[Tensor, "3 corner patch patch"], node: Tensor, weight: Tensor
) -> Float[Tensor, "patch patch"]:
    """The double contour integral, all edges of one with all edges of the other."""
    first, second = visible.mT.unsqueeze(2), visible.unsqueeze(1)
    edge, other = first.roll(-1, 1) - first, second.roll(-1, 2) - second
    start = (second - first).unsqueeze(-1) - edge.unsqueeze(-1) * node
    mean = (log_distance(start, start + other.unsqueeze(-1)) * weight).sum(-1)
    return ((edge * other).sum(0) * mean).sum((0, 1)) / (2 * math.pi)


def _away(corners: Tensor) -> Bool[Tensor, "patch patch"]:
    """Pairs so distant that the contour would lose more digits than a product rule."""
    middle = corners.mean(1)
    radius = safe_norm(corners - middle.unsqueeze(1)).amax(1)
    distance = safe_norm(middle.unsqueeze(1) - middle)
    return distance > DISTANT * torch.maximum(radius.unsqueeze(1), radius)


def _product(corners: Tensor, height: Tensor, away: Tensor) -> Float[Tensor, "patch patch"]:
    """The product rule of degree 5; a finite number of no meaning where not `away`."""
    own = corners.permute(2, 1, 0)
    shape = (*own.shape[:2], *away.shape)
    first, second = own.unsqueeze(-1).expand(shape), own.unsqueeze(-2).expand(shape)
    second = torch.where(away, second, second + 4)  # apart from the first, also if it is the same
    sides = (
        Polygon(first.flatten(2), height.mT.flatten(1)),
        Polygon(second.flatten(2), height.flatten(1)),
    )
    (here, bright), (there, other) = (weighted_points(side, 5) for side in sides)
    return product_sum(here, bright, there, other).reshape(away.shape) / math.pi


def _heights(corners: Tensor) -> Float[Tensor, "corner patch patch"]:
    """Of the corners of patch j above the plane of patch i, at [:, i, j]."""
    normal = safe_normalize(vector_area(corners))
    offset = corners.permute(1, 0, 2).unsqueeze(1) - corners.mean(1).unsqueeze(1)
    height = dot(offset, normal.unsqueeze(1))
    rounding = torch.finfo(corners.dtype).eps * 64
    return torch.where(height.detach().abs() < rounding, 0, height)


@final
class UnoccludedFormFactors(nn.Module):
    """`unoccluded_form_factors` as a layer that holds its rule.

    Args:
        order: points on each half of an edge.

    Raises:
        OutOfRangeError: fewer than one point.
    """

    node: Tensor
    weight: Tensor

    def __init__(self, order: int = 24) -> None:
        super().__init__()
        if order < 1:
            raise OutOfRangeError("order", f"{order}", "pass at least 1")
        node, weight = graded_line(order)
        self.register_buffer("node", node, persistent=False)
        self.register_buffer("weight", weight, persistent=False)

    def forward(self, corners: Float[Tensor, "patch corner 3"]) -> Float[Tensor, "patch patch"]:
        """F[receiver, emitter] of patches in m, 0..1."""
        return unoccluded_form_factors(corners, self.node, self.weight)

    def extra_repr(self) -> str:
        """Points on an edge."""
        return f"points={len(self.node)}"
