"""Random reciprocal rooms and their solutions in higher precision."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchradiometry import solve

#: closed: all patches see each other; plates: two groups that see only each other, the room
#: whose light swings most; sparse: few strong exchanges; spiky: very unequal ones; open:
#: up to two thirds of the light leaves
KINDS = ("closed", "plates", "sparse", "spiky", "open")


def room(kind: str, patches: int, dtype: torch.dtype, seed: int = 0) -> solve.DenseOperator:
    """Form factors and areas of a room."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, dtype=torch.float64, generator=generator)

    weights = uniform(patches, patches)
    if kind == "plates":
        half = patches // 2
        weights[:half, :half] = weights[half:, half:] = 0
    elif kind == "sparse":
        weights = weights * (uniform(patches, patches) < 4 / patches) + weights / 1000
    elif kind == "spiky":
        weights = weights**12
    exchange = weights + weights.mT
    area = exchange.sum(-1)
    if kind == "open":
        area = area * (1 + 2 * uniform(patches))
    return solve.DenseOperator((exchange / area.unsqueeze(-1)).to(dtype), area.to(dtype))


def surfaces(
    patches: int, dtype: torch.dtype, seed: int = 0, most: float = 0.9
) -> tuple[Tensor, Tensor]:
    """Albedo of three channels (uniform, random, in two steps), exitance of few bright lamps."""
    generator = torch.Generator().manual_seed(seed + 1)
    albedo = torch.rand(patches, 3, dtype=torch.float64, generator=generator) * most
    albedo[:, 0] = most
    albedo[:, 1] = torch.where(albedo[:, 1] > most / 2, most, most / 9)
    exitance = torch.rand(patches, 3, dtype=torch.float64, generator=generator) ** 8
    if seed % 2:
        exitance[1:] = 0
    # below `most` in float32 too
    return (albedo * (1 - 2.0**-20)).to(dtype), exitance.to(dtype)


def exact_solution(operator: solve.DenseOperator, albedo: Tensor, exitance: Tensor) -> np.ndarray:
    """B `patch channel` of the system as stored, refined in extended precision."""
    factors = operator.form_factors.double().numpy().astype(np.longdouble)
    rho, right = (t.double().numpy().astype(np.longdouble) for t in (albedo, exitance))
    found = np.zeros_like(right)
    for channel in range(right.shape[-1]):
        system = np.eye(len(right), dtype=np.longdouble) - rho[:, channel, None] * factors
        decomposed = torch.linalg.lu_factor(torch.tensor(system.astype(np.float64)))
        for _ in range(6):
            rest = (right[:, channel] - system @ found[:, channel]).astype(np.float64)
            step = torch.linalg.lu_solve(*decomposed, torch.tensor(rest).unsqueeze(-1))
            found[:, channel] += step.squeeze(-1).numpy()
    return found


def errors_of(found: solve.Solution, exact: np.ndarray) -> np.ndarray:
    """Largest |B - B*| per channel."""
    return np.abs(found.radiosity.detach().double().numpy().astype(np.longdouble) - exact).max(0)


def truncated_solvers(patches: int) -> list[solve.AbstractSolver]:
    """Every solver, stopped early in several ways."""
    return [
        solver
        for tail in (False, True)
        for solver in (
            *(solve.Neumann(bounces, tail) for bounces in (0, 1, 3, 8, 25)),
            solve.AdaptiveNeumann(1e-2, ambient_tail=tail),
            *(solve.GaussSeidel(max_sweeps=count, ambient_tail=tail) for count in (1, 3)),
            *(solve.ConjugateGradient(max_iterations=n, ambient_tail=tail) for n in (1, 2, 4)),
            *(solve.Southwell(max_shots=n, ambient_tail=tail) for n in (1, patches, 3 * patches)),
        )
    ]
