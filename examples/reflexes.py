"""Reflexes: a groove is brightest where it is deepest.

Two long planes meet at the angle a; their albedo is p and direct light is the same all over them.
In the crease each side sees only the other one, with the form factor F = (1 + cos a) / 2, and light
is

    1 / (1 - p F)      times as bright as without reflection.

Away from it the strips of the two sides exchange light by Hottel's crossed strings, which gives
the whole profile to any number of digits.

Run it: `python examples/reflexes.py`. It writes `docs/pictures/reflexes.png`: the groove with
direct light and with all light, and how much brighter it is across.

Reference: H. Hottel and A. Sarofim, *Radiative Transfer* (1967), 2.3 (crossed strings).
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import Tensor

from torchradiometry.demo.curve import show_radiance
from torchradiometry.render import RenderSettings, render_scene
from torchradiometry.scene import Scene, quad
from torchradiometry.scene.standard import camera
from torchradiometry.sources import DirectionalSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "reflexes.png"
ANGLE, ALBEDO = math.radians(60), 0.7
#: length of the groove, in widths of a side; strips a side of the reference
LENGTH, STRIPS = 12.0, 400
#: distances from the crease that are printed, in widths of a side
DISTANCES = (0.05, 0.25, 0.5, 1.0)


def groove(width: int, height: int) -> Scene:
    """Sides 1 m wide, lit and seen from above."""
    run, rise, z = math.sin(ANGLE / 2), math.cos(ANGLE / 2), LENGTH / 2
    sides = (
        quad("left", [[0, 0, z], [0, 0, -z], [-run, rise, -z], [-run, rise, z]], albedo=ALBEDO),
        quad("right", [[0, 0, -z], [0, 0, z], [run, rise, z], [run, rise, -z]], albedo=ALBEDO),
    )
    sun = DirectionalSource([0.0, 1.0, 0.0], [[math.pi] * 3])
    return Scene(sides, (sun,), camera(width, height, (0, 9.0, 0.9), (0, 0.3, 0), 7))


def crossed_strings(strips: int) -> tuple[Tensor, Tensor]:
    """Distances of strips from the crease, and how many times brighter reflections make them.

    Strips are narrow at the crease. By symmetry B = p (E + F B), with F of one side to the other.
    """
    edge = torch.linspace(0, 1, strips + 1, dtype=torch.float64) ** 3
    distance = (edge[:, None] ** 2 + edge**2 - 2 * edge[:, None] * edge * math.cos(ANGLE)).sqrt()
    crossed = distance[:-1, 1:] + distance[1:, :-1] - distance[:-1, :-1] - distance[1:, 1:]
    factors = crossed / (2 * (edge[1:] - edge[:-1])[:, None])
    system = torch.eye(strips, dtype=torch.float64) - ALBEDO * factors
    return (edge[1:] + edge[:-1]) / 2, torch.linalg.solve(system, torch.ones(strips).double())


def profile(direct: Tensor, full: Tensor, scene: Scene) -> tuple[Tensor, Tensor]:
    """Distances of the right side's pixels from the crease, and how much brighter they are."""
    view = scene.cameras[0]
    row = view.height // 2
    origin, ray = view.rays(view.pixel_grid()[row].double())
    # where y = x / tan(a/2) meets the ray
    steep = 1 / math.tan(ANGLE / 2)
    way = (steep * origin[..., 0] - origin[..., 1]) / (ray[..., 1] - steep * ray[..., 0])
    distance = (origin + way.unsqueeze(-1) * ray)[..., 0] / math.sin(ANGLE / 2)
    seen = (distance > 0) & (distance < 1) & (direct[row, :, 0] > 0)
    return distance[seen], (full[row, :, 0] / direct[row, :, 0])[seen].double()


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, tuple[float, float]]:
    """How much brighter the groove is at each distance: rendered, and by crossed strings."""
    scene = groove(48, 36) if fast else groove(192, 144)
    rays, size = (1, 0.6) if fast else (3, 0.25)
    settings = RenderSettings(supersampling=rays, patch_size=size)
    with torch.no_grad():
        direct, full = (
            render_scene(scene, scene.cameras[0], replace(settings, bounces=n)).radiance
            for n in (0, 64)
        )
    place, reference = crossed_strings(STRIPS)
    where, brighter = profile(direct, full, scene)
    found = {}
    for distance in DISTANCES:
        pixel = (where - distance).abs().argmin()
        strip = (place - where[pixel]).abs().argmin()
        found[f"{distance:g} from the crease"] = (float(brighter[pixel]), float(reference[strip]))
    limit = 1 / (1 - ALBEDO * (1 + math.cos(ANGLE)) / 2)
    found["in the crease: crossed strings, and 1 / (1 - p F)"] = (float(reference[0]), limit)

    figure = Figure(figsize=(9, 2.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    show_radiance(left, direct, "direct light", float(1 / full.max()))
    show_radiance(middle, full, "all light", float(1 / full.max()))
    right.plot(place, reference, color="0.6", label="crossed strings")
    right.plot(where, brighter, ".", ms=3, label="rendered")
    right.set(xlabel="distance from the crease, m", ylabel="all over direct light", ylim=(1, None))
    right.legend(frameon=False, fontsize="small")
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)
    return found


if __name__ == "__main__":
    for name, (measured, wanted) in main().items():
        print(f"{name}: {measured:.4f}, should be {wanted:.4f}")
