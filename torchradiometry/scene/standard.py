"""Scenes to try a model on: one for each thing that light does.

Every function makes the same scene each time, y up, in m, with one camera. What each is for
stands in its first line.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from torchradiometry.geometry.cameras import PinholeCamera, look_at
from torchradiometry.scene.build import SIDES, box, cornell_like_room, quad, room, sphere
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.surface import Surface
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.point import PointSource

__all__ = ["STANDARD_SCENES"]

UPRIGHT = ("left", "right", "top", "back", "front")


def camera(
    width: int, height: int, eye: Sequence[float], target: Sequence[float], degrees: float
) -> tuple[PinholeCamera]:
    """One camera."""
    place = look_at(tuple(eye), tuple(target))
    yfov = math.radians(degrees)
    return (PinholeCamera(width=width, height=height, yfov=yfov, camera_to_world=place),)


def sun(direction: Sequence[float] = (0.5, 1.0, 0.4), irradiance: float = 3.0) -> DirectionalSource:
    """A distant lamp."""
    return DirectionalSource([list(direction)], [[irradiance] * 3])


def ground(name: str, half: float, **options: object) -> Surface:
    """A horizontal square at y = 0 that faces up."""
    h = half
    return quad(name, [[-h, 0, h], [h, 0, h], [h, 0, -h], [-h, 0, -h]], **options)  # type: ignore[arg-type]


def ball(width: int, height: int) -> Scene:
    """One convex body under a distant lamp: a dot product a pixel, nothing else."""
    body = sphere("ball", 1.0, subdivisions=4, albedo=[0.8, 0.5, 0.3])
    return Scene((body,), (sun(),), camera(width, height, (0.5, 1.2, 4.0), (0, 0, 0), 36))


def groove(width: int, height: int) -> Scene:
    """Two planes at 60 degrees: one shades the other, and both brighten the groove by reflexes."""
    run, rise = math.sin(math.radians(30)), math.cos(math.radians(30))
    sides = [
        quad("left", [[0, 0, 1], [0, 0, -1], [-run, rise, -1], [-run, rise, 1]], albedo=0.7),
        quad("right", [[0, 0, -1], [0, 0, 1], [run, rise, 1], [run, rise, -1]], albedo=0.7),
    ]
    view = camera(width, height, (0.1, 3.0, 1.2), (0, 0.35, 0), 38)
    return Scene(tuple(sides), (sun((0.9, 1.0, 0.1)),), view)


def bowl(width: int, height: int) -> Scene:
    """Half a hollow sphere: every point sees every other one equally well."""
    whole = sphere("bowl", 1.0, subdivisions=3, albedo=0.8)
    middle = whole.vertices[whole.faces].mean(1)
    faces = whole.faces[middle[:, 1] < 0].flip(-1)
    normals = None if whole.normals is None else -whole.normals
    inside = Surface("bowl", whole.vertices, faces, whole.albedo, None, normals)  # type: ignore[arg-type]
    view = camera(width, height, (0.0, 2.6, 1.6), (0, -0.4, 0), 38)
    return Scene((inside,), (sun((0.4, 1.0, 0.2)),), view)


def cornell(width: int, height: int) -> Scene:
    """Coloured walls, two boxes, a ceiling panel: penumbras and colour bleeding."""
    return cornell_like_room(width=width, height=height)


def painted_room(width: int, height: int, albedo: float, emission: float) -> Scene:
    """A room and a box of one albedo."""
    walls = room((4.0, 3.0, 5.0), albedo=albedo, panel_albedo=albedo, emission=emission)
    crate = box("box", (1.2, 1.0, 1.0), (0.6, 0.5, -0.8), turn=0.5, sides=UPRIGHT, albedo=albedo)
    return Scene((*walls, crate), (), camera(width, height, (0, 1.5, 2.4), (0, 1.2, -2.5), 60))


def white_room(width: int, height: int) -> Scene:
    """Gilchrist's white room: many bounces fill the shadows."""
    return painted_room(width, height, 0.9, 1.0)


def black_room(width: int, height: int) -> Scene:
    """Gilchrist's black room: hardly any bounce, deep shadows."""
    return painted_room(width, height, 0.05, 100.0)


