"""Gauss-Seidel: every patch gathers with the newest values of all others.

    B_i <- M_i + rho_i (sum_{j<i} F_ij B_j(new) + sum_{j>=i} F_ij B_j(old))

Patches are taken in blocks: what arrives from outside a block is one product with its rows
of F, what its patches send each other is a small triangular system, so no loop runs over
single patches and the result is that of the textbook's loop to rounding. The residual after a
sweep is that part of rho F which saw old values, times the change: at most the change.

Unlike the textbook, where the areas are known each sweep but the last ends with an energy
balance (`balance`), which takes the slow mode of bright closed rooms away.

References: R. Varga, *Matrix Iterative Analysis* (1962), ch. 3; C. Goral, K. Torrance,
D. Greenberg and B. Battaile, SIGGRAPH 1984.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, final

import torch
from torch import Tensor

from torchradiometry.solve.ambient import with_ambient_tail
from torchradiometry.solve.balance import balance_of
from torchradiometry.solve.operators import AbstractOperator, reflected
from torchradiometry.solve.solver import AbstractSolver, Approximation
from torchradiometry.solve.stopping import allowed_residual, check_limits, settled

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["GaussSeidel"]

#: patches of a block
BLOCK = 64
#: share of the radiosity below which an energy balance may be nothing but rounding
SMALL = 2.0**-30
#: such balances in a row that do not shrink before no more are made
PATIENCE = 4


@final
@dataclass(frozen=True)
class GaussSeidel(AbstractSolver):
    """Sweeps over all patches; needs rows of F, so it is at its best on a dense matrix.

    Args:
        tolerance: stop when the error is known to be below this share of the largest
            radiosity, or (always) when the change is down to rounding.
        max_sweeps: status NOT_CONVERGED after them.
        ambient_tail: add the calibrated ambient term at the end.

    Differentiable in: nothing by itself; see `Implicit`.
    Export: no, the number of sweeps depends on the data.

    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])
    >>> half = torch.full((2, 1), 0.5)
    >>> GaussSeidel().solve(F, half, half).radiosity.T
    tensor([[1., 1.]])
    """

    tolerance: float = 0.0
    max_sweeps: int = 500
    ambient_tail: bool = False
    promises: ClassVar[bool] = True
    unrolls: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_limits(self.tolerance, "max_sweeps", self.max_sweeps)

    def approximate(
        self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor
    ) -> Approximation:
        # one exitance may stand for a batch of rooms, in which each gets a radiosity of its own
        rooms = operator.rows(0, 1).shape[:-2]
        batch = torch.broadcast_shapes(rooms, albedo.shape[:-2], exitance.shape[:-2])
        exitance = exitance.expand(*batch, *exitance.shape[-2:])
        allowed = allowed_residual(operator, albedo, self.tolerance)
        balance = None if operator.area is None else balance_of(operator, albedo)
        radiosity, done, sweeps = exitance, torch.zeros_like(allowed) > 0, 0
        smallest = torch.full_like(allowed, torch.inf).unsqueeze(-2)
        stale = torch.zeros_like(smallest)
        while sweeps < self.max_sweeps and not bool(done.all()):
            swept = _sweep(operator, albedo, exitance, radiosity)
            settles = settled(swept - radiosity, swept, allowed)
            if balance is not None:
                ambient = balance.ambient_of(exitance, swept)
                smallest, stale = _progress(ambient, smallest, stale, swept)
                useful = (stale < PATIENCE) & ~settles.unsqueeze(-2)
                lacking = albedo * torch.where(useful, ambient, 0)
                swept = swept + lacking
            radiosity = torch.where(done.unsqueeze(-2), radiosity, swept)
            done, sweeps = done | settles, sweeps + 1
        found = Approximation(radiosity, sweeps + 2 * (balance is not None), converged=done)
        if not self.ambient_tail:
            return found
        rest = exitance + reflected(operator, albedo, radiosity) - radiosity
        return with_ambient_tail(operator, albedo, found, rest)


def _progress(
    ambient: Tensor, smallest: Tensor, stale: Tensor, radiosity: Tensor
) -> tuple[Tensor, Tensor]:
    """The smallest balance so far, and for how many small ones in a row it has not halved."""
    size = ambient.abs()
    shrinks = (size < smallest / 2) | (size > SMALL * radiosity.abs().amax(-2, keepdim=True))
    stale = torch.where(stale < PATIENCE, torch.where(shrinks, 0, stale + 1), stale)
    return torch.minimum(smallest, size), stale


def _sweep(
    operator: AbstractOperator, albedo: Tensor, exitance: Tensor, radiosity: Tensor
) -> Float[Tensor, "*batch patch channel"]:
    """Every patch once, in order."""
    patches, radiosity = operator.patches, radiosity.clone()
    for first in range(0, patches, BLOCK):
        last = min(first + BLOCK, patches)
        rows = operator.rows(first, last)
        within = rows[..., first:last].tril(-1)
        own, share = radiosity[..., first:last, :], albedo[..., first:last, :]
        outside = rows @ radiosity - within @ own
        right = exitance[..., first:last, :] + share * outside
        radiosity[..., first:last, :] = _gathered(within, share, right)
    return radiosity


def _gathered(within: Tensor, albedo: Tensor, right: Tensor) -> Tensor:
    """x of x - rho L x = right for one block, L its strictly lower triangle."""
    eye = torch.eye(within.shape[-1], dtype=within.dtype, device=within.device)
    system = eye - albedo.mT.unsqueeze(-1) * within.unsqueeze(-3)
    solved = torch.linalg.solve_triangular(
        system, right.mT.unsqueeze(-1), upper=False, unitriangular=True
    )
    return solved.squeeze(-1).mT
