"""Solvers: closed forms, a bound that holds, statuses with advice, gradients, graphs."""

from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.cases import OTHER, SMALL, SOLVERS, enclosure, rand
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


@DTYPES
@pytest.mark.parametrize("case", SOLVERS, ids=lambda c: c.name)
def test_furnace(case, dtype: torch.dtype) -> None:
    """Exitance 1 - rho in a closed room: every patch has B = 1."""
    factors, albedo, _ = system(dtype, albedo=0.3)
    solver = case.build(dtype).solver
    found = solver.solve(factors, albedo, 1 - albedo)
    assert_close(found.radiosity, 1.0, atol=float(found.bound.max()) + 1e-6, rtol=0)
    if isinstance(solver, solve.Direct):
        assert_close(found.radiosity, 1.0)


@DTYPES
def test_uniform_enclosure_is_a_geometric_series(dtype: torch.dtype) -> None:
    factors, _, _ = system(dtype)
    albedo = torch.full((12, 1), 0.5, dtype=dtype)
    found = solve.Neumann(9).solve(factors, albedo, albedo)
    assert_close(found.radiosity, 1 - 0.5**10)
    assert_close(found.bound, 0.5**10, rtol=1e-4)
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
    assert (error <= found.bound * (1 + 1e-9) + 1e-14).all()
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
        assert tail.iterations == bounces + 3


def test_albedo_zero_and_no_light() -> None:
    factors, albedo, exitance = system(torch.float64)
    for solver in (solve.Neumann(4), solve.Neumann(4, ambient_tail=True), solve.Direct()):
        black = solver.solve(factors, albedo * 0, exitance)
        assert_close(black.radiosity, exitance)
        assert (black.bound == 0).all()
        assert (solver.solve(factors, albedo, exitance * 0).radiosity == 0).all()


def test_albedo_one_in_a_closed_room() -> None:
    factors, albedo, exitance = system(torch.float64)
    with pytest.raises(errors.SingularSystemError, match="lower some albedo"):
        solve.Direct().solve(factors, torch.ones_like(albedo), exitance)
    found = solve.Neumann(3).solve(factors, torch.ones_like(albedo) * 1.5, exitance)
    assert torch.isinf(found.bound).all()
    assert (found.status == solve.Status.UNBOUNDED).all()
    assert "below 1" in solve.advice(found.status)


def test_status_and_advice() -> None:
    factors, albedo, exitance = system(torch.float64)
    assert "add bounces" in solve.advice(solve.Neumann(1).solve(factors, albedo, exitance).status)
    broken = solve.Neumann(1).solve(factors, albedo, exitance * torch.nan)
    assert (broken.status == solve.Status.NOT_FINITE).all()
    assert "check" in solve.advice(broken.status)


def test_linearity_and_superposition() -> None:
    factors, albedo, exitance = system(torch.float64)
    other = rand(12, 3, dtype=torch.float64, seed=9)
    for solver in (solve.Neumann(5), solve.Neumann(2, ambient_tail=True), solve.Direct()):
        one, two, both = (
            solver.solve(factors, albedo, m).radiosity
            for m in (exitance, other, 2 * exitance + other)
        )
        assert_close(both, 2 * one + two)


@pytest.mark.parametrize("case", SOLVERS, ids=lambda c: c.name)
def test_gradients(case) -> None:
    factors, albedo, exitance = system(torch.float64, patches=4)
    inputs = [t[..., :2].clone() if t is not factors else t.clone() for t in (albedo, exitance)]
    inputs = [t.requires_grad_() for t in (*inputs, factors.clone())]
    assert gradcheck(case.build(torch.float64), inputs)


@pytest.mark.parametrize("case", [c for c in SOLVERS if c.name != "direct"], ids=lambda c: c.name)
def test_compiles_and_exports_with_a_dynamic_patch_axis(case, tmp_path: Path) -> None:
    module = case.build(torch.float32).eval()
    inputs, others = (case.inputs(torch.float32, sizes) for sizes in (SMALL, OTHER))
    compiled = torch.compile(module, fullgraph=True, dynamic=True, backend="aot_eager")
    for tensors in (inputs, others):
        assert_close(compiled(*tensors), module(*tensors))
    axes = {
        "albedo": ("batch", "patch", "channel"),
        "exitance": ("batch", "patch", "channel"),
        "form_factors": ("patch", "patch"),
    }
    path = export.export_onnx(
        module, inputs, tmp_path / "radiosity.onnx", axes=axes, outputs={"radiosity": "W/m2"},
        units={"form_factors": "1", "exitance": "W/m2"},
    )  # fmt: skip
    # form factors as a scene has them: rows sum to less than 1
    generator = torch.Generator().manual_seed(5)
    other = {
        "albedo": torch.rand(3, 7, 2, generator=generator) * 0.9,
        "exitance": torch.rand(3, 7, 2, generator=generator),
        "form_factors": torch.rand(7, 7, generator=generator) / 7,
    }
    check = export.check_onnx(path, module, inputs=other)
    assert check.passed, check


def test_bad_arguments_are_named() -> None:
    with pytest.raises(errors.OutOfRangeError, match="0 or more"):
        solve.Neumann(-1)
    with pytest.raises(errors.DTypeError, match="whole number"):
        solve.Neumann(1.5)  # type: ignore[arg-type]


def test_enclosure_case_is_closed() -> None:
    assert_close(enclosure(torch.float64, SMALL)[2].sum(-1), 1.0)
    assert isinstance(SOLVERS[0].build(torch.float64), shade.RadiosityShading)
