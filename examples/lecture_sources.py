"""A ball on a floor under six kinds of light.

Run it: `python examples/lecture_sources.py`. It writes
`docs/pictures/lecture_sources.png`, and prints how much of each picture is dark.
"""

from __future__ import annotations

from pathlib import Path

import torch
from matplotlib.figure import Figure

from torchradiometry.demo.curve import show_radiance
from torchradiometry.render import RenderSettings, render_scene
from torchradiometry.scene import Scene, Surface, quad, sphere
from torchradiometry.scene.standard import camera, ground
from torchradiometry.sources import AmbientDome, DirectionalSource, PointSource, SpotSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "lecture_sources.png"


def panel(half: float, height: float, power: float) -> Surface:
    """A square that shines down, as strong straight on as a lamp of that intensity, W/sr."""
    x, z, h = 1.2, 0.6, half
    place = [[x - h, height, z - h], [x + h, height, z - h]]
    place += [[x + h, height, z + h], [x - h, height, z + h]]
    return quad("panel", place, albedo=0.0, emission=power / (4 * half * half))


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """A ball that hovers over a floor, under six kinds of light."""
    size = (24, 18) if fast else (200, 150)
    objects = (
        ground("floor", 4.0, albedo=0.6),
        sphere(
            "ball", 0.5, (0.0, 0.65, 0.0), subdivisions=2 if fast else 4, albedo=[0.7, 0.4, 0.2]
        ),
    )
    view = camera(*size, (0.6, 2.6, 4.2), (-0.2, 0.3, 0), 40)
    place, white = [1.2, 2.6, 0.6], [1.0] * 3
    aim = [-1.2, -2.0, -0.6]
    power = 22.0
    kinds: dict[str, tuple[tuple[Surface, ...], tuple[object, ...]]] = {
        "far away (sun)": ((), (DirectionalSource([1.2, 2.0, 0.6], [[3.0] * 3]),)),
        "small and near (lamp)": ((), (PointSource(place, [power * c for c in white]),)),
        "a lamp in a cone (spot)": (
            (),
            (SpotSource(place, aim, [power * c for c in white], 0.22, 0.32),),
        ),
        "a panel of 0.4 m": ((panel(0.2, 2.6, power),), ()),
        "a panel of 1.6 m": ((panel(0.8, 2.6, power),), ()),
        "the whole sky": ((), (AmbientDome([1.0]),)),
    }
    figure = Figure(figsize=(9.6, 5.2), layout="constrained")
    found = {}
    settings = RenderSettings(
        bounces=0,
        supersampling=1 if fast else 3,
        sky_samples=16 if fast else 256,
        shadow_samples=16,
    )
    for axes, (name, (more, lamps)) in zip(figure.subplots(2, 3).flat, kinds.items(), strict=True):
        scene = Scene((*objects, *more), lamps, view)  # type: ignore[arg-type]
        with torch.no_grad():
            picture = render_scene(scene, view[0], settings).radiance
        found[name] = float((picture.mean(-1) < 0.02 * picture.mean(-1).max()).float().mean())
        show_radiance(axes, picture, name, 0.9 / float(picture.quantile(0.995)))
    figure.savefig(out, dpi=100)
    return found


if __name__ == "__main__":
    print({name: round(value, 4) for name, value in main().items()})
