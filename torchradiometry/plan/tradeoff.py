"""Accuracy versus time: what each rung of the ladder costs, and how far off it is.

    error = sum |L - L*| / sum L*      over pixels that see no emitter, in linear radiance

L* is the last rung's picture, or a reference that is handed in (a path tracer's). One run of a
rung is `view_scene` and `develop`; with gradients `develop` is done again, followed by the
gradient of the mean radiance with respect to every albedo and emission. The processor's clock is
not used: these are seconds that a user waits.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import EmptySceneError, OutOfRangeError, ShapeError, require_kind
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.places import atomic_path
from torchradiometry.plan.ladder import Rung, ladder
from torchradiometry.plan.memory import peak_memory, reset_peak_memory, resident_memory
from torchradiometry.plan.tradeoff_plot import draw_tradeoff
from torchradiometry.render.picture import View, develop, view_scene
from torchradiometry.render.settings import RenderSettings
from torchradiometry.scene.scene import Scene

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["Measured", "Tradeoff", "tradeoff"]

#: relative L1 difference below which a rung is the one before it
SAME = 2.0**-14


@dataclass(frozen=True)
class Measured:
    """One rung.

    Attributes:
        name, settings: of the rung.
        error: relative L1.
        seconds, spread: forward, median and interquartile range.
        gradient_seconds, gradient_spread: forward and backward.
        megabytes: peak of the process above what it held before the study; None where the
            system does not count it (see `memory`).
        patches: of the radiosity solution.
        chosen: not a rung of the ladder but somebody's choice.
    """

    name: str
    settings: RenderSettings
    error: float
    seconds: float
    spread: float
    gradient_seconds: float
    gradient_spread: float
    megabytes: float | None
    patches: int
    chosen: bool

    def to_dict(self) -> dict[str, object]:
        """Plain numbers and strings; of the settings only what differs from the defaults."""
        row = {f.name: getattr(self, f.name) for f in fields(self)}
        return row | {"settings": _changed(self.settings)}


@dataclass(frozen=True)
class Tradeoff:
    """The measured ladder.

    Attributes:
        rows: from the cheapest rung to the finest, then the choices.
        reference: what the errors are measured against.
        width, height: pixels.
        repeats: runs of each rung.
        skipped: rungs whose picture is that of the rung before them.
    """

    rows: tuple[Measured, ...]
    reference: str
    width: int
    height: int
    repeats: int
    skipped: tuple[str, ...]

    def to_dict(self) -> dict[str, object]:
        """Plain numbers, strings, lists and dicts, for JSON."""
        return asdict(self) | {"rows": [row.to_dict() for row in self.rows]}

    def save_json(self, path: str | Path) -> Path:
        """Write `to_dict()`."""
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(self.to_dict(), indent=1) + "\n")
        return Path(path)

    def save_csv(self, path: str | Path) -> Path:
        """Write one line a row; settings as `name=value`, separated by spaces."""
        rows = [row.to_dict() for row in self.rows]
        with atomic_path(path) as temporary, temporary.open("w", newline="") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            for row in rows:
                changed = dict(row["settings"])  # type: ignore[call-overload]
                text = " ".join(f"{key}={value}" for key, value in changed.items())
                table.writerow(row | {"settings": text})
        return Path(path)

    def save_plot(self, path: str | Path) -> Path:
        """Draw error over time, both logarithmic; the ending names the format (pdf, svg, png).

        Raises:
            MissingDependencyError: matplotlib is not installed.
        """
        return draw_tradeoff(path, [row.to_dict() for row in self.rows])


def tradeoff(
    scene: Scene,
    camera: AbstractCamera | None = None,
    reference: Float[Tensor, "height width channel"] | None = None,
    *,
    repeats: int = 3,
    rungs: Sequence[Rung] | None = None,
    choices: Sequence[Rung] = (),
    progress: Callable[[int, int, str], None] | None = None,
) -> Tradeoff:
    """Climb the ladder and measure every rung.

    A rung whose picture differs from the one before it by less than 2^-14 is skipped: the
    scene does not call for it.

    Args:
        scene: surfaces and sources.
        camera: who looks; by default the scene's first.
        reference: radiance, W/m2/sr, of every pixel; by default the last rung's picture, whose
            own error is then 0.
        repeats: runs of each rung, >= 1.
        rungs: by default `ladder(scene)`.
        choices: settings to be measured besides, such as a planner's.
        progress: called before the first rung and after each: how many are done, of how many,
            and its name.

    Raises:
        EmptySceneError: no triangle, no camera, or a picture without light.
        OutOfRangeError: fewer than one repeat, or no rungs.
        ShapeError: a reference of another size.
    """
    camera = _camera(scene, camera)
    rungs = ladder(scene) if rungs is None else rungs
    if repeats < 1 or not rungs:
        got = f"{repeats} repeats of {len(rungs)} rungs"
        raise OutOfRangeError("repeats, rungs", got, "pass at least one of each")
    if reference is not None and reference.shape[:2] != (camera.height, camera.width):
        got = f"shape {tuple(reference.shape)} for {camera.width} x {camera.height} pixels"
        raise ShapeError("reference", got, "pass height x width x channel")
    runs, skipped = _climb(scene, camera, rungs, choices, repeats, progress)
    mask = ~runs[len(runs) - len(choices) - 1].emitter
    truth = runs[len(runs) - len(choices) - 1].radiance if reference is None else reference
    return Tradeoff(
        tuple(_row(run, truth, mask) for run in runs),
        f"the rung {rungs[-1].name!r}" if reference is None else "a picture that was handed in",
        camera.width,
        camera.height,
        repeats,
        tuple(skipped),
    )


class _Run(NamedTuple):
    """What the repeats of one rung gave."""

    rung: Rung
    radiance: Float[Tensor, "height width channel"]
    emitter: Bool[Tensor, "height width"]
    seconds: list[float]
    gradient_seconds: list[float]
    peak: float | None
    patches: int
    chosen: bool


def _camera(scene: Scene, camera: AbstractCamera | None) -> AbstractCamera:
    require_kind("scene", scene, Scene)
    if camera is not None:
        require_kind("camera", camera, AbstractCamera, "camera, such as scene.cameras[0]")
        return camera
    if not scene.cameras:
        raise EmptySceneError("scene", "no camera", "pass one, or call with_default_view first")
    return scene.cameras[0]


def _climb(
    scene: Scene,
    camera: AbstractCamera,
    rungs: Sequence[Rung],
    choices: Sequence[Rung],
    repeats: int,
    progress: Callable[[int, int, str], None] | None,
) -> tuple[list[_Run], list[str]]:
    """Every rung that differs from the one before, the choices, and the names of the others."""
    develop(_view(scene, camera, rungs[0]), scene)  # what is loaded at first use counts nowhere
    before = resident_memory() or 0
    runs: list[_Run] = []
    skipped = []

    def tell(done: int, name: str) -> None:
        if progress is not None:
            progress(done, len(rungs) + len(choices), name)

    tell(0, "")
    for done, rung in enumerate(rungs, 1):
        first = _measure(scene, camera, rung, 1, before)
        last = rung is rungs[-1]
        if runs and not last and _relative(first.radiance, runs[-1].radiance) < SAME:
            skipped.append(rung.name)
        else:
            more = _measure(scene, camera, rung, repeats - 1, before) if repeats > 1 else None
            runs.append(first if more is None else _together(first, more))
        tell(done, rung.name)
    for done, choice in enumerate(choices, len(rungs) + 1):
        runs.append(_measure(scene, camera, choice, repeats, before)._replace(chosen=True))
        tell(done, choice.name)
    return runs, skipped


def _measure(scene: Scene, camera: AbstractCamera, rung: Rung, repeats: int, before: int) -> _Run:
    """Some runs of a rung; the picture is that of the last."""
    counted = reset_peak_memory()
    seconds, gradient_seconds = [], []
    for _ in range(repeats):
        view, made = _timed(lambda: _view(scene, camera, rung))
        with torch.no_grad():
            picture, shown = _timed(lambda view=view: develop(view, scene))  # type: ignore[misc]
        _, learned = _timed(lambda view=view: _gradient(view, scene))  # type: ignore[misc]
        seconds.append(made + shown)
        gradient_seconds.append(made + learned)
    peak = peak_memory() if counted else None
    above = None if peak is None else max(0, peak - before) / 2**20
    found = (picture.radiance.double(), picture.emitter, seconds, gradient_seconds)
    return _Run(rung, *found, above, picture.patches, False)


@torch.no_grad()
def _view(scene: Scene, camera: AbstractCamera, rung: Rung) -> View:
    return view_scene(scene, camera, rung.settings)


def _gradient(view: View, scene: Scene) -> tuple[Tensor, ...]:
    """Of the mean radiance, with respect to every albedo and emission."""
    surfaces = tuple(
        replace(
            surface,
            albedo=surface.albedo.detach().clone().requires_grad_(),
            emission=surface.emission.detach().clone().requires_grad_(),
        )
        for surface in scene.surfaces
    )
    mean = develop(view, replace(scene, surfaces=surfaces)).radiance.mean()
    leaves = [leaf for s in surfaces for leaf in (s.albedo, s.emission)]
    return torch.autograd.grad(mean, leaves, allow_unused=True)


def _timed(call: Callable[[], object]) -> tuple:
    """What a call returns, and its seconds."""
    _finish()
    began = time.perf_counter()
    found = call()
    _finish()
    return found, time.perf_counter() - began


def _finish() -> None:
    """Wait for what a CUDA device still computes."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()


