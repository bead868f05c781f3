"""A picture and its gradient against Mitsuba 3: `python -m tests.benchmarks.path_tracer`.

The Cornell-like room, 128 x 128. Truth is Mitsuba's own path tracer (`path`, and `prb` for
gradients) with many samples; it is kept in a file, so that a run can be continued, and its own
noise is found from its two halves. It is contained in every error below.

    error = sum |L - L*| / sum L*      over pixels none of whose rays meet the panel, and
                                        over all pixels that see anything but the panel

The processor's seconds are of all threads: they hardly change when the machine is shared.

Mitsuba's error falls as c / sqrt(t). c is measured in the same run, at several sample counts,
and gives the time t = (c / e)^2 that Mitsuba needs for our error e. Kernels are compiled and
scenes loaded before its clock starts; ours runs over the whole of `render_scene`.

Needs Mitsuba: `pip install mitsuba`, and libLLVM (Debian's package libllvm19).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from tests.benchmarks.mitsuba_scenes import (
    coverage,
    drjit,
    mitsuba,
    mitsuba_scene,
    relative_error,
    sensor,
    start,
)
from torchradiometry import RenderSettings, Scene, cornell_like_room
from torchradiometry.render.picture import View, develop, view_scene

SIDE = 128
#: Mitsuba's default, and one that spreads its samples more evenly
SAMPLERS = ("independent", "multijitter")
#: samples of one render of the reference, and of the times
CHUNK, SAMPLES, GRADIENT_SAMPLES = 256, (16, 64), (4, 16)
#: ours: name -> settings
OURS = {
    "patches up to 1.6 m": RenderSettings(patch_size=1.6),
    "patches up to 1 m": RenderSettings(patch_size=1.0),
    "patches up to 0.6 m": RenderSettings(patch_size=0.6),
}


@dataclass(frozen=True)
class Rivals:
    """Our scene, and the same in Mitsuba.

    Attributes:
        scene: ours.
        theirs: the loaded scene.
        sensors: by their sampler.
        keys: Mitsuba's names of all albedos and of the panel's radiance, in our order.
        dark: pixels none of whose rays meet the panel.
        partly: pixels that see something else than the panel.
        target: what the gradient's loss compares the picture with.
    """

    scene: Scene
    theirs: Any
    sensors: dict[str, Any]
    keys: tuple[str, ...]
    dark: np.ndarray
    partly: np.ndarray
    target: np.ndarray


def target_picture(scene: Scene, file: Path) -> np.ndarray:
    """Mitsuba's picture of the same room painted differently; kept in `file`."""
    if not file.exists():
        paint = torch.linspace(0.7, 1.3, len(scene.surfaces)).tolist()
        surfaces = tuple(
            replace(s, albedo=(s.albedo * p).clamp(max=0.95))
            for s, p in zip(scene.surfaces, paint, strict=True)
        )
        painted = mitsuba_scene(replace(scene, surfaces=surfaces))
        film = sensor(scene.cameras[0], SAMPLERS[0], CHUNK)
        integrator = mitsuba.load_dict({"type": "path"})
        found = mitsuba.render(painted, sensor=film, integrator=integrator, spp=CHUNK, seed=1)
        np.save(file, np.array(found))
    return np.load(file)


def rivals(folder: Path) -> Rivals:
    """Both scenes, the masks, and the target."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = cornell_like_room(width=SIDE, height=SIDE)
    theirs = mitsuba_scene(scene)
    found = mitsuba.traverse(theirs)
    keys = [f"s{k}.bsdf.reflectance.value" for k in range(len(scene.surfaces))]
    keys += [k for k in found.keys() if k.endswith("radiance.value")]  # noqa: SIM118
    target = target_picture(scene, folder / "path_tracer_target.npy")
    sensors = {name: sensor(scene.cameras[0], name, CHUNK) for name in SAMPLERS}
    return Rivals(scene, theirs, sensors, tuple(keys), *coverage(scene), target)


# --- Mitsuba --------------------------------------------------------------------------------


def path_traced(both: Rivals, sampler: str, samples: int, seed: int) -> np.ndarray:
    """Mitsuba's picture."""
    film, integrator = both.sensors[sampler], mitsuba.load_dict({"type": "path"})
    found = mitsuba.render(both.theirs, sensor=film, integrator=integrator, spp=samples, seed=seed)
    return np.array(found)


