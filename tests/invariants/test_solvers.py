"""Laws of the radiosity equation, for every solver and every adjoint of the lists."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from tests.cases import ADJOINTS, SOLVERS, Case
from tests.invariants import draws
from tests.invariants.draws import invariant, same
from torchradiometry import solve

SOLVER = pytest.mark.parametrize("case", SOLVERS, ids=lambda case: case.name)
ROOMS, PATCHES = 20, 5
#: what a solver that stops at its tolerance may be off by: `AdaptiveNeumann(1e-9)` of the list
STOPPED = 2e-9


def rooms(seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """Albedo and exitance `room patch channel`, and weights of exchange `room patch patch`."""
    draw = draws.generator(seed)
    return (
        draws.uniform(draw, ROOMS, PATCHES, 1, high=0.9),
        draws.uniform(draw, ROOMS, PATCHES, 1),
        draws.uniform(draw, ROOMS, PATCHES, PATCHES) ** 3,
    )


@SOLVER
@given(seed=draws.seeds, factor=draws.factors, order=st.permutations(range(PATCHES)))
@invariant(ROOMS)
def test_emission_adds_up_in_any_order(
    case: Case, seed: int, factor: float, order: list[int]
) -> None:
    layer = case.build(torch.float64)
    albedo, exitance, weights = rooms(seed)
    found = draws.repeats(lambda: layer(albedo, exitance, weights))
    assert (found >= exitance * (1 - STOPPED)).all()
    parts = draws.uniform(draws.generator(seed + 1), *exitance.shape) * exitance
    both = layer(albedo, parts, weights) + layer(albedo, exitance - parts, weights)
    same(both, found, STOPPED)
    same(layer(albedo, factor * exitance, weights), factor * found, STOPPED)
    mixed = layer(albedo[:, order], exitance[:, order], weights[:, order][..., order])
    same(mixed, found[:, order], STOPPED)


@SOLVER
@given(seed=draws.seeds)
@invariant(ROOMS)
def test_all_light_is_absorbed(case: Case, seed: int) -> None:
    """Closed rooms: sum A M = sum A (1 - rho) E, for solvers that finish."""
    layer = case.build(torch.float64)
    albedo, exitance, weights = rooms(seed)
    operator = layer.operator(weights)
    found = layer(albedo, exitance, weights)
    area = operator.area.unsqueeze(-1)
    lost = (area * (1 - albedo) * operator(found)).sum(-2)
    given_off = (area * exitance).sum(-2)
    if isinstance(layer.layer.solver, solve.Neumann):  # stops after a number of bounces
        assert (lost <= given_off * (1 + 1e-12)).all() or layer.layer.solver.ambient_tail
    else:
        same(lost, given_off, 1e-8)


@SOLVER
@given(seed=draws.seeds)
@invariant(ROOMS)
def test_a_brighter_wall_never_darkens(case: Case, seed: int) -> None:
    layer = case.build(torch.float64)
    albedo, exitance, weights = rooms(seed)
    brighter = albedo + draws.uniform(draws.generator(seed), *albedo.shape) * (0.9 - albedo)
    before, after = (layer(rho, exitance, weights) for rho in (albedo, brighter))
    solver = layer.layer.solver
    if not getattr(solver, "ambient_tail", False):  # a tail is a guess of what is left
        assert (after >= before * (1 - 1e-8)).all()


@given(seed=draws.seeds, bounces=st.integers(0, 12))
@invariant(ROOMS)
def test_more_bounces_never_darken(seed: int, bounces: int) -> None:
    albedo, exitance, weights = rooms(seed)
    operator = next(c for c in SOLVERS).build(torch.float64).operator(weights)
    few, more = (
        solve.Neumann(n).solve(operator, albedo, exitance).radiosity for n in (bounces, bounces + 1)
    )
    exact = solve.Direct().solve(operator, albedo, exitance).radiosity
    assert (few <= more).all()
    assert (more <= exact * (1 + 1e-12)).all()


@SOLVER
@given(seed=draws.seeds)
@invariant(ROOMS)
def test_the_bound_holds(case: Case, seed: int) -> None:
    layer = case.build(torch.float64)
    albedo, exitance, weights = rooms(seed)
    operator = layer.operator(weights)
    with torch.no_grad():
        solution = layer.layer.solver.solve(operator, albedo, exitance)
    exact = solve.Direct().solve(operator, albedo, exitance).radiosity
    off = (solution.radiosity - exact).abs().amax(-2)
    assert (off <= solution.bound + 1e-14 * exact.amax()).all()


@pytest.mark.parametrize("case", ADJOINTS, ids=lambda case: case.name)
@given(seed=draws.seeds)
@invariant(ROOMS)
def test_gradients_are_those_of_the_exact_solution(case: Case, seed: int) -> None:
    """dL/dM is the radiosity of the transposed room; unrolled ones are exact for their series."""
    layer = case.build(torch.float64)
    tensors = [t.requires_grad_() for t in rooms(seed)]
    wanted = draws.uniform(draws.generator(seed + 2), ROOMS, PATCHES, 1)
    found = torch.autograd.grad((layer(*tensors) * wanted).sum(), tensors)
    reference = dataclasses.replace(layer.layer.solver) if _short(layer) else solve.Direct()
    exact = type(layer)(reference, solve.Unrolled())
    expected = torch.autograd.grad((exact(*tensors) * wanted).sum(), tensors)
    for a, b in zip(found, expected, strict=True):
        same(a, b, 1e-10)


def _short(layer: object) -> bool:
    return isinstance(layer.layer.solver, solve.Neumann)  # type: ignore[attr-defined]
