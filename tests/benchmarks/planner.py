"""Is the planner honest, thrifty and quick? `python -m tests.benchmarks.planner --cache DIR`.

Every scene that has a reference picture (`python -m tests.benchmarks.references`, a path tracer's)
is planned for every tolerance, rendered as planned, and compared:

    error = sum |L - L*| / sum L*        over pixels none of whose rays meet an emitter

The reference's own noise is contained in the measured error; "honest" asks for
measured - noise <= tolerance and measured - noise <= predicted. Seconds are of the whole picture,
the processor's, on one thread, median of the repeats; prices are fitted first (`calibrate`).
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from tests.benchmarks.references import SCENES, SIZE, load
from torchradiometry import Planner, calibrate, render_scene
from torchradiometry.plan import Costs

TOLERANCES = (0.1, 0.03, 0.01)


class Case(NamedTuple):
    """One scene and tolerance."""

    scene: str
    tolerance: float
    measured: float
    noise: float
    predicted: float
    seconds: float
    expected_seconds: float
    planning: float
    included: str

    @property
    def honest(self) -> bool:
        """Within the tolerance and the prediction, but for the reference's own noise."""
        return self.measured - self.noise <= min(self.tolerance, self.predicted)


def run(folder: Path, name: str, tolerance: float, costs: Costs, repeats: int) -> Case:
    """Plan, render, compare."""
    scene, reference = SCENES[name](*SIZE), load(folder, name)
    camera, planner = scene.cameras[0], Planner(tolerance, costs=costs)
    planning, seconds = [], []
    for _ in range(repeats):
        began = time.process_time()
        plan = planner.plan(scene, camera)
        planning.append(time.process_time() - began)
        began = time.process_time()
        with torch.no_grad():
            picture = render_scene(scene, camera, plan.settings)
        seconds.append(time.process_time() - began)
    mask, truth = reference.mask, reference.radiance
    error = np.abs(picture.radiance.numpy() - truth)[mask].sum() / truth[mask].sum()
    chosen = ", ".join(f"{r.effect} ({r.level.name})" for r in plan.rows if r.included)
    return Case(
        name,
        tolerance,
        float(error),
        reference.noise,
        plan.predicted_error,
        statistics.median(seconds),
        plan.predicted_seconds,
        statistics.median(planning),
        chosen or "none",
    )


def row(case: Case) -> str:
    """A line of the table."""
    cells = [case.scene, *(f"{100 * e:.3g} %" for e in (case.tolerance, case.predicted))]
    cells += [f"{100 * case.measured:.2f} %", f"{100 * case.noise:.2f} %"]
    cells += ["yes" if case.honest else "**no**"]
    cells += [f"{s:.3f}" for s in (case.expected_seconds, case.seconds, case.planning)]
    return "| " + " | ".join([*cells, case.included]) + " |"


def main() -> None:
    """Print a Markdown table and a summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenes; all by default")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--prices", type=Path, default=None, help="a file of stored prices")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    known = options.prices is not None and options.prices.exists()
    costs = Costs.load(options.prices) if known else calibrate(options.prices)
    print("| scene | tolerance | predicted | measured | reference's noise | honest | s, predicted "
          "| s, measured | s, planning | included |\n|" + "---|" * 10)  # fmt: skip
    cases = []
    for name in options.names or SCENES:
        if not (options.cache / f"{name}.npz").exists():
            continue
        for tolerance in TOLERANCES:
            cases.append(run(options.cache, name, tolerance, costs, options.repeats))
            print(row(cases[-1]), flush=True)
    honest = sum(case.honest for case in cases)
    ratio = statistics.median(c.predicted / max(c.measured - c.noise, 1e-5) for c in cases)
    times = [c.seconds / c.expected_seconds for c in cases]
    inside = sum(0.5 <= t <= 2 for t in times)
    print(f"\nhonest: {honest} of {len(cases)}; predicted over measured error: median {ratio:.1f}")
    print(f"seconds within a factor of 2: {inside} of {len(cases)}; {min(times):.2f} to "
          f"{max(times):.2f}, median {statistics.median(times):.2f}")  # fmt: skip
    quick = sum(c.planning <= max(0.2, 0.2 * c.seconds) for c in cases)
    print(f"planning within 0.2 s or 20 % of the picture: {quick} of {len(cases)}")


if __name__ == "__main__":
    main()
