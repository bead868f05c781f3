"""Training images for shape from shading: one photograph of one shape.

    L = (f_d + f_s) (sum over two lamps l of  E_l mu_l V_l)
        + albedo/pi (sum over l of  R_l  +  V_sky' E_sh(n))

A Blinn-Phong surface (`PhongShading`) under two of its shape's lamps, near or distant, with their
shadows V_l and bounces R_l, and in natural light: E_sh is its irradiance (nine spherical
harmonics). Lamps in a dark room, lamps in a lit one, and natural light alone occur. All further
bounces are geometric series in the object's mean albedo r, with the share 1 - V_sky of a bounce
that meets the object again:

    R_l = r E_1l / (1 - r (1 - V_sky)),    V_sky' = V_sky / (1 - r (1 - V_sky)).

The albedo is painted: a few colours with sharp borders, and stains. Colour tells paint from
shading: a border between colours bends no surface, and shading has one colour.

A shape, its lamps and what it sees of them are made once (`lit_shapes`) and photographed many
times, turned, mirrored, and with new paint, lights and camera.

References: B. K. P. Horn, "Obtaining shape from shading information" (1975); J. T. Barron and
J. Malik, "Shape, illumination, and reflectance from shading", TPAMI 2015 (single images); R.
Grosse et al., "Ground truth dataset and baseline evaluations for intrinsic image algorithms",
ICCV 2009 (painted objects); A. J. Stewart and M. S. Langer, "Towards accurate recovery of shape
from shading under diffuse lighting", TPAMI 19 (1997) (bounces in what sees less of the sky).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.learn.samples.lit_shapes import ShapeBank, light_shapes, places, turned_shapes
from torchradiometry.learn.samples.shapes import FAMILIES, height_to_normals, random_shapes
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.numerics import guarded_divide
from torchradiometry.shade.lambertian import LambertianShading
from torchradiometry.shade.phong import PhongShading
from torchradiometry.sources.harmonics import HarmonicSource
from torchradiometry.sources.point import PointSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["SingleImages", "photograph", "photograph_shapes"]

#: a relief fills the image and has no outline
OBJECTS = tuple(family for family in FAMILIES if family != "reliefs")
#: shares of images of one colour, without lamps, and with highlights
PLAIN, NATURAL, GLOSSY = 0.25, 0.25, 0.4


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


def photograph_shapes(
    images: int,
    size: int,
    generator: torch.Generator,
    shadows: bool = True,
    indirect: bool = True,
) -> SingleImages:
    """`images` new random shapes, each under its own light, photographed.

    Args:
        images: how many.
        size: pixels along an edge.
        generator: the source of chance.
        shadows: let lamps and sky be hidden.
        indirect: let surfaces light each other.
    """
    bank = light_shapes(random_shapes(images, size, generator, OBJECTS), generator)
    return photograph(bank, generator, shadows, indirect)


def photograph(
    bank: ShapeBank, generator: torch.Generator, shadows: bool = True, indirect: bool = True
) -> SingleImages:
    """One photograph of every shape of a bank; see `photograph_shapes`."""
    bank = turned_shapes(bank, generator)
    images, size = len(bank.height), bank.height.shape[-1]
    mask = bank.mask.unsqueeze(1).float()
    normal = height_to_normals(bank.height) * mask
    kept = torch.rand(images, bank.lamp.shape[1], generator=generator).argsort(1)[:, :2]
    which = torch.arange(images).unsqueeze(1)
    seen, sky = bank.visibility[which, kept].float(), bank.sky.unsqueeze(1)
    albedo = _painted(images, size, generator)
    around = guarded_divide(
        (albedo * mask).sum((-2, -1), keepdim=True), mask.sum((-2, -1), keepdim=True)
    )
    again = 1 / (1 - around * (1 - sky))
    light = Light(
        bank.lamp[which, kept],
        seen if shadows else torch.ones_like(seen),
        bank.bounce[which, kept].float().unsqueeze(2) * (around * again).unsqueeze(1) * indirect,
        (sky if shadows else torch.ones_like(sky)) * (again if indirect else 1),
    )
    radiance = _shaded(normal, places(bank.height), albedo, light, generator) * mask
    made = (_exposed(radiance, mask, generator), mask, normal, albedo * mask)
    return SingleImages(*(part.contiguous() for part in made))


class Light(NamedTuple):
    """What reaches each pixel of a photograph.

    Attributes:
        lamp: places of the lamps, pixels.
        seen: share of each lamp.
        sent: irradiance from other parts of the object, per unit of the lamp's in the middle.
        sky: share of natural light, with its bounces.
    """

    lamp: Float[Tensor, "B lamp 3"]
    seen: Float[Tensor, "B lamp H W"]
    sent: Float[Tensor, "B lamp 3 H W"]
    sky: Float[Tensor, "B 3 H W"]


def _shaded(
    normal: Tensor, points: Tensor, albedo: Tensor, light: Light, generator: torch.Generator
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
    shininess = (2 ** uniform(2, 8, 1, 1, 1)).expand_as(albedo[:, :1])
    far = light.lamp.square().sum(-1, keepdim=True)
    lamps = PhongShading(BlinnPhong, PointSource(light.lamp, power * far))
    to_camera = normal.new_tensor([0.0, 0.0, 1.0]).reshape(1, 3, 1, 1).expand_as(normal)
    surface = (normal, albedo, gloss.expand_as(albedo), shininess)
    lit = lamps(*surface, None, points, light.seen, to_camera)
    sent = (light.sent * power[..., None, None]).sum(1)
    around = HarmonicSource((_environment(images, generator) * strength * tint[:, 2:]).unsqueeze(1))
    sky = LambertianShading(around)(normal, albedo) * light.sky
    return lit + albedo / math.pi * sent + sky


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
    fields = torch.cat([_smooth_noise(images, colours, size, (k, k), generator) for k in (4, 9)], 1)
    mix = uniform(0, 1, 1, 1, 1)
    level = mix * fields[:, :colours] + (1 - mix) * fields[:, colours:]
    absent = torch.arange(colours).reshape(1, -1, 1, 1) >= count
    sharp = 2 ** uniform(2, 6, 1, 1, 1)
    share = torch.softmax(torch.where(absent, -torch.inf, level) * sharp, 1)
    paint = torch.einsum("bkhw,bkc->bchw", share, palette)
    stains = torch.exp(
        _smooth_noise(images, 1, size, (16, 16), generator)
        * uniform(-0.05, 0.12, 1, 1, 1).clamp(min=0)
    )
    return (paint * stains).clamp(0.02, 0.95)


def _smooth_noise(
    images: int, fields: int, size: int, cells: tuple[int, int], generator: torch.Generator
) -> Tensor:
    """Noise of a few rows and columns of cells, standard deviation about 1."""
    coarse = torch.randn(images, fields, *cells, generator=generator)
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
