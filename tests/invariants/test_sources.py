"""Laws that every source obeys: it moves with the room, and light adds up."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from tests.cases import SOURCES, Case
from tests.invariants import draws
from tests.invariants.draws import Motion, brighter, invariant, same

SOURCE = pytest.mark.parametrize("case", SOURCES, ids=lambda case: case.name)
POINTS = 20
#: the moved scene is up to 60 m from the origin, so places lose that many roundings; the sharpest
#: edge of the cases (a spot of 0.1 rad) multiplies them by its steepness
MOVED = 1e-11


def receivers(seed: int) -> tuple[Tensor, Tensor]:
    """Points all about the lamps and normals of any direction, `1 point 3`."""
    draw = draws.generator(seed)
    return draws.uniform(draw, 1, POINTS, 3, low=-1.5, high=1.5), draws.units(draw, 1, POINTS)


@SOURCE
@given(seed=draws.seeds, scale=draws.factors)
@invariant(POINTS)
def test_moves_with_the_room(case: Case, seed: int, scale: float) -> None:
    source = case.build(torch.float64)
    position, normal = receivers(seed)
    received = draws.repeats(lambda: source.irradiance_on(position, normal))
    motion = Motion(seed + 1, scale)
    found = motion.of(source).irradiance_on(motion.move(position), motion.turn(normal))
    same(found, received, MOVED)


@SOURCE
@given(seed=draws.seeds, factor=draws.factors)
@invariant(POINTS)
def test_light_adds_up(case: Case, seed: int, factor: float) -> None:
    source = case.build(torch.float64)
    position, normal = receivers(seed)
    received = source.irradiance_on(position, normal)
    assert (received >= 0).all()
    same(brighter(source, factor).irradiance_on(position, normal), factor * received)
    shade = draws.uniform(draws.generator(seed), source.lights, 1, POINTS)
    shaded = source.irradiance_on(position, normal, shade)
    assert (shaded <= received * (1 + draws.ROUNDING)).all()
    same(shaded + source.irradiance_on(position, normal, 1 - shade), received)


@SOURCE
@given(seed=draws.seeds, order=st.permutations(range(POINTS)))
@invariant(POINTS)
def test_points_do_not_know_each_other(case: Case, seed: int, order: list[int]) -> None:
    source = case.build(torch.float64)
    position, normal = receivers(seed)
    received = source.irradiance_on(position, normal)
    mixed = source.irradiance_on(position[:, order], normal[:, order])
    same(mixed, received[:, order])
