"""What shiny surfaces show: lamps, emitters and other surfaces in their lobes.

    L_s(x, wo) = k_s  int  l(wi) L(x, wi) cos(theta_i) dwi,    l = (n+2)/(2 pi) cos^n(alpha)

alpha is the angle from the mirror direction of wo (`NormalizedPhong`). A lamp is one direction of
the integral. Everything else is looked at along c directions drawn with density

    p = (n+1)/(2 pi) cos^n(alpha),   each stands for  l cos(theta_i) / p = (n+2)/(n+1) cos(theta_i),

and an emitter also through c points spread evenly on it, q = r^2/(A cos(theta')) by solid angle.
Both ways see the emitter; p/(p+q) of what the directions find counts and q/(p+q) of what the
points find, so that sharp lobes and small emitters are both without much noise (the balance
heuristic). What a lobe shows of other surfaces is their diffuse light; what lobes send to other
surfaces is spread evenly (`Triangles.reflectance`).

Geometry is done here; k_s, albedos and radiances may change afterwards.

References: B. T. Phong, CACM 18 (1975); E. P. Lafortune and Y. D. Willems, K.U. Leuven report CW
197 (1994), section 4 (drawing directions); E. Veach and L. Guibas, "Optimally Combining Sampling
Techniques for Monte Carlo Rendering", SIGGRAPH 1995 (balance heuristic).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.directions import local_frame, reflect
from torchradiometry.geometry.patches import Patches
from torchradiometry.materials.lobes import cosine_power, mirror_lobe
from torchradiometry.numerics import clamped_cosine, dot, guarded_divide, safe_normalize
from torchradiometry.render.direct import emitter_weights, lamp_arrivals, lamp_irradiance
from torchradiometry.render.points import SurfacePoints, see
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World
from torchradiometry.transport.rules import sample_patches, sequence

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["Lobes", "lobe_light", "look_along_lobes"]

#: directions that are followed at a time
BLOCK = 2**16


class Lobes(NamedTuple):
    """What some points show in their lobes, for k_s = 1.

    Attributes:
        point: which of the points that were asked for are shiny.
        weights: radiance for unit radiance of each emitter.
        lamps: radiance by lamps and sky, W/m2/sr.
        owner: the shiny point in whose lobe a surface is seen.
        share: how much of that surface's radiance it shows.
        seen: the surfaces' points.
        seen_weights, seen_lamps: direct light there, see `direct`.
    """

    point: Int[Tensor, "shiny"]
    weights: Float[Tensor, "shiny emitter"]
    lamps: Float[Tensor, "shiny channel"]
    owner: Int[Tensor, "seen"]
    share: Float[Tensor, "seen"]
    seen: SurfacePoints
    seen_weights: Float[Tensor, "seen emitter"]
    seen_lamps: Float[Tensor, "seen channel"]


def look_along_lobes(
    world: World,
    settings: RenderSettings,
    points: SurfacePoints,
    pixel: Int[Tensor, "ray"],
    share: Float[Tensor, "ray"],
) -> Lobes | None:
    """What shiny ones among the points show; None if none is, or lobes are left out.

    Args:
        world: a prepared scene.
        settings: how many directions a pixel gets.
        points: where camera rays end.
        pixel: of each ray.
        share: of its pixel that a ray stands for.

    Differentiable in: the sources' parameters.
    """
    shiny = torch.nonzero((world.triangles.specular > 0).any(-1)[points.triangle]).squeeze(-1)
    if settings.lobe_samples == 0 or len(shiny) == 0:
        return None
    generator = torch.Generator().manual_seed(settings.seed)
    where = points.take(shiny)
    count = (settings.lobe_samples * share[shiny]).ceil().long()
    first, shift = _numbered(pixel[shiny], count, generator)
    rows = max(1, BLOCK // int(count.max()))
    parts = []
    for block in torch.arange(len(shiny), device=shiny.device).split(rows):
        drawn = (t[block] for t in (count, first, shift))
        found = _look(world, settings, where.take(block), *drawn)
        parts.append(found._replace(owner=block[found.owner]))
    weights, sky, owner, carried, hits = zip(*parts, strict=True)
    seen = SurfacePoints(*(torch.cat(t) for t in zip(*hits, strict=True)))
    # many directions look at many points: one shadow ray each is enough
    once = replace(settings, shadow_samples=min(1, settings.shadow_samples))
    sampled = world._replace(blockers=None)
    return Lobes(
        shiny,
        torch.cat(weights),
        torch.cat(sky) + _highlights(world, settings, where, generator),
        torch.cat(owner),
        torch.cat(carried),
        seen,
        emitter_weights(sampled, once, seen.receivers, generator),
        lamp_irradiance(sampled, once, seen.receivers, generator),
    )


def lobe_light(
    lobes: Lobes,
    glow: Float[Tensor, "emitter channel"],
    radiance: Float[Tensor, "seen channel"],
) -> Float[Tensor, "shiny channel"]:
    """Radiance of the shiny points by their lobes for k_s = 1, W/m2/sr.

    Args:
        lobes: see `look_along_lobes`.
        glow: radiance of the emitters, W/m2/sr.
        radiance: of the surfaces that are seen in the lobes, without what they emit, W/m2/sr.

    Differentiable in: glow, radiance.
    """
    light = lobes.lamps + lobes.weights @ glow
    return light.index_add(0, lobes.owner, lobes.share.unsqueeze(-1) * radiance)


def _numbered(
    pixel: Int[Tensor, "shiny"], count: Int[Tensor, "shiny"], generator: torch.Generator
) -> tuple[Int[Tensor, "shiny"], Float[Tensor, "shiny 4"]]:
    """Numbers that run through all directions of a pixel: a point's first; the pixel's shifts."""
    order = torch.argsort(pixel, stable=True)
    _, group, rays = torch.unique_consecutive(pixel[order], return_inverse=True, return_counts=True)
    before = count[order].cumsum(0) - count[order]
    begun = before[rays.cumsum(0) - rays]
    first = torch.empty_like(count).index_copy(0, order, before - begun[group])
    shift = torch.rand(int(pixel.max()) + 1, 4, generator=generator, dtype=torch.float64)
    return first, shift.to(pixel.device)[pixel]


class _Rays(NamedTuple):
    """Looks from shiny points, along their lobes or at emitters.

    Attributes:
        owner: number of the point in its block.
        points: the point itself.
        axis: about which its lobe is even.
        exponent: n.
        each: share of one ray among those of its point.
    """

    owner: Int[Tensor, "ray"]
    points: SurfacePoints
    axis: Float[Tensor, "ray 3"]
    exponent: Float[Tensor, "ray"]
    each: Float[Tensor, "ray"]

    def take(self, index: Tensor) -> _Rays:
        """Some of them."""
        owner, axis, exponent, each = (t[index] for t in (self.owner, *self[2:]))
        return _Rays(owner, self.points.take(index), axis, exponent, each)

    def density(self, direction: Float[Tensor, "ray 3"]) -> Float[Tensor, "ray"]:
        """p, 1/sr."""
        power = cosine_power(direction, self.axis, self.exponent.unsqueeze(-1)).squeeze(-1)
        return (self.exponent + 1) / (2 * math.pi) * power

    def carried(self, direction: Float[Tensor, "ray 3"]) -> Float[Tensor, "ray"]:
        """l cos(theta_i) / p over the number of rays; 0 below the surface."""
        above = dot(direction, self.points.facet) > 0
        cosine = dot(direction, self.points.normal).clamp(min=0) * above
        return cosine * (self.exponent + 2) / (self.exponent + 1) * self.each


class _Shown(NamedTuple):
    """What a block shows; the attributes of `Lobes` that they become."""

    weights: Float[Tensor, "block emitter"]
    sky: Float[Tensor, "block channel"]
    owner: Int[Tensor, "seen"]
    share: Float[Tensor, "seen"]
    seen: SurfacePoints


@torch.no_grad()
def _look(
    world: World,
    settings: RenderSettings,
    points: SurfacePoints,
    count: Int[Tensor, "block"],
    first: Int[Tensor, "block"],
    shift: Float[Tensor, "block 4"],
) -> _Shown:
    """Look from a block of shiny points, `count` times from each."""
    owner = torch.arange(len(count), device=count.device).repeat_interleave(count)
    place = torch.arange(len(owner), device=count.device) - (count.cumsum(0) - count)[owner]
    place = first[owner] + place
    numbers = sequence(int(place.max()) + 1, 2, points.position)[place]
    numbers = (numbers.repeat(1, 2) + shift[owner].to(numbers)).frac()
    here = points.take(owner)
    exponent = world.triangles.shininess[here.triangle]
    # n = 0 is even all around
    mirror = safe_normalize(reflect(here.outgoing, here.normal))
    axis = torch.where(exponent.unsqueeze(-1) > 0, mirror, here.normal)
    rays = _Rays(owner, here, axis, exponent, 1 / count[owner].to(exponent))
    shown = _along_lobes(world, rays, numbers[:, :2], len(count))
    if shown.weights.shape[1] == 0:
        return shown
    return shown._replace(
        weights=shown.weights + _at_emitters(world, settings, rays, numbers[:, 2:], len(count))
    )


def _along_lobes(world: World, rays: _Rays, numbers: Float[Tensor, "ray 2"], block: int) -> _Shown:
    """Follow directions of the lobes."""
    direction = _drawn(rays, numbers)
    carried = rays.carried(direction)
    up = torch.nonzero(carried > 0).squeeze(-1)
    rays, direction, carried = rays.take(up), direction[up], carried[up]
    start = world.rays.lift(rays.points.position, rays.points.facet)
    hits = see(world, start, direction)
    sky = carried.new_zeros(block, world.scene.channels)
    sky = sky.index_add(0, rays.owner, carried.unsqueeze(-1) * _sky(world, direction, hits))
    emitter, area = _emitter_of(world, hits)
    weights = carried.new_zeros(block, len(world.emitters.triangle))
    lit = torch.nonzero(emitter >= 0).squeeze(-1)
    if len(lit):
        ray = hits.position[lit] - start[lit]
        cosine = dot(hits.facet[lit], -direction[lit]).clamp(min=0)
        here, there = rays.take(lit).density(direction[lit]), dot(ray, ray)
        # p / (p + q), q = r^2 / (A cos)
        part = guarded_divide(here * cosine * area[lit], here * cosine * area[lit] + there)
        found = carried[lit] * part
        weights = weights.index_put((rays.owner[lit], emitter[lit]), found, accumulate=True)
    met = torch.nonzero(hits.face >= 0).squeeze(-1)
    return _Shown(weights, sky, rays.owner[met], carried[met], hits.take(met))


def _drawn(rays: _Rays, numbers: Float[Tensor, "ray 2"]) -> Float[Tensor, "ray 3"]:
    """Directions with density p: cos(alpha) = u^(1/(n+1))."""
    height = torch.log1p(-numbers[:, 0]) / (rays.exponent + 1)
    cosine, sine = height.exp(), (-torch.expm1(2 * height)).clamp(min=0).sqrt()
    angle = 2 * math.pi * numbers[:, 1]
    tangent, bitangent = local_frame(rays.axis)
    x, y, z = (t.unsqueeze(-1) for t in (sine * angle.cos(), sine * angle.sin(), cosine))
    return safe_normalize(x * tangent + y * bitangent + z * rays.axis)


def _emitter_of(
    world: World, hits: SurfacePoints
) -> tuple[Int[Tensor, "ray"], Float[Tensor, "ray"]]:
    """Which emitter a point lies on, -1 for none, and the area of that emitter, m2."""
    triangles, emitters = world.triangles, world.emitters
    if len(emitters.triangle) == 0:
        return torch.full_like(hits.face, -1), hits.position.new_zeros(len(hits.face))
    triangle = hits.triangle.clamp(min=0)
    kinds = triangles.surface[emitters.triangle]
    column = torch.searchsorted(kinds, triangles.surface[triangle].contiguous())
    column = column.clamp(max=len(kinds) - 1)
    shines = (triangles.emission > 0).any(-1)[triangle] & (hits.face >= 0)
    area = Patches(emitters.corners).area @ emitters.member
    return torch.where(shines, column, -1), area[column]


def _sky(
    world: World, direction: Float[Tensor, "ray 3"], hits: SurfacePoints
) -> Float[Tensor, "ray channel"]:
    """Radiance of light from everywhere along rays that meet nothing, W/m2/sr.

    Of a dome it is what a plane across the ray receives, over pi: exact where the dome is even.
    """
    light = direction.new_zeros(len(direction), world.scene.channels)
    for source in world.scene.sources:
        if not source.has_direction:
            found = source(hits.position if source.needs_position else None, direction)
            light = light + found.irradiance.to(light).sum(0) / math.pi
    return light * (hits.triangle < 0).unsqueeze(-1)


def _at_emitters(
    world: World,
    settings: RenderSettings,
    rays: _Rays,
    numbers: Float[Tensor, "ray 2"],
    block: int,
) -> Float[Tensor, "block emitter"]:
    """Look at points spread evenly on each emitter."""
    corners, member = world.emitters.corners, world.emitters.member
    area = Patches(corners).area
    total, group = area @ member, member.argmax(-1)
    order = torch.argsort(group, stable=True)
    reached = area[order].cumsum(0)
    begun = total.cumsum(0) - total
    # the first number picks a polygon by its area; what is left of it a place there
    target = begun + numbers[:, :1] * total
    picked = torch.searchsorted(reached, target).clamp(max=len(order) - 1)
    polygon = order[picked]
    left = guarded_divide(target - (reached - area[order])[picked], area[polygon]).clamp(0, 1)
    second = numbers[:, 1:].expand_as(left)
    spot = sample_patches(corners[polygon], torch.stack((left, second), -1))
    front = Patches(corners).normal[polygon]
    start = world.rays.lift(rays.points.position, rays.points.facet)
    ray = spot - start.unsqueeze(1)
    square = dot(ray, ray)
    direction = safe_normalize(ray)
    across = dot(-direction, front).clamp(min=0)
    ray_index, column = torch.nonzero(
        (across > 0) & (dot(direction, rays.points.facet.unsqueeze(1)) > 0), as_tuple=True
    )
    some, way = rays.take(ray_index), direction[ray_index, column]
    here, there = some.density(way), square[ray_index, column]
    seen = across[ray_index, column] * total[column]
    # l cos / (p + q) = (l cos / p) p / (p + q)
    found = some.carried(way) * guarded_divide(here * seen, here * seen + there)
    worth = torch.nonzero(found > 0).squeeze(-1)
    if settings.shadow_samples:
        at = (ray_index[worth], column[worth])
        free = world.rays.visible(start[at[0]], world.rays.lift(spot[at], front[at]))
        found = found.index_put((worth,), found[worth] * free)
    weights = found.new_zeros(block, len(total))
    return weights.index_put((some.owner, column), found, accumulate=True)


def _highlights(
    world: World, settings: RenderSettings, points: SurfacePoints, generator: torch.Generator
) -> Float[Tensor, "shiny channel"]:
    """Radiance of the points by lamps, W/m2/sr."""
    light = points.position.new_zeros(len(points.face), world.scene.channels)
    exponent = world.triangles.shininess[points.triangle].unsqueeze(-1)
    lamps = tuple(source for source in world.scene.sources if source.has_direction)
    for arrival, seen in lamp_arrivals(world, settings, lamps, points.receivers, generator):
        lobe = mirror_lobe(arrival.direction, points.outgoing, points.normal, exponent)
        cosine = clamped_cosine(arrival.direction, points.normal) * seen
        height = (exponent + 2) / (2 * math.pi) * lobe * cosine.unsqueeze(-1)
        light = light + (height * arrival.irradiance).sum(0)
    return light
