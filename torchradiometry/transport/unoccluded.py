"""Form factors of unoccluded patches as one graph of fixed shape, for export.

    F_ij = 1/(2 pi A_i) sum_e sum_f (e . f) L(e, f)          clipped at both planes, see `contour`

`exchange` chooses its rules by looking at the data, which no exported graph can do. Here every
pair of patches takes the same points: each outer edge is halved and graded towards its ends,
s = D sinh(u), so that whole edges and corners in common, the rule in a mesh, are met. The contour
cancels: it is off by up to 1e-11 of what the patches would exchange face to face, which is all of
the exchange of a sliver. From 5 sizes between the visible parts a product rule of degree 9 on
these parts, all of whose terms are positive, takes its place. Measured against
`polygon_exchange` with the default 24 points a half: a cube's triangles within 2e-12 relative;
random triangles 8 to 60 sizes apart within 1e-11; 2 to 6.5 sizes apart within 1e-9 where they see
1e-4 of what they would face to face, slivers within 1e-6 (3e-7 at a share of 7e-9).
What no grading meets costs digits: edges that come near each other away from their ends.
`python -m tests.benchmarks.unoccluded` measures random triangles (relative error, median and 99th
percentile): 3e-12 and 2e-8 where fair ones share an edge at 30 to 150 degrees, 7e-10 and 7e-4 at
any angle and shape, 2e-9 and 2e-3 where they share a corner, 8e-4 and 0.2 where they pierce each
other, 1e-3 and 0.2 where a corner lies on the other's face, 7e-4 and 1 where an edge lies on a part
of the other's. F itself is off by 0.05 at worst; what sees next to nothing may come out several
times as large. Cut patches along each other first, and give T-shaped joints their corner.

References: as of `contour`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, final

import torch
from torch import Tensor, nn
from torch._higher_order_ops.while_loop import while_loop

from torchradiometry.errors import require_floating, require_whole
from torchradiometry.geometry.clipping import clip_slots
from torchradiometry.geometry.patches import vector_area
from torchradiometry.numerics import dot, guarded_divide, safe_norm, safe_normalize, wide
from torchradiometry.transport.contour import log_distance
from torchradiometry.transport.exchange import product_sum
from torchradiometry.transport.polygon_pairs import Polygon
from torchradiometry.transport.rules import corner_shares, line_rule

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["UnoccludedFormFactors", "unoccluded_form_factors"]

#: distance from an end of an edge, in edges, where the grading begins
GRADING = 2.0**-13
#: distance, in sizes, from which pairs take a product rule, and its degree
DISTANT, DEGREE = 5.0, 9
#: its points in a triangle: how each mixes the corners, and its weight
RULE = [t.tolist() for t in corner_shares(3, DEGREE, torch.zeros(0, dtype=torch.float64))]
#: edges and points of one patch that meet all of the other at a time: memory against operations
EDGES, POINTS = 2, 25
#: pairs that are taken at a time where no graph is made: more do not fit the cache
PAIRS = 2**8


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
        0..1; rows and columns of degenerate patches are 0. Memory grows as patches^2 x points
        where gradients are kept or a graph is compiled (108 triangles and 48 points: 1.1 GB),
        else as patches^2 alone (256 triangles: 0.6 GB with all that is loaded, exported too).

    Differentiable in: corners (kinks where a corner crosses another patch's plane).
    Export: compile yes, ONNX yes, with a dynamic patch axis; float64 inside.
    References: as of `contour`.

    >>> floor = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> wall = torch.tensor([[0.0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    >>> unoccluded_form_factors(torch.stack((floor, wall)), *graded_line(24))
    tensor([[0.0000, 0.2000],
            [0.2000, 0.0000]])
    """
    require_floating("corners", corners)
    if not torch.compiler.is_compiling() and corners.shape[-3] == 0:
        return corners[:, 0] @ corners[:, 0].mT
    dtype = corners.dtype
    corners, node, weight = wide(corners, node, weight)
    corners = corners - corners.detach().mean((0, 1))
    unit = corners.detach().abs().max()
    corners = corners / torch.where(unit > 0, unit, 1)
    height = _heights(corners)
    reached = height.amax(0) > 0
    parts = _visible(corners, height)
    rules = _Rules(node, weight, *(corners.new_tensor(rows) for rows in RULE))
    if torch.compiler.is_exporting():
        total = _row_by_row(parts, rules)
    elif torch.compiler.is_compiling():  # a graph knows no number of blocks
        total = _total(parts.mT, parts, rules)
    else:
        block = max(PAIRS // parts.shape[-1], 1)
        rows = zip(parts.mT.split(block, -2), parts.split(block, -2), strict=True)
        total = torch.cat([_total(own, other, rules) for own, other in rows])
    exchange = torch.where(reached & reached.mT, total + total.mT, 0).clamp(min=0) / 2
    return guarded_divide(exchange, safe_norm(vector_area(corners)).unsqueeze(1)).to(dtype)


def _visible(corners: Tensor, height: Tensor) -> Float[Tensor, "2 4 edge patch patch"]:
    """Starts and ends of the edges of the part of patch j in front of patch i, at [..., i, j].

    The fourth component is the height. The last edge runs along the cut; without a cut it is a
    corner. The transpose holds the part of patch i in front of patch j.
    """
    own = corners.permute(2, 1, 0).unsqueeze(-2).expand(-1, -1, corners.shape[0], -1)
    slots = clip_slots(torch.cat((own, height.unsqueeze(0))), height)
    start, end = slots[:, ::2], slots[:, 1::2]
    inside = height >= 0
    following = inside.roll(-1, 0)
    leaves, returns = inside & ~following, following & ~inside
    cut = leaves.sum(0) > 0
    last = (
        torch.where(cut, torch.where(wanted, points, 0).sum(1), start[:, 0]).unsqueeze(1)
        for points, wanted in ((end, leaves), (start, returns))
    )
    return torch.stack([torch.cat(ends, 1) for ends in zip((start, end), last, strict=True)])


class _Rules(NamedTuple):
    """Points and weights: of the outer edges, and in the triangles of the product rule."""

    node: Float[Tensor, "point"]
    weight: Float[Tensor, "point"]
    share: Float[Tensor, "sample 3"]
    portion: Float[Tensor, "sample"]


def _row_by_row(parts: Tensor, rules: _Rules) -> Float[Tensor, "patch patch"]:
    """`_total` of one receiver after the other: a loop in the graph, whose memory is one row's."""
    receiver = torch.arange(parts.shape[-1], device=parts.device)

    def following(k: Tensor, total: Tensor) -> tuple[Tensor, Tensor]:
        here = k.reshape(1)
        own, other = parts.index_select(-1, here).mT, parts.index_select(-2, here)
        row = _total(own, other, rules)
        return k + 1, torch.where((receiver == k).unsqueeze(1), row, total)

    start = torch.zeros((), dtype=torch.int64, device=parts.device)
    state = (start, torch.zeros_like(parts[0, 0, 0]))
    return while_loop(lambda k, _: k < parts.shape[-1], following, state)[1]


def _total(own: Tensor, other: Tensor, rules: _Rules) -> Float[Tensor, "*pair"]:
    """Exchange areas of pairs, half of a symmetric sum, by either rule.

    Args:
        own: of the part of patch i in front of patch j, from `_visible`.
        other: of the part of patch j in front of patch i.
        rules: the outer edges are i's.
    """
    away = _away(own.detach(), other.detach())
    near = _contour(own, other, rules)
    return torch.where(away, _product(own, other, away, rules), near)


def _contour(own: Tensor, other: Tensor, rules: _Rules) -> Float[Tensor, "*pair"]:
    """The double contour integral, a few outer edges after the other."""
    place, end = other[:, :3].unsqueeze(2)
    edge = end - place
    start, last = own[:, :3]
    total = torch.zeros_like(place[0, 0, 0])
    blocks = zip(*(t.unsqueeze(2).split(EDGES, 1) for t in (start, last - start)), strict=True)
    for begin, outer in blocks:
        near = (place - begin).unsqueeze(-1) - outer.unsqueeze(-1) * rules.node
        mean = (log_distance(near, near + edge.unsqueeze(-1)) * rules.weight).sum(-1)
        total = total + ((outer * edge).sum(0) * mean).sum((0, 1))
    return total / (2 * math.pi)


def _away(own: Tensor, other: Tensor) -> Bool[Tensor, "*pair"]:
    """Pairs whose visible parts lie so far apart that the product rule has converged."""
    corner = torch.stack((own, other))[:, 0, :3].movedim(1, -1)
    middle = corner.mean(1)
    radius = safe_norm(corner - middle.unsqueeze(1)).amax(1)
    gap = safe_norm(middle[0] - middle[1]) - radius.amin(0)
    return gap > DISTANT * radius.amax(0)


def _product(own: Tensor, other: Tensor, away: Tensor, rules: _Rules) -> Float[Tensor, "*pair"]:
    """The product rule; a finite number of no meaning where not `away`."""
    (here, lit), (there, bright) = (_points(side, rules) for side in (own, other))
    apart = torch.where(away, there, there + 4)  # from the first, also if it is the same
    total = torch.zeros_like(bright[0])
    for place, share in zip(here.split(POINTS, 1), lit.split(POINTS), strict=True):
        total = total + product_sum(place, share, apart, bright)
    return total / math.pi


def _points(
    side: Tensor, rules: _Rules
) -> tuple[Float[Tensor, "3 point *pair"], Float[Tensor, "point *pair"]]:
    """Of the product rule on the visible parts, and what each counts there."""
    start, end = side[:, :, :-1]
    fan = torch.stack((side[0, :, -1:].expand_as(start), start, end), 1).flatten(2)
    triangle = Polygon(fan[:3], fan[3])
    lit = (rules.share @ triangle.height).clamp(min=0)
    bright = lit * triangle.area * rules.portion.unsqueeze(-1)
    point = (rules.share @ triangle.corner).reshape(3, -1, *start.shape[2:])
    return point, bright.reshape(-1, *start.shape[2:])


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
        require_whole("order", order, 1, 2**10)
        node, weight = graded_line(order)
        self.register_buffer("node", node, persistent=False)
        self.register_buffer("weight", weight, persistent=False)

    def forward(self, corners: Float[Tensor, "patch corner 3"]) -> Float[Tensor, "patch patch"]:
        """F[receiver, emitter] of patches in m, 0..1."""
        return unoccluded_form_factors(corners, self.node, self.weight)

    def extra_repr(self) -> str:
        """Points on an edge."""
        return f"points={len(self.node)}"
