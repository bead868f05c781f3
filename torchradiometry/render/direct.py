"""Direct light at points: exact polygons times the share that shadow rays find.

    E(x) = sum over emitters  L W(x),   W = sum over the emitter's polygons  E_polygon(x) V
         + sum over lamps     E_facing max(0, n . wi) v
    V    = sum w_k v_k / sum w_k

E_polygon is Lambert's contour integral for unit radiance, without noise. Behind a few convex
blockers its visible part is found by clipping, without noise too (`visible_parts`). Otherwise V
is the visible part: free shadow rays v_k to points spread evenly over the polygon, each with its
share w = cos cos / r^2 of the irradiance. Fully lit and fully dark points therefore have no
noise at all; points whose first rays disagree get four times as many. W is geometry alone: one W
serves every radiance.

References: J. Arvo, SIGGRAPH 1994; E. Heitz, S. Hill and M. McGuire, "Combining Analytic
Direct Illumination and Stochastic Shadows", I3D 2018 (the ratio of the two).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.geometry.directions import local_frame
from torchradiometry.geometry.patches import Patches, vector_area
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.numerics import guarded_divide, safe_normalize
from torchradiometry.render.points import Receivers
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World
from torchradiometry.sources.base import AbstractSource, Arrival, irradiance
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import sample_patches, sequence
from torchradiometry.transport.visible_parts import visible_irradiance

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = [
    "direct_irradiance",
    "emitter_weights",
    "lamp_arrivals",
    "lamp_irradiance",
    "sky_visibility",
]

#: pairs of a point and an emitting polygon that are integrated at a time
BLOCK = 2**15
#: rounding of a polygon's irradiance: a picture does not show the digits of a second look
ROUNDING = 2.0**-34


def direct_irradiance(
    world: World, settings: RenderSettings, points: Receivers, generator: torch.Generator
) -> Float[Tensor, "point channel"]:
    """E of emitting faces and lamps on surface points, W/m2.

    Args:
        world: a prepared scene.
        settings: how many shadow rays.
        points: on surfaces of the world.
        generator: of the random shifts.
    """
    lamps = lamp_irradiance(world, settings, points, generator)
    return lamps + emitter_weights(world, settings, points, generator) @ world.glow(world.triangles)


def emitter_weights(
    world: World,
    settings: RenderSettings,
    points: Receivers,
    generator: torch.Generator,
    unblocked: Float[Tensor, "point polygon"] | None = None,
) -> Float[Tensor, "point emitter"]:
    """W: irradiance of each emitting surface for unit radiance, W/m2 per W/m2/sr.

    Arguments as of `direct_irradiance`.

    Args:
        unblocked: irradiance of each polygon for unit radiance with nothing in between, where it
            is known; not asked for where penumbras are clipped.
    """
    emitters = world.emitters
    if len(emitters.corners) == 0:
        return points.position.new_zeros(len(points.position), 0)
    step, blocks = max(1, BLOCK // len(emitters.corners)), []
    for number, part in enumerate(points.split(step)):
        pairs = (part.position.unsqueeze(1), part.normal.unsqueeze(1), emitters.corners)
        exact = settings.shadow_samples > 0 and settings.penumbra and settings.extent
        if exact and world.blockers is not None:
            seen = visible_irradiance(
                *pairs, world.blockers, margin=world.rays.tolerance, rounding=ROUNDING
            )
        else:
            if unblocked is not None:
                seen = unblocked[number * step : (number + 1) * step]
            else:
                seen = unblocked_irradiance(*pairs, settings.extent)
            seen = seen * _visible_share(world, settings, seen, part, generator)
        blocks.append(seen @ emitters.member)
    return torch.cat(blocks)


def unblocked_irradiance(
    position: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    polygon: Float[Tensor, "*batch corner 3"],
    extent: bool,
    rounding: float = ROUNDING,
) -> Float[Tensor, "*batch"]:
    """Irradiance of a polygon of unit radiance with nothing in between, W/m2.

    Args:
        position, normal, polygon, rounding: as of `polygon_irradiance`.
        extent: whether the polygon shines from all of its area.
    """
    if not extent:
        return small_source_irradiance(position, normal, polygon)
    return polygon_irradiance(position, normal, polygon, rounding=rounding)


def small_source_irradiance(
    position: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    polygon: Float[Tensor, "*batch corner 3"],
) -> Float[Tensor, "*batch"]:
    """A cos cos / r^2 to the middle of a polygon of unit radiance; arguments as of the exact one.

    It is what `polygon_irradiance` tends to far away, and off by about (size / r)^2.
    """
    middle, area = Patches(polygon).centroid, vector_area(polygon)
    ray = middle - position
    square = (ray * ray).sum(-1)
    here, there = (ray * normal).sum(-1).clamp(min=0), (-ray * area).sum(-1).clamp(min=0)
    return guarded_divide(here * there, square * square)


@torch.no_grad()
def _visible_share(
    world: World,
    settings: RenderSettings,
    unblocked: Tensor,
    points: Receivers,
    generator: torch.Generator,
) -> Float[Tensor, "point polygon"]:
    """V of every pair of a point and an emitting polygon."""
    share = torch.ones_like(unblocked)
    samples = settings.shadow_samples
    point, polygon = torch.nonzero(unblocked > 0, as_tuple=True)
    if samples == 0 or len(point) == 0:
        return share
    if not (settings.penumbra and settings.extent):
        near, far = points.take(point), world.emitters.corners[polygon]
        target = world.rays.lift(Patches(far).centroid, Patches(far).normal)
        free = world.rays.visible(world.rays.lift(near.position, near.facet), target)
        return share.index_put((point, polygon), free.to(share))
    shift = torch.rand(len(point), 2, generator=generator, dtype=torch.float64).to(unblocked)
    where = sequence(4 * samples, 2, unblocked)

    def lit(pairs: Int[Tensor, "pair"], samples: Tensor) -> Tensor:
        near, far = points.take(point[pairs]), world.emitters.corners[polygon[pairs]]
        spots = sample_patches(far.unsqueeze(1), (samples + shift[pairs].unsqueeze(1)).frac())
        return _weighted(world.rays, near, far, spots)

    sums = lit(torch.arange(len(point), device=point.device), where[:samples])
    mixed = torch.nonzero((sums[0] > 0) & (sums[0] < sums[1])).squeeze(-1)
    free, total = sums.index_add(1, mixed, lit(mixed, where[samples:]))
    return share.index_put((point, polygon), torch.where(total > 0, guarded_divide(free, total), 1))


def _weighted(
    rays: AbstractRayCaster,
    points: Receivers,
    polygon: Float[Tensor, "pair corner 3"],
    spots: Float[Tensor, "pair sample 3"],
) -> Float[Tensor, "2 pair"]:
    """Sum of cos cos / r^2 over the free samples, and over all."""
    front = safe_normalize(
        torch.linalg.cross(polygon[:, 1] - polygon[:, 0], polygon[:, 2] - polygon[:, 0])
    ).unsqueeze(1)
    start = rays.lift(points.position, points.facet).unsqueeze(1)
    ray = spots - start
    square = (ray * ray).sum(-1)
    cosine = (ray * points.normal.unsqueeze(1)).sum(-1).clamp(min=0)
    weight = guarded_divide(cosine * (-ray * front).sum(-1).clamp(min=0), square * square)
    free = rays.visible(start, rays.lift(spots, front))
    return torch.stack(((weight * free).sum(-1), weight.sum(-1)))


def lamp_irradiance(
    world: World, settings: RenderSettings, points: Receivers, generator: torch.Generator
) -> Float[Tensor, "point channel"]:
    """E of the scene's sources, one shadow ray to each light, W/m2.

    Arguments as of `direct_irradiance`.
    """
    total = points.position.new_zeros(len(points.position), world.scene.channels)
    sources = world.scene.sources
    for arrival, seen in lamp_arrivals(world, settings, sources, points, generator):
        total = total + irradiance(arrival, points.normal, seen)
    return total


def lamp_arrivals(
    world: World,
    settings: RenderSettings,
    sources: Iterable[AbstractSource],
    points: Receivers,
    generator: torch.Generator,
) -> Iterator[tuple[Arrival, Float[Tensor, "light point"]]]:
    """What arrives from each source, and which share of it is not blocked.

    Other arguments as of `direct_irradiance`.
    """
    sky = None
    middle = Receivers(world.middle.unsqueeze(0), points.normal[:1], points.facet[:1])
    for source in sources:
        if settings.near or not source.has_direction:
            arrival = _arrival(source, points)
        else:
            arrival = _distant(_arrival(source, middle))
        if source.has_direction:
            seen = _lamp_visibility(world.rays, settings, arrival, points)
        else:
            if sky is None:
                sky = sky_visibility(world, settings, points, generator)
            seen = sky.expand(arrival.distance.shape)
        yield arrival, seen


def _arrival(source: AbstractSource, points: Receivers) -> Arrival:
    """In float64, also where the source's own parameters are float32."""
    found = source(points.position if source.needs_position else None, points.normal)
    return Arrival(*(t.to(points.position) for t in found))


