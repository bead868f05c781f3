"""What a camera records: the mean radiance over every pixel.

    L(pixel) = mean over its rays of  [ L_emitted + rho/pi (E_direct + E_indirect) + L_lobe ]

Direct light is evaluated at the point that each ray meets (exact polygons times shadow rays,
`direct`), indirect light is interpolated from radiosity patches (`indirect`), and shiny surfaces
are looked at along their lobes (`lobes`). The background and the backs of one-sided faces are
black.

Nearly all of the work is geometry: what rays meet, which part of the emitters they see, form
factors. A `View` holds it, and `develop` makes a picture of it for any albedo and emission, and
its gradient, in a few milliseconds.

References: M. Cohen and J. Wallace, *Radiosity and Realistic Image Synthesis* (1993), ch. 9
and 10 (multi-pass rendering with direct light per pixel).
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import ResourceLimitError, ShapeError, require_kind
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.render.adaptive import adaptive_exchange
from torchradiometry.render.ambient import (
    AmbientExchange,
    ambient_exchange,
    ambient_irradiance,
)
from torchradiometry.render.gather import gather_weights
from torchradiometry.render.importance import Visits
from torchradiometry.render.indirect import Exchange, Indirect, indirect_at, solve_exchange
from torchradiometry.render.lobes import Lobes, lobe_light, look_along_lobes
from torchradiometry.render.pixels import Samples, camera_samples, pixel_means
from torchradiometry.render.points import SurfacePoints, see
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World, prepare
from torchradiometry.scene.scene import Scene, Triangles

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = [
    "Picture",
    "SurfacePoints",
    "View",
    "develop",
    "indirect_light",
    "render_scene",
    "see",
    "view_scene",
]

#: that the rays of a pixel take at least
BYTES = 128


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
        indirect: radiosity of each patch and irradiance on vertices; None without bounces.
    """

    radiance: Float[Tensor, "height width channel"]
    emitter: Bool[Tensor, "height width"]
    seconds: dict[str, float]
    patches: int
    indirect_bound: float
    closed: bool
    rays: str
    indirect: Indirect | None


