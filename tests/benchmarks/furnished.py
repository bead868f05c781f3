"""Rooms that hide light from clusters in other ways than two boxes do (for `scale`)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchradiometry import Patches, subdivide
from torchradiometry.scene.build import box, quad
from torchradiometry.scene.surface import Surface

#: a box that stands on a floor has no bottom; a leg under a plate no top either
STANDING = ("left", "right", "top", "back", "front")
LEG = ("left", "right", "back", "front")
DTYPE = torch.float64


def cut(surfaces: list[Surface], count: int) -> tuple[Patches, Tensor, Tensor, Tensor]:
    """About `count` patches, albedo, exitance, and the blockers."""
    solid = torch.cat([s.vertices[s.faces] for s in surfaces])
    albedo = torch.cat([s.albedo.expand(len(s.faces), 3) for s in surfaces])
    emission = torch.cat([s.emission.expand(len(s.faces), 3) for s in surfaces])
    edge = math.sqrt(4 * float(Patches(solid).area.sum()) / count)
    patches, parent = subdivide(Patches(solid), edge)
    for _ in range(8):
        edge *= math.sqrt(patches.count / count)
        patches, parent = subdivide(Patches(solid), edge)
    return patches, albedo[parent], math.pi * emission[parent], solid


def lamp(x: float, z: float, width: float, depth: float, emission: float) -> Surface:
    """A panel 5 cm below the ceiling, of twice `width` and `depth`."""
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    points = [[x + width * a, 2.45, z + depth * b] for a, b in corners]
    return quad("lamp", points, albedo=0.0, emission=emission, dtype=DTYPE)


def walls(length: float, albedo: object) -> Surface:
    return box("room", (length, 2.5, 3), (0, 1.25, 0), inward=True, albedo=albedo, dtype=DTYPE)


def crates(count: int) -> tuple[Patches, Tensor, Tensor, Tensor]:
    """Sixteen crates of any size and turn."""
    generator = torch.Generator().manual_seed(3)
    found = [walls(3, (0.7, 0.6, 0.5)), lamp(0.3, -0.2, 0.4, 0.3, 10.0)]
    for number in range(16):
        a, b, c, d, turn, shade = torch.rand(6, generator=generator).tolist()
        side, height = 0.15 + 0.3 * a, 0.15 + 0.7 * b
        row, column = divmod(number, 4)
        x, z = 0.7 * row + 0.1 * c - 1.1, 0.7 * column + 0.1 * d - 1.1
        place = (x, height / 2, z)
        size, paint = (side, height, side), 0.3 + 0.5 * shade
        found.append(
            box("crate", size, place, turn=3 * turn, sides=STANDING, albedo=paint, dtype=DTYPE)
        )
    return cut(found, count)


def table(count: int) -> tuple[Patches, Tensor, Tensor, Tensor]:
    """A table and two stools on thin legs."""
    found = [
        walls(3, (0.7, 0.6, 0.5)),
        lamp(-0.5, 0.4, 0.25, 0.25, 20.0),
        box("top", (1.4, 0.05, 0.9), (0.2, 0.75, 0), turn=0.3, albedo=(0.6, 0.4, 0.2), dtype=DTYPE),
    ]
    cosine, sine = math.cos(0.3), math.sin(0.3)
    for x in (-0.6, 0.6):
        for z in (-0.38, 0.38):
            place = (0.2 + cosine * x + sine * z, 0.3625, cosine * z - sine * x)
            found.append(
                box("leg", (0.05, 0.725, 0.05), place, turn=0.3, sides=LEG, albedo=0.3, dtype=DTYPE)
            )
    for x in (-0.9, 1.1):
        found.append(box("seat", (0.4, 0.04, 0.4), (x, 0.45, 0.9), albedo=0.5, dtype=DTYPE))
        for a in (-0.17, 0.17):
            for b in (-0.17, 0.17):
                place = (x + a, 0.215, 0.9 + b)
                found.append(box("leg", (0.03, 0.43, 0.03), place, sides=LEG, dtype=DTYPE))
    return cut(found, count)


def doors(count: int) -> tuple[Patches, Tensor, Tensor, Tensor]:
    """Two rooms joined by a door; one has the lamp."""
    paint = (0.8, 0.75, 0.7)
    parts = (
        ((0.1, 2.5, 1.2), (0, 1.25, -0.9), ("left", "right", "front")),
        ((0.1, 2.5, 0.9), (0, 1.25, 1.05), ("left", "right", "back")),
        ((0.1, 0.5, 0.9), (0, 2.25, 0.15), ("left", "right", "bottom")),
    )
    found = [walls(5, paint), lamp(-1.2, 0.0, 0.3, 0.3, 15.0)]
    found += [box("wall", s, c, sides=k, albedo=paint, dtype=DTYPE) for s, c, k in parts]
    size, place = (0.5, 0.6, 0.5), (1.2, 0.3, 0.2)
    found.append(box("crate", size, place, turn=0.5, sides=STANDING, dtype=DTYPE))
    return cut(found, count)
