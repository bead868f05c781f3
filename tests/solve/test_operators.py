"""Operators: the products agree with the matrix, and what does not fit is named."""

import pytest
import torch
from torch.autograd import gradcheck

from tests.cases import rand
from tests.solve.rooms import errors_of, exact_solution, room, surfaces
from tests.tolerances import assert_close
from torchradiometry import errors, solve
from torchradiometry.solve.operators import AbstractOperator


def operators(dtype: torch.dtype = torch.float64) -> list[AbstractOperator]:
    dense = room("open", 7, dtype)
    return [dense, solve.MatrixFreeOperator(dense.exchange, dense.area)]


@pytest.mark.parametrize("operator", operators(), ids=lambda o: type(o).__name__)
def test_products_agree_with_the_matrix(operator: AbstractOperator) -> None:
    factors, area = operators()[0].form_factors, operators()[0].area
    x = rand(2, 7, 3, dtype=torch.float64)
    index = torch.tensor([[1, 4], [6, 0]])
    some = rand(2, 2, 3, dtype=torch.float64, seed=4)
    sent = torch.stack([factors[:, i] @ s for i, s in zip(index, some, strict=True)])
    assert_close(operator(x), factors @ x)
    assert_close(operator.exchange(x), area[:, None] * (factors @ x))
    assert_close(operator.transposed(x), factors.mT @ x)
    assert_close(operator.row_sums(), factors.sum(-1))
    assert_close(operator.from_patches(index, some), sent)
    assert_close(operator.rows(2, 5), factors[2:5])
    assert_close(operator.transpose()(x), factors.mT @ x)
    assert_close(operator.transpose().transposed(x), factors @ x)
    assert operator.patches == 7


def test_batched_form_factors() -> None:
    both = torch.stack([room("open", 5, torch.float64, seed).form_factors for seed in (0, 1)])
    x, index = rand(2, 5, 3, dtype=torch.float64), torch.tensor([[0, 3], [4, 1]])
    some = x.gather(1, index.unsqueeze(-1).expand(2, 2, 3))
    for number in (0, 1):
        alone = solve.DenseOperator(both[number])
        assert_close(solve.DenseOperator(both)(x)[number], alone(x[number]))
        found = solve.DenseOperator(both).from_patches(index, some)[number]
        assert_close(found, alone.from_patches(index[number], some[number]))


def test_patches_without_area_exchange_nothing() -> None:
    dense = room("closed", 4, torch.float64)
    area = torch.cat((dense.area, dense.area.new_zeros(1)))
    operator = solve.MatrixFreeOperator(
        lambda x: torch.nn.functional.pad(dense.exchange(x[..., :4, :]), (0, 0, 0, 1)), area
    )
    albedo, exitance = rand(5, 2, dtype=torch.float64, high=0.8), rand(5, 2, dtype=torch.float64)
    assert_close(operator.row_sums(), torch.tensor([1, 1, 1, 1, 0.0]))
    for solver in (solve.ConjugateGradient(), solve.GaussSeidel(), solve.Southwell()):
        found = solver.solve(operator, albedo, exitance).radiosity
        assert_close(found[:4], solve.Direct().solve(dense, albedo[:4], exitance[:4]).radiosity)
        assert_close(found[4], exitance[4])


def test_wide_operators_compute_in_double_precision() -> None:
    dense, free = operators(torch.float32)
    x = rand(7, 2, dtype=torch.float64)
    assert dense.wide()(x).dtype == torch.float64
    assert_close(dense.wide()(x), operators()[0](x), rtol=1e-6)
    assert free.wide() is free
    assert operators()[0].wide().dtype == torch.float64


def test_a_callable_in_single_precision_is_solved_and_certified_in_it() -> None:
    dense = room("closed", 30, torch.float32)
    free = solve.MatrixFreeOperator(dense.exchange, dense.area)
    albedo, exitance = surfaces(30, torch.float32)
    exact = exact_solution(dense, albedo, exitance)
    for solver in (solve.ConjugateGradient(), solve.GaussSeidel(), solve.Southwell()):
        found = solver.solve(free, albedo, exitance)
        assert found.radiosity.dtype == torch.float32
        assert (errors_of(found, exact) <= found.bound.double().numpy()).all()
        assert (found.bound < 1e-3).all()
        assert (found.status == solve.Status.BOUNDED).all()


def test_gradients_of_products() -> None:
    exchange = rand(4, 4, dtype=torch.float64).requires_grad_()
    area = rand(4, dtype=torch.float64, seed=1, low=5, high=9).requires_grad_()
    x = rand(4, 2, dtype=torch.float64, seed=2).requires_grad_()

    def products(h, a, x):
        free = solve.MatrixFreeOperator(lambda v: (h + h.mT) @ v, a)
        dense = solve.DenseOperator((h + h.mT) / a[:, None], a)
        return [f(x) for o in (free, dense) for f in (o, o.transposed, o.exchange)]

    assert gradcheck(products, (exchange, area, x))


def test_what_does_not_fit_is_named() -> None:
    with pytest.raises(errors.ShapeError, match="receiver emitter"):
        solve.DenseOperator(torch.rand(3, 4))
    with pytest.raises(errors.ShapeError, match="one area for each of 3"):
        solve.DenseOperator(torch.eye(3), torch.ones(4))
    bare = solve.as_operator(torch.eye(3))
    with pytest.raises(errors.ShapeError, match=r"pass DenseOperator\(form_factors, area\)"):
        bare.exchange(torch.ones(3, 1))
    assert bare.transpose().area is None
