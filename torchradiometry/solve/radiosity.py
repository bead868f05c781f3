"""B = M + rho F B in one call: an operator, a solver, and how gradients pass it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torch import Tensor

from torchradiometry.errors import require_kind
from torchradiometry.solve.adjoints import AbstractAdjoint, Implicit
from torchradiometry.solve.conjugate_gradient import ConjugateGradient
from torchradiometry.solve.operators import AbstractOperator
from torchradiometry.solve.solution import Solution
from torchradiometry.solve.solver import AbstractSolver

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["solve_radiosity"]

#: what fits most rooms
DEFAULT_SOLVER, DEFAULT_ADJOINT = ConjugateGradient(), Implicit()


def solve_radiosity(
    operator: AbstractOperator | Float[Tensor, "*batch patch patch"],
    albedo: Float[Tensor, "*batch patch channel"],
    exitance: Float[Tensor, "*batch patch channel"],
    solver: AbstractSolver = DEFAULT_SOLVER,
    adjoint: AbstractAdjoint = DEFAULT_ADJOINT,
) -> Solution:
    """The radiosity of every patch, with gradients.

    B = M + rho F B

    Args:
        operator: F with areas, for instance `DenseOperator(form_factors, area)`; a bare matrix
            of form factors for solvers that need no symmetry.
        albedo: 0..1.
        exitance: M, W/m2: emitted, or reflected from sources that are no patches.
        solver: how B is found.
        adjoint: how gradients are.

    Returns:
        B in W/m2 with its residual, bound and status.

    Raises:
        OutOfRangeError, InvalidValueError: albedo outside 0..1, or NaN.
        SingularSystemError: light that is never absorbed.
        ShapeError: shapes that do not fit, or areas that are missing.
        DTypeError: what is no tensor, or no operator.

    Differentiable in: albedo, exitance, and all that the operator holds.
    Export: with `Neumann` or `AdaptiveNeumann` and `Unrolled`.

    >>> import torch
    >>> from torchradiometry.solve import DenseOperator
    >>> F = DenseOperator(torch.tensor([[0.0, 1.0], [1.0, 0.0]]), torch.ones(2))
    >>> albedo = torch.full((2, 1), 0.5, requires_grad=True)
    >>> found = solve_radiosity(F, albedo, torch.ones(2, 1))
    >>> found.radiosity.sum().backward(); albedo.grad.T  # M / (1 - rho)^2
    tensor([[4., 4.]])
    """
    for name, values in (("albedo", albedo), ("exitance", exitance)):
        require_kind(name, values, Tensor, "tensor `... patch channel`")
    return adjoint.solve(solver, operator, albedo, exitance)
