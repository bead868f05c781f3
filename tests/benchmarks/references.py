"""Pictures by a path tracer, to measure ours against: `python -m tests.benchmarks.references`.

Mitsuba renders the standard scenes, further ones (`further_scenes`), shiny ones (`shiny_scenes`)
and those of two blind tests (`blind_scenes`, `fresh_scenes`), 96 x 72 pixels. It lifts rays by
0.1 mm and looks no nearer than 1 cm, so scenes much smaller or larger than 1 m are scaled to 1 m
for it, which changes no radiance. Each picture is a sum of many renders, kept in two halves; its
own noise is what the halves differ by, and a run can be broken off and continued:

    noise = sum |A - B| / sum (A + B)      of the mean of both halves, over the pixels that count

`NAME.npz` holds `sums` (the halves), `chunks` and `samples` (of a chunk); `NAME.npy` the mask of
the pixels that count: none of 16 x 16 rays meets an emitter.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.benchmarks.blind_scenes import BLIND_SCENES
from tests.benchmarks.fresh_scenes import FRESH_SCENES
from tests.benchmarks.further_scenes import FURTHER_SCENES
from tests.benchmarks.mitsuba_scenes import coverage, mitsuba, mitsuba_scene, sensor, start
from tests.benchmarks.shiny_scenes import SHINY_SCENES
from torchradiometry.places import atomic_path
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.standard import STANDARD_SCENES

__all__ = ["SCENES", "SIZE", "Reference", "load"]

SIZE = (96, 72)
#: samples of a pixel in one render: a square number, as the sampler wants
CHUNK = 256
SCENES: dict[str, Callable[[int, int], Scene]] = (
    STANDARD_SCENES | FURTHER_SCENES | BLIND_SCENES | FRESH_SCENES | SHINY_SCENES
)
#: sizes of scenes that the path tracer takes as they are, m
ORDINARY = (0.1, 100.0)


class Reference(NamedTuple):
    """What is known of a scene's picture.

    Attributes:
        radiance: `height width 3`, W/m2/sr.
        mask: pixels that count.
        noise: own relative L1 error.
        samples: of a pixel.
    """

    radiance: np.ndarray
    mask: np.ndarray
    noise: float
    samples: int


def load(folder: Path, name: str) -> Reference:
    """The picture of a scene as far as it has come."""
    kept = np.load(folder / f"{name}.npz")
    mask = np.load(folder / f"{name}.npy")
    (first, second), chunks = kept["sums"], int(kept["chunks"])
    noise = float(np.abs(first - second)[mask].sum() / (first + second)[mask].sum())
    return Reference((first + second) / chunks, mask, noise, chunks * int(kept["samples"]))


def ordinary(scene: Scene) -> Scene:
    """The same picture from a scene of about 1 m, where it is much smaller or larger."""
    points = scene.triangles.corners.reshape(-1, 3)
    size = float((points.amax(0) - points.amin(0)).norm()) / 2
    if ORDINARY[0] <= size <= ORDINARY[1]:
        return scene
    if any(source.needs_position for source in scene.sources):
        raise ValueError("lamps that are near are not scaled")
    surfaces = tuple(replace(s, vertices=s.vertices / size) for s in scene.surfaces)
    place = scene.cameras[0].camera_to_world.clone()
    place[:3, 3] /= size
    return replace(
        scene, surfaces=surfaces, cameras=(replace(scene.cameras[0], camera_to_world=place),)
    )


def improve(folder: Path, name: str, noise: float, seconds: float) -> Reference:
    """Go on with a scene until its noise or the time of this call is reached."""
    scene = SCENES[name](*SIZE)
    if not (folder / f"{name}.npy").exists():
        with atomic_path(folder / f"{name}.npy") as file:
            np.save(file, coverage(scene)[0])
    file = folder / f"{name}.npz"
    same = ordinary(scene)
    theirs, film = mitsuba_scene(same), sensor(same.cameras[0], "multijitter", CHUNK)
    integrator = mitsuba.load_dict({"type": "path", "max_depth": -1, "rr_depth": 16})
    began = time.process_time()
    while not file.exists() or load(folder, name).noise > noise:
        if time.process_time() - began > seconds:
            break
        kept = dict(np.load(file)) if file.exists() else {"sums": 0, "chunks": 0}
        pair = [
            np.array(mitsuba.render(theirs, sensor=film, integrator=integrator, spp=CHUNK, seed=s))
            for s in (int(kept["chunks"]), int(kept["chunks"]) + 1)
        ]
        sums = kept["sums"] + np.stack(pair).astype(np.float64)
        with atomic_path(file) as temporary:
            np.savez(temporary, sums=sums, chunks=kept["chunks"] + 2, samples=CHUNK)
    return load(folder, name)


def main() -> None:
    """Print a Markdown table of the references."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenes; all of them by default")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--noise", type=float, default=0.004)
    parser.add_argument("--seconds", type=float, default=600, help="of the processor, a scene")
    options = parser.parse_args()
    start(options.threads)
    options.cache.mkdir(parents=True, exist_ok=True)
    print("| scene | samples a pixel | own noise | processor, s |\n|---|---|---|---|")
    for name in options.names or SCENES:
        began = time.process_time()
        found = improve(options.cache, name, options.noise, options.seconds)
        spent = time.process_time() - began
        print(f"| {name} | {found.samples} | {100 * found.noise:.2f} % | {spent:.0f} |", flush=True)


if __name__ == "__main__":
    main()
