"""Adjoints: implicit = unrolled = finite differences, twice; memory that stays flat."""

import pytest
import torch
from torch.autograd import gradcheck, gradgradcheck
from torch.autograd.graph import saved_tensors_hooks

from tests.cases import ADJOINTS, ClosedRoom, rand
from tests.tolerances import assert_close
from torchradiometry import errors, solve

ADJOINT = pytest.mark.parametrize("case", ADJOINTS, ids=lambda c: c.name)


def inputs(patches: int = 5, channels: int = 2) -> tuple[torch.Tensor, ...]:
    """Albedo, exitance and exchange weights that ask for gradients."""
    made = (
        rand(2, patches, channels, dtype=torch.float64, seed=1, high=0.8),
        rand(2, patches, channels, dtype=torch.float64, seed=2),
        rand(patches, patches, dtype=torch.float64, seed=3),
    )
    return tuple(t.requires_grad_() for t in made)


@ADJOINT
def test_finite_differences(case) -> None:
    module = case.build(torch.float64)
    assert gradcheck(module, inputs(4, 1), rtol=1e-6, atol=1e-8)


@ADJOINT
def test_second_derivatives(case) -> None:
    assert gradgradcheck(case.build(torch.float64), inputs(4), fast_mode=True)


def gradients(solver, adjoint, tensors) -> tuple[torch.Tensor, ...]:
    found = ClosedRoom(solver, adjoint)(*tensors)
    return torch.autograd.grad(
        (found * torch.linspace(0, 1, found.shape[-2])[:, None]).sum(), tensors
    )


def test_implicit_is_unrolled() -> None:
    tensors = inputs(30, 3)
    expected = gradients(solve.Direct(), solve.Unrolled(), tensors)
    pairs = [
        (solve.Neumann(300), solve.Unrolled()),
        (solve.Neumann(300), solve.Unrolled(checkpoint=7)),
        (solve.Neumann(300), solve.Implicit()),
        (solve.ConjugateGradient(), solve.Implicit()),
        (solve.ConjugateGradient(), solve.Truncated(300)),
        (solve.Southwell(), solve.Implicit(solve.GaussSeidel())),
    ]
    for solver, adjoint in pairs:
        for a, b in zip(gradients(solver, adjoint, tensors), expected, strict=True):
            assert_close(a, b, rtol=1e-9, atol=1e-10 * float(b.abs().max()))


def test_implicit_without_areas_and_reciprocity() -> None:
    factors = ClosedRoom.operator(rand(4, 4, dtype=torch.float64)).form_factors * 0.9
    skewed = (factors * rand(4, 4, dtype=torch.float64, seed=8)).requires_grad_()
    albedo, exitance, _ = inputs(4, 1)

    def implicit(solver):
        return lambda *t: (
            solve.solve_radiosity(t[2], t[0], t[1], solver, solve.Implicit()).radiosity
        )

    for solver in (solve.GaussSeidel(), solve.Southwell(), solve.Direct()):
        assert gradcheck(implicit(solver), (albedo, exitance, skewed), rtol=1e-6, atol=1e-8)
        assert gradgradcheck(implicit(solver), (albedo, exitance, skewed), fast_mode=True)


@pytest.mark.parametrize("albedo", [0.0, 0.5])
@pytest.mark.parametrize("emitted", [0.0, 1.0])
def test_gradients_in_dark_and_black_rooms(albedo: float, emitted: float) -> None:
    """Where a solver has nothing to do, a small change still has something to add."""
    rho = torch.full((6, 1), albedo, dtype=torch.float64, requires_grad=True)
    exitance = torch.full((6, 1), emitted, dtype=torch.float64, requires_grad=True)
    tensors = (rho, exitance, rand(6, 6, dtype=torch.float64))
    expected = torch.autograd.grad(ClosedRoom(solve.Direct())(*tensors).sum(), (rho, exitance))
    for solver in (solve.ConjugateGradient(), solve.GaussSeidel(), solve.Southwell(),
                   solve.AdaptiveNeumann(1e-12)):  # fmt: skip
        found = torch.autograd.grad(ClosedRoom(solver)(*tensors).sum(), (rho, exitance))
        for a, b in zip(found, expected, strict=True):
            assert_close(a, b, rtol=1e-10, atol=1e-12)


def saved_numbers(solver, adjoint) -> int:
    """How many numbers the graph of one solve keeps."""
    kept: dict[int, int] = {}

    def pack(tensor):
        kept[tensor.untyped_storage().data_ptr()] = tensor.untyped_storage().nbytes() // 8
        return tensor

    with saved_tensors_hooks(pack, lambda tensor: tensor):
        found = ClosedRoom(solver, adjoint)(*inputs(12))
    assert found.requires_grad
    return sum(kept.values())


def test_memory_of_the_implicit_adjoint_does_not_grow_with_the_bounces() -> None:
    few, many = (saved_numbers(solve.Neumann(n), solve.Implicit()) for n in (5, 500))
    assert few == many
    unrolled = [saved_numbers(solve.Neumann(n), solve.Unrolled()) for n in (5, 500)]
    assert unrolled[1] > 20 * unrolled[0]
    assert saved_numbers(solve.Neumann(500), solve.Unrolled(checkpoint=25)) < unrolled[1] / 8


def test_single_precision_gradients() -> None:
    tensors = inputs(20, 3)
    single = tuple(t.detach().float().requires_grad_() for t in tensors)
    exact = gradients(solve.Direct(), solve.Unrolled(), tensors)
    found = gradients(solve.ConjugateGradient(), solve.Implicit(), single)
    for a, b in zip(found, exact, strict=True):
        assert a.dtype == torch.float32
        assert_close(a.double(), b, rtol=1e-5, atol=1e-6 * float(b.abs().max()))


def test_no_graph_where_none_is_asked_for() -> None:
    with torch.no_grad():
        assert not ClosedRoom(solve.ConjugateGradient(), solve.Implicit())(*inputs()).requires_grad


def test_adaptive_solvers_are_not_unrolled() -> None:
    module = ClosedRoom(solve.ConjugateGradient(), solve.Unrolled())
    with pytest.raises(errors.DTypeError, match=r"take Implicit\(\)"):
        module(*inputs())
    with torch.no_grad():
        assert torch.isfinite(module(*inputs())).all()
    with pytest.raises(errors.OutOfRangeError, match="checkpoint"):
        solve.Unrolled(checkpoint=0)
    with pytest.raises(errors.DTypeError, match="bounces"):
        solve.Truncated(1.5)  # type: ignore[arg-type]


def test_solve_radiosity_needs_areas_for_conjugate_gradients() -> None:
    albedo = torch.full((2, 1), 0.5)
    factors = torch.tensor([[0.0, 1.0], [1.0, 0.0]])
    with pytest.raises(errors.ShapeError, match="without areas"):
        solve.solve_radiosity(factors, albedo, albedo)
    assert_close(solve.solve_radiosity(factors, albedo, albedo, solve.Direct()).radiosity, 1.0)
