"""Random hard inputs, kind by kind, that are exact in the dtype they are asked for.

Corners lie on a grid in planes of simple slope, so that a polygon of many corners is planar to
the last bit in float32 as well, and "edge-on" or "on the edge's line" mean what they say.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches

#: bits of a coordinate in the polygon's plane, and of the slopes of that plane
GRID = {torch.float64: (20, 8), torch.float32: (10, 3)}


class Receiver(NamedTuple):
    """A point that looks at a polygon."""

    position: Tensor
    normal: Tensor
    polygon: Tensor


class Draw:
    """Random numbers of one seed."""

    def __init__(self, seed: int, dtype: torch.dtype) -> None:
        self.generator, self.dtype = torch.Generator().manual_seed(seed), dtype

    def uniform(self, *shape: int, low: float = 0.0, high: float = 1.0) -> Tensor:
        drawn = torch.rand(shape, generator=self.generator, dtype=torch.float64)
        return low + (high - low) * drawn

    def decades(self, low: float, high: float) -> float:
        return 10 ** float(self.uniform(low=math.log10(low), high=math.log10(high)))

    def integer(self, low: int, high: int) -> int:
        return int(torch.randint(low, high + 1, (), generator=self.generator))

    def unit(self) -> Tensor:
        return _normalised(torch.randn(3, generator=self.generator, dtype=torch.float64))

    def rounded(self, value: Tensor) -> Tensor:
        return value.to(self.dtype)

    def polygon(self, corners: int | None = None) -> Tensor:
        """Star-shaped about the origin, 3..8 corners, size about 1, exactly planar."""
        number = self.integer(3, 8) if corners is None else corners
        bits, slope_bits = GRID[self.dtype]
        turn = torch.arange(number) + 0.8 * self.uniform(number)
        turn = turn * (2 * math.pi / number)
        reach = self.uniform(number, low=0.3)
        x, y = (torch.round(reach * f(turn) * 2**bits) / 2**bits for f in (torch.cos, torch.sin))
        a, b = (torch.round(self.uniform(low=-1) * 2**slope_bits) / 2**slope_bits for _ in "ab")
        flat = torch.stack((x, y, a * x + b * y), -1)
        order = int(self.integer(0, 2))  # any axis may be the one that depends on the others
        return self.rounded(flat.roll(order, -1))


def _normalised(v: Tensor) -> Tensor:
    return v / v.norm(dim=-1, keepdim=True)


def axis_of(polygon: Tensor) -> Tensor:
    """Unit normal on the emitting side."""
    spokes = polygon.double()[1:] - polygon.double()[0]
    return _normalised(torch.linalg.cross(spokes[:-1], spokes[1:]).sum(0))


def _across(draw: Draw, direction: Tensor) -> Tensor:
    return _normalised(torch.linalg.cross(direction, draw.unit()))


def _towards(draw: Draw, polygon: Tensor) -> Tensor:
    """A direction on the emitting side, at least 10 degrees above the plane."""
    axis = axis_of(polygon)
    away = draw.unit()
    away = away + (draw.uniform(low=0.2) - away @ axis) * axis
    return _normalised(away)


def _facing(draw: Draw, near: float, far: float) -> Receiver:
    polygon = draw.polygon()
    away = _towards(draw, polygon)
    normal = _normalised(-away + 0.3 * draw.unit())
    return Receiver(draw.decades(near, far) * away, normal, polygon)


def near(draw: Draw) -> Receiver:
    return _facing(draw, 1e-3, 1.0)


def far(draw: Draw) -> Receiver:
    return _facing(draw, 1.0, 1e6)


def _grazing(draw: Draw, low: float, high: float, lift: float) -> Receiver:
    """The horizon passes the polygon's middle at `lift` of its size or less, of either sign."""
    polygon = draw.polygon()
    away, distance = _towards(draw, polygon), draw.decades(low, high)
    tilt = float(draw.uniform(low=-lift, high=lift)) / distance
    normal = _normalised(_across(draw, away) - tilt * away)
    return Receiver(distance * away, normal, polygon)


def crossing_near(draw: Draw) -> Receiver:
    return _grazing(draw, 0.1, 10, 0.7)


def crossing_far(draw: Draw) -> Receiver:
    return _grazing(draw, 10, 1e6, 0.7)


def grazing(draw: Draw) -> Receiver:
    """Wholly above the horizon, at angles down to size over distance."""
    polygon = draw.polygon()
    away, distance = _towards(draw, polygon), draw.decades(2, 1e6)
    tilt = draw.decades(2 / distance, 1)
    return Receiver(distance * away, _normalised(_across(draw, away) - tilt * away), polygon)


def edge_on(draw: Draw) -> Receiver:
    """Beside the polygon, close to its plane or far in it: height 1e-6..0.1 of the distance."""
    polygon = draw.polygon()
    axis = axis_of(polygon)
    distance = draw.decades(1.5, 1e3)
    beside = _across(draw, axis)
    away = distance * (beside + draw.decades(1e-6, 0.1) * axis)
    return Receiver(away, _normalised(-beside + 0.5 * draw.unit()), polygon)


