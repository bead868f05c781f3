"""Global shading on depth maps, its price and its error: `python -m tests.benchmarks.depth_maps`.

Price: median and spread (interquartile range) in ms, and peak memory above what was held before, of
each layer for a batch of 8 random reliefs in three channels, forward without gradients and forward
with backward; plain Lambertian shading of the same maps' normals is the baseline of the same run.
Repeats are interleaved, baseline and layer by turns, so that a busy machine slows both.

With --truth instead: relative L1 error against rays traced on the mesh of the same map
(`tests/shade/depth_truth.py`), for every relief and both cameras at 64 x 64.
"""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from statistics import median, quantiles

import torch
from torch import Tensor
from torch.nn import functional

from tests.shade.depth_truth import bounced, hard_shadow, sky_visibility, transport_matrix
from tests.shade.relief_bank import perspective_reliefs, reliefs
from torchradiometry import (
    AmbientDome,
    AmbientOcclusion,
    CastShadow,
    DepthSettings,
    DirectionalSource,
    InterreflectionShading,
    LambertianShading,
    PointSource,
    ShadeDepth,
    ambient_occlusion,
    cast_shadows,
    depth_to_normals,
    depth_to_points,
    reflected_irradiance,
)
from torchradiometry.plan.memory import peak_memory, reset_peak_memory, resident_memory

BATCH = 8
ALBEDO = 0.7
#: cells, azimuths and fine steps of the interreflection that is held to the truth
GRIDS = ((16, 8, 4), (32, 16, 2), (64, 16, 1), (64, 32, 1))


def relief(size: int) -> Tensor:
    """Smooth random reliefs, `BATCH 1 size size`, of 1 m, slopes to about 45 degrees."""
    coarse = torch.rand(BATCH, 1, 8, 8, generator=torch.Generator().manual_seed(0))
    height = functional.interpolate(coarse, size=(size, size), mode="bicubic")
    return 2 - 0.15 * height


def layers(size: int) -> dict[str, tuple[Callable[..., Tensor], tuple[Tensor, ...]]]:
    """Name -> (layer, what it is called with); the first is the baseline."""
    side, sun = 1 / size, DirectionalSource([0.5, 0.3, 0.8], [3.0, 2.0, 1.0])
    sky = AmbientDome([0.5, 0.6, 0.7])
    depth, generator = relief(size), torch.Generator().manual_seed(1)
    albedo, received = (torch.rand(BATCH, 3, size, size, generator=generator) for _ in range(2))
    normal = depth_to_normals(depth, pixel_size=side)
    every = DepthSettings(shadow_width=0.05, bounces=1)
    found: dict[str, tuple[Callable[..., Tensor], tuple[Tensor, ...]]] = {
        "LambertianShading": (LambertianShading(sun), (normal, albedo)),
        "depth_to_normals": (lambda d: depth_to_normals(d, pixel_size=side), (depth,)),
        "CastShadow, hard": (CastShadow(sun, pixel_size=side), (depth,)),
        "CastShadow, width 0.05": (CastShadow(sun, width=0.05, pixel_size=side), (depth,)),
        "AmbientOcclusion, 8 azimuths": (
            lambda d: AmbientOcclusion(8, pixel_size=side)(d)[0],
            (depth,),
        ),
        "InterreflectionShading, 16 x 16, 1 bounce": (
            InterreflectionShading(16, 1, pixel_size=side),
            (depth, albedo, received),
        ),
        "InterreflectionShading, 16 x 16, 4 bounces + tail": (
            InterreflectionShading(16, 4, tail=True, pixel_size=side),
            (depth, albedo, received),
        ),
        "InterreflectionShading, 32 x 32, 1 bounce": (
            InterreflectionShading(32, 1, pixel_size=side),
            (depth, albedo, received),
        ),
        "ShadeDepth, all of it": (ShadeDepth(every, [sun, sky], pixel_size=side), (depth, albedo)),
    }
    return found


def forward(layer: Callable[..., Tensor], maps: tuple[Tensor, ...]) -> None:
    with torch.no_grad():
        layer(*maps)


def backward(layer: Callable[..., Tensor], maps: tuple[Tensor, ...]) -> None:
    leaves = [t.clone().requires_grad_() for t in maps]
    out = layer(*leaves)
    if out.requires_grad:
        out.sum().backward()


def by_turns(first: Callable, second: Callable, repeats: int) -> tuple[list[float], list[float]]:
    """Times of two calls in ms, by turns, after one call of each to warm up."""
    times: tuple[list[float], list[float]] = ([], [])
    for number in range(repeats + 1):
        for call, found in zip((first, second), times, strict=True):
            began = time.perf_counter()
            call()
            if number:
                found.append(1e3 * (time.perf_counter() - began))
    return times


def peak(size: int, name: str) -> float:
    """MB that forward and backward of one layer hold above its inputs at most."""
    layer, maps = layers(size)[name]
    held = resident_memory()
    if not reset_peak_memory() or held is None:
        return float("nan")
    backward(layer, maps)
    return ((peak_memory() or held) - held) / 1e6


def peak_alone(size: int, name: str) -> float:
    """`peak` in a process of its own: an allocator keeps what earlier work gave back."""
    command = [sys.executable, "-m", __spec__.name, "--peak", name, "--sizes", str(size)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stdout)


