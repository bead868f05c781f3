"""Triangulation: the triangles tile the polygon."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tolerances import assert_close
from torchradiometry.errors import DegenerateGeometryError
from torchradiometry.geometry import triangulate_polygon, vector_area


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(0.1, 1), min_size=3, max_size=12), st.booleans())
def test_areas_add_up_and_have_one_sign(reach: list[float], reverse: bool) -> None:
    turn = torch.arange(len(reach)).double() * (2 * math.pi / len(reach))
    r = torch.tensor(reach, dtype=torch.float64)
    star = torch.stack((r * torch.cos(turn), 0.3 * r, r * torch.sin(turn)), -1)
    star[:, 1] = star[:, 0] * 0.7  # the plane y = 0.7 x
    star = star.flip(0) if reverse else star
    tiles = star[triangulate_polygon(star)]
    assert tiles.shape == (len(reach) - 2, 3, 3)
    whole = vector_area(star)
    assert_close(vector_area(tiles).sum(0), whole)
    assert bool((vector_area(tiles) @ whole >= -1e-12).all())


def test_collinear_corners() -> None:
    row = torch.tensor([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0.0]])
    assert_close(vector_area(row[triangulate_polygon(row)]).sum(0), vector_area(row))


def test_a_crossing_outline_is_named() -> None:
    star = torch.tensor(
        [[math.cos(k * 4 * math.pi / 5), math.sin(k * 4 * math.pi / 5), 0] for k in range(5)]
    )
    with pytest.raises(DegenerateGeometryError, match="crosses itself"):
        triangulate_polygon(star)