def path_gradient(both: Rivals, sampler: str, samples: int, seed: int) -> np.ndarray:
    """Mitsuba's gradient of the loss: picture and gradient with `samples` each."""
    parameters = mitsuba.traverse(both.theirs)
    for key in both.keys:
        drjit.enable_grad(parameters[key])
    parameters.update()
    integrator = mitsuba.load_dict({"type": "prb", "max_depth": -1})
    film = both.sensors[sampler]
    picture = mitsuba.render(
        both.theirs, parameters, sensor=film, integrator=integrator, spp=samples, seed=seed
    )
    mask = both.dark[..., None].astype(np.float32)
    difference = (picture - mitsuba.TensorXf(both.target)) * mitsuba.TensorXf(mask)
    loss = drjit.sum((difference * difference).array) / (3 * float(mask.sum()))
    drjit.backward(loss)
    found = [np.array(drjit.grad(parameters[key])).reshape(-1) for key in both.keys]
    for key in both.keys:
        drjit.disable_grad(parameters[key])
    return np.concatenate(found)


def reference(
    call: Callable[[Rivals, str, int, int], np.ndarray], both: Rivals, samples: int, file: Path
) -> tuple[np.ndarray, np.ndarray, int]:
    """Means of the even and of the odd chunks, and samples in all; goes on from `file`."""
    kept = np.load(file) if file.exists() else {"sums": None, "chunks": 0}
    sums, chunks = kept["sums"], int(kept["chunks"])
    while chunks * CHUNK < samples or chunks % 2:
        found = call(both, SAMPLERS[-1], CHUNK, 1_000_000 + 2 * chunks).astype(np.float64)
        sums = np.zeros((2, *found.shape)) if sums is None else sums
        sums[chunks % 2] += found
        chunks += 1
        if chunks % 2 == 0 or chunks * CHUNK >= samples:
            np.savez(file, sums=sums, chunks=chunks)
    return sums[0] / (chunks // 2), sums[1] / (chunks // 2), chunks * CHUNK


# --- ours -----------------------------------------------------------------------------------


def our_picture(both: Rivals, settings: RenderSettings, view: View | None) -> np.ndarray:
    """Our picture, of a view that was made before or from the scene alone."""
    with torch.no_grad():
        view = view or view_scene(both.scene, both.scene.cameras[0], settings)
        return develop(view, both.scene).radiance.numpy()


def our_gradient(both: Rivals, settings: RenderSettings, view: View | None) -> np.ndarray:
    """Our gradient of the loss, of all albedos and the panel's emission."""
    albedo = [s.albedo.expand(3).clone().requires_grad_() for s in both.scene.surfaces]
    shining = next(k for k, s in enumerate(both.scene.surfaces) if s.emission.max() > 0)
    emission = both.scene.surfaces[shining].emission.expand(3).clone().requires_grad_()
    surfaces = [replace(s, albedo=a) for s, a in zip(both.scene.surfaces, albedo, strict=True)]
    surfaces[shining] = replace(surfaces[shining], emission=emission)
    painted = replace(both.scene, surfaces=tuple(surfaces))
    view = view or view_scene(both.scene, both.scene.cameras[0], settings)
    picture = develop(view, painted).radiance
    mask = torch.from_numpy(both.dark)
    loss = (picture - torch.from_numpy(both.target))[mask].square().mean()
    return torch.cat(torch.autograd.grad(loss, [*albedo, emission])).numpy()


# --- the race -------------------------------------------------------------------------------


class Run(NamedTuple):
    """What a call returned, and its wall and processor seconds."""

    found: np.ndarray
    wall: float
    processor: float


def timed(call: Callable[[], np.ndarray]) -> Run:
    """One call."""
    wall, processor = time.perf_counter(), time.process_time()
    found = call()
    return Run(found, time.perf_counter() - wall, time.process_time() - processor)


class Line(NamedTuple):
    """One line of a table: medians of the times, root mean square errors."""

    name: str
    seconds: np.ndarray
    errors: np.ndarray


def measured(
    name: str,
    calls: list[Callable[[], np.ndarray]],
    error: Callable[[np.ndarray], list[float]],
) -> Line:
    """The first call warms up and is not counted."""
    runs = [timed(call) for call in calls][1:]
    seconds = np.array([[r.wall, r.processor] for r in runs])
    errors = np.array([error(r.found) for r in runs])
    return Line(name, np.median(seconds, 0), np.sqrt((errors**2).mean(0)))


def shown(line: Line, law: np.ndarray | None) -> str:
    """A row: times, errors, and how much longer Mitsuba needs for the first error."""
    cells = [line.name, *(f"{t:.3f}" for t in line.seconds)]
    cells += [f"{100 * e:.2f} %" for e in line.errors]
    if law is not None:
        needs = (law / line.errors[0]) ** 2
        cells += [
            f"{needs[0]:.1f}",
            *(f"{n / s:.0f}" for n, s in zip(needs, line.seconds, strict=True)),
        ]
    return "| " + " | ".join(cells) + " |"


def race(
    title: str,
    theirs: Callable[[Rivals, str, int, int], np.ndarray],
    ours: Callable[[Rivals, RenderSettings, View | None], np.ndarray],
    both: Rivals,
    error: Callable[[np.ndarray], list[float]],
    counts: tuple[int, ...],
    repeats: int,
) -> None:
    """Print the tables of Mitsuba and of ours; Mitsuba's default sampler sets its law."""
    law = None
    print(f"\n### {title}\n\n| Mitsuba | wall, s | processor, s | errors |\n|---|---|---|---|")
    for sampler in SAMPLERS:
        found = []
        for n in counts:
            calls = [
                lambda k=k, n=n, sampler=sampler: theirs(both, sampler, n, 7 + 2 * k)
                for k in range(repeats + 1)
            ]
            found.append(measured(f"{sampler}, {n} samples", calls, error))
            print(shown(found[-1], None), flush=True)
        roots = [line.errors[0] * np.sqrt(line.seconds) for line in found]
        law = np.median(roots, 0) if law is None else law
        products = " | ".join(f"{r:.4f}" for r in np.median(roots, 0))
        print(f"| {sampler}: error x sqrt(seconds) | {products} | |")
    print("\n| ours | wall, s | processor, s | errors | Mitsuba, wall s | x wall | x processor |")
    print("|---|---|---|---|---|---|---|")
    for name, settings in OURS.items():
        with torch.no_grad():
            view = view_scene(both.scene, both.scene.cameras[0], settings)
        for kind, made in (("", None), (", view made before", view)):
            calls = [lambda s=settings, v=made: ours(both, s, v)] * (repeats + 1)
            print(shown(measured(name + kind, calls, error), law), flush=True)


def main() -> None:
    """Print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--samples", type=int, default=16384, help="of the reference picture")
    parser.add_argument("--gradient-samples", type=int, default=2560)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--reference-only", action="store_true")
    options = parser.parse_args()
    start(options.threads)
    both = rivals(options.cache)
    truths = {}
    for name, call, samples in (
        ("picture", path_traced, options.samples),
        ("gradient", path_gradient, options.gradient_samples),
    ):
        file = options.cache / f"path_tracer_{name}.npz"
        first, second, spent = reference(call, both, samples, file)
        truths[name] = (first + second) / 2
        # the halves differ by sqrt(2) times their own noise, twice that of their mean
        mask = both.dark if name == "picture" else slice(None)
        noise = np.abs(first - second)[mask].sum() / np.abs(first + second)[mask].sum()
        print(
            f"reference {name}: {spent} samples a pixel, own noise {100 * noise:.3f} %", flush=True
        )
    if options.reference_only:
        return
    picture, gradient = truths["picture"], truths["gradient"]
    norm = np.abs(gradient).sum()
    race(
        "Picture",
        path_traced,
        our_picture,
        both,
        lambda found: [relative_error(found, picture, m) for m in (both.dark, both.partly)],
        SAMPLES,
        options.repeats,
    )
    race(
        "Gradient",
        path_gradient,
        our_gradient,
        both,
        lambda found: [float(np.abs(found - gradient).sum() / norm)],
        GRADIENT_SAMPLES,
        options.repeats,
    )


if __name__ == "__main__":
    main()
