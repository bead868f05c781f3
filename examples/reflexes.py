"""Reflexes, smoothing and a smaller dynamic range, held against closed forms.

**A long groove** of two planes at the angle a, lit evenly, albedo p. In the crease each side sees
only the other one with the form factor F = (1 + cos a) / 2, and light is

    1 / (1 - p F)      times as bright as without reflection.

Away from it the strips of the two sides exchange light by Hottel's crossed strings, which
gives the whole profile to any number of digits.

**A bowl**, half a hollow sphere of albedo p: every point sees every other one equally well, half of
each hemisphere (F = 1/2). Whatever falls into it, reflected light is the same everywhere:

    E_reflected = F p E_mean / (1 - p F),   E_mean = E_sun cos(tilt of the sun) / 2

so that shadows are filled evenly (smoothing), and the contrast (standard deviation over mean)
falls to 1 - p F of what it was.

Run it: `python examples/reflexes.py`. It writes `docs/pictures/reflexes.png`: groove and bowl, each
with direct light and with all light.

References: H. Hottel and A. Sarofim, *Radiative Transfer* (1967), 2.3 (crossed strings); J.
Koenderink and A. van Doorn, "Geometrical modes as a general method to treat diffuse
interreflections in radiometry", J. Opt. Soc. Am. 73 (1983) 843-850.
"""

from __future__ import annotations

import math
from pathlib import Path

import torch
import trimesh
from torch import Tensor

from torchradiometry.demo.curve import write_panels
from torchradiometry.render import Picture, RenderSettings, render_scene
from torchradiometry.scene import Scene, Surface, quad
from torchradiometry.scene.standard import camera
from torchradiometry.sources import DirectionalSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "reflexes.png"
ANGLE, ALBEDO = math.radians(60), 0.7
#: length of the groove, in widths of a side; strips a side of the reference
LENGTH, STRIPS = 12.0, 400
#: the bowl, the way to its sun, and its mesh: the lower half of an octahedron, split
BOWL_ALBEDO, SUN, SPLITS = 0.8, (0.4, 1.0, 0.2), 4
OCTANTS = [[1.0, 0, 0], [0, 0, 1], [-1, 0, 0], [0, 0, -1], [0, -1, 0]]
KINDS = (torch.float32, torch.int64)
#: distances from the crease that are shown, in widths of a side
DISTANCES = (0.05, 0.25, 0.5, 1.0)


def groove(width: int, height: int) -> Scene:
    """A long groove of sides 1 m wide, lit from above, seen from above."""
    run, rise, z = math.sin(ANGLE / 2), math.cos(ANGLE / 2), LENGTH / 2
    sides = [
        quad("left", [[0, 0, z], [0, 0, -z], [-run, rise, -z], [-run, rise, z]], albedo=ALBEDO),
        quad("right", [[0, 0, -z], [0, 0, z], [run, rise, z], [run, rise, -z]], albedo=ALBEDO),
    ]
    sun = DirectionalSource([0.0, 1.0, 0.0], [[math.pi] * 3])
    return Scene(tuple(sides), (sun,), camera(width, height, (0, 9.0, 0.9), (0, 0.3, 0), 7))


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


def bowl(width: int, height: int) -> Scene:
    """Half a hollow sphere of radius 1 m, one sun, seen from above."""
    place = torch.tensor(OCTANTS)
    faces = torch.tensor([[4, 1, 0], [4, 2, 1], [4, 3, 2], [4, 0, 3]])
    for _ in range(SPLITS):
        halved = trimesh.remesh.subdivide(place.numpy(), faces.numpy())
        place, faces = (torch.tensor(t).to(kind) for t, kind in zip(halved, KINDS, strict=True))
        place = place / place.norm(dim=-1, keepdim=True)
    inside = Surface("bowl", place, faces, torch.full((3,), BOWL_ALBEDO), normals=-place)
    sun = DirectionalSource(SUN, [[math.pi] * 3])
    return Scene((inside,), (sun,), camera(width, height, (0, 2.6, 1.6), (0, -0.4, 0), 38))


def pictures(scene: Scene, common: dict[str, float]) -> tuple[Picture, Picture]:
    """With direct light only, and with all light."""
    made = []
    for bounces in (0, 64):
        settings = RenderSettings(bounces=bounces, **common)  # type: ignore[arg-type]
        with torch.no_grad():
            made.append(render_scene(scene, scene.cameras[0], settings))
    return made[0], made[1]


def groove_profile(direct: Tensor, full: Tensor, scene: Scene) -> tuple[Tensor, Tensor]:
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


def bowl_numbers(direct: Picture, full: Picture) -> dict[str, tuple[float, float]]:
    """Measured and closed-form numbers of the bowl."""
    tilt = SUN[1] / math.hypot(*SUN)
    reflected = 0.5 * BOWL_ALBEDO * (math.pi * tilt / 2) / (1 - BOWL_ALBEDO / 2)
    glow = BOWL_ALBEDO * reflected / math.pi
    exchange = full.indirect.exchange
    area = exchange.patches.area
    before = exchange.lamps[:, 0]
    after = before + full.indirect.irradiance[:, 0]
    seen = full.radiance[..., 0]
    dark = float(seen[(direct.radiance[..., 0] == 0) & (seen > 0)].median())
    return {
        "radiance in its shadow": (dark, glow),
        "brightest over darkest": (float(seen.max()) / dark, (BOWL_ALBEDO + glow) / glow),
        "variation of reflected light": (contrast(after - before, area), 0.0),
        "contrast left by reflected light": (
            contrast(after, area) / contrast(before, area),
            1 - BOWL_ALBEDO / 2,
        ),
    }


def contrast(light: Tensor, area: Tensor) -> float:
    """Standard deviation over mean."""
    mean = (light * area).sum() / area.sum()
    return float((((light - mean) ** 2 * area).sum() / area.sum()).sqrt() / mean)


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, tuple[float, float]]:
    """Render a groove and a bowl; each number with what it should be."""
    width, height = (48, 36) if fast else (192, 144)
    common = {"supersampling": 1} if fast else {"supersampling": 3}
    scene = groove(width, height)
    direct, full = pictures(scene, common | {"patch_size": 0.6 if fast else 0.25})
    where, brighter = groove_profile(direct.radiance, full.radiance, scene)
    place, reference = crossed_strings(STRIPS)
    found = {
        f"groove, {s:g} from the crease": (
            float(brighter[(where - s).abs().argmin()]),
            float(reference[(place - where[(where - s).abs().argmin()]).abs().argmin()]),
        )
        for s in DISTANCES
    }
    limit = 1 / (1 - ALBEDO * (1 + math.cos(ANGLE)) / 2)
    found["groove, in the crease: crossed strings, and 1 / (1 - p F)"] = (
        float(reference[0]),
        limit,
    )
    dark, bright = pictures(bowl(width, height), common | {"patch_size": 0.5})
    found |= {f"bowl, {k}": v for k, v in bowl_numbers(dark, bright).items()}
    panels = [p.radiance.numpy() for p in (direct, full, dark, bright)]
    titles = [
        f"{body}, {light} light" for body in ("groove", "bowl") for light in ("direct", "all")
    ]
    write_panels(out, [panels], titles, exposure=float(1 / bright.radiance.max()))
    return found


if __name__ == "__main__":
    for name, (measured, wanted) in main().items():
        print(f"{name}: {measured:.4f}, should be {wanted:.4f}")