def two_rooms(width: int, height: int) -> Scene:
    """A lamp in one room, the camera in the next, a door between: bounces only."""
    shells = [
        box(name, (4, 3, 4), (x, 1.5, 0), sides=[s for s in SIDES if s != open_], inward=True,
            albedo=0.75)
        for name, x, open_ in (("dim room", -2.0, "right"), ("bright room", 2.0, "left"))
    ]  # fmt: skip
    parts = [
        [[0, 0, -2], [0, 3, -2], [0, 3, -0.6], [0, 0, -0.6]],
        [[0, 0, 0.6], [0, 3, 0.6], [0, 3, 2], [0, 0, 2]],
        [[0, 2.1, -0.6], [0, 3, -0.6], [0, 3, 0.6], [0, 2.1, 0.6]],
    ]
    wall = quad("partition", parts, albedo=0.75, two_sided=True)
    x, z, y = 2.0, 0.7, 2.97
    corners = [[x - z, y, -z], [x + z, y, -z], [x + z, y, z], [x - z, y, z]]
    panel = quad("panel", corners, albedo=0.5, emission=15.0)
    view = camera(width, height, (-3.6, 1.6, 1.6), (0.2, 1.1, -0.9), 65)
    return Scene((*shells, wall, panel), (), view)


def crate(width: int, height: int) -> Scene:
    """A crate on the ground in the sun: one hard shadow and a weak reflex."""
    body = box("crate", (0.8, 0.8, 0.8), (0, 0.4, 0), turn=0.3, sides=UPRIGHT, albedo=0.6)
    view = camera(width, height, (1.6, 1.9, 3.4), (0, 0.3, 0), 40)
    return Scene((ground("ground", 2.5, albedo=0.4), body), (sun(),), view)


def lamp_and_ball(width: int, height: int) -> Scene:
    """A small lamp just above a ball on a table: light falls off with distance."""
    body = sphere("ball", 0.4, (0.0, 0.4, 0.0), subdivisions=3, albedo=[0.3, 0.5, 0.8])
    lamp = PointSource([[0.7, 1.1, 0.5]], [[1.5] * 3])
    view = camera(width, height, (0.8, 1.6, 3.0), (0, 0.3, 0), 36)
    return Scene((ground("table", 1.5, albedo=0.5), body), (lamp,), view)


def columns(width: int, height: int) -> Scene:
    """A row of columns under a long lamp: wide overlapping penumbras, nearly no reflexes."""
    bars = [
        box(f"column {k}", (0.16, 1.2, 0.16), (-1.2 + 0.6 * k, 0.6, 0), sides=UPRIGHT, albedo=0.3)
        for k in range(5)
    ]
    corners = [[-1.5, 2.2, -1.4], [1.5, 2.2, -1.4], [1.5, 2.2, -1.0], [-1.5, 2.2, -1.0]]
    lamp = quad("lamp", corners, albedo=0.0, emission=8.0)
    view = camera(width, height, (1.2, 1.8, 3.6), (0, 0.5, 0), 42)
    return Scene((ground("ground", 2.5, albedo=0.3), *bars, lamp), (), view)


def shiny_table(width: int, height: int) -> Scene:
    """A varnished table, a glazed ball and a dull box under a lamp: highlights and reflections."""
    table = ground("table", 1.5, albedo=[0.4, 0.25, 0.15]).shiny(0.3, 80.0)
    ball = sphere("ball", 0.35, (-0.4, 0.35, 0.1), subdivisions=3, albedo=[0.1, 0.3, 0.5])
    block = box("box", (0.4, 0.6, 0.4), (0.45, 0.3, -0.1), turn=0.4, sides=UPRIGHT, albedo=0.6)
    corners = [[-0.5, 1.8, -0.9], [0.5, 1.8, -0.9], [0.5, 1.8, -0.4], [-0.5, 1.8, -0.4]]
    lamp = quad("lamp", corners, albedo=0.0, emission=12.0)
    view = camera(width, height, (0.5, 1.1, 2.6), (0, 0.25, 0), 38)
    return Scene((table, ball.shiny(0.25, 200.0), block, lamp), (), view)


#: name -> function of width and height in pixels
STANDARD_SCENES: dict[str, Callable[[int, int], Scene]] = {
    "ball": ball,
    "groove": groove,
    "bowl": bowl,
    "cornell": cornell,
    "white room": white_room,
    "black room": black_room,
    "two rooms": two_rooms,
    "crate": crate,
    "lamp and ball": lamp_and_ball,
    "columns": columns,
    "shiny table": shiny_table,
}
