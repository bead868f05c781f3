"""How gradients pass a solve: through its steps, or through one more solve.

    B = (I - T)^-1 M,  T = rho F:      dL = lambda . (dM + dT B),   (I - T^T) lambda = dL/dB

`Unrolled` differentiates the steps that the solver took; `Implicit` takes the solution as
given and solves the transposed system for lambda, so that its memory does not grow with the
number of steps and its gradient is that of the solution itself, not of the iteration;
`Truncated` takes few bounces of that system. An adjoint receives the solver; neither knows
the other.

By reciprocity F^T = H A^-1, and the transposed system is an ordinary one for nu = rho lambda / A:

    nu = rho g / A + rho F nu,     lambda = g + H nu,     g = dL/dB

so any solver serves. *Second derivatives.* With P = (I - T)^-1 held constant, two Newton steps
from the detached solution, x <- x + P (M + T x - x), have the value and the first and second
derivatives of the solution. The steps cost nothing forward (their residual is 0 up to the
solver's tolerance), and the gradient that enters the first of them is 0, so it is dropped
until a graph of the gradient is asked for.

References: B. Christianson, "Reverse Accumulation and Attractive Fixed Points", Optimization
Methods and Software 3 (1994); S. Bai, J. Kolter and V. Koltun, "Deep Equilibrium Models",
NeurIPS 2019.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import torch
from torch import Tensor
from torch.autograd import Function
from torch.utils.checkpoint import checkpoint

from torchradiometry.errors import DTypeError, require_whole
from torchradiometry.solve.operators import AbstractOperator, as_operator, per_area, reflected
from torchradiometry.solve.solution import Solution
from torchradiometry.solve.solver import AbstractSolver, Approximation, broadcast

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AbstractAdjoint", "Implicit", "Truncated", "Unrolled"]


@dataclass
class Solves:
    """P and its transpose, and whether a graph of the gradient was ever asked for."""

    onward: Callable[[Tensor], Tensor]
    backward: Callable[[Tensor], Tensor]
    graph_of_gradient: bool = False


class AbstractAdjoint(ABC):
    """How gradients pass a solve."""

    @abstractmethod
    def solve(
        self,
        solver: AbstractSolver,
        operator: AbstractOperator | Float[Tensor, "*batch patch patch"],
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
    ) -> Solution:
        """The solution of that solver, with gradients for albedo, exitance and operator."""


@final
@dataclass(frozen=True)
class Unrolled(AbstractAdjoint):
    """Through every step of the solver.

    Args:
        checkpoint: keep every so many bounces of a `Neumann` series only and compute those
            between them again in the backward pass; None keeps all.

    Raises:
        DTypeError: a solver whose steps may not be differentiated (`AbstractSolver.unrolls`).

    Export: as the solver (without `checkpoint`).
    """

    checkpoint: int | None = None

    def __post_init__(self) -> None:
        if self.checkpoint is not None:
            require_whole("checkpoint", self.checkpoint, 1)

    def solve(
        self,
        solver: AbstractSolver,
        operator: AbstractOperator | Tensor,
        albedo: Tensor,
        exitance: Tensor,
    ) -> Solution:
        if not solver.unrolls and torch.is_grad_enabled() and not torch.compiler.is_compiling():
            raise DTypeError(
                "solver",
                f"{type(solver).__name__}, which stops when the value is good enough, to unroll",
                "take Implicit() as adjoint, or Neumann as solver, or call it under no_grad",
            )
        if self.checkpoint is not None:
            solver = _InSegments(solver, self.checkpoint)
        return solver.solve(operator, albedo, exitance)


class AbstractTransposed(AbstractAdjoint):
    """By the transposed system, whatever way it is solved."""

    @abstractmethod
    def solves(
        self,
        solver: AbstractSolver,
        operator: AbstractOperator,
        albedo: Float[Tensor, "*batch patch channel"],
    ) -> Solves:
        """P and its transpose; the albedo is detached."""

    def solve(
        self,
        solver: AbstractSolver,
        operator: AbstractOperator | Tensor,
        albedo: Tensor,
        exitance: Tensor,
    ) -> Solution:
        """The solution, computed without a graph, with the gradients of the exact one."""
        operator = as_operator(operator)
        with torch.no_grad():
            found = solver.solve(operator, albedo, exitance)
        if torch.compiler.is_compiling() or not torch.is_grad_enabled():
            return found
        albedo, exitance = broadcast(operator, albedo, exitance)
        solves = self.solves(solver, operator, albedo.detach())
        radiosity = found.radiosity
        for _ in range(2):
            radiosity = _FirstOrderStop.apply(radiosity, solves)
            following = exitance + reflected(operator, albedo, radiosity)
            radiosity = _NewtonStep.apply(following, radiosity, solves)
        return found._replace(radiosity=radiosity)


@final
@dataclass(frozen=True)
class Implicit(AbstractTransposed):
    """Through one solve of the transposed system; twice differentiable.

    Args:
        solver: for the transposed system; None takes that of the solution.

    The gradient is that of the exact solution: with a truncated solver it is not the
    derivative of what was returned, but closer to that of what was meant.

    Export: as the solver; a traced graph carries no gradients.
    """

    solver: AbstractSolver | None = None

    def solves(self, solver: AbstractSolver, operator: AbstractOperator, albedo: Tensor) -> Solves:
        solver = self.solver or solver
        return Solves(
            lambda residual: solver.radiosity(operator, albedo, residual),
            lambda gradient: _transposed_solution(solver, operator, albedo, gradient),
        )


@final
@dataclass(frozen=True)
class Truncated(AbstractTransposed):
    """Through a few bounces of the transposed system; its cost and error are fixed.

    Args:
        bounces: k of lambda = sum_{m<=k} (F^T rho)^m dL/dB; the relative error falls at least
            as q^(k+1).

    Export: as the solver; a traced graph carries no gradients.
    """

    bounces: int

    def __post_init__(self) -> None:
        require_whole("bounces", self.bounces, 0)

    def solves(self, solver: AbstractSolver, operator: AbstractOperator, albedo: Tensor) -> Solves:
        return Solves(
            lambda residual: self._series(residual, lambda x: reflected(operator, albedo, x)),
            lambda gradient: self._series(gradient, lambda x: operator.transposed(albedo * x)),
        )

    def _series(self, first: Tensor, product: Callable[[Tensor], Tensor]) -> Tensor:
        total = term = first
        for _ in range(self.bounces):
            term = product(term)
            total = total + term
        return total


@final
@dataclass(frozen=True)
class _InSegments(AbstractSolver):
    """A solver whose segments are computed again in the backward pass."""

    solver: AbstractSolver
    every: int

    @property
    def promises(self) -> bool:  # type: ignore[override]
        return self.solver.promises

    @property
    def unrolls(self) -> bool:  # type: ignore[override]
        return self.solver.unrolls

    def approximate(
        self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor
    ) -> Approximation:
        first, *others = self.solver.segments(self.every)
        found = _recomputed(first, operator, albedo, exitance)
        for segment in others:
            more = _recomputed(segment, operator, albedo, found.residual)
            found = more._replace(
                radiosity=found.radiosity + more.radiosity,
                products=found.products + more.products,
                bounces=_joined(found.bounces, more.bounces),
            )
        return found


def _recomputed(segment: AbstractSolver, *arguments: Any) -> Approximation:
    return checkpoint(
        segment.approximate, *arguments, use_reentrant=False, preserve_rng_state=False
    )


def _joined(first: Tensor | None, more: Tensor | None) -> Tensor | None:
    return None if first is None or more is None else torch.cat((first, more), -3)


def _transposed_solution(
    solver: AbstractSolver, operator: AbstractOperator, albedo: Tensor, gradient: Tensor
) -> Float[Tensor, "*batch patch channel"]:
    """lambda of (I - F^T rho) lambda = gradient."""
    if operator.area is None:
        flipped = operator.transpose()
        return gradient + flipped(solver.radiosity(flipped, albedo, albedo * gradient))
    source = albedo * per_area(gradient, operator.area)
    return gradient + operator.exchange(solver.radiosity(operator, albedo, source))


class _NewtonStep(Function):
    """x + P (M + T x - x), whose last term is 0 at the solution x."""

    @staticmethod
    def forward(following: Tensor, radiosity: Tensor, solves: Solves) -> Tensor:
        return radiosity.clone()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.set_materialize_grads(False)
        ctx.solves = inputs[2]

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Any, ...]:
        (gradient,) = gradients
        if gradient is None:
            return None, None, None
        passed = _Solve.apply(gradient, ctx.solves, True)
        return passed, gradient - passed if ctx.needs_input_grad[1] else None, None


class _Solve(Function):
    """P g, or P^T g if transposed; linear in g, so that its own gradient is the other."""

    @staticmethod
    def forward(gradient: Tensor, solves: Solves, transposed: bool) -> Tensor:
        with torch.no_grad():
            return (solves.backward if transposed else solves.onward)(gradient)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        _, ctx.solves, ctx.transposed = inputs

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Any, ...]:
        return _Solve.apply(gradients[0], ctx.solves, not ctx.transposed), None, None


class _FirstOrderStop(Function):
    """x, whose gradient is known to be 0: dropped until a graph of the gradient is asked for."""

    @staticmethod
    def forward(x: Tensor, solves: Solves) -> Tensor:
        return x.clone()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        ctx.set_materialize_grads(False)
        ctx.solves = inputs[1]

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> Any:
        ctx.solves.graph_of_gradient |= torch.is_grad_enabled()
        return gradients[0] if ctx.solves.graph_of_gradient else None, None
