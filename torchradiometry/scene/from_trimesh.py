"""A trimesh mesh as a surface.

    albedo = linearised sRGB of the material's diffuse colour, or of the mean vertex or face
             colour;  0.5 where the mesh has neither

A closed mesh is one-sided. An open one has no inside, so both its sides reflect.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray

from torchradiometry.errors import FileFormatError
from torchradiometry.files import srgb_to_linear
from torchradiometry.scene.gltf_nodes import mirrors, transformed_normals, transformed_points
from torchradiometry.scene.surface import Surface, Texture, colours

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["GREY", "picture_pixels", "surface_from_trimesh"]

#: albedo of a mesh that names no colour
GREY = 0.5
#: modes of Pillow whose numbers are no bytes
DEEP = ("I", "F")
#: what trimesh fills in where a material file names no diffuse colour
UNSET = (102, 102, 102, 255)


@np.errstate(invalid="ignore", over="ignore")
def surface_from_trimesh(
    mesh: trimesh.Trimesh,
    *,
    name: str = "mesh",
    transform: NDArray[np.float64] | None = None,
    albedo: object = None,
    emission: object = 0.0,
    two_sided: bool | None = None,
    dtype: torch.dtype | None = None,
) -> Surface:
    """A trimesh mesh, placed in the world.

    Args:
        mesh: its lengths are read as metres; normals that it was given are kept, otherwise it
            is shaded flat.
        name: of the surface.
        transform: `4 4`, to world space; scale and mirroring allowed.
        albedo: number or channels, 0..1; None takes it from the mesh (see the module).
        emission: number or channels, W/m2/sr.
        two_sided: None makes an open mesh two-sided and a closed one not.
        dtype: of the tensors, by default torch's default.

    Raises:
        FileFormatError: a texture of more than 8 bits a channel, or without coordinates.

    >>> import trimesh
    >>> surface_from_trimesh(trimesh.creation.box(), name="cube").albedo
    tensor([0.5000, 0.5000, 0.5000])
    """
    dtype = dtype or torch.get_default_dtype()
    matrix = np.eye(4) if transform is None else np.asarray(transform, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    points = np.asarray(mesh.vertices, dtype=np.float64)
    open_border = two_sided is None and not _is_closed(points, faces)
    if mirrors(matrix):
        faces = faces[:, [0, 2, 1]]
    normals = _given_normals(mesh)
    if normals is not None:
        normals = transformed_normals(matrix, normals)
    texture = _texture(mesh, dtype) if albedo is None else None
    paint, shine = colours(_albedo(mesh) if albedo is None else albedo, emission, dtype=dtype)
    return Surface(
        name,
        _tensor(transformed_points(matrix, points), dtype),
        _tensor(faces, torch.int64),
        paint,
        shine,
        None if normals is None else _tensor(normals, dtype),
        open_border if two_sided is None else two_sided,
        texture,
    )


def _tensor(array: NDArray[np.generic], dtype: torch.dtype) -> Tensor:
    return torch.tensor(array, dtype=dtype)


def _given_normals(mesh: trimesh.Trimesh) -> NDArray[np.float64] | None:
    """Vertex normals that came with the mesh, not those that trimesh would compute."""
    if "vertex_normals" not in mesh._cache:
        return None
    normals = np.asarray(mesh.vertex_normals, dtype=np.float64)
    return normals if normals.shape == np.shape(mesh.vertices) else None


def _albedo(mesh: trimesh.Trimesh) -> NDArray[np.float64]:
    """Linear albedo `3` of a mesh, without its texture."""
    visual = mesh.visual
    if visual.kind == "texture":
        material = visual.material
        written = np.ravel(getattr(material, "kwargs", {}).get("kd", ()))  # `Kd`, not in 8 bits
        if len(written) in (1, 3, 4):
            return srgb_to_linear(np.broadcast_to(written[:3], 3)).astype(np.float64)
        encoded = np.asarray(getattr(material, "diffuse", None), dtype=object).reshape(-1)
        if len(encoded) < 3 or tuple(encoded) == UNSET:
            return np.full(3, GREY if _picture(mesh) is None else 1.0)
        return srgb_to_linear(encoded[:3].astype(np.float64) / 255).astype(np.float64)
    if visual.kind not in ("vertex", "face"):
        return np.full(3, GREY)
    area = np.asarray(mesh.area_faces, dtype=np.float64)
    colours = srgb_to_linear(np.asarray(visual.face_colors)[:, :3] / 255.0)
    usable = len(area) > 0 and np.isfinite(area).all() and area.sum() > 0
    return np.average(colours, axis=0, weights=area) if usable else np.full(3, GREY)


def picture_pixels(mesh: trimesh.Trimesh) -> int:
    """Pixels of a mesh's texture, 0 without one; the picture is not decoded for it."""
    image = getattr(getattr(mesh.visual, "material", None), "image", None)
    return 0 if image is None else image.width * image.height


def _picture(mesh: trimesh.Trimesh) -> NDArray[np.float64] | None:
    """Linear texture picture `height width 3`, None without one."""
    image = getattr(mesh.visual.material, "image", None)
    if image is None or _is_placeholder(image):
        return None
    where = str(image.info.get("file_path", "texture"))
    if np.shape(mesh.visual.uv) != (len(mesh.vertices), 2):
        got = "a picture, and faces without texture coordinates"
        raise FileFormatError(where, got, "give every corner its own, or take the picture out")
    if image.mode.startswith(DEEP):  # Pillow would clip them
        got = f"a texture of more than 8 bits a channel ({image.mode})"
        raise FileFormatError(where, got, "save it with 8 bits a channel, sRGB")
    table = srgb_to_linear(np.arange(256) / 255)  # of 8 bits; nothing larger is made on the way
    return table[np.asarray(image.convert("RGB"))]


def _is_placeholder(image: Any) -> bool:
    """Whether it is the small grey picture of a mesh with texture coordinates and no material."""
    grey = trimesh.visual.material.color_image()
    same = image.format is None and (image.mode, image.size) == (grey.mode, grey.size)
    return same and bool(np.array_equal(np.asarray(image), np.asarray(grey)))


def _texture(mesh: trimesh.Trimesh, dtype: torch.dtype) -> Texture | None:
    picture = _picture(mesh) if mesh.visual.kind == "texture" else None
    if picture is None:
        return None
    return Texture(_tensor(picture, dtype), _tensor(np.asarray(mesh.visual.uv), dtype))


def _is_closed(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bool:
    """Whether every edge is run through as often forwards as backwards.

    Vertices in the same place count as one, and faces that then repeat a corner as none.
    """
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        return False
    _, place = np.unique(vertices, axis=0, return_inverse=True)
    a, b, c = place.reshape(-1)[faces].T
    proper = (a != b) & (b != c) & (c != a)
    start, end = (np.concatenate(t)[np.tile(proper, 3)] for t in ((a, b, c), (b, c, a)))
    forwards, backwards = start * len(vertices) + end, end * len(vertices) + start
    return bool(np.array_equal(np.sort(forwards), np.sort(backwards)))
