"""Triangles of a simple polygon, by cutting off ears.

An ear is a convex corner whose triangle holds no other corner; every simple polygon with more
than three corners has two (G. H. Meisters, "Polygons Have Ears", Amer. Math. Monthly 82, 1975).
Done once when a source is built, on numbers and not on graphs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from torchradiometry.errors import (
    DegenerateGeometryError,
    require_axes,
)
from torchradiometry.geometry.patches import vector_area

if TYPE_CHECKING:
    from jaxtyping import Float, Int
    from torch import Tensor

__all__ = ["triangulate_polygon"]

_Point = tuple[float, float]


def triangulate_polygon(polygon: Float[Tensor, "corner 3"]) -> Int[Tensor, "triangle 3"]:
    """Corner numbers of the `corner - 2` triangles that tile a simple planar polygon.

    Args:
        polygon: corners in m, without crossings; one polygon.

    Returns:
        int64 indices, in the polygon's own sense of rotation.

    Raises:
        DegenerateGeometryError: the outline crosses itself or has no area.

    >>> triangulate_polygon(torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    tensor([[3, 0, 1],
            [1, 2, 3]])
    """
    require_axes("polygon", polygon, None, 3)
    flat = _flatten(polygon.detach().double())
    ring, triangles = list(range(len(flat))), []
    while len(ring) > 3:
        ear = next((i for i in range(len(ring)) if _is_ear(flat, ring, i)), None)
        if ear is None or _crosses_itself(flat):
            raise DegenerateGeometryError(
                "polygon",
                "an outline that crosses itself or repeats a corner",
                "list each corner once, in order around the outline",
            )
        triangles.append([ring[ear - 1], ring[ear], ring[(ear + 1) % len(ring)]])
        del ring[ear]
    return torch.tensor([*triangles, ring], dtype=torch.int64, device=polygon.device)


def _flatten(polygon: Tensor) -> list[_Point]:
    """The corners in a plane where they run counter-clockwise."""
    normal = vector_area(polygon)
    axis = int(normal.abs().argmax())
    first, second = (axis + 1) % 3, (axis + 2) % 3
    if normal[axis] < 0:
        first, second = second, first
    return [(float(p[first]), float(p[second])) for p in polygon]


def _is_ear(points: list[_Point], ring: list[int], i: int) -> bool:
    """Whether corner `i` of the ring is convex and its triangle holds no other corner."""
    a, b, c = ring[i - 1], ring[i], ring[(i + 1) % len(ring)]
    if _turn(points[a], points[b], points[c]) < 0:
        return False
    others = (j for j in ring if j not in (a, b, c))
    return not any(_holds(points[a], points[b], points[c], points[j]) for j in others)


def _crosses_itself(points: list[_Point]) -> bool:
    """Whether two edges cross inside both."""
    edges = list(zip(points, [*points[1:], points[0]], strict=True))
    return any(
        _turn(a, b, c) * _turn(a, b, d) < 0 and _turn(c, d, a) * _turn(c, d, b) < 0
        for i, (a, b) in enumerate(edges)
        for c, d in edges[i + 1 :]
    )


def _turn(a: _Point, b: _Point, c: _Point) -> float:
    """Twice the signed area of a triangle: > 0 for a left turn."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _holds(a: _Point, b: _Point, c: _Point, p: _Point) -> bool:
    """Whether the triangle, its border included, holds the point."""
    return _turn(a, b, p) >= 0 and _turn(b, c, p) >= 0 and _turn(c, a, p) >= 0
