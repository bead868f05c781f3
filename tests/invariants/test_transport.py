"""Laws of form factors: reciprocity, closure, motion, order of faces, split faces."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from tests.cases import TRANSPORT, Case
from tests.invariants import draws
from tests.invariants.draws import Motion, invariant, same
from torchradiometry import transport
from torchradiometry.geometry.patches import Patches

PAIRS = 40
#: pairs have a relative error of 1e-10; those that see little of each other, of the largest
RELATIVE = 1e-10
#: what the exportable rule, one for all pairs, is off by where no corners are shared
ONE_RULE = 1e-6


def pairs(seed: int) -> tuple[Tensor, Tensor]:
    draw = draws.generator(seed)
    first, second = draws.uniform(draw, 2, PAIRS, 3, 3)
    second = second + 2 * draws.units(draw, PAIRS, 1) * draws.uniform(draw, PAIRS, 1, 1)
    return first, second


def room(seed: int) -> Patches:
    """A tetrahedron seen from inside: four triangles that share all edges."""
    draw = draws.generator(seed)
    regular = torch.tensor([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]).double()
    corner = regular + draws.uniform(draw, 4, 3, low=-0.5, high=0.5)
    corner = corner * draws.uniform(draw, 3, low=0.3, high=2)
    faces = corner[torch.tensor([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])]
    inwards = torch.linalg.det(corner[1:] - corner[:1]) > 0
    return Patches(faces if inwards else faces.flip(1))


@given(seed=draws.seeds, scale=draws.factors)
@invariant(PAIRS)
def test_pairs_are_reciprocal_and_move(seed: int, scale: float) -> None:
    first, second = pairs(seed)
    exchange = draws.repeats(lambda: transport.polygon_exchange(first, second))
    assert (exchange >= 0).all()
    assert torch.equal(transport.polygon_exchange(second, first), exchange)
    assert (exchange <= torch.minimum(Patches(first).area, Patches(second).area)).all()
    motion = Motion(seed, scale, reach=1.0)
    moved = transport.polygon_exchange(motion.move(first), motion.move(second))
    same(moved / scale**2, exchange, RELATIVE)


@given(seed=draws.seeds, share=st.floats(0.05, 0.95), corner=st.integers(0, 2))
@invariant(PAIRS)
def test_a_face_split_in_two_exchanges_the_same(seed: int, share: float, corner: int) -> None:
    first, second = pairs(seed)
    a, b, c = first.roll(corner, 1).unbind(1)
    middle = b + share * (c - b)
    parts = [torch.stack(t, 1) for t in ((a, b, middle), (a, middle, c))]
    total = sum(transport.polygon_exchange(part, second) for part in parts)
    same(total, transport.polygon_exchange(first, second), RELATIVE)


@given(seed=draws.seeds, order=st.permutations(range(4)))
@invariant(4)
def test_a_closed_room(seed: int, order: list[int]) -> None:
    patches = room(seed)
    factors = draws.repeats(lambda: transport.form_factors(patches))
    exchange = factors * patches.area.unsqueeze(1)
    same(exchange, exchange.mT)
    same(factors.sum(-1), torch.ones(4).double(), 4 * RELATIVE)
    mixed = transport.form_factors(Patches(patches.corners[order]))
    same(mixed, factors[order][:, order], RELATIVE)
    closed = transport.form_factors(patches, closed=True)
    same(closed.sum(-1), torch.ones(4).double())


@given(seed=draws.seeds)
@invariant(4)
def test_a_blocker_only_darkens(seed: int) -> None:
    """A sheet inside the room: reciprocal, rows of at most 1, nothing above the free room."""
    patches = room(seed)
    draw = draws.generator(seed)
    sheet = patches.corners.mean((0, 1)) + 0.3 * draws.uniform(draw, 1, 3, 3, low=-1)
    rays = transport.BruteForceRays(torch.cat((patches.corners, sheet)))
    free = transport.form_factors(patches)
    factors = draws.repeats(lambda: transport.form_factors(patches, rays, samples=4))
    exchange = factors * patches.area.unsqueeze(1)
    same(exchange, exchange.mT)
    assert (factors <= free * (1 + RELATIVE)).all()
    assert (factors >= 0).all()


@pytest.mark.parametrize("case", TRANSPORT, ids=lambda case: case.name)
@given(seed=draws.seeds, scale=draws.factors, order=st.permutations(range(6)))
@invariant(15)
def test_layers_of_form_factors(case: Case, seed: int, scale: float, order: list[int]) -> None:
    """Six patches in pairs that lie apart (15 exchanges): reciprocal, movable, in any order."""
    layer, draw = case.build(torch.float64), draws.generator(seed)
    corners = draws.uniform(draw, 6, 3, 3) + 3 * torch.arange(6).double().reshape(6, 1, 1)
    factors = draws.repeats(lambda: layer(corners))
    exchange = factors * Patches(corners).area.unsqueeze(1)
    same(exchange, exchange.mT)
    assert (factors >= 0).all()
    assert (factors.sum(-1) <= 1).all()
    motion = Motion(seed, scale)
    same(layer(motion.move(corners)), factors, ONE_RULE)
    same(layer(corners[order]), factors[order][:, order], ONE_RULE)
