"""Smoothing: reflected light fills the shadows of a bowl evenly.

In half a hollow sphere of albedo p every point sees every other one equally well, half of each
hemisphere (F = 1/2). Whatever falls into it, reflected light is the same everywhere:

    E_reflected = F p E_mean / (1 - p F),   E_mean = E_sun cos(tilt of the sun) / 2

so that shadows are filled, and the contrast (standard deviation over mean) falls to 1 - p F of
what it was.

Run it: `python examples/smoothing.py`. It writes `docs/pictures/smoothing.png`: the bowl with
direct light, with all light, and with reflected light alone.

Reference: J. Koenderink and A. van Doorn, "Geometrical modes as a general method to treat diffuse
interreflections in radiometry", J. Opt. Soc. Am. 73 (1983) 843-850.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import torch
import trimesh
from torch import Tensor

from torchradiometry.demo.curve import write_panels
from torchradiometry.render import Picture, RenderSettings, render_scene
from torchradiometry.scene import Scene, Surface
from torchradiometry.scene.standard import camera
from torchradiometry.sources import DirectionalSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "smoothing.png"
#: albedo, the way to the sun, and the bowl's mesh: the lower half of an octahedron, split
ALBEDO, SUN, SPLITS = 0.8, (0.4, 1.0, 0.2), 4
CORNERS = [[1.0, 0, 0], [0, 0, 1], [-1, 0, 0], [0, 0, -1], [0, -1, 0]]
OCTANTS = [[4, 1, 0], [4, 2, 1], [4, 3, 2], [4, 0, 3]]


def bowl(width: int, height: int) -> Scene:
    """Half a hollow sphere of radius 1 m, one sun, seen from above."""
    place, faces = torch.tensor(CORNERS), torch.tensor(OCTANTS)
    for _ in range(SPLITS):
        corners, triangles = trimesh.remesh.subdivide(place.numpy(), faces.numpy())
        place, faces = torch.tensor(corners).float(), torch.tensor(triangles)
        place = place / place.norm(dim=-1, keepdim=True)
    inside = Surface("bowl", place, faces, torch.full((3,), ALBEDO), normals=-place)
    sun = DirectionalSource(SUN, [[math.pi] * 3])
    return Scene((inside,), (sun,), camera(width, height, (0, 2.6, 1.6), (0, -0.4, 0), 38))


def contrast(light: Tensor, area: Tensor) -> float:
    """Standard deviation over mean."""
    mean = (light * area).sum() / area.sum()
    return float((((light - mean) ** 2 * area).sum() / area.sum()).sqrt() / mean)


def numbers(direct: Picture, full: Picture) -> dict[str, tuple[float, float]]:
    """Measured and closed-form numbers."""
    tilt = SUN[1] / math.hypot(*SUN)
    reflected = 0.5 * ALBEDO * (math.pi * tilt / 2) / (1 - ALBEDO / 2)
    glow = ALBEDO * reflected / math.pi
    area, before = full.indirect.exchange.patches.area, full.indirect.exchange.lamps[:, 0]
    after = before + full.indirect.irradiance[:, 0]
    seen = full.radiance[..., 0]
    dark = float(seen[(direct.radiance[..., 0] == 0) & (seen > 0)].median())
    return {
        "radiance in the shadow": (dark, glow),
        "brightest over darkest": (float(seen.max()) / dark, (ALBEDO + glow) / glow),
        "variation of reflected light": (contrast(after - before, area), 0.0),
        "contrast left": (contrast(after, area) / contrast(before, area), 1 - ALBEDO / 2),
    }


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, tuple[float, float]]:
    """Render the bowl; each number with what it should be."""
    scene = bowl(48, 36) if fast else bowl(192, 144)
    settings = RenderSettings(supersampling=1 if fast else 3, patch_size=0.5)
    with torch.no_grad():
        direct, full = (
            render_scene(scene, scene.cameras[0], replace(settings, bounces=n)) for n in (0, 64)
        )
    panels = [direct.radiance, full.radiance, full.radiance - direct.radiance]
    titles = ["direct light", "all light", "reflected light"]
    exposure = float(1 / full.radiance.max())
    write_panels(out, [[panel.numpy() for panel in panels]], titles, exposure=exposure)
    return numbers(direct, full)


if __name__ == "__main__":
    for name, (measured, wanted) in main().items():
        print(f"{name}: {measured:.4f}, should be {wanted:.4f}")
