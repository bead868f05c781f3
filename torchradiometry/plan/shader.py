"""The shader of a plan: an `nn.Module` that holds what the plan chose, and runs nothing else.

    L(pixel) = sum over its rays of  share [ L_emitted + rho/pi (E_direct + E_reflected) ]

Geometry is done when the shader is made: what each ray meets, which part of the sources it sees,
how much patches see of each other. What is left is linear algebra in the colours: a product
for direct light, one number for ambient light, a series for bounces. A convex body under a distant
lamp keeps one dot product a ray and no more.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.render.ambient import AmbientExchange, balanced_irradiance
from torchradiometry.render.indirect import Exchange, reflected_irradiance
from torchradiometry.render.lattice import interpolate
from torchradiometry.render.picture import View, view_scene
from torchradiometry.render.pixels import pixel_means
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.subdivision import find
from torchradiometry.scene.scene import Scene

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AmbientLight", "DirectLight", "PlannedShader", "ReflectedLight"]


class DirectLight(nn.Module):
    """E_direct of every ray: W L of the shining surfaces, plus that of the lamps.

    Args:
        weights: W, W/m2 per W/m2/sr.
        lamps: E by lamps, W/m2.
        emitter: the surface that each column of W belongs to.
    """

    weights: Tensor
    lamps: Tensor
    emitter: Tensor

    def __init__(self, weights: Tensor, lamps: Tensor, emitter: Tensor) -> None:
        super().__init__()
        for name, value in (("weights", weights), ("lamps", lamps), ("emitter", emitter)):
            self.register_buffer(name, value.detach())

    def forward(self, emission: Float[Tensor, "surface channel"]) -> Float[Tensor, "ray channel"]:
        """E in W/m2 for the surfaces' radiances in W/m2/sr."""
        if self.weights.shape[-1] == 0:
            return self.lamps
        return self.lamps + self.weights @ emission[self.emitter]


class AmbientLight(nn.Module):
    """One E for all points, from the balance of light between the surfaces.

    Args:
        exchange: what the balance takes from geometry.
        surface: the surface of each of its points.
        paint: texture there, 0..1.
        emitter: the surface of each column of its weights.
    """

    surface: Tensor
    paint: Tensor
    view: Tensor
    weight: Tensor

    def __init__(
        self, exchange: AmbientExchange, surface: Tensor, paint: Tensor, emitter: Tensor
    ) -> None:
        super().__init__()
        self.direct = DirectLight(exchange.weights, exchange.lamps, emitter)
        sample = exchange.sample
        for name, value in (
            ("surface", surface),
            ("paint", paint),
            ("view", sample.view),
            ("weight", sample.weight),
        ):
            self.register_buffer(name, value.detach())

    def forward(
        self,
        albedo: Float[Tensor, "surface channel"],
        emission: Float[Tensor, "surface channel"],
    ) -> Float[Tensor, "channel"]:
        """E in W/m2."""
        found = albedo[self.surface] * self.paint
        return balanced_irradiance(found, self.direct(emission), self.view, self.weight)


class ReflectedLight(nn.Module):
    """E by k bounces on patches, interpolated to every ray.

    Args:
        exchange: patches and their form factors.
        settings: bounces, and whether they are coloured.
        surface, paint: of the patches.
        emitter: the surface of each column of the patches' weights.
        patch, inside: which patch a ray lies in, and the weights of the patch's corners.
    """

    surface: Tensor
    paint: Tensor
    patch: Tensor
    inside: Tensor

    def __init__(
        self,
        exchange: Exchange,
        settings: RenderSettings,
        surface: Tensor,
        paint: Tensor,
        emitter: Tensor,
        patch: Tensor,
        inside: Tensor,
    ) -> None:
        super().__init__()
        self.exchange, self.settings = exchange, settings
        self.direct = DirectLight(exchange.weights, exchange.lamps, emitter)
        for name, value in (
            ("surface", surface),
            ("paint", paint),
            ("patch", patch),
            ("inside", inside),
        ):
            self.register_buffer(name, value.detach())

    def forward(
        self,
        albedo: Float[Tensor, "surface channel"],
        emission: Float[Tensor, "surface channel"],
    ) -> Float[Tensor, "ray channel"]:
        """E in W/m2."""
        found = albedo[self.surface] * self.paint
        values = reflected_irradiance(self.exchange, found, self.direct(emission), self.settings)
        return interpolate(values.values, self.exchange.welding.corner, self.patch, self.inside)


