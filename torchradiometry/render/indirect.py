"""Indirect light: radiosity on patches, interpolated to the points a camera sees.

    D   = rho (E_lamps + W L)             first reflection, on patches, W/m2
    R   = D + rho F D + ... (solver)       all that was reflected at least once
    E   = F R                              irradiance by reflected light, W/m2

W is the exact direct light of `direct`, averaged over points of each patch, and not the form
factors of the emitters: shadows on patches are as good as those in the picture. E is smooth
where direct light is not; it is interpolated between patch corners (`lattice`) and multiplied
by the albedo of the very point, so textures stay sharp. M does not contribute to E: emitted
light reaches the picture directly and exactly.

`Exchange` is geometry alone and serves any albedo and radiance; `solve_exchange` is what is
left to do, a few products with F. F is a dense matrix for few patches and a tree of clusters
for many; `operator_between` decides.

Black backs are no patches: what they receive is lost, as it should be. Rows of patches that
see only patches are closed to 1 all the same (`exposure`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import guarded_divide
from torchradiometry.render.direct import emitter_weights, lamp_irradiance
from torchradiometry.render.exposure import Exposure, exposure_of
from torchradiometry.render.importance import Visits, relative_sizes
from torchradiometry.render.lattice import (
    Welding,
    build_lattice,
    interpolate,
    vertex_values,
    weld_patches,
)
from torchradiometry.render.points import Receivers
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.subdivision import Subdivision, find, unrefined
from torchradiometry.render.world import World
from torchradiometry.scene.scene import Triangles
from torchradiometry.shade.large_scenes import hierarchical_operator
from torchradiometry.shade.radiosity import RadiosityShading
from torchradiometry.solve.neumann import Neumann
from torchradiometry.solve.operators import AbstractOperator, DenseOperator
from torchradiometry.solve.solution import Solution
from torchradiometry.transport.form_factors import MATRICES, form_factors

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = [
    "CLUSTER_ERROR",
    "MOST_DENSE",
    "Exchange",
    "Indirect",
    "Reflected",
    "exchange_between",
    "first_patches",
    "indirect_at",
    "operator_between",
    "patch_size_of",
    "patch_splits",
    "reflected_irradiance",
    "solve_exchange",
]

#: default longest edge of a patch, as a share of the half diagonal of the scene
PATCH_SHARE = 1 / 6
#: relative error of unoccluded form factors: constant radiosity on patches costs more
PAIR_ERROR = 1e-2
#: relative error of the radiosity that a tree of clusters aims at
CLUSTER_ERROR = 0.01
#: patches above which a tree is made: of bodies sooner than a matrix, of rooms in less memory
MOST_DENSE = 6000


class Exchange(NamedTuple):
    """What patches send each other, whatever they reflect and emit.

    Attributes:
        subdivision: of the one-sided faces into patches.
        welding: which vertices they share.
        patches: all patches.
        triangle: which triangle a patch is part of.
        exposure: what of the patches lies free.
        weights, points: mean W of the emitters over the free points of a patch, W/m2 per
            W/m2/sr, and W on the points themselves.
        lamps: mean E by sources, W/m2.
        operator: F of the patches, for any solver.
        reason: why F is a matrix or a tree of clusters.
    """

    subdivision: Subdivision
    welding: Welding
    patches: Patches
    triangle: Int[Tensor, "patch"]
    exposure: Exposure
    weights: Float[Tensor, "patch emitter"]
    points: Float[Tensor, "patch point emitter"]
    lamps: Float[Tensor, "patch channel"]
    operator: AbstractOperator
    reason: str


#: how F of patches is found, see `operator_between`
Between = Callable[[World, Patches, Exposure, RenderSettings], tuple[AbstractOperator, str]]


class Indirect(NamedTuple):
    """Solved interreflection.

    Attributes:
        exchange: patches and what they send each other.
        values: irradiance by reflected light on welded vertices, W/m2.
        albedo, exitance: of the patches; 1, W/m2.
        solution: the reflected light R, W/m2, with its bound.
        irradiance: F R on patches, W/m2.
    """

    exchange: Exchange
    values: Float[Tensor, "vertex channel"]
    albedo: Float[Tensor, "patch channel"]
    exitance: Float[Tensor, "patch channel"]
    solution: Solution
    irradiance: Float[Tensor, "patch channel"]

    @property
    def radiosity(self) -> Float[Tensor, "patch channel"]:
        """B of the patches, emitted and reflected, W/m2."""
        return self.exitance + self.solution.radiosity


def patch_size_of(world: World, settings: RenderSettings) -> float:
    """Longest edge of a patch, m."""
    return settings.patch_size or world.rays.scale * PATCH_SHARE


def patch_splits(world: World, size: float | Float[Tensor, "face"]) -> Int[Tensor, "face"]:
    """In how many parts the edges of each face are cut, so that none is longer than `size` (m)."""
    corners = world.faces.corners.detach()
    edge = (corners - corners.roll(-1, 1)).norm(dim=-1).amax(-1)
    # an edge that is a whole multiple of the patch size to rounding is not split again
    return (edge / size - 2.0**-20).ceil().clamp(min=1).long()


def first_patches(
    world: World, settings: RenderSettings, seen: Visits | None = None
) -> Subdivision:
    """The grid of all faces, no edge longer than the patch size.

    Args:
        world: a prepared scene.
        settings: patch size, and whether it follows importance.
        seen: what a camera looks at; None: everything, alike.
    """
    size: float | Tensor = patch_size_of(world, settings)
    if settings.importance and seen is not None:
        size = size * relative_sizes(world, seen)
    return unrefined(build_lattice(world.faces.corners, patch_splits(world, size)))


def exchange_between(
    world: World,
    subdivision: Subdivision,
    settings: RenderSettings,
    between: Between | None = None,
) -> Exchange:
    """Exposure, direct light and form factors of patches.

    Args:
        world: a prepared scene.
        subdivision: its patches.
        settings: shadow rays, samples, budget.
        between: what finds F; None: `operator_between`.

    Raises:
        ResourceLimitError: too many patches for the budget.
    """
    patches = Patches(subdivision.corners)
    exposure = exposure_of(world, patches, settings.seed)
    operator, reason = (between or operator_between)(world, patches, exposure, settings)
    triangle = world.faces.triangle[subdivision.face]
    weights, lamps = _direct(world, settings, patches, exposure)
    return Exchange(
        subdivision,
        weld_patches(
            subdivision.corners,
            world.parts[subdivision.face],
            world.rays.scale,
            subdivision.levels,
        ),
        patches,
        triangle,
        exposure,
        _over_free(weights, exposure),
        weights,
        _over_free(lamps, exposure),
        operator,
        reason,
    )


def operator_between(
    world: World, patches: Patches, exposure: Exposure, settings: RenderSettings
) -> tuple[AbstractOperator, str]:
    """F of patches as the operator that costs less, and why.

    Up to `MOST_DENSE` patches whose matrix fits into the budget F is a `DenseOperator`, beyond
    either a `HierarchicalOperator`. Corners that ask for gradients get them from the matrix
    only.

    Args:
        world: what blocks.
        patches: senders and receivers.
        exposure: what of them lies free.
        settings: budget, samples and seed.

    Raises:
        ResourceLimitError: too many patches for the budget.
    """
    count, learns = patches.count, patches.corners.requires_grad
    needed = 8 * MATRICES * count**2
    enclosed, share = exposure.enclosed, exposure.share
    if learns or (count <= MOST_DENSE and needed <= settings.budget):
        factors = form_factors(
            patches,
            world.rays,
            closed=enclosed,
            exposure=share,
            samples=settings.pair_samples,
            rtol=PAIR_ERROR,
            budget=settings.budget,
            seed=settings.seed,
        )
        area = patches.area.detach() * share
        why = "their corners ask for gradients" if learns else f"at most {MOST_DENSE}"
        return DenseOperator(factors, area), f"a matrix: {count} patches, {why}"
    operator = hierarchical_operator(
        patches,
        world.rays,
        closed=enclosed,
        exposure=share,
        tolerance=CLUSTER_ERROR,
        budget=settings.budget,
        seed=settings.seed,
    )
    why = f"more than {MOST_DENSE}"
    if count <= MOST_DENSE:
        why = f"whose matrix needs {needed} bytes of {settings.budget}"
    return operator, f"a tree of clusters: {count} patches, {why}"


def _direct(
    world: World, settings: RenderSettings, patches: Patches, exposure: Exposure
) -> tuple[Float[Tensor, "patch point emitter"], Float[Tensor, "patch point channel"]]:
    """Direct light on the points of the patches."""
    count, points = exposure.point.shape[:2]
    normal = patches.normal.repeat_interleave(points, 0)
    where = Receivers(exposure.point.reshape(-1, 3), normal, normal)
    generator = torch.Generator().manual_seed(settings.seed)
    weights = emitter_weights(world, settings, where, generator)
    lamps = lamp_irradiance(world, settings, where, generator)
    return weights.reshape(count, points, -1), lamps.reshape(count, points, -1)


def _over_free(
    value: Float[Tensor, "patch point column"], exposure: Exposure
) -> Float[Tensor, "patch column"]:
    weight = exposure.free.to(value).unsqueeze(-1)
    return guarded_divide((value * weight).sum(1), weight.sum(1))


def solve_exchange(
    world: World, exchange: Exchange, triangles: Triangles, settings: RenderSettings
) -> Indirect:
    """The reflected light of patches.

    Args:
        world: where the exchange was found.
        exchange: see `exchange_between`.
        triangles: of the same scene; only albedo and emission are read.
        settings: bounces.
    """
    albedo = triangles.reflectance[exchange.triangle].to(torch.float64)
    exitance = math.pi * triangles.emission[exchange.triangle].to(torch.float64)
    direct = exchange.lamps + exchange.weights @ world.glow(triangles)
    found = reflected_irradiance(exchange, albedo, direct, settings)
    return Indirect(exchange, found.values, albedo, exitance, found.solution, found.irradiance)


class Reflected(NamedTuple):
    """Reflected light of patches: on vertices, the solution, on patches; see `Indirect`."""

    values: Float[Tensor, "vertex channel"]
    solution: Solution
    irradiance: Float[Tensor, "patch channel"]


def reflected_irradiance(
    exchange: Exchange,
    albedo: Float[Tensor, "patch channel"],
    direct: Float[Tensor, "patch channel"],
    settings: RenderSettings,
) -> Reflected:
    """What patches receive from each other if they receive `direct` (W/m2) from sources."""
    weight = exchange.patches.area.detach() * exchange.exposure.share
    solver = Neumann(max(settings.bounces - 1, 0), settings.ambient_tail)
    operator = exchange.operator
    if settings.colour_bleeding:
        solution = RadiosityShading(operator, solver).solution(albedo, albedo * direct)
        irradiance = operator(solution.radiosity)
    else:
        grey, light = (t.mean(-1, keepdim=True) for t in (albedo, direct))
        solution = RadiosityShading(operator, solver).solution(grey, grey * light)
        colour = guarded_divide(weight @ direct, weight @ light)
        irradiance = operator(solution.radiosity) * colour
        solution = solution._replace(
            radiosity=solution.radiosity * colour, bound=solution.bound * colour
        )
    return Reflected(vertex_values(irradiance, weight, exchange.welding), solution, irradiance)


def indirect_at(
    indirect: Indirect, face: Int[Tensor, "ray"], barycentric: Float[Tensor, "ray 3"]
) -> Float[Tensor, "ray channel"]:
    """Irradiance by reflected light at points of faces, W/m2."""
    patch, weights = find(indirect.exchange.subdivision, face, barycentric)
    return interpolate(indirect.values, indirect.exchange.welding.corner, patch, weights)
