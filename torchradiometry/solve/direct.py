"""The dense system solved at once: the reference for the iterative solvers.

    (I - rho F) B = M,  one LU factorisation per channel

I - rho F is an M-matrix, its inverse has no negative entry. Its largest-norm is therefore
that of (I - rho F)^-1 1, which one more right-hand side gives: the bound
|B - B*| <= |(I - rho F)^-1 1| |r| needs no estimate of q and is infinite only where the
system is singular. Costs n^3/3 multiplications; not exportable (ONNX has no linear solve).

References: R. Varga, *Matrix Iterative Analysis* (1962), ch. 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import SingularSystemError
from torchradiometry.solve.solution import Solution, certified

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Direct"]


@final
@dataclass(frozen=True)
class Direct:
    """One dense solve.

    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])
    >>> half = torch.full((2, 1), 0.5)
    >>> Direct().solve(F, half, half).radiosity.T
    tensor([[1., 1.]])
    """

    def solve(
        self,
        form_factors: Float[Tensor, "*batch patch patch"],
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
    ) -> Solution:
        """B of B = M + rho F B to rounding.

        Raises:
            SingularSystemError: a closed group of patches with albedo 1 (no solution), to
                rounding.

        Differentiable in: all tensors.
        Export: no.
        """
        albedo = albedo + torch.zeros_like(exitance)
        patches = form_factors.shape[-1]
        system = torch.eye(patches).to(form_factors) - albedo.mT.unsqueeze(-1) * (
            form_factors.unsqueeze(-3)
        )
        right = exitance.mT.unsqueeze(-1)
        solved, info = torch.linalg.solve_ex(system, torch.cat((right, torch.ones_like(right)), -1))
        radiosity, ones = solved[..., 0].mT, solved[..., 1].detach()
        limit = 1 / (max(patches, 1) * torch.finfo(ones.dtype).eps)
        norm = ones.abs().amax(-1)
        if bool((info != 0).any()) or not bool((norm < limit).all()) or bool((ones < 0).any()):
            raise SingularSystemError(
                "Direct",
                "patches that enclose a space and reflect all they receive",
                "lower some albedo below 1 or open the scene",
            )
        found = certified(form_factors, albedo, exitance, radiosity)
        return found._replace(bound=found.residual * norm, status=torch.zeros_like(found.status))
