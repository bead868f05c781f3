"""Rays at the edge of what has a meaning, through every ray caster of the list."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from tests.cases import RAY_CASTERS
from torchradiometry.errors import InvalidValueError, ShapeError
from torchradiometry.transport import AbstractRayCaster

CASTERS = pytest.mark.parametrize("caster", RAY_CASTERS, ids=lambda c: c.__name__)
SCALES = pytest.mark.parametrize("scale", [2.0**-40, 1.0, 2.0**40])
SHIFTS = pytest.mark.parametrize("shift", [0.0, 1e6])


def square() -> Tensor:
    """Two triangles that share the diagonal of the unit square at z = 1."""
    a, b, c, d = [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]
    return torch.tensor([[a, b, c], [a, c, d]], dtype=torch.float64)


def up(*places: tuple[float, float]) -> tuple[Tensor, Tensor]:
    origin = torch.tensor([[x, y, 0] for x, y in places], dtype=torch.float64)
    return origin, torch.tensor([[0, 0, 1]], dtype=torch.float64).expand_as(origin)


@CASTERS
@SCALES
def test_no_ray_slips_through_a_shared_edge_or_vertex(
    caster: type[AbstractRayCaster], scale: float
) -> None:
    fan = torch.cat([square(), square() + torch.tensor([1.0, 0, 0])])  # share an edge, a vertex
    steps = torch.linspace(0.01, 0.99, 50).tolist()
    places = [(s, s) for s in steps] + [(1.0, s) for s in steps] + [(0.5, 0.5)]
    origin, direction = up(*places)
    found = caster(fan * scale).closest(origin * scale, direction)
    assert found.found.all()
    torch.testing.assert_close(found.distance, torch.full_like(found.distance, scale))


@CASTERS
@SHIFTS
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_scene_far_away_is_seen_as_at_the_origin(
    caster: type[AbstractRayCaster], shift: float, dtype: torch.dtype
) -> None:
    origin, direction = up((0.25, 0.5), (0.75, 0.5), (1.5, 0.5))
    rays = caster((square() + shift).to(dtype))
    found = rays.closest((origin + shift).to(dtype), direction.to(dtype))
    assert found.found.tolist() == [True, True, False]
    assert found.distance[:2].tolist() == [1, 1]


@CASTERS
def test_rays_without_direction_and_segments_without_length_meet_nothing(
    caster: type[AbstractRayCaster],
) -> None:
    rays = caster(square())
    origin, _ = up((0.25, 0.5))
    assert not rays.closest(origin, torch.zeros_like(origin)).found.any()
    assert not rays.occluded(origin, origin).any()


@CASTERS
def test_faces_without_area_are_never_hit(caster: type[AbstractRayCaster]) -> None:
    point, line = torch.ones(1, 3, 3).double(), torch.tensor([[[0, 0, 1], [1, 1, 1], [2, 2, 1.0]]])
    origin, direction = up((1.0, 1.0), (0.5, 0.5))
    found = caster(torch.cat([point, line.double()])).closest(origin, direction)
    assert not found.found.any()
    assert torch.isfinite(found.barycentric).all()


@CASTERS
def test_needles_and_coincident_faces_are_hit_once(caster: type[AbstractRayCaster]) -> None:
    needle = torch.tensor([[[0, 0, 1], [1, 0, 1], [0.5, 1e-3, 1.0]]], dtype=torch.float64)
    origin, direction = up((0.5, 5e-4))
    found = caster(torch.cat([needle, needle, needle.flip(1)])).closest(origin, direction)
    assert found.found.all()
    assert found.distance.item() == pytest.approx(1, rel=1e-12)


@CASTERS
def test_nothing_to_hit_and_nothing_to_ask(caster: type[AbstractRayCaster]) -> None:
    origin, direction = up((0.5, 0.5))
    empty = caster(torch.zeros(0, 3, 3))
    assert not empty.closest(origin, direction).found.any()
    assert not empty.occluded(origin, direction).any()
    none = caster(square()).closest(origin[:0], direction[:0])
    assert none.triangle.shape == (0,)


@CASTERS
def test_bad_corners_are_refused_by_name(caster: type[AbstractRayCaster]) -> None:
    for value in (math.nan, math.inf):
        corners = square()
        corners[0, 0, 0] = value
        with pytest.raises(InvalidValueError, match="corners"):
            caster(corners)
    with pytest.raises(ShapeError, match="corners"):
        caster(square()[0])


@CASTERS
def test_strides_do_not_matter(caster: type[AbstractRayCaster]) -> None:
    origin, direction = up((0.25, 0.5), (0.75, 0.5), (1.5, 0.5))
    wide = torch.stack([square(), square()], -1)[..., 0]
    found = caster(wide).closest(torch.stack([origin, origin], -1)[..., 0], direction)
    assert found.found.tolist() == [True, True, False]
