"""Shading of a depth map: local light, and as much of global light as is asked for.

    L = rho / pi (E_d V_d + E_s V_s + E_r) + specular lobe

E_d light with a direction, V_d its cast shadows; E_s light from everywhere, V_s the share of the
sky that is seen (E_s taken along the bent normal); E_r what the surface reflects onto itself. Each
can be left out, and what is left out is not computed; with all of them left out it is
`LambertianShading` (or `PhongShading`) of the map's normals.

References: the layers that it is made of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import OutOfRangeError, ShapeError, require_whole
from torchradiometry.geometry.depth import depth_to_normals, depth_to_points
from torchradiometry.geometry.image_space import checked_size, is_seen
from torchradiometry.materials.lobes import AbstractLobe
from torchradiometry.materials.phong import Phong
from torchradiometry.shade.ambient_occlusion import ambient_occlusion
from torchradiometry.shade.cast_shadow import cast_shadows
from torchradiometry.shade.interreflection import reflected_irradiance
from torchradiometry.shade.lambertian import check_channels, diffuse_radiance, image_irradiance
from torchradiometry.shade.layout import (
    check_image,
    chosen_sources,
    to_image,
    to_points,
    visibility_to_points,
)
from torchradiometry.shade.phong import specular_irradiance, view_directions
from torchradiometry.sources.base import AbstractSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["DepthSettings", "ShadeDepth"]


@dataclass(frozen=True)
class DepthSettings:
    """What a `ShadeDepth` computes.

    Attributes:
        cast_shadows: lights with a direction are hidden by the surface.
        shadow_width: angular radius of lights in radians, for shadows with gradients; None is hard.
        ambient_occlusion: light from everywhere is hidden by the surface.
        bounces: of light between parts of the surface.
        ambient_tail: what comes after them as one number; with bounces only.
        cells: rows and columns of the grid for bounces.
        azimuths: slices through each pixel, for occlusion and bounces.
        reach: pixels that occlusion looks far; None is across the map.
        specular: the lobe, where `specular` and `shininess` maps are passed.
    """

    cast_shadows: bool = True
    shadow_width: float | None = None
    ambient_occlusion: bool = True
    bounces: int = 1
    ambient_tail: bool = False
    cells: int = 16
    azimuths: int = 8
    reach: int | None = None
    specular: bool = True

    def __post_init__(self) -> None:
        for name, least in (("bounces", 0), ("cells", 2), ("azimuths", 4)):
            require_whole(name, getattr(self, name), least)
        if self.shadow_width is not None and not 0 < self.shadow_width < math.pi / 2:
            got = f"{self.shadow_width!r}"
            raise OutOfRangeError("shadow_width", got, "pass radians, 0 < width < pi/2, or None")


@final
class ShadeDepth(nn.Module):
    """Image layer: what a camera sees of a depth map under given lights.

    Args:
        settings: what is computed; `DepthPlanner` chooses them.
        sources: lights that belong to the layer, in the camera frame; None: pass them with each
            call.
        lobe: of the specular part: `Phong`, `NormalizedPhong`, `BlinnPhong` or `OriginalPhong`.
        pixel_size: side of a pixel of a parallel camera, m; None for a pinhole, whose `intrinsics`
            are then passed to `forward`.

    >>> from torchradiometry.sources.directional import DirectionalSource
    >>> layer = ShadeDepth(sources=DirectionalSource([0.0, 0.6, 0.8], [10.0]), pixel_size=0.1)
    >>> layer(torch.ones(1, 1, 4, 4), torch.full((1, 1, 4, 4), 0.5))[0, 0, 0]
    tensor([1.2732, 1.2732, 1.2732, 1.2732])
    """

    def __init__(
        self,
        settings: DepthSettings | None = None,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
        *,
        lobe: type[AbstractLobe] = Phong,
        pixel_size: float | None = None,
    ) -> None:
        super().__init__()
        self.settings = DepthSettings() if settings is None else settings
        self.lobe, self.pixel_size = lobe, checked_size(pixel_size)
        self.sources = nn.ModuleList([] if sources is None else chosen_sources([], sources))

    def forward(
        self,
        depth: Float[Tensor, "B 1 H W"],
        albedo: Float[Tensor, "B C H W"],
        intrinsics: Float[Tensor, "B 3 3"] | None = None,
        specular: Float[Tensor, "B C H W"] | None = None,
        shininess: Float[Tensor, "B 1 H W"] | None = None,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
    ) -> Float[Tensor, "B C H W"]:
        """Radiance `B C H W` in W/m2/sr.

        Args:
            depth: m along the viewing axis; NaN or infinite where nothing is seen (radiance 0).
            albedo: 0..1.
            intrinsics: `3 3` or `B 3 3` of a pinhole camera.
            specular: k_s as the lobe takes it; with `shininess`, or neither.
            shininess: n, >= 0.
            sources: where the constructor was given none.

        Raises:
            DTypeError: maps that are not floating-point, or sources of another dtype or device.
            ShapeError: wrong axes or sizes, one of `specular` and `shininess`, or both or neither
                of `intrinsics` and a pixel size.

        Differentiable in: depth (through hard shadows not at all), albedo, specular, shininess,
            the sources and the camera.
        Export: compile yes, ONNX yes; batch, height and width may stay dynamic, with a `reach`.
        """
        chosen = chosen_sources(self.sources, sources)
        if (specular is None) != (shininess is None):
            raise ShapeError("specular, shininess", "one of the two", "pass both or neither")
        normal = depth_to_normals(depth, intrinsics, self.pixel_size)
        check_image("albedo", albedo, None, normal)
        seen = is_seen(depth, self.pixel_size is None)
        albedo = torch.where(seen, albedo, 0)
        position = None
        if any(source.needs_position for source in chosen) or (
            self.pixel_size is None and specular is not None
        ):
            # normals are 0 where no point is, so any finite place will do
            held = torch.where(seen, depth, 1)
            position = depth_to_points(held, intrinsics, self.pixel_size)
        visibility = None
        if self.settings.cast_shadows and any(source.has_direction for source in chosen):
            width = self.settings.shadow_width
            visibility = cast_shadows(depth, chosen, intrinsics, self.pixel_size, width)
        received = self._direct(chosen, depth, normal, position, visibility, intrinsics)
        if self.settings.bounces:
            received = received + self._reflected(depth, albedo, received, normal, intrinsics)
        check_channels("albedo", albedo, received)
        radiance = diffuse_radiance(albedo, received)
        if specular is None or shininess is None or not self.settings.specular:
            return radiance
        check_image("specular", specular, None, normal)
        check_image("shininess", shininess, 1, normal)
        specular, shininess = (torch.where(seen, image, 0) for image in (specular, shininess))
        eye = view_directions(normal, position, perspective=self.pixel_size is None)
        highlight = specular_irradiance(
            self.lobe.brdf,
            to_points(shininess),
            chosen,
            None if position is None else to_points(position),
            to_points(normal),
            to_points(eye),
            visibility_to_points(visibility),
        )
        return radiance + specular * to_image(highlight, normal)

    def _direct(
        self,
        sources: Sequence[AbstractSource],
        depth: Tensor,
        normal: Tensor,
        position: Tensor | None,
        visibility: Tensor | None,
        intrinsics: Tensor | None,
    ) -> Tensor:
        """Irradiance by the sources, as far as they are seen."""
        domes = [source for source in sources if not source.has_direction]
        if not domes or not self.settings.ambient_occlusion:
            return image_irradiance(normal, sources, position, visibility)
        share, bent = ambient_occlusion(
            depth,
            intrinsics,
            self.pixel_size,
            normal,
            azimuths=self.settings.azimuths,
            reach=self.settings.reach,
        )
        received = share * image_irradiance(bent, domes)
        lights = [source for source in sources if source.has_direction]
        if not lights:
            return received
        if visibility is not None:
            each = zip(sources, visibility.split([s.lights for s in sources], 1), strict=True)
            visibility = torch.cat([v for source, v in each if source.has_direction], 1)
        return received + image_irradiance(normal, lights, position, visibility)

    def _reflected(
        self,
        depth: Tensor,
        albedo: Tensor,
        received: Tensor,
        normal: Tensor,
        intrinsics: Tensor | None,
    ) -> Tensor:
        settings = self.settings
        return reflected_irradiance(
            depth,
            albedo,
            received,
            intrinsics,
            self.pixel_size,
            normal,
            cells=(settings.cells, settings.cells),
            bounces=settings.bounces,
            tail=settings.ambient_tail,
            azimuths=settings.azimuths,
        )

    def extra_repr(self) -> str:
        return f"{self.settings}, lobe={self.lobe.__name__}, pixel_size={self.pixel_size} [m]"
