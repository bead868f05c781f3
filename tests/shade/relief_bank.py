"""Reliefs for tests of shading on depth maps, as an orthographic and as a pinhole camera sees them.

A relief is a height h(x, y) in m over the square of 1 m around the origin, towards a camera
that stands 2 m in front of the plane h = 0. It is a function and not a picture, so that every
size shows the same relief.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import torch
from torch import Tensor

__all__ = [
    "BOWL_ANGLE",
    "BOWL_RIM",
    "CAMERAS",
    "DISTANCE",
    "perspective_reliefs",
    "reliefs",
    "reliefs_by",
]

#: m from the camera to the plane h = 0
DISTANCE = 2.0
#: m, radius of the rim of the bowl
BOWL_RIM = 0.45
#: angle at the centre of its sphere between the axis and the rim: the slope at the rim
BOWL_ANGLE = math.radians(70)
#: the random reliefs' steepest slope
STEEPEST = math.radians(55)

Height = Callable[[Tensor, Tensor], Tensor]


def reliefs(size: int, dtype: torch.dtype = torch.float64) -> dict[str, Tensor]:
    """Depth maps `1 1 size size` of all reliefs, orthographic, with pixel_size = 1 / size."""
    axis = (torch.arange(size, dtype=torch.float64) + 0.5) / size - 0.5
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    return {name: (DISTANCE - h(x, y))[None, None].to(dtype) for name, h in _heights().items()}


def perspective_reliefs(
    size: int, dtype: torch.dtype = torch.float64
) -> tuple[dict[str, Tensor], Tensor]:
    """The same reliefs seen by a pinhole camera, and its intrinsics K `3 3`.

    The picture spans 1 m at the plane h = 0. What a pixel sees is the first point of its ray
    below the surface, found by small steps and then by halving.
    """
    focal, middle = DISTANCE * size, size / 2
    matrix = [[focal, 0, middle], [0, focal, middle], [0, 0, 1]]
    axis = (torch.arange(size, dtype=torch.float64) + 0.5 - middle) / focal
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    seen = {name: _first(h, x, y)[None, None].to(dtype) for name, h in _heights().items()}
    return seen, torch.tensor(matrix, dtype=dtype)


#: how a depth map may be seen
CAMERAS = ("pinhole", "orthographic")


@cache
def reliefs_by(camera: str, size: int) -> tuple[dict[str, Tensor], dict]:
    """All reliefs seen by one of `CAMERAS`, and what names it: intrinsics or pixel_size."""
    if camera == "orthographic":
        return reliefs(size), {"pixel_size": 1 / size}
    depths, matrix = perspective_reliefs(size)
    return depths, {"intrinsics": matrix}


def _first(h: Height, x: Tensor, y: Tensor, steps: int = 400) -> Tensor:
    """Depth of the first point (x, y, 1) d at or below the surface."""

    def below(depth: Tensor) -> Tensor:
        return h(x * depth, y * depth) >= DISTANCE - depth

    near, far = DISTANCE - 1.0, DISTANCE + 1.0
    low, found = torch.full_like(x, near), torch.zeros_like(x, dtype=torch.bool)
    for step in range(steps):
        depth = torch.full_like(x, near + (far - near) * (step + 1) / steps)
        found = found | below(depth)
        low = torch.where(found, low, depth)
    high = low + (far - near) / steps
    for _ in range(40):
        half = (low + high) / 2
        under = below(half)
        low, high = torch.where(under, low, half), torch.where(under, half, high)
    return high


@cache
def _heights() -> dict[str, Height]:
    heights: dict[str, Height] = {
        "bowl": _bowl,
        "groove": lambda x, y: x.abs(),
        "groove_turned": lambda x, y: (x * math.cos(math.pi / 6) + y * 0.5).abs(),
        "ripple": _ripple,
        "block": lambda x, y: torch.where(((x + 0.05).abs() < 0.2) & (y.abs() < 0.15), 0.2, 0.0),
    }
    return heights | {f"random_{seed}": _random(seed) for seed in range(3)}


def _bowl(x: Tensor, y: Tensor) -> Tensor:
    """A spherical cap sunk into a plane."""
    radius = BOWL_RIM / math.sin(BOWL_ANGLE)
    deep = (radius**2 - x * x - y * y).clamp(min=0).sqrt() - radius * math.cos(BOWL_ANGLE)
    return -deep.clamp(min=0)


def _ripple(x: Tensor, y: Tensor) -> Tensor:
    """Two crossing waves; slopes to 50 degrees."""
    turn = 2 * math.pi
    first = 0.055 * torch.sin(turn * (2.5 * x + 0.5 * y))
    return first + 0.037 * torch.sin(turn * (3 * y - x) + 1)


def _random(seed: int, waves: int = 32) -> Height:
    """Waves of 1 to 5 periods in all directions, finer ones weaker, scaled to `STEEPEST`."""
    generator = torch.Generator().manual_seed(seed)
    draw = torch.rand(3, waves, dtype=torch.float64, generator=generator)
    periods, heading, phase = 1 + 4 * draw[0], 2 * math.pi * draw[1], 2 * math.pi * draw[2]
    pace = 2 * math.pi * periods * torch.stack([heading.cos(), heading.sin()])
    amplitude = periods**-1.5

    def arguments(x: Tensor, y: Tensor) -> Tensor:
        return x.unsqueeze(-1) * pace[0] + y.unsqueeze(-1) * pace[1] + phase

    axis = torch.linspace(-0.5, 0.5, 129, dtype=torch.float64)
    fine = arguments(*torch.meshgrid(axis, axis, indexing="xy"))
    gradient = (amplitude * fine.cos()) @ pace.T
    amplitude = amplitude * (math.tan(STEEPEST) / gradient.norm(dim=-1).max())
    return lambda x, y: (amplitude * arguments(x, y).sin()).sum(-1)
