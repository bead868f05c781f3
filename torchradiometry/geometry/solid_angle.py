"""Solid angles: how large a patch, triangle, polygon, cone or sphere looks from a point, in sr.

    patch      omega = A cos(theta) / r^2                       (small against r)
    triangle   tan(omega/2) = a.(b x c) / (|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|)
    cone       omega = 2 pi (1 - cos(alpha)) = 4 pi sin^2(alpha/2)
    sphere     omega = 2 pi (1 - sqrt(1 - (r/d)^2))

a, b, c are the corners seen from the point. The triple product is taken as a.((b-a) x (c-a)),
which does not cancel far away. A polygon is the signed sum of the triangles of a fan, so it
may be non-convex. The triangle's denominator cancels for points close to a large face; there
the spherical excess 2 pi - sum of the outline's turns keeps its digits and is taken instead.

References: A. Van Oosterom and J. Strackee, "The Solid Angle of a Plane Triangle", IEEE
Trans. Biomedical Engineering 30 (1983), eq. 8; D. Forsyth and J. Ponce, *Computer Vision: A
Modern Approach*, 2nd ed. (2011), 2.1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch

from torchradiometry.errors import require_axes
from torchradiometry.geometry.careful import careful_solid_angle, looked_at_twice
from torchradiometry.numerics import (
    alike,
    angle_of,
    dot,
    guarded_divide,
    narrow,
    safe_norm,
    safe_sqrt,
    single,
    wide,
)

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

__all__ = [
    "solid_angle_cone",
    "solid_angle_patch",
    "solid_angle_polygon",
    "solid_angle_sphere",
    "solid_angle_triangle",
]


#: Triangles that look larger than this, in sr, are measured by their spherical excess, whose
#: error is a rounding of 2 pi; for smaller ones the rounding of the arctangent is relative.
_LARGE = 0.1


def solid_angle_patch(
    area: Float[Tensor, "*batch"],
    cosine: Float[Tensor, "*batch"],
    distance: Float[Tensor, "*batch"],
) -> Float[Tensor, "*batch"]:
    """Solid angle of a patch that is small against its distance: A max(0, cos) / r^2.

    Args:
        area: m2.
        cosine: of the angle between the patch normal and the direction to the point; a patch
            that turns its back counts 0.
        distance: m; 0 at distance 0 by convention.

    Returns:
        sr. The relative error is of the order of A / r^2.

    Differentiable in: area, cosine (kink at 0), distance.
    Export: compile yes, ONNX yes.
    References: Forsyth and Ponce (2011), 2.1.

    >>> solid_angle_patch(torch.tensor(4.0), torch.tensor(0.5), torch.tensor(2.0))
    tensor(0.5000)
    """
    for name, tensor in (("area", area), ("cosine", cosine), ("distance", distance)):
        require_axes(name, tensor)
    area, cosine, distance = alike(area, cosine, distance)
    dtype = area.dtype
    area, cosine, distance = single(area, cosine, distance)
    return narrow(
        guarded_divide(guarded_divide(area * cosine.clamp(min=0), distance), distance), dtype
    )


def solid_angle_triangle(
    position: Float[Tensor, "*batch 3"], triangle: Float[Tensor, "*batch 3 3"]
) -> Float[Tensor, "*batch"]:
    """Signed solid angle of a triangle, > 0 where its corners run counter-clockwise.

    In the triangle's own plane: 2 pi inside, pi on an edge, the interior angle on a corner,
    0 outside (the mean of both sides' absolute limits inside a face, and in its plane only).

    Args:
        position: the point, m.
        triangle: three corners, m.

    Returns:
        sr, -2 pi...2 pi.

    Differentiable in: position, triangle (jump in the triangle's plane, inside it).
    Export: compile yes, ONNX yes.
    References: Van Oosterom and Strackee (1983), eq. 8.

    >>> octant = torch.eye(3)
    >>> solid_angle_triangle(torch.zeros(3), octant) / torch.pi
    tensor(-0.5000)
    """
    require_axes("position", position, 3)
    require_axes("triangle", triangle, 3, 3)
    return solid_angle_polygon(position, triangle)


def solid_angle_polygon(
    position: Float[Tensor, "*batch 3"], polygon: Float[Tensor, "*batch corner 3"]
) -> Float[Tensor, "*batch"]:
    """Signed solid angle of any planar polygon, > 0 where its corners run counter-clockwise.

    The sum of the signed triangles of a fan, right for non-convex polygons too. In the
    polygon's own plane: 2 pi inside, pi on an edge, the interior angle on a corner, 0
    outside.

    Args:
        position: the point, m.
        polygon: planar corners, m. Batch axes broadcast.

    Returns:
        sr, -2 pi...2 pi.

    Differentiable in: position, polygon (jump in the polygon's plane, inside it).
    Export: compile yes, ONNX yes.
    References: Van Oosterom and Strackee (1983), eq. 8.

    >>> wall = torch.tensor([[1.0, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]])
    >>> solid_angle_polygon(torch.tensor([0.0, 0, 1]), wall) / torch.pi  # a cube's face
    tensor(0.6667)
    """
    require_axes("position", position, 3)
    require_axes("polygon", polygon, None, 3)
    dtype = torch.promote_types(position.dtype, polygon.dtype)
    position, polygon = wide(position, polygon)
    plain, loss = _plain_solid_angle(position, polygon)
    rows = (position, 1), (polygon, 2)
    rounding = torch.finfo(dtype).eps
    return looked_at_twice(plain, loss, rounding, careful_solid_angle, *rows).to(dtype)


def _plain_solid_angle(position: Tensor, polygon: Tensor) -> tuple[Tensor, Tensor]:
    """In float64, and how many roundings of itself it may be off by."""
    corner = polygon - position.unsqueeze(-2)
    unit = corner.detach().abs().amax((-2, -1), keepdim=True)
    unit = torch.where(unit > 0, unit, 1)
    corner, arm = corner / unit, (polygon[..., 1:, :] - polygon[..., :1, :]) / unit
    a, b, c = corner[..., :1, :], corner[..., 1:-1, :], corner[..., 2:, :]
    area = torch.linalg.cross(arm[..., :-1, :], arm[..., 1:, :])
    volume = -dot(a, area)
    below = _van_oosterom_denominator(a, b, c)
    fan = 2 * angle_of(volume, below)
    with torch.no_grad():
        off = below.abs() * area.abs().amax(-1) + 8 * volume.abs()
        off = 2 * guarded_divide(off, volume * volume + below * below)
    edges = (arm[..., :-1, :], arm[..., 1:, :] - arm[..., :-1, :], -arm[..., 1:, :])
    large = fan.detach().abs() > _LARGE
    fan = torch.where(large, _excess((a, b, c), edges, volume), fan)
    in_plane = (volume == 0).all(-1)
    found = torch.where(in_plane, _winding(corner, area), fan.sum(-1))
    loss = guarded_divide(off.sum(-1), found.detach().abs())
    return found, torch.where(in_plane, 0, loss)


def _van_oosterom_denominator(a: Tensor, b: Tensor, c: Tensor) -> Tensor:
    """|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b| of a triangle."""
    la, lb, lc = (safe_norm(v) for v in (a, b, c))
    return la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb


def _excess(
    corners: tuple[Tensor, Tensor, Tensor], edges: tuple[Tensor, Tensor, Tensor], volume: Tensor
) -> Tensor:
    """2 pi minus the turns of a triangle's outline on the unit sphere, signed.

    The planes through the point and two edges that meet in p turn by atan2(volume |p|, g.g').
    """
    side = [torch.linalg.cross(p, e) for p, e in zip(corners, edges, strict=True)]
    total = 2 * _pi(volume) * torch.sign(volume)
    for i in range(3):
        total = total - angle_of(volume * safe_norm(corners[i]), dot(side[i - 1], side[i]))
    return total


def _winding(corner: Tensor, area: Tensor) -> Tensor:
    """Angle that the outline turns about a point of its plane; an edge through it counts 0."""
    following = corner.roll(-1, -2)
    cross = torch.linalg.cross(corner, following)
    axis = area.sum(-2, keepdim=True).detach()
    side = torch.sign(dot(cross, axis))
    angle = angle_of(safe_norm(cross), dot(corner, following))
    return (side * angle).sum(-1).abs()


def solid_angle_cone(half_angle: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Solid angle of a circular cone: 4 pi sin^2(alpha/2), which keeps its digits when narrow.

    Args:
        half_angle: alpha in rad, 0...pi.

    Returns:
        sr, 0...4 pi.

    Differentiable in: half_angle.
    Export: compile yes, ONNX yes.

    >>> solid_angle_cone(torch.tensor(torch.pi / 2)) / torch.pi
    tensor(2.0000)
    """
    require_axes("half_angle", half_angle)
    return 4 * _pi(half_angle) * torch.sin(half_angle / 2) ** 2


def solid_angle_sphere(
    distance: Float[Tensor, "*batch"], radius: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """Solid angle of a sphere: 2 pi s^2 / (1 + sqrt(1 - s^2)) with s = radius / distance.

    Args:
        distance: to the centre, m.
        radius: m, >= 0.

    Returns:
        sr; 2 pi on the surface, 4 pi inside.

    Differentiable in: distance, radius (outside; the gradient on the surface is cut to that
        of the rational part).
    Export: compile yes, ONNX yes.

    >>> solid_angle_sphere(torch.tensor([2.0, 1.0, 0.5]), torch.tensor(1.0)) / torch.pi
    tensor([0.2679, 2.0000, 4.0000])
    """
    require_axes("distance", distance)
    require_axes("radius", radius)
    dtype = torch.promote_types(distance.dtype, radius.dtype)
    distance, radius = wide(distance, radius)
    inside = distance < radius
    ratio = guarded_divide(radius, torch.where(inside, 0, distance))
    root = safe_sqrt((1 - ratio) * (1 + ratio))
    pi = _pi(ratio)
    return torch.where(inside, 4 * pi, 2 * pi * ratio**2 / (1 + root)).to(dtype)


def _pi(like: Tensor) -> Tensor:
    """Pi in the dtype; the ONNX exporter rounds a Python number to float32."""
    return torch.tensor(math.pi, dtype=like.dtype, device=like.device)
