"""From a scene to a folder with its measured ladder: `tradeoff.csv`, `.json`, `.pdf` and `.png`.

The plans for tolerances of 10 %, 3 % and 1 % are measured beside the rungs, so that the figure
shows where the planner's choices lie.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from torchradiometry.places import make_folder
from torchradiometry.plan.ladder import Rung
from torchradiometry.plan.planner import Planner
from torchradiometry.plan.render_file import open_scene
from torchradiometry.plan.tradeoff import tradeoff
from torchradiometry.plan.tradeoff_plot import require_matplotlib

__all__ = ["tradeoff_file"]

#: tolerances of the plans that are shown
TOLERANCES = (0.1, 0.03, 0.01)


def tradeoff_file(
    scene: str | Path,
    out: str | Path,
    *,
    width: int = 96,
    height: int = 72,
    repeats: int = 3,
    progress: Callable[[int, int, str], None] | None = None,
) -> dict[str, object]:
    """Measure the ladder of a scene and write tables and plots.

    Args:
        scene: glTF, GLB or a mesh, or the name of a standard scene.
        out: folder, made if it is not there.
        width, height: pixels.
        repeats: runs of each rung, >= 1.
        progress: as of `tradeoff`.

    Returns:
        `out`, `seconds`, `warnings` (faults of the scene that a picture survives) and what
        `Tradeoff.to_dict()` gives, ready for JSON.

    Raises:
        MissingDependencyError: matplotlib is not installed (found out first).
        InputFileError: the scene or the place of `out` does not exist.
        RadiometryError: as of `open_scene` and `tradeoff`.
    """
    began, folder = time.perf_counter(), Path(out)
    require_matplotlib()
    made, warnings = open_scene(scene, width, height)
    make_folder(folder, "measurements")
    plans = [
        Rung(f"plan {100 * t:g} %", Planner(t).plan(made, made.cameras[0]).settings)
        for t in TOLERANCES
    ]
    found = tradeoff(made, repeats=repeats, choices=plans, progress=progress)
    found.save_csv(folder / "tradeoff.csv")
    found.save_json(folder / "tradeoff.json")
    for ending in ("pdf", "png"):
        found.save_plot(folder / f"tradeoff.{ending}")
    seconds = time.perf_counter() - began
    return {"out": str(folder), "seconds": seconds, "warnings": list(warnings)} | found.to_dict()
