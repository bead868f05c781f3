"""The dense system solved at once: the reference for the iterative solvers.

    (I - rho F) B = M,  one LU factorisation per channel

I - rho F is an M-matrix, its inverse has no negative entry. Its largest-norm is therefore
that of z = (I - rho F)^-1 1, which one more right-hand side gives: the bound
|B - B*| <= |z| |r| needs no estimate of q and is infinite only where the system is singular.
Costs n^3/3 multiplications a channel and n^2 numbers; not exportable (ONNX has no linear
solve).

References: R. Varga, *Matrix Iterative Analysis* (1962), ch. 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from torchradiometry.errors import SingularSystemError
from torchradiometry.solve.operators import AbstractOperator
from torchradiometry.solve.solver import AbstractSolver, Approximation

__all__ = ["Direct"]


@final
@dataclass(frozen=True)
class Direct(AbstractSolver):
    """One dense solve.

    Export: no.

    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])
    >>> half = torch.full((2, 1), 0.5)
    >>> Direct().solve(F, half, half).radiosity.T
    tensor([[1., 1.]])
    """

    promises: ClassVar[bool] = True
    unrolls: ClassVar[bool] = True

    def approximate(
        self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor
    ) -> Approximation:
        patches = operator.patches
        factors = operator.rows(0, patches)
        system = torch.eye(patches).to(factors) - albedo.mT.unsqueeze(-1) * factors.unsqueeze(-3)
        right = exitance.mT.unsqueeze(-1)
        solved, info = torch.linalg.solve_ex(system, torch.cat((right, torch.ones_like(right)), -1))
        above = solved[..., 1].mT.detach()
        limit = 1 / (max(patches, 1) * torch.finfo(above.dtype).eps)
        if bool((info != 0).any()) or not bool(((above > 0) & (above < limit)).all()):
            raise SingularSystemError(
                "Direct",
                "patches that enclose a space and reflect all they receive",
                "lower some albedo below 1 or open the scene",
            )
        return Approximation(solved[..., 0].mT, 0, above=above)
