"""Is a plan as quick as what one picks by hand? `python -m tests.benchmarks.thrift --cache DIR`.

For every scene that has a reference picture (`tests.benchmarks.references`, the same DIR) a grid
of settings is rendered: shadows (none, one ray to the middle of a source, rays or clipped), rays a
pixel, no reflected light, ambient light, or bounces on patches of several sizes. The
cheapest whose measured error, less the reference's own noise, is within a tolerance is the one to
beat (rendered as a whole: patches are lit as the picture is); the plan for that tolerance is
then timed beside it.

Direct light, patches and bounces are made once each and put together, so that a grid of some
hundred settings takes about a minute. Patches are made finer until they alone take longer
than a picture that already meets the tightest tolerance. What is found is kept in
DIR/thrift-NAME.json: a broken run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from tests.benchmarks.references import SCENES, SIZE, Reference, load
from torchradiometry import Planner, RenderSettings, render_scene
from torchradiometry.places import atomic_path
from torchradiometry.plan import Costs
from torchradiometry.render import Picture, View, develop, prepare, view_scene
from torchradiometry.render.ambient import ambient_exchange
from torchradiometry.render.indirect import first_patches
from torchradiometry.scene.scene import Scene

TOLERANCES = (0.1, 0.03, 0.01)
BOUNCES, SIDES, RAYS = (1, 2, 4, 8, 16, 32), (1, 2, 3, 4), (2, 8)
#: patch edges as parts of the half diagonal, and how many patches are made at most
PARTS, MOST = tuple(1.5 * 2 ** (k / 2) for k in range(9)), 4000


class Tried(NamedTuple):
    """One setting of the grid."""

    settings: RenderSettings
    error: float
    seconds: float


def shadows(scene: Scene) -> list[RenderSettings]:
    """Ways to treat direct light that differ in this scene."""
    world = prepare(scene, RenderSettings())
    plain = RenderSettings(bounces=0, supersampling=1, penumbra=False)
    found = [replace(plain, shadow_samples=0), plain]
    if len(world.emitters.corners):
        found.append(replace(plain, extent=False))
        samples = (1,) if world.blockers is not None else RAYS
        found += [replace(plain, penumbra=True, shadow_samples=n) for n in samples]
    return found


def error_of(picture: Picture, reference: Reference) -> float:
    """Relative L1 error over the pixels that count, less the reference's own noise."""
    off = np.abs(picture.radiance.numpy() - reference.radiance)[reference.mask].sum()
    return max(0.0, float(off / reference.radiance[reference.mask].sum()) - reference.noise)


def indirect_views(scene: Scene, best: list[float]) -> Iterator[View]:
    """Views with reflected light, from the coarsest, while they can be cheaper than `best`."""
    camera = scene.cameras[0]
    plain = RenderSettings(bounces=0, supersampling=1, shadow_samples=0)
    world = prepare(scene, plain)
    yield view_scene(scene, camera, plain)
    began = time.perf_counter()
    sample = ambient_exchange(world, plain)
    seconds = {"indirect": time.perf_counter() - began}
    ambient = view_scene(scene, camera, plain)
    yield ambient._replace(ambient=sample, settings=replace(plain, ambient=True), seconds=seconds)
    for part in PARTS:
        settings = replace(plain, bounces=1, patch_size=world.rays.scale / part)
        if len(first_patches(world, settings).corners) > MOST:
            return
        view = view_scene(scene, camera, replace(settings, shadow_samples=1))
        yield view
        if view.seconds["indirect"] > best[0]:
            return


def grid(scene: Scene, reference: Reference) -> Iterator[Tried]:
    """All settings."""
    camera, best = scene.cameras[0], [float("inf")]
    direct = []
    for each in shadows(scene):
        for side in SIDES:
            direct.append(view_scene(scene, camera, replace(each, supersampling=side)))
    for rest in indirect_views(scene, best):
        counts = BOUNCES if rest.exchange is not None else (0,)
        for view in direct:
            for count in counts:
                settings = replace(
                    view.settings,
                    bounces=count,
                    patch_size=rest.settings.patch_size,
                    ambient=rest.settings.ambient,
                )
                made = view._replace(
                    settings=settings, exchange=rest.exchange, ambient=rest.ambient
                )
                picture = develop(made, scene)
                seconds = sum(view.seconds[k] for k in ("prepare", "direct"))
                seconds += picture.seconds["shade"] + rest.seconds["indirect"] * (
                    count > 0 or settings.ambient
                )
                found = Tried(settings, error_of(picture, reference), seconds)
                if found.error <= min(TOLERANCES):
                    best[0] = min(best[0], found.seconds)
                yield found


