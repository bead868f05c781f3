"""A second blind test: scenes that were made before any plan for them was looked at.

Written when patches had come to follow importance, so that much of each lies where the camera
does not look: rooms behind rooms, a street around a corner, aisles between shelves. As in
`blind_scenes`, y is up, lengths are in m, and each has one camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from tests.benchmarks.blind_scenes import across_x, across_z
from tests.benchmarks.further_scenes import panel
from torchradiometry.scene.build import SIDES, box, quad, sphere
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.standard import UPRIGHT, camera, ground, sun
from torchradiometry.scene.surface import Surface

__all__ = ["FRESH_SCENES"]


def enfilade(width: int, height: int) -> Scene:
    """Six rooms in a row, each with its own lamp; the camera stands in the first."""
    count, rooms, walls, lamps = 6, [], [], []
    for k in range(count):
        gone = [side for side, open_ in (("left", k > 0), ("right", k < count - 1)) if open_]
        rooms.append(box(f"room {k}", (3, 2.6, 3), (3 * k, 1.3, 0), inward=True,
                         albedo=[0.7 - 0.05 * (k % 4), 0.6, 0.4 + 0.08 * (k % 4)],
                         sides=[s for s in SIDES if s not in gone]))  # fmt: skip
        lamps.append(panel(f"lamp {k}", 3.0 * k, 2.57, 0.2, 0.8, 0.6, 12.0))
    for k in range(count - 1):
        x, (a, b) = 3 * k + 1.5, ((-1.0, 0.0) if k % 2 else (0.1, 1.1))
        parts = [
            across_x(x, (0, 2.6), (-1.5, a)),
            across_x(x, (0, 2.6), (b, 1.5)),
            across_x(x, (2.0, 2.6), (a, b)),
        ]
        walls.append(quad(f"wall {k}", parts, albedo=[0.8, 0.75, 0.7], two_sided=True))
    view = camera(width, height, (-1.2, 1.5, -1.2), (1.4, 1.0, 0.6), 65)
    return Scene((*rooms, *walls, *lamps), (), view)


def street(width: int, height: int) -> Scene:
    """A street of eight houses in the sun, seen from its end, and four more around the corner."""
    houses = []
    for k in range(4):
        for side in (-1, 1):
            high = 7.0 + 2.0 * ((3 * k + side) % 3)
            paint = [0.6, 0.4 + 0.08 * k, 0.35 - 0.1 * side]
            houses.append(box(f"house {side} {k}", (6, high, 7), (6.5 * side, high / 2, -8.0 * k),
                              sides=UPRIGHT, albedo=paint))  # fmt: skip
        houses.append(box(f"far house {k}", (6, 9, 7), (20 + 8.0 * k, 4.5, -36), sides=UPRIGHT,
                          albedo=[0.5, 0.5, 0.55]))  # fmt: skip
    road = quad("road", [[-10, 0, 10], [60, 0, 10], [60, 0, -45], [-10, 0, -45]], albedo=0.3)
    view = camera(width, height, (0.8, 1.7, 8.0), (0.2, 3.0, -12), 58)
    return Scene((road, *houses), (sun((0.5, 0.9, 0.25), 3.0),), view)


def attic(width: int, height: int) -> Scene:
    """Under a roof of two slopes; light comes through the window of one gable."""
    x, y, z = 2.2, 2.4, 3.0
    boards = quad(
        "boards", [[-x, 0, z], [x, 0, z], [x, 0, -z], [-x, 0, -z]], albedo=[0.5, 0.35, 0.2]
    )
    slopes = quad(
        "slopes",
        [
            [[-x, 0, z], [-x, 0, -z], [0, y, -z], [0, y, z]],
            [[x, 0, -z], [x, 0, z], [0, y, z], [0, y, -z]],
        ],
        albedo=[0.75, 0.7, 0.62],
    )
    gables = Surface(
        "gables",
        torch.tensor([[-x, 0, -z], [x, 0, -z], [0, y, -z], [x, 0, z], [-x, 0, z], [0, y, z]]),
        torch.tensor([[0, 1, 2], [3, 4, 5]]),
        torch.tensor([0.8, 0.8, 0.75]),
    )
    window = quad("window", across_z(-z + 0.02, (-0.4, 0.4), (0.6, 1.4)), albedo=0.0, emission=9.0)
    trunk = box("trunk", (0.9, 0.5, 0.5), (-0.7, 0.25, -0.9), turn=0.5, sides=UPRIGHT,
                albedo=[0.3, 0.4, 0.6])  # fmt: skip
    view = camera(width, height, (1.0, 1.1, 2.4), (-0.3, 0.6, -1.5), 62)
    return Scene((boards, slopes, gables, window, trunk), (), view)


def cave(width: int, height: int, subdivisions: int = 3) -> Scene:
    """A bumpy hollow with one lamp behind a pillar."""
    whole = sphere("cave", 2.0, subdivisions=subdivisions, albedo=[0.6, 0.5, 0.4])
    x, y, z = whole.vertices.unbind(-1)
    bump = 1 + 0.12 * torch.sin(3 * x + 1) * torch.cos(4 * y) + 0.08 * torch.sin(5 * z)
    hollow = Surface(
        "cave", whole.vertices * bump.unsqueeze(-1), whole.faces.flip(-1), whole.albedo
    )
    pillar = box("pillar", (0.4, 3.0, 0.4), (0.2, 0.0, -0.3), turn=0.3, albedo=[0.7, 0.7, 0.6])
    lamp = panel("lamp", 0.9, 0.9, -0.9, 0.3, 0.3, 60.0)
    view = camera(width, height, (-1.0, 0.1, 1.1), (0.5, -0.2, -1.0), 70)
    return Scene((hollow, pillar, lamp), (), view)


def library(width: int, height: int) -> Scene:
    """Four shelves across a hall that is lit from two lamps; the camera looks down one aisle."""
    hall = box("hall", (8, 3, 6), (0, 1.5, 0), inward=True, albedo=[0.72, 0.7, 0.64])
    shelves = [
        box(f"shelf {k}", (0.4, 2.1, 4.2), (1.6 * k - 2.4, 1.05, -0.6), sides=UPRIGHT,
            albedo=[0.45 - 0.06 * k, 0.25, 0.12 + 0.08 * k])
        for k in range(4)
    ]  # fmt: skip
    lamps = [panel(f"lamp {k}", 4.0 * k - 2.0, 2.97, 0.5, 0.5, 2.5, 9.0) for k in range(2)]
    view = camera(width, height, (0.1, 1.6, 2.8), (-0.1, 0.9, -2.0), 60)
    return Scene((hall, *shelves, *lamps), (), view)


def lighthouse(width: int, height: int) -> Scene:
    """A thin bright ring of lamps on a tower above rough ground; the camera is far off."""
    tower = box("tower", (0.5, 3.0, 0.5), (0, 1.5, 0), sides=UPRIGHT, albedo=[0.9, 0.9, 0.85])
    lamps = [
        box(f"lamp {k}", (0.12, 0.12, 0.12),
            (0.45 * math.cos(k * math.pi / 3), 2.6, 0.45 * math.sin(k * math.pi / 3)),
            turn=k * math.pi / 3, albedo=0.0, emission=120.0)
        for k in range(6)
    ]  # fmt: skip
    rocks = []
    for k in range(7):
        where = (1.6 * math.sin(2.4 * k), 0.1, 1.6 * math.cos(2.4 * k))
        rocks.append(sphere(f"rock {k}", 0.25 + 0.1 * (k % 3), where, subdivisions=2,
                            albedo=[0.4, 0.4, 0.35 + 0.04 * k]))  # fmt: skip
    view = camera(width, height, (2.6, 2.2, 4.6), (0, 1.0, 0), 42)
    return Scene((ground("ground", 3.0, albedo=[0.45, 0.5, 0.4]), tower, *rocks, *lamps), (), view)


#: name -> function of width and height in pixels
FRESH_SCENES: dict[str, Callable[[int, int], Scene]] = {
    "enfilade": enfilade,
    "street": street,
    "attic": attic,
    "cave": cave,
    "library": library,
    "lighthouse": lighthouse,
}
