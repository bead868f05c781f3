"""What a camera records: the mean radiance over every pixel.

    L(pixel) = mean over s x s strata of  [ L_emitted + rho/pi (E_direct + E_indirect) ]

Each stratum holds one ray at a random place. Direct light is evaluated at the point it meets
(exact polygons times shadow rays, `direct`), indirect light is interpolated from radiosity
patches (`indirect`). The background and the backs of one-sided faces are black.

References: M. Cohen and J. Wallace, *Radiosity and Realistic Image Synthesis* (1993), ch. 9
and 10 (multi-pass rendering with direct light per pixel).
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import EmptySceneError
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.numerics import safe_normalize
from torchradiometry.render.direct import direct_irradiance
from torchradiometry.render.indirect import Indirect, indirect_at, indirect_light
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World, prepare
from torchradiometry.scene.scene import Scene

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Picture", "SurfacePoints", "render_scene", "see"]

#: camera rays that are shaded at a time
BLOCK = 2**16


class Picture(NamedTuple):
    """What the camera recorded, and how.

    Attributes:
        radiance: linear, W/m2/sr.
        emitter: pixels in which some ray meets an emitting face (left out of error measures).
        seconds: wall time of each stage.
        patches: how many radiosity patches were solved.
        indirect_bound: largest possible error of the indirect irradiance by bounces that were
            left out, W/m2 (0 without interreflection).
        closed: the scene was found to be closed and its form factors were closed too.
        rays: which ray caster answered, and why.
    """

    radiance: Float[Tensor, "height width channel"]
    emitter: Bool[Tensor, "height width"]
    seconds: dict[str, float]
    patches: int
    indirect_bound: float
    closed: bool
    rays: str


class SurfacePoints(NamedTuple):
    """Where camera rays end.

    Attributes:
        triangle: -1 where nothing was met.
        face: the one-sided face that was met, -1 for nothing and for black backs.
        barycentric: in the triangle.
        position: m.
        normal: shading normal on the side of the camera.
        facet: geometric normal on that side.
    """

    triangle: Int[Tensor, "ray"]
    face: Int[Tensor, "ray"]
    barycentric: Float[Tensor, "ray 3"]
    position: Float[Tensor, "ray 3"]
    normal: Float[Tensor, "ray 3"]
    facet: Float[Tensor, "ray 3"]


def render_scene(
    scene: Scene, camera: AbstractCamera, settings: RenderSettings | None = None
) -> Picture:
    """The picture of a scene.

    Args:
        scene: surfaces and sources; its own cameras are not looked at.
        camera: who looks.
        settings: see `RenderSettings`.

    Raises:
        EmptySceneError: no triangle.
        ResourceLimitError: more patches than the budget allows.

    Differentiable in: albedo, emission, textures and the sources' parameters (positions of
        vertices only through the light on unshadowed points; visibility is detached).
    Export: no.
    """
    settings = settings or RenderSettings()
    clock = [time.perf_counter()]
    world = prepare(scene, settings)
    clock.append(time.perf_counter())
    indirect = indirect_light(world, settings) if settings.bounces > 0 else None
    clock.append(time.perf_counter())
    radiance, emitter = _shade_pixels(world, camera, settings, indirect)
    clock.append(time.perf_counter())
    names = ("prepare", "indirect", "shade")
    seconds = {n: b - a for n, a, b in zip(names, clock[:-1], clock[1:], strict=True)}
    bound = float(indirect.solution.bound.detach().max()) if indirect else 0.0
    return Picture(
        radiance.to(scene.surfaces[0].albedo.dtype),
        emitter,
        seconds | {"total": clock[-1] - clock[0]},
        indirect.patches.count if indirect else 0,
        bound,
        bool(indirect and indirect.exposure.closed),
        world.reason,
    )


def _shade_pixels(
    world: World, camera: AbstractCamera, settings: RenderSettings, indirect: Indirect | None
) -> tuple[Float[Tensor, "height width channel"], Bool[Tensor, "height width"]]:
    generator = torch.Generator().manual_seed(settings.seed)
    pixels = _strata(camera, settings.supersampling, generator)
    rays = pixels.shape[1]
    rows = max(1, BLOCK // rays)
    parts = [
        _shade_block(world, camera, settings, indirect, block, generator)
        for block in pixels.split(rows)
    ]
    radiance, emitter = (torch.cat(column) for column in zip(*parts, strict=True))
    size = (camera.height, camera.width)
    return radiance.reshape(*size, -1), emitter.reshape(size)


def _strata(
    camera: AbstractCamera, side: int, generator: torch.Generator
) -> Float[Tensor, "pixel ray 2"]:
    """One random place in each of side x side parts of every pixel."""
    centre = camera.pixel_grid().to(torch.float64).reshape(-1, 1, 2)
    step = torch.arange(side, dtype=torch.float64)
    corner = torch.cartesian_prod(step, step).reshape(-1, 2).to(centre)
    inside = torch.rand(len(centre), len(corner), 2, generator=generator, dtype=torch.float64)
    if side == 1:
        inside = torch.full_like(inside, 0.5)
    return centre - 0.5 + (corner + inside.to(centre)) / side


def _shade_block(
    world: World,
    camera: AbstractCamera,
    settings: RenderSettings,
    indirect: Indirect | None,
    pixels: Float[Tensor, "pixel ray 2"],
    generator: torch.Generator,
) -> tuple[Float[Tensor, "pixel channel"], Bool[Tensor, "pixel"]]:
    """Mean radiance of some pixels, and whether they see an emitter."""
    origin, direction = camera.rays(pixels.reshape(-1, 2))
    points = see(world, origin, direction)
    lit = torch.nonzero(points.face >= 0).squeeze(-1)
    seen = SurfacePoints(*(t[lit] for t in points))
    where = (seen.position, seen.normal, seen.facet)
    irradiance = direct_irradiance(world, settings, *where, generator)
    if indirect is not None:
        irradiance = irradiance + indirect_at(indirect, seen.face, _on_face(world, seen))
    albedo = world.scene.albedo_at(seen.triangle, seen.barycentric.to(points.barycentric))
    emitted = world.triangles.emission[seen.triangle]
    radiance = emitted + albedo.to(irradiance) * irradiance / math.pi
    shape = pixels.shape[:2]
    full = radiance.new_zeros(len(points.face), radiance.shape[-1]).index_copy(0, lit, radiance)
    bright = torch.zeros_like(points.face, dtype=torch.bool)
    bright[lit] = (emitted.detach() > 0).any(-1)
    return full.reshape(*shape, -1).mean(1), bright.reshape(shape).any(1)


def see(
    world: World, origin: Float[Tensor, "ray 3"], direction: Float[Tensor, "ray 3"]
) -> SurfacePoints:
    """The surface points that rays meet first."""
    hits = world.rays.closest(origin, direction)
    triangle = hits.triangle.clamp(min=0)
    position = origin + torch.where(hits.found, hits.distance, 0).unsqueeze(-1) * direction
    facet = world.normal[triangle]
    front = (facet * direction).sum(-1) < 0
    face = torch.where(front, triangle, world.faces.back[triangle])
    side = torch.where(front, 1.0, -1.0).to(facet).unsqueeze(-1)
    corner = world.triangles.normals[triangle]
    normal = safe_normalize((corner * hits.barycentric.unsqueeze(-1)).sum(1))
    # shading normals that look into their own face (creases, careless files) give way to it
    normal = torch.where((normal * facet).sum(-1, keepdim=True) > 0, normal, facet)
    return SurfacePoints(
        hits.triangle,
        torch.where(hits.found, face, -1),
        hits.barycentric,
        position,
        normal * side,
        facet * side,
    )


def _on_face(world: World, points: SurfacePoints) -> Float[Tensor, "ray 3"]:
    """Barycentric weights on the face: a back runs through its corners the other way round."""
    back = (points.face >= len(world.triangles.surface)).unsqueeze(-1)
    return torch.where(back, points.barycentric.flip(-1), points.barycentric)


def require_something(scene: Scene) -> None:
    """Raise `EmptySceneError` where a scene has no triangle."""
    if not any(surface.count for surface in scene.surfaces):
        raise EmptySceneError("scene", "no triangles", "add a surface with faces")
