"""Radiosity by way of form factors: gradients with respect to the vertices of a room."""

from __future__ import annotations

import pytest
import torch
import trimesh
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.geometry.patches import Patches
from torchradiometry.solve import (
    ConjugateGradient,
    DenseOperator,
    Direct,
    GaussSeidel,
    Implicit,
    Neumann,
    Unrolled,
    solve_radiosity,
)
from torchradiometry.transport.form_factors import exchange_areas

BOX = trimesh.creation.box((1.0, 1.2, 0.8))
INWARD = torch.tensor(BOX.triangles.copy(), dtype=torch.float64).flip(1)
VERTICES, INDEX = INWARD.reshape(-1, 3).unique(dim=0, return_inverse=True)
ALBEDO = torch.linspace(0.2, 0.9, 24, dtype=torch.float64).reshape(12, 2)
EXITANCE = torch.zeros(12, 2, dtype=torch.float64).index_fill(0, torch.tensor([3]), 5.0)
WAYS = [
    (ConjugateGradient(), Implicit()),
    (GaussSeidel(), Implicit()),
    (Neumann(400), Unrolled()),
    (Neumann(400), Unrolled(checkpoint=20)),
    (Direct(), Unrolled()),
]


def brightness(vertices: Tensor, solver: object, adjoint: object, closed: bool = True) -> Tensor:
    """Weighted sum of the radiosities of a box whose corners are `vertices`."""
    exchange, area = exchange_areas(Patches(vertices[INDEX].reshape(-1, 3, 3)), closed=closed)
    operator = DenseOperator(exchange / area.unsqueeze(1), area)
    found = solve_radiosity(operator, ALBEDO, EXITANCE, solver, adjoint).radiosity
    return (found * torch.arange(1.0, 25.0, dtype=torch.float64).reshape(12, 2)).sum()


def gradient(vertices: Tensor, solver: object, adjoint: object) -> Tensor:
    vertices = vertices.clone().requires_grad_()
    (found,) = torch.autograd.grad(brightness(vertices, solver, adjoint), vertices)
    return found


@pytest.mark.parametrize("way", WAYS, ids=str)
def test_every_adjoint_gives_the_same_gradient(way: tuple[object, object]) -> None:
    """A box stays planar where whole faces move: the gradient of its stretching."""
    stretch = torch.tensor([1.0, 1.1, 0.9], dtype=torch.float64, requires_grad=True)
    (found,) = torch.autograd.grad(brightness(VERTICES * stretch, *way), stretch)
    step = 1e-5 * torch.eye(3, dtype=torch.float64)
    expected = torch.stack(
        [
            (
                brightness(VERTICES * (stretch + s), *way)
                - brightness(VERTICES * (stretch - s), *way)
            )
            / 2e-5
            for s in step
        ]
    )
    assert_close(found, expected.detach(), rtol=1e-6, atol=0)


def test_adjoints_agree_vertex_by_vertex() -> None:
    first = gradient(VERTICES, *WAYS[0])
    assert first.abs().min() > 0
    for way in WAYS[1:]:
        assert_close(gradient(VERTICES, *way), first, rtol=1e-9, atol=1e-9 * first.abs().max())


def test_gradcheck_of_an_open_box() -> None:
    def loss(stretch: Tensor) -> Tensor:
        return brightness(VERTICES * stretch, *WAYS[0], closed=False)

    stretch = torch.tensor([1.0, 1.1, 0.9], dtype=torch.float64, requires_grad=True)
    assert gradcheck(loss, (stretch,), rtol=1e-6, atol=1e-6)
