"""What of a training pixel does not depend on its material: normal, shadows, indirect light.

Shadows and bounces are costly and materials are cheap, so surfaces are made once and get a
new material, new lights out of their set and new noise at every training step.

Each pixel of a bank holds, for each of the lights of its shape,

    normal n,  visibility V_l,  indirect E_l = (1/pi) sum over rays d of  E'_l(d) max(0, n.d) dw

where E'_l(d) = max(0, n'.l) V'_l is the irradiance (per unit of the light's) at the surface
that ray d meets first: one bounce off a neighbour of albedo 1. A second and further bounces
are a geometric series in the neighbours' albedo (see `images`).

References: D. Forsyth and A. Zisserman, "Reflections on shading", TPAMI 13 (1991): what
interreflection does to photometric measurements.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import require_whole
from torchradiometry.learn.samples.shapes import random_shapes
from torchradiometry.numerics import clamped_cosine, safe_normalize
from torchradiometry.transport.height_field import height_field_hits, height_field_visibility

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["SurfaceBank", "make_surfaces", "random_lights"]

#: directions over the whole sphere; about half of them leave the surface upwards
RAYS = 64
#: chance of a pixel that no light is hidden from, beside the share of lights that are hidden:
#: pixels in shadow, where networks go wrong, come more often than they are
ALWAYS = 0.3
#: largest angular radius of a lamp, radians (2 degrees: a 7 cm lamp at 1 m), and the directions in
#: it that shadows are averaged over
LAMP, LAMP_DIRECTIONS = 0.035, 4


class SurfaceBank(NamedTuple):
    """Pixels of random surfaces under the lights of their shape.

    Attributes:
        normal: unit.
        visibility: share of the lamp that is seen, 0..1; 0 or 1 for points.
        indirect: one bounce off neighbours of albedo 1, per unit irradiance of the light.
        openness: share of a uniform sky that the pixel receives, 0..1.
        direction: unit, to the lights.
    """

    normal: Float[Tensor, "shape pixel 3"]
    visibility: Float[Tensor, "shape pixel light"]
    indirect: Float[Tensor, "shape pixel light"]
    openness: Float[Tensor, "shape pixel"]
    direction: Float[Tensor, "shape light 3"]


def random_lights(count: int, generator: torch.Generator) -> Float[Tensor, "light 3"]:
    """Distant lights in front of the object: spread over an ellipse of random size and tilt.

    The widest spread is 25 to 65 degrees from the viewing direction, as in rigs of lamps
    around a camera.
    """
    require_whole("count", count, 0, 2**24)
    widest = math.sin(math.radians(25 + 40 * float(torch.rand((), generator=generator))))
    narrow = 0.55 + 0.45 * float(torch.rand((), generator=generator))
    turn = 2 * math.pi * float(torch.rand((), generator=generator))
    radius = torch.sqrt(torch.rand(count, generator=generator)) * widest
    angle = 2 * math.pi * torch.rand(count, generator=generator)
    along, across = radius * torch.cos(angle), narrow * radius * torch.sin(angle)
    x = math.cos(turn) * along - math.sin(turn) * across
    y = math.sin(turn) * along + math.cos(turn) * across
    return torch.stack([x, y, torch.sqrt(1 - x * x - y * y)], -1)


def make_surfaces(
    shapes: int,
    pixels: int,
    lights: int,
    size: int,
    generator: torch.Generator,
    *,
    area: bool = True,
) -> SurfaceBank:
    """Random shapes under random lights, `pixels` of each kept.

    Args:
        shapes: how many shapes.
        pixels: how many pixels of each, drawn with replacement from its mask, shadowed ones
            more often.
        lights: how many lights each shape has.
        size: pixels along an edge of the height field.
        generator: the source of chance.
        area: lamps have a size, up to `LAMP`; otherwise they are points.

    Returns:
        The bank, on the CPU.
    """
    made = [_one_surface(pixels, lights, size, generator, area) for _ in range(shapes)]
    return SurfaceBank(*(torch.stack(parts) for parts in zip(*made, strict=True)))


def _one_surface(
    pixels: int, lights: int, size: int, generator: torch.Generator, area: bool
) -> tuple[Tensor, ...]:
    shape = random_shapes(1, size, generator)
    direction = random_lights(lights, generator)
    width = LAMP * float(torch.rand((), generator=generator)) if area else 0.0
    visibility = _seen(shape.height, direction, width, generator)
    normal = shape.normal[0].flatten(1).T
    facing = clamped_cosine(normal, direction.unsqueeze(1)) * shape.mask.flatten()
    received = facing * visibility
    hidden = (facing > received).float().mean(0)
    chance = (hidden + ALWAYS) * shape.mask.flatten()
    kept = torch.multinomial(chance, pixels, replacement=True, generator=generator)
    indirect, openness = _one_bounce(shape.height, normal, received, kept, generator)
    return normal[kept], visibility[:, kept].T, indirect, openness, direction


def _seen(
    height: Tensor, direction: Tensor, width: float, generator: torch.Generator
) -> Float[Tensor, "light pixel"]:
    """Share of lamps of this angular radius that each pixel sees; at width 0 they are points."""
    if width == 0:
        return height_field_visibility(height, direction).reshape(len(direction), -1)
    around = torch.randn(LAMP_DIRECTIONS, len(direction), 3, generator=generator)
    # uniform in a disc would have this standard deviation along each axis
    spread = safe_normalize(direction + width / 2 * around).flatten(0, 1)
    seen = height_field_visibility(height, spread)
    return seen.reshape(LAMP_DIRECTIONS, len(direction), -1).mean(0)


def _one_bounce(
    height: Tensor, normal: Tensor, received: Tensor, kept: Tensor, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Indirect irradiance `pixel light` of the kept pixels, and their openness."""
    rays = _sphere_directions(RAYS, generator)
    rays = rays[rays[:, 2] > -0.8]
    steps = int(height.shape[-1] * 0.6)
    met = height_field_hits(height, rays, kept, steps=steps).squeeze(1)
    weight = clamped_cosine(normal[kept], rays.unsqueeze(1)) * (4 * math.pi / RAYS) / math.pi
    blocked = met >= 0
    emitted = received[:, met.clamp(min=0)]
    indirect = torch.einsum("lrp,rp->pl", emitted, weight * blocked)
    openness = (weight * ~blocked * (rays[:, 2] > 0).unsqueeze(1)).sum(0)
    return indirect, openness.clamp(max=1)


def _sphere_directions(count: int, generator: torch.Generator) -> Float[Tensor, "ray 3"]:
    """Evenly spread directions (Fibonacci's lattice), turned at random about z."""
    k = torch.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = k * math.pi * (3 - math.sqrt(5)) + 2 * math.pi * torch.rand((), generator=generator)
    level = torch.sqrt(1 - z * z)
    return safe_normalize(torch.stack([level * torch.cos(angle), level * torch.sin(angle), z], -1))