def _distant(arrival: Arrival) -> Arrival:
    """The same light from infinitely far away."""
    return arrival._replace(distance=torch.full_like(arrival.distance, torch.inf))


@torch.no_grad()
def _lamp_visibility(
    rays: AbstractRayCaster, settings: RenderSettings, arrival: Arrival, points: Receivers
) -> Float[Tensor, "light point"]:
    if settings.shadow_samples == 0:
        return torch.ones_like(arrival.distance)
    distance = arrival.distance.unsqueeze(-1)
    near = torch.isfinite(distance)
    target = torch.where(
        near,
        points.position + torch.where(near, distance, 0) * arrival.direction,
        rays.beyond(points.position, arrival.direction),
    )
    return rays.visible(rays.lift(points.position, points.facet), target).to(points.position)


@torch.no_grad()
def sky_visibility(
    world: World, settings: RenderSettings, points: Receivers, generator: torch.Generator
) -> Float[Tensor, "point"]:
    """Cosine-weighted share of the hemisphere that no triangle covers, 0..1.

    Arguments as of `direct_irradiance`.
    """
    position = points.position
    if settings.shadow_samples == 0:
        return torch.ones_like(position[:, 0])
    where = sequence(settings.sky_samples, 2, position)
    shift = torch.rand(len(position), 1, 2, generator=generator, dtype=torch.float64)
    direction = cosine_directions((where + shift.to(position)).frac(), points.normal)
    start = world.rays.lift(position, points.facet).unsqueeze(1)
    return world.rays.visible(start, world.rays.beyond(start, direction)).to(position).mean(-1)


def cosine_directions(
    where: Float[Tensor, "point sample 2"], normal: Float[Tensor, "point 3"]
) -> Float[Tensor, "point sample 3"]:
    """Directions about the normals, spread with density cos / pi (Malley's method)."""
    radius, angle = where[..., 0].sqrt(), 2 * torch.pi * where[..., 1]
    tangent, bitangent = (axis.unsqueeze(1) for axis in local_frame(normal))
    x, y = radius * torch.cos(angle), radius * torch.sin(angle)
    z = (1 - where[..., 0]).clamp(min=0).sqrt()
    up = normal.unsqueeze(1)
    return x.unsqueeze(-1) * tangent + y.unsqueeze(-1) * bitangent + z.unsqueeze(-1) * up
