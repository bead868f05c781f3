"""A white room in dim light, a black room in bright light: what tells them apart.

Gilchrist and Jacobsen painted everything in a room with one paint, white or black, and people who
looked in through a hole knew which it was, even when the black room sent more light to the eye.
Here both lamps are set so that the mean radiance is the same; what differs is what reflected
light does to the shading:

    dynamic range      99th over 1st percentile of radiance
    shadow depth       1 - darkest over brightest part of the floor (1st and 99th percentile)
    sharpness          99th percentile of |grad ln L| on the surfaces, per height of the picture

Run it: `python examples/gilchrist.py`. It writes `docs/pictures/rooms.png`: the white room, the
black one, and the black one without reflected light, at the same exposure.

References: A. Gilchrist and A. Jacobsen, "Perception of lightness and illumination in a world of
one reflectance", Perception 13 (1984) 5-19.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from torchradiometry.demo.curve import write_panels
from torchradiometry.render import Picture, RenderSettings, render_scene
from torchradiometry.render.picture import see
from torchradiometry.render.world import prepare
from torchradiometry.scene import Scene
from torchradiometry.scene.standard import STANDARD_SCENES

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "rooms.png"
ROOMS = ("white room", "black room")
#: pixels of the pictures that are measured, and of those that are shown
SIZE, SHOWN = (96, 72), (288, 216)


def surface_of_pixels(scene: Scene) -> Tensor:
    """Index of the surface in the middle of every pixel."""
    world, camera = prepare(scene, RenderSettings()), scene.cameras[0]
    points = see(world, *camera.rays(camera.pixel_grid().double().reshape(-1, 2)))
    found = world.triangles.surface[points.triangle]
    return found.reshape(camera.height, camera.width)


def observe(radiance: Tensor, scene: Scene, keep: Tensor) -> dict[str, float]:
    """Dynamic range, shadow depth and sharpness of a picture.

    Args:
        radiance: `height width`.
        scene: what it shows.
        keep: pixels that see no emitter.
    """
    surface = surface_of_pixels(scene)
    floor = [s.name for s in scene.surfaces].index("floor")
    low, high = radiance[keep].quantile(radiance.new_tensor([0.01, 0.99]))
    dark, bright = radiance[keep & (surface == floor)].quantile(radiance.new_tensor([0.01, 0.99]))
    changes = []
    for axis in (0, 1):
        count = radiance.shape[axis] - 1
        here, there = (
            [t.narrow(axis, start, count) for t in (radiance, surface, keep)] for start in (0, 1)
        )
        same = (here[1] == there[1]) & here[2] & there[2]
        changes.append((here[0] / there[0]).log().abs()[same])
    steepest = torch.cat(changes).quantile(0.99) * radiance.shape[0]
    return {
        "dynamic range": float(high / low),
        "shadow depth": float(1 - dark / bright),
        "sharpness": float(steepest),
    }


def render(room: str, size: tuple[int, int], bounces: int, patch_size: float) -> Picture:
    """A standard room with so many bounces."""
    scene = STANDARD_SCENES[room](*size)
    settings = RenderSettings(bounces=bounces, patch_size=patch_size, supersampling=3)
    with torch.no_grad():
        return render_scene(scene, scene.cameras[0], settings)


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, dict[str, float]]:
    """Render both rooms; what can be read off each, and the share of light that was reflected."""
    size, patch_size = ((32, 24), 1.5) if fast else (SIZE, 0.35)
    found = {}
    for name in ROOMS:
        full, direct = (render(name, size, bounces, patch_size) for bounces in (64, 0))
        keep = ~full.emitter
        found[name] = observe(full.radiance.mean(-1), STANDARD_SCENES[name](*size), keep)
        found[name]["reflected share"] = float(
            1 - direct.radiance[keep].sum() / full.radiance[keep].sum()
        )
    panels = []
    for name, bounces in ((ROOMS[0], 64), (ROOMS[1], 64), (ROOMS[1], 0)):
        picture = render(name, size if fast else SHOWN, bounces, max(patch_size, 0.5))
        panels.append(picture.radiance / picture.radiance[~picture.emitter].mean())
    titles = ("white room", "black room", "black room, direct light alone")
    write_panels(out, [[panel.numpy() for panel in panels]], titles, exposure=0.4)
    return found


if __name__ == "__main__":
    for title, numbers in main().items():
        print(title, {name: round(value, 3) for name, value in numbers.items()})
