"""A concave relief from one photograph, without and with the light that it reflects onto itself.

Three distant lights, red, green and blue, shine on a white relief, so that one colour photograph
holds three shadings. Its depth is what makes a shading model reproduce the photograph:

    minimise over depth d    mean (model(d, albedo) - photograph)^2

by gradient descent (L-BFGS), from a plane. The *local* model is albedo / pi times the irradiance of
the lights; the *global* one is `ShadeDepth` with bounces and an ambient tail. Concave parts are
brighter than the local model allows, which it takes for less slope: it finds them too flat.

The photograph is made by neither: `render_scene` solves for all light between the triangles of a
finer mesh. Errors are mean angles between the normals found and those of the relief.

Run it: `python examples/concave_relief.py`. It writes `docs/pictures/concave_relief.png`. More
reliefs, and albedos that are not known: `python -m tests.benchmarks.concave_reliefs`.

Reference: S. Nayar, K. Ikeuchi and T. Kanade, "Shape from Interreflections", IJCV 6 (1991) 173-195.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from torchradiometry.demo.curve import write_panels
from torchradiometry.geometry import OrthographicCamera, depth_to_mesh, depth_to_normals
from torchradiometry.render import RenderSettings, render_scene
from torchradiometry.scene import Scene, Surface
from torchradiometry.shade import DepthSettings, ShadeDepth
from torchradiometry.sources import DirectionalSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "concave_relief.png"
Height = Callable[[Tensor, Tensor], Tensor]
#: m from the camera to the plane that reliefs are cut into; albedo
DISTANCE, ALBEDO = 2.0, 0.9
LOCAL = DepthSettings(cast_shadows=False, ambient_occlusion=False, bounces=0)
GLOBAL = replace(LOCAL, bounces=2, ambient_tail=True)


def bowl(x: Tensor, y: Tensor) -> Tensor:
    """A hollow cap of a sphere of radius 0.48 m in a plane, 70 degrees steep at its rim."""
    deep = (0.48**2 - x * x - y * y).clamp(min=0).sqrt() - math.sqrt(0.48**2 - 0.45**2)
    return -deep.clamp(min=0)


def groove(x: Tensor, y: Tensor) -> Tensor:
    """Two planes at a right angle."""
    return x.abs()


def lights(angle: float) -> DirectionalSource:
    """A red, a green and a blue light at an angle (degrees) to the camera's axis, pi W/m2 each."""
    tilt, turn = math.radians(angle), 0.3 + torch.arange(3) * math.tau / 3
    sideways = math.sin(tilt) * torch.stack((turn.cos(), turn.sin()), -1)
    direction = torch.cat((sideways, torch.full((3, 1), math.cos(tilt))), -1)
    return DirectionalSource(direction, math.pi * torch.eye(3))


def depth_map(height: Height, axis: Tensor) -> Tensor:
    """Depth `1 1 n n` of a relief at places along both axes, m."""
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    return (DISTANCE - height(x, y))[None, None]


def photograph(height: Height, albedo: float, source: DirectionalSource, size: int) -> Tensor:
    """`1 3 size size`, W/m2/sr, of one square metre: all light, from a mesh half as fine again."""
    corners = size * 3 // 2 + 1
    depth = depth_map(height, torch.linspace(-0.5, 0.5, corners))
    side = 1 / (corners - 1)
    vertices, faces = depth_to_mesh(depth, pixel_size=side)
    normals = depth_to_normals(depth, pixel_size=side)[0].flatten(1).T
    relief = Surface("relief", vertices, faces, torch.full((3,), albedo), normals=normals)
    camera = OrthographicCamera(width=size, height=size, ymag=0.5, camera_to_world=torch.eye(4))
    settings = RenderSettings(bounces=64, patch_size=1.0)  # a patch is a triangle
    with torch.no_grad():
        seen = render_scene(Scene((relief,), (source,)), camera, settings)
    return seen.radiance.permute(2, 0, 1)[None].float()


def recover(picture: Tensor, model: ShadeDepth, albedo: float | None, steps: int) -> Tensor:
    """Depth `1 1 n n` with which the model makes the picture; albedo None: unknown, one number.

    Depth is a sum of maps of falling size, so that a step changes broad shapes as fast as details.
    """
    size = picture.shape[-1]
    maps = [torch.zeros(1, 1, size >> k, size >> k) for k in range(size.bit_length() - 1)]
    paint = torch.tensor(0.6 if albedo is None else albedo).logit()
    unknown = [tensor.requires_grad_() for tensor in (maps if albedo else [*maps, paint])]
    descent = torch.optim.LBFGS(unknown, 1, steps, history_size=100, line_search_fn="strong_wolfe")

    def depth() -> Tensor:  # each map is in units of its own pixels
        wide = (
            functional.interpolate(m, (size, size), mode="bilinear") / len(m[0, 0]) for m in maps
        )
        return DISTANCE + sum(wide, torch.zeros(1, 1, size, size))

    def misfit() -> Tensor:
        descent.zero_grad()
        seen = model(depth(), paint.sigmoid().expand(1, 1, size, size))
        loss = ((seen - picture) / picture.mean()).square().mean()
        loss.backward()
        return loss

    descent.step(misfit)
    return depth().detach()


def normals_of(depth: Tensor) -> Tensor:
    """`1 3 n n`, of a map of one square metre."""
    return depth_to_normals(depth, pixel_size=1 / len(depth[0, 0]))


def degrees(depth: Tensor, truth: Tensor) -> float:
    """Mean angle between the normals of two depth maps."""
    here, there = normals_of(depth), normals_of(truth)
    sine = torch.linalg.cross(here, there, dim=1).norm(dim=1)
    return float(torch.rad2deg(torch.atan2(sine, (here * there).sum(1))).mean())


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, dict[str, float]]:
    """Mean angular error, degrees, of the local and of the global model on each relief."""
    size, steps = (12, 20) if fast else (24, 60)
    source, found, rows = lights(25), {}, []
    for height in (bowl, groove):
        picture = photograph(height, ALBEDO, source, size)
        truth = depth_map(height, (torch.arange(size) + 0.5) / size - 0.5)
        depths = {}
        for name, settings in (("local", LOCAL), ("global", replace(GLOBAL, cells=size))):
            model = ShadeDepth(settings, source, pixel_size=1 / size)
            depths[name] = recover(picture, model, ALBEDO, steps)
        found[height.__name__] = {name: degrees(d, truth) for name, d in depths.items()}
        colours = [((normals_of(d) + 1) / 2) ** 2.2 for d in (truth, *depths.values())]
        rows.append([p[0].permute(1, 2, 0).numpy() for p in (picture / picture.max(), *colours)])
    titles = ("photograph", "true normals", "local model", "global model")
    write_panels(out, rows, titles, names=[*found], scale=6)
    return found


if __name__ == "__main__":
    for relief, errors in main().items():
        print(relief, {model: round(error, 2) for model, error in errors.items()})
