"""Scenes with lobes, to try the planner on: written down before any plan for them was looked at.

Made as those in `further_scenes`.
"""

from __future__ import annotations

from collections.abc import Callable

from tests.benchmarks.further_scenes import panel
from torchradiometry.scene.build import box, quad, room, sphere
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.standard import UPRIGHT, camera, ground, sun
from torchradiometry.sources.point import PointSource

__all__ = ["SHINY_SCENES"]


def satin_room(width: int, height: int) -> Scene:
    """A painted room with a little gloss everywhere, and a satin box."""
    shell = room((3.6, 2.6, 3.6), panel=(1.0, 0.8), emission=8.0, albedo=0.6)
    satin = tuple(s if bool((s.emission > 0).any()) else s.shiny(0.04, 12.0) for s in shell)
    block = box("box", (0.9, 1.1, 0.7), (-0.3, 0.55, -0.7), turn=0.5, sides=UPRIGHT,
                albedo=[0.6, 0.3, 0.2]).shiny(0.15, 25.0)  # fmt: skip
    view = camera(width, height, (0.8, 1.5, 1.6), (-0.2, 0.9, -1.0), 62)
    return Scene((*satin, block), (), view)


def billiard(width: int, height: int) -> Scene:
    """Hard, bright balls on dull cloth under two near lamps: small sharp highlights."""
    cloth = ground("cloth", 1.2, albedo=[0.1, 0.35, 0.15])
    balls = [
        sphere(f"ball {k}", 0.18, (x, 0.18, z), subdivisions=3, albedo=paint).shiny(0.2, 600.0)
        for k, (x, z, paint) in enumerate(
            ((-0.45, 0.1, [0.7, 0.1, 0.1]), (0.0, -0.3, [0.7, 0.6, 0.1]), (0.4, 0.15, [0.7] * 3))
        )
    ]
    lamps = PointSource([[-0.5, 1.3, 0.4], [0.6, 1.4, -0.2]], [[2.0] * 3, [1.5, 1.5, 1.8]])
    view = camera(width, height, (0.2, 0.9, 1.9), (0, 0.12, 0), 36)
    return Scene((cloth, *balls), (lamps,), view)


def wet_yard(width: int, height: int) -> Scene:
    """Wet ground under a low sun and a shop window: long reflections."""
    floor = ground("yard", 4.0, albedo=0.2).shiny(0.35, 150.0)
    wall = quad("wall", [[-3, 0, -2], [3, 0, -2], [3, 2.4, -2], [-3, 2.4, -2]], albedo=0.5)
    window = quad("window", [[-1, 0.5, -1.95], [1, 0.5, -1.95], [1, 1.6, -1.95], [-1, 1.6, -1.95]],
                  albedo=0.0, emission=4.0)  # fmt: skip
    post = box("post", (0.3, 1.5, 0.3), (1.3, 0.75, -0.6), turn=0.3, sides=UPRIGHT, albedo=0.4)
    view = camera(width, height, (-0.6, 1.2, 3.2), (0.2, 0.5, -1.0), 48)
    return Scene((floor, wall, window, post), (sun((-0.6, 0.5, 0.5), 1.5),), view)


def gallery(width: int, height: int) -> Scene:
    """A polished floor in a long white room with a lamp at its end."""
    shell = box("room", (2.4, 2.4, 6.0), (0, 1.2, 0), inward=True, albedo=0.7,
                sides=("left", "right", "top", "back", "front"))  # fmt: skip
    floor = quad("floor", [[-1.2, 0, 3], [1.2, 0, 3], [1.2, 0, -3], [-1.2, 0, -3]],
                 albedo=[0.3, 0.2, 0.12]).shiny(0.25, 60.0)  # fmt: skip
    lamp = panel("lamp", 0, 2.35, -1.8, 0.8, 0.8, 15.0)
    view = camera(width, height, (0.3, 1.4, 2.8), (0, 0.9, -1.0), 60)
    return Scene((shell, floor, lamp), (), view)


SHINY_SCENES: dict[str, Callable[[int, int], Scene]] = {
    "satin room": satin_room,
    "billiard": billiard,
    "wet yard": wet_yard,
    "gallery": gallery,
}
