"""Patches of one size, of different sizes, gathered light: `python -m tests.benchmarks.patches`.

Relative L1 error of pictures (64 x 48, one ray a pixel) against patches of a quarter of a metre,
which are interpolated, in the same run: the Cornell-like room, a crate on a floor of 6 m under
the sun, three rooms of which two are seen, and a white niche in a black wall (against an eighth of
a metre). Direct light is the same in all of them. Seconds are the processor's.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import torch

from tests.benchmarks.blind_scenes import alcove, three_rooms
from torchradiometry import (
    DirectionalSource,
    Picture,
    RenderSettings,
    Scene,
    box,
    cornell_like_room,
    quad,
    render_scene,
    with_default_view,
)

FINE = RenderSettings(patch_size=0.25, supersampling=1, bounces=12, budget=2**33)
SIZES = (2.0, 1.6, 1.0, 0.6)
ERRORS = (0.04, 0.02, 0.01)
UPRIGHT = ("left", "right", "top", "back", "front")


def crate_on_a_floor() -> Scene:
    floor = quad("floor", [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]], albedo=0.6)
    crate = box("crate", (1, 1, 1), (0, 0.5, 0), turn=0.3, sides=UPRIGHT, albedo=0.7)
    sun = DirectionalSource([[0.5, 1.0, 0.4]], [[3.0]])
    return with_default_view(Scene((floor, crate), (sun,)), width=64, height=48)


def error(picture: Picture, reference: Picture) -> float:
    lit = ~reference.emitter
    off = (picture.radiance - reference.radiance)[lit].abs().sum()
    return float(off / reference.radiance[lit].sum())


@torch.no_grad()
def print_rows(name: str, scene: Scene, gather: float, fine: float = 0.25) -> None:
    """Some lines of the table; patch sizes of the gathered picture and of the reference, m."""
    camera = scene.cameras[0]
    reference = render_scene(scene, camera, replace(FINE, patch_size=fine))
    ways = {f"{size:g} m": replace(FINE, patch_size=size) for size in SIZES}
    ways |= {
        f"{size:g} m, by importance": replace(FINE, patch_size=size, importance=True)
        for size in SIZES
    }
    ways |= {
        f"2 m, split to {100 * goal:g} %": replace(FINE, patch_size=2.0, patch_error=goal)
        for goal in ERRORS
    }
    ways[f"{gather:g} m, gathered"] = replace(FINE, patch_size=gather, gather=True)
    for way, settings in ways.items():
        began = time.process_time()
        picture = render_scene(scene, camera, settings)
        seconds = time.process_time() - began
        off = 100 * error(picture, reference)
        print(f"| {name} | {way} | {picture.patches} | {off:.2f} % | {seconds:.1f} |", flush=True)


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    print("| scene | patches up to | patches | error | s |\n|---|---|---|---|---|")
    print_rows("crate", crate_on_a_floor(), 2.0)
    print_rows("room", cornell_like_room(width=64, height=48), 1.6)
    print_rows("three rooms", three_rooms(64, 48), 1.6)
    print_rows("niche", alcove(64, 48), 1.0, 0.125)


if __name__ == "__main__":
    main()
