"""Training images: surfaces of a bank, shaded by the package's own materials, seen by a camera.

    L = (T(mu_i) T(mu_o) f_base + f_coat + f_sheen) mu_i V  +  rho/pi E_ind,    wo = (0, 0, 1)

under one distant light at a time: a rough matt base (`OrenNayar`) under two glossy coats
(`Microfacet`), with the bank's shadows. What a coat reflects at grazing angles is missing below
it, Schlick's T(mu) = 1 - v (1 - mu)^5 on the way in and out. The indirect irradiance is the bank's
single bounce E_1 times the series of further bounces between neighbours of albedo rho',

    E_ind = rho' E_1 (1 + a rho' + (a rho')^2 + ...) = rho' E_1 / (1 - a rho'),

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

from torchradiometry.errors import require_whole
from torchradiometry.learn.samples.geometry_bank import SurfaceBank
from torchradiometry.materials.microfacet import microfacet_brdf
from torchradiometry.materials.oren_nayar import oren_nayar_brdf
from torchradiometry.numerics import clamped_cosine, safe_normalize

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Materials", "Observations", "expose", "observe", "random_materials", "shade"]

LUMINANCE = (0.2989, 0.5870, 0.1140)
#: shares of matt shapes and of metal ones
MATT, METAL = 0.25, 0.15
#: largest share of a lamp's irradiance that walls and table send back
STRAY = 0.08
#: standard deviation of each component of a calibrated light direction, about half a degree
CALIBRATION_ERROR = 0.007


class Materials(NamedTuple):
    """What each pixel is made of.

    Attributes:
        albedo: of the matt base, 0..1.
        roughness: of the matt base, 0..1.
        veil: v, how much of the base its coat hides at grazing angles, 0..1.
        specular: reflectance of the two coats at normal incidence, 0..1.
        gloss: roughness of the two coats, 0.03..1.
        surround: albedo of what faces the pixel, 0..1.
    """

    albedo: Float[Tensor, "shape pixel"]
    roughness: Float[Tensor, "shape pixel"]
    veil: Float[Tensor, "shape pixel"]
    specular: Float[Tensor, "shape pixel 2"]
    gloss: Float[Tensor, "shape pixel 2"]
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
    """Clay, plaster, paint, glaze and metal, each with stains and worn places.

    A quarter of the shapes is matt, a sixth is metal (a dark base, a strong coat that is all
    there is), the others are paint: a coat of varnish (k_s about 0.04), and often a wide sheen.
    """

    def uniform(low: float, high: float, *size: int) -> Tensor:
        return low + (high - low) * torch.rand(size, generator=generator)

    require_whole("shapes", shapes, 0, 2**16)
    require_whole("pixels", pixels, 0, 2**24)
    kind = uniform(0, 1, shapes, 1)
    matt, metal = (kind < MATT).float(), (kind > 1 - METAL).float()
    base = uniform(0.08, 0.95, shapes, 1) * (1 - 0.8 * metal)
    rough = uniform(-0.3, 0.6, shapes, 1).clamp(min=0) * torch.ones(1, pixels)
    veil = uniform(-0.2, 1, shapes, 1).clamp(min=0) * (1 - matt) * torch.ones(1, pixels)
    coat = 2 ** uniform(-6, -3.3, shapes, 1) * (1 - metal) + uniform(0.3, 0.9, shapes, 1) * metal
    sheen = 2 ** uniform(-6, -2, shapes, 1) * (uniform(0, 1, shapes, 1) < 0.6).float()
    specular = torch.stack([coat, sheen], -1) * (1 - matt).unsqueeze(-1)
    width = torch.stack([uniform(-4.5, -0.7, shapes, 1), uniform(-2, 0, shapes, 1)], -1)
    worn = uniform(0.6, 1, shapes, pixels, 1)
    albedo = base * uniform(0.6, 1.4, shapes, pixels)
    specular = (specular * worn).clamp(max=0.95)
    albedo = (albedo * (1 - specular.sum(-1))).clamp(0.01, 0.95)
    gloss = 2 ** (width + uniform(-0.3, 0.3, shapes, pixels, 1))
    surround = (base + specular.mean(1, keepdim=True).sum(-1)).clamp(max=0.95)
    surround = surround.expand_as(albedo)
    return Materials(albedo, rough, veil, specular, gloss.clamp(0.03, 1), surround)


def shade(bank: SurfaceBank, materials: Materials) -> Float[Tensor, "shape pixel light"]:
    """Radiance of each pixel under each light of unit irradiance, times pi."""
    wi, normal = bank.direction.unsqueeze(1), bank.normal.unsqueeze(2)
    wo = normal.new_tensor([0.0, 0.0, 1.0])

    def each(value: Tensor) -> Tensor:
        """`shape pixel` as `shape pixel light=1 channel=1`."""
        return value[..., None, None]

    base = oren_nayar_brdf(each(materials.albedo), each(materials.roughness), wi, wo, normal)
    facing = clamped_cosine(wi, normal)
    veil = materials.veil.unsqueeze(-1)
    through = (1 - veil * (1 - facing) ** 5) * (1 - veil * (1 - clamped_cosine(wo, normal)) ** 5)
    brdf = base * through.unsqueeze(-1)
    for k in range(materials.specular.shape[-1]):
        coat, gloss = each(materials.specular[..., k]), each(materials.gloss[..., k])
        brdf = brdf + microfacet_brdf(coat, gloss, wi, wo, normal)
    direct = brdf.squeeze(-1) * facing * bank.visibility
    return math.pi * direct + materials.albedo.unsqueeze(-1) * _indirect(bank, materials)


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
    ambient: bool = True,
) -> Observations:
    """A training batch: new materials, some of each shape's lights, a turn about z, a camera.

    Args:
        bank: surfaces, as drawn from a larger bank.
        lights: how many of each shape's lights to use.
        generator: the source of chance.
        shadows: keep cast shadows.
        indirect: keep indirect light.
        ambient: the room is not quite black: walls and table send up to `STRAY` of the lamps'
            irradiance back.
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
    materials = random_materials(shapes, pixels, generator)
    radiance = shade(part, materials)
    stray = _stray(part.normal, generator)
    if ambient:
        radiance = radiance + (stray * materials.albedo * bank.openness).unsqueeze(-1)
    error = torch.randn(part.direction.shape, generator=generator) * CALIBRATION_ERROR
    reported = safe_normalize(part.direction + error)
    return Observations(spoil(expose(radiance, generator), generator), reported, part.normal)


def _stray(
    normal: Float[Tensor, "shape pixel 3"], generator: torch.Generator
) -> Float[Tensor, "shape pixel"]:
    """Light from a half space of each shape's room: s (1 + n . d) / 2."""
    shapes = len(normal)
    strength = STRAY * torch.rand(shapes, 1, generator=generator) ** 2
    towards = safe_normalize(torch.randn(shapes, 1, 3, generator=generator))
    return strength * (1 + (normal * towards).sum(-1)) / 2


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
