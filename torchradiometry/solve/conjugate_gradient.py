"""Conjugate gradients on the symmetric form of the radiosity system.

    K = A F,  s = sqrt(rho / A):   (I - s K s) y = s K M,   B = M + s y

s K s is symmetric with the eigenvalues of rho F, so the system is positive definite wherever
the room has a solution, and well defined at rho = 0. Its residual, times s, is that of
B = M + s y in W/m2; the iteration stops on that one. Plain conjugate gradients on the
unsymmetric I - rho F stall.

Unlike the textbook, every channel and every member of the batch is a system of its own (each
has its own albedo), with its own step sizes; all of them share each product. A system that
has converged takes steps of 0.

References: M. Hestenes and E. Stiefel, "Methods of Conjugate Gradients for Solving Linear
Systems", Journal of Research of the National Bureau of Standards 49 (1952).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple, final

import torch
from torch import Tensor

from torchradiometry.errors import ShapeError
from torchradiometry.numerics import guarded_divide, safe_sqrt
from torchradiometry.solve.ambient import with_ambient_tail
from torchradiometry.solve.operators import AbstractOperator, per_area
from torchradiometry.solve.solver import AbstractSolver, Approximation
from torchradiometry.solve.stopping import allowed_residual, check_limits, settled

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["ConjugateGradient"]


class _State(NamedTuple):
    """Solution, residual and direction of every system, and whether it is done."""

    y: Float[Tensor, "*batch patch channel"]
    residual: Float[Tensor, "*batch patch channel"]
    direction: Float[Tensor, "*batch patch channel"]
    done: Bool[Tensor, "*batch channel"]


@final
@dataclass(frozen=True)
class ConjugateGradient(AbstractSolver):
    """The fewest products with F; needs areas (or an operator that knows them).

    Args:
        tolerance: stop when the error is known to be below this share of the largest
            radiosity, or (always) when the residual is down to rounding.
        max_iterations: products that are spent at most; status NOT_CONVERGED after them.
        ambient_tail: add the calibrated ambient term when it stopped early.

    Differentiable in: nothing by itself; see `Implicit`.
    Export: no, the number of steps depends on the data.

    >>> from torchradiometry.solve import DenseOperator
    >>> F = DenseOperator(torch.tensor([[0.0, 1.0], [1.0, 0.0]]), torch.ones(2))
    >>> half = torch.full((2, 1), 0.5)
    >>> ConjugateGradient().solve(F, half, half).radiosity.T
    tensor([[1., 1.]])
    """

    tolerance: float = 0.0
    max_iterations: int = 500
    ambient_tail: bool = False
    promises: ClassVar[bool] = True
    unrolls: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_limits(self.tolerance, "max_iterations", self.max_iterations)

    def approximate(
        self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor
    ) -> Approximation:
        if operator.area is None:
            raise ShapeError(
                "operator",
                "form factors without areas",
                "pass DenseOperator(form_factors, area), or use Neumann, GaussSeidel or Direct",
            )
        scale = safe_sqrt(per_area(albedo, operator.area))
        allowed = allowed_residual(operator, albedo, self.tolerance)
        right = scale * operator.exchange(exitance)
        state = _State(torch.zeros_like(right), right, right, torch.zeros_like(allowed) > 0)
        products = 1
        while True:
            state = _marked(state, scale, exitance, allowed)
            if products > self.max_iterations or bool(state.done.all()):
                break
            state, products = _step(state, operator, scale), products + 1
        found = Approximation(exitance + scale * state.y, products, converged=state.done)
        if not self.ambient_tail:
            return found
        return with_ambient_tail(operator, albedo, found, scale * state.residual)


def _marked(state: _State, scale: Tensor, exitance: Tensor, allowed: Tensor) -> _State:
    """The state with the systems marked that need no further step."""
    done = settled(scale * state.residual, exitance + scale * state.y, allowed)
    return state._replace(done=state.done | done)


def _step(state: _State, operator: AbstractOperator, scale: Tensor) -> _State:
    """One step of conjugate gradients in every system that is not done."""
    y, residual, direction, done = state
    image = direction - scale * operator.exchange(scale * direction)
    square = residual.square().sum(-2, keepdim=True)
    step = guarded_divide(square, (direction * image).sum(-2, keepdim=True))
    step = torch.where(done.unsqueeze(-2), 0, step)
    after = residual - step * image
    turn = guarded_divide(after.square().sum(-2, keepdim=True), square)
    return _State(y + step * direction, after, after + turn * direction, done)
