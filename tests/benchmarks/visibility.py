"""What visibility costs: `python -m tests.benchmarks.visibility`.

1. Direct light of the ceiling panel in the Cornell-like room on 128 x 128 camera points: exact
   clipping against shadow rays (exact polygon times the share of free stratified rays, weighted
   by cos cos / r^2; four times as many rays where the first disagree). Error:
   sum |E - E*| / sum E*, over all points and over those that see the panel in part; E* is the
   clipped value, itself checked on some points by rays.
2. Visibility of all pairs of patches of the room: certain pairs without rays and the others by
   weight, against the same number of rays for every pair (four times as many where they
   disagree). Error: sum w |V - V*| / sum w and its root mean square, w the centre-to-centre
   exchange area; V* from 512 segments of every pair that is not certain.
3. `occluded_exchange` of two unit squares 1 m apart, half hidden by symmetry and by a tilted
   screen: against the closed form, and against the pair the other way round.

Times are medians of repeats on one thread, spread the distance of the quartiles.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from statistics import quantiles
from typing import NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches, subdivide
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.reference.closed_forms import parallel_rectangles
from torchradiometry.scene.build import cornell_like_room
from torchradiometry.transport import EmbreeRays, visibility
from torchradiometry.transport.blockers import convex_blockers
from torchradiometry.transport.occluded_exchange import occluded_exchange
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import pair_index, sample_patches, sequence
from torchradiometry.transport.visible_parts import visible_irradiance


def measured(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median and interquartile range in s, after one call to warm up."""
    times = []
    for number in range(repeats + 1):
        began = time.perf_counter()
        call()
        if number:
            times.append(time.perf_counter() - began)
    if len(times) < 2:
        return times[0], 0.0
    low, median, high = quantiles(times, n=4)
    return median, high - low


class Room(NamedTuple):
    """What blocks and shines in the room, and points and normals that its camera sees."""

    rays: AbstractRayCaster
    lamps: Tensor
    blockers: Tensor
    position: Tensor
    normal: Tensor


def room(pixels: int) -> Room:
    scene = cornell_like_room(width=pixels, height=pixels, dtype=torch.float64)
    corners = scene.triangles.corners
    rays = EmbreeRays(corners)
    camera = scene.cameras[0]
    seen = camera.rays(camera.pixel_grid())
    direction = seen.direction.reshape(-1, 3).double()
    origin = seen.origin.double().expand_as(seen.direction).reshape(-1, 3)
    hits = rays.closest(origin, direction)
    position = (hits.barycentric.unsqueeze(-1) * corners[hits.triangle]).sum(1)
    shining = (scene.triangles.emission > 0).any(-1)
    lamps = convex_blockers(corners[shining])
    normal = Patches(corners).normal[hits.triangle]
    return Room(rays, lamps, convex_blockers(corners), position, normal)


def clipped(room: Room) -> Tensor:
    """Irradiance by the panel of unit radiance, by clipping."""
    points = (room.position.unsqueeze(1), room.normal.unsqueeze(1))
    margin = room.rays.tolerance
    return visible_irradiance(*points, room.lamps, room.blockers, margin=margin).sum(1)


def unblocked(room: Room) -> Tensor:
    return polygon_irradiance(room.position, room.normal, room.lamps[0])


def by_rays(room: Room, samples: int) -> Tensor:
    """The same by shadow rays to the panel, which is one quad."""
    whole = unblocked(room)
    point = torch.nonzero(whole > 0).squeeze(-1)
    generator = torch.Generator().manual_seed(0)
    shift = torch.rand(len(point), 1, 2, generator=generator, dtype=torch.float64)
    where = sequence(4 * samples, 2, whole)
    lit, total = _weighted(room, point, (where[:samples] + shift).frac())
    mixed = torch.nonzero((lit > 0) & (lit < total)).squeeze(-1)
    more = _weighted(room, point[mixed], (where[samples:] + shift[mixed]).frac())
    lit, total = lit.index_add(0, mixed, more[0]), total.index_add(0, mixed, more[1])
    share = torch.where(total > 0, lit / total, 1)
    return whole.index_put((point,), whole[point] * share)