def tried(folder: Path, name: str) -> list[Tried]:
    """The grid of a scene, from its file if there is one."""
    file = folder / f"thrift-{name}.json"
    if not file.exists():
        scene = SCENES[name](*SIZE)
        with torch.no_grad():
            found = list(grid(scene, load(folder, name)))
        rows = [(asdict(replace(t.settings, rays=None)), t.error, t.seconds) for t in found]
        with atomic_path(file) as temporary:
            temporary.write_text(json.dumps(rows))
    return [Tried(RenderSettings(**s), e, t) for s, e, t in json.loads(file.read_text())]


def by_hand(
    found: list[Tried], tolerance: float, scene: Scene, reference: Reference
) -> RenderSettings | None:
    """The cheapest settings whose picture meets the tolerance."""
    for each in sorted(found, key=lambda t: t.seconds):
        if each.error <= tolerance:
            with torch.no_grad():
                picture = render_scene(scene, scene.cameras[0], each.settings)
            if error_of(picture, reference) <= tolerance:
                return each.settings
    return None


def timed(scene: Scene, settings: list[RenderSettings], repeats: int) -> list[float]:
    """Median seconds of whole pictures, in turns."""
    seconds: list[list[float]] = [[] for _ in settings]
    with torch.no_grad():
        for _ in range(repeats):
            for each, kept in zip(settings, seconds, strict=True):
                began = time.perf_counter()
                render_scene(scene, scene.cameras[0], each)
                kept.append(time.perf_counter() - began)
    return [statistics.median(kept) for kept in seconds]


def described(settings: RenderSettings) -> str:
    """In a few words."""
    words = [f"{settings.supersampling} x {settings.supersampling}"]
    if settings.shadow_samples == 0:
        words.append("no shadows")
    elif not settings.penumbra:
        words.append("hard shadows" if settings.extent else "hard shadows, small sources")
    elif settings.shadow_samples > 1:
        words.append(f"{settings.shadow_samples} shadow rays")
    if settings.ambient:
        words.append("ambient")
    if settings.bounces:
        words.append(f"{settings.bounces} bounces, {settings.patch_size or 0:.2g} m")
    return ", ".join(words)


def main() -> None:
    """Print a Markdown table and medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenes; all by default")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--prices", type=Path, default=None, help="a file of stored prices")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    costs = Costs.load(options.prices) if options.prices else Costs()
    print("| scene | tolerance | plan, s | by hand, s | ratio | plan | by hand |\n|" + "---|" * 7)
    ratios = []
    for name in options.names or SCENES:
        if not (options.cache / f"{name}.npz").exists():
            continue
        scene, found = SCENES[name](*SIZE), tried(options.cache, name)
        for tolerance in TOLERANCES:
            plan = Planner(tolerance, costs=costs).plan(scene, scene.cameras[0]).settings
            hand = by_hand(found, tolerance, scene, load(options.cache, name))
            if hand is None:
                print(f"| {name} | {tolerance:.0%} | | none meets it | | {described(plan)} | |")
                continue
            ours, theirs = timed(scene, [plan, hand], options.repeats)
            ratios.append(ours / theirs)
            cells = [name, f"{tolerance:.0%}", f"{ours:.3f}", f"{theirs:.3f}", f"{ratios[-1]:.2f}"]
            print("| " + " | ".join([*cells, described(plan), described(hand)]) + " |", flush=True)
    within, middle = sum(ratio <= 1.3 for ratio in ratios), statistics.median(ratios)
    print(f"\nratio: median {middle:.2f}; at most 1.3 in {within} of {len(ratios)}")


if __name__ == "__main__":
    main()
