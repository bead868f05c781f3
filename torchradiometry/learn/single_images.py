"""Training images for shape from shading: one photograph of one shape.

    L = PhongShading(albedo, highlight; a key light with cast shadow, a weaker fill)
        + AmbientShading(dome)

The albedo is one grey per object with gentle stains: with any albedo allowed, one image says
nothing about shape.

References: B. K. P. Horn, "Obtaining shape from shading information" (1975); J. T. Barron and
J. Malik, "Shape, illumination, and reflectance from shading", TPAMI 2015 (single images).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.learn.geometry_bank import random_lights
from torchradiometry.learn.shapes import random_shapes
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.shade.ambient import AmbientShading
from torchradiometry.shade.phong import PhongShading
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.transport.height_field import height_field_visibility

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["SingleImages", "photograph_shapes"]


#: a relief fills the image and has no outline
OBJECTS = ("blobs", "ellipsoids", "carved")


class SingleImages(NamedTuple):
    """One training batch of the shading network.

    Attributes:
        luminance: linear, 0..1 after exposure.
        mask: 1 on the object.
        normal: unit, the answer.
    """

    luminance: Float[Tensor, "B 1 H W"]
    mask: Float[Tensor, "B 1 H W"]
    normal: Float[Tensor, "B 3 H W"]


def photograph_shapes(
    images: int, size: int, generator: torch.Generator, shadows: bool = True
) -> SingleImages:
    """`images` random shapes, each under its own light, photographed.

    Args:
        images: how many.
        size: pixels along an edge.
        generator: the source of chance.
        shadows: let the key light cast shadows.
    """
    shapes = random_shapes(images, size, generator, OBJECTS)
    light = torch.stack([random_lights(2, generator) for _ in range(images)])
    mask = shapes.mask.unsqueeze(1).float()
    seen = torch.ones(images, 2, size, size)
    if shadows:
        seen[:, :1] = height_field_visibility(shapes.height, light[:, :1]).transpose(0, 1)
    radiance = _shaded(shapes.normal, light, seen, generator) * mask
    return SingleImages(_exposed(radiance, generator), mask, shapes.normal * mask)


def _shaded(
    normal: Tensor, light: Tensor, seen: Tensor, generator: torch.Generator
) -> Float[Tensor, "B 1 H W"]:
    images = len(normal)

    def uniform(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(images, 1, 1, 1, generator=generator)

    power = torch.cat([torch.ones(images, 1), uniform(0, 0.5).reshape(images, 1)], 1)
    stains = _smooth_noise(images, normal.shape[-1], generator) * uniform(0, 0.15)
    albedo = (uniform(0.2, 0.8) * (1 + stains)).clamp(0.02, 0.95)
    gloss = uniform(-0.3, 0.3).clamp(min=0) * torch.ones_like(albedo)
    shininess = (2 ** uniform(2, 7)).expand_as(albedo)
    camera = PhongShading(BlinnPhong, DirectionalSource(light, power.unsqueeze(-1)))
    ambient = AmbientShading()(albedo, radiance=uniform(0, 0.1).reshape(images, 1))
    return camera(normal, albedo, gloss, shininess, visibility=seen) + ambient


def _smooth_noise(images: int, size: int, generator: torch.Generator) -> Tensor:
    """Noise of a few grid cells across, standard deviation about 1."""
    coarse = torch.randn(images, 1, 6, 6, generator=generator)
    return torch.nn.functional.interpolate(coarse, size=(size, size), mode="bicubic")


def _exposed(radiance: Tensor, generator: torch.Generator) -> Tensor:
    """Scaled to 0..1, with a little noise."""
    brightest = radiance.amax((-2, -1), keepdim=True)
    exposed = radiance / torch.where(brightest > 0, brightest, 1)
    noise = 0.01 * torch.randn(exposed.shape, generator=generator)
    return (exposed * (1 + noise)).clamp(0, 1)
