"""What all sources share: shapes, lists of sources, superposition, visibility."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.cases import SMALL, SOURCES, directions, rand, surface_points
from tests.tolerances import assert_close
from torchradiometry.errors import DTypeError, InvalidValueError, ShapeError
from torchradiometry.sources import (
    DirectionalSource,
    PointSource,
    SpotSource,
    arrive,
    arriving_irradiance,
    irradiance,
    light_first,
)

DOUBLE = torch.float64


def mixed() -> list:
    return [
        DirectionalSource(directions(2, dtype=DOUBLE), rand(2, 3, dtype=DOUBLE)),
        PointSource(directions(3, dtype=DOUBLE) * 2, rand(3, 1, dtype=DOUBLE)),
        SpotSource(
            torch.tensor([0, 0, 2.0]).double(), torch.tensor([0, 0, -1.0]).double(),
            rand(3, dtype=DOUBLE),
        ),
    ]  # fmt: skip


def test_light_axis_comes_first() -> None:
    points = rand(2, 5, 3, dtype=DOUBLE)
    assert light_first(rand(4, 3, dtype=DOUBLE), points).shape == (4, 1, 1, 3)
    assert light_first(rand(2, 4, 1, dtype=DOUBLE), points).shape == (4, 2, 1, 1)
    with pytest.raises(ShapeError, match="batch axes"):
        light_first(rand(2, 4, 3, dtype=DOUBLE), points[0])


def test_a_mixed_list_is_stacked_and_white_sources_shine_on_all_channels() -> None:
    position, normal = surface_points(DOUBLE, SMALL)
    members = mixed()
    reach = arrive(members, position, normal)
    assert reach.direction.shape == (6, 2, 12, 3)
    assert reach.irradiance.shape == (6, 2, 12, 3)
    assert reach.distance.shape == (6, 2, 12)
    assert [m.lights for m in members] == [2, 3, 1]
    assert_close(arrive(members[1], position, normal).distance, reach.distance[2:5])


@given(seed=st.integers(0, 100))
@settings(deadline=None, max_examples=20)
def test_superposition(seed: int) -> None:
    position = rand(2, 5, 3, dtype=DOUBLE, seed=seed) - 0.5
    normal = directions(2, 5, dtype=DOUBLE, seed=seed)
    visibility = rand(6, 2, 5, dtype=DOUBLE, seed=seed, low=0)
    members = mixed()
    together = irradiance(arrive(members, position, normal), normal, visibility)
    assert_close(arriving_irradiance(members, position, normal, visibility), together)
    apart = torch.zeros_like(together)
    for member, share in zip(members, visibility.split([2, 3, 1]), strict=True):
        apart = apart + irradiance(member(position, normal), normal, share)
    assert_close(together, apart)
    dark = irradiance(arrive(members, position, normal), normal, visibility * 0)
    assert (dark == 0).all()


@pytest.mark.parametrize("case", SOURCES, ids=lambda c: c.name)
def test_nothing_arrives_from_behind_and_all_is_finite(case) -> None:
    source = case.build(DOUBLE)
    position, normal = surface_points(DOUBLE, SMALL)
    reach = source(position, normal)
    assert (reach.irradiance >= 0).all()
    assert torch.isfinite(reach.direction).all()
    assert (irradiance(reach, normal) >= 0).all()
    if source.has_direction and not list(source.parameters()) and source.lights == 2:
        length = reach.direction.norm(dim=-1)
        assert_close(length[reach.irradiance.sum(-1) > 0], 1.0)


@pytest.mark.parametrize("case", SOURCES, ids=lambda c: c.name)
def test_state_moves_and_saves_with_the_module(case) -> None:
    source, other = case.build(torch.float32), case.build(torch.float32)
    for tensor in other.state_dict().values():
        tensor.zero_()
    other.load_state_dict(source.state_dict())
    position, normal = surface_points(torch.float32, SMALL)
    for a, b in zip(source(position, normal), other(position, normal), strict=True):
        assert torch.equal(a, b)
    assert source.double()(position.double(), normal.double()).irradiance.dtype == DOUBLE


def test_mistakes_are_named() -> None:
    position, normal = surface_points(DOUBLE, SMALL)
    with pytest.raises(ShapeError, match="at least one source"):
        arrive([], position, normal)
    with pytest.raises(ShapeError, match="at least one source"):
        arriving_irradiance([], position, normal)
    with pytest.raises(ShapeError, match="6 lights"):
        arriving_irradiance(mixed(), position, normal, rand(5, 2, 12, dtype=DOUBLE))
    with pytest.raises(DTypeError, match="real"):
        DirectionalSource([0, 0, 1j], [1.0])
    with pytest.raises(InvalidValueError, match="finite"):
        PointSource([0, 0, float("nan")], [1.0])
