"""Solvers: closed forms, a bound that holds, statuses with advice, gradients, graphs."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn
from torch.autograd import gradcheck

from tests.cases import OTHER, SMALL, SOLVERS, enclosure, rand
from tests.solve.rooms import errors_of, exact_solution, room, surfaces
from tests.tolerances import assert_close
from torchradiometry import errors, export, shade, solve

DTYPES = pytest.mark.parametrize("dtype", [torch.float64, torch.float32])


def system(dtype: torch.dtype, patches: int = 12, albedo: float = 0.8) -> tuple[Tensor, ...]:
    """Closed reciprocal form factors of equal areas, albedo and exitance of three channels."""
    share = rand(patches, patches, dtype=torch.float64, seed=1)
    share = (share + share.mT).fill_diagonal_(0)
    for _ in range(400):
        scale = share.sum(-1).rsqrt()
        share = scale.unsqueeze(-1) * share * scale
    return (
        share.to(dtype),
        rand(patches, 3, dtype=dtype, seed=2, high=albedo),
        rand(patches, 3, dtype=dtype, seed=3),
    )


#: solvers that iterate until rounding, and the one that needs no iteration
CONVERGING = (
    solve.Direct(),
    solve.ConjugateGradient(),
    solve.GaussSeidel(),
    solve.Southwell(at_once=4),
)


def operator_of(factors: Tensor) -> solve.DenseOperator:
    """Symmetric form factors: equal areas."""
    return solve.DenseOperator(factors, torch.ones_like(factors[..., 0]))


def every_solver() -> list[solve.AbstractSolver]:
    return [case.build(torch.float64).layer.solver for case in SOLVERS]


@DTYPES
@pytest.mark.parametrize("case", SOLVERS, ids=lambda c: c.name)
def test_furnace(case, dtype: torch.dtype) -> None:
    """Exitance 1 - rho in a closed room: every patch has B = 1."""
    factors, albedo, _ = system(dtype, albedo=0.3)
    solver = case.build(dtype).layer.solver
    found = solver.solve(
        solve.DenseOperator(factors, torch.ones(12, dtype=dtype)), albedo, 1 - albedo
    )
    assert_close(found.radiosity, 1.0, atol=float(found.bound.max()) + 1e-6, rtol=0)
    if solver.promises:
        assert_close(found.radiosity, 1.0)


@DTYPES
def test_uniform_enclosure_is_a_geometric_series(dtype: torch.dtype) -> None:
    factors, _, _ = system(dtype)
    albedo = torch.full((12, 1), 0.5, dtype=dtype)
    found = solve.Neumann(9).solve(factors, albedo, albedo)
    assert_close(found.radiosity, 1 - 0.5**10)
    # and the worst case of (12 + 10 + 16) roundings of some 4 B, over 1 - q
    rounding = 38 * torch.finfo(dtype).eps * 4
    assert (found.bound >= 0.5**10).all()
    assert_close(found.bound, 0.5**10, rtol=0, atol=rounding)
    tail = solve.Neumann(0, ambient_tail=True).solve(factors, albedo, albedo)
    assert_close(tail.radiosity, 1.0)


@settings(deadline=None, max_examples=50)
@given(
    seed=st.integers(0, 10**6), bounces=st.integers(0, 12), tail=st.booleans(),
    albedo=st.floats(0.15, 0.95),
)  # fmt: skip
def test_the_bound_holds(seed: int, bounces: int, tail: bool, albedo: float) -> None:
    factors, _, _ = system(torch.float64)
    rho = rand(12, 2, dtype=torch.float64, seed=seed, high=albedo)
    exitance = rand(12, 2, dtype=torch.float64, seed=seed + 1) ** 8
    exact = solve.Direct().solve(factors, rho, exitance).radiosity
    found = solve.Neumann(bounces, tail).solve(factors, rho, exitance)
    error = (found.radiosity - exact).abs().amax(0)
    assert (error <= found.bound).all()
    residual = (exitance + rho * (factors @ found.radiosity) - found.radiosity).abs().amax(0)
    assert_close(found.residual, residual, atol=1e-14)


def test_more_bounces_never_darken_and_the_tail_helps() -> None:
    factors, albedo, exitance = system(torch.float64)
    exact = solve.Direct().solve(factors, albedo, exitance).radiosity
    previous = torch.zeros_like(exact)
    for bounces in range(6):
        plain = solve.Neumann(bounces).solve(factors, albedo, exitance)
        tail = solve.Neumann(bounces, ambient_tail=True).solve(factors, albedo, exitance)
        assert (plain.radiosity >= previous).all()
        assert (tail.radiosity - exact).abs().max() < (plain.radiosity - exact).abs().max() / 3
        assert (tail.bound < plain.bound).all()
        previous = plain.radiosity
        assert plain.iterations == bounces + 1
        assert tail.iterations == bounces + 7  # three for the tail, three for its bound


@pytest.mark.parametrize("kind", ["closed", "sparse", "spiky"])
def test_the_tail_of_a_room_of_one_albedo_holds_all_light_that_was_left(kind: str) -> None:
    """sum A B is exact, and patches that see nothing (walled in) change nothing."""
    found = room(kind, 24, torch.float64, seed=3)
    walled = torch.nn.functional.pad(found.form_factors, (0, 5, 0, 5))
    area = torch.cat((found.area, torch.full((5,), 7.0, dtype=torch.float64)))
    albedo = torch.full((29, 1), 0.9, dtype=torch.float64)
    exitance = torch.rand(29, 1, dtype=torch.float64) * (torch.arange(29) < 24).unsqueeze(-1)
    operator = solve.DenseOperator(walled, area)
    exact = (solve.Direct().solve(operator, albedo, exitance).radiosity.T @ area).item()
    plain, tail = (
        (solve.Neumann(3, ambient_tail=t).solve(operator, albedo, exitance).radiosity.T @ area)
        for t in (False, True)
    )
    assert plain.item() < 0.5 * exact
    assert abs(tail.item() - exact) <= 1e-12 * exact
    assert (tail >= plain).all()


def test_albedo_zero_and_no_light() -> None:
    factors, albedo, exitance = system(torch.float64)
    for solver in every_solver():
        black = solver.solve(operator_of(factors), albedo * 0, exitance)
        assert_close(black.radiosity, exitance)
        assert (black.bound < 1e-13).all()
        assert (black.status == solve.Status.BOUNDED).all()
        dark = solver.solve(operator_of(factors), albedo, exitance * 0)
        assert (dark.radiosity == 0).all()
        assert (dark.bound == 0).all()


def test_status_and_advice() -> None:
    factors, albedo, exitance = system(torch.float64)
    assert "add bounces" in solve.advice(solve.Neumann(1).solve(factors, albedo, exitance).status)
    for solver in every_solver():
        broken = solver.solve(operator_of(factors), albedo, exitance * torch.nan)
        assert (broken.status == solve.Status.NOT_FINITE).all()
        assert torch.isinf(broken.bound).all()
        assert "check" in solve.advice(broken.status)


@pytest.mark.parametrize(
    "solver",
    [
        solve.ConjugateGradient(max_iterations=2),
        solve.GaussSeidel(max_sweeps=1),
        solve.Southwell(max_shots=5),
        solve.Southwell(max_seconds=0),
        solve.AdaptiveNeumann(1e-9, max_bounces=3),
    ],
    ids=repr,
)
def test_a_solver_that_stops_early_says_so(solver) -> None:
    factors, albedo, exitance = system(torch.float64)
    found = solver.solve(operator_of(factors), albedo, exitance)
    assert (found.status == solve.Status.NOT_CONVERGED).all()
    assert "more iterations" in solve.advice(found.status)
    exact = solve.Direct().solve(factors, albedo, exitance).radiosity
    assert ((found.radiosity - exact).abs().amax(0) <= found.bound).all()
    tail = replace(solver, ambient_tail=True).solve(operator_of(factors), albedo, exitance)
    assert ((tail.radiosity - exact).abs().amax(0) < (found.radiosity - exact).abs().amax(0)).all()


@pytest.mark.parametrize(
    "solver",
    [
        solve.ConjugateGradient(1e-3),
        solve.GaussSeidel(1e-3),
        solve.Southwell(1e-3),
        solve.AdaptiveNeumann(1e-3),
    ],
    ids=repr,
)
def test_the_tolerance_is_kept_and_not_by_far(solver) -> None:
    factors, albedo, exitance = system(torch.float64, patches=40)
    exact = solve.Direct().solve(factors, albedo, exitance).radiosity
    found = solver.solve(operator_of(factors), albedo, exitance)
    error = (found.radiosity - exact).abs().amax(0) / exact.amax(0)
    assert (error <= 1e-3).all()
    assert (error > 1e-8).all()
    assert (found.status == solve.Status.BOUNDED).all()


@DTYPES
@pytest.mark.parametrize("albedo", [0.5, 0.99, 0.999])
def test_closed_rooms_agree_with_their_exact_solution(albedo: float, dtype: torch.dtype) -> None:
    """Sphere: F_ij = A_j / S, so B = M + rho a, a = sum A M / sum A (1 - rho) by hand."""
    count = 64  # a power of two: the form factors of equal areas are exact in both dtypes
    area = torch.full((count,), 0.25, dtype=dtype)
    factors = (area / area.sum()).expand(count, count)
    rho = torch.full((count, 2), albedo, dtype=dtype)
    rho[:, 1] = rand(count, dtype=dtype, low=albedo / 2, high=albedo)
    exitance = rand(count, 2, dtype=dtype, seed=6) ** 8
    wide_rho, wide_exitance = rho.double(), exitance.double()
    arriving = wide_exitance.mean(0) / (1 - wide_rho).mean(0)
    exact = wide_exitance + wide_rho * arriving
    condition = 2 / (1 - albedo)
    allowed = 1e-15 * condition if dtype == torch.float64 else 3e-5
    for solver in CONVERGING:
        found = solver.solve(solve.DenseOperator(factors, area), rho, exitance)
        assert (found.status == solve.Status.BOUNDED).all()
        error = (found.radiosity.double() - exact).abs() / exact.amax(0)
        assert error.max() <= allowed, solver


@DTYPES
def test_closed_random_rooms_of_albedo_0_999(dtype: torch.dtype) -> None:
    operator = room("closed", 50, dtype)
    albedo, exitance = surfaces(50, dtype, most=0.999)
    exact = exact_solution(operator, albedo, exitance)
    allowed = 1e-15 * 2000 if dtype == torch.float64 else 3e-5
    for solver in CONVERGING:
        found = solver.solve(operator, albedo, exitance)
        assert (errors_of(found, exact) <= allowed * exact.max(0)).all(), solver


def test_two_plates() -> None:
    """F = [[0, f], [f, 0]]: B_1 = (M_1 + rho_1 f M_2) / (1 - rho_1 rho_2 f^2)."""
    f, rho, light = 0.4, torch.tensor([0.9, 0.5]).double(), torch.tensor([2.0, 1.0]).double()
    expected = (light + rho * f * light.flip(0)) / (1 - rho.prod() * f**2)
    operator = operator_of(torch.tensor([[0, f], [f, 0]], dtype=torch.float64))
    for solver in CONVERGING:
        found = solver.solve(operator, rho[:, None], light[:, None]).radiosity
        assert_close(found[:, 0], expected, rtol=1e-11)


def test_one_patch_and_systems_of_a_batch_do_not_disturb_each_other() -> None:
    factors, albedo, exitance = system(torch.float64)
    lights = torch.stack((exitance, exitance * 0, exitance.flip(0) ** 9))
    albedos = torch.stack((albedo, albedo, albedo / 9))
    for solver in every_solver():
        together = solver.solve(operator_of(factors), albedos, lights)
        assert together.bound.shape == (3, 3)
        for number in range(3):
            alone = solver.solve(operator_of(factors), albedos[number], lights[number])
            difference = (together.radiosity[number] - alone.radiosity).abs().amax(0)
            assert (difference <= together.bound[number] + alone.bound).all()
            assert (together.bound[number] <= 1.5 * alone.bound + 1e-12).all()
        sphere = solver.solve(operator_of(factors[:1, :1] * 0 + 0.5), albedo[:1], exitance[:1])
        assert_close(
            sphere.radiosity, exitance[:1] / (1 - albedo[:1] / 2),
            rtol=0, atol=float(sphere.bound.max()),
        )  # fmt: skip


def test_batched_form_factors() -> None:
    both = torch.stack([room("open", 12, torch.float64, seed).form_factors for seed in (0, 1)])
    areas = torch.stack([room("open", 12, torch.float64, seed).area for seed in (0, 1)])
    _, albedo, exitance = system(torch.float64)
    for solver in every_solver():
        found = solver.solve(solve.DenseOperator(both, areas), albedo.expand(2, 12, 3), exitance)
        for number in range(2):
            alone = solve.DenseOperator(both[number], areas[number])
            expected = solver.solve(alone, albedo, exitance)
            difference = (found.radiosity[number] - expected.radiosity).abs().amax(0)
            assert (difference <= found.bound[number] + expected.bound).all()


def test_bounces_sum_to_the_radiosity() -> None:
    factors, albedo, exitance = system(torch.float64)
    for tail in (False, True):
        found = solve.Neumann(4, tail, per_bounce=True).solve(factors, albedo, exitance)
        assert found.bounces is not None
        assert found.bounces.shape == (5 + tail, 12, 3)
        assert_close(found.bounces.sum(-3), found.radiosity)
        assert_close(found.radiosity, solve.Neumann(4, tail).solve(factors, albedo, exitance)[0])
        assert_close(found.bounces[1], albedo * (factors @ exitance))
    exact = solve.Direct().solve(factors, albedo, exitance)
    parts = solve.separate_bounces(exact, factors, albedo, exitance, 2).bounces
    assert parts is not None
    assert_close(parts.sum(-3), exact.radiosity)
    assert_close(parts[2], albedo * (factors @ (albedo * (factors @ exitance))))
    assert (parts > 0).all()


def test_southwell_shoots_the_brightest_first_and_only_brightens() -> None:
    factors, albedo, exitance = system(torch.float64)
    light = exitance.clone()
    light[5] = 50
    first = solve.Southwell(max_shots=1, at_once=4).solve(operator_of(factors), albedo, light)
    assert_close(first.radiosity, light + albedo * factors[:, 5:6] * light[5])
    previous = light
    for shots in range(1, 12):
        now = solve.Southwell(max_shots=shots, at_once=1).solve(factors, albedo, light).radiosity
        assert (now >= previous).all()
        previous = now


def test_gauss_seidel_is_the_textbook_loop() -> None:
    """One sweep over more than two blocks against a loop over patches."""
    patches = 150
    factors = room("open", patches, torch.float64).form_factors
    albedo, exitance = surfaces(patches, torch.float64)
    found = solve.GaussSeidel(max_sweeps=1).solve(factors, albedo, exitance).radiosity
    expected = exitance.clone()
    for i in range(patches):
        expected[i] = exitance[i] + albedo[i] * (factors[i] @ expected)
    assert_close(found, expected)


def test_linearity_and_superposition() -> None:
    factors, albedo, exitance = system(torch.float64)
    other = rand(12, 3, dtype=torch.float64, seed=9)
    for solver in (*CONVERGING, solve.Neumann(5), solve.Neumann(2, ambient_tail=True)):
        one, two, both = (
            solver.solve(operator_of(factors), albedo, m).radiosity
            for m in (exitance, other, 2 * exitance + other)
        )
        assert_close(both, 2 * one + two, rtol=1e-11)


@pytest.mark.parametrize("case", SOLVERS, ids=lambda c: c.name)
def test_gradients(case) -> None:
    factors, albedo, exitance = system(torch.float64, patches=4)
    inputs = [t[..., :2].clone() if t is not factors else t.clone() for t in (albedo, exitance)]
    inputs = [t.requires_grad_() for t in (*inputs, factors.clone())]
    assert gradcheck(case.build(torch.float64), inputs)


EXPORTED = (solve.Neumann(3, ambient_tail=True), solve.AdaptiveNeumann(1e-3, ambient_tail=True))


class Certified(nn.Module):
    """Radiosity, residual and bound of a layer."""

    def __init__(self, solver: solve.AbstractSolver) -> None:
        super().__init__()
        self.layer = shade.RadiosityShading(solver=solver)

    def forward(self, albedo: Tensor, exitance: Tensor, form_factors: Tensor) -> tuple[Tensor, ...]:
        found = self.layer.solution(albedo, exitance, form_factors)
        return found.radiosity, found.residual, found.bound


def test_the_adaptive_loop_compiles() -> None:
    """`Neumann` does so in the test of all layers."""
    module = Certified(EXPORTED[-1]).eval()
    compiled = torch.compile(module, fullgraph=True, dynamic=True, backend="aot_eager")
    for sizes in (SMALL, OTHER):
        tensors = enclosure(torch.float32, sizes)
        for a, b in zip(compiled(*tensors), module(*tensors), strict=True):
            assert_close(a, b, rtol=2.0**-17)


@pytest.mark.parametrize("solver", EXPORTED, ids=repr)
def test_exports_with_a_dynamic_patch_axis(solver, tmp_path: Path) -> None:
    module, inputs = Certified(solver).eval(), enclosure(torch.float32, SMALL)
    axes = {
        "albedo": ("batch", "patch", "channel"),
        "exitance": ("batch", "patch", "channel"),
        "form_factors": ("patch", "patch"),
    }
    path = export.export_onnx(
        module, inputs, tmp_path / "radiosity.onnx", axes=axes,
        outputs={"radiosity": "W/m2", "residual": "W/m2", "bound": "W/m2"},
        units={"form_factors": "1", "exitance": "W/m2"},
    )  # fmt: skip
    # form factors as a scene has them, rows sum to less than 1; few and many bounces
    generator = torch.Generator().manual_seed(5)
    bounces = set()
    for patches, albedo in ((7, 0.9), (20, 0.3), (40, 0.97)):
        other = {
            "albedo": torch.rand(3, patches, 2, generator=generator) * albedo,
            "exitance": torch.rand(3, patches, 2, generator=generator),
            "form_factors": torch.rand(patches, patches, generator=generator) / patches * 1.9,
        }
        check = export.check_onnx(path, module, inputs=other)
        assert check.passed, check
        factors = other["form_factors"]
        bounces.add(solver.solve(factors, other["albedo"], other["exitance"]).iterations)
    assert len(bounces) == (3 if isinstance(solver, solve.AdaptiveNeumann) else 1)


def test_bad_arguments_are_named() -> None:
    with pytest.raises(errors.OutOfRangeError, match="0 or more"):
        solve.Neumann(-1)
    with pytest.raises(errors.DTypeError, match="whole number"):
        solve.Neumann(1.5)  # type: ignore[arg-type]
    with pytest.raises(errors.OutOfRangeError, match="tolerance"):
        solve.ConjugateGradient(tolerance=float("nan"))
    with pytest.raises(errors.OutOfRangeError, match="max_sweeps"):
        solve.GaussSeidel(max_sweeps=0)
    with pytest.raises(errors.OutOfRangeError, match="max_seconds"):
        solve.Southwell(max_seconds=-1)


def test_bad_tensors_are_named() -> None:
    factors, albedo, exitance = system(torch.float64)
    broken = albedo.clone()
    broken[3, 1] = torch.nan
    for solver in every_solver():
        for wrong in (albedo + 0.5, albedo - 0.5):
            with pytest.raises(errors.OutOfRangeError, match="albedo"):
                solver.solve(factors, wrong, exitance)
        with pytest.raises(errors.InvalidValueError, match="albedo: got NaN"):
            solver.solve(factors, broken, exitance)
        with pytest.raises(errors.ShapeError, match="one row for each patch"):
            solver.solve(factors, albedo[:5], exitance[:5])
        with pytest.raises(errors.ShapeError, match="broadcast"):
            solver.solve(factors, albedo, exitance[:5])
        with pytest.raises(errors.DTypeError, match="one dtype"):
            solver.solve(factors, albedo, exitance.float())
    with pytest.raises(errors.ShapeError, match="without areas"):
        solve.ConjugateGradient().solve(factors, albedo, exitance)


def test_enclosure_case_is_closed() -> None:
    assert_close(enclosure(torch.float64, SMALL)[2].sum(-1), 1.0)
    assert isinstance(SOLVERS[0].build(torch.float64).layer, shade.RadiosityShading)


def test_shooting_ends_where_light_only_wanders() -> None:
    """A "room" of negative exchanges, where light turns in circles: no turn leaves less to send."""
    factors = torch.tensor([[0.0, 1.0], [-1.0, 0.0]], dtype=torch.float64)
    white, light = torch.ones(2, 1).double(), torch.tensor([[1.0], [0.0]]).double()
    solver = solve.Southwell(at_once=1)
    found = solver.approximate(solve.as_operator(factors), white, light)
    assert not found.converged.any()
    assert found.products < 10_000 < solver.max_shots


def test_what_is_no_tensor_or_no_operator_is_named() -> None:
    matrix, albedo = torch.zeros(2, 2), torch.full((2, 1), 0.5)
    with pytest.raises(errors.DTypeError, match="albedo: got a float; pass a tensor"):
        solve.solve_radiosity(matrix, 0.5, albedo)
    with pytest.raises(errors.DTypeError, match="exitance: got None"):
        solve.solve_radiosity(matrix, albedo, None)
    with pytest.raises(errors.DTypeError, match="operator: got a list"):
        solve.solve_radiosity([[0.0]], albedo, albedo)
