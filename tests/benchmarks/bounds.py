"""How far above the true error is the bound? `python -m tests.benchmarks.bounds`.

Every solver is stopped early in several ways in random closed and open rooms up to albedo
0.9. Baseline in the same run: the plain bound |r| / (1 - q) of the same solutions, without the
further products that sharpen it. Ratios count where the error is truncation; `below` counts
all cases in which a bound is below the true error (found in extended precision).
"""

from __future__ import annotations

import argparse
import json
from statistics import quantiles

import numpy as np
import torch

from tests.solve.rooms import KINDS, errors_of, exact_solution, room, surfaces, truncated_solvers
from torchradiometry import solve

#: share of the radiosity below which an error counts as rounding
ROUNDING = {torch.float64: 1e-10, torch.float32: 2e-3}


def ratios_of(
    dtype: torch.dtype, patches: int, seed: int, found: dict[tuple[str, str, str], list[float]]
) -> int:
    """Collect bound / error by solver, dtype and way; returns how many bounds are too small."""
    below = 0
    for kind in KINDS:
        operator = room(kind, patches, dtype, seed)
        albedo, exitance = surfaces(patches, dtype, seed)
        exact = exact_solution(operator, albedo, exitance)
        for solver in truncated_solvers(patches):
            solution = solver.solve(operator, albedo, exitance)
            plain = solve.certified(operator, albedo, exitance, solution.radiosity, steps=0)
            error = errors_of(solution, exact)
            tail = " + tail" if solver.ambient_tail else ""  # type: ignore[attr-defined]
            for way, bound in (("bound", solution.bound), ("plain", plain.bound)):
                value = bound.double().numpy().astype(np.longdouble)
                below += int((value < error).sum())
                counts = error > ROUNDING[dtype] * exact.max(0)
                key = (type(solver).__name__ + tail, str(dtype).removeprefix("torch."), way)
                found.setdefault(key, []).extend((value / error)[counts].astype(float).tolist())
    return below


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--patches", type=int, nargs="+", default=[2, 9, 40, 120])
    parser.add_argument("--json", help="write the rows to this file too")
    arguments = parser.parse_args()
    found: dict[tuple[str, str, str], list[float]] = {}
    below = 0
    for dtype in (torch.float64, torch.float32):
        for patches in arguments.patches:
            for seed in range(arguments.seeds):
                below += ratios_of(dtype, patches, seed, found)
    rows = []
    print("| solver | dtype | bound | cases | median | 90 % | largest |\n|" + "---|" * 7)
    for (name, dtype_name, way), values in sorted(found.items()):
        if len(values) < 2:  # all errors are rounding
            continue
        tenths = quantiles(values, n=10)
        row = (name, dtype_name, way, len(values), tenths[4], tenths[8], max(values))
        rows.append(row)
        print("| {} | {} | {} | {} | {:.2f} | {:.2f} | {:.2f} |".format(*row))
    print(f"\nbounds below the true error: {below}")
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump({"rows": rows, "below": below}, file)


if __name__ == "__main__":
    main()
