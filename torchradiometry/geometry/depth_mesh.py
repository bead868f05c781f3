"""Depth map -> triangle mesh: the surface between the points of the pixels.

    a b     vertices: a = point of pixel (r, c), b = (r, c + 1), c = (r + 1, c),
    c d     d = (r + 1, c + 1);     faces: a c d and a d b, counter-clockwise for the camera

Every square of four neighbouring pixels is cut along the diagonal from a to d. A square of
which one corner is masked keeps the triangle of the other three, whichever it is; with two
masked corners or more nothing is left of it.

A depth step between neighbours is bridged like any other square: the map does not say what
lies between two pixels, and a surface without gaps hides what is behind it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import ShapeError, require_floating
from torchradiometry.geometry.depth import depth_to_points

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["depth_to_mesh"]


def depth_to_mesh(
    depth: Float[Tensor, "1 1 H W"],
    intrinsics: Float[Tensor, "3 3"] | None = None,
    pixel_size: float | Tensor | None = None,
) -> tuple[Float[Tensor, "vertex 3"], Int[Tensor, "face 3"]]:
    """Vertices and faces of one depth map; arguments as of `depth_to_points`.

    Args:
        depth: distance along the viewing axis, m; NaN or infinite where nothing is seen.
        intrinsics: matrix K of a pinhole camera, in pixels.
        pixel_size: side of a pixel of an orthographic camera, m. Give one of the two.

    Returns:
        vertices: points in the camera frame, m; vertex r W + c is the point of pixel (r, c),
            NaN where it is masked.
        faces: indices into them; their normals turn to the camera. No face names a masked
            pixel; a map of one row or one column has none at all.

    Raises:
        ShapeError: not one depth map, or both or neither of `intrinsics` and `pixel_size`.

    Differentiable in: depth, intrinsics, pixel_size (if a tensor), by way of the vertices.
    Export: no, the number of faces follows the mask.

    >>> vertices, faces = depth_to_mesh(torch.ones(1, 1, 2, 2), pixel_size=2.0)
    >>> vertices.tolist()
    [[-1.0, 1.0, -1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0], [1.0, -1.0, -1.0]]
    >>> faces.tolist()
    [[0, 2, 3], [0, 3, 1]]
    """
    require_floating("depth", depth)
    if depth.ndim != 4 or depth.shape[0] != 1:
        got = f"a tensor of shape {tuple(depth.shape)}"
        raise ShapeError("depth", got, "pass 1 x 1 x H x W, one map at a time")
    points = depth_to_points(depth, intrinsics, pixel_size)
    return points[0].flatten(1).T, _faces(depth[0, 0].abs() < torch.inf)


def _faces(seen: Bool[Tensor, "H W"]) -> Int[Tensor, "face 3"]:
    """Of each square, the triangles whose corners are all seen."""
    height, width = seen.shape
    index = torch.arange(height * width, device=seen.device).reshape(height, width)
    a, b, c, d = _corners(index)
    at_a, at_b, at_c, at_d = _corners(seen)
    halves = (a, c, d), (a, d, b)
    others = (c, d, b), (a, c, b)  # cut along the other diagonal: where a or where d is masked
    triangles = torch.stack([torch.stack(corners, -1) for corners in halves + others], 1)
    kept = (at_a & at_c & at_d, at_a & at_d & at_b, at_c & at_d & at_b & ~at_a)
    return triangles[torch.stack((*kept, at_a & at_c & at_b & ~at_d), 1)]


def _corners(grid: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The corners a, b, c, d of every square, row by row."""
    corners = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    a, b, c, d = (corner.reshape(-1) for corner in corners)
    return a, b, c, d
