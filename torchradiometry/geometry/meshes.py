"""Normals and areas of triangle meshes.

    face    S = 1/2 (b - a) x (c - a)        area |S|,  normal S / |S|
    vertex  n = normalize( sum over faces at the vertex of  alpha * S / |S| )

alpha is the angle of the face at that vertex, so that the normal depends on the shape and not
on how it is cut into triangles.

References: G. Thurmer and C. Wuthrich, "Computing vertex normals from polygonal facets",
*Journal of Graphics Tools* 3(1), 1998.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import (
    IndexRangeError,
    ShapeError,
    require_axes,
    require_floating,
    require_kind,
)
from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import angle_of, dot, safe_norm, safe_normalize

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["corner_angles", "face_areas", "face_corners", "face_normals", "vertex_normals"]


def face_corners(
    vertices: Float[Tensor, "vertex 3"], faces: Int[Tensor, "face 3"]
) -> Float[Tensor, "face 3 3"]:
    """The three corner points of each face, m.

    Raises:
        ShapeError: vertices not `vertex 3` or faces not `face 3`.
        IndexRangeError: a face that names a vertex which does not exist.

    Differentiable in: vertices.
    """
    require_floating("vertices", vertices)
    require_kind("faces", faces, Tensor)
    for name, tensor in (("vertices", vertices), ("faces", faces)):
        if tensor.ndim != 2 or tensor.shape[-1] != 3:
            got = f"a tensor of shape {tuple(tensor.shape)}"
            raise ShapeError(name, got, f"pass `{name} 3`")
    if faces.numel() and not 0 <= int(faces.min()) <= int(faces.max()) < len(vertices):
        wrong = (faces < 0) | (faces >= len(vertices))
        face = int(wrong.any(-1).nonzero()[0])
        got = f"indices {faces[face].tolist()} in face {face}"
        raise IndexRangeError("faces", got, f"use 0 to {len(vertices) - 1}")
    return vertices[faces]


def face_areas(
    vertices: Float[Tensor, "vertex 3"], faces: Int[Tensor, "face 3"]
) -> Float[Tensor, "face"]:
    """Areas of the faces, m2.

    Differentiable in: vertices (gradient 0 at zero area).

    >>> corners = torch.tensor([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]])
    >>> face_areas(corners, torch.tensor([[0, 1, 2]]))
    tensor([1.])
    """
    return Patches(face_corners(vertices, faces)).area


def face_normals(
    vertices: Float[Tensor, "vertex 3"], faces: Int[Tensor, "face 3"]
) -> Float[Tensor, "face 3"]:
    """Unit normals on the counter-clockwise side; zero for a face without area.

    Differentiable in: vertices (gradient 0 at zero area).

    >>> corners = torch.tensor([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]])
    >>> face_normals(corners, torch.tensor([[0, 1, 2], [0, 0, 2]]))
    tensor([[0., 0., 1.],
            [0., 0., 0.]])
    """
    return Patches(face_corners(vertices, faces)).normal


def vertex_normals(
    vertices: Float[Tensor, "vertex 3"], faces: Int[Tensor, "face 3"]
) -> Float[Tensor, "vertex 3"]:
    """Unit normals at the vertices: the face normals, weighted by the angle of each face there.

    A vertex of no face, or whose faces cancel or have no area, gets the zero vector.

    Differentiable in: vertices.
    Export: no (`index_add` over the faces); meshes are prepared before a graph runs.

    >>> corners = torch.tensor([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]])
    >>> vertex_normals(corners, torch.tensor([[0, 1, 2]]))
    tensor([[0., 0., 1.],
            [0., 0., 1.],
            [0., 0., 1.]])
    """
    corners = face_corners(vertices, faces)
    normal = Patches(corners).normal
    weighted = corner_angles(corners).unsqueeze(-1) * normal.unsqueeze(-2)
    total = torch.zeros_like(vertices).index_add(0, faces.reshape(-1), weighted.reshape(-1, 3))
    return safe_normalize(total)


def corner_angles(corners: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3"]:
    """Interior angles of triangles, radians; 0 where an edge has no length.

    Differentiable in: corners.
    """
    require_axes("corners", corners, 3, 3)
    after = safe_normalize(corners.roll(-1, -2) - corners)
    before = safe_normalize(corners.roll(1, -2) - corners)
    return angle_of(safe_norm(torch.linalg.cross(after, before)), dot(after, before))
