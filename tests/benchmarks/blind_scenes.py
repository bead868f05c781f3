"""Scenes that were made before any plan for them was looked at: a test of the planner.

Made as those in `torchradiometry.scene.standard`: y up, in m, one camera each. They were chosen to
be unlike the standard and the further scenes: light through slots and bars, lamps that nearly
touch a wall or are very thin, a camera along the floor, meshes of many faces, and scenes of
1 mm and of 1 km.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from tests.benchmarks.further_scenes import panel
from torchradiometry.scene.build import SIDES, box, quad, room, sphere
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.standard import UPRIGHT, camera, ground, sun
from torchradiometry.scene.surface import Surface
from torchradiometry.sources.point import PointSource

__all__ = ["BLIND_SCENES"]

Quad = list[list[float]]


def across_x(x: float, y: tuple[float, float], z: tuple[float, float]) -> Quad:
    """A rectangle that faces -x."""
    return [[x, y[1], z[1]], [x, y[1], z[0]], [x, y[0], z[0]], [x, y[0], z[1]]]


def across_z(z: float, x: tuple[float, float], y: tuple[float, float]) -> Quad:
    """A rectangle that faces +z."""
    return [[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]


def spiral(width: int, height: int) -> Scene:
    """Thin slabs wind up a shaft; the sun comes in through a slot."""
    sides = [s for s in SIDES if s != "right"]
    shaft = box("shaft", (3, 3.8, 3), (0, 1.9, 0), sides=sides, inward=True,
                albedo=[0.62, 0.6, 0.52])  # fmt: skip
    low, high, z, end = (0.0, 1.9), (2.9, 3.8), 0.35, 1.5
    parts = [
        across_x(1.5, low, (-end, end)),
        across_x(1.5, high, (-end, end)),
        across_x(1.5, (1.9, 2.9), (-end, -z)),
        across_x(1.5, (1.9, 2.9), (z, end)),
    ]
    wall = quad("wall with slot", parts, albedo=[0.62, 0.6, 0.52])
    pole = box("pole", (0.2, 3.8, 0.2), (0, 1.9, 0), sides=("left", "right", "back", "front"),
               albedo=[0.3, 0.3, 0.35])  # fmt: skip
    slabs = []
    for k in range(12):
        turn = k * math.pi / 6
        where = (0.72 * math.cos(turn), 0.28 * (k + 1), -0.72 * math.sin(turn))
        slabs.append(box(f"slab {k}", (1.1, 0.05, 0.36), where, turn=turn, albedo=[0.7, 0.5, 0.3]))
    light = sun((0.8, 0.62, 0.12), 20.0)
    view = camera(width, height, (-1.35, 2.0, 1.35), (0.3, 1.5, -0.3), 78)
    return Scene((shaft, wall, pole, *slabs), (light,), view)


def three_rooms(width: int, height: int) -> Scene:
    """A red, a green and a blue room in a row; the lamp in the last, the camera in the middle."""
    paints = {"red": [0.75, 0.25, 0.2], "green": [0.35, 0.7, 0.3], "blue": [0.25, 0.35, 0.75]}
    gone = (("right",), ("left", "right"), ("left",))
    shells = [
        box(f"{name} room", (3, 2.6, 3), (x, 1.3, 0), inward=True, albedo=paint,
            sides=[s for s in SIDES if s not in open_])
        for (name, paint), x, open_ in zip(paints.items(), (-3, 0, 3), gone, strict=True)
    ]  # fmt: skip
    walls = []
    for name, x, a, b in (("first wall", -1.5, -1.0, 0.0), ("second wall", 1.5, 0.1, 1.1)):
        parts = [
            across_x(x, (0, 2.6), (-1.5, a)),
            across_x(x, (0, 2.6), (b, 1.5)),
            across_x(x, (2.0, 2.6), (a, b)),
        ]
        walls.append(quad(name, parts, albedo=[0.8, 0.75, 0.7], two_sided=True))
    lamp = panel("lamp", 3.0, 2.57, 0.2, 1.2, 0.8, [18.0, 16.0, 13.0])  # type: ignore[arg-type]
    view = camera(width, height, (1.2, 1.5, -1.2), (-1.6, 1.0, 0.5), 70)
    return Scene((*shells, *walls, lamp), (), view)


def wall_lamp(width: int, height: int) -> Scene:
    """A small bright cube 3 cm before a wall, above a shelf."""
    wall = quad("wall", across_z(-1.0, (-1.5, 1.5), (0, 2.4)), albedo=[0.7, 0.62, 0.5])
    lamp = box("lamp", (0.1, 0.14, 0.1), (0.3, 1.5, -0.92), albedo=0.0, emission=150.0)
    shelf = box("shelf", (0.9, 0.04, 0.3), (0.1, 1.0, -0.849), albedo=[0.45, 0.3, 0.2],
                sides=[s for s in SIDES if s != "back"])  # fmt: skip
    vase = sphere("vase", 0.12, (-0.15, 1.14, -0.82), subdivisions=2, albedo=[0.2, 0.4, 0.7])
    view = camera(width, height, (-0.6, 1.5, 2.2), (0, 1.1, -0.8), 48)
    floor = ground("floor", 1.5, albedo=[0.5, 0.5, 0.45])
    return Scene((wall, floor, shelf, vase, lamp), (), view)


def thirty_boxes(width: int, height: int) -> Scene:
    """Five by six small boxes on a floor under a square lamp."""
    boxes = []
    for i in range(6):
        for k in range(5):
            size = (0.22, 0.15 + 0.07 * ((5 * i + 2 * k) % 4), 0.2)
            where = (0.45 * (i - 2.5), size[1] / 2, 0.45 * (k - 2))
            paint = [0.2 + 0.1 * i, 0.5, 0.8 - 0.15 * k]
            boxes.append(
                box(f"box {i}{k}", size, where, turn=0.3 * i - 0.2 * k, sides=UPRIGHT, albedo=paint)
            )
    lamp = panel("lamp", 0.4, 2.0, -0.3, 0.9, 0.9, 9.0)
    view = camera(width, height, (-1.4, 1.9, 2.4), (0, 0.05, 0), 42)
    return Scene((ground("floor", 1.8, albedo=[0.65, 0.6, 0.5]), *boxes, lamp), (), view)


def shell(width: int, height: int) -> Scene:
    """A ball inside a hollow sphere; sun and camera look in through a hole."""
    whole = sphere("shell", 1.0, subdivisions=3, albedo=[0.85, 0.8, 0.7])
    way = torch.tensor([0.1, 0.6, 0.8])
    middle = whole.vertices[whole.faces].mean(1)
    kept = torch.nn.functional.normalize(middle, dim=-1) @ way < math.cos(0.75)
    normals = None if whole.normals is None else -whole.normals
    hollow = Surface("shell", whole.vertices, whole.faces[kept].flip(-1), whole.albedo, None,
                     normals, two_sided=True)  # type: ignore[arg-type]  # fmt: skip
    inner = sphere("ball", 0.4, (0.05, -0.25, -0.1), subdivisions=2, albedo=[0.25, 0.55, 0.35])
    view = camera(width, height, (0.5, 1.9, 2.7), (0, 0.1, 0.1), 36)
    return Scene((hollow, inner), (sun((-0.15, 0.75, 0.65), 5.0),), view)


def alcove(width: int, height: int) -> Scene:
    """A white alcove in a black wall above a black floor, in the sun."""
    black, white = [0.02, 0.02, 0.025], [0.92, 0.88, 0.8]
    floor = ground("floor", 2.0, albedo=black)
    parts = [
        across_z(0.0, (-2, -0.6), (0, 2)),
        across_z(0.0, (0.6, 2), (0, 2)),
        across_z(0.0, (-0.6, 0.6), (0, 0.3)),
        across_z(0.0, (-0.6, 0.6), (1.5, 2)),
    ]
    sides = [s for s in SIDES if s != "front"]
    niche = box("alcove", (1.2, 1.2, 0.9), (0, 0.9, -0.45), sides=sides, inward=True, albedo=white)
    view = camera(width, height, (-0.7, 1.2, 3.0), (0, 0.8, -0.2), 40)
    lamp = sun((0.7, 0.6, 1.0), 4.0)
    return Scene((floor, quad("wall", parts, albedo=black), niche), (lamp,), view)


def screen(width: int, height: int) -> Scene:
    """A lamp 3 m long and 3 cm wide behind a screen lights a wall and a floor."""
    wall = quad("wall", across_z(-1.0, (-2, 2), (0, 2.4)), albedo=[0.6, 0.65, 0.7])
    floor = ground("floor", 2.0, albedo=[0.5, 0.4, 0.3])
    lamp = panel("lamp", 0.0, 2.0, -0.6, 3.0, 0.03, 250.0)
    shade = quad("screen", across_z(-0.4, (-1.7, 1.7), (1.2, 2.3)), albedo=[0.3, 0.5, 0.4],
                 two_sided=True)  # fmt: skip
    post = box("post", (0.12, 0.9, 0.12), (0.5, 0.45, 0.2), sides=UPRIGHT, albedo=[0.7, 0.3, 0.3])
    view = camera(width, height, (1.0, 1.0, 3.2), (0, 0.75, -0.5), 46)
    return Scene((wall, floor, shade, post, lamp), (), view)


def lantern(width: int, height: int) -> Scene:
    """A point lamp inside a lantern of bars: its shadows turn a room into a fan."""
    shell_ = box("room", (3, 2.4, 3), (0, 1.2, 0), inward=True, albedo=[0.6, 0.55, 0.5])
    x, y, z = 0.2, 1.1, -0.2
    bars = []
    for k in range(10):
        turn = k * math.pi / 5
        where = (x + 0.15 * math.cos(turn), y, z - 0.15 * math.sin(turn))
        sides = ("left", "right", "back", "front")
        bars.append(box(f"bar {k}", (0.03, 0.4, 0.03), where, turn=turn, sides=sides,
                        albedo=[0.4, 0.35, 0.2]))  # fmt: skip
    plates = [
        box(f"plate {k}", (0.4, 0.03, 0.4), (x, y + 0.215 * k, z), albedo=[0.4, 0.35, 0.2])
        for k in (-1, 1)
    ]
    lamp = PointSource([[x, y, z]], [[2.0, 1.8, 1.4]])
    view = camera(width, height, (-1.2, 1.5, 1.3), (0.1, 1.0, -0.3), 66)
    return Scene((shell_, *bars, *plates), (lamp,), view)


def oblique(width: int, height: int) -> Scene:
    """A camera 25 cm above a long floor with two rows of posts, in a low sun and under lamps."""
    posts = [
        box(f"post {side} {k}", (0.1, 0.5, 0.1), (0.8 * side, 0.25, -1.2 * k), turn=0.4 * k,
            sides=UPRIGHT, albedo=[0.7, 0.35, 0.2])
        for k in range(14)
        for side in (-1, 1)
    ]  # fmt: skip
    corners = [[-3, 0, 3], [3, 0, 3], [3, 0, -30], [-3, 0, -30]]
    floor = quad("floor", corners, albedo=[0.45, 0.5, 0.55])
    lamps = [panel(f"lamp {k}", 0, 2.5, -4.0 - 8 * k, 0.6, 2.0, 6.0) for k in range(2)]
    view = camera(width, height, (0.1, 0.25, 2.5), (0, 0.15, -6), 38)
    return Scene((floor, *posts, *lamps), (sun((1.0, 0.35, -0.3), 1.0),), view)


def mite(width: int, height: int) -> Scene:
    """A room of 1 mm with a ball on its floor."""
    mm = 1e-3
    walls = room((1 * mm, 0.8 * mm, 1 * mm), panel=(0.3 * mm, 0.3 * mm), emission=12.0,
                 albedo=[0.7, 0.7, 0.65], left=[0.2, 0.3, 0.6], right=[0.6, 0.5, 0.1])  # fmt: skip
    body = sphere("ball", 0.18 * mm, (0.1 * mm, 0.1801 * mm, -0.1 * mm), subdivisions=2,
                  albedo=[0.6, 0.2, 0.3])  # fmt: skip
    eye, target = (-0.25 * mm, 0.45 * mm, 0.47 * mm), (0.05 * mm, 0.25 * mm, -0.3 * mm)
    return Scene((*walls, body), (), camera(width, height, eye, target, 68))


def town(width: int, height: int) -> Scene:
    """Towers on a plain of 1 km in the sun."""
    towers = []
    for k in range(14):
        x, z = 180.0 * (k % 4 - 1.5), 170.0 * (k // 4 - 1.5)
        high = 60.0 + 40.0 * ((7 * k) % 5)
        paint = [0.7 - 0.03 * k, 0.5, 0.3 + 0.03 * k]
        towers.append(box(f"tower {k}", (60, high, 50), (x, high / 2, z), turn=0.5 * k,
                          sides=UPRIGHT, albedo=paint))  # fmt: skip
    view = camera(width, height, (300, 420, 700), (0, 30, 0), 50)
    plain = ground("plain", 500.0, albedo=[0.35, 0.45, 0.25])
    return Scene((plain, *towers), (sun((-0.8, 0.7, 0.4), 3.0),), view)


def terrain(width: int, height: int) -> Scene:
    """Hills of 2,048 triangles under a shining ceiling, as under a clouded sky."""
    count = 33
    at = torch.linspace(-1.5, 1.5, count)
    z, x = torch.meshgrid(at, at, indexing="ij")
    y = 0.25 * torch.sin(3.1 * x + 0.5) * torch.cos(2.6 * z) + 0.12 * torch.sin(7 * x + 5 * z)
    first = torch.arange(count - 1)
    a = (first[:, None] * count + first).reshape(-1, 1)
    faces = torch.cat((a, a + count, a + count + 1, a, a + count + 1, a + 1), 1).reshape(-1, 3)
    hills = Surface("hills", torch.stack((x, y, z), -1).reshape(-1, 3), faces,
                    torch.tensor([0.45, 0.6, 0.3]))  # fmt: skip
    sky = panel("sky", 0, 2.0, 0, 6.0, 6.0, 1.0)
    view = camera(width, height, (1.4, 1.3, 2.4), (0, 0, 0), 44)
    return Scene((hills, sky), (), view)


def well(width: int, height: int) -> Scene:
    """A deep white well that a lamp outside of it lights from above; the camera looks down."""
    sides = [s for s in SIDES if s != "top"]
    shaft = box("well", (1.0, 3.0, 1.0), (0, -1.5, 0), sides=sides, inward=True,
                albedo=[0.9, 0.87, 0.82])  # fmt: skip
    lamp = panel("lamp", 0.9, 1.5, 0.0, 0.8, 0.8, 20.0)
    view = camera(width, height, (-0.3, 0.6, 0.3), (0.1, -1.6, -0.1), 58)
    return Scene((shaft, lamp), (), view)


#: name -> function of width and height in pixels
BLIND_SCENES: dict[str, Callable[[int, int], Scene]] = {
    "spiral": spiral,
    "three rooms": three_rooms,
    "wall lamp": wall_lamp,
    "thirty boxes": thirty_boxes,
    "shell": shell,
    "alcove": alcove,
    "screen": screen,
    "lantern": lantern,
    "oblique": oblique,
    "mite": mite,
    "town": town,
    "terrain": terrain,
    "well": well,
}
