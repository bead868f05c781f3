"""How much is enough: a plan for two rooms and a door, and what each step of light buys.

`Planner` looks at some hundred pixels and says which effects a picture needs for an error that is
named, and why. Beside plans for 10 and 3 % some settings by hand are measured, from direct light to
a fine solution: relative L1 error against the finest one over pixels that see no lamp, and seconds
of the processor. `torchradiometry tradeoff` does this for any scene, rung by rung, with gradients.

Run it: `python examples/plan_a_scene.py`. It writes `docs/pictures/plan_a_scene.png`: three rungs,
the plan for 3 %, and error against time.
"""

from __future__ import annotations

import time
from pathlib import Path

import torch
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from torchradiometry.files import linear_to_srgb
from torchradiometry.plan import Planner, Rung
from torchradiometry.render import Picture, RenderSettings, render_scene
from torchradiometry.scene import STANDARD_SCENES

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "plan_a_scene.png"
#: the scene: light comes through a door, by several bounces
SCENE = "two rooms"
TOLERANCES = (0.1, 0.03)
#: what is drawn
SHOWN = ("direct light", "an ambient number", "2 bounces", "plan for 3%")


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Plan, measure, draw; the predicted error of the finer plan, and all measured ones."""
    scene = STANDARD_SCENES["groove" if fast else SCENE](*((24, 18) if fast else (96, 72)))
    plans = {t: Planner(tolerance=t).plan(scene, scene.cameras[0]) for t in TOLERANCES}
    print(plans[TOLERANCES[-1]].table())
    rungs = [*rungs_of(fast), *(Rung(f"plan for {t:.0%}", p.settings) for t, p in plans.items())]
    pictures, seconds = {}, {}
    for rung in rungs:
        began = time.process_time()
        with torch.no_grad():
            pictures[rung.name] = render_scene(scene, scene.cameras[0], rung.settings)
        seconds[rung.name] = time.process_time() - began
    fine = pictures["fine"]
    keep = ~fine.emitter
    errors = {
        name: float((p.radiance - fine.radiance)[keep].abs().sum() / fine.radiance[keep].sum())
        for name, p in pictures.items()
        if name != "fine"
    }
    draw(out, pictures, errors, seconds)
    return {"predicted": plans[TOLERANCES[-1]].predicted_error, **errors}


def draw(
    out: Path, pictures: dict[str, Picture], errors: dict[str, float], seconds: dict[str, float]
) -> None:
    """Four pictures at one exposure, and error against time."""
    figure = Figure(figsize=(9.6, 2.3), layout="constrained")
    *panels, curve = figure.subplots(1, 5, width_ratios=[1, 1, 1, 1, 1.6])
    last = pictures[SHOWN[-1]]
    exposure = 1 / float(last.radiance[~last.emitter].quantile(0.97))
    for axes, name in zip(panels, SHOWN, strict=True):
        screen = (exposure * pictures[name].radiance).clamp(0, 1).numpy()
        axes.imshow(linear_to_srgb(screen))
        axes.set_title(name, fontsize=8)
        axes.set_axis_off()
    for name, error in errors.items():
        curve.loglog(seconds[name], 100 * error, "r^" if "plan" in name else "ko", ms=4)
        place = (seconds[name], 100 * error)
        curve.annotate(name, place, (4, -2), textcoords="offset points", fontsize=6)
    curve.margins(x=0.5, y=0.15)
    curve.xaxis.set_minor_formatter(NullFormatter())
    curve.set(xlabel="processor seconds", ylabel="error, %")
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


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
