"""Scenes to GLB files.

The inverse of `gltf`: one mesh, material and node per surface, one node per light and camera.
Vertices are stored in float32, colours and transforms with all digits. Textures are not written.

References: Khronos, *glTF 2.0 Specification* (2021); KHR_lights_punctual;
KHR_materials_emissive_strength; KHR_materials_pbrSpecularGlossiness.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchradiometry.errors import FileFormatError
from torchradiometry.geometry.cameras import AbstractCamera, OrthographicCamera, PinholeCamera
from torchradiometry.numerics import safe_normalize
from torchradiometry.places import atomic_path, check_place
from torchradiometry.scene.gltf_materials import GLOSS, glossiness_of
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.surface import Surface
from torchradiometry.sources.base import AbstractSource
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.point import PointSource
from torchradiometry.sources.spot import SpotSource

__all__ = ["save_scene"]

FLOAT, UINT = 5126, 5125
#: rounding of colours that float32 holds
UNIT = torch.finfo(torch.float32).eps
LIGHTS, STRENGTH = "KHR_lights_punctual", "KHR_materials_emissive_strength"


def save_scene(scene: Scene, path: str | Path) -> Path:
    """Write a scene to a `.glb` file, atomically.

    Raises:
        FileFormatError: another ending, or something that the file cannot hold: a texture, a
            source other than point, spot and directional, colours of other than 1 or 3 channels.
        InputFileError: the folder does not exist.
    """
    path = check_place(path, (".glb",))
    writer = _Writer()
    for surface in scene.surfaces:
        writer.add_surface(surface)
    for source in scene.sources:
        writer.add_source(source)
    for camera in scene.cameras:
        writer.add_camera(camera)
    with atomic_path(path) as temporary:
        temporary.write_bytes(writer.glb())
    return path


class _Writer:
    """The tree and the buffer of a file in the making."""

    def __init__(self) -> None:
        self.lists: dict[str, list[Any]] = {}
        self.lights: list[dict[str, Any]] = []
        self.data = bytearray()

    def add(self, key: str, entry: dict[str, Any]) -> int:
        members = self.lists.setdefault(key, [])
        members.append(entry)
        return len(members) - 1

    def add_surface(self, surface: Surface) -> None:
        if surface.texture is not None:
            mend = "take the texture off, or write the file with another tool"
            raise FileFormatError(f"surface {surface.name!r}", "a texture", mend)
        attributes = {"POSITION": self._vectors(surface.vertices, bounds=True)}
        if surface.normals is not None:
            attributes["NORMAL"] = self._vectors(surface.normals)
        order = surface.faces.detach().cpu().numpy().astype("<u4").reshape(-1)
        primitive = {
            "attributes": attributes,
            "indices": self._accessor(order, UINT, "SCALAR"),
            "material": self.add("materials", _material(surface)),
        }
        mesh = self.add("meshes", {"name": surface.name, "primitives": [primitive]})
        self.add("nodes", {"name": surface.name, "mesh": mesh})

    def add_source(self, source: AbstractSource) -> None:
        if not isinstance(source, (PointSource, SpotSource, DirectionalSource)):
            mend = "glTF has point, spot and directional lights"
            raise FileFormatError("scene.sources", f"a {type(source).__name__}", mend)
        distant = isinstance(source, DirectionalSource)
        power = source.irradiance if isinstance(source, DirectionalSource) else source.intensity
        if power.ndim != 2:
            raise FileFormatError("scene.sources", "lights per image", "write one image's lights")
        count = max(t.shape[0] for t in source.state_dict().values())
        for k in range(count):
            light = {"type": "directional" if distant else "point", **_colour(_row(power, k))}
            node: dict[str, Any] = {}
            if isinstance(source, SpotSource):
                cones = [float(_row(c, k)) for c in (source.inner_cone, source.outer_cone)]
                light["type"] = "spot"
                light["spot"] = dict(zip(("innerConeAngle", "outerConeAngle"), cones, strict=True))
                node["rotation"] = _turn(-_row(source.axis, k))
            if isinstance(source, DirectionalSource):
                node["rotation"] = _turn(_row(source.direction, k))
            else:
                node["translation"] = _row(source.position, k).tolist()
            self.lights.append(light)
            node["extensions"] = {LIGHTS: {"light": len(self.lights) - 1}}
            self.add("nodes", node)

    def add_camera(self, camera: AbstractCamera) -> None:
        aspect = camera.width / camera.height
        if isinstance(camera, PinholeCamera):
            lens = {"yfov": camera.yfov, "aspectRatio": aspect, "znear": 1e-3}
            entry: dict[str, Any] = {"type": "perspective", "perspective": lens}
        elif isinstance(camera, OrthographicCamera):
            lens = {"xmag": camera.ymag * aspect, "ymag": camera.ymag, "znear": 0.0, "zfar": 1e3}
            entry = {"type": "orthographic", "orthographic": lens}
        matrix = camera.camera_to_world.detach().double().cpu().T.reshape(-1).tolist()
        self.add("nodes", {"camera": self.add("cameras", entry), "matrix": matrix})

    def glb(self) -> bytes:
        """The finished file."""
        used = [name for name in (LIGHTS, STRENGTH, GLOSS) if self._uses(name)]
        tree: dict[str, Any] = {"asset": {"version": "2.0", "generator": "torchradiometry"}}
        tree |= self.lists
        tree |= {"scene": 0, "scenes": [{"nodes": list(range(len(self.lists.get("nodes", []))))}]}
        if self.data:
            tree["buffers"] = [{"byteLength": len(self.data)}]
        if used:
            tree["extensionsUsed"] = used
        if self.lights:
            tree["extensions"] = {LIGHTS: {"lights": self.lights}}
        text = json.dumps(tree, allow_nan=False).encode()
        chunks = [(b"JSON", text + b" " * (-len(text) % 4))]
        if self.data:
            chunks.append((b"BIN\0", bytes(self.data) + b"\0" * (-len(self.data) % 4)))
        body = b"".join(struct.pack("<I4s", len(c), kind) + c for kind, c in chunks)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def _uses(self, extension: str) -> bool:
        if extension == LIGHTS:
            return bool(self.lights)
        return any(extension in m.get("extensions", {}) for m in self.lists.get("materials", []))

    def _vectors(self, values: Tensor, bounds: bool = False) -> int:
        array = values.detach().cpu().numpy().astype("<f4")
        number = self._accessor(array, FLOAT, "VEC3")
        if bounds and len(array):
            low, high = array.min(0).astype(float), array.max(0).astype(float)
            self.lists["accessors"][number] |= {"min": low.tolist(), "max": high.tolist()}
        return number

    def _accessor(self, array: NDArray[np.generic], component: int, kind: str) -> int:
        data = array.tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.data += data
        entry = {"bufferView": self.add("bufferViews", view), "componentType": component}
        return self.add("accessors", {**entry, "count": len(array), "type": kind})


def _material(surface: Surface) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "name": surface.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*_three(surface.albedo), 1.0],
            "metallicFactor": 0.0,
        },
        "doubleSided": surface.two_sided,
    }
    shine = _colour(surface.emission)
    if shine["intensity"] > 0:
        entry["emissiveFactor"] = shine["color"]
        entry["extensions"] = {STRENGTH: {"emissiveStrength": shine["intensity"]}}
    if surface.glossy:
        entry["extensions"] = entry.get("extensions", {}) | {GLOSS: _gloss(surface)}
    return entry


def _gloss(surface: Surface) -> dict[str, Any]:
    """glTF scales the diffuse colour by what the largest specular one leaves."""
    specular, albedo = _three(surface.specular), _three(surface.albedo)
    rest = 1 - max(specular)
    diffuse = [value / rest if rest > 0 else value for value in albedo]
    if max(diffuse) > 1 + UNIT or (rest <= 0 and max(albedo) > 0):
        got = f"{surface.name!r}: albedo {max(albedo):.3g} beside specular {max(specular):.3g}"
        raise FileFormatError("surface", got, "keep albedo <= 1 - the largest specular")
    return {
        "diffuseFactor": [*(min(value, 1.0) for value in diffuse), 1.0],
        "specularFactor": specular,
        "glossinessFactor": glossiness_of(float(surface.shininess)),
    }


def _row(parameter: Tensor, light: int) -> Tensor:
    """A light's parameters; one row serves all lights."""
    values = parameter.detach().double().cpu()
    return values[min(light, len(values) - 1)]


def _three(channels: Tensor) -> list[float]:
    values = channels.detach().double().cpu().tolist()
    if len(values) not in (1, 3):
        raise FileFormatError("colour", f"{len(values)} channels", "glTF has three (or pass one)")
    return values * 3 if len(values) == 1 else values


def _colour(channels: Tensor) -> dict[str, Any]:
    """`color` in 0..1 and `intensity`, whose product is the colour."""
    values = _three(channels)
    most = max(values)
    return {"color": [v / most for v in values] if most > 0 else values, "intensity": most}


def _turn(backwards: Tensor) -> list[float]:
    """Quaternion x y z w that turns +z to a direction: that of half way between the two."""
    x, y, z = safe_normalize(backwards).tolist()
    quaternion = torch.tensor([-y, x, 0.0, 1 + z], dtype=torch.float64)
    if not bool(quaternion.any()):
        return [1.0, 0.0, 0.0, 0.0]
    return safe_normalize(quaternion).tolist()