def _weighted(room: Room, point: Tensor, where: Tensor) -> tuple[Tensor, Tensor]:
    """Sums of cos cos / r^2 over the free rays and over all."""
    lamp = room.lamps[0]
    front = Patches(room.lamps).normal[0]
    normal = room.normal[point].unsqueeze(1)
    start = room.rays.lift(room.position[point].unsqueeze(1), normal)
    end = sample_patches(lamp, where)
    ray = end - start
    cosines = (ray * normal).sum(-1).clamp(min=0) * (-ray * front).sum(-1).clamp(min=0)
    weight = cosines / (ray * ray).sum(-1) ** 2
    free = room.rays.visible(start, room.rays.lift(end, front))
    return (weight * free).sum(-1), weight.sum(-1)


def penumbra_rows(pixels: int, repeats: int) -> list[str]:
    seen = room(pixels)
    exact, whole = clipped(seen), unblocked(seen)
    part = (exact > 0) & (exact < whole * (1 - 2.0**-30))
    median, spread = measured(lambda: clipped(seen), repeats)
    rows = [f"| clipping | {median:.2f} | {spread:.2f} | 0 | 0 |"]
    for samples in (1, 4, 16, 64):
        found = by_rays(seen, samples)
        off = (found - exact).abs()
        errors = (float(off[k].sum() / exact[k].sum()) for k in (exact >= 0, part))
        median, spread = measured(lambda s=samples: by_rays(seen, s), repeats)
        text = " | ".join(f"{100 * e:.3f} %" for e in errors)
        rows.append(
            f"| {samples} rays, then {4 * samples} | {median:.2f} | {spread:.2f} | {text} |"
        )
    some = torch.nonzero(part).squeeze(-1)[:: max(1, int(part.sum()) // 16)]
    check = by_rays(seen._replace(position=seen.position[some], normal=seen.normal[some]), 2**14)
    off = float((check - exact[some]).abs().sum() / exact[some].sum())
    rows.append(
        f"\n{int(part.sum())} of {len(part)} points see a part of the panel. On {len(some)} of "
        f"them 2^16 rays differ from clipping by {100 * off:.3f} %."
    )
    return rows


def plain_visibility(
    patches: Patches, rays: AbstractRayCaster, i: Tensor, j: Tensor, samples: int
) -> Tensor:
    """Baseline: rays for every pair, four times as many where the first ones disagree."""
    generator = torch.Generator().manual_seed(0)
    points = visibility._points(patches, rays, 4 * samples, generator)
    start = torch.randint(4 * samples, (2, len(i)), generator=generator)
    drawn = torch.full_like(i, samples)
    free, valid = visibility._segments(points, rays, i, j, start, drawn * 0, drawn)
    mixed = torch.nonzero((free > 0) & (free < valid)).squeeze(-1)
    more = visibility._segments(
        points, rays, i[mixed], j[mixed], start[:, mixed], drawn[mixed], 3 * drawn[mixed]
    )
    free, valid = free.index_add(0, mixed, more[0]), valid.index_add(0, mixed, more[1])
    return torch.where(valid > 0, free / valid.clamp(min=1), 1)


class CountedRays:
    """Counts the segments that are asked for."""

    def __init__(self, rays: AbstractRayCaster) -> None:
        self.held, self.count = rays, 0

    def __getattr__(self, name: str) -> object:
        return getattr(self.held, name)

    def visible(self, origin: Tensor, target: Tensor) -> Tensor:
        self.count += torch.broadcast_tensors(origin, target)[0][..., 0].numel()
        return self.held.visible(origin, target)


def weights(patches: Patches) -> Tensor:
    """Exchange areas from centre to centre, bounded where patches touch."""
    ray = patches.centroid.unsqueeze(0) - patches.centroid.unsqueeze(1)
    square = (ray * ray).sum(-1)
    here = (ray * patches.normal.unsqueeze(1)).sum(-1).clamp(min=0)
    there = (-ray * patches.normal.unsqueeze(0)).sum(-1).clamp(min=0)
    both = patches.area.unsqueeze(1) * patches.area
    return both * here * there / (math.pi * square**2 + both).clamp(min=2.0**-60)


def reference(patches: Patches, rays: AbstractRayCaster, i: Tensor, j: Tensor) -> Tensor:
    """V from 512 independent segments of every pair that is not certain."""
    visible, hidden = visibility._certain(patches, rays, i, j, 4)
    value = visible.double()
    normal = patches.normal.unsqueeze(1)
    generator = torch.Generator().manual_seed(1)
    for some in torch.nonzero(~(visible | hidden)).squeeze(-1).split(2**14):
        a, b = i[some], j[some]
        free, valid = value.new_zeros(2, len(some))
        for _ in range(16):
            where = torch.rand(2, len(some), 32, 2, generator=generator, dtype=torch.float64)
            here = rays.lift(sample_patches(patches.corners[a].unsqueeze(1), where[0]), normal[a])
            there = rays.lift(sample_patches(patches.corners[b].unsqueeze(1), where[1]), normal[b])
            ahead = ((there - patches.corners[a][:, :1]) * normal[a]).sum(-1) > 0
            ahead &= ((here - patches.corners[b][:, :1]) * normal[b]).sum(-1) > 0
            free += (rays.visible(here, there) & ahead).sum(-1)
            valid += ahead.sum(-1)
        value[some] = torch.where(valid > 0, free / valid.clamp(min=1), 1)
    return value


def pair_rows(share: float, repeats: int) -> list[str]:
    world = room(8)
    patches, _ = subdivide(Patches(world.rays.corners), share * world.rays.scale)
    exchange = weights(patches)
    i, j = pair_index(patches.count, exchange > 0)
    weight = exchange[i, j]
    exact = reference(patches, world.rays, i, j)
    rows = []
    for samples in (2, 4, 8, 16):
        for name in ("rays for all", "certain first"):
            rays = CountedRays(world.rays)

            def call(
                rays: CountedRays = rays, samples: int = samples, name: str = name
            ) -> tuple[Tensor, ...]:
                if name == "rays for all":
                    return (plain_visibility(patches, rays, i, j, samples),)
                return visibility.pair_visibility(patches, rays, i, j, samples, 0, weight)

            off = (call()[0] - exact).abs() * weight / weight.sum()
            count = rays.count
            median, spread = measured(call, repeats)
            errors = f"{100 * float(off.sum()):.2f} % | {float(off.square().sum().sqrt()):.2e}"
            cost = f"{samples} | {count / 1e6:.2f} | {median:.2f} | {spread:.2f}"
            rows.append(f"| {name} | {cost} | {errors} |")
    visible, hidden = visibility._certain(patches, world.rays, i, j, 4)
    rows.append(
        f"\n{patches.count} patches, {len(i)} pairs: {100 * float(visible.double().mean()):.1f} % "
        f"surely visible, {100 * float(hidden.double().mean()):.1f} % surely hidden."
    )
    return rows


def occluded_rows(repeats: int) -> list[str]:
    floor = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=torch.float64)
    ceiling = floor.flip(1) + floor.new_tensor([0, 0, 1])
    half = floor * floor.new_tensor([18, 18, 0]) + floor.new_tensor([0.5, -9, 0.5])
    screen = floor * 0.5 + floor.new_tensor([0.28, 0.23, 0.4])
    screen = screen + screen[..., :1] * floor.new_tensor([0, 0.2, 0.3])
    rows = []
    for name, blocker in (("half, by symmetry", half), ("tilted screen", screen)):
        found = occluded_exchange(floor, ceiling, blocker)
        other = occluded_exchange(ceiling, floor, blocker).exchange
        if blocker is half:
            other = other.new_tensor([parallel_rectangles(1.0, 1.0, 1.0) / 2])
        off = float((found.exchange / other - 1).abs())
        stated = float(found.error / found.exchange)
        median, spread = measured(
            lambda b=blocker: occluded_exchange(floor, ceiling, b), min(repeats, 3)
        )
        rows.append(f"| {name} | {off:.0e} | {stated:.0e} | {median:.2f} | {spread:.2f} |")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pixels", type=int, default=128)
    parser.add_argument("--share", type=float, default=1 / 6, help="patch over half diagonal")
    parser.add_argument("--repeats", type=int, default=5)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    print("| way | median, s | spread, s | error, all points | error, penumbra |")
    print("|---|---|---|---|---|")
    print("\n".join(penumbra_rows(chosen.pixels, chosen.repeats)))
    print("\n| pair | relative difference | stated error | median, s | spread, s |")
    print("|---|---|---|---|---|")
    print("\n".join(occluded_rows(chosen.repeats)))
    print("\n| way | samples | rays, 10^6 | median, s | spread, s | weighted L1 | weighted RMS |")
    print("|---|---|---|---|---|---|---|")
    print("\n".join(pair_rows(chosen.share, chosen.repeats)))


if __name__ == "__main__":
    main()
