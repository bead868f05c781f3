"""How much reflected light bends within a patch: a quick look before any patch is made.

    bend(x) = | E_1(x) - sum_k w_k E_1(c_k) |
    E_1(x)  = mean over cosine-weighted directions of rho E_direct where they meet a surface

c_k are the corners of the patch that x would lie in, drawn a little towards its middle, and w_k the
weights of x in it: what linear interpolation between exact corner values would miss. E_1 is the
first bounce, gathered along the same directions from all four places, so that what does not differ
cancels without noise. Later bounces are smoother.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.render.direct import (
    cosine_directions,
    emitter_weights,
    lamp_irradiance,
)
from torchradiometry.render.indirect import first_patches
from torchradiometry.render.points import Receivers, SurfacePoints, see
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.subdivision import find
from torchradiometry.render.world import World
from torchradiometry.transport.rules import sequence

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["bends", "first_bounce"]

#: points that are looked at, and directions from each place
POINTS, RAYS = 96, 24
#: how far corners are drawn towards the middle of the patch
INWARDS = 0.1
#: direct light where rays end: one shadow ray to each source, taken as small
ROUGH = RenderSettings(penumbra=False, extent=False)


@torch.no_grad()
def bends(
    world: World, points: SurfacePoints, size: float
) -> tuple[Float[Tensor, "point channel"], SurfacePoints]:
    """The bend at up to `POINTS` of the points for patches of a longest edge (m), W/m2.

    Returns:
        The bends, and the points that were looked at.
    """
    step = max(1, len(points.face) // POINTS)
    some = points.take(torch.arange(0, len(points.face), step)[:POINTS])
    grid = first_patches(world, RenderSettings(patch_size=size))
    patch, weight = find(grid, some.face, some.on_face(world))
    corner = grid.corners[patch]
    corner = corner + INWARDS * (corner.mean(1, keepdim=True) - corner)
    place = torch.cat((some.position.unsqueeze(1), corner), 1)
    found = first_bounce(world, place, some.facet)
    return (found[:, 0] - (weight.unsqueeze(-1) * found[:, 1:]).sum(1)).abs(), some


def first_bounce(
    world: World, place: Float[Tensor, "point place 3"], normal: Float[Tensor, "point 3"]
) -> Float[Tensor, "point place channel"]:
    """E_1, W/m2, along the same `RAYS` directions from all places (m) of a point."""
    count, places = place.shape[:2]
    generator = torch.Generator().manual_seed(0)
    turn = torch.rand(count, 1, 2, generator=generator, dtype=torch.float64).to(place)
    direction = cosine_directions((sequence(RAYS, 2, place) + turn).frac(), normal)
    start = world.rays.lift(place, normal.unsqueeze(1)).unsqueeze(2)
    shape = (count, places, RAYS, 3)
    hits = see(
        world,
        start.expand(shape).reshape(-1, 3),
        direction.unsqueeze(1).expand(shape).reshape(-1, 3),
    )
    light = place.new_zeros(len(hits.face), world.scene.channels)
    met = torch.nonzero(hits.face >= 0).squeeze(-1)
    if len(met):
        where = hits.take(met)
        receivers = Receivers(where.position, where.facet, where.facet)
        weights = emitter_weights(world, ROUGH, receivers, generator)
        direct = lamp_irradiance(world, ROUGH, receivers, generator)
        direct = direct + weights @ world.glow(world.triangles)
        albedo = world.triangles.reflectance[where.triangle].to(direct)
        light[met] = albedo * direct
    return light.reshape(count, places, RAYS, -1).mean(2)
