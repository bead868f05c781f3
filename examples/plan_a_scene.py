"""How much is enough: a plan for two rooms and a door, and what each step of light buys.

`Planner` looks at some hundred pixels and says which effects a picture needs for an error that is
named, and why. `tradeoff` measures error and seconds of any settings; here of a few rungs from
direct light to a fine solution, and of plans for 10 and 3 %. Errors are relative L1 over pixels
that see no lamp, against the last rung.

Run it: `python examples/plan_a_scene.py`. It writes `docs/pictures/plan_a_scene.png`: three rungs,
the plan for 3 %, and error against time.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from torchradiometry.files import linear_to_srgb
from torchradiometry.plan import Planner, Rung, tradeoff
from torchradiometry.render import RenderSettings, render_scene
from torchradiometry.scene import STANDARD_SCENES, Scene

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "plan_a_scene.png"
#: the scene: light comes through a door, by several bounces
SCENE = "two rooms"
TOLERANCES = (0.1, 0.03)


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Plan, measure, draw; the predicted error of the finer plan, and all measured ones."""
    scene = STANDARD_SCENES["groove" if fast else SCENE](*((24, 18) if fast else (96, 72)))
    plans = {t: Planner(tolerance=t).plan(scene, scene.cameras[0]) for t in TOLERANCES}
    print(plans[TOLERANCES[-1]].table())
    choices = [Rung(f"plan for {t:.0%}", plan.settings) for t, plan in plans.items()]
    rungs = rungs_of(fast)
    found = tradeoff(scene, repeats=1, rungs=rungs, choices=choices)
    figure = Figure(figsize=(9.6, 2.3), layout="constrained")
    *panels, curve = figure.subplots(1, 5, width_ratios=[1, 1, 1, 1, 1.4])
    draw(scene, panels, [rungs[0], rungs[1], rungs[2], choices[-1]])
    for row in found.rows:
        if row.error > 0:
            curve.loglog(row.seconds, 100 * row.error, "r^" if row.chosen else "ko", ms=4)
            place = (row.seconds, 100 * row.error)
            curve.annotate(row.name, place, (3, 3), textcoords="offset points", fontsize=5)
    curve.set(xlabel="seconds", ylabel="error, %")
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)
    errors = {row.name: row.error for row in found.rows}
    return {"predicted": plans[TOLERANCES[-1]].predicted_error, **errors}


def draw(scene: Scene, panels: Sequence[Axes], rungs: Sequence[Rung]) -> None:
    """Pictures at the exposure of the last one."""
    with torch.no_grad():
        pictures = [render_scene(scene, scene.cameras[0], rung.settings) for rung in rungs]
    last = pictures[-1]
    exposure = 1 / float(last.radiance[~last.emitter].quantile(0.97))
    for axes, rung, picture in zip(panels, rungs, pictures, strict=True):
        axes.imshow(linear_to_srgb((exposure * picture.radiance).clamp(0, 1).numpy()))
        axes.set_title(rung.name, fontsize=8)
        axes.set_axis_off()


def rungs_of(fast: bool) -> list[Rung]:
    """Some ways to make the picture; each adds one thing to the one before it."""
    common = {"supersampling": 1 if fast else 2, "patch_size": 1.0 if fast else 0.8}
    fine = (
        {"supersampling": 2, "patch_size": 0.5} if fast else {"supersampling": 4, "patch_size": 0.4}
    )
    return [
        Rung("direct light", RenderSettings(bounces=0, **common)),  # type: ignore[arg-type]
        Rung("an ambient number", RenderSettings(bounces=0, ambient=True, **common)),  # type: ignore[arg-type]
        Rung("2 bounces", RenderSettings(bounces=2, ambient_tail=False, **common)),  # type: ignore[arg-type]
        Rung("2 and a tail", RenderSettings(bounces=2, **common)),  # type: ignore[arg-type]
        Rung("32 bounces", RenderSettings(bounces=32, **common)),  # type: ignore[arg-type]
        Rung("fine", RenderSettings(bounces=64, **fine)),  # type: ignore[arg-type]
    ]


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name}: {value:.4f}")
