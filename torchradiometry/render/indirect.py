"""Indirect light: radiosity on patches, interpolated to the points a camera sees.

    D   = rho (E_lamps + F M)             first reflection, on patches, W/m2
    R   = D + rho F D + ... (solver)       all that was reflected at least once
    E   = F R                              irradiance by reflected light, W/m2

E is smooth where direct light is not; it is interpolated between patch corners (`lattice`)
and multiplied by the albedo of the very point, so textures stay sharp. M does not contribute
to E: emitted light reaches the picture directly and exactly.

Black backs are no patches: what they receive is lost, as it should be. Rows of patches that
see only patches are closed to 1 all the same (`exposure`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import guarded_divide
from torchradiometry.render.direct import lamp_irradiance
from torchradiometry.render.exposure import Exposure, exposure_of
from torchradiometry.render.lattice import (
    Lattice,
    build_lattice,
    interpolate,
    locate,
    vertex_values,
    weld,
)
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World
from torchradiometry.shade.radiosity import RadiosityShading
from torchradiometry.solve.neumann import Neumann
from torchradiometry.solve.solution import Solution
from torchradiometry.transport.form_factors import form_factors

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["Indirect", "indirect_at", "indirect_light", "make_lattice", "patch_size_of"]

#: default longest edge of a patch, as a share of the half diagonal of the scene
PATCH_SHARE = 1 / 6
#: a triangle is flat if its shading normals deviate from its plane by less (cosine)
FLAT = 1 - 2.0**-12


class Indirect(NamedTuple):
    """Solved interreflection.

    Attributes:
        lattice: of the one-sided faces.
        corner: welded vertices of each patch.
        values: irradiance by reflected light on welded vertices, W/m2.
        patches: all patches.
        exposure: what of them lies free.
        albedo, exitance, lamps: of the patches; 1, W/m2, W/m2 (lamps: E by sources).
        form_factors: F[receiver, emitter].
        solution: the reflected light R, W/m2, with its bound.
        irradiance: F R on patches, W/m2.
    """

    lattice: Lattice
    corner: Int[Tensor, "patch 3"]
    values: Float[Tensor, "vertex channel"]
    patches: Patches
    exposure: Exposure
    albedo: Float[Tensor, "patch channel"]
    exitance: Float[Tensor, "patch channel"]
    lamps: Float[Tensor, "patch channel"]
    form_factors: Float[Tensor, "patch patch"]
    solution: Solution
    irradiance: Float[Tensor, "patch channel"]


def patch_size_of(world: World, settings: RenderSettings) -> float:
    """Longest edge of a patch, m."""
    return settings.patch_size or world.rays.scale * PATCH_SHARE


def make_lattice(world: World, patch_size: float) -> Lattice:
    """The grid of all faces, no patch edge longer than `patch_size` (m)."""
    corners = world.faces.corners
    edge = (corners.detach() - corners.detach().roll(-1, 1)).norm(dim=-1).amax(-1)
    # an edge that is a whole multiple of the patch size to rounding is not split again
    splits = (edge / patch_size - 2.0**-20).ceil().clamp(min=1).long()
    return build_lattice(corners, splits)


def indirect_light(world: World, settings: RenderSettings) -> Indirect:
    """Patches, form factors and the solved reflected light of a scene.

    Raises:
        ResourceLimitError: too many patches for the budget.
    """
    lattice = make_lattice(world, patch_size_of(world, settings))
    patches = Patches(lattice.corners)
    exposure = exposure_of(world, patches, settings.seed)
    triangle = world.faces.triangle[lattice.triangle]
    factors = form_factors(
        patches,
        world.rays,
        closed=exposure.enclosed,
        exposure=exposure.share,
        samples=settings.pair_samples,
        budget=settings.budget,
        seed=settings.seed,
    )
    albedo = world.triangles.albedo[triangle]
    exitance = math.pi * world.triangles.emission[triangle]
    lamps = _lamps_on(world, settings, patches, exposure)
    first = albedo * (lamps + factors @ exitance)
    solver = Neumann(max(settings.bounces - 1, 0), settings.ambient_tail)
    solution = RadiosityShading(factors, solver).solution(albedo, first)
    irradiance = factors @ solution.radiosity
    corner, values = _on_vertices(world, lattice, patches, exposure, irradiance)
    return Indirect(
        lattice,
        corner,
        values,
        patches,
        exposure,
        albedo,
        exitance,
        lamps,
        factors,
        solution,
        irradiance,
    )


def _lamps_on(
    world: World, settings: RenderSettings, patches: Patches, exposure: Exposure
) -> Float[Tensor, "patch channel"]:
    """Mean irradiance by the scene's sources over the free points of each patch, W/m2."""
    channels = world.scene.channels
    if not world.scene.sources:
        return patches.corners.new_zeros(patches.count, channels)
    points = exposure.point.shape[1]
    normal = patches.normal.repeat_interleave(points, 0)
    generator = torch.Generator().manual_seed(settings.seed)
    found = lamp_irradiance(
        world, settings, exposure.point.reshape(-1, 3), normal, normal, generator
    ).reshape(patches.count, points, -1)
    weight = exposure.free.to(found).unsqueeze(-1)
    return guarded_divide((found * weight).sum(1), weight.sum(1))


def _on_vertices(
    world: World,
    lattice: Lattice,
    patches: Patches,
    exposure: Exposure,
    irradiance: Tensor,
) -> tuple[Tensor, Tensor]:
    """Welded vertices of each patch, and the irradiance on them."""
    triangles, triangle = world.triangles, world.faces.triangle
    plane = world.normal[triangle]
    flat = (triangles.normals * world.normal.unsqueeze(1)).sum(-1).amin(-1) > FLAT
    side = torch.ones_like(plane[:, :1])
    side[len(triangles.surface) :] = -1
    key = torch.where(flat[triangle].unsqueeze(-1), plane * side, 4 * side)
    vertex = weld(lattice, triangles.surface[triangle], key, world.rays.scale)
    corner = vertex[lattice.vertex]
    weight = patches.area.detach() * exposure.share
    count = int(vertex.max()) + 1 if len(vertex) else 0
    return corner, vertex_values(irradiance, weight, corner, count)


def indirect_at(
    indirect: Indirect, face: Int[Tensor, "ray"], barycentric: Float[Tensor, "ray 3"]
) -> Float[Tensor, "ray channel"]:
    """Irradiance by reflected light at points of faces, W/m2."""
    patch, weights = locate(indirect.lattice, face, barycentric)
    return interpolate(indirect.values, indirect.corner, patch, weights)
