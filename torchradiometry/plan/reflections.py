"""A quick look at reflected light: how much, how many bounces, how even, how coloured.

Scenes of few faces are solved on coarse patches whose form factors are counted rays (`rough`). In
larger ones every face would be a patch; there the first bounce is gathered along rays, and the
balance of ambient light (`render.ambient`) gives the later ones: their mean, and the share h(x) of
a point's hemisphere in which it sees surfaces their distribution:

    E(x) ~ E_1(x) + h(x) (B_mean - mean(rho E_direct))
    bounce k+1 ~ g bounce k,   g = mean(rho h)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide
from torchradiometry.plan.resolution import first_bounce
from torchradiometry.plan.rough import counted_factors
from torchradiometry.render.ambient import SurfaceSample, balanced_irradiance
from torchradiometry.render.direct import cosine_directions
from torchradiometry.render.indirect import (
    Indirect,
    exchange_between,
    first_patches,
    indirect_at,
    solve_exchange,
)
from torchradiometry.render.points import SurfacePoints, look
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World
from torchradiometry.transport.rules import sequence

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["ENOUGH", "Reflections", "look_at_reflections"]

#: edge of the pilot's patches, as a share of the half diagonal of the scene
COARSE = 0.9
#: faces and patches up to which the pilot solves for reflected light
MOST_FACES = 192
#: bounces that stand for all
ENOUGH = 96
#: rays over the hemisphere of a point
RAYS = 16


class Reflections(ABC):
    """Reflected light of the points that a pilot looks at.

    Attributes:
        irradiance: by all bounces, on the pilot's points, W/m2.
        ambient: what the ambient term would put in its place, W/m2.
        decay: largest share of the light that a bounce keeps, 0..1 (a bound).
    """

    irradiance: Float[Tensor, "point channel"]
    ambient: Float[Tensor, "channel"]
    decay: float

    @abstractmethod
    def after(self, bounces: int) -> Float[Tensor, "point channel"]:
        """The same after so many bounces and the ambient tail, W/m2."""

    @abstractmethod
    def grey(self) -> Float[Tensor, "point channel"]:
        """The same with the sources' colour, W/m2."""

    @abstractmethod
    def at(self, where: SurfacePoints) -> Float[Tensor, "look channel"]:
        """On any points, roughly, W/m2."""


@dataclass(frozen=True, eq=False)
class NoReflections(Reflections):
    """Nothing reflects, or no surface sees another."""

    irradiance: Tensor
    ambient: Tensor
    decay: float = 0.0

    def after(self, bounces: int) -> Tensor:
        return self.irradiance

    def grey(self) -> Tensor:
        return self.irradiance

    def at(self, where: SurfacePoints) -> Tensor:
        return self.irradiance.new_zeros(len(where.face), self.irradiance.shape[1])


@dataclass(frozen=True, eq=False)
class SolvedReflections(Reflections):
    """On coarse patches."""

    world: World
    found: Indirect
    points: SurfacePoints
    irradiance: Tensor
    ambient: Tensor
    decay: float

    def _solved(self, settings: RenderSettings) -> Tensor:
        found = solve_exchange(self.world, self.found.exchange, self.world.triangles, settings)
        return indirect_at(found, self.points.face, self.points.on_face(self.world))

    def after(self, bounces: int) -> Tensor:
        return self._solved(RenderSettings(bounces=bounces))

    def grey(self) -> Tensor:
        return self._solved(RenderSettings(bounces=ENOUGH, colour_bleeding=False))

    def at(self, where: SurfacePoints) -> Tensor:
        return indirect_at(self.found, where.face, where.on_face(self.world))


@dataclass(frozen=True, eq=False)
class BalancedReflections(Reflections):
    """By the balance of ambient light."""

    world: World
    irradiance: Tensor
    ambient: Tensor
    decay: float
    kept: Tensor
    colour: Tensor

    def after(self, bounces: int) -> Tensor:
        # the ambient tail stands for the rest; where surfaces differ, half of it goes astray
        return self.irradiance * (1 - self.kept**bounces / 2)

    def grey(self) -> Tensor:
        return self.irradiance.mean(-1, keepdim=True) * self.colour

    def at(self, where: SurfacePoints) -> Tensor:
        return self.ambient.expand(len(where.face), -1)


@torch.no_grad()
def look_at_reflections(
    world: World,
    points: SurfacePoints,
    surfaces: SurfaceSample,
    lit: Float[Tensor, "sample channel"],
) -> Reflections:
    """Reflected light of some points, and `lit` is the direct light (W/m2) of all `surfaces`."""
    channels = world.scene.channels
    nothing = points.position.new_zeros(len(points.face), channels)
    reflectance = world.triangles.reflectance
    albedo = reflectance[surfaces.triangle].double()
    decay = float(reflectance.max())
    if surfaces.mutual_view == 0 or decay <= 0:
        return NoReflections(nothing, nothing.new_zeros(channels))
    ambient = balanced_irradiance(albedo, lit, surfaces.view, surfaces.weight)
    if len(world.faces.corners) <= MOST_FACES:
        return _solved(world, points, ambient, decay)
    weight = guarded_divide(surfaces.weight, surfaces.weight.sum()).unsqueeze(-1)
    kept = (weight * albedo * surfaces.view.unsqueeze(-1)).sum(0)
    direct = (weight * lit).sum(0)
    colour = guarded_divide(direct, direct.mean())
    even = guarded_divide(ambient, nothing.new_tensor(surfaces.mutual_view))
    later = (even - (weight * albedo * lit).sum(0)).clamp(min=0)
    first = first_bounce(world, points.position.unsqueeze(1), points.facet).squeeze(1)
    irradiance = first + _view(world, points).unsqueeze(-1) * later
    return BalancedReflections(world, irradiance, ambient, decay, kept, colour)


def _solved(world: World, points: SurfacePoints, ambient: Tensor, decay: float) -> Reflections:
    size = COARSE * world.rays.scale
    settings = RenderSettings(patch_size=size, bounces=ENOUGH, penumbra=False, extent=False)
    patches = first_patches(world, settings)
    between = partial(counted_factors, patches)
    exchange = exchange_between(world, patches, settings, between)
    found = solve_exchange(world, exchange, world.triangles, settings)
    irradiance = indirect_at(found, points.face, points.on_face(world))
    return SolvedReflections(world, found, points, irradiance, ambient, decay)


def _view(world: World, points: SurfacePoints) -> Float[Tensor, "point"]:
    """Share of the hemisphere of points in which they see fronts of surfaces."""
    normal = points.facet
    turn = torch.rand(len(normal), 1, 2, generator=torch.Generator().manual_seed(0)).to(normal)
    direction = cosine_directions((sequence(RAYS, 2, normal) + turn).frac(), normal)
    front, _ = look(world, world.rays.lift(points.position, normal).unsqueeze(1), direction)
    return front.to(normal).mean(-1)
