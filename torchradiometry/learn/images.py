"""Training images: surfaces of a bank, shaded by the package's own layers, seen by a camera.

    L = PhongShading(rho; Blinn, k_1, n_1) + PhongShading(0; k_2, n_2) + AmbientShading(E_ind/pi)

under one distant light at a time, with the bank's shadows. The indirect irradiance is the
bank's single bounce E_1 times the series of further bounces between neighbours of albedo rho,

    E_ind = rho E_1 (1 + a rho + (a rho)^2 + ...) = rho E_1 / (1 - a rho),

with a the share of a bounce that hits a neighbour again (1 - openness).

The camera then counts photons: each colour of light i has its own intensity g, a count is

    v = floor(256 x g L) + noise, clipped to 0..255,     L~ = (v + 1/2) / (256 x g),

and luminance is 0.2989 R + 0.5870 G + 0.1140 B of the L~, as in `deploy.photographs`.

References: J. R. Janesick, *Photon Transfer* (2007), chapter 2 (shot and read noise).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.learn.geometry_bank import SurfaceBank
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.materials.phong import NormalizedPhong
from torchradiometry.numerics import safe_normalize
from torchradiometry.shade.ambient import AmbientShading
from torchradiometry.shade.phong import PhongShading
from torchradiometry.sources.directional import DirectionalSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Materials", "Observations", "expose", "observe", "random_materials", "shade"]

LUMINANCE = (0.2989, 0.5870, 0.1140)
#: standard deviation of each component of a calibrated light direction, about half a degree
CALIBRATION_ERROR = 0.007


class Materials(NamedTuple):
    """What each pixel is made of; all `shape pixel`.

    Attributes:
        albedo: diffuse, 0..1.
        specular: reflectance of the two highlights at normal incidence, `shape pixel 2`.
        shininess: their exponents, `shape pixel 2`.
        surround: albedo of what faces the pixel, 0..1.
    """

    albedo: Float[Tensor, "shape pixel"]
    specular: Float[Tensor, "shape pixel 2"]
    shininess: Float[Tensor, "shape pixel 2"]
    surround: Float[Tensor, "shape pixel"]


class Observations(NamedTuple):
    """One training batch of the photometric network.

    Attributes:
        intensity: luminance per unit of light, as a camera would give it.
        direction: unit, to the lights, as a calibration would give it.
        normal: unit, the answer.
    """

    intensity: Float[Tensor, "shape pixel light"]
    direction: Float[Tensor, "shape light 3"]
    normal: Float[Tensor, "shape pixel 3"]


def random_materials(shapes: int, pixels: int, generator: torch.Generator) -> Materials:
    """Matt to glossy surfaces with an albedo that varies from pixel to pixel."""

    def uniform(*size: int) -> Tensor:
        return torch.rand(size, generator=generator)

    base = 0.1 + 0.85 * uniform(shapes, 1)
    albedo = (base * (1 + 0.6 * (uniform(shapes, pixels) - 0.5))).clamp(0.02, 0.95)
    gloss = uniform(shapes, 1, 2) ** 2 * torch.tensor([0.5, 0.7])
    present = (uniform(shapes, 1, 2) < torch.tensor([0.7, 0.5])).float()
    specular = gloss * present * (0.5 + 0.5 * uniform(shapes, pixels, 1))
    exponent = torch.tensor([2.0, 0.0]) + torch.tensor([6.0, 4.0]) * uniform(shapes, 1, 2)
    jitter = uniform(shapes, pixels, 2) - 0.5
    albedo = albedo * (1 - specular.sum(-1)).clamp(0.03, 1)
    return Materials(
        albedo, specular, 2 ** (exponent + jitter).clamp(min=0), base.expand_as(albedo)
    )


def shade(bank: SurfaceBank, materials: Materials) -> Float[Tensor, "shape pixel light"]:
    """Radiance of each pixel under each light of unit irradiance, times pi; by the layers.

    Each light of each shape is one image of the layers' batch, `pixel` high and 1 wide.
    """
    shapes, pixels, lights = bank.visibility.shape

    def image(values: Tensor) -> Tensor:
        """`shape pixel k` (for every light) as `shape*light k pixel 1`."""
        lifted = values.transpose(1, 2).unsqueeze(1).expand(-1, lights, -1, -1)
        return lifted.flatten(0, 1).unsqueeze(-1)

    def per_light(values: Tensor) -> Tensor:
        """`shape pixel light` as `shape*light 1 pixel 1`."""
        return values.transpose(1, 2).reshape(shapes * lights, 1, pixels, 1)

    light = DirectionalSource(bank.direction.reshape(-1, 1, 3), torch.ones(shapes * lights, 1, 1))
    normal, seen = image(bank.normal), per_light(bank.visibility)
    albedo = image(materials.albedo.unsqueeze(-1))
    specular, shininess = image(materials.specular), image(materials.shininess)
    glossy, dull = PhongShading(BlinnPhong, light), PhongShading(NormalizedPhong, light)
    radiance = glossy(normal, albedo, specular[:, :1], shininess[:, :1], visibility=seen)
    nothing = torch.zeros_like(albedo)
    sheen = dull(normal, nothing, specular[:, 1:], shininess[:, 1:], visibility=seen)
    bounced = AmbientShading()(albedo, radiance=per_light(_indirect(bank, materials)) / math.pi)
    total = radiance + sheen + bounced
    return math.pi * total.reshape(shapes, lights, pixels).transpose(1, 2)


def _indirect(bank: SurfaceBank, materials: Materials) -> Float[Tensor, "shape pixel light"]:
    """E_ind = rho E_1 / (1 - a rho)."""
    surround = materials.surround.unsqueeze(-1)
    again = (1 - bank.openness).unsqueeze(-1) * surround
    return bank.indirect * surround / (1 - again)


def expose(
    radiance: Float[Tensor, "shape pixel light"], generator: torch.Generator
) -> Float[Tensor, "shape pixel light"]:
    """Luminance that an 8-bit colour camera reports for this radiance.

    Intensities of the lights, colour of the surface, exposure and noise are drawn at random;
    the darkest exposures put the brightest pixels at 6 of 256 counts.
    """

    def uniform(low: float, high: float, *size: int) -> Tensor:
        return low + (high - low) * torch.rand(size, generator=generator)

    shapes, pixels, lights = radiance.shape
    gain = 2 ** uniform(-1, 1, shapes, 1, lights, 3)
    colour = uniform(0.3, 1, shapes, pixels, 1, 3)
    bright = torch.quantile(radiance.flatten(1), 0.98, dim=1).clamp(min=1e-3)
    exposure = 2 ** uniform(-5.4, -0.3, shapes) / bright
    signal = radiance.unsqueeze(-1) * colour * exposure.reshape(-1, 1, 1, 1)
    noise = torch.randn(signal.shape, generator=generator) * uniform(0, 0.01, shapes, 1, 1, 1)
    counts = torch.floor(256 * gain * signal * (1 + noise)).clamp(0, 255)
    reported = (counts + 0.5) / (256 * gain * exposure.reshape(-1, 1, 1, 1))
    return reported @ torch.tensor(LUMINANCE)


def observe(
    bank: SurfaceBank,
    lights: int,
    generator: torch.Generator,
    shadows: bool = True,
    indirect: bool = True,
) -> Observations:
    """A training batch: new materials, some of each shape's lights, a turn about z, a camera.

    Args:
        bank: surfaces, as drawn from a larger bank.
        lights: how many of each shape's lights to use.
        generator: the source of chance.
        shadows: keep cast shadows.
        indirect: keep indirect light.
    """
    shapes, pixels, available = bank.visibility.shape
    kept = torch.rand(shapes, available, generator=generator).argsort(1)[:, :lights]
    each = kept.unsqueeze(1).expand(-1, pixels, -1)
    part = SurfaceBank(
        bank.normal,
        bank.visibility.gather(2, each) if shadows else torch.ones(shapes, pixels, lights),
        bank.indirect.gather(2, each) if indirect else torch.zeros(shapes, pixels, lights),
        bank.openness,
        bank.direction.gather(1, kept.unsqueeze(-1).expand(-1, -1, 3)),
    )
    part = _turned(part, generator)
    radiance = shade(part, random_materials(shapes, pixels, generator))
    error = torch.randn(part.direction.shape, generator=generator) * CALIBRATION_ERROR
    reported = safe_normalize(part.direction + error)
    return Observations(spoil(expose(radiance, generator), generator), reported, part.normal)


def spoil(
    intensity: Float[Tensor, "shape pixel light"], generator: torch.Generator
) -> Float[Tensor, "shape pixel light"]:
    """In a third of the shapes, up to a quarter of the photographs wrong by up to a stop or two.

    Real sets hold photographs that a lamp, a reflection or a compression has spoilt; a
    network that never saw one trusts them.
    """
    shapes, pixels, lights = intensity.shape
    share = torch.rand(shapes, 1, 1, generator=generator) * 0.75 - 0.5
    wrong = torch.rand(shapes, 1, lights, generator=generator) < share
    stops = torch.rand(shapes, 1, 1, generator=generator) * torch.randn(
        shapes, pixels, lights, generator=generator
    )
    common = torch.randn(shapes, 1, 1, generator=generator)
    return torch.where(wrong, intensity * 2 ** (stops + common).clamp(-3, 2), intensity)


def _turned(bank: SurfaceBank, generator: torch.Generator) -> SurfaceBank:
    """Each shape with its lights turned about the viewing direction and mirrored at random."""
    shapes = len(bank.normal)
    angle = 2 * math.pi * torch.rand(shapes, generator=generator)
    mirror = torch.where(torch.rand(shapes, generator=generator) < 0.5, -1.0, 1.0)
    c, s, nil, one = angle.cos(), angle.sin(), torch.zeros(shapes), torch.ones(shapes)
    turn = torch.stack([c, s, nil, -s * mirror, c * mirror, nil, nil, nil, one], -1)
    turn = turn.reshape(-1, 3, 3)
    return bank._replace(normal=bank.normal @ turn, direction=bank.direction @ turn)
