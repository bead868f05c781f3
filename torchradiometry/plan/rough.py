"""Rough stand-ins for what takes long, good enough to judge effects by.

    F_ij ~ share of the rays from the free points of patch i that meet patch j

Rays leave the points with density cos / pi, so the shares are unbiased, rows sum to at most 1, and
patches that see each other in part need no special care.

A lamp of many polygons is thinned: of all polygons, ordered as they are, every one is kept where
the power before it passes a multiple of a step, and stands for that step:

    W ~ sum over kept polygons of  (step / power_k) W_k          (systematic sampling)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from torchradiometry.geometry.patches import Patches, vector_area
from torchradiometry.render.direct import cosine_directions
from torchradiometry.render.exposure import Exposure
from torchradiometry.render.points import see
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.subdivision import Subdivision, find
from torchradiometry.render.world import World
from torchradiometry.solve.operators import DenseOperator
from torchradiometry.transport.rules import sequence

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["counted_factors", "thinned"]

#: rays from each point of a patch
RAYS = 4
#: polygons that a thinned scene shines with
POLYGONS = 16


@torch.no_grad()
def counted_factors(
    subdivision: Subdivision,
    world: World,
    patches: Patches,
    exposure: Exposure,
    settings: RenderSettings,
) -> tuple[DenseOperator, str]:
    """F of the patches of a subdivision by counting rays; other arguments as `operator_between`."""
    count, points = exposure.free.shape
    normal = patches.normal.repeat_interleave(points, 0)
    generator = torch.Generator().manual_seed(settings.seed)
    turn = torch.rand(count * points, 1, 2, generator=generator, dtype=torch.float64).to(normal)
    direction = cosine_directions((sequence(RAYS, 2, normal) + turn).frac(), normal)
    start = world.rays.lift(exposure.point.reshape(-1, 3), normal).unsqueeze(1)
    hits = see(world, start.expand_as(direction).reshape(-1, 3), direction.reshape(-1, 3))
    free = exposure.free.repeat_interleave(RAYS, 1).reshape(-1)
    met = torch.nonzero(free & (hits.face >= 0)).squeeze(-1)
    where = hits.take(met)
    patch, _ = find(subdivision, where.face, where.on_face(world))
    pair = met // (points * RAYS) * count + patch
    number = torch.bincount(pair, minlength=count**2).reshape(count, count).to(normal)
    factors = number / (RAYS * exposure.free.sum(1).clamp(min=1)).unsqueeze(1)
    return DenseOperator(factors, patches.area * exposure.share), "counted rays"


@torch.no_grad()
def thinned(world: World) -> World:
    """The same world with at most `POLYGONS` shining polygons in place of all."""
    corners, member, _ = world.emitters
    if len(corners) <= POLYGONS:
        return world
    radiance = (member @ world.glow(world.triangles)).sum(-1)
    power: Float[torch.Tensor, "polygon"] = vector_area(corners).norm(dim=-1) * radiance
    reached = power.cumsum(0)
    step = reached[-1] / POLYGONS
    place = torch.arange(POLYGONS, device=power.device) + 0.5
    kept = torch.searchsorted(reached, place * step).clamp(max=len(power) - 1)
    weight = (step / power[kept]).unsqueeze(-1)
    emitters = world.emitters._replace(corners=corners[kept], member=member[kept] * weight)
    return world._replace(emitters=emitters)
