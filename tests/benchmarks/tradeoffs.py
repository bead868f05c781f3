"""Accuracy versus time of seven standard scenes, for the documentation.

`python -m tests.benchmarks.tradeoffs --cache DIR --out docs/tradeoffs`

Every scene climbs its ladder (`torchradiometry.tradeoff`) and the plans for 10 %, 3 % and 1 % are
measured beside it, against a path tracer's picture (`python -m tests.benchmarks.references`). One
table, one JSON file and one plot a scene. A scene that has been written is not measured again.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import torch
from rich.progress import track

from tests.benchmarks.references import SCENES, SIZE, load
from torchradiometry import Planner, calibrate, tradeoff
from torchradiometry.plan import Costs, Rung

NAMES = ("ball", "groove", "bowl", "cornell", "white room", "black room", "two rooms")
TOLERANCES = (0.1, 0.03, 0.01)


def measure(folder: Path, cache: Path, name: str, costs: Costs, repeats: int) -> None:
    """One scene."""
    scene, reference = SCENES[name](*SIZE), load(cache, name)
    plans = [
        Rung(f"plan {100 * t:g} %", Planner(t, costs=costs).plan(scene, scene.cameras[0]).settings)
        for t in TOLERANCES
    ]
    truth = torch.from_numpy(reference.radiance)
    found = tradeoff(scene, reference=truth, repeats=repeats, choices=plans)
    stem = folder / name.replace(" ", "_")
    found.save_plot(stem.with_suffix(".png"))
    found.save_csv(stem.with_suffix(".csv"))
    found.save_json(stem.with_suffix(".json"))


def main() -> None:
    """Measure what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", default=NAMES)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--out", type=Path, default=Path("docs/tradeoffs"))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--prices", type=Path, default=None, help="a file of stored prices")
    options = parser.parse_args()
    torch.set_num_threads(1)
    known = options.prices is not None and options.prices.exists()
    costs = Costs.load(options.prices) if known else calibrate(options.prices)
    options.out.mkdir(exist_ok=True)
    for name in track(options.names):
        if not (options.out / f"{name.replace(' ', '_')}.json").exists():
            began = time.perf_counter()
            measure(options.out, options.cache, name, costs, options.repeats)
            print(f"{name}: {time.perf_counter() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
