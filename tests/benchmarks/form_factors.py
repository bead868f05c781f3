"""What form factors cost and how exact they are: `python -m tests.benchmarks.form_factors`.

Two tables. Pairs: the worst relative error of `polygon_exchange` against its own tightest setting
(1e-13; the tests hold that against independent quadrature), and microseconds a pair. Rooms: the
whole matrix of a unit cube's faces against two baselines in the same run: midpoints alone, and the
rule that averages the exact point-to-polygon factor over a few points of the receiver. Median and
spread (interquartile range) of repeats; processor time, since other work may share the machine.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from statistics import quantiles

import torch
from torch import Tensor

from torchradiometry import Patches, polygon_exchange, subdivide, unoccluded_exchange
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.transport.rules import patch_points

RTOLS = (1e-2, 1e-3, 1e-6, 1e-10)
PAIRS = 2000


def timed(call: Callable[[], Tensor], repeats: int) -> tuple[Tensor, float, float]:
    """The result, median and interquartile range in s."""
    times = []
    for _ in range(repeats + 1):
        began = time.process_time()
        result = call()
        times.append(time.process_time() - began)
    low, median, high = quantiles(times[1:], n=4) if repeats > 1 else (0.0, times[1], 0.0)
    return result, median, high - low


def cube(parts: int) -> Patches:
    """The inside of a unit cube, `parts` x `parts` squares on each face."""
    square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)
    faces = []
    for axis in range(3):
        face = square.roll(axis, -1)
        normal = torch.eye(3, dtype=torch.float64)[(axis + 2) % 3]
        faces += [face, face.flip(0) + normal]
    return subdivide(Patches(torch.stack(faces)), 1 / parts + 1e-6)[0]


def midpoints(patches: Patches) -> Tensor:
    """Exchange areas from centre to centre."""
    offset = patches.centroid - patches.centroid.unsqueeze(1)
    square = offset.square().sum(-1).fill_diagonal_(1)
    leaving = torch.einsum("ijx,ix->ij", offset, patches.normal).clamp(min=0)
    kernel = leaving * leaving.mT / square**2 / math.pi
    return kernel * patches.area * patches.area.unsqueeze(1)


def averaged(patches: Patches) -> Tensor:
    """Exact point-to-polygon factors averaged over 4 points of the receiver, made symmetric."""
    points = patch_points(patches.corners, 2)
    rows = []
    for i in range(patches.count):
        position = points.position[i].unsqueeze(1)
        factor = polygon_irradiance(position, patches.normal[i], patches.corners) / math.pi
        rows.append(points.weight[i] @ factor * patches.area[i])
    exchange = torch.stack(rows)
    return (exchange + exchange.mT) / 2


def pair_classes() -> dict[str, tuple[Tensor, Tensor]]:
    """Random pairs of triangles that face each other, by how they lie."""
    generator = torch.Generator().manual_seed(0)

    def random(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    first = random(4 * PAIRS, 3, 3)
    found = {}
    for name, distance in (("1 size apart", 1.5), ("10 sizes", 10.0), ("10^4 sizes", 1e4)):
        way = torch.nn.functional.normalize(random(4 * PAIRS, 1, 3) - 0.5, dim=-1)
        found[name] = (first, random(4 * PAIRS, 3, 3) + distance * way)
    corner = random(4 * PAIRS, 3, 3) - 0.3
    corner[:, 0] = first[:, 0]
    found["common corner"] = (first, corner)
    edge = corner.clone()
    edge[:, 0], edge[:, 1] = first[:, 1], first[:, 0]
    found["common edge"] = (first, edge)
    normal = Patches(first).normal.unsqueeze(1)
    found["face to face at 1e-6"] = (first, first.flip(1) + 1e-6 * normal)
    return {name: seeing(*pair) for name, pair in found.items()}


def seeing(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """The pairs that see more of each other than rounding."""
    value = polygon_exchange(first, second, 1e-3)
    kept = torch.nonzero(value > value.max() * 1e-5).squeeze(-1)[:PAIRS]
    return first[kept], second[kept]


def print_pairs(repeats: int) -> None:
    print("| pairs | rtol | worst error | us a pair | spread |\n|---|---|---|---|---|")
    for name, (first, second) in pair_classes().items():
        exact = polygon_exchange(first, second, 1e-13)
        for rtol in RTOLS:
            call = lambda a=first, b=second, r=rtol: polygon_exchange(a, b, r)  # noqa: E731
            found, median, spread = timed(call, repeats)
            error = float((found / exact - 1).abs().max())
            scale = 1e6 / len(first)
            print(
                f"| {name} | {rtol:g} | {error:.1e} | {median * scale:.1f} | {spread * scale:.1f} |"
            )


def print_rooms(sizes: list[int], repeats: int) -> None:
    print(
        "\n| patches | way | worst row sum - 1 | worst pair | s | spread |"
        "\n|---|---|---|---|---|---|"
    )
    for parts in sizes:
        patches = cube(parts)
        exact = unoccluded_exchange(patches, 1e-12)
        ways: dict[str, Callable[[], Tensor]] = {
            "midpoints": lambda p=patches: midpoints(p),
            "averaged, 4 points": lambda p=patches: averaged(p),
        }
        for rtol in RTOLS:
            ways[f"rtol {rtol:g}"] = lambda p=patches, r=rtol: unoccluded_exchange(p, r)
        for way, call in ways.items():
            found, median, spread = timed(call, repeats)
            row = float((found.sum(-1) / patches.area - 1).abs().max())
            pair = float((found / exact - 1)[exact > 0].abs().max())
            errors, seconds = f"{row:.1e} | {pair:.1e}", f"{median:.2f} | {spread:.2f}"
            print(f"| {patches.count} | {way} | {errors} | {seconds} |")


def main() -> None:
    """Print both tables in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--parts", type=int, nargs="+", default=[9, 18])
    options = parser.parse_args()
    with torch.no_grad():
        print_pairs(options.repeats)
        print_rooms(options.parts, options.repeats)


if __name__ == "__main__":
    main()
