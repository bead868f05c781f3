"""Radiosity bounce by bounce: the Neumann series, unrolled.

    B_0 = M,   B_k = M + rho F B_{k-1} = sum_{m<=k} (rho F)^m M

k bounces leave the residual r_k = (rho F)^(k+1) M, so the error falls at least as q^(k+1),
q = max_i rho_i sum_j F_ij. The number of bounces is a Python number: the graph is a fixed
chain of matrix products, which compiles, exports and differentiates as it stands.

References: J. Kajiya, "The Rendering Equation", SIGGRAPH 1986.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, final

import torch
from torch import Tensor

from torchradiometry.errors import require_whole
from torchradiometry.solve.ambient import with_ambient_tail
from torchradiometry.solve.operators import (
    AbstractOperator,
    as_operator,
    reflected,
    require_system,
)
from torchradiometry.solve.solution import Solution
from torchradiometry.solve.solver import AbstractSolver, Approximation

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Neumann", "bounce_series", "neumann_series", "separate_bounces"]


def bounce_series(
    operator: AbstractOperator | Float[Tensor, "*batch patch patch"],
    albedo: Float[Tensor, "*batch patch channel"],
    exitance: Float[Tensor, "*batch patch channel"],
    bounces: int,
) -> list[Float[Tensor, "*batch patch channel"]]:
    """(rho F)^m M for m = 0 .. bounces + 1: light by the number of its reflections, W/m2."""
    operator, series = as_operator(operator), [exitance]
    require_system(operator, ("albedo", albedo), ("exitance", exitance))
    for _ in range(bounces + 1):
        series.append(reflected(operator, albedo, series[-1]))
    return series


def neumann_series(
    operator: AbstractOperator | Float[Tensor, "*batch patch patch"],
    albedo: Float[Tensor, "*batch patch channel"],
    exitance: Float[Tensor, "*batch patch channel"],
    bounces: int,
) -> tuple[Float[Tensor, "*batch patch channel"], Float[Tensor, "*batch patch channel"]]:
    """B after `bounces` reflections, and the next bounce (its residual), both in W/m2.

    B_k = M + rho F B_{k-1},   r_k = rho F (B_k - B_{k-1})

    Args:
        operator: F, or form factors F[receiver, emitter], 0..1.
        albedo: 0..1.
        exitance: M, W/m2: what the patches emit (or reflect of sources that are no patches).
        bounces: >= 0; 0 leaves the emission alone.

    Differentiable in: all tensors.
    Export: compile yes, ONNX yes.
    """
    operator = as_operator(operator)
    require_system(operator, ("albedo", albedo), ("exitance", exitance))
    radiosity = bounce = exitance
    for _ in range(bounces):
        bounce = reflected(operator, albedo, bounce)
        radiosity = radiosity + bounce
    return radiosity, reflected(operator, albedo, bounce)


def separate_bounces(
    solution: Solution,
    operator: AbstractOperator | Float[Tensor, "*batch patch patch"],
    albedo: Float[Tensor, "*batch patch channel"],
    exitance: Float[Tensor, "*batch patch channel"],
    bounces: int,
) -> Solution:
    """Any solver's solution with its light separated by the number of reflections.

    Entry m of `bounces` is (rho F)^m M for m = 0 .. `bounces`, the last entry what was
    reflected more often; they sum to the radiosity.

    Differentiable in: all tensors.
    Export: compile yes, ONNX yes.

    References: S. Seitz, Y. Matsushita and K. Kutulakos, "A Theory of Inverse Light
    Transport", ICCV 2005.
    """
    operator = as_operator(operator)
    require_system(operator, ("albedo", albedo), ("exitance", exitance))
    exitance = exitance.expand_as(solution.radiosity)
    series = torch.stack(bounce_series(operator, albedo, exitance, bounces)[:-1], -3)
    rest = solution.radiosity - series.sum(-3)
    return solution._replace(bounces=torch.cat((series, rest.unsqueeze(-3)), -3))


@final
@dataclass(frozen=True)
class Neumann(AbstractSolver):
    """A fixed number of bounces; exports as a chain of products.

    Args:
        bounces: reflections that are followed, >= 0.
        ambient_tail: add the calibrated ambient term for all further ones (costs three more
            products with F).
        per_bounce: return the radiosity of each bounce too; with `ambient_tail` the last
            entry is the tail.

    In a closed room of albedo 1 the truncated sum is returned and its bound is infinite.

    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])  # two patches that see only each other
    >>> half = torch.full((2, 1), 0.5)
    >>> Neumann(20).solve(F, half, half).radiosity.T  # M / (1 - rho)
    tensor([[1.0000, 1.0000]])
    >>> Neumann(2, per_bounce=True).solve(F, half, half).bounces[:, 0, 0]
    tensor([0.5000, 0.2500, 0.1250])
    """

    bounces: int
    ambient_tail: bool = False
    per_bounce: bool = False
    promises: ClassVar[bool] = False
    unrolls: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_whole("bounces", self.bounces, 0)

    def approximate(
        self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor
    ) -> Approximation:
        if self.per_bounce:
            *series, rest = bounce_series(operator, albedo, exitance, self.bounces)
            separate: Tensor | None = torch.stack(series, -3)
            radiosity = torch.stack(series, -3).sum(-3)
        else:
            radiosity, rest = neumann_series(operator, albedo, exitance, self.bounces)
            separate = None
        found = Approximation(radiosity, self.bounces + 1, rest, one_sign=True, bounces=separate)
        return with_ambient_tail(operator, albedo, found, rest) if self.ambient_tail else found

    def segments(self, every: int) -> tuple[AbstractSolver, ...]:
        """k bounces are `every` - 1 bounces, then as many of what those left, and so on."""
        whole, last = divmod(self.bounces + 1, every)
        sizes = [every] * whole + [last] * (last > 0)
        tails = [False] * (len(sizes) - 1) + [self.ambient_tail]
        return tuple(
            replace(self, bounces=size - 1, ambient_tail=tail)
            for size, tail in zip(sizes, tails, strict=True)
        )
