"""What of a training image does not depend on its paint: shape, shadows, and light sent around.

Shadows and bounces are costly and paint is cheap, so shapes are lit once, each by a few lamps of
its own, and painted anew at every training step. A bank holds, for each lamp l of each shape,

    V_l   the share of the lamp that a pixel sees                        (`cast_shadows`)
    E_l   one bounce: what the surface sends itself at albedo 1,
          per unit of the irradiance that the lamp gives at the middle   (`reflected_irradiance`)

and for natural light the share of the sky that is seen, V_sky (`AmbientOcclusion`). Half of the
lamps are near (2 to 8 times the image's edge away: their light falls off across the object), the
others are distant; all have a size, and so penumbras.

References: B. K. P. Horn, "Obtaining shape from shading information" (1975); J. H. Lambert,
*Photometria* (1760), for the law of inverse squares.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.learn.samples.shapes import Shapes, height_to_normals
from torchradiometry.learn.samples.solids import grid, uniform
from torchradiometry.numerics import clamped_cosine, safe_normalize
from torchradiometry.shade.ambient_occlusion import AmbientOcclusion
from torchradiometry.shade.cast_shadow import cast_shadows
from torchradiometry.shade.interreflection import reflected_irradiance
from torchradiometry.shade.layout import to_points
from torchradiometry.sources.point import PointSource, point_arrival

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["ShapeBank", "light_shapes", "places", "turned_shapes"]

#: lamps of each shape, and the places on each of them that shadows are averaged over
LAMPS, PLACES = 4, 3
#: share of near lamps, and how far they are in edges of the image; the distant ones
NEAR, CLOSEST, FARTHEST, DISTANT = 0.5, 2.0, 8.0, 1000.0
#: largest angle of a lamp from the viewing direction, and its largest angular radius, radians
WIDEST, LARGEST = math.radians(75), 0.12


class ShapeBank(NamedTuple):
    """Shapes, what they see of their lamps and of the sky, and what they send themselves.

    Attributes:
        height: pixels, towards the camera.
        mask: True on the object.
        sky: share of the sky that is seen, weighted by the cosine, 0..1.
        lamp: places of the lamps, pixels from the middle of the image: x right, y up, z to the
            camera.
        visibility: share of each lamp that is seen, 0..1.
        bounce: one bounce between surfaces of albedo 1, per unit irradiance of the lamp at the
            middle of the image.
    """

    height: Float[Tensor, "shape H W"]
    mask: Bool[Tensor, "shape H W"]
    sky: Float[Tensor, "shape H W"]
    lamp: Float[Tensor, "shape lamp 3"]
    visibility: Float[Tensor, "shape lamp H W"]
    bounce: Float[Tensor, "shape lamp H W"]


def light_shapes(shapes: Shapes, generator: torch.Generator) -> ShapeBank:
    """Random lamps for each shape, and what it sees of them and of the sky.

    Args:
        shapes: with a mask each.
        generator: the source of chance.
    """
    depth = torch.where(shapes.mask, -shapes.height, torch.nan).unsqueeze(1)
    lamp, spread = _random_lamps(shapes, generator)
    sky, _ = AmbientOcclusion(azimuths=8, pixel_size=1.0)(depth)
    source = PointSource(spread.flatten(1, 2), torch.ones(*spread.flatten(1, 2).shape[:2], 1))
    seen = cast_shadows(depth, [source], pixel_size=1.0).unflatten(1, spread.shape[1:3]).mean(2)
    normal = height_to_normals(shapes.height)
    power = lamp.square().sum(-1, keepdim=True)
    points = to_points(places(shapes.height))
    arrival = point_arrival(lamp, power, points)
    facing = clamped_cosine(arrival.direction, to_points(normal)) * arrival.irradiance.squeeze(-1)
    lit = facing.transpose(0, 1).unflatten(2, depth.shape[-2:]) * seen
    sent = reflected_irradiance(
        depth, torch.ones_like(lit), lit, pixel_size=1.0, normal=normal, bounces=1
    )
    # a sixteenth of a percent is enough here, and half the memory
    return ShapeBank(shapes.height, shapes.mask, sky.squeeze(1), lamp, seen.half(), sent.half())


def places(height: Float[Tensor, "B H W"]) -> Float[Tensor, "B 3 H W"]:
    """Points of height fields, in pixels from the middle of the image."""
    x, y = (axis.expand_as(height) for axis in grid(*height.shape[-2:]))
    return torch.stack([x, y, height], 1)


def _random_lamps(shapes: Shapes, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Middles `shape lamp 3` of the lamps, and `shape lamp place 3` on them."""
    count, size = len(shapes.height), shapes.height.shape[-1]
    cosine = 1 - (1 - math.cos(WIDEST)) * uniform(generator, 0, 1, count, LAMPS)
    azimuth = 2 * math.pi * uniform(generator, 0, 1, count, LAMPS)
    aside = torch.sqrt(1 - cosine * cosine)
    towards = torch.stack([aside * azimuth.cos(), aside * azimuth.sin(), cosine], -1)
    near = uniform(generator, 0, 1, count, LAMPS) < NEAR
    ratio = FARTHEST / CLOSEST
    close = CLOSEST * ratio ** uniform(generator, 0, 1, count, LAMPS)
    distance = torch.where(near, close, DISTANT).unsqueeze(-1) * size
    middle = torch.where(shapes.mask, shapes.height, 0).sum((-2, -1))
    middle = middle / shapes.mask.sum((-2, -1)).clamp(min=1)
    lift = torch.zeros(count, 1, 3)
    lift[..., 2] = middle.unsqueeze(-1)
    # uniform in a disc would have half the radius as standard deviation along each axis
    wide = LARGEST / 2 * uniform(generator, 0, 1, count, LAMPS, 1, 1)
    around = torch.randn(count, LAMPS, PLACES, 3, generator=generator) * wide
    spread = safe_normalize(towards.unsqueeze(2) + around) * distance.unsqueeze(2)
    return towards * distance + lift, spread + lift.unsqueeze(1)


def turned_shapes(bank: ShapeBank, generator: torch.Generator) -> ShapeBank:
    """Every shape, with its lamps, by the same multiple of 90 degrees, mirrored or not."""
    turns = int(torch.randint(0, 4, (), generator=generator))
    mirror = bool(torch.randint(0, 2, (), generator=generator))
    x, y, z = bank.lamp.unbind(-1)
    for _ in range(turns):
        x, y = -y, x
    lamp = torch.stack([-x if mirror else x, y, z], -1)

    def turned(image: Tensor) -> Tensor:
        image = torch.rot90(image, turns, (-2, -1))
        return image.flip(-1) if mirror else image

    return ShapeBank(
        *(part if name == "lamp" else turned(part) for name, part in bank._asdict().items())
    )._replace(lamp=lamp)
