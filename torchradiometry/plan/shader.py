"""The shader of a plan: an `nn.Module` that holds what the plan chose, and runs nothing else.

    L(pixel) = sum over its rays of  share [ L_emitted + rho/pi (E_direct + E_reflected) + L_lobe ]

Geometry is done when the shader is made: what each ray meets, which part of the sources it sees,
how much patches see of each other, what lies in the lobes of shiny points. What is left is linear
algebra in the colours: a product for direct light, one number for ambient light, a series for
bounces. A convex body under a distant
lamp keeps one dot product a ray and no more.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor, nn

from torchradiometry.errors import ShapeError, require_floating
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.materials.phong import mean_lobe_reflectance
from torchradiometry.render.ambient import AmbientExchange, balanced_irradiance
from torchradiometry.render.indirect import Exchange, reflected_irradiance
from torchradiometry.render.lobes import Lobes
from torchradiometry.render.picture import View, view_scene
from torchradiometry.render.pixels import pixel_means
from torchradiometry.render.points import SurfacePoints
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.subdivision import find
from torchradiometry.render.world import World
from torchradiometry.scene.scene import Scene

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AmbientLight", "DirectLight", "LobeLight", "PlannedShader", "ReflectedLight"]


class Colours(NamedTuple):
    """What may change about a scene without changing what sees what.

    Attributes:
        albedo: of the surfaces.
        emission: W/m2/sr.
        even: what lobes add to the albedo in even light; None where there are none.
    """

    albedo: Float[Tensor, "surface channel"]
    emission: Float[Tensor, "surface channel"]
    even: Float[Tensor, "surface channel"] | None


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


class Painted(nn.Module):
    """What points of surfaces reflect of even light: albedo x texture, and their lobes.

    Args:
        surface: each point's.
        paint: texture there, 0..1.
    """

    surface: Tensor
    paint: Tensor

    def __init__(self, surface: Tensor, paint: Tensor) -> None:
        super().__init__()
        self.register_buffer("surface", surface.detach())
        self.register_buffer("paint", paint.detach())

    def forward(self, colours: Colours) -> Float[Tensor, "point channel"]:
        """0..1."""
        found = colours.albedo[self.surface] * self.paint
        return found if colours.even is None else found + colours.even[self.surface]


class AmbientLight(nn.Module):
    """One E for all points, from the balance of light between the surfaces.

    Args:
        exchange: what the balance takes from geometry.
        painted: its points.
        emitter: the surface of each column of its weights.
    """

    view: Tensor
    weight: Tensor

    def __init__(self, exchange: AmbientExchange, painted: Painted, emitter: Tensor) -> None:
        super().__init__()
        self.direct = DirectLight(exchange.weights, exchange.lamps, emitter)
        self.painted = painted
        self.register_buffer("view", exchange.sample.view.detach())
        self.register_buffer("weight", exchange.sample.weight.detach())

    def forward(self, colours: Colours) -> Float[Tensor, "channel"]:
        """E in W/m2."""
        direct = self.direct(colours.emission)
        return balanced_irradiance(self.painted(colours), direct, self.view, self.weight)


class ReflectedLight(nn.Module):
    """E by k bounces on the vertices of patches.

    Args:
        exchange: patches and their form factors.
        settings: bounces, and whether they are coloured.
        painted: the patches.
        emitter: the surface of each column of the patches' weights.
    """

    def __init__(
        self, exchange: Exchange, settings: RenderSettings, painted: Painted, emitter: Tensor
    ) -> None:
        super().__init__()
        self.exchange, self.settings = exchange, settings
        self.direct = DirectLight(exchange.weights, exchange.lamps, emitter)
        self.painted = painted

    def forward(self, colours: Colours) -> Float[Tensor, "vertex channel"]:
        """E in W/m2."""
        direct = self.direct(colours.emission)
        found = self.painted(colours)
        return reflected_irradiance(self.exchange, found, direct, self.settings).values


class Interpolation(nn.Module):
    """From the vertices of patches to points.

    Args:
        exchange: the patches.
        world: whose faces they are parts of.
        points: on those faces.
    """

    corner: Tensor
    inside: Tensor

    def __init__(self, exchange: Exchange, world: World, points: SurfacePoints) -> None:
        super().__init__()
        patch, inside = find(exchange.subdivision, points.face, points.on_face(world))
        self.register_buffer("corner", exchange.welding.corner[patch].detach())
        self.register_buffer("inside", inside.detach())

    def forward(self, values: Float[Tensor, "vertex channel"]) -> Float[Tensor, "ray channel"]:
        """The same quantity on the points."""
        return (values[self.corner] * self.inside.unsqueeze(-1)).sum(1)


class LobeLight(nn.Module):
    """What shiny points show of sources and of surfaces, for k_s = 1.

    Args:
        lobes: what their rays see.
        painted: the points that are seen.
        emitter: the surface of each column of their weights.
        place: reflected light on the points that are seen; None if there is none on patches.
    """

    owner: Tensor
    share: Tensor

    def __init__(
        self, lobes: Lobes, painted: Painted, emitter: Tensor, place: Interpolation | None
    ) -> None:
        super().__init__()
        self.shown = DirectLight(lobes.weights, lobes.lamps, emitter)
        self.direct = DirectLight(lobes.seen_weights, lobes.seen_lamps, emitter)
        self.painted, self.place = painted, place
        self.register_buffer("owner", lobes.owner.detach())
        self.register_buffer("share", lobes.share.detach())

    def forward(self, colours: Colours, reflected: Tensor | None) -> Float[Tensor, "shiny channel"]:
        """Radiance in W/m2/sr; `reflected` is E on vertices, or everywhere, W/m2."""
        irradiance: Tensor = self.direct(colours.emission)
        if reflected is not None:
            irradiance = irradiance + (reflected if self.place is None else self.place(reflected))
        radiance = self.painted(colours) * irradiance / math.pi
        shown: Tensor = self.shown(colours.emission)
        return shown.index_add(0, self.owner, self.share.unsqueeze(-1) * radiance)


class PlannedShader(nn.Module):
    """The picture of one scene through one camera, as a function of its colours.

    Members that the plan left out do not exist: `reflected`, `ambient` and `lobes` are None.

    Args:
        scene: surfaces and sources.
        camera: who looks.
        settings: what was chosen.
        effects: names of what is included, for the printed form.
    """

    pixel: Tensor
    share: Tensor
    shiny: Tensor
    albedo: Tensor
    emission: Tensor
    specular: Tensor
    lobe: Tensor

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
            self._take(view_scene(scene, camera, settings), scene)

    def _take(self, view: View, scene: Scene) -> None:
        world, samples, points = view.world, view.samples, view.samples.points
        surface, surfaces = world.triangles.surface, scene.surfaces
        white = replace(
            scene, surfaces=tuple(replace(s, albedo=torch.ones_like(s.albedo)) for s in surfaces)
        )
        shininess = torch.stack([s.shininess for s in surfaces]).double().unsqueeze(-1)
        self.size = view.size
        self.has_lobes = any(s.glossy for s in surfaces)
        for name, value in (
            ("pixel", samples.pixel),
            ("share", samples.share),
            ("shiny", samples.pixel[:0] if view.lobes is None else view.lobes.point),
            ("albedo", _table(scene, [s.albedo for s in surfaces])),
            ("emission", _table(scene, [s.emission for s in surfaces])),
            ("specular", _table(scene, [s.specular for s in surfaces])),
            ("lobe", mean_lobe_reflectance(shininess)),
        ):
            self.register_buffer(name, value.detach())

        def painted(points: SurfacePoints) -> Painted:
            paint = white.albedo_at(points.triangle, points.barycentric).double()
            return Painted(surface[points.triangle], paint)

        patched, emitter = white.triangles.albedo.double(), surface[world.emitters.triangle]
        self.painted = painted(points)
        self.direct = DirectLight(samples.weights, samples.lamps, emitter)
        self.ambient: AmbientLight | None = None
        self.reflected: ReflectedLight | None = None
        self.place: Interpolation | None = None
        self.lobes: LobeLight | None = None
        if view.ambient is not None:
            place = view.ambient.sample.triangle
            self.ambient = AmbientLight(
                view.ambient, Painted(surface[place], patched[place]), emitter
            )
        if view.exchange is not None:
            place = view.exchange.triangle
            patches = Painted(surface[place], patched[place])
            self.reflected = ReflectedLight(view.exchange, view.settings, patches, emitter)
            self.place = Interpolation(view.exchange, world, points)
        if view.lobes is not None:
            seen, inside = view.lobes.seen, None
            if view.exchange is not None:
                inside = Interpolation(view.exchange, world, seen)
            self.lobes = LobeLight(view.lobes, painted(seen), emitter, inside)

    def forward(
        self,
        albedo: Float[Tensor, "surface channel"] | None = None,
        emission: Float[Tensor, "surface channel"] | None = None,
        specular: Float[Tensor, "surface channel"] | None = None,
    ) -> Float[Tensor, "channel height width"]:
        """The picture, W/m2/sr.

        Args:
            albedo: of the surfaces, 0..1; None: the scene's.
            emission: of the surfaces that shone when the shader was made, W/m2/sr.
            specular: of those that were shiny, 0..1.

        Raises:
            DTypeError, ShapeError: colours that are not real numbers, or not one row a surface.

        Differentiable in: albedo, emission, specular.
        Export: compile yes, ONNX yes (dense form factors).
        """
        paint = _given("albedo", albedo, self.albedo)
        light = _given("emission", emission, self.emission)
        gloss = _given("specular", specular, self.specular)
        colours = Colours(paint, light, gloss * self.lobe if self.has_lobes else None)
        surface = self.painted.surface
        irradiance: Tensor = self.direct(light)
        reflected: Tensor | None = None
        if self.ambient is not None:
            reflected = self.ambient(colours)
            irradiance = irradiance + reflected
        if self.reflected is not None and self.place is not None:
            reflected = self.reflected(colours)
            irradiance = irradiance + self.place(reflected)
        radiance = light[surface] + paint[surface] * self.painted.paint * irradiance / math.pi
        if self.lobes is not None:
            shown = gloss[surface[self.shiny]] * self.lobes(colours, reflected)
            radiance = radiance.index_add(0, self.shiny, shown)
        return pixel_means(radiance, self.share, self.pixel, self.size).permute(2, 0, 1)

    def extra_repr(self) -> str:
        height, width = self.size
        return f"{width} x {height} pixels, {len(self.pixel)} rays, effects={list(self.effects)}"


def _given(name: str, colours: Tensor | None, own: Tensor) -> Tensor:
    """Colours of the surfaces, the shader's own if none are given."""
    if colours is None:
        return own
    require_floating(name, colours)
    if colours.ndim != 2 or len(colours) != len(own) or colours.shape[1] not in (1, own.shape[1]):
        got = f"shape {tuple(colours.shape)}"
        raise ShapeError(name, got, f"pass `{len(own)} surfaces x {own.shape[1]} channels`")
    return colours.to(own)


def _table(scene: Scene, colours: list[Tensor]) -> Float[Tensor, "surface channel"]:
    return torch.stack([colour.expand(scene.channels) for colour in colours]).double()
