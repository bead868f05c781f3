"""A quick look at a scene: what some hundred pixels receive, with and without each effect.

    error of leaving something out  =  sum |L without - L with| / sum L        over pilot pixels

Each pilot pixel is seen through its middle and through a pair of opposite places in it
(`within_pixels`). Direct light is evaluated exactly, reflected light on coarse
patches (`reflections`). Sums over n pixels have a standard error, and what n pixels do not show
may still be there: `mean_error` adds both.

Without a camera the pilot looks at points spread evenly over all surfaces.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.numerics import guarded_divide
from torchradiometry.plan.highlights import Highlights, look_at_highlights
from torchradiometry.plan.patching import Patching
from torchradiometry.plan.reflections import COARSE, Reflections, look_at_reflections
from torchradiometry.plan.resolution import bends
from torchradiometry.plan.rough import thinned
from torchradiometry.plan.within_pixels import OneRay, look_within_pixels
from torchradiometry.render.ambient import SurfaceSample, on_surfaces
from torchradiometry.render.direct import (
    emitter_weights,
    lamp_irradiance,
    small_source_irradiance,
    unblocked_irradiance,
)
from torchradiometry.render.importance import Visits
from torchradiometry.render.points import Receivers, SurfacePoints, see
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World, prepare
from torchradiometry.scene.scene import Scene
from torchradiometry.transport.blockers import possible_blockers
from torchradiometry.transport.rules import sequence
from torchradiometry.transport.visible_parts import blockers_between

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["Pilot"]

#: pixels that are looked at where faces shine, and where only lamps do, which is quick
PIXELS, MORE = 512, 2048
#: faces x vertices up to which it is asked whether any face can block
MOST_TESTS = 2**24
#: shadow rays of a point to all shining polygons, and at least to each, where nothing is left out
SHADOWS, EACH = 8, 4
#: standard errors that are added to what the pilot's pixels show
ERRORS = 1.5
#: factor on the bends of reflected light, and the power of the patch size by which they fall
BLUR, POWER = 2.3, 1.3
#: error of reflected light between patches as large as the scene that see each other in part
PARTLY = 0.03
#: rounding that irradiance may have here
ENOUGH_DIGITS = 1e-4


class _Lit(NamedTuple):
    """Direct light.

    Attributes:
        seen: irradiance of the pilot points, W/m2.
        everywhere: irradiance of points of all surfaces, W/m2.
        power: rho E on points of all surfaces, sum of channels, W/m2.
    """

    seen: Float[Tensor, "point channel"]
    everywhere: Float[Tensor, "sample channel"]
    power: Float[Tensor, "sample"]


class Pilot:
    """What a quick look at a scene shows; everything is found when it is first asked for.

    Args:
        scene: surfaces and sources, with at least one triangle.
        camera: who looks; None: all surfaces count by their area.
        seed: of the pixels and rays.
    """

    def __init__(self, scene: Scene, camera: AbstractCamera | None, seed: int = 0) -> None:
        self.scene, self.camera, self.seed = scene, camera, seed
        self.world: World = prepare(scene, RenderSettings())
        self._known: dict[RenderSettings, _Lit] = {}
        self._open: dict[bool, Tensor] = {}
        self.lit_world = thinned(self.world)
        polygons = max(1, len(self.lit_world.emitters.corners))
        #: how direct light is evaluated where nothing is left out
        self.fine = RenderSettings(shadow_samples=max(EACH, SHADOWS // polygons))

    @cached_property
    def surfaces(self) -> SurfaceSample:
        """Points on all surfaces, and how much of them each sees."""
        return on_surfaces(self.world, 256, self.seed)

    @cached_property
    def patching(self) -> Patching:
        """How many patches and pairs of them there are."""
        if self.camera is None:
            return Patching(self.world, None, self.seed)
        where, _ = self.looks
        seen = Visits(where, torch.ones_like(where.position[:, 0]))
        return Patching(self.world, seen, self.seed)

    @cached_property
    def blocks(self) -> bool:
        """Whether some face can come between a point and a source.

        On one convex body no point lies in front of any face, and a lamp that lights a face from
        its front is seen by all of it. Large meshes are not asked: True.
        """
        world = self.world
        corners, tolerance = world.triangles.corners, world.rays.tolerance
        points = torch.cat([surface.vertices.detach() for surface in self.scene.surfaces]).double()
        if len(corners) * len(points) > MOST_TESTS:
            return True
        if self.surfaces.mutual_view == 0 and self._convex(points):
            return False
        if self.scene.sources:
            return True
        blocks = (possible_blockers(part, points, tolerance) for part in corners.split(1024))
        return any(bool(block.any()) for block in blocks)

    def _convex(self, points: Float[Tensor, "vertex 3"]) -> bool:
        """No point lies in front of any face."""
        world = self.world
        if bool(world.triangles.two_sided.any()):
            return False
        middle = points.mean(0)
        offset = (world.normal * (world.triangles.corners[:, 0] - middle)).sum(-1, keepdim=True)
        # about the middle float32 knows heights to a tenth of the tolerance
        around = (points - middle).float().mT
        parts = zip(world.normal.float().split(1024), offset.float().split(1024), strict=True)
        return all(float((n @ around - o).max()) <= world.rays.tolerance for n, o in parts)

    @cached_property
    def looks(self) -> tuple[SurfacePoints, Bool[Tensor, "look pixel"]]:
        """What the rays of all pilot pixels meet, and whether it is a surface that counts."""
        generator = torch.Generator().manual_seed(self.seed)
        like = self.world.triangles.corners
        if self.camera is None:
            sample = self.surfaces
            count = len(sample.triangle)
            third = torch.full((count, 3), 1 / 3).to(like)
            receivers = sample.receivers
            # without an eye every point is seen along its normal
            where = SurfacePoints(sample.triangle, sample.face, third, *receivers, receivers.normal)
            met = (sample.weight > 0).unsqueeze(0)
        else:
            size = like.new_tensor([self.camera.width, self.camera.height])
            count = PIXELS if len(self.world.emitters.corners) else MORE
            centre = (sequence(count, 2, like) * size).floor()
            shift = torch.rand(count, 2, generator=generator, dtype=torch.float64).to(like) - 0.5
            place = torch.cat((centre, centre + shift, centre - shift))
            where = see(self.world, *self.camera.rays(place))
            met = (where.face >= 0).reshape(3, -1)
        shines = (self.world.triangles.emission > 0).any(-1)[where.triangle.clamp(min=0)]
        return where, met & ~shines.reshape(met.shape)

    @cached_property
    def points(self) -> SurfacePoints:
        """What the middles of the pilot pixels see, emitters and background left out."""
        where, counts = self.looks
        return where.take(torch.nonzero(counts[0]).squeeze(-1))

    @cached_property
    def seen(self) -> float:
        """Share of the pixels that see a surface that does not shine."""
        return float(self.looks[1][0].double().mean())

    def _lit(self, settings: RenderSettings) -> _Lit:
        """Direct light of the pilot points and of all surfaces."""
        if settings not in self._known:
            self._known[settings] = self._evaluated(settings)
        return self._known[settings]

    @torch.no_grad()
    def _evaluated(self, settings: RenderSettings) -> _Lit:
        found, sample = self.points, self.surfaces
        parts = zip(found.receivers, sample.receivers, strict=True)
        points = Receivers(*(torch.cat(pair) for pair in parts))
        if settings.extent not in self._open:
            self._open[settings.extent] = self.unblocked(points, settings.extent)
        light = self.direct_at(points, settings, self._open[settings.extent])
        seen, everywhere = light.split((len(found.face), len(sample.triangle)))
        albedo = self.world.triangles.reflectance[sample.triangle].double()
        power = sample.weight * (albedo * everywhere).sum(-1)
        return _Lit(seen, everywhere, power)

    @property
    def _fully_lit(self) -> _Lit:
        return self._lit(self.fine)

    @cached_property
    def shaded(self) -> float:
        """Share of the pilot points that some face keeps some light from."""
        if not self.blocks or not len(self.points.face):
            return 0.0
        free, full = self._lit(replace(self.fine, shadow_samples=0)).seen, self.full_direct
        return float((~torch.isclose(full, free)).any(-1).double().mean())

    @cached_property
    def facing(self) -> float:
        """Share of the pairs of a pilot point and a shining polygon that face each other."""
        polygons = self.lit_world.emitters.corners
        if not len(polygons) or not len(self.points.face):
            return 0.0
        position, normal = (t.unsqueeze(1) for t in self.points.receivers[:2])
        return float((small_source_irradiance(position, normal, polygons) > 0).double().mean())

    @cached_property
    def between(self) -> float:
        """How many blockers are cut out of the view of a shining polygon, in the mean: all that may
        come in between, but only the first of those that leave nothing.
        """
        polygons, blockers = self.lit_world.emitters.corners, self.lit_world.blockers
        if not len(polygons) or blockers is None or not len(self.points.face):
            return 0.0
        position, normal = (t.unsqueeze(1) for t in self.points.receivers[:2])
        number = blockers_between(position[::4], normal[::4], polygons, blockers)
        dark = (self.full_direct[::4] <= 0).all(-1, keepdim=True)
        return float(torch.where(dark, number.clamp(max=1), number).double().mean())

    @torch.no_grad()
    def direct_at(
        self, points: Receivers, settings: RenderSettings, unblocked: Tensor | None
    ) -> Float[Tensor, "point channel"]:
        """Penumbras are clipped where nothing is known `unblocked`."""
        world = self.lit_world
        world = world if unblocked is None else world._replace(blockers=None)
        generator = torch.Generator().manual_seed(self.seed + settings.shadow_samples)
        weights = emitter_weights(world, settings, points, generator, unblocked)
        lamps = lamp_irradiance(world, settings, points, generator)
        return lamps + weights @ world.glow(world.triangles)

    def unblocked(self, points: Receivers, extent: bool) -> Float[Tensor, "point polygon"]:
        """Irradiance of every polygon for unit radiance with nothing in between."""
        position, normal = (t.unsqueeze(1) for t in points[:2])
        polygons = self.lit_world.emitters.corners
        if not len(polygons):
            return position.new_zeros(len(position), 0)
        return unblocked_irradiance(position, normal, polygons, extent, ENOUGH_DIGITS)

    @cached_property
    def full_direct(self) -> Float[Tensor, "point channel"]:
        """Direct irradiance with nothing left out."""
        return self._fully_lit.seen

    @cached_property
    def reflections(self) -> Reflections:
        """Reflected light of the pilot points."""
        lit = self._fully_lit.everywhere
        return look_at_reflections(self.lit_world, self.points, self.surfaces, lit)

    @cached_property
    def albedo(self) -> Float[Tensor, "point channel"]:
        """Of the pilot points."""
        found = self.points
        return self.scene.albedo_at(found.triangle, found.barycentric).detach().double()

    @cached_property
    def highlights(self) -> Highlights:
        """Light of the pilot points by their lobes."""
        return look_at_highlights(self.lit_world, self.fine, self.points, self.reflections)

    @cached_property
    def sent_by_lobes(self) -> float:
        """Share of what surfaces send each other that their lobes send, 0..1."""
        sample, triangles, lit = self.surfaces, self.world.triangles, self._fully_lit
        lobe = (triangles.reflectance - triangles.albedo)[sample.triangle].double()
        sent = (sample.weight * (lobe * lit.everywhere).sum(-1)).sum()
        return float(guarded_divide(sent, lit.power.sum()))

    @cached_property
    def light(self) -> float:
        """Sum of pi L, reflected, over the pilot points and channels."""
        received = self.full_direct + self.reflections.irradiance
        return float((self.albedo * received).sum() + math.pi * self.highlights.radiance.sum())

    def mean_error(self, difference: Float[Tensor, "point channel"]) -> float:
        """Relative L1 error by a difference of the irradiance on the pilot points, W/m2.

        `ERRORS` standard errors of the sum are added to it.
        """
        return self.error_of((self.albedo * difference).abs().sum(-1))

    def error_of(self, each: Float[Tensor, "point"]) -> float:
        """The same of differences of pi L on the pilot points, W/m2."""
        if self.light <= 0 or len(each) < 2:
            return 0.0
        return float(each.sum() + ERRORS * math.sqrt(len(each)) * each.std()) / self.light

    @property
    def unseen(self) -> float:
        """Error by what too few pixels showed none of: one of them in the light of a mean one."""
        return 1 / max(1, len(self.points.face))

    def direct_error(self, settings: RenderSettings) -> float:
        """Relative L1 error of evaluating direct light with `settings`.

        What all surfaces together reflect too much or too little is added: reflected light, where
        it is seen, is wrong by the same share.
        """
        found, full = self._lit(settings), self._fully_lit
        error = self.mean_error(found.seen - full.seen)
        power = float(full.power.sum())
        if self.light <= 0 or power <= 0:
            return error
        reflected = float((self.albedo * self.reflections.irradiance).sum()) / self.light
        off = found.power - full.power
        wrong = float(off.sum().abs()) + ERRORS * math.sqrt(len(off)) * float(off.std())
        return error + reflected * wrong / power

    @cached_property
    def _bends(self) -> tuple[Tensor, Tensor, Tensor]:
        """What coarse patches miss at some points, relative to their mean light, their faces'
        longest edges, m, and the relative sizes of patches there.
        """
        points = self.points
        bend, some = bends(self.lit_world, points, COARSE * self.world.rays.scale)
        albedo = self.scene.albedo_at(some.triangle, some.barycentric).detach().double()
        corners = self.world.triangles.corners[some.triangle]
        edge = (corners - corners.roll(-1, 1)).norm(dim=-1).amax(-1)
        mean = self.light / max(1, len(points.face))
        return (albedo * bend).sum(-1) / mean, edge, self.patching.relative[some.face]

    def patch_error(self, size: float) -> float:
        """Relative L1 error by patches of that longest edge, m, where importance is even."""
        if self.light <= 0 or self.reflections.decay <= 0:
            return 0.0
        bend, edge, relative = self._bends
        coarse = torch.clamp(edge, max=COARSE * self.world.rays.scale)
        each = bend * (torch.minimum(edge, size * relative) / coarse) ** POWER
        bent = BLUR * (float(each.mean()) + float(each.std()) / math.sqrt(max(1, len(each))))
        share = float((self.albedo * self.reflections.irradiance).sum()) / self.light
        return bent + self.blocks * share * PARTLY * (size / self.world.rays.scale) ** 2

    @cached_property
    def one_ray(self) -> OneRay:
        """The picture with one ray a pixel."""
        if self.camera is None or self.light <= 0:
            return OneRay(0.0, 0.0, 0.0, 0.0)
        return look_within_pixels(self)