def _together(first: _Run, more: _Run) -> _Run:
    peaks = [p for p in (first.peak, more.peak) if p is not None]
    return first._replace(
        seconds=first.seconds + more.seconds,
        gradient_seconds=first.gradient_seconds + more.gradient_seconds,
        peak=max(peaks) if peaks else None,
    )


def _relative(found: Tensor, truth: Tensor) -> float:
    """Relative L1 over all pixels; 0 for two black pictures."""
    difference, total = (found - truth).abs().sum(), truth.abs().sum()
    return float(difference / total) if bool(total > 0) else float(difference > 0)


def _row(run: _Run, truth: Tensor, mask: Tensor) -> Measured:
    wanted = truth.to(run.radiance).expand_as(run.radiance)[mask]
    if not bool(wanted.sum() > 0):
        mend = "add a lamp, or turn the camera to a lit surface"
        raise EmptySceneError("scene", "a picture without light", mend)
    return Measured(
        run.rung.name,
        run.rung.settings,
        _relative(run.radiance[mask], wanted),
        *_summary(run.seconds),
        *_summary(run.gradient_seconds),
        run.peak,
        run.patches,
        run.chosen,
    )


def _summary(values: list[float]) -> tuple[float, float]:
    """Median and interquartile range; 0 for a single value."""
    if len(values) == 1:
        return values[0], 0.0
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return middle, high - low


def _changed(settings: RenderSettings) -> dict[str, object]:
    """What differs from the defaults."""
    found = {
        f.name: getattr(settings, f.name)
        for f in dataclasses.fields(settings)
        if getattr(settings, f.name) != f.default
    }
    if settings.rays is not None:
        found["rays"] = settings.rays.__name__
    return found