class View(NamedTuple):
    """All that a picture takes from geometry.

    Attributes:
        world: the scene it was made of.
        size: height and width, pixels.
        settings: how it was made.
        samples: what camera rays meet, and the direct light there.
        exchange: patches and form factors; None without bounces.
        ambient: what stands in for reflected light; None if that is solved for, or left out.
        gathered: share of each patch's radiosity that arrives at each ray; None if reflected
            light is interpolated.
        lobes: what shiny surfaces show; None if there are none, or they are left out.
        seconds: wall time of each stage.
    """

    world: World
    size: tuple[int, int]
    settings: RenderSettings
    samples: Samples
    exchange: Exchange | None
    ambient: AmbientExchange | None
    gathered: Float[Tensor, "ray patch"] | None
    lobes: Lobes | None
    seconds: dict[str, float]


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
        DTypeError: no scene, or no camera (a tuple of cameras).
        ResourceLimitError: more patches than the budget allows.

    Differentiable in: albedo, emission, textures, the sources' parameters, and vertices as far as
        direct light goes: shadows of emitting faces move with them where they are clipped (behind
        few faces), those found by rays and the outlines that the camera sees do not.
    Export: no.
    """
    return develop(view_scene(scene, camera, settings), scene)


def view_scene(
    scene: Scene, camera: AbstractCamera, settings: RenderSettings | None = None
) -> View:
    """What a camera sees of a scene, and what its patches see of each other.

    Arguments, errors and derivatives as of `render_scene`.
    """
    require_kind("camera", camera, AbstractCamera, "camera, such as scene.cameras[0]")
    settings = settings or RenderSettings()
    pixels = camera.width * camera.height
    if BYTES * pixels > settings.budget:
        got, mend = f"{pixels} pixels, {BYTES * pixels} bytes", "use fewer, or raise budget"
        raise ResourceLimitError("camera", got, mend)
    clock = [time.perf_counter()]
    world = prepare(scene, settings)
    clock.append(time.perf_counter())
    samples = camera_samples(world, camera, settings)
    clock.append(time.perf_counter())
    lobes = look_along_lobes(world, settings, samples.points, samples.pixel, samples.share)
    clock.append(time.perf_counter())
    exchange = None
    if settings.bounces > 0:
        exchange = adaptive_exchange(world, settings, Visits(samples.points, samples.share))
    ambient = None
    if settings.ambient and settings.bounces == 0:
        ambient = ambient_exchange(world, settings)
    gathered = _gather(world, exchange, samples, settings)
    clock.append(time.perf_counter())
    names = ("prepare", "direct", "lobes", "indirect")
    seconds = {n: b - a for n, a, b in zip(names, clock[:-1], clock[1:], strict=True)}
    size = (camera.height, camera.width)
    return View(world, size, settings, samples, exchange, ambient, gathered, lobes, seconds)


def _gather(
    world: World, exchange: Exchange | None, samples: Samples, settings: RenderSettings
) -> Float[Tensor, "ray patch"] | None:
    if exchange is None or not settings.gather:
        return None
    needed = 8 * len(samples.pixel) * exchange.patches.count
    if needed > settings.budget:
        got = f"{len(samples.pixel)} rays and {exchange.patches.count} patches, {needed} bytes"
        raise ResourceLimitError("gather", got, "interpolate, use larger patches, or raise budget")
    where = samples.points.receivers
    return gather_weights(world, exchange.patches, exchange.exposure, where)


def develop(view: View, scene: Scene) -> Picture:
    """The picture of a view.

    Args:
        view: see `view_scene`.
        scene: the view's own, or the same with other albedos, textures, specular shares (of
            surfaces that were shiny when the view was made) and radiances (of those that shone).
            Its sources are not looked at.

    Raises:
        ShapeError: another number of triangles.

    Differentiable in: albedo, specular, emission and textures; a view of learnable sources
        serves one backward pass.
    Export: no.
    """
    began = time.perf_counter()
    triangles = scene.triangles
    if len(triangles.surface) != len(view.world.triangles.surface):
        raise ShapeError(
            "scene",
            f"{len(triangles.surface)} triangles, the view has {len(view.world.triangles.surface)}",
            "pass the scene of the view with other colours, or make a new view",
        )
    indirect = None
    if view.exchange is not None:
        indirect = solve_exchange(view.world, view.exchange, triangles, view.settings)
    radiance, emitter = _shade(view, scene, triangles, indirect)
    seconds = view.seconds | {"shade": time.perf_counter() - began}
    return Picture(
        radiance.to(scene.surfaces[0].albedo.dtype),
        emitter,
        seconds | {"total": sum(seconds.values())},
        indirect.exchange.patches.count if indirect else 0,
        float(indirect.solution.bound.detach().max()) if indirect else 0.0,
        bool(indirect and indirect.exchange.exposure.closed),
        view.world.reason,
        indirect,
    )


def indirect_light(world: World, settings: RenderSettings) -> Indirect:
    """Patches, form factors and the solved reflected light of a prepared scene.

    Raises:
        ResourceLimitError: too many patches for the budget.
    """
    return solve_exchange(world, adaptive_exchange(world, settings), world.triangles, settings)


def _shade(
    view: View, scene: Scene, triangles: Triangles, indirect: Indirect | None
) -> tuple[Float[Tensor, "height width channel"], Bool[Tensor, "height width"]]:
    """Mean radiance of the pixels, and whether they see an emitter."""
    points, pixel, glow = view.samples.points, view.samples.pixel, view.world.glow(triangles)
    direct = view.samples.lamps + view.samples.weights @ glow
    if indirect is not None and view.gathered is not None:
        irradiance = direct + view.gathered @ indirect.solution.radiosity
    else:
        irradiance = direct + _reflected(view, triangles, indirect, points)
    albedo = scene.albedo_at(points.triangle, points.barycentric).to(irradiance)
    emitted = triangles.emission[points.triangle].to(irradiance)
    radiance = emitted + albedo * irradiance / math.pi
    if view.lobes is not None:
        shown = view.lobes
        shiny = points.triangle[shown.point]
        light = lobe_light(shown, glow, _in_lobes(view, scene, triangles, indirect, shown))
        light = triangles.specular[shiny].to(light) * light
        radiance = radiance.index_add(0, shown.point, light)
    height, width = view.size
    full = pixel_means(radiance, view.samples.share, pixel, view.size)
    bright = torch.zeros_like(full[..., 0], dtype=torch.bool).reshape(-1)
    bright[pixel[(emitted.detach() > 0).any(-1)]] = True
    return full, bright.reshape(height, width)


def _reflected(
    view: View, triangles: Triangles, indirect: Indirect | None, points: SurfacePoints
) -> Tensor:
    """E by other surfaces, interpolated or ambient, W/m2."""
    if indirect is not None:
        return indirect_at(indirect, points.face, points.on_face(view.world))
    if view.ambient is not None:
        return ambient_irradiance(view.world, view.ambient, triangles)
    return points.position.new_zeros(())


def _in_lobes(
    view: View, scene: Scene, triangles: Triangles, indirect: Indirect | None, lobes: Lobes
) -> Float[Tensor, "seen channel"]:
    """Radiance of the surfaces seen in lobes, without what they emit; their own lobes are even."""
    points = lobes.seen
    irradiance = lobes.seen_lamps + lobes.seen_weights @ view.world.glow(triangles)
    irradiance = irradiance + _reflected(view, triangles, indirect, points)
    albedo = scene.albedo_at(points.triangle, points.barycentric).to(irradiance)
    lobe = (triangles.reflectance - triangles.albedo)[points.triangle].to(irradiance)
    return (albedo + lobe) * irradiance / math.pi
