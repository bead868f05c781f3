"""Training images for shape from shading: one photograph of one shape.

    L = PhongShading(albedo, highlight; a key light with its cast shadow, a weaker fill)
        + albedo/pi V_sky E_sh(n)

E_sh is the irradiance of natural light (nine spherical harmonics), V_sky the share of the sky that
a pixel sees (`AmbientOcclusion`). Lamps in a dark room, lamps in a lit one, and natural light alone
occur. The albedo is painted: a few colours with sharp borders, and stains. Colour tells paint
from shading: a border between colours bends no surface, and shading has one colour.

A shape and what it sees of the sky are made once (`ShapeBank`) and photographed many times, turned,
mirrored, and with new paint, lights and camera.

References: B. K. P. Horn, "Obtaining shape from shading information" (1975); J. T. Barron and
J. Malik, "Shape, illumination, and reflectance from shading", TPAMI 2015 (single images); R.
Grosse et al., "Ground truth dataset and baseline evaluations for intrinsic image algorithms",
ICCV 2009 (painted objects).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.learn.geometry_bank import random_lights
from torchradiometry.learn.shapes import FAMILIES, Shapes, height_to_normals, random_shapes
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.shade.ambient_occlusion import AmbientOcclusion
from torchradiometry.shade.lambertian import LambertianShading
from torchradiometry.shade.phong import PhongShading
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.harmonics import HarmonicSource
from torchradiometry.transport.height_field import height_field_visibility

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["ShapeBank", "SingleImages", "photograph", "photograph_shapes", "shape_bank"]

#: a relief fills the image and has no outline
OBJECTS = tuple(family for family in FAMILIES if family != "reliefs")
#: shares of images of one colour, without lamps, and with highlights
PLAIN, NATURAL, GLOSSY = 0.25, 0.3, 0.4


class ShapeBank(NamedTuple):
    """Shapes and what they see of the sky.

    Attributes:
        height: pixels, towards the camera.
        mask: True on the object.
        sky: share of the sky that is seen, weighted by the cosine, 0..1.
    """

    height: Float[Tensor, "shape H W"]
    mask: Bool[Tensor, "shape H W"]
    sky: Float[Tensor, "shape H W"]


class SingleImages(NamedTuple):
    """One training batch of the shading network.

    Attributes:
        image: linear, 0..1 after exposure.
        mask: 1 on the object.
        normal: unit, the answer.
        albedo: the paint, 0..1.
    """

    image: Float[Tensor, "B 3 H W"]
    mask: Float[Tensor, "B 1 H W"]
    normal: Float[Tensor, "B 3 H W"]
    albedo: Float[Tensor, "B 3 H W"]


def shape_bank(shapes: Shapes) -> ShapeBank:
    """What the shapes see of the sky, by `AmbientOcclusion`."""
    depth = torch.where(shapes.mask, -shapes.height, torch.nan).unsqueeze(1)
    sky, _ = AmbientOcclusion(azimuths=8, pixel_size=1.0)(depth)
    return ShapeBank(shapes.height, shapes.mask, sky.squeeze(1))


def photograph_shapes(
    images: int, size: int, generator: torch.Generator, shadows: bool = True
) -> SingleImages:
    """`images` new random shapes, each under its own light, photographed.

    Args:
        images: how many.
        size: pixels along an edge.
        generator: the source of chance.
        shadows: let the key light and the sky be hidden.
    """
    bank = shape_bank(random_shapes(images, size, generator, OBJECTS))
    return photograph(bank, generator, shadows)


def photograph(bank: ShapeBank, generator: torch.Generator, shadows: bool = True) -> SingleImages:
    """One photograph of every shape of a bank; see `photograph_shapes`."""
    bank = _turned(bank, generator)
    images, size = len(bank.height), bank.height.shape[-1]
    mask = bank.mask.unsqueeze(1).float()
    normal = height_to_normals(bank.height) * mask
    light = torch.stack([random_lights(2, generator) for _ in range(images)])
    seen, sky = torch.ones(images, 2, size, size), torch.ones(images, 1, size, size)
    if shadows:
        seen[:, :1] = height_field_visibility(bank.height, light[:, :1]).transpose(0, 1)
        sky = bank.sky.unsqueeze(1)
    albedo = _painted(images, size, generator)
    radiance = _shaded(normal, albedo, light, seen, sky, generator) * mask
    made = (_exposed(radiance, mask, generator), mask, normal, albedo * mask)
    return SingleImages(*(part.contiguous() for part in made))


def _turned(bank: ShapeBank, generator: torch.Generator) -> ShapeBank:
    """Every shape by the same multiple of 90 degrees, mirrored or not."""
    turn = int(torch.randint(0, 4, (), generator=generator))
    mirror = bool(torch.randint(0, 2, (), generator=generator))
    parts = [torch.rot90(part, turn, (-2, -1)) for part in bank]
    return ShapeBank(*(part.flip(-1) if mirror else part for part in parts))


def _shaded(
    normal: Tensor,
    albedo: Tensor,
    light: Tensor,
    seen: Tensor,
    sky: Tensor,
    generator: torch.Generator,
) -> Float[Tensor, "B 3 H W"]:
    images = len(normal)

    def uniform(low: float, high: float, *size: int) -> Tensor:
        return low + (high - low) * torch.rand(images, *size, generator=generator)

    tint = 1 + 0.15 * torch.randn(images, 3, 3, generator=generator).clamp(-2, 2)
    natural = uniform(0, 1, 1, 1) < NATURAL
    power = torch.cat([torch.ones(images, 1, 1), uniform(-0.3, 0.4, 1, 1).clamp(min=0)], 1)
    power = torch.where(natural, 0, power) * tint[:, :2]
    strength = torch.where(natural, 1, uniform(-0.1, 0.3, 1, 1).clamp(min=0))
    gloss = torch.where(uniform(0, 1, 1, 1, 1) < GLOSSY, uniform(0.02, 0.25, 1, 1, 1), 0)
    shininess = (2 ** uniform(2, 8, 1, 1, 1)).expand_as(sky)
    lamps = PhongShading(BlinnPhong, DirectionalSource(light, power))
    lit = lamps(normal, albedo, gloss.expand_as(albedo), shininess, visibility=seen)
    around = HarmonicSource((_environment(images, generator) * strength * tint[:, 2:]).unsqueeze(1))
    return lit + LambertianShading(around)(normal, albedo) * sky


def _environment(images: int, generator: torch.Generator) -> Float[Tensor, "B 9 1"]:
    """Natural light: irradiance of about 1, brighter from one side, mostly from above."""
    order = torch.tensor([0.0, 1, 1, 1, 2, 2, 2, 2, 2]).reshape(9, 1)
    spread = 0.9 / (1 + order) ** 1.2
    found = torch.randn(images, 9, 1, generator=generator) * spread
    found[:, :1] = 1
    found[:, 1] += 0.3
    return found * math.sqrt(4 * math.pi) / math.pi / 3


def _painted(images: int, size: int, generator: torch.Generator) -> Float[Tensor, "B 3 H W"]:
    """Albedo: up to five colours in patches, stained; a quarter of the images has one colour."""
    colours = 5

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(images, *shape, generator=generator)

    grey = 2 ** uniform(-3, 0, colours, 1)
    vivid = torch.randn(images, colours, 3, generator=generator) * uniform(0, 0.8, 1, 1)
    palette = grey * torch.exp(vivid - vivid.mean(-1, keepdim=True))
    count = 1 + torch.floor(uniform(0, colours, 1))
    count = torch.where(uniform(0, 1, 1) < PLAIN, 1, count).reshape(-1, 1, 1, 1)
    fields = torch.cat([_smooth_noise(images, colours, size, k, generator) for k in (4, 9)], 1)
    mix = uniform(0, 1, 1, 1, 1)
    level = mix * fields[:, :colours] + (1 - mix) * fields[:, colours:]
    absent = torch.arange(colours).reshape(1, -1, 1, 1) >= count
    sharp = 2 ** uniform(2, 6, 1, 1, 1)
    share = torch.softmax(torch.where(absent, -torch.inf, level) * sharp, 1)
    paint = torch.einsum("bkhw,bkc->bchw", share, palette)
    stains = torch.exp(
        _smooth_noise(images, 1, size, 16, generator) * uniform(-0.05, 0.12, 1, 1, 1).clamp(min=0)
    )
    return (paint * stains).clamp(0.02, 0.95)


def _smooth_noise(
    images: int, fields: int, size: int, cells: int, generator: torch.Generator
) -> Tensor:
    """Noise of a few grid cells across, standard deviation about 1."""
    coarse = torch.randn(images, fields, cells, cells, generator=generator)
    return torch.nn.functional.interpolate(coarse, size=(size, size), mode="bicubic")


def _exposed(radiance: Tensor, mask: Tensor, generator: torch.Generator) -> Tensor:
    """Most of it scaled into 0..1, the brightest cut off, with a little noise."""
    images = len(radiance)
    inside = torch.where(mask > 0, radiance, torch.nan).flatten(1)
    bright = torch.nanquantile(inside, 0.98, dim=1)
    bright = torch.where(bright > 0, bright, 1)  # also where nothing is seen
    stops = torch.rand(images, generator=generator) - 0.8
    exposed = radiance * (2**stops / bright).reshape(-1, 1, 1, 1)
    noise = torch.randn(exposed.shape, generator=generator) * 0.01
    return (exposed * (1 + noise)).clamp(0, 1)