def price(sizes: list[int], repeats: int) -> None:
    print("| size | layer | forward, ms | x Lambertian | with backward, ms | x Lambertian | MB |")
    print("|---|---|---|---|---|---|---|")
    for size in sizes:
        made = layers(size)
        base, base_maps = made["LambertianShading"]
        for name, (layer, maps) in made.items():
            cells = [f"| {size} | {name} "]
            for way in (forward, backward):
                calls = partial(way, base, base_maps), partial(way, layer, maps)
                plain, own = by_turns(*calls, repeats)
                low, middle, high = quantiles(own, n=4)
                cells.append(f"| {middle:.1f} ({high - low:.1f}) | {middle / median(plain):.1f} ")
            print("".join(cells) + f"| {peak_alone(size, name):.0f} |", flush=True)


def bank(size: int) -> Iterator[tuple[str, str, Tensor, dict]]:
    """Camera, relief, depth map and the camera's arguments."""
    for name, depth in reliefs(size).items():
        yield "parallel", name, depth, {"pixel_size": 1 / size}
    maps, matrix = perspective_reliefs(size)
    for name, depth in maps.items():
        yield "pinhole", name, depth, {"intrinsics": matrix}


def relative(found: Tensor, true: Tensor) -> float:
    return float((found - true).abs().sum() / true.abs().sum())


def lit_wrong(depth: Tensor, camera: dict) -> tuple[int, int]:
    """Pixels and lights whose hard shadow differs from the rays', of how many; borders left out."""
    generator = torch.Generator().manual_seed(1)
    heading = torch.randn(6, 3, dtype=depth.dtype, generator=generator)
    heading[:, 2] = 0.7 * heading[:, 2].abs() + 0.15
    heading = functional.normalize(heading, dim=1)
    lamp = torch.tensor([[0.3, 0.2, -1.5], [-0.6, 0.5, -1.7], [0.1, -0.2, -0.5], [0.05, 0.3, 0.5]])
    lamp = lamp.to(depth.dtype)
    normal, point = depth_to_normals(depth, **camera)[0], depth_to_points(depth, **camera)[0]
    sun = DirectionalSource(heading, torch.ones(len(heading), 1, dtype=depth.dtype))
    bulb = PointSource(lamp, torch.ones(len(lamp), 1, dtype=depth.dtype))
    found = cast_shadows(depth, [sun, bulb], **camera)[0] > 0.5
    towards = torch.cat(
        [heading[..., None, None].expand(-1, -1, *depth.shape[-2:]), lamp[..., None, None] - point]
    )
    found = found & ((towards * normal).sum(1) > 0)
    true = torch.cat(
        [
            hard_shadow(depth, light_direction=heading, **camera),
            hard_shadow(depth, light_position=lamp, **camera),
        ]
    )
    inside = (slice(None), slice(1, -1), slice(1, -1))
    return int((found != true)[inside].sum()), true[inside].numel()


def truth(size: int, rays: int) -> None:
    grids = " | ".join(f"E_r, {c} x {c}, {a} azimuths" for c, a, _ in GRIDS)
    print(f"| camera | relief | shadow pixels that differ | sky | bent normal | {grids} |")
    print("|---|---|---|---|---|" + "---|" * len(GRIDS))
    for name, shape, depth, camera in bank(size):
        wrong, total = lit_wrong(depth, camera)
        sky = sky_visibility(depth, rays=rays, **camera)
        share, bent = ambient_occlusion(depth, azimuths=16, **camera)
        cosine = (bent[0] * sky.bent_normal).sum(0).clamp(-1, 1)
        angle = torch.rad2deg(torch.acos(cosine)).mean()
        slope = 0.3 + 0.7 * (torch.arange(size, dtype=depth.dtype) / size)
        direct = slope[:, None, None].expand(size, size, 1)
        albedo = torch.full_like(direct, ALBEDO)
        true = bounced(transport_matrix(depth, rays=rays, **camera), albedo, direct, None)
        errors = []
        for cells, azimuths, fine in GRIDS:
            found = reflected_irradiance(
                depth,
                albedo.permute(2, 0, 1)[None],
                direct.permute(2, 0, 1)[None],
                cells=(cells, cells),
                azimuths=azimuths,
                fine=fine,
                bounces=12,
                **camera,
            )
            errors.append(f"{relative(found[0].permute(1, 2, 0), true):.2%}")
        open_sky = relative(share[0, 0], sky.visibility)
        row = [name, shape, f"{wrong} of {total}", f"{open_sky:.2%}", f"{float(angle):.2f} deg"]
        print(f"| {' | '.join([*row, *errors])} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128, 256])
    parser.add_argument("--repeats", type=int, default=11)
    parser.add_argument("--truth", action="store_true")
    parser.add_argument("--rays", type=int, default=4096)
    parser.add_argument("--peak", metavar="LAYER", help="only its peak memory, MB")
    given = parser.parse_args()
    if given.peak:
        print(peak(given.sizes[0], given.peak))
        return
    if given.truth:
        truth(64, given.rays)
        return
    print(f"torch {torch.__version__}, {torch.get_num_threads()} threads, {platform.machine()}\n")
    price(given.sizes, given.repeats)


if __name__ == "__main__":
    main()
