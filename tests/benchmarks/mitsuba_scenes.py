"""Our scenes for Mitsuba 3: the same surfaces, lights and cameras, and what a camera sees of them.

What is the same on both sides: a one-sided face is black on its back (`diffuse`), a two-sided one
reflects on both (`twosided`), shading normals are interpolated between vertices, a distant lamp is
given by its irradiance on a facing plane, a near one by its intensity, an emitting face by its
radiance, and a pixel is the plain mean over its square (box filter).

Needs Mitsuba: `pip install mitsuba`, and libLLVM (Debian's package libllvm19).
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh

from tests.benchmarks.mitsuba_phong import phong_bsdf
from torchradiometry import RenderSettings, Scene, Surface
from torchradiometry.geometry.cameras import PinholeCamera
from torchradiometry.numerics import safe_normalize
from torchradiometry.render.picture import see
from torchradiometry.render.world import prepare
from torchradiometry.sources.base import AbstractSource
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.point import PointSource

try:
    import drjit
    import mitsuba
except ImportError:
    drjit = mitsuba = None

__all__ = ["coverage", "drjit", "mitsuba", "mitsuba_scene", "relative_error", "sensor", "start"]

#: rays that are followed at a time to find what pixels see
BLOCK = 2**20


def start(threads: int) -> None:
    """Choose Mitsuba's variant, or end with a sentence where it is missing."""
    if mitsuba is None:
        sys.exit("mitsuba is not installed: run `pip install mitsuba` (and install libllvm19)")
    mitsuba.set_variant("llvm_ad_rgb")
    torch.set_num_threads(threads)
    drjit.set_thread_count(threads)


def mitsuba_scene(scene: Scene) -> Any:
    """The same scene; nothing merged: surface k is `s{k}`, lamp k `l{k}`."""
    made: dict[str, Any] = {"type": "scene"}
    for number, source in enumerate(scene.sources):
        for light, lamp in enumerate(_lamps(source)):
            made[f"l{number}_{light}"] = lamp
    with tempfile.TemporaryDirectory() as folder:
        for number, surface in enumerate(scene.surfaces):
            made[f"s{number}"] = _shape(surface, Path(folder) / f"{number}.ply")
        return mitsuba.load_dict(made, optimize=False)


def _shape(surface: Surface, file: Path) -> dict[str, Any]:
    """A mesh file with its material and, if it shines, its radiance."""
    if surface.texture is not None:
        raise ValueError(f"{surface.name}: textures are not carried over")
    normals = None if surface.normals is None else surface.normals.numpy()
    mesh = trimesh.Trimesh(
        surface.vertices.numpy(), surface.faces.numpy(), vertex_normals=normals, process=False
    )
    mesh.export(file, vertex_normal=normals is not None)
    shape = {"type": "ply", "filename": str(file), "face_normals": normals is None}
    paint = {"type": "diffuse", "reflectance": _rgb(surface.albedo)}
    if surface.glossy:
        paint = phong_bsdf(surface)
    shape["bsdf"] = {"type": "twosided", "bsdf": paint} if surface.two_sided else paint
    if bool((surface.emission > 0).any()):
        if surface.two_sided:
            raise ValueError(f"{surface.name}: a shape of Mitsuba shines on one side")
        shape["emitter"] = {"type": "area", "radiance": _rgb(surface.emission)}
    return shape


def _lamps(source: AbstractSource) -> list[dict[str, Any]]:
    """Mitsuba's direction is the way light travels, ours the way to the lamp."""
    if isinstance(source, DirectionalSource):
        pairs = zip(-safe_normalize(source.direction), source.irradiance, strict=True)
        return [
            {"type": "directional", "direction": way.tolist(), "irradiance": _rgb(power)}
            for way, power in pairs
        ]
    if isinstance(source, PointSource):
        pairs = zip(source.position, source.intensity, strict=True)
        return [
            {"type": "point", "position": place.tolist(), "intensity": _rgb(power)}
            for place, power in pairs
        ]
    raise ValueError(f"{type(source).__name__} is not carried over")


def _rgb(colour: torch.Tensor) -> dict[str, Any]:
    return {"type": "rgb", "value": colour.expand(3).tolist()}


def sensor(camera: PinholeCamera, sampler: str, samples: int) -> Any:
    """Ours looks along -z with x to the right; Mitsuba's along +z with x to the left."""
    place = camera.camera_to_world.double().numpy() @ np.diag([-1.0, 1, -1, 1])
    film = {"type": "hdrfilm", "width": camera.width, "height": camera.height}
    film |= {"rfilter": {"type": "box"}, "pixel_format": "rgb", "component_format": "float32"}
    made = {
        "type": "perspective",
        "fov": math.degrees(float(camera.yfov)),
        "fov_axis": "y",
        "to_world": mitsuba.ScalarTransform4f(place.tolist()),
        "film": film,
        "sampler": {"type": sampler, "sample_count": samples},
    }
    return mitsuba.load_dict(made)


@torch.no_grad()
def coverage(scene: Scene, side: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Pixels none of whose side x side rays meet an emitter, and those of which some do not."""
    world, camera = prepare(scene, RenderSettings()), scene.cameras[0]
    step = (torch.arange(side) + 0.5) / side - 0.5
    shift = torch.cartesian_prod(step, step).to(torch.float64)
    emitting = (world.triangles.emission > 0).any(-1)
    parts = []
    for pixel in camera.pixel_grid().double().reshape(-1, 1, 2).split(BLOCK // side**2):
        points = see(world, *camera.rays((pixel + shift).reshape(-1, 2)))
        found = emitting[points.triangle.clamp(min=0)] & (points.triangle >= 0)
        parts.append(found.reshape(-1, side**2))
    emits = torch.cat(parts).reshape(camera.height, camera.width, -1)
    return (~emits.any(-1)).numpy(), (~emits.all(-1)).numpy()


def relative_error(found: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Relative L1 over the pixels of the mask."""
    return float(np.abs(found - truth)[mask].sum() / truth[mask].sum())
