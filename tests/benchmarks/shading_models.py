"""What each effect of the shading model is worth to a network: degrees on real photographs.

`python -m tests.benchmarks.shading_models --cache FILE.json`

The same photometric network is trained in equal steps on data with more and more of what light
does, and measured on real objects (DiLiGenT) that no training saw: under all 96 lights, and under
ten drawn at random (five published seeds). Nothing is chosen by these figures. Seconds are of one
thread. A training that FILE holds is not repeated: the study may be stopped and gone on with.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import torch
from torch import Tensor

from tests.benchmarks.photographs import DRAWS, OBJECTS
from tests.conftest import DATA
from torchradiometry.deploy import Photographs, read_photographs
from torchradiometry.learn import (
    PhotometricTraining,
    SurfaceOptions,
    angle_degrees,
    drawn_lights,
    least_squares,
    robust_normals,
    train,
)
from torchradiometry.places import atomic_path

LOCAL = SurfaceOptions(shadows=False, indirect=False, area=False)
MODELS = {
    "local shading": LOCAL,
    "+ cast shadows": replace(LOCAL, shadows=True),
    "+ bounces": replace(LOCAL, indirect=True),
    "+ shadows and bounces": replace(LOCAL, shadows=True, indirect=True),
    "+ area lamps and stray light": SurfaceOptions(),
}
PIXELS_AT_ONCE = 512

Row: TypeAlias = dict[str, float]
#: intensity, direction -> normal: a network or a fit
Solve: TypeAlias = Callable[[Tensor, Tensor], Tensor]


@torch.no_grad()
def degrees(network: Solve, photographs: Photographs) -> float:
    """Mean angle over the mask."""
    assert photographs.ground_truth is not None
    intensity = torch.from_numpy(photographs.grey())
    direction = torch.from_numpy(photographs.light_directions).float()
    truth = torch.from_numpy(photographs.ground_truth[photographs.mask]).float()
    found = torch.cat([network(part, direction) for part in intensity.split(PIXELS_AT_ONCE)])
    return float(angle_degrees(found, truth).mean())


def measured(network: Solve, data: Path) -> Row:
    """Every object under 96 and under ten lights, and the means."""
    row: Row = {}
    for name in OBJECTS:
        photographs = read_photographs(data / "diligent" / name)
        row[name] = degrees(network, photographs)
        drawn = (drawn_lights(96, 10, seed) for seed in DRAWS)
        few = [degrees(network, photographs.under(lights)) for lights in drawn]
        row[f"{name}, 10"] = statistics.mean(few)
    row["96 lights"] = statistics.mean(row[name] for name in OBJECTS)
    row["10 lights"] = statistics.mean(row[f"{name}, 10"] for name in OBJECTS)
    return row


def line(name: str, rows: list[Row]) -> str:
    """Means over the seeds and, where there are several, their range."""

    def cell(key: str) -> str:
        values = [row[key] for row in rows]
        spread = f" ({min(values):.2f} to {max(values):.2f})" if len(values) > 1 else ""
        return f"{statistics.mean(values):.2f}{spread}"

    seconds = [row["seconds"] for row in rows if "seconds" in row]
    cells = [*(f"{statistics.mean(r[o] for r in rows):.2f}" for o in OBJECTS)]
    cells += [cell("96 lights"), cell("10 lights")]
    cells.append(f"{statistics.median(seconds):.0f}" if seconds else "")
    return "| " + " | ".join([name, *cells]) + " |"


def main() -> None:
    """Train what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=Path("shading_models.json"))
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=1500)
    options = parser.parse_args()
    torch.set_num_threads(1)
    known = json.loads(options.cache.read_text()) if options.cache.exists() else {}
    for seed in range(1, options.seeds + 1):
        for name, surfaces in MODELS.items():
            key = f"{name}, seed {seed}, {options.steps} steps"
            if key in known:
                continue
            trained = train(PhotometricTraining(options.steps, surfaces, seed=seed))
            row = measured(trained.network, options.data) | {"seconds": trained.seconds}
            known[key] = row
            with atomic_path(options.cache) as temporary:
                temporary.write_text(json.dumps(known, indent=1))
            print(f"{key}: {row['96 lights']:.2f}, {row['10 lights']:.2f}", flush=True)
    print(
        "| trained on | "
        + " | ".join(OBJECTS)
        + " | 96 lights | 10 lights | s |\n"
        + "|---" * 8
        + "|"
    )
    for name in MODELS:
        keys = [f"{name}, seed {s}, {options.steps} steps" for s in range(1, options.seeds + 1)]
        print(line(name, [known[key] for key in keys]))
    for name, fit in (("robust fit", robust_normals), ("least squares", least_squares)):
        print(line(f"no network: {name}", [measured(fit, options.data)]))


if __name__ == "__main__":
    main()
