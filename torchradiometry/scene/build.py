"""Scenes in a few lines of Python: quads, boxes, spheres, rooms.

Colours are a number (the same in three channels) or a list of channels. Every shape is a
`Surface` in world space, y up, in m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
import trimesh
from torch import Tensor

from torchradiometry.arguments import as_numbers
from torchradiometry.errors import OutOfRangeError, ShapeError, require_between, require_whole
from torchradiometry.geometry.cameras import PinholeCamera, look_at
from torchradiometry.numerics import safe_normalize
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.surface import Surface, colours
from torchradiometry.sources.point import PointSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["box", "cornell_like_room", "quad", "room", "sphere"]

#: corners of the unit cube around the origin, numbered by x + 2 y + 4 z
CUBE = [[x - 0.5, y - 0.5, z - 0.5] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
#: its sides, counter-clockwise from outside
SIDES = {
    "left": (0, 4, 6, 2),
    "right": (1, 3, 7, 5),
    "bottom": (0, 1, 5, 4),
    "top": (2, 6, 7, 3),
    "back": (0, 2, 3, 1),
    "front": (4, 5, 7, 6),
}


def quad(
    name: str,
    corners: object,
    *,
    albedo: object = 0.5,
    emission: object = 0.0,
    two_sided: bool = False,
    dtype: torch.dtype | None = None,
) -> Surface:
    """Planar quads, two triangles each.

    Args:
        name: of the surface.
        corners: `4 3` or `quad 4 3`, m, counter-clockwise seen from the front.
        albedo: 0..1, a number or channels.
        emission: W/m2/sr, a number or channels.
        two_sided: the back reflects and emits too.
        dtype: of the tensors, by default torch's default.

    >>> quad("wall", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]).faces
    tensor([[0, 1, 2],
            [0, 2, 3]])
    """
    points = as_numbers("corners", corners, dtype)
    if points.shape[-2:] != (4, 3):
        raise ShapeError("corners", f"shape {tuple(points.shape)}", "pass `4 3` or `quad 4 3`")
    points = points.reshape(-1, 3)
    first = torch.arange(0, len(points), 4, device=points.device).reshape(-1, 1, 1)
    faces = first + torch.tensor([[0, 1, 2], [0, 2, 3]], device=points.device)
    paint, shine = (c.to(points.device) for c in colours(albedo, emission, dtype=points.dtype))
    return Surface(name, points, faces.reshape(-1, 3), paint, shine, two_sided=two_sided)


def box(
    name: str,
    size: Sequence[float],
    centre: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    turn: float = 0.0,
    sides: Sequence[str] = tuple(SIDES),
    inward: bool = False,
    albedo: object = 0.5,
    emission: object = 0.0,
    dtype: torch.dtype | None = None,
) -> Surface:
    """A box, or some of its sides.

    Args:
        name: of the surface.
        size: along x, y, z, m, > 0.
        centre: m.
        turn: about the vertical, radians.
        sides: any of `left right bottom top back front`. Leave the bottom out of a box that
            stands on a floor, so that no two faces lie in the same place.
        inward: the sides face the inside, as walls do.
        albedo, emission, dtype: as for `quad`.

    Raises:
        DTypeError, ShapeError: sizes or centres that are not three numbers.
        OutOfRangeError: lengths that are none, or sides of another name.

    >>> box("crate", (1, 1, 1)).count
    12
    """
    require_between("turn", turn, -math.inf, math.inf, "finite radians")
    size, centre = _numbers("size", size, 3, least=0.0), _numbers("centre", centre, 3)
    unknown = [side for side in sides if side not in SIDES]
    if unknown or not sides:
        raise OutOfRangeError("sides", f"{unknown or sides!r}", f"use {', '.join(SIDES)}")
    dtype = dtype or torch.get_default_dtype()
    cosine, sine = math.cos(turn), math.sin(turn)
    rotation = torch.tensor([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]], dtype=dtype)
    corners = torch.tensor(CUBE, dtype=dtype) * torch.tensor(size, dtype=dtype)
    corners = corners @ rotation.T + torch.tensor(centre, dtype=dtype)
    order = [SIDES[side][::-1] if inward else SIDES[side] for side in sides]
    return quad(name, corners[torch.tensor(order)], albedo=albedo, emission=emission, dtype=dtype)


def sphere(
    name: str,
    radius: float,
    centre: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    subdivisions: int = 3,
    smooth: bool = True,
    albedo: object = 0.5,
    emission: object = 0.0,
    dtype: torch.dtype | None = None,
) -> Surface:
    """A sphere of 20 * 4^subdivisions triangles whose corners lie on it.

    Args:
        name: of the surface.
        radius: m, > 0.
        centre: m.
        subdivisions: 0..7.
        smooth: with the sphere's own normals; otherwise shaded flat.
        albedo, emission, dtype: as for `quad`.

    Raises:
        DTypeError, ShapeError: a radius that is no number, a centre that is not three.
        OutOfRangeError: a radius that is no length, or too many subdivisions.

    >>> sphere("ball", 1.0, subdivisions=1).count
    80
    """
    require_between("radius", radius, 0, math.inf, "a length in m, > 0")
    require_whole("subdivisions", subdivisions, 0, 7)
    centre = _numbers("centre", centre, 3)
    dtype = dtype or torch.get_default_dtype()
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    paint, shine = colours(albedo, emission, dtype=dtype)
    normals = safe_normalize(torch.tensor(ball.vertices, dtype=dtype))
    return Surface(
        name,
        normals * radius + torch.tensor(centre, dtype=dtype),
        torch.tensor(ball.faces, dtype=torch.int64),
        paint,
        shine,
        normals if smooth else None,
    )


def room(
    size: Sequence[float] = (4.0, 3.0, 5.0),
    *,
    panel: Sequence[float] = (1.5, 1.5),
    emission: object = 10.0,
    albedo: object = 0.7,
    left: object = None,
    right: object = None,
    panel_albedo: object = 0.7,
    dtype: torch.dtype | None = None,
) -> tuple[Surface, ...]:
    """A closed room with a shining panel in its ceiling.

    The panel lies in a hole of the ceiling and shares its edges, so that no faces coincide and
    no light leaks. The floor is at y = 0, the room's middle at x = z = 0.

    Args:
        size: along x, y (height), z, m.
        panel: along x and z, m, smaller than the ceiling.
        emission: of the panel, W/m2/sr.
        albedo: of floor, ceiling and walls.
        left, right: albedo of the walls at -x and +x, if another one.
        panel_albedo: of the panel.
        dtype: of the tensors, by default torch's default.

    Returns:
        Surfaces `floor, walls, left wall, right wall, ceiling, panel`.
    """
    size, panel = _numbers("size", size, 3, least=0.0), _numbers("panel", panel, 2, least=0.0)
    width, height, depth = size
    if panel[0] >= width or panel[1] >= depth:
        raise OutOfRangeError("panel", f"{panel!r} m", "make it smaller than the ceiling")
    centre = (0.0, height / 2, 0.0)
    painted = {
        "floor": (("bottom",), albedo),
        "walls": (("back", "front"), albedo),
        "left wall": (("left",), albedo if left is None else left),
        "right wall": (("right",), albedo if right is None else right),
    }
    sides = [
        box(name, size, centre, sides=which, inward=True, albedo=paint, dtype=dtype)
        for name, (which, paint) in painted.items()
    ]
    outer, inner = (_ceiling(x, z, height, dtype) for x, z in ((width, depth), panel))
    ring = torch.stack((outer, outer.roll(-1, 0), inner.roll(-1, 0), inner), 1)
    ceiling = quad("ceiling", ring, albedo=albedo, dtype=dtype)
    shining = quad("panel", inner, albedo=panel_albedo, emission=emission, dtype=dtype)
    return (*sides, ceiling, shining)


def _numbers(
    where: str, values: Sequence[float], count: int, least: float = -math.inf
) -> tuple[float, ...]:
    """So many finite numbers above `least`, or a named error."""
    wanted = f"pass {count} numbers" + ("" if least == -math.inf else f" > {least:g}")
    numbers = as_numbers(where, values, torch.float64)
    if numbers.shape != (count,):
        raise ShapeError(where, f"{values!r}"[:60], wanted)
    if not bool(((numbers > least) & numbers.isfinite()).all()):
        raise OutOfRangeError(where, f"{values!r}"[:60], wanted)
    return tuple(numbers.tolist())


def _ceiling(
    width: float, depth: float, height: float, dtype: torch.dtype | None
) -> Float[Tensor, "4 3"]:
    """A horizontal rectangle, counter-clockwise seen from below."""
    x, z = width / 2, depth / 2
    corners = [[-x, height, -z], [x, height, -z], [x, height, z], [-x, height, z]]
    return torch.tensor(corners, dtype=dtype or torch.get_default_dtype())


def cornell_like_room(
    *,
    width: int = 320,
    height: int = 240,
    lamp: bool = False,
    dtype: torch.dtype | None = None,
) -> Scene:
    """A closed room with a red and a green wall, a ceiling panel, two boxes and a camera.

    In the manner of the Cornell box (Goral et al. 1984), with a fourth wall behind the camera.

    Args:
        width, height: of the camera's picture, pixels.
        lamp: add a point light of 2 W/sr above the low box.
        dtype: of the tensors, by default torch's default.

    >>> scene = cornell_like_room()
    >>> [surface.name for surface in scene.emissive], scene.validate()
    (['panel'], ())
    """
    walls = room((4.0, 3.0, 5.0), left=[0.63, 0.06, 0.05], right=[0.12, 0.45, 0.15], dtype=dtype)
    upright = ("left", "right", "top", "back", "front")
    shapes = {"tall box": (1.8, -0.7, -1.1, 0.35), "low box": (0.9, 0.8, 0.2, -0.3)}
    boxes = [
        box(name, (1.0, high, 1.0), (x, high / 2, z), turn=turn, sides=upright, dtype=dtype)
        for name, (high, x, z, turn) in shapes.items()
    ]
    dtype = dtype or torch.get_default_dtype()
    place = look_at((0.0, 1.5, 2.4), (0.0, 1.3, -2.5)).to(dtype)
    camera = PinholeCamera(width=width, height=height, yfov=math.radians(60), camera_to_world=place)
    position, power = (torch.tensor(v, dtype=dtype) for v in ([0.8, 1.6, 0.2], [2.0] * 3))
    lamps = (PointSource(position, power),) if lamp else ()
    return Scene((*walls, *boxes), lamps, (camera,))
