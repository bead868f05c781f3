"""A matrix or a tree of clusters for the renderer: `python -m tests.benchmarks.operators`.

For patches of the Cornell-like room and of a ball with a dent, seconds (processor) to make F as
the renderer makes it, as a matrix and as a tree of clusters that aims at 1 %, milliseconds of a
product with F (median), and the relative L1 error, area weighted, of two quantities:

    B = M + rho F B,  rho = 0.6,  M = max(0, n . d) of each patch,  d = (0.3, 1, 0.4) / |d|

and B - M, what was reflected, both against a matrix with four times as many shadow segments. A
matrix that exceeds the renderer's budget is not made. Every row in the same run.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from statistics import median

import torch
from torch import Tensor

from torchradiometry import (
    ConjugateGradient,
    DenseOperator,
    Patches,
    RenderSettings,
    Scene,
    form_factors,
    hierarchical_operator,
    prepare,
    solve_radiosity,
)
from torchradiometry.render.exposure import Exposure, exposure_of
from torchradiometry.render.indirect import CLUSTER_ERROR, PAIR_ERROR, first_patches
from torchradiometry.render.world import World
from torchradiometry.scene.build import cornell_like_room, sphere
from torchradiometry.solve import AbstractOperator
from torchradiometry.transport.form_factors import MATRICES

SETTINGS = RenderSettings()
#: longest edges of the room's patches, m, and how often the ball's faces are split
EDGES, LEVELS = (0.8, 0.4, 0.3), (3, 4, 5)
ALBEDO = 0.6


def dented_ball(level: int) -> Scene:
    ball = sphere("ball", 1.0, subdivisions=level, smooth=False)
    dent = 1 - 0.6 * torch.exp(-8 * (1 - ball.vertices[:, 2:]))
    return Scene((replace(ball, vertices=ball.vertices * dent),))


def matrix(world: World, patches: Patches, exposure: Exposure, samples: int) -> AbstractOperator:
    factors = form_factors(
        patches,
        world.rays,
        closed=exposure.enclosed,
        exposure=exposure.share,
        samples=samples,
        rtol=PAIR_ERROR,
        budget=SETTINGS.budget,
    )
    return DenseOperator(factors, patches.area * exposure.share)


def tree(world: World, patches: Patches, exposure: Exposure) -> AbstractOperator:
    return hierarchical_operator(
        patches,
        world.rays,
        closed=exposure.enclosed,
        exposure=exposure.share,
        tolerance=CLUSTER_ERROR,
        budget=SETTINGS.budget,
    )


def timed(call: Callable[[], AbstractOperator]) -> tuple[AbstractOperator, float]:
    began = time.process_time()
    made = call()
    return made, time.process_time() - began


def product_ms(operator: AbstractOperator, x: Tensor, repeats: int = 7) -> float:
    times = []
    for _ in range(repeats):
        began = time.process_time()
        operator(x)
        times.append(1e3 * (time.process_time() - began))
    return median(times)


def difference(found: Tensor, expected: Tensor, area: Tensor) -> float:
    weight = area.unsqueeze(-1)
    return float((weight * (found - expected).abs()).sum() / (weight * expected).sum())


@torch.no_grad()
def rows(name: str, scene: Scene, edge: float) -> list[str]:
    """Two lines of the table."""
    settings = replace(SETTINGS, patch_size=edge)
    world = prepare(scene, settings)
    patches = Patches(first_patches(world, settings).corners)
    exposure = exposure_of(world, patches, settings.seed)
    toward = torch.nn.functional.normalize(torch.tensor([0.3, 1, 0.4], dtype=torch.float64), dim=0)
    exitance = (patches.normal @ toward).clamp(min=0).unsqueeze(-1)
    albedo = torch.full_like(exitance, ALBEDO)
    area = patches.area * exposure.share

    def radiosity(operator: AbstractOperator) -> Tensor:
        return solve_radiosity(operator, albedo, exitance, ConjugateGradient(1e-8)).radiosity

    ways: dict[str, Callable[[], AbstractOperator]] = {
        "matrix": lambda: matrix(world, patches, exposure, settings.pair_samples),
        "tree": lambda: tree(world, patches, exposure),
    }
    exact = None
    if 8 * MATRICES * patches.count**2 <= settings.budget:
        exact = radiosity(matrix(world, patches, exposure, 4 * settings.pair_samples))
    else:
        del ways["matrix"]
    found = []
    for way, call in ways.items():
        operator, seconds = timed(call)
        cells = [name, f"{patches.count:,}", way, f"{seconds:.1f}"]
        cells += [f"{product_ms(operator, exitance):.1f}"]
        if exact is None:
            cells += ["", ""]
        else:
            other = radiosity(operator)
            parts = (other, exact), (other - exitance, exact - exitance)
            cells += [f"{100 * difference(*pair, area):.2f} %" for pair in parts]
        found.append("| " + " | ".join(cells) + " |")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--edges", type=float, nargs="*", default=EDGES)
    parser.add_argument("--levels", type=int, nargs="*", default=LEVELS)
    options = parser.parse_args()
    print(f"torch {torch.__version__}, {torch.get_num_threads()} threads; s: processor\n")
    print(
        "| scene | patches | F | s | product, ms | B | reflected |\n|---|---|---|---|---|---|---|"
    )
    for edge in options.edges:
        for line in rows("room", cornell_like_room(), edge):
            print(line, flush=True)
    for level in options.levels:
        for line in rows("dented ball", dented_ball(level), 1.0):
            print(line, flush=True)


if __name__ == "__main__":
    main()
