"""glTF and GLB files as scenes.

Each primitive of each node becomes a `Surface` in world space; see `gltf_materials` and
`gltf_viewers` for what its material, the lights and the cameras become. A primitive without
normals is shaded flat. Points and lines have no area and are left out; animations, skins and
morph targets are ignored.

References: Khronos, *glTF 2.0 Specification* (2021), 3.7 (geometry).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from torchradiometry.errors import FileFormatError, ResourceLimitError
from torchradiometry.geometry.meshes import face_areas
from torchradiometry.scene.gltf_accessors import read_indices, read_values
from torchradiometry.scene.gltf_container import Container, open_gltf
from torchradiometry.scene.gltf_fields import Fields
from torchradiometry.scene.gltf_materials import Map, Material, Materials
from torchradiometry.scene.gltf_nodes import (
    Node,
    mirrors,
    placed_nodes,
    transformed_normals,
    transformed_points,
)
from torchradiometry.scene.gltf_viewers import read_cameras, read_lights
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.surface import Surface, Texture
from torchradiometry.scene.texture_lookup import triangle_means

__all__ = ["MAX_ELEMENTS", "load_gltf"]

#: vertices and indices of all instances together: about 2 GB of tensors
MAX_ELEMENTS = 2**25
#: primitives of all instances together, empty ones too
MAX_PIECES = 2**16
TRIANGLES, STRIP, FAN = 4, 5, 6


def load_gltf(path: Path, dtype: torch.dtype) -> Scene:
    """The default scene of a `.gltf` or `.glb` file, in world space.

    Raises:
        InputFileError: no such file.
        FileFormatError: not glTF 2.0, cut short, or inconsistent; the place is named.
        ResourceLimitError: more data than is read.
    """
    container = open_gltf(path)
    nodes = placed_nodes(container)
    pieces = _pieces(container, nodes)
    materials = Materials(container, dtype)
    surfaces = [
        _surface(container, node, name, primitive, materials.of(primitive), dtype)
        for node, name, primitive in pieces
    ]
    return Scene(
        tuple(surface for surface in surfaces if surface is not None),
        read_lights(container, nodes, dtype),
        read_cameras(container, nodes, dtype),
    )


def _pieces(container: Container, nodes: list[Node]) -> list[tuple[Node, str, Fields]]:
    """Node, name and primitive of every surface to be, after their size is found bearable."""
    meshes = container.tree.records("meshes")
    primitives = {mesh.place: mesh.records("primitives") for mesh in meshes}
    pieces, total, looked_at = [], 0, 0
    for node in nodes:
        if "mesh" not in node.fields:
            continue
        mesh = node.fields.index("mesh", meshes)
        members = primitives[mesh.place]
        looked_at += len(members)
        if looked_at > MAX_PIECES:
            where, got = f"{mesh.file}, {node.name}", f"{looked_at} primitives so far"
            raise ResourceLimitError(where, got, f"join them to {MAX_PIECES}")
        for number, primitive in enumerate(members):
            if primitive.integer("mode", TRIANGLES) not in (TRIANGLES, STRIP, FAN):
                continue
            total += _elements(container, primitive)
            if total > MAX_ELEMENTS:
                where = f"{primitive.file}, {primitive.place}"
                mend = f"simplify the scene to {MAX_ELEMENTS}"
                raise ResourceLimitError(where, f"{total} vertices and indices so far", mend)
            name = node.name if len(members) == 1 else f"{node.name}, primitive {number}"
            pieces.append((node, name, primitive))
    return pieces


def _elements(container: Container, primitive: Fields) -> int:
    """Vertices and indices of a primitive, as declared."""
    position = primitive.record("attributes").index("POSITION", container.accessors)
    count = position.integer("count")
    if "indices" in primitive:
        count += primitive.index("indices", container.accessors).integer("count")
    return count


def _surface(
    container: Container,
    node: Node,
    name: str,
    primitive: Fields,
    material: Material,
    dtype: torch.dtype,
) -> Surface | None:
    attributes = primitive.record("attributes")
    points = read_values(container, attributes.index("POSITION", container.accessors), 3)
    faces = _faces(container, primitive, len(points))
    if mirrors(node.matrix):
        faces = faces[:, [0, 2, 1]]
    normals = _attribute(container, attributes, "NORMAL", 3, len(points))
    if normals is not None:
        normals = transformed_normals(node.matrix, normals)
    vertices = torch.from_numpy(transformed_points(node.matrix, points)).to(dtype)
    indices = torch.from_numpy(np.ascontiguousarray(faces))
    texture = _texture(container, attributes, material.albedo_map, len(points), dtype)
    shine = _texture(container, attributes, material.emission_map, len(points), dtype)
    emission = torch.tensor(material.emission, dtype=dtype)
    if shine is not None:
        emission = emission * _mean(shine, vertices, indices)
    return Surface(
        name,
        vertices,
        indices,
        torch.tensor(material.albedo, dtype=dtype),
        emission,
        None if normals is None else torch.from_numpy(normals).to(dtype),
        material.two_sided,
        texture,
        torch.tensor(material.specular, dtype=dtype),
        torch.tensor(material.shininess, dtype=dtype),
    )


def _faces(container: Container, primitive: Fields, vertices: int) -> NDArray[np.int64]:
    """Triangles `face 3` of a list, strip or fan.

    A strip's triangles that repeat a corner only join its parts and are left out.
    """
    if "indices" in primitive:
        order = read_indices(container, primitive.index("indices", container.accessors))
    else:
        order = np.arange(vertices, dtype=np.int64)
    mode = primitive.integer("mode", TRIANGLES)
    if mode == TRIANGLES:
        if len(order) % 3:
            got = f"{len(order)} corners, no whole number of triangles"
            raise primitive.fault("indices", got)
        return order.reshape(-1, 3)
    first, second, third = order[:-2], order[1:-1], order[2:]
    if mode == FAN:
        first = np.broadcast_to(order[:1], second.shape)
        faces = np.stack((second, third, first), 1)
    else:
        odd = (np.arange(len(third)) % 2).astype(bool)
        second, third = np.where(odd, third, second), np.where(odd, second, third)
        faces = np.stack((first, second, third), 1)
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]


def _attribute(
    container: Container, attributes: Fields, key: str, components: int, count: int
) -> NDArray[np.float64] | None:
    """A vertex attribute, if the primitive has it, with one row per vertex."""
    if key not in attributes:
        return None
    accessor = attributes.index(key, container.accessors)
    if accessor.integer("count") != count:
        got = f"{accessor.integer('count')} rows for {count} vertices"
        raise attributes.fault(key, got)
    return read_values(container, accessor, components)


def _texture(
    container: Container, attributes: Fields, used: Map | None, count: int, dtype: torch.dtype
) -> Texture | None:
    """A map laid on the vertices; None without a map."""
    if used is None:
        return None
    key = f"TEXCOORD_{used.coordinates}"
    uv = _attribute(container, attributes, key, 2, count)
    if uv is None:
        raise attributes.fault(key, "nothing", "a textured mesh needs texture coordinates")
    uv = uv @ used.transform[:, :2].T + used.transform[:, 2]
    uv[:, 1] = 1 - uv[:, 1]
    return Texture(used.image, torch.from_numpy(uv).to(dtype), used.wrap)


def _mean(texture: Texture, vertices: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Mean colour of a texture over the area of a mesh."""
    if faces.numel() and int(faces.max()) >= len(vertices):
        got = f"vertex {int(faces.max())} of {len(vertices)}"
        raise FileFormatError("a mesh with an emissive texture", got, "repair its indices")
    area = face_areas(vertices, faces).unsqueeze(-1)
    mean = (area * triangle_means(texture, faces)).sum(0)
    total = area.sum()
    return mean / total if bool(total > 0) else torch.ones_like(mean)
