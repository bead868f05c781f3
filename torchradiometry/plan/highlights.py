"""A quick look at what shiny surfaces show: lamps, and other surfaces, in a few rays each."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.plan.reflections import Reflections
from torchradiometry.render.lobes import Lobes, lobe_light, look_along_lobes
from torchradiometry.render.points import SurfacePoints
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["FEW", "Highlights", "look_at_highlights", "shown_by_looks"]

#: rays in a lobe of a pilot point, and few of them to tell their noise
RAYS, FEW = 32, 4


class Highlights(NamedTuple):
    """Light of the points that a pilot looks at, by their lobes.

    Attributes:
        radiance: W/m2/sr.
        noisy: the same by `FEW` rays.
        even: the part of it that the lobes of other surfaces sent, taken to be spread evenly.
        shiny: share of the points that have a lobe.
    """

    radiance: Float[Tensor, "point channel"]
    noisy: Float[Tensor, "point channel"]
    even: Float[Tensor, "point channel"]
    shiny: float


@torch.no_grad()
def look_at_highlights(
    world: World, settings: RenderSettings, points: SurfacePoints, reflections: Reflections
) -> Highlights:
    """What the pilot's points show in their lobes; settings as of direct light."""
    pixel = torch.arange(len(points.face), device=points.face.device)
    radiance, even = _shown(world, settings, points, pixel, reflections, RAYS)
    noisy, _ = _shown(world, settings, points, pixel, reflections, FEW)
    shiny = (world.triangles.specular > 0).any(-1)[points.triangle]
    share = float(shiny.double().mean()) if len(pixel) else 0.0
    return Highlights(radiance, noisy, even, share)


@torch.no_grad()
def _shown(
    world: World,
    settings: RenderSettings,
    points: SurfacePoints,
    pixel: Int[Tensor, "point"],
    reflections: Reflections,
    rays: int = RAYS,
) -> tuple[Float[Tensor, "point channel"], Float[Tensor, "point channel"]]:
    """Radiance of points by their lobes, and what of it other lobes sent, W/m2/sr.

    Points of one pixel look along the same numbers if they are asked for in separate calls.
    """
    dark = points.position.new_zeros(len(points.face), world.scene.channels)
    one = torch.ones_like(points.position[:, 0])
    seen = look_along_lobes(world, replace(settings, lobe_samples=rays), points, pixel, one)
    if seen is None:
        return dark, dark
    triangles, glow = world.triangles, world.glow(world.triangles)
    received = seen.seen_lamps + seen.seen_weights @ glow + reflections.at(seen.seen)
    share = triangles.specular[points.triangle[seen.point]].double()

    def through(reflectance: Tensor, lobes: Lobes) -> Tensor:
        radiance = reflectance[seen.seen.triangle].double() * received / math.pi
        return dark.index_copy(0, seen.point, share * lobe_light(lobes, glow, radiance))

    alone = seen._replace(
        weights=torch.zeros_like(seen.weights), lamps=torch.zeros_like(seen.lamps)
    )
    return (
        through(triangles.reflectance, seen),
        through(triangles.reflectance - triangles.albedo, alone),
    )


def shown_by_looks(
    world: World,
    settings: RenderSettings,
    points: SurfacePoints,
    look: Int[Tensor, "point"],
    pixel: Int[Tensor, "point"],
    reflections: Reflections,
) -> Float[Tensor, "point channel"]:
    """Radiance by lobes, W/m2/sr; all looks of a pixel are along the same numbers.

    Args:
        world, settings, reflections: as of `look_at_highlights`.
        points: where the looks end, in the order of `look`.
        look: which of its pixel's looks it is.
        pixel: of each.
    """
    parts = []
    for number in range(int(look.max()) + 1 if len(look) else 0):
        some = torch.nonzero(look == number).squeeze(-1)
        parts.append(_shown(world, settings, points.take(some), pixel[some], reflections)[0])
    return torch.cat(parts) if parts else points.position.new_zeros(0, world.scene.channels)
