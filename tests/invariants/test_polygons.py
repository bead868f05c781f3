"""Laws of irradiance and solid angle of polygons, on drawn polygons of 3 to 8 corners."""

from __future__ import annotations

import math

import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from tests.invariants import draws
from tests.invariants.draws import Motion, invariant, same
from torchradiometry.geometry import (
    polygon_irradiance,
    polygon_vector_irradiance,
    solid_angle_polygon,
)

BATCH = 40
#: up to 60 m from the origin, seen from 1 m: places lose six bits, and so do values near 0
MOVED = 1e-12


def scenes(seed: int, corners: int) -> tuple[Tensor, Tensor, Tensor]:
    """Positions, normals and star-shaped polygons about the origin, facing anywhere."""
    draw = draws.generator(seed)
    turn = torch.arange(corners) + draws.uniform(draw, BATCH, corners, high=0.8)
    turn = turn * (2 * math.pi / corners)
    reach = draws.uniform(draw, BATCH, corners, low=0.3).unsqueeze(-1)
    frame = torch.linalg.qr(torch.randn(BATCH, 3, 3, generator=draw, dtype=torch.float64))[0]
    polygon = reach * torch.stack((torch.cos(turn), torch.sin(turn)), -1) @ frame[:, :2]
    distance = 10 ** draws.uniform(draw, BATCH, 1, low=-0.5, high=1.5)
    return distance * draws.units(draw, BATCH), draws.units(draw, BATCH), polygon


@given(seed=draws.seeds, corners=st.integers(3, 8), scale=draws.factors, start=st.integers(1, 7))
@invariant(BATCH)
def test_motion_scale_and_the_first_corner(
    seed: int, corners: int, scale: float, start: int
) -> None:
    position, normal, polygon = scenes(seed, corners)
    motion = Motion(seed, scale)
    held = draws.repeats(lambda: polygon_irradiance(position, normal, polygon, two_sided=True))
    moved = (motion.move(position), motion.turn(normal), motion.move(polygon))
    for again in ((position, normal, polygon.roll(start, 1)), moved):
        same(polygon_irradiance(*again, two_sided=True), held, MOVED)
    phi = polygon_vector_irradiance(position, normal, polygon)
    same(polygon_vector_irradiance(*moved), motion.turn(phi), MOVED)
    omega = draws.repeats(lambda: solid_angle_polygon(position, polygon))
    for at, shape in ((position, polygon.roll(start, 1)), moved[::2]):
        same(solid_angle_polygon(at, shape), omega, MOVED)
    same(solid_angle_polygon(position, polygon.flip(1)), -omega, MOVED)
    # powers of two change no bit
    doubled = polygon_irradiance(2 * position, normal, 2 * polygon, two_sided=True)
    same(doubled, held, MOVED)


@given(seed=draws.seeds, corners=st.integers(4, 8), cut=st.integers(2, 6))
@invariant(BATCH)
def test_parts_add_up(seed: int, corners: int, cut: int) -> None:
    """A diagonal from corner 0 splits a polygon, convex or not, into two signed ones."""
    position, normal, polygon = scenes(seed, corners)
    cut = min(cut, corners - 2)
    first = polygon[:, : cut + 1]
    second = torch.cat((polygon[:, :1], polygon[:, cut:]), 1)
    for law in (
        lambda p: (polygon_vector_irradiance(position, normal, p) * normal).sum(-1),
        lambda p: solid_angle_polygon(position, p),
    ):
        same(law(first) + law(second), law(polygon), MOVED)


@given(seed=draws.seeds, corners=st.integers(3, 8))
@invariant(BATCH)
def test_bounds_and_symmetry_of_sides(seed: int, corners: int) -> None:
    """0 <= E <= solid angle, E <= pi; one side shines, the other not; both normals share it."""
    position, normal, polygon = scenes(seed, corners)
    both = polygon_irradiance(position, normal, polygon, two_sided=True)
    front = polygon_irradiance(position, normal, polygon)
    back = polygon_irradiance(position, normal, polygon.flip(1))
    same(front + back, both)
    assert (front * back == 0).all()
    omega = solid_angle_polygon(position, polygon).abs()
    assert (both <= omega * (1 + MOVED) + MOVED).all()
    assert (both <= math.pi * (1 + MOVED)).all()
    turned = polygon_irradiance(position, -normal, polygon, two_sided=True)
    whole = polygon_vector_irradiance(position, normal, polygon)
    other = polygon_vector_irradiance(position, -normal, polygon)
    same(both + turned, (whole * normal).sum(-1).abs() + (other * normal).sum(-1).abs(), MOVED)


@given(seed=draws.seeds)
@invariant(BATCH)
def test_a_closed_room_is_the_whole_sphere(seed: int) -> None:
    """Inside any tetrahedron of radiance 1 every surface receives pi, and sees 4 pi sr."""
    draw = draws.generator(seed)
    corner = draws.units(draw, BATCH, 4) * draws.uniform(draw, BATCH, 4, 1, low=0.5, high=2)
    inside = draws.uniform(draw, BATCH, 4, 1, low=0.02)
    position = (corner * inside / inside.sum(1, keepdim=True)).sum(1)
    faces = corner[:, torch.tensor([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])]
    turn = torch.linalg.det(corner[:, 1:] - corner[:, :1]).reshape(-1, 1, 1, 1)
    faces = torch.where(turn > 0, faces, faces.flip(2))
    at, up = position.unsqueeze(1), draws.units(draw, BATCH, 1)
    thick = torch.linalg.det(corner[:, 1:] - corner[:, :1]).abs() > 1e-3
    received = polygon_irradiance(at, up, faces).sum(1)[thick]
    same(received, torch.full_like(received, math.pi), 1e-12)
    seen = solid_angle_polygon(at, faces).sum(1).abs()[thick]
    same(seen, torch.full_like(seen, 4 * math.pi), 1e-12)
