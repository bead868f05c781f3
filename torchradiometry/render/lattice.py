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

__all__ = ["Lattice", "build_lattice", "interpolate", "locate", "vertex_values", "weld"]

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
    lattice: Lattice,
    surface: Int[Tensor, "triangle"],
    normal: Float[Tensor, "triangle 3"],
    scale: float,
) -> Int[Tensor, "vertex"]:
    """One number for all grid vertices that share their value.

    Args:
        surface: vertices of different surfaces are never shared.
        normal: of the plane of a flat triangle; any one vector for all triangles of a smooth
            mesh.
        scale: size of the scene, m.
    """
    low = lattice.position.detach().amin(0) if len(lattice.position) else 0.0
    # a shift by 0.37 keeps round numbers away from the borders of the rounding
    place = ((lattice.position.detach() - low) / (scale * WELD) + 0.37).floor()
    plane = (normal[lattice.owner].detach() * 256 + 0.37).floor()
    key = torch.cat((surface[lattice.owner].unsqueeze(-1).to(place), place, plane), -1).long()
    return torch.unique(key, dim=0, return_inverse=True)[1]


def vertex_values(
    value: Float[Tensor, "patch channel"],
    weight: Float[Tensor, "patch"],
    corner: Int[Tensor, "patch 3"],
    count: int,
) -> Float[Tensor, "vertex channel"]:
    """Values on welded vertices whose mean over a patch's corners is the patch's value.

    Args:
        value: on patches.
        weight: how much a patch counts (its exposed area); patches of weight 0 are ignored.
        corner: welded vertices of each patch, `count` in all.

    Returns:
        >= 0 where `value` is.

    Differentiable in: value.
    """
    flat = corner.reshape(-1)
    share = weight.unsqueeze(-1).expand(-1, 3).reshape(-1, 1)
    total = value.new_zeros(count, 1).index_add(0, flat, share.to(value))

    def around(field: Tensor) -> Tensor:
        spread = field.unsqueeze(1).expand(-1, 3, -1).reshape(len(flat), -1) * share
        return guarded_divide(
            value.new_zeros(count, field.shape[-1]).index_add(0, flat, spread), total
        )

    found = around(value)
    for _ in range(CORRECTIONS):
        found = (found + around(value - found[corner].mean(1))).clamp(min=0)
    return found


def interpolate(
    values: Float[Tensor, "vertex channel"],
    corner: Int[Tensor, "patch 3"],
    patch: Int[Tensor, "ray"],
    weights: Float[Tensor, "ray 3"],
) -> Float[Tensor, "ray channel"]:
    """Linear interpolation inside patches."""
    return (values[corner[patch]] * weights.unsqueeze(-1)).sum(1)
