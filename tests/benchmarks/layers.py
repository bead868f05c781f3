"""What the local layers cost: `python -m tests.benchmarks.layers`.

Baselines in the same run: copying the bytes that a layer reads and writes, and the same formula
written out in plain PyTorch; layer and formula also through `torch.compile`. Median and spread
(interquartile range) of repeats, in ms; forward without gradients, and forward with backward to
every input. With --accuracy instead: the worst relative error of the highlight in float32, of the
layer and of the plain formula.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import time
from collections.abc import Callable
from statistics import quantiles

import torch
from torch import Tensor

from torchradiometry import DirectionalSource, LambertianShading, NormalizedPhong, PhongShading

SIZE = (8, 512, 512)
EXPONENTS = (10.0, 40.0, 1e3, 1e6)
#: share of its peak down to which a lobe is compared, and normals that are drawn
DIMMEST, NORMALS = 1e-3, 200_000


def measured(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median and interquartile range in ms, after two calls to warm up."""
    times = []
    for number in range(repeats + 2):
        began = time.perf_counter()
        call()
        if number >= 2:
            times.append(1e3 * (time.perf_counter() - began))
    low, median, high = quantiles(times, n=4)
    return median, high - low


def plain_lambertian(normal: Tensor, albedo: Tensor, light: Tensor, power: Tensor) -> Tensor:
    cosine = (normal * light.view(1, 3, 1, 1)).sum(1, keepdim=True).clamp(min=0)
    return albedo / math.pi * cosine * power.view(1, -1, 1, 1)


def plain_phong(
    normal: Tensor,
    albedo: Tensor,
    specular: Tensor,
    shininess: Tensor,
    light: Tensor,
    power: Tensor,
) -> Tensor:
    facing = (normal * light.view(1, 3, 1, 1)).sum(1, keepdim=True)
    mirror = 2 * facing * normal - light.view(1, 3, 1, 1)
    lobe = mirror[:, 2:].clamp(min=1e-4) ** shininess * (shininess + 2) / (2 * math.pi)
    brdf = albedo / math.pi + specular * lobe
    return brdf * facing.clamp(min=0) * power.view(1, -1, 1, 1)


def cases(
    batch: int, height: int, width: int
) -> dict[str, tuple[dict[str, Callable], list[Tensor]]]:
    """Name -> (the ways to compute it, the tensors they read)."""
    generator = torch.Generator().manual_seed(0)

    def image(channels: int, low: float, high: float) -> Tensor:
        made = torch.rand(batch, channels, height, width, generator=generator)
        return made * (high - low) + low

    normal = torch.nn.functional.normalize(
        image(3, -1, 1) + torch.tensor([0, 0, 2.0]).view(3, 1, 1), dim=1
    )
    albedo, specular, shininess = image(3, 0, 1), image(3, 0, 0.3), image(1, 5, 40)
    light = torch.nn.functional.normalize(torch.tensor([0.3, 0.4, 0.8]), dim=0)
    power = torch.tensor([3.0, 2.0, 1.0])
    sun = DirectionalSource(light, power)
    lambertian, phong = LambertianShading(sun), PhongShading(NormalizedPhong, sun)
    return {
        "Lambertian": (
            {
                "layer": lambda n, a: lambertian(n, a),
                "plain formula": lambda n, a: plain_lambertian(n, a, light, power),
            },
            [normal, albedo],
        ),
        "Phong": (
            {
                "layer": lambda n, a, s, e: phong(n, a, s, e),
                "plain formula": lambda n, a, s, e: plain_phong(n, a, s, e, light, power),
            },
            [normal, albedo, specular, shininess],
        ),
    }


def copy_of(read: list[Tensor]) -> Callable[[], object]:
    """Copying as many bytes as the layer reads and writes, into memory that is already there."""
    source = torch.cat([t.flatten() for t in (*read, read[1])])
    half = source.numel() // 2
    target = torch.empty(half)
    return lambda: target.copy_(source[:half])


def backward(call: Callable, read: list[Tensor]) -> Callable[[], object]:
    leaves = [t.clone().requires_grad_() for t in read]
    return lambda: torch.autograd.grad(call(*leaves).sum(), leaves)


def rows(
    size: tuple[int, int, int], repeats: int, *, compiled: bool = True
) -> list[dict[str, object]]:
    found = []
    for name, (eager, read) in cases(*size).items():
        ways = dict(eager)
        for way, call in eager.items() if compiled else ():
            ways[f"{way}, compiled"] = torch.compile(call, fullgraph=True)
        with torch.no_grad():
            timed = {("copy", "forward"): measured(copy_of(read), repeats)}
            for way, call in ways.items():
                timed[way, "forward"] = measured(lambda call=call, read=read: call(*read), repeats)
        for way, call in ways.items():
            timed[way, "forward + backward"] = measured(backward(call, read), repeats)
        for (way, kind), (median, spread) in timed.items():
            found.append(
                {"layer": name, "way": way, "kind": kind, "median_ms": median, "spread_ms": spread}
            )
    return found


def lobe_errors(shininess: float) -> dict[str, float]:
    """Way -> worst relative error in float32 against the layer in float64, near the mirror."""
    generator = torch.Generator().manual_seed(0)
    light = torch.nn.functional.normalize(torch.tensor([0.3, 0.4, 0.8]), dim=0)
    half = torch.nn.functional.normalize(light + torch.tensor([0, 0, 1.0]), dim=0)
    around = torch.randn(1, 3, 1, NORMALS, generator=generator) / math.sqrt(shininess)
    normal = torch.nn.functional.normalize(half.view(1, 3, 1, 1) + around, dim=1)
    one = torch.ones(1, 1, 1, NORMALS)
    read = (normal, 0 * one, one, shininess * one)

    def layer(dtype: torch.dtype) -> Tensor:
        sun = DirectionalSource(light.to(dtype), torch.ones(1, dtype=dtype))
        return PhongShading(NormalizedPhong, sun)(*(t.to(dtype) for t in read))

    exact = layer(torch.float64)
    ways = {
        "layer": layer(torch.float32),
        "plain formula": plain_phong(*read, light, torch.ones(1)),
    }
    lit = exact > DIMMEST * exact.max()
    return {
        way: float(((found.double() - exact).abs() / exact)[lit].max())
        for way, found in ways.items()
    }


def print_accuracy() -> None:
    """A Markdown table of `lobe_errors`."""
    print("| exponent n | layer | plain formula |\n|---|---|---|")
    for shininess in EXPONENTS:
        found = lobe_errors(shininess)
        print(f"| {shininess:g} | {found['layer']:.1e} | {found['plain formula']:.1e} |")


def main() -> None:
    """Print a Markdown table, or JSON with --json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=21)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--accuracy", action="store_true", help="errors and not times")
    options = parser.parse_args()
    if options.accuracy:
        print_accuracy()
        return
    table = rows(SIZE, options.repeats)
    if options.json:
        print(json.dumps(table))
        return
    print(f"{platform.machine()}, {torch.get_num_threads()} threads, torch {torch.__version__}")
    print("\n| layer | way | what | median, ms | spread, ms |\n|---|---|---|---|---|")
    for row in table:
        print(
            f"| {row['layer']} | {row['way']} | {row['kind']} | {row['median_ms']:.1f} "
            f"| {row['spread_ms']:.1f} |"
        )


if __name__ == "__main__":
    main()
