from __future__ import annotations

import pytest
import torch
from torch import Tensor

from torchradiometry.errors import ShapeError
from torchradiometry.solve import (
    ConjugateGradient,
    DenseOperator,
    HierarchicalOperator,
    Neumann,
    solve_radiosity,
)


def fields(seed: int = 0) -> dict:
    """A tree of four patches, two clusters of two, one link between the clusters."""
    generator = torch.Generator().manual_seed(seed)

    def positive(*shape: int) -> Tensor:
        return 0.2 + torch.rand(*shape, generator=generator, dtype=torch.float64)

    area = positive(4)
    transfer = positive(7, 3, 3)
    return {
        "area": 2 * area,
        "full_area": area,
        "leaf": torch.tensor([3, 4, 5, 6]),
        "parent": torch.tensor([-1, 0, 0, 1, 1, 2, 2]),
        "levels": (0, 1, 3, 7),
        "transfer": transfer / transfer.sum(-1, keepdim=True),
        "first": torch.tensor([1]),
        "second": torch.tensor([2]),
        "kernel": 0.1 * positive(1, 3, 3),
        "near_first": torch.tensor([0, 2]),
        "near_second": torch.tensor([1, 3]),
        "near_exchange": 0.2 * positive(2),
        "scale": positive(4),
    }


def matrix(held: dict) -> Tensor:
    """H written out from the definition."""
    share = torch.full((4, 3), 1 / 3, dtype=torch.float64)
    share = (share.unsqueeze(1) @ held["transfer"][3:]).squeeze(1) * held["full_area"].unsqueeze(1)
    exchange = torch.zeros(4, 4, dtype=torch.float64)
    exchange[:2, 2:] = share[:2] @ held["kernel"][0] @ share[2:].mT
    exchange[held["near_first"], held["near_second"]] += held["near_exchange"]
    return held["scale"].unsqueeze(1) * (exchange + exchange.mT) * held["scale"]


def test_products_are_those_of_the_matrix() -> None:
    held = fields()
    operator, exchange = HierarchicalOperator(**held), matrix(held)
    factors = exchange / held["area"].unsqueeze(1)
    x = torch.randn(2, 5, 4, 3, dtype=torch.float64)
    torch.testing.assert_close(operator.exchange(x), exchange @ x)
    torch.testing.assert_close(operator(x), factors @ x)
    torch.testing.assert_close(operator.transposed(x), factors.mT @ x)
    torch.testing.assert_close(operator.row_sums(), factors.sum(1))
    torch.testing.assert_close(operator.rows(1, 3), factors[1:3])
    assert operator.patches == 4


@pytest.mark.parametrize("solver", [ConjugateGradient(), Neumann(30)])
def test_solutions_and_gradients_are_those_of_the_matrix(solver: object) -> None:
    held = fields()
    albedo = torch.tensor([[0.2, 0.5], [0.8, 0.1], [0.0, 0.9], [0.4, 0.3]]).double()
    exitance = torch.tensor([[1.0, 0.0], [0.0, 2.0], [0.0, 0.0], [3.0, 1.0]]).double()
    results = []
    for tree in (True, False):
        operator = (
            HierarchicalOperator(**held)
            if tree
            else DenseOperator(matrix(held) / held["area"].unsqueeze(1), held["area"])
        )
        inputs = [t.clone().requires_grad_() for t in (albedo, exitance)]
        found = solve_radiosity(operator, *inputs, solver=solver)
        gradients = torch.autograd.grad(found.radiosity.square().sum(), inputs)
        results.append((found.radiosity, *gradients))
    for here, there in zip(*results, strict=True):
        torch.testing.assert_close(here, there, rtol=1e-8, atol=1e-10)


def test_all_that_it_holds_has_gradients() -> None:
    held = fields()
    x = torch.randn(4, 2, dtype=torch.float64)
    names = ("full_area", "transfer", "kernel", "near_exchange", "scale")

    def product(*values: Tensor) -> Tensor:
        changed = dict(zip(names, values, strict=True))
        return HierarchicalOperator(**{**held, **changed}).exchange(x)

    assert torch.autograd.gradcheck(product, [held[n].requires_grad_() for n in names])


def test_a_wrong_number_of_patches_is_named() -> None:
    with pytest.raises(ShapeError, match="4 patches"):
        HierarchicalOperator(**fields())(torch.ones(5, 1))
