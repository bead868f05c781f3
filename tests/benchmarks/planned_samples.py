"""Which training images call for which effect: `python -m tests.benchmarks.planned_samples`.

Random shapes of every family under a distant lamp, alone or with a sky, are shaded with everything
on and as finely as the planner can, and by what `DepthPlanner` chooses image by image. Prints a
Markdown table: how many images keep cast shadows, the sky's occlusion and bounces, the error of
the planned pictures against the whole ones (mean and largest of an image), and the seconds of
planning, of the planned layer and of the whole one, forward and backward to the depth.
"""

from __future__ import annotations

import argparse
import time
from statistics import median

import torch
from torch import Tensor

from torchradiometry import AmbientDome, DepthPlanner, DirectionalSource
from torchradiometry.learn import random_shapes
from torchradiometry.numerics import guarded_divide
from torchradiometry.sources import AbstractSource

TOLERANCES = (0.1, 0.03)
RIGS = ("a lamp", "a lamp and the sky")
EFFECTS = ("cast_shadows", "ambient_occlusion", "bounces")
#: a tolerance that nothing reaches: the planner's finest settings
TINY = 1e-9


def rig(name: str) -> list[AbstractSource]:
    lamp = DirectionalSource([0.65, 0.5, 0.57], [2.0])
    return [lamp] if name == RIGS[0] else [lamp, AmbientDome([0.3])]


def seconds(layer: torch.nn.Module, depth: Tensor, albedo: Tensor, repeats: int) -> float:
    """Median of forward and backward."""
    found = []
    for _ in range(repeats):
        leaf = depth.clone().requires_grad_()
        began = time.perf_counter()
        layer(leaf, albedo).sum().backward()
        found.append(time.perf_counter() - began)
    return median(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=64)
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--albedo", type=float, default=0.6)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    shapes = random_shapes(options.count, options.size, torch.Generator().manual_seed(0))
    depth = torch.where(shapes.mask, -shapes.height, torch.nan).unsqueeze(1)
    albedo = torch.full((options.count, 1, options.size, options.size), options.albedo)
    print(
        "| light | tolerance | shadows | sky hidden | bounces | error, mean | error, largest "
        "| planning, s | planned, s | everything, s |"
    )
    print("|---" * 10 + "|")
    for name in RIGS:
        lights = rig(name)
        finest = DepthPlanner(TINY).plan(depth, albedo, lights, pixel_size=1.0)
        whole = finest.build(lights, pixel_size=1.0)
        with torch.no_grad():
            truth = whole(depth, albedo)
        dear = seconds(whole, depth, albedo, options.repeats)
        for tolerance in TOLERANCES:
            began = time.perf_counter()
            plan = DepthPlanner(tolerance).plan(depth, albedo, lights, pixel_size=1.0)
            planning = time.perf_counter() - began
            layer = plan.build(lights, pixel_size=1.0)
            with torch.no_grad():
                missed = (layer(depth, albedo) - truth).abs().sum((1, 2, 3))
            missed = guarded_divide(missed, truth.sum((1, 2, 3)))
            kept = [sum(bool(getattr(s, field)) for s in plan.settings) for field in EFFECTS]
            cells = (
                f"{missed.mean():.1%}",
                f"{missed.max():.1%}",
                f"{planning:.1f}",
                f"{seconds(layer, depth, albedo, options.repeats):.2f}",
                f"{dear:.1f}",
            )
            print(" | ".join(["", name, f"{tolerance:.0%}", *map(str, kept), *cells, ""]).strip())


if __name__ == "__main__":
    main()
