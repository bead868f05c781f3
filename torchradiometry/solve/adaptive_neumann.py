"""Bounces until the error is small enough: the Neumann series that knows when to stop.

    B <- B + r,   r <- rho F r      while  |r| > tolerance (1 - q) |B|  in any system

r = M + rho F B - B, so |B - B*| <= |r| / (1 - q). In a traced graph the loop is torch's
`while_loop`, which exports as an ONNX `Loop`: one file serves every number of patches and
every albedo with as many bounces as each needs. Eager code runs the same loop in Python.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor
from torch._higher_order_ops.while_loop import while_loop

from torchradiometry.solve.ambient import with_ambient_tail
from torchradiometry.solve.operators import AbstractOperator, reflected
from torchradiometry.solve.solver import AbstractSolver, Approximation
from torchradiometry.solve.stopping import allowed_residual, check_limits, settled

__all__ = ["AdaptiveNeumann"]


@final
@dataclass(frozen=True)
class AdaptiveNeumann(AbstractSolver):
    """As many bounces as a tolerance needs; exports as an ONNX `Loop`.

    Args:
        tolerance: stop when the error is known to be below this share of the largest
            radiosity, in every system.
        max_bounces: status NOT_CONVERGED after them.
        ambient_tail: add the calibrated ambient term at the end.

    In a traced graph `Solution.iterations` is a tensor, because it depends on the data.

    Differentiable in: nothing by itself; see `Implicit`.
    Export: compile yes, ONNX yes, as a `Loop`.

    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])
    >>> half = torch.full((2, 1), 0.5)
    >>> AdaptiveNeumann(0.01).solve(F, half, half).iterations
    7
    """

    tolerance: float = 2.0**-10
    max_bounces: int = 1000
    ambient_tail: bool = False
    promises: ClassVar[bool] = False
    unrolls: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_limits(self.tolerance, "max_bounces", self.max_bounces)

    def approximate(
        self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor
    ) -> Approximation:
        allowed = allowed_residual(operator, albedo, self.tolerance)
        rest = reflected(operator, albedo, exitance)

        def unfinished(count: Tensor, radiosity: Tensor, rest: Tensor) -> Tensor:
            excess = rest.abs().amax(-2) - allowed * radiosity.abs().amax(-2)
            return (excess.max() > 0) & (count < self.max_bounces)

        def bounce(count: Tensor, radiosity: Tensor, rest: Tensor) -> tuple[Tensor, ...]:
            return count + 1, radiosity + rest, reflected(operator, albedo, rest)

        none = torch.zeros((), dtype=torch.int64, device=exitance.device)
        state: tuple[Tensor, ...] = (none, exitance, rest)
        if torch.compiler.is_compiling():
            state = while_loop(unfinished, bounce, state)
            products: int | Tensor = state[0] + 1
        else:
            while exitance.numel() and bool(unfinished(*state)):
                state = bounce(*state)
            products = int(state[0]) + 1
        radiosity, rest = state[1:]
        converged = settled(rest, radiosity, allowed)
        found = Approximation(radiosity, products, rest, one_sign=True, converged=converged)
        return with_ambient_tail(operator, albedo, found, rest) if self.ambient_tail else found
