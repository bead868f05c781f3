"""Direct light at points: exact polygons times the share that shadow rays find.

    E(x) = sum over emitting triangles  L E_polygon(x) V,   V = sum w_k v_k / sum w_k
         + sum over lamps  E_facing max(0, n . wi) v

E_polygon is Lambert's contour integral, without noise. V is the visible part of it: free
shadow rays v_k to points spread evenly over the triangle, each with its share
w = cos cos / r^2 of the irradiance. Fully lit and fully dark points therefore have no noise at
all; points whose first rays disagree get four times as many.

References: J. Arvo, SIGGRAPH 1994; E. Heitz, S. Hill and M. McGuire, "Combining Analytic
Direct Illumination and Stochastic Shadows", I3D 2018 (the ratio of the two).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.geometry.directions import local_frame
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.numerics import guarded_divide
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World
from torchradiometry.sources.base import AbstractSource, Arrival, irradiance
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import sample_patches, sequence

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["direct_irradiance", "emitter_irradiance", "lamp_irradiance", "sky_visibility"]

#: pairs of a point and an emitting face that are integrated at a time
BLOCK = 2**15


def direct_irradiance(
    world: World,
    settings: RenderSettings,
    position: Float[Tensor, "point 3"],
    normal: Float[Tensor, "point 3"],
    facet: Float[Tensor, "point 3"],
    generator: torch.Generator,
) -> Float[Tensor, "point channel"]:
    """E of emitting faces and lamps on surface points, W/m2.

    Args:
        position: on surfaces of the world, m.
        normal: shading normal, unit.
        facet: geometric normal of the same side, unit; shadow rays start on its side.
        generator: of the random shifts.
    """
    lamps = lamp_irradiance(world, settings, position, normal, facet, generator)
    return lamps + emitter_irradiance(world, settings, position, normal, facet, generator)


def emitter_irradiance(
    world: World,
    settings: RenderSettings,
    position: Float[Tensor, "point 3"],
    normal: Float[Tensor, "point 3"],
    facet: Float[Tensor, "point 3"],
    generator: torch.Generator,
) -> Float[Tensor, "point channel"]:
    """E of the emitting faces, W/m2; arguments as of `direct_irradiance`."""
    chosen = torch.nonzero(world.emitting).squeeze(-1)
    radiance = world.triangles.emission[world.faces.triangle[chosen]]
    if len(chosen) == 0:
        return torch.zeros_like(position[:, :1]).expand(-1, radiance.shape[-1])
    polygons = world.faces.corners[chosen]
    rows = max(1, BLOCK // len(chosen))
    blocks = []
    for x, n, g in zip(position.split(rows), normal.split(rows), facet.split(rows), strict=True):
        unblocked = polygon_irradiance(x.unsqueeze(1), n.unsqueeze(1), polygons)
        share = _visible_share(world.rays, settings, unblocked, x, n, g, polygons, generator)
        blocks.append((unblocked * share) @ radiance)
    return torch.cat(blocks)


@torch.no_grad()
def _visible_share(
    rays: AbstractRayCaster,
    settings: RenderSettings,
    unblocked: Tensor,
    position: Tensor,
    normal: Tensor,
    facet: Tensor,
    polygons: Tensor,
    generator: torch.Generator,
) -> Float[Tensor, "point face"]:
    """V of every pair of a point and an emitting face."""
    share = torch.ones_like(unblocked)
    samples = settings.shadow_samples
    point, face = torch.nonzero(unblocked > 0, as_tuple=True)
    if samples == 0 or len(point) == 0:
        return share
    shift = torch.rand(len(point), 2, generator=generator, dtype=torch.float64).to(position)
    where = sequence(4 * samples, 2, position)
    ends = (rays.lift(position, facet)[point], normal[point], polygons[face])
    lit, total = _weighted(rays, *ends, where[:samples], shift)
    mixed = torch.nonzero((lit > 0) & (lit < total)).squeeze(-1)
    start, face_normal, polygon = (e[mixed] for e in ends)
    more = _weighted(rays, start, face_normal, polygon, where[samples:], shift[mixed])
    lit, total = lit.index_add(0, mixed, more[0]), total.index_add(0, mixed, more[1])
    found = torch.where(total > 0, guarded_divide(lit, total), 1)
    return share.index_put((point, face), found)


def _weighted(
    rays: AbstractRayCaster,
    start: Tensor,
    normal: Tensor,
    polygon: Tensor,
    where: Tensor,
    shift: Tensor,
) -> tuple[Tensor, Tensor]:
    """Sum of cos cos / r^2 over the free samples, and over all."""
    front = torch.nn.functional.normalize(
        torch.linalg.cross(polygon[:, 1] - polygon[:, 0], polygon[:, 2] - polygon[:, 0]), dim=-1
    ).unsqueeze(1)
    end = sample_patches(polygon.unsqueeze(1), (where + shift.unsqueeze(1)).frac())
    start = start.unsqueeze(1)
    ray = end - start
    square = (ray * ray).sum(-1)
    cosines = (ray * normal.unsqueeze(1)).sum(-1).clamp(min=0) * (-ray * front).sum(-1).clamp(min=0)
    weight = guarded_divide(cosines, square * square)
    free = rays.visible(start, rays.lift(end, front))
    return (weight * free).sum(-1), weight.sum(-1)


def lamp_irradiance(
    world: World,
    settings: RenderSettings,
    position: Float[Tensor, "point 3"],
    normal: Float[Tensor, "point 3"],
    facet: Float[Tensor, "point 3"],
    generator: torch.Generator,
) -> Float[Tensor, "point channel"]:
    """E of the scene's sources, one shadow ray to each light, W/m2."""
    total = position.new_zeros(len(position), world.scene.channels)
    sky = None
    for source in world.scene.sources:
        arrival = _arrival(source, position, normal)
        if source.has_direction:
            seen = _lamp_visibility(world.rays, settings, arrival, position, facet)
        else:
            if sky is None:
                sky = sky_visibility(world.rays, settings, position, normal, facet, generator)
            seen = sky.expand(arrival.distance.shape)
        total = total + irradiance(arrival, normal, seen)
    return total


