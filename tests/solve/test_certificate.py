"""The bound: never below the true error, rounding included, and not far above it."""

import pytest
import torch

from tests.solve.rooms import KINDS, errors_of, exact_solution, room, surfaces, truncated_solvers
from tests.tolerances import assert_close
from torchradiometry import errors, solve

DTYPES = pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
#: errors below this share of the radiosity count as rounding: the bound covers them, but with
#: the worst case of every rounding, which is not within a factor of 10
ROUNDING = {torch.float64: 1e-10, torch.float32: 2e-3}
SOLVERS = (
    solve.Direct(),
    solve.ConjugateGradient(),
    solve.GaussSeidel(),
    solve.Southwell(),
    solve.AdaptiveNeumann(1e-9, 3000),
)


def solver_tolerance(solver: solve.AbstractSolver) -> float:
    return getattr(solver, "tolerance", 2.0**-40)


@DTYPES
@pytest.mark.parametrize("kind", KINDS)
def test_bound_of_truncated_solves(kind: str, dtype: torch.dtype) -> None:
    """error <= bound, and bound <= 10 errors up to albedo 0.9, for every truncated solver."""
    for patches, seed in ((2, 0), (9, 1), (30, 2)):
        operator = room(kind, patches, dtype, seed)
        albedo, exitance = surfaces(patches, dtype, seed)
        exact = exact_solution(operator, albedo, exitance)
        for solver in truncated_solvers(patches):
            found = solver.solve(operator, albedo, exitance)
            error, bound = errors_of(found, exact), found.bound.double().numpy()
            assert (error <= bound).all(), solver
            matters = error > ROUNDING[dtype] * exact.max(0)
            assert (bound <= 10 * error)[matters].all(), solver


@DTYPES
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
def test_bound_of_converged_solves_covers_rounding(solver, dtype: torch.dtype) -> None:
    for kind in KINDS:
        operator = room(kind, 25, dtype)
        albedo, exitance = surfaces(25, dtype, most=0.97)
        exact = exact_solution(operator, albedo, exitance)
        found = solver.solve(operator, albedo, exitance)
        assert (errors_of(found, exact) <= found.bound.double().numpy()).all(), kind
        assert (found.status == solve.Status.BOUNDED).all(), kind
        if not isinstance(solver, solve.AdaptiveNeumann):  # which computes in the dtype given
            # the stopping rule and the worst case of all roundings, over 1 - q; then the cast
            share = 4 * 41 * torch.finfo(torch.float64).eps / 0.03 + 2 * torch.finfo(dtype).eps
            assert (found.bound.double().numpy() <= share * exact.max(0)).all(), kind


def test_bound_holds_for_signed_light() -> None:
    """Exitance and radiosity below 0 cost more rounding, which the bound knows."""
    operator = room("closed", 40, torch.float32)
    albedo, exitance = surfaces(40, torch.float32)
    exitance = exitance - exitance.mean(0)
    exact = exact_solution(operator, albedo, exitance)
    for solver in (solve.Neumann(60), solve.Neumann(60, True), solve.ConjugateGradient()):
        found = solver.solve(operator, albedo, exitance)
        assert (errors_of(found, exact) <= found.bound.double().numpy()).all()


def test_a_given_radiosity_is_certified() -> None:
    operator = room("closed", 12, torch.float64)
    albedo, exitance = surfaces(12, torch.float64)
    exact = exact_solution(operator, albedo, exitance)
    found = solve.certified(operator, albedo, exitance, exitance)
    assert (errors_of(found, exact) <= found.bound.numpy()).all()
    residual = (albedo * operator(exitance)).abs().amax(0)
    assert_close(found.residual, residual)


def test_white_patches_are_bounded_by_a_supersolution() -> None:
    """q = 1 says nothing, (I - T) z >= w > 0 does."""
    operator = room("closed", 12, torch.float64)
    albedo, exitance = surfaces(12, torch.float64, most=0.5)
    albedo[3] = 1
    exact = exact_solution(operator, albedo, exitance)
    for solver in SOLVERS[:4]:
        found = solver.solve(operator, albedo, exitance)
        assert (errors_of(found, exact) <= found.bound.numpy()).all()
        assert (found.bound < 1e-10).all()
        assert (found.status == solve.Status.BOUNDED).all()
    open_ended = solve.Neumann(3).solve(operator, albedo, exitance)
    assert torch.isinf(open_ended.bound).all()
    assert (open_ended.status == solve.Status.UNBOUNDED).all()


def test_inverse_norm() -> None:
    operator = room("closed", 12, torch.float64)
    uniform = torch.full((12, 1), 0.75, dtype=torch.float64)
    ones = torch.ones_like(uniform)
    assert_close(solve.inverse_norm(operator, uniform, ones), 4.0, rtol=1e-12)
    assert torch.isinf(solve.inverse_norm(operator, ones, ones)).all()


def test_albedo_one_in_a_closed_room() -> None:
    operator = room("closed", 12, torch.float64)
    _, exitance = surfaces(12, torch.float64)
    white = torch.ones_like(exitance)
    for solver in SOLVERS[:4]:
        with pytest.raises(errors.SingularSystemError, match="lower some albedo"):
            solver.solve(operator, white, exitance)
    for solver, status in (
        (solve.Neumann(3), solve.Status.UNBOUNDED),
        (solve.Neumann(3, ambient_tail=True), solve.Status.UNBOUNDED),
        (solve.AdaptiveNeumann(max_bounces=5), solve.Status.SINGULAR),
    ):
        found = solver.solve(operator, white, exitance)
        assert torch.isinf(found.bound).all()
        assert torch.isfinite(found.radiosity).all()
        assert (found.status == status).all()
        assert "below 1" in solve.advice(found.status)


def test_a_white_closed_corner_of_a_room_is_found() -> None:
    """Two rooms without a door, one of them white: no solution, though light is lost elsewhere."""
    first, second = room("closed", 6, torch.float64), room("closed", 6, torch.float64, seed=1)
    factors = torch.block_diag(first.form_factors, second.form_factors)
    operator = solve.DenseOperator(factors, torch.cat((first.area, second.area)))
    albedo = torch.full((12, 1), 0.5, dtype=torch.float64)
    albedo[6:] = 1
    for solver in SOLVERS[:4]:
        with pytest.raises(errors.SingularSystemError):
            solver.solve(operator, albedo, albedo)
    albedo[6] = 0.9
    for solver in SOLVERS[:2]:
        assert (solver.solve(operator, albedo, albedo).bound < 1e-9).all()