class PlannedShader(nn.Module):
    """The picture of one scene through one camera, as a function of its colours.

    Members that the plan left out do not exist: `reflected` and `ambient` are None.

    Args:
        scene: surfaces and sources.
        camera: who looks.
        settings: what was chosen.
        effects: names of what is included, for the printed form.
    """

    pixel: Tensor
    share: Tensor
    surface: Tensor
    paint: Tensor
    albedo: Tensor
    emission: Tensor

    def __init__(
        self,
        scene: Scene,
        camera: AbstractCamera,
        settings: RenderSettings,
        effects: tuple[str, ...] = (),
    ) -> None:
        super().__init__()
        self.effects = effects
        with torch.no_grad():
            view = view_scene(scene, camera, settings)
        self._take(view, scene)

    def _take(self, view: View, scene: Scene) -> None:
        world, samples, points = view.world, view.samples, view.samples.points
        surface = world.triangles.surface
        white = [replace(s, albedo=torch.ones_like(s.albedo)) for s in scene.surfaces]
        blank = replace(scene, surfaces=tuple(white))
        paint = blank.albedo_at(points.triangle, points.barycentric).double()
        patched = blank.triangles.albedo.double()
        self.size = view.size
        for name, value in (
            ("pixel", samples.pixel),
            ("share", samples.share),
            ("surface", surface[points.triangle]),
            ("paint", paint),
            ("albedo", torch.stack([s.albedo for s in scene.surfaces]).double()),
            ("emission", torch.stack([s.emission for s in scene.surfaces]).double()),
        ):
            self.register_buffer(name, value.detach())
        emitter = surface[world.emitters.triangle]
        self.direct = DirectLight(samples.weights, samples.lamps, emitter)
        self.ambient: AmbientLight | None = None
        self.reflected: ReflectedLight | None = None
        if view.ambient is not None:
            place = view.ambient.sample.triangle
            self.ambient = AmbientLight(view.ambient, surface[place], patched[place], emitter)
        if view.exchange is not None:
            exchange = view.exchange
            found = find(exchange.subdivision, points.face, points.on_face(world))
            place = exchange.triangle
            self.reflected = ReflectedLight(
                exchange, view.settings, surface[place], patched[place], emitter, *found
            )

    def forward(
        self,
        albedo: Float[Tensor, "surface channel"] | None = None,
        emission: Float[Tensor, "surface channel"] | None = None,
    ) -> Float[Tensor, "channel height width"]:
        """The picture, W/m2/sr.

        Args:
            albedo: of the surfaces, 0..1; None: the scene's.
            emission: of the surfaces that shone when the shader was made, W/m2/sr.

        Differentiable in: albedo, emission.
        Export: compile yes, ONNX yes (dense form factors).
        """
        paint = (self.albedo if albedo is None else albedo).to(self.albedo)
        light = (self.emission if emission is None else emission).to(self.emission)
        irradiance: Tensor = self.direct(light)
        if self.ambient is not None:
            irradiance = irradiance + self.ambient(paint, light)
        if self.reflected is not None:
            irradiance = irradiance + self.reflected(paint, light)
        reflected = paint[self.surface] * self.paint * irradiance / math.pi
        radiance = light[self.surface] + reflected
        return pixel_means(radiance, self.share, self.pixel, self.size).permute(2, 0, 1)

    def extra_repr(self) -> str:
        height, width = self.size
        return f"{width} x {height} pixels, {len(self.pixel)} rays, effects={list(self.effects)}"
