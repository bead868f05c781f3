"""Patches as a barycentric grid on triangles: arithmetic instead of search.

A triangle with n splits has n^2 patches and (n + 1)(n + 2) / 2 grid vertices. A point with
barycentric weights (w_a, w_b, w_c) lies in cell i = floor(n w_b), j = floor(n w_c), in its
upright triangle if the two remainders sum to at most 1, otherwise in the one upside down.
Row j starts at vertex j (2n + 3 - j) / 2 and at patch j (2n - j).

Values on patches become values on grid vertices, and those are interpolated linearly inside
each patch. Vertices of neighbouring triangles are one where they lie at the same place on the
same surface, on one plane or on a smoothly shaded mesh; across an edge between two walls
nothing is shared. The vertex values are found by starting from the mean of the patches
around (weighted by exposed area) and then adding what the mean of a patch's corners misses
of the patch's value, a few times: a linear field comes out linear, up to the rim.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = [
    "Lattice",
    "Welding",
    "build_lattice",
    "interpolate",
    "locate",
    "spread",
    "vertex_values",
    "weld",
    "weld_patches",
]

#: corrections of the vertex values: each moves the patch means to within about 1/3 of the rest
CORRECTIONS = 4
#: grid vertices closer than this share of the scene are one
WELD = 2.0**-14


class Lattice(NamedTuple):
    """The grid of all triangles.

    Attributes:
        splits: n of each triangle.
        first_patch: index of a triangle's first patch.
        first_vertex: index of a triangle's first grid vertex.
        corners: of the patches, m.
        triangle: which triangle a patch lies in.
        vertex: the grid vertices of each patch.
        position: of the grid vertices, m.
        owner: which triangle a grid vertex lies in.
    """

    splits: Int[Tensor, "triangle"]
    first_patch: Int[Tensor, "triangle"]
    first_vertex: Int[Tensor, "triangle"]
    corners: Float[Tensor, "patch 3 3"]
    triangle: Int[Tensor, "patch"]
    vertex: Int[Tensor, "patch 3"]
    position: Float[Tensor, "vertex 3"]
    owner: Int[Tensor, "vertex"]


def build_lattice(
    corners: Float[Tensor, "triangle 3 3"], splits: Int[Tensor, "triangle"]
) -> Lattice:
    """The grid of triangles, each with its own number of splits.

    Differentiable in: corners.
    """
    patches, vertices = splits**2, (splits + 1) * (splits + 2) // 2
    first_patch, first_vertex = patches.cumsum(0) - patches, vertices.cumsum(0) - vertices
    number = torch.arange(len(splits), device=splits.device)
    triangle = torch.repeat_interleave(number, patches)
    owner = torch.repeat_interleave(number, vertices)
    position = corners.new_zeros(len(owner), 3)
    vertex = splits.new_zeros(len(triangle), 3)
    for n in torch.unique(splits).tolist():
        members = torch.nonzero(splits == n).squeeze(-1)
        weight, cells = _grid(int(n), corners)
        local = torch.arange(max(len(weight), len(cells)), device=splits.device)
        where = (first_vertex[members].unsqueeze(-1) + local[: len(weight)]).reshape(-1)
        points = torch.einsum("vc,tcx->tvx", weight, corners[members]).reshape(-1, 3)
        position = position.index_put((where,), points)
        slots = (first_patch[members].unsqueeze(-1) + local[: len(cells)]).reshape(-1)
        vertex[slots] = (cells + first_vertex[members].reshape(-1, 1, 1)).reshape(-1, 3)
    return Lattice(
        splits, first_patch, first_vertex, position[vertex], triangle, vertex, position, owner
    )


def _grid(n: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Corner weights of the grid vertices of one triangle, and the corners of its patches."""
    count = torch.arange(n * n + 1, device=like.device)
    j, i = torch.meshgrid(*(count[: n + 1],) * 2, indexing="ij")
    keep = i + j <= n
    b, c = i[keep].to(like) / n, j[keep].to(like) / n
    row = count[:n].repeat_interleave(2 * (n - count[:n]) - 1)
    column = count[: n * n] - row * (2 * n - row)
    return torch.stack((1 - b - c, b, c), -1), _cell(n, column // 2, row, column % 2 == 1)


def _cell(n: int | Tensor, i: Tensor, j: Tensor, turned: Tensor) -> Int[Tensor, "patch 3"]:
    """Grid vertices of the upright triangle of cell (i, j), or of the one upside down."""
    here, above = j * (2 * n + 3 - j) // 2 + i, (j + 1) * (2 * n + 2 - j) // 2 + i
    upright = torch.stack((here, here + 1, above), -1)
    return torch.where(turned.unsqueeze(-1), torch.stack((above + 1, above, here + 1), -1), upright)


def locate(
    lattice: Lattice, triangle: Int[Tensor, "ray"], barycentric: Float[Tensor, "ray 3"]
) -> tuple[Int[Tensor, "ray"], Float[Tensor, "ray 3"]]:
    """The patch that holds a point of a triangle, and the weights of the patch's corners."""
    n = lattice.splits[triangle]
    scaled = (barycentric * n.unsqueeze(-1))[:, 1:]
    cell = torch.minimum(scaled.detach().floor().long().clamp(min=0), (n - 1).unsqueeze(-1))
    j = cell[:, 1]
    i = torch.minimum(cell[:, 0], n - 1 - j)
    u, v = scaled[:, 0] - i, scaled[:, 1] - j
    turned = (u + v > 1) & (i + j < n - 1)
    patch = lattice.first_patch[triangle] + j * (2 * n - j) + 2 * i + turned
    upright = torch.stack((1 - u - v, u, v), -1)
    weights = torch.where(turned.unsqueeze(-1), torch.stack((u + v - 1, 1 - u, 1 - v), -1), upright)
    return patch, weights


def weld(
    position: Float[Tensor, "vertex 3"], part: Int[Tensor, "vertex"], scale: float
) -> Int[Tensor, "vertex"]:
    """One number for all vertices that share their value.

    Args:
        position: m.
        part: vertices of different flat or smooth parts are never shared.
        scale: size of the scene, m.
    """
    low = position.detach().amin(0) if len(position) else 0.0
    # a shift by 0.37 keeps round numbers away from the borders of the rounding
    place = ((position.detach() - low) / (scale * WELD) + 0.37).floor()
    key = torch.cat((part.unsqueeze(-1).to(place), place), -1).long()
    return torch.unique(key, dim=0, return_inverse=True)[1]


class Welding(NamedTuple):
    """Which vertices patches share.

    Attributes:
        corner: welded vertices of each patch.
        vertices: how many there are.
        hanging: vertices that lie in the middle of a larger patch's edge.
        ends: the ends of that edge; a hanging vertex takes the mean of their values.
        levels: how often an end may itself be hanging.
    """

    corner: Int[Tensor, "patch 3"]
    vertices: int
    hanging: Int[Tensor, "hanging"]
    ends: Int[Tensor, "hanging 2"]
    levels: int


def weld_patches(
    corners: Float[Tensor, "patch 3 3"], part: Int[Tensor, "patch"], scale: float, levels: int = 0
) -> Welding:
    """The vertices of patches; arguments as of `weld`, `levels` of different sizes."""
    parts = [corners, (corners + corners.roll(-1, 1)) / 2] if levels else [corners]
    position = torch.cat(parts).reshape(-1, 3)
    kind = part.repeat_interleave(3).repeat(len(parts))
    number = weld(position, kind, scale).reshape(-1, 3)
    used, corner = torch.unique(number[: len(corners)], return_inverse=True)
    if not levels:
        return Welding(corner, len(used), used[:0], corner[:0, :2], 0)
    middle = number[len(corners) :].reshape(-1)
    place = torch.searchsorted(used, middle).clamp(max=len(used) - 1)
    found = torch.nonzero(used[place] == middle).squeeze(-1)
    ends = torch.stack((corner, corner.roll(-1, 1)), -1).reshape(-1, 2)
    hanging, first = torch.unique(place[found], return_inverse=True)
    chosen = torch.zeros_like(hanging).index_copy(0, first, found)
    return Welding(corner, len(used), hanging, ends[chosen], levels)


def vertex_values(
    value: Float[Tensor, "patch channel"], weight: Float[Tensor, "patch"], welding: Welding
) -> Float[Tensor, "vertex channel"]:
    """Values on welded vertices whose mean over a patch's corners is the patch's value.

    Args:
        value: on patches.
        weight: how much a patch counts (its exposed area); patches of weight 0 are ignored.
        welding: of the patches.

    Returns:
        >= 0 where `value` is.

    Differentiable in: value.
    """
    found = spread(value, weight, welding)
    for _ in range(CORRECTIONS):
        rest = value - found[welding.corner].mean(1)
        found = (found + spread(rest, weight, welding)).clamp(min=0)
    return found


def spread(
    value: Float[Tensor, "patch channel"], weight: Float[Tensor, "patch"], welding: Welding
) -> Float[Tensor, "vertex channel"]:
    """Weighted mean of the patches around each vertex; arguments as of `vertex_values`."""
    flat = welding.corner.reshape(-1)
    share = weight.to(value).unsqueeze(-1)
    each = torch.cat((value * share, share), -1).repeat_interleave(3, 0)
    total = each.new_zeros(welding.vertices, each.shape[-1]).index_add(0, flat, each)
    hanging, ends = welding.hanging, welding.ends
    for _ in range(welding.levels):
        half = total[hanging] / 2
        total = total.index_fill(0, hanging, 0)
        total = total.index_add(0, ends.reshape(-1), half.repeat_interleave(2, 0))
    found = guarded_divide(total[:, :-1], total[:, -1:])
    for _ in range(welding.levels):
        found = found.index_copy(0, hanging, found[ends].mean(1))
    return found


def interpolate(
    values: Float[Tensor, "vertex channel"],
    corner: Int[Tensor, "patch 3"],
    patch: Int[Tensor, "ray"],
    weights: Float[Tensor, "ray 3"],
) -> Float[Tensor, "ray channel"]:
    """Linear interpolation inside patches."""
    return (values[corner[patch]] * weights.unsqueeze(-1)).sum(1)