def above_an_edge(draw: Draw) -> Receiver:
    """Just above an edge, or its continuation: where contour terms are at their steepest."""
    polygon = draw.polygon()
    start, end = polygon[0].double(), polygon[1].double()
    place = start + float(draw.uniform(low=-1, high=2)) * (end - start)
    position = place + draw.decades(1e-6, 1e-1) * axis_of(polygon)
    return Receiver(position, _normalised(-axis_of(polygon) + 0.5 * draw.unit()), polygon)


POLYGONS: dict[str, Callable[[Draw], Receiver]] = {
    "near, 1e-3..1 sizes": near,
    "far, 1..1e6 sizes": far,
    "grazing, 2..1e6 sizes": grazing,
    "cut by the horizon, 0.1..10 sizes": crossing_near,
    "cut by the horizon, 10..1e6 sizes": crossing_far,
    "edge-on, 1e-6..0.1 rad": edge_on,
    "1e-6..0.1 sizes above an edge": above_an_edge,
}


def receivers(kind: str, count: int, dtype: torch.dtype, seed: int = 0) -> list[Receiver]:
    """Drawn, scaled by a power of two, rounded to the dtype."""
    draw = Draw(seed, dtype)
    found = []
    for _ in range(count):
        position, normal, polygon = POLYGONS[kind](draw)
        scale = 2.0 ** draw.integer(-10, 10)
        found.append(
            Receiver(
                draw.rounded(position * scale), draw.rounded(normal), draw.rounded(polygon * scale)
            )
        )
    return found


class Lamp(NamedTuple):
    """A sphere as it is seen from a point."""

    offset: Tensor
    normal: Tensor
    radius: Tensor


def _above(draw: Draw, away: Tensor, cosine: float) -> Tensor:
    """A normal at that cosine to a direction."""
    cosine = max(-1.0, min(1.0, cosine))
    return cosine * away + math.sqrt(1 - cosine * cosine) * _across(draw, away)


#: name -> sine of the sphere's half-angle s, and the cosine of its centre for that s
SPHERES: dict[str, Callable[[Draw], tuple[float, Callable[[float], float]]]] = {
    "far, s = 1e-6..0.5": lambda d: (d.decades(1e-6, 0.5), lambda s: d.decades(2 * s, 1)),
    "near, 1 - s = 1e-6..0.5": lambda d: (1 - d.decades(1e-6, 0.5), lambda s: 1.0),
    "cut by the horizon": lambda d: (
        d.decades(1e-6, 0.99), lambda s: s * float(d.uniform(low=-0.95, high=0.95))
    ),
    "touched by the horizon": lambda d: (
        d.decades(1e-6, 0.5), lambda s: s * (1 + d.decades(1e-6, 1))
    ),
    "peeking over the horizon": lambda d: (
        d.decades(1e-4, 0.9), lambda s: -s * (1 - d.decades(1e-4, 0.5))
    ),
}  # fmt: skip


def spheres(kind: str, count: int, dtype: torch.dtype, seed: int = 0) -> list[Lamp]:
    """Drawn at distances of 1e-2..1e2 and rounded; those that are hidden are left out."""
    draw, found = Draw(seed, dtype), []
    while len(found) < count:
        s, cosine = SPHERES[kind](draw)
        away, distance = draw.unit(), draw.decades(1e-2, 1e2)
        normal = _above(draw, away, cosine(s))
        radius = torch.tensor(s * distance, dtype=torch.float64)
        lamp = Lamp(*(draw.rounded(t) for t in (distance * away, normal, radius)))
        a, n, r = (t.double() for t in lamp)
        if a @ n > -0.99999 * r * n.norm():
            found.append(lamp)
    return found


def plates(
    kind: str, count: int, dtype: torch.dtype, seed: int = 0
) -> list[tuple[Patches, tuple[float, float, float]]]:
    """Two rectangles of any ratio up to 1000, facing at any gap, or with a common edge."""
    draw, found = Draw(seed, dtype), []
    for _ in range(count):
        size = draw.decades(1e-3, 1e3)
        ratios = (size, size * draw.decades(1e-3, 1e3), size * draw.decades(1e-3, 1e3))
        a, b, c = draw.rounded(torch.tensor(ratios, dtype=torch.float64)).tolist()
        floor = torch.tensor([[0, 0, 0], [a, 0, 0], [a, b, 0], [0, b, 0]], dtype=dtype)
        if kind == "parallel":
            other = floor.flip(0) + torch.tensor([0, 0, c], dtype=dtype)
            found.append((Patches(torch.stack((floor, other))), (a, b, c)))
        else:
            other = torch.tensor([[0, 0, 0], [0, b, 0], [0, b, c], [0, 0, c]], dtype=dtype)
            found.append((Patches(torch.stack((floor, other))), (a, c, b)))
    return found