def _arrival(source: AbstractSource, position: Tensor, normal: Tensor) -> Arrival:
    """In float64, also where the source's own parameters are float32."""
    found = source(position if source.needs_position else None, normal)
    return Arrival(*(t.to(position) for t in found))


@torch.no_grad()
def _lamp_visibility(
    rays: AbstractRayCaster,
    settings: RenderSettings,
    arrival: Arrival,
    position: Tensor,
    facet: Tensor,
) -> Float[Tensor, "light point"]:
    if settings.shadow_samples == 0:
        return torch.ones_like(arrival.distance)
    distance = arrival.distance.unsqueeze(-1)
    near = torch.isfinite(distance)
    start = rays.lift(position, facet)
    target = torch.where(
        near,
        position + torch.where(near, distance, 0) * arrival.direction,
        rays.beyond(position, arrival.direction),
    )
    return rays.visible(start, target).to(position)


@torch.no_grad()
def sky_visibility(
    rays: AbstractRayCaster,
    settings: RenderSettings,
    position: Float[Tensor, "point 3"],
    normal: Float[Tensor, "point 3"],
    facet: Float[Tensor, "point 3"],
    generator: torch.Generator,
) -> Float[Tensor, "point"]:
    """Cosine-weighted share of the hemisphere that no triangle covers, 0..1."""
    if settings.shadow_samples == 0:
        return torch.ones_like(position[:, 0])
    count = settings.sky_samples
    shift = torch.rand(len(position), 1, 2, generator=generator, dtype=torch.float64)
    direction = cosine_directions(
        (sequence(count, 2, position) + shift.to(position)).frac(), normal
    )
    start = rays.lift(position, facet).unsqueeze(1)
    target = rays.beyond(start, direction)
    return rays.visible(start, target).to(position).mean(-1)


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
