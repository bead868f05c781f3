"""Things that people and nature make, as height fields.

    limbs    z = smooth max over tapered capsules of  z_k + sqrt(r(t)^2 - d^2)   (animals)
    lathe    z = sqrt(r(y)^2 - x^2) + slope y,  r a smooth profile               (cups, fruit)
    stones   z = smooth min over planes of  h_k - a_k x - b_k y                  (boxes, gems)
    sheets   z = folds and a tilt inside a random outline                        (paper, bags)

with d the distance to a capsule's axis, t the place along it. The smooth max is
log(sum exp(b z)) / b, whose 1/b is the radius of a fillet. Lengths in pixels, orthographic, as in
`shapes`.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide

__all__ = ["lathe", "limbs", "sheets", "stones"]


def limbs(size: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """A body with limbs: each tapered capsule starts at the end or middle of an earlier one."""
    x, y = grid(size, size)
    count = int(torch.randint(2, 11, (), generator=generator))
    ends, radii = [torch.zeros(3)], [float(uniform(generator, 0.15, 0.32))]
    limb: list[Tensor] = []
    for k in range(count):
        root = int(torch.randint(0, len(ends), (), generator=generator)) if k else 0
        start, wide = ends[root], radii[root]
        angle = 2 * math.pi * float(uniform(generator, 0, 1))
        length = float(uniform(generator, 0.1, 0.38))
        rise = float(uniform(generator, -0.6, 0.6))
        stop = start + length * torch.tensor([math.cos(angle), math.sin(angle), rise])
        narrow = wide * float(uniform(generator, 0.45, 1.1))
        limb.append(torch.cat([start, stop, torch.tensor([wide, narrow])]))
        ends.append(stop)
        radii.append(narrow)
    start, stop, radius = torch.stack(limb).split((3, 3, 2), -1)
    middle = (start + stop).mean(0) / 2
    reach = torch.cat([start, stop]).sub(middle)[:, :2].abs().max() + max(radii)
    scale = float(uniform(generator, 0.34, 0.47)) / float(reach) * size
    a, b, (r, s) = (start - middle) * scale, (stop - middle) * scale, (radius * scale).unbind(-1)
    top, room = _capsules(x, y, a, b, r, s)
    inside = (room > 0).any(0)
    soft = float(2 ** uniform(generator, -2.5, 1.5)) * 64 / size
    joined = smooth_max(torch.where(room > 0, top, -torch.inf), soft)
    return torch.where(inside, joined, joined[inside].min()), inside


def _capsules(
    x: Tensor, y: Tensor, a: Tensor, b: Tensor, r: Tensor, s: Tensor
) -> tuple[Tensor, Tensor]:
    """Heights of tapered capsules from a to b with radii r to s, and r(t)^2 - d^2."""
    ax, ay, az = (c[:, None, None] for c in a.unbind(-1))
    dx, dy, dz = (c[:, None, None] for c in (b - a).unbind(-1))
    t = guarded_divide((x - ax) * dx + (y - ay) * dy, dx * dx + dy * dy).clamp(0, 1)
    squared = (x - ax - t * dx) ** 2 + (y - ay - t * dy) ** 2
    radius = r[:, None, None] + t * (s - r)[:, None, None]
    room = radius * radius - squared
    return az + t * dz + room.clamp(min=0).sqrt(), room


def lathe(size: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """A turned thing, its axis tilted to the camera and turned in the image."""
    x, y = turned(*grid(size, size), generator)
    tall = float(uniform(generator, 0.3, 0.46)) * size
    place = (y / tall).clamp(-1, 1)
    terms = torch.arange(1, 6)
    weight = uniform(generator, -1, 1, 5) / terms * float(uniform(generator, 0, 0.5))
    phase = 2 * math.pi * uniform(generator, 0, 1, 5)
    wave = torch.cos(math.pi / 2 * terms[:, None, None] * place + phase[:, None, None])
    radius = (
        float(uniform(generator, 0.16, 0.4))
        * size
        * torch.exp((weight[:, None, None] * wave).sum(0))
    )
    if float(uniform(generator, 0, 1)) < 0.5:  # closed at both ends like a fruit
        radius = radius * (1 - place.abs() ** float(uniform(generator, 2, 6))).clamp(min=0).sqrt()
    radius = radius.clamp(max=0.48 * size)
    room = radius * radius - x * x
    inside = (room > 0) & (y.abs() < tall)
    slope = float(uniform(generator, -0.9, 0.9))
    height = room.clamp(min=0).sqrt() * float(uniform(generator, 0.6, 1)) + slope * y
    return torch.where(inside, height, height[inside].min()), inside


def stones(size: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """What a few planes cut off, with rounded edges."""
    x, y = turned(*grid(size, size), generator)
    planes = int(torch.randint(3, 10, (), generator=generator))
    azimuth = 2 * math.pi * (torch.arange(planes) + uniform(generator, 0, 0.8, planes)) / planes
    steep = torch.tan(math.radians(80) * uniform(generator, 0.1, 1, planes))
    away = uniform(generator, 0.22, 0.42, planes) * size
    across = torch.cos(azimuth)[:, None, None] * x + torch.sin(azimuth)[:, None, None] * y
    sides = steep[:, None, None] * (away[:, None, None] - across)
    lean = uniform(generator, -0.7, 0.7, 2)
    lid = float(uniform(generator, 0.05, 0.5)) * size + lean[0] * x + lean[1] * y
    walls = torch.cat([sides, lid[None]])
    soft = float(2 ** uniform(generator, -1, 2.5)) * 64 / size
    height = -smooth_max(-walls, soft)
    inside = (walls[:-1] > 0).all(0) & (height > 0)
    if float(uniform(generator, 0, 1)) < 0.4 or not bool(inside.any()):
        inside = _outline(x, y, size, generator) > 0  # sides that turn away, as of a box
    return torch.where(inside, height, height[inside].min()), inside


def sheets(size: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """A nearly flat thing with a random outline: folds, dents, a tilt."""
    x, y = turned(*grid(size, size), generator)
    edge = _outline(x, y, size, generator)
    inside = edge > 0
    folds = int(torch.randint(1, 10, (), generator=generator))
    turn = 2 * math.pi * uniform(generator, 0, 1, folds)
    where = torch.cos(turn)[:, None, None] * x + torch.sin(turn)[:, None, None] * y
    where = where - uniform(generator, -0.3, 0.3, folds)[:, None, None] * size
    sharp = uniform(generator, 0.01, 0.12, folds)[:, None, None] * size
    bend = uniform(generator, -0.8, 0.8, folds)[:, None, None]
    creased = (bend * sharp * torch.nn.functional.softplus(where / sharp)).sum(0)
    lean = uniform(generator, -0.6, 0.6, 2)
    rim = float(uniform(generator, 0, 0.12)) * size
    rounded = rim * (1 - torch.exp(-edge.clamp(min=0) / max(rim, 1)))
    height = creased + rounded + lean[0] * x + lean[1] * y
    return torch.where(inside, height, height[inside].min()), inside


def _outline(x: Tensor, y: Tensor, size: int, generator: torch.Generator) -> Tensor:
    """Distance to the outline of a random polygon with rounded corners, positive inside."""
    corners = int(torch.randint(3, 9, (), generator=generator))
    azimuth = 2 * math.pi * (torch.arange(corners) + uniform(generator, 0, 0.6, corners)) / corners
    away = uniform(generator, 0.25, 0.46, corners) * size
    across = torch.cos(azimuth)[:, None, None] * x + torch.sin(azimuth)[:, None, None] * y
    soft = float(2 ** uniform(generator, -2, 3)) * 64 / size
    return -smooth_max(across - away[:, None, None], soft)


def smooth_max(values: Tensor, soft: float) -> Tensor:
    """Largest along the first axis; near ties rounded over about 1/`soft`."""
    return torch.logsumexp(values * soft, 0) / soft


def turned(x: Tensor, y: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Coordinates in a frame turned by a random angle."""
    angle = 2 * math.pi * float(torch.rand((), generator=generator))
    c, s = math.cos(angle), math.sin(angle)
    return c * x + s * y, c * y - s * x


def grid(rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """x (right) and y (up) of pixel centres in pixels, the middle of the image at 0."""
    x = torch.arange(columns) - (columns - 1) / 2
    y = (rows - 1) / 2 - torch.arange(rows)
    return x.expand(rows, columns), y.unsqueeze(1).expand(rows, columns)


def uniform(generator: torch.Generator, low: float, high: float, *shape: int) -> Tensor:
    """Uniform numbers."""
    return torch.rand(shape, generator=generator) * (high - low) + low
