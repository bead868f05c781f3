"""Radiosity of large scenes: `python -m tests.benchmarks.scale [--patches N ...]`.

A closed room with two boxes and a ceiling panel, and a round one (icosphere) with a ring in it,
cut into more and more patches (on request also furnished rooms: `--scene crates`): time of links
(with visibility), closing and solving, peak memory, and up to `--dense` patches the relative L1
error of the radiosity, area weighted, against the dense matrix of the same patches in the same
run. The fitted exponent of the time stands last.
Every size is a process of its own, so that its peak memory is its own.

The dense reference has four times the default number of shadow segments; the column "dense"
is the error of the dense matrix with the default number against it.
"""

from __future__ import annotations

import argparse
import math
import resource
import subprocess
import sys
import time

import torch
import trimesh
from torch import Tensor

from tests.benchmarks.furnished import crates, cut, doors, table
from torchradiometry import (
    ConjugateGradient,
    DenseOperator,
    EmbreeRays,
    Patches,
    exchange_areas,
    hierarchical_operator,
    solve_radiosity,
)
from torchradiometry.scene.build import cornell_like_room, sphere
from torchradiometry.solve import AbstractOperator

SIZES = (2_000, 5_000, 10_000, 30_000, 100_000)
LARGER = (300_000, 1_000_000)
ROUND = "round room"
BOXES = "room with boxes"


def boxes(count: int) -> tuple[Patches, Tensor, Tensor, Tensor]:
    """About `count` patches, albedo, exitance, and the blockers."""
    return cut(list(cornell_like_room(dtype=torch.float64).surfaces), count)


def rounded(count: int) -> tuple[Patches, Tensor, Tensor, Tensor]:
    """The same for the round room."""
    level = max(1, round(math.log(count * 0.7 / 20, 4)))
    wall = sphere("wall", 3.0, subdivisions=level, dtype=torch.float64)
    wall_corners = wall.vertices[wall.faces].flip(1)
    left = max(200, count - len(wall_corners))
    around = round(math.sqrt(left))
    ring = trimesh.creation.torus(1.0, 0.4, major_sections=around, minor_sections=around // 2)
    place = torch.tensor([0.3, 0.2, -0.5], dtype=torch.float64)
    ring_corners = torch.tensor(ring.vertices[ring.faces]) + place
    solid = torch.cat((wall_corners, ring_corners))
    albedo = torch.full((len(solid), 3), 0.7, dtype=torch.float64)
    albedo[len(wall_corners) :] = 0.4
    lamp = Patches(solid).centroid[:, 2] > 2.4
    return Patches(solid), albedo, 10 * lamp.to(albedo).unsqueeze(-1).expand(-1, 3), solid


SCENES = {BOXES: boxes, ROUND: rounded}
#: for `--scene`, against the dense matrix
FURNISHED = {"crates": crates, "table": table, "two rooms": doors}


def difference(found: Tensor, expected: Tensor, area: Tensor, where: Tensor) -> float:
    """Relative L1 over the patches `where`, area weighted."""
    weight = (area * where).unsqueeze(-1)
    return float((weight * (found - expected).abs()).sum() / (weight * expected).sum())


def dense(patches: Patches, rays: EmbreeRays, closed: bool, samples: int) -> AbstractOperator:
    exchange, area = exchange_areas(
        patches, rays, closed=closed, samples=samples, rtol=1e-3, budget=2**34
    )
    return DenseOperator(exchange / area.unsqueeze(1), area)


def measured(name: str, count: int, limit: int) -> str:
    """One line of the table."""
    patches, albedo, exitance, solid = (SCENES | FURNISHED)[name](count)
    # boxes stand on the floor and hide some of it: only the round room's rows are all 1
    closed = name == ROUND
    began, used = time.perf_counter(), time.process_time()
    rays = EmbreeRays(solid)
    operator = hierarchical_operator(patches, rays, closed=closed)
    built, built_cpu = time.perf_counter(), time.process_time()
    solution = solve_radiosity(operator, albedo, exitance, solver=ConjugateGradient(1e-6))
    ended, ended_cpu = time.perf_counter(), time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    errors = ["", "", ""]
    if patches.count <= limit:
        area = patches.area
        right = solve_radiosity(dense(patches, rays, closed, 16), albedo, exitance).radiosity
        usual = solve_radiosity(dense(patches, rays, closed, 4), albedo, exitance).radiosity
        everywhere, dark = torch.ones_like(area), (exitance.sum(-1) == 0).to(area)
        errors = [
            f"{100 * difference(solution.radiosity, right, area, everywhere):.2f}",
            f"{100 * difference(solution.radiosity, right, area, dark):.2f}",
            f"{100 * difference(usual, right, area, dark):.2f}",
        ]
    cells = (
        name,
        f"{patches.count}",
        f"{len(operator.kernel)}",
        f"{len(operator.near_first)}",
        f"{built - began:.1f} ({built_cpu - used:.1f})",
        f"{ended - built:.1f} ({ended_cpu - built_cpu:.1f})",
        f"{ended - began:.1f} ({ended_cpu - used:.1f})",
        f"{solution.iterations}",
        f"{peak:.2f}",
        *errors,
    )
    return "| " + " | ".join(cells) + " |"


def exponents(rows: list[str]) -> None:
    """Slope of log(processor time) over log(patches), first size to last."""
    for name in SCENES:
        cells = [[c.strip() for c in row.split("|")[1:-1]] for row in rows]
        points = [
            (math.log(int(c[1])), math.log(float(c[6].split("(")[1].rstrip(")"))))
            for c in cells
            if c[0] == name
        ]
        if len(points) > 1:
            (x0, y0), (x1, y1) = points[0], points[-1]
            print(f"\n{name}: processor time grows as N^{(y1 - y0) / (x1 - x0):.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--patches", type=int, nargs="*", default=SIZES)
    parser.add_argument("--scene", choices=[*SCENES, *FURNISHED], nargs="*", default=list(SCENES))
    parser.add_argument("--larger", action="store_true", help=f"{LARGER} patches as well")
    parser.add_argument("--dense", type=int, default=5_500, help="largest dense reference")
    parser.add_argument("--one", action="store_true", help="one line, in this process")
    chosen = parser.parse_args()
    if chosen.one:
        print(measured(chosen.scene[0], chosen.patches[0], chosen.dense), flush=True)
        return
    print(f"torch {torch.__version__}, {torch.get_num_threads()} threads; s: wall (processor)\n")
    print(
        "| scene | patches | links | near | links s | solve s | total s | products | peak GiB "
        "| error % | error of unlit % | dense, unlit % |"
    )
    print("|" + "---|" * 12, flush=True)
    rows = []
    sizes = [*chosen.patches, *(LARGER if chosen.larger else ())]
    for name in chosen.scene:
        for count in sizes:
            command = [sys.executable, "-m", "tests.benchmarks.scale", "--one", "--scene", name]
            command += ["--patches", str(count), "--dense", str(chosen.dense)]
            done = subprocess.run(command, capture_output=True, text=True)
            line = done.stdout.strip()
            if done.returncode or not line:
                reason = (done.stderr.strip().splitlines() or ["?"])[-1]
                line = f"| {name} | {count} | not reached: {reason} |"
            else:
                rows.append(line)
            print(line, flush=True)
    exponents(rows)


if __name__ == "__main__":
    main()
