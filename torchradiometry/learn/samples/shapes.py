"""Random shapes as height fields, made on the fly and the same for the same seed.

Families, drawn at random:

    blobs       z = a smooth dome plus Gaussian bumps and dents
    ellipsoids  z = max over tilted half ellipsoids (creases, concave joints, silhouettes)
    reliefs     z = filtered noise with a power spectrum |f|^-p on a tilted plane
    limbs, lathe, stones, sheets    see `solids`
    carved      z = one of the solid ones plus a relief: objects with fine surface detail

Lengths are in pixels, x to the right, y up, z to the camera, seen orthographically.
Normals come from the heights by `geometry.depth`, so what is shaded, what casts shadows and
what is asked of the network are the same surface.

References: S. Ikehata, "CNN-PS: CNN-based photometric stereo for general non-convex surfaces",
ECCV 2018, section 4.1 (why training shapes need concavities); M. K. Johnson and E. H. Adelson,
"Shape estimation in natural illumination", CVPR 2011 (blobs).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import OutOfRangeError, require_axes, require_kind, require_whole
from torchradiometry.geometry.depth import points_to_normals
from torchradiometry.learn.samples.solids import grid, lathe, limbs, sheets, stones, uniform

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["FAMILIES", "Shapes", "height_to_normals", "random_shapes"]

FAMILIES = ("blobs", "ellipsoids", "reliefs", "carved", "limbs", "lathe", "stones", "sheets")


class Shapes(NamedTuple):
    """A batch of height fields.

    Attributes:
        height: pixels, towards the camera; far below the rest outside the mask.
        normal: unit, x right, y up, z to the camera; (0, 0, 1) outside the mask.
        mask: True on the object, one pixel inside its outline.
    """

    height: Float[Tensor, "batch height width"]
    normal: Float[Tensor, "batch 3 height width"]
    mask: Bool[Tensor, "batch height width"]


def random_shapes(
    count: int, size: int, generator: torch.Generator, families: Sequence[str] = FAMILIES
) -> Shapes:
    """`count` random shapes on `size x size` pixels.

    Args:
        count: how many, >= 1.
        size: pixels along an edge, 16...16384.
        generator: the source of chance; the same state gives the same shapes.
        families: which of `FAMILIES` to draw from.

    Returns:
        Heights, normals and masks.

    Raises:
        DTypeError: a count or size that is no whole number, or no generator.
        OutOfRangeError: a count below 1, a size out of range or an unknown family.

    >>> shapes = random_shapes(2, 32, torch.Generator().manual_seed(0))
    >>> shapes.normal.shape, bool(shapes.mask.any())
    (torch.Size([2, 3, 32, 32]), True)
    """
    require_whole("count", count, 1)
    require_whole("size", size, 16, 2**14)
    require_kind("generator", generator, torch.Generator)
    unknown = [family for family in families if family not in FAMILIES]
    if unknown or not families:
        raise OutOfRangeError("families", str(list(families)), f"choose some of {FAMILIES}")
    choice = torch.randint(0, len(families), (count,), generator=generator).tolist()
    made = [MAKERS[families[k]](size, generator) for k in choice]
    height = torch.stack([height for height, _ in made])
    inside = torch.stack([mask for _, mask in made])
    return finished(height, inside)


def height_to_normals(
    height: Float[Tensor, "batch height width"], pixel_size: float = 1.0
) -> Float[Tensor, "batch 3 height width"]:
    """Unit normals of orthographic height fields, by `geometry.depth.points_to_normals`.

    >>> height_to_normals(torch.zeros(1, 4, 4))[0, :, 0, 0].abs()
    tensor([0., 0., 1.])
    """
    require_axes("height", height, None, None, None)
    x, y = grid(*height.shape[-2:])
    points = torch.stack(
        [(x * pixel_size).expand_as(height), (y * pixel_size).expand_as(height), height], 1
    )
    return points_to_normals(points)


def finished(height: Tensor, inside: Tensor) -> Shapes:
    """Heights below the object pushed down, normals, and the mask without its outermost pixel."""
    normal = height_to_normals(height)
    outside = (~inside).to(height.dtype).unsqueeze(1)
    near_edge = torch.nn.functional.max_pool2d(outside, 3, stride=1, padding=1).squeeze(1) > 0
    mask = inside & ~near_edge
    straight = torch.tensor([0.0, 0.0, 1.0])[None, :, None, None]
    normal = torch.where(mask.unsqueeze(1), normal, straight)
    floor = torch.where(inside, height, torch.inf).amin((-2, -1), keepdim=True)
    height = torch.where(inside, height, floor - 2 * height.shape[-1])
    return Shapes(height, normal, mask)


def _noise(size: int, power: float, generator: torch.Generator) -> Tensor:
    """Filtered noise of spectrum |f|^-power, mean 0 and standard deviation 1."""
    spectrum = torch.fft.rfft2(torch.randn(2 * size, 2 * size, generator=generator))
    rows = torch.fft.fftfreq(2 * size).unsqueeze(1)
    frequency = torch.sqrt(rows**2 + torch.fft.rfftfreq(2 * size) ** 2) * size
    kept = torch.where(frequency >= 0.5, frequency.clamp(min=0.5) ** -power, 0)
    field = torch.fft.irfft2(spectrum * kept)[:size, :size]
    return (field - field.mean()) / field.std()


def _ellipsoids(size: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    x, y = grid(size, size)
    pieces = int(torch.randint(1, 12, (), generator=generator))
    radius = uniform(generator, 0.1, 0.42, pieces, 2) * size
    depth = radius.mean(1) * uniform(generator, 0.4, 1.6, pieces)
    turn = uniform(generator, 0, math.pi, pieces)
    spread = 0.0 if pieces == 1 else 0.28
    centre = uniform(generator, -spread, spread, pieces, 3) * size
    dx, dy = x - centre[:, 0, None, None], y - centre[:, 1, None, None]
    c, s = torch.cos(turn)[:, None, None], torch.sin(turn)[:, None, None]
    along, across = (c * dx + s * dy), (c * dy - s * dx)
    room = 1 - (along / radius[:, :1, None]) ** 2 - (across / radius[:, 1:, None]) ** 2
    top = centre[:, 2, None, None] + depth[:, None, None] * torch.sqrt(room.clamp(min=0))
    height = torch.where(room > 0, top, -torch.inf).amax(0)
    inside = (room > 0).any(0)
    return torch.where(inside, height, height[inside].min()), inside


def _blobs(size: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    x, y = grid(size, size)
    bumps = int(torch.randint(4, 24, (), generator=generator))
    width = uniform(generator, 0.05, 0.25, bumps, 1, 1) * size
    centre = uniform(generator, -0.45, 0.45, bumps, 2, 1, 1) * size
    tall = uniform(generator, -0.9, 1.5, bumps, 1, 1) * width
    squared = (x - centre[:, 0]) ** 2 + (y - centre[:, 1]) ** 2
    bumpy = (tall * torch.exp(-squared / (2 * width**2))).sum(0)
    radius = float(uniform(generator, 0.38, 0.7)) * size
    room = 1 - (x**2 + y**2) / radius**2
    dome = float(uniform(generator, 0.2, 1.2)) * radius * torch.sqrt(room.clamp(min=0))
    return dome + bumpy, room > 0


def _reliefs(size: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    x, y = grid(size, size)
    power = float(uniform(generator, 1.8, 3.2))
    tall = float(uniform(generator, 0.02, 0.16)) * size
    slope = uniform(generator, -0.8, 0.8, 2)
    height = tall * _noise(size, power, generator) + slope[0] * x + slope[1] * y
    return height, torch.ones(size, size, dtype=torch.bool)


def _carved(size: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    solid = (_ellipsoids, limbs, lathe, stones)
    which = int(torch.randint(0, len(solid), (), generator=generator))
    height, inside = solid[which](size, generator)
    power = float(uniform(generator, 1.2, 2.5))
    tall = float(uniform(generator, 0.004, 0.05)) * size
    detail = _noise(size, power, generator)
    if torch.rand((), generator=generator) < 0.3:
        detail = -detail.abs()  # grooves with sharp bottoms
    return height + tall * detail, inside


#: (size, generator) -> heights and whether the object is there
MAKERS: dict[str, Callable[[int, torch.Generator], tuple[Tensor, Tensor]]] = {
    "blobs": _blobs,
    "ellipsoids": _ellipsoids,
    "reliefs": _reliefs,
    "carved": _carved,
    "limbs": limbs,
    "lathe": lathe,
    "stones": stones,
    "sheets": sheets,
}
