"""Scenes from files: glTF/GLB, and every mesh format that trimesh reads.

A plain mesh (`.obj .ply .stl .off ...`) has no light and no camera; `with_default_view` adds
both. Its albedo is the diffuse colour of its material (`Kd`, times `map_Kd`) or the mean of its
vertex or face colours, taken as sRGB and linearised, and 0.5 where the file has none. Its
lengths are read as metres. Normals that the file gives are kept; without them it is shaded
flat. A mesh with an open border is two-sided, a closed one is not.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import torch
import trimesh

from torchradiometry.errors import (
    DTypeError,
    EmptySceneError,
    FileFormatError,
    InputFileError,
    RadiometryError,
    ResourceLimitError,
)
from torchradiometry.files import MAX_PIXELS, check_readable
from torchradiometry.scene.beside import Beside
from torchradiometry.scene.from_trimesh import picture_pixels, surface_from_trimesh
from torchradiometry.scene.gltf import MAX_ELEMENTS, load_gltf
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.wavefront import as_utf8, material_names, tidied_mesh

__all__ = ["SCENE_ENDINGS", "load_scene"]

#: bytes of a mesh that is text, which grows sixtyfold while it is read
MAX_MESH_TEXT = 2**27
#: bytes of a `.ply` in which its header ends
MAX_PLY_HEADER = 2**20
PLY_PICTURE = re.compile(rb"^comment +TextureFile([^\r\n]*)", re.MULTILINE | re.IGNORECASE)
PLY_COORDINATES = re.compile(
    rb"^(property[^\r\n]* (?:texture_u|texture_v|u|v|s|t|texcoord))(?=\s)", re.MULTILINE
)
GLTF_ENDINGS = (".gltf", ".glb")
#: archives, which may unpack to any size; drawings and point clouds, which have no faces
LEFT_OUT = ("zip", "gz", "bz2", "dxf", "svg", "xyz", "gltf", "glb")
#: what trimesh reads, without those
SCENE_ENDINGS = GLTF_ENDINGS + tuple(
    sorted(
        f".{name}"
        for name in trimesh.available_formats()
        if not name.startswith(LEFT_OUT) and not name.endswith(LEFT_OUT)
    )
)


@np.errstate(invalid="ignore", over="ignore")
def load_scene(path: str | Path, *, dtype: torch.dtype | None = None) -> Scene:
    """The scene that a file describes, in world space.

    Args:
        path: a glTF file (`.gltf`, `.glb`) or a mesh file (see `SCENE_ENDINGS`).
        dtype: floating dtype of all tensors, by default torch's default.

    Returns:
        Surfaces, and the lights and cameras that the file has. Values are as the file gives
        them; `Scene.validate` tells what is wrong with them.

    Raises:
        InputFileError: no such file, or a folder.
        FileFormatError: not a scene, damaged, or of an unknown format.
        EmptySceneError: no triangles in it.
        ResourceLimitError: too large.
        DTypeError: `dtype` is not a floating one.
    """
    dtype = dtype or torch.get_default_dtype()
    if not dtype.is_floating_point:
        raise DTypeError("dtype", f"{dtype}", "pass torch.float32 or torch.float64")
    path = check_readable(path, "scene file")
    ending = path.suffix.lower()
    if ending not in SCENE_ENDINGS:
        got = f"the ending {ending!r}" if ending else "a name without an ending"
        raise FileFormatError(str(path), got, f"use {', '.join(SCENE_ENDINGS)}")
    try:
        scene = load_gltf(path, dtype) if ending in GLTF_ENDINGS else _load_mesh(path, dtype)
    except OSError as error:
        if isinstance(error, RadiometryError):
            raise
        raise InputFileError(
            str(path), f"a file that cannot be read ({error})"[:300], "check it"
        ) from error
    if not any(surface.count for surface in scene.surfaces):
        raise EmptySceneError(str(path), "no triangles", "pass a file with a mesh")
    return scene


def _require_bearable(path: Path, data: bytes) -> None:
    """Refuse what would take trimesh too much memory or time."""
    binary = path.suffix.lower() == ".ply" and b"format ascii" not in data[:1000]
    binary |= path.suffix.lower() == ".stl" and not data[:80].lstrip().startswith(b"solid")
    if len(data) > MAX_MESH_TEXT and not binary:
        mend = f"save it as .glb or binary .ply, or with at most {MAX_MESH_TEXT} bytes"
        raise ResourceLimitError(str(path), f"{len(data)} bytes of text", mend)


def _tidied_ply(path: Path, data: bytes) -> bytes:
    """A `.ply` whose picture can be read; one without a picture keeps its colours, which trimesh
    would give up for texture coordinates."""
    head = data[: max(data.find(b"end_header", 0, MAX_PLY_HEADER), 0)]
    named = PLY_PICTURE.findall(head)
    for name in named:
        Beside(path).get(name.decode(errors="replace"))
    plain = head if named else PLY_COORDINATES.sub(rb"\1_unused", head)
    return data if plain == head else plain + data[len(head) :]


def _load_mesh(path: Path, dtype: torch.dtype) -> Scene:
    """A plain mesh through trimesh, with the transforms of its parts applied."""
    data, ending = path.read_bytes(), path.suffix[1:].lower()
    _require_bearable(path, data)
    beside = Beside(path)
    if ending == "obj":
        data = tidied_mesh(path, data)
    elif ending == "ply":
        data = _tidied_ply(path, data)
    elif ending == "off":
        data = as_utf8(data)
    try:
        loaded = trimesh.load_scene(
            io.BytesIO(data), file_type=ending, resolver=beside, process=False
        )
        graph = [(name, *loaded.graph[name]) for name in loaded.graph.nodes_geometry]
    except RadiometryError:
        raise
    except Exception as error:
        if beside.fault is not None:
            raise beside.fault from error
        # trimesh guesses the encoding of what is no text by a library that need not be there
        cause = "damaged data" if isinstance(error, ImportError) else f"{error}"
        got = f"no mesh ({cause})".replace("\n", " ")
        raise FileFormatError(str(path), got[:300], "pass a mesh file") from error
    if beside.fault is not None:
        raise beside.fault
    if beside.materials is not None and (unknown := material_names(data) - beside.materials):
        got = f"materials that its material file lacks ({', '.join(sorted(unknown))})"
        raise FileFormatError(str(path), got[:200], "add them there, or take them out here")
    parts = [
        (node, matrix, loaded.geometry[key])
        for node, matrix, key in graph
        if isinstance(loaded.geometry[key], trimesh.Trimesh)
    ]
    if any(mesh.vertices.ndim != 2 or mesh.vertices.shape[1] != 3 for _, _, mesh in parts):
        raise FileFormatError(str(path), "vertices without three numbers", "pass a mesh file")
    total = sum(len(mesh.vertices) + 3 * len(mesh.faces) for _, _, mesh in parts)
    if total > MAX_ELEMENTS:
        mend = f"simplify the mesh to {MAX_ELEMENTS}"
        raise ResourceLimitError(str(path), f"{total} vertices and indices", mend)
    pixels = sum(picture_pixels(mesh) for _, _, mesh in parts)
    if pixels > MAX_PIXELS:
        mend = f"shrink the textures of all its parts to {MAX_PIXELS}"
        raise ResourceLimitError(str(path), f"{pixels} pixels", mend)
    names = [path.stem if len(parts) == 1 else str(name) for name, _, _ in parts]
    return Scene(
        tuple(
            surface_from_trimesh(mesh, name=name, transform=matrix, dtype=dtype)
            for name, (_, matrix, mesh) in zip(names, parts, strict=True)
        )
    )
