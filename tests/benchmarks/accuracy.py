"""How exact the formulas are on hard inputs: `python -m tests.benchmarks.accuracy [--count N]`.

Random inputs of `tests.accuracy.inputs`, exact in the dtype of the row, against fifty digits
(`tests.accuracy.truth`): relative errors, median and worst. "graph" is what a compiled or exported
graph computes, which has no second look. `--seed` draws others.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Iterator

import torch
from torch import Tensor

from tests.accuracy import truth
from tests.accuracy.inputs import POLYGONS, SPHERES, Draw, plates, receivers, spheres
from tests.solve.rooms import KINDS, room
from torchradiometry import solve, transport
from torchradiometry.geometry import (
    polygon_irradiance,
    polygon_vector_irradiance,
    solid_angle_polygon,
)
from torchradiometry.sources.sphere import sphere_irradiance, sphere_vector_irradiance

DTYPES = (torch.float64, torch.float32)
#: of a batch, a triangle's worth of form factors is dear: fifty digits and a double integral
TRIANGLES = 10


def show(name: str, dtype: torch.dtype, errors: list[float]) -> None:
    kind = str(dtype).removeprefix("torch.")
    middle, most = statistics.median(errors), max(errors)
    print(f"| {name} | {kind} | {len(errors)} | {middle:.0e} | {most:.0e} |", flush=True)


def polygon_errors(kind: str, count: int, dtype: torch.dtype, seed: int) -> Iterator[list[float]]:
    """Irradiance, the same as a graph computes it, solid angle."""
    for at in receivers(kind, count, dtype, seed):
        exact = truth.polygon_irradiance(*at)
        if exact == 0:
            continue
        wide = [t.double() for t in at]
        graph = (polygon_vector_irradiance(*wide) * wide[1]).sum(-1).abs().to(dtype)
        found = (polygon_irradiance(*at, two_sided=True), graph)
        omega = solid_angle_polygon(at.position, at.polygon)
        yield [truth.relative(float(f), exact) for f in found] + [
            truth.relative(float(omega), truth.solid_angle(at.position, at.polygon))
        ]


def sphere_errors(kind: str, count: int, dtype: torch.dtype, seed: int) -> Iterator[list[float]]:
    for at in spheres(kind, count, dtype, seed):
        exact = truth.sphere_irradiance(*at)
        wide = [t.double() for t in at]
        graph = (sphere_vector_irradiance(*wide) * wide[1]).sum(-1).to(dtype)
        yield [truth.relative(float(f), exact) for f in (sphere_irradiance(*at), graph)]


def plate_errors(kind: str, count: int, dtype: torch.dtype, seed: int) -> list[float]:
    closed = getattr(truth, f"{kind}_rectangles")
    return [
        truth.relative(float(transport.form_factors(patches)[0, 1]), closed(*sizes))
        for patches, sizes in plates(kind, count, dtype, seed)
    ]


def triangle_errors(shared: int, count: int, seed: int) -> list[float]:
    """Random triangles with so many corners in common, those with A F > 1e-6."""
    draw, found = Draw(seed, torch.float64), []
    while len(found) < count:
        first, second = draw.uniform(2, 3, 3)
        second[:shared] = first[:shared].flip(0)
        for turned in (second, second.flip(0)):
            value = float(transport.polygon_exchange(first[None], turned[None]))
            if value > 1e-6:
                found.append(truth.relative(value, truth.exchange(first, turned)))
    return found


def largest(found: Tensor, exact: list) -> float:
    """Of a vector, relative to its largest value."""
    values = found.detach().flatten().tolist()
    off = max(abs(truth.mpf(f) - x) for f, x in zip(values, exact, strict=True))
    return float(off / max(abs(x) for x in exact))


def radiosity_errors(
    solver: solve.AbstractSolver, albedo: float, dtype: torch.dtype, seed: int
) -> Iterator[list[float]]:
    """Radiosity, radiosity over the condition number, gradients; all kinds of rooms."""
    for kind in KINDS:
        operator, draw = room(kind, 8, dtype, seed), Draw(seed, dtype)
        rho = torch.full((8, 1), albedo, dtype=dtype)
        light, wanted = (draw.rounded(draw.uniform(8, 1)) for _ in range(2))
        system = (operator.form_factors, rho[:, 0], light[:, 0])
        exact, slopes = truth.radiosity(*system), truth.radiosity_gradients(*system, wanted[:, 0])
        leaves = [t.clone().requires_grad_() for t in (rho, light, operator.form_factors)]
        held = solve.DenseOperator(leaves[2], operator.area)
        found = solve.Implicit().solve(solver, held, *leaves[:2]).radiosity
        gradients = torch.autograd.grad((found * wanted).sum(), leaves)
        expected = [*slopes[:2], [x for row in slopes[2] for x in row]]
        error = largest(found, exact)
        pairs = zip(gradients, expected, strict=True)
        yield [
            error,
            error / truth.condition(*system[:2]),
            max(largest(gradient, slope) for gradient, slope in pairs),
        ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    count, seed = options.count, options.seed
    print("| quantity | dtype | inputs | median | worst |\n|---|---|---|---|---|")
    for dtype in DTYPES:
        for kind in POLYGONS:
            columns = zip(*polygon_errors(kind, count, dtype, seed), strict=True)
            for name, errors in zip(("E", "E in a graph", "solid angle"), columns, strict=True):
                show(f"polygon, {kind}: {name}", dtype, list(errors))
        for kind in SPHERES:
            columns = zip(*sphere_errors(kind, count, dtype, seed), strict=True)
            for name, errors in zip(("E", "E in a graph"), columns, strict=True):
                show(f"sphere, {kind}: {name}", dtype, list(errors))
        for kind in ("parallel", "perpendicular"):
            errors = plate_errors(kind, count, dtype, seed)
            show(f"form factors, {kind} plates of ratios up to 1000", dtype, errors)
        for solver in (solve.ConjugateGradient(), solve.Direct()):
            for albedo in (0.5, 0.999):
                columns = zip(*radiosity_errors(solver, albedo, dtype, seed), strict=True)
                names = ("B", "B over the condition number", "gradients")
                for name, errors in zip(names, columns, strict=True):
                    title = f"{type(solver).__name__}, albedo {albedo}: {name}"
                    show(title, dtype, list(errors))
    for shared, name in enumerate(("no corner", "a corner", "an edge")):
        errors = triangle_errors(shared, min(TRIANGLES, count), seed)
        show(f"exchange, triangles with {name} in common", torch.float64, errors)


if __name__ == "__main__":
    main()
