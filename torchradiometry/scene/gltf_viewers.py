"""Lights and cameras of a glTF file.

| glTF | here |
|---|---|
| `KHR_lights_punctual` point, `intensity` x `color` | `PointSource`, W/sr |
| spot, the same, with its cone | `SpotSource`, W/sr on the axis |
| directional, the same | `DirectionalSource`, W/m2 on a facing plane |
| perspective camera | `PinholeCamera`; `znear`, `zfar` ignored |
| orthographic camera | `OrthographicCamera` |

The extension counts in candela and lux; the numbers are read as W/sr and W/m2. `range` is
ignored: light falls off as 1/r2 without end. Lights shine, and cameras look, along the node's
-z; a node's scale changes neither.

References: Khronos, *KHR_lights_punctual*; *glTF 2.0 Specification* (2021), 3.10 (cameras).
"""

from __future__ import annotations

import math

import numpy as np
import torch

from torchradiometry.errors import RadiometryError, ResourceLimitError
from torchradiometry.geometry.cameras import (
    AbstractCamera,
    OrthographicCamera,
    PinholeCamera,
    rigid,
)
from torchradiometry.scene.gltf_container import Container
from torchradiometry.scene.gltf_fields import Fields
from torchradiometry.scene.gltf_nodes import Node
from torchradiometry.sources.base import AbstractSource
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.point import PointSource
from torchradiometry.sources.spot import SpotSource

__all__ = ["HEIGHT", "WIDTH", "read_cameras", "read_lights"]

#: size of the picture of a loaded camera, in pixels; a camera's own aspect ratio sets the width
WIDTH, HEIGHT = 640, 480
#: widest picture that an aspect ratio may ask for, in pixels
MAX_WIDTH = 2**14
#: lights, and cameras, of a scene
MAX_VIEWERS = 2**14


def read_lights(
    container: Container, nodes: list[Node], dtype: torch.dtype
) -> tuple[AbstractSource, ...]:
    """One source for each node that carries a light."""
    extension = container.tree.extension("KHR_lights_punctual")
    lights = extension.records("lights") if extension else []
    found: list[AbstractSource] = []
    for node in nodes:
        reference = node.fields.extension("KHR_lights_punctual")
        if reference is not None:
            _require_few(len(found), node)
            found.append(_light(reference.index("light", lights), node, dtype))
    return tuple(found)


def _light(fields: Fields, node: Node, dtype: torch.dtype) -> AbstractSource:
    intensity = fields.number("intensity", 1.0)
    colour = fields.numbers("color", 3, (1.0, 1.0, 1.0))
    power = torch.tensor([intensity * c for c in colour], dtype=dtype)
    position = torch.tensor(node.matrix[:3, 3].tolist(), dtype=dtype)
    kind = fields.text("type")
    if kind == "point":
        return PointSource(position, power)
    backwards = node.matrix[:3, 2]
    length = np.linalg.norm(backwards)
    if length == 0:
        raise node.fields.fault("", "a light on a node of scale 0", "give it a direction")
    towards = torch.tensor((backwards / length).tolist(), dtype=dtype)
    if kind == "directional":
        return DirectionalSource(towards, power)
    if kind != "spot":
        raise fields.fault("type", repr(kind)[:40], "use point, spot or directional")
    spot = fields.record("spot")
    cones = [
        torch.tensor([spot.number(key, default)], dtype=dtype)
        for key, default in (("innerConeAngle", 0.0), ("outerConeAngle", math.pi / 4))
    ]
    try:
        return SpotSource(position, -towards, power, *cones)
    except RadiometryError as error:
        raise fields.fault("spot", error.got, error.mend) from error


def read_cameras(
    container: Container, nodes: list[Node], dtype: torch.dtype
) -> tuple[AbstractCamera, ...]:
    """One camera for each node that carries one."""
    cameras = container.tree.records("cameras")
    found: list[AbstractCamera] = []
    for node in nodes:
        if "camera" in node.fields:
            _require_few(len(found), node)
            found.append(_camera(node.fields.index("camera", cameras), node, dtype))
    return tuple(found)


def _require_few(count: int, node: Node) -> None:
    if count >= MAX_VIEWERS:
        where = f"{node.fields.file}, {node.fields.place}"
        got = f"more than {MAX_VIEWERS} lights or cameras"
        raise ResourceLimitError(where, got, "leave some out")


def _camera(fields: Fields, node: Node, dtype: torch.dtype) -> AbstractCamera:
    kind = fields.text("type")
    try:
        place = rigid(torch.tensor(node.matrix.tolist(), dtype=torch.float64)).to(dtype)
        if kind == "perspective":
            lens = fields.record(kind)
            width = _width(lens, lens.number("aspectRatio", WIDTH / HEIGHT))
            yfov = lens.number("yfov")
            return PinholeCamera(width=width, height=HEIGHT, yfov=yfov, camera_to_world=place)
        if kind == "orthographic":
            lens = fields.record(kind)
            x, y = lens.number("xmag"), lens.number("ymag")
            width = _width(lens, x / y if y else math.inf)
            return OrthographicCamera(width=width, height=HEIGHT, ymag=y, camera_to_world=place)
    except RadiometryError as error:
        raise fields.fault("", error.got, error.mend) from error
    raise fields.fault("type", repr(kind)[:40], "use perspective or orthographic")


def _width(lens: Fields, aspect: float) -> int:
    if not 0 < aspect * HEIGHT <= MAX_WIDTH:
        raise lens.fault("", f"an aspect ratio of {aspect:.4g}", "use a positive, usual one")
    return max(1, round(aspect * HEIGHT))
