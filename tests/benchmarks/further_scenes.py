"""Scenes on which nothing was tuned: what holds on the standard ones has to hold here.

Made as those in `torchradiometry.scene.standard`: y up, in m, one camera each.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from torchradiometry.scene.build import SIDES, box, quad, room, sphere
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.standard import UPRIGHT, camera, ground, sun
from torchradiometry.scene.surface import Surface

__all__ = ["FURTHER_SCENES"]


def panel(
    name: str, x: float, y: float, z: float, wide: float, deep: float, shine: float
) -> Surface:
    """A horizontal lamp that shines down."""
    a, b = wide / 2, deep / 2
    corners = [[x - a, y, z - b], [x + a, y, z - b], [x + a, y, z + b], [x - a, y, z + b]]
    return quad(name, corners, albedo=0.0, emission=shine)


def corridor(width: int, height: int) -> Scene:
    """A long corridor with three lamps: light fades along it and comes back."""
    shell = box("corridor", (2.0, 2.6, 12.0), (0, 1.3, 0), inward=True, albedo=[0.7, 0.65, 0.6])
    lamps = [panel(f"lamp {k}", 0, 2.55, 3.5 * (k - 1), 0.5, 0.9, 12.0) for k in range(3)]
    view = camera(width, height, (0.4, 1.6, 5.7), (-0.1, 1.2, 0), 60)
    return Scene((shell, *lamps), (), view)


def table(width: int, height: int) -> Scene:
    """A table with four legs under a ceiling panel: soft shadows of thin things."""
    shell = room((3.6, 2.6, 3.6), panel=(1.2, 0.6), emission=9.0, albedo=0.6)
    top = box("top", (1.3, 0.05, 0.8), (0, 0.74, -0.3), turn=0.2, albedo=[0.5, 0.3, 0.15])
    legs = []
    cosine, sine = math.cos(0.2), math.sin(0.2)
    for k, (a, b) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
        x, z = 0.58 * a, 0.33 * b
        where = (x * cosine + z * sine, 0.35, -0.3 - x * sine + z * cosine)
        size = (0.07, 0.7, 0.07)
        sides = ("left", "right", "back", "front")
        legs.append(box(f"leg {k}", size, where, turn=0.2, sides=sides, albedo=[0.5, 0.3, 0.15]))
    view = camera(width, height, (0.9, 1.5, 1.7), (-0.1, 0.55, -0.5), 58)
    return Scene((*shell, top, *legs), (), view)


def window(width: int, height: int) -> Scene:
    """A ball in a white box that a small window lights from the side."""
    shell = box("box", (2.4, 2.0, 2.4), (0, 1.0, 0), inward=True, albedo=0.85)
    x, y, z, h = -1.19, 1.3, -0.2, 0.22
    corners = [[x, y - h, z - h], [x, y + h, z - h], [x, y + h, z + h], [x, y - h, z + h]]
    light = quad("window", corners, albedo=0.0, emission=30.0)
    body = sphere("ball", 0.45, (0.15, 0.45, -0.3), subdivisions=3, albedo=[0.7, 0.35, 0.2])
    view = camera(width, height, (0.5, 1.2, 1.15), (-0.1, 0.6, -0.5), 66)
    return Scene((shell, light, body), (), view)


def corner(width: int, height: int) -> Scene:
    """An L-shaped room whose lamp hangs in the leg that the camera does not see."""
    far = box("near leg", (2.5, 2.8, 6.0), (0, 1.4, 0), inward=True, albedo=0.7,
              sides=[s for s in SIDES if s != "right"])  # fmt: skip
    side = box("far leg", (4.0, 2.8, 2.5), (3.25, 1.4, -1.75), inward=True, albedo=[0.75, 0.7, 0.6],
               sides=[s for s in SIDES if s != "left"])  # fmt: skip
    x, low, high = 1.25, -0.5, 3.0
    wall = quad("wall", [[x, 2.8, high], [x, 2.8, low], [x, 0, low], [x, 0, high]], albedo=0.7)
    lamp = panel("lamp", 3.8, 2.75, -1.75, 1.2, 1.2, 14.0)
    view = camera(width, height, (-0.4, 1.6, 2.7), (0.3, 1.2, -1.6), 60)
    return Scene((far, side, wall, lamp), (), view)


def staircase(width: int, height: int) -> Scene:
    """Six steps in the sun: shadows that fold over edges, reflexes in every corner."""
    steps = []
    for k in range(6):
        low, high, front, back = 0.17 * k, 0.17 * (k + 1), 0.9 - 0.28 * k, 0.62 - 0.28 * k
        a, b = -0.8, 0.8
        riser = [[a, low, front], [b, low, front], [b, high, front], [a, high, front]]
        tread = [[a, high, front], [b, high, front], [b, high, back], [a, high, back]]
        steps.append(quad(f"step {k}", [riser, tread], albedo=[0.7, 0.6, 0.5]))
    side = box("side", (0.1, 1.5, 1.9), (0.86, 0.75, 0.05), albedo=0.5, sides=UPRIGHT)
    floor = quad("floor", [[-2, 0, 3], [2, 0, 3], [2, 0, 0.9], [-2, 0, 0.9]], albedo=0.5)
    view = camera(width, height, (-1.6, 2.0, 3.2), (0.1, 0.5, 0.1), 40)
    return Scene((floor, *steps, side), (sun((0.9, 1.0, 0.5)),), view)


def touching(width: int, height: int) -> Scene:
    """Two balls that touch, under a round lamp of many faces."""
    floor = ground("ground", 2.0, albedo=0.5)
    balls = [
        sphere("red ball", 0.4, (-0.4, 0.4, 0), subdivisions=3, albedo=[0.8, 0.2, 0.15]),
        sphere("white ball", 0.4, (0.4, 0.4, 0), subdivisions=3, albedo=0.85),
    ]
    lamp = sphere("lamp", 0.25, (0.3, 1.9, 0.6), subdivisions=1, smooth=False, albedo=0.0,
                  emission=12.0)  # fmt: skip
    view = camera(width, height, (0.5, 1.3, 3.0), (0, 0.35, 0), 34)
    return Scene((floor, *balls, lamp), (), view)


def chequer(width: int, height: int) -> Scene:
    """Many small boxes like a chequer board in the sun: more detail than patches like."""
    boxes = []
    for i in range(6):
        for k in range(6):
            if (i + k) % 2 == 0:
                size = (0.24, 0.12 + 0.05 * ((3 * i + 5 * k) % 4), 0.24)
                where = (0.34 * (i - 2.5), size[1] / 2, 0.34 * (k - 2.5))
                paint = [0.75, 0.7, 0.6] if i % 2 else [0.3, 0.45, 0.65]
                boxes.append(box(f"box {i}{k}", size, where, sides=UPRIGHT, albedo=paint))
    view = camera(width, height, (1.3, 1.7, 2.3), (0, 0.05, 0), 40)
    return Scene((ground("ground", 1.6, albedo=0.6), *boxes), (sun((-0.7, 1.0, 0.5)),), view)


def louvres(width: int, height: int) -> Scene:
    """Thin slats that are white on both sides, between a lamp and a wall."""
    slats = []
    for k in range(6):
        y, run, rise = 0.3 + 0.25 * k, 0.1, 0.08
        corners = [
            [-0.8, y - rise, run],
            [0.8, y - rise, run],
            [0.8, y + rise, -run],
            [-0.8, y + rise, -run],
        ]
        slats.append(quad(f"slat {k}", corners, albedo=0.75, two_sided=True))
    floor = ground("ground", 2.0, albedo=0.4)
    wall = quad("wall", [[-2, 0, -1], [2, 0, -1], [2, 2, -1], [-2, 2, -1]], albedo=0.6)
    lamp = panel("lamp", 0.0, 2.4, 1.0, 0.8, 0.5, 15.0)
    view = camera(width, height, (1.9, 1.2, 2.9), (0, 0.8, -0.3), 42)
    return Scene((floor, wall, *slats, lamp), (), view)


#: name -> function of width and height in pixels
FURTHER_SCENES: dict[str, Callable[[int, int], Scene]] = {
    "corridor": corridor,
    "table": table,
    "window": window,
    "corner": corner,
    "staircase": staircase,
    "touching": touching,
    "chequer": chequer,
    "louvres": louvres,
}
