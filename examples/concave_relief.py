"""A concave relief from one photograph, without and with the light that it reflects onto itself.

Three distant lights, red, green and blue, shine on a white relief, so that one colour photograph
holds three shadings. Its depth is what makes a shading model reproduce the photograph:

    minimise over depth d    mean (model(d, albedo) - photograph)^2

by gradient descent (Adam), from a plane. The *local* model is albedo / pi times the irradiance of
the lights; the *global* one is `ShadeDepth` with bounces and an ambient tail, and with shadows
where the lights are oblique. Concave parts are brighter than the local model allows, which it takes
for less slope: it finds grooves and bowls too flat.

The photographs are made by neither: `render_scene` solves for all reflected light between the
triangles of a finer mesh and looks for shadows with rays. Errors are mean angles between the
normals of the depth found and those of the relief, over all pixels. The albedo is known, or one
number that is found along with the depth.

Depth is a sum of maps of falling size, so that a step changes broad shapes as fast as details.

Run it: `python examples/concave_relief.py`. It writes `docs/pictures/concave_relief.png`, a row for
each relief: the photograph, the true normals, those of the local and those of the global model.

References: S. Nayar, K. Ikeuchi and T. Kanade, "Shape from Interreflections", IJCV 6 (1991)
173-195.
"""

from __future__ import annotations

import math
from collections.abc import Callable
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
#: radius of the bowl's sphere and of its rim, m: at the rim it is 70 degrees steep
SPHERE, RIM = 0.48, 0.45
#: m from the camera to the plane that reliefs are cut into
DISTANCE = 2.0
#: steps of the descent: of depths, pixels of their level, and of an unknown albedo, logits
RATES = [0.03, 0.1]
LOCAL = DepthSettings(cast_shadows=False, ambient_occlusion=False, bounces=0)


def bowl(x: Tensor, y: Tensor) -> Tensor:
    """A hollow spherical cap in a plane."""
    deep = (SPHERE**2 - x * x - y * y).clamp(min=0).sqrt() - math.sqrt(SPHERE**2 - RIM**2)
    return -deep.clamp(min=0)


def groove(x: Tensor, y: Tensor) -> Tensor:
    """Two planes at a right angle."""
    return x.abs()


def waves(x: Tensor, y: Tensor) -> Tensor:
    """Hills and hollows, up to 60 degrees steep."""
    return 0.1 * (torch.sin(9 * x + 4 * y) + torch.sin(3 * x - 11 * y + 1))


#: relief, albedo, angle between the lights and the camera's axis (degrees)
CASES: dict[str, tuple[Height, float, float]] = {
    "bowl": (bowl, 0.9, 25),
    "groove": (groove, 0.9, 25),
    "waves": (waves, 0.9, 25),
    "bowl, oblique lights": (bowl, 0.9, 45),
    "bowl, albedo 0.6": (bowl, 0.6, 25),
    "groove, albedo 0.6": (groove, 0.6, 25),
    "bowl, albedo 0.3": (bowl, 0.3, 25),
    "groove, albedo 0.3": (groove, 0.3, 25),
}


def lights(angle: float) -> DirectionalSource:
    """A red, a green and a blue light around the camera's axis, pi W/m2 each."""
    tilt, turn = math.radians(angle), 0.3 + torch.arange(3) * math.tau / 3
    sideways = math.sin(tilt) * torch.stack((turn.cos(), turn.sin()), -1)
    direction = torch.cat((sideways, torch.full((3, 1), math.cos(tilt))), -1)
    return DirectionalSource(direction, math.pi * torch.eye(3))


def depth_map(height: Height, axis: Tensor) -> Tensor:
    """Depth `1 1 n n` of a relief at places along both axes, m."""
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    return (DISTANCE - height(x, y))[None, None]


def photograph(height: Height, albedo: float, angle: float, size: int) -> Tensor:
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
        seen = render_scene(Scene((relief,), (lights(angle),)), camera, settings)
    return seen.radiance.permute(2, 0, 1)[None].float()


def recover(picture: Tensor, model: ShadeDepth, albedo: float | None, steps: int) -> Tensor:
    """Depth `1 1 n n` with which the model makes the picture; albedo None: unknown."""
    size = picture.shape[-1]
    levels = [torch.zeros(1, 1, size >> k, size >> k) for k in range(size.bit_length() - 1)]
    for tensor in levels:
        tensor.requires_grad_()
    paint = torch.tensor(0.6 if albedo is None else albedo).logit().requires_grad_(albedo is None)
    groups = [{"params": levels}, {"params": [paint]}]
    descent = torch.optim.Adam(groups, betas=(0.9, 0.95))
    pace = torch.optim.lr_scheduler.OneCycleLR(descent, RATES, total_steps=steps, pct_start=0.1)
    for _ in range(steps):
        depth = summed(levels, size)
        seen = model(depth, paint.sigmoid().expand_as(depth))
        loss = ((seen - picture) / picture.mean()).square().mean()
        descent.zero_grad()
        loss.backward()
        descent.step()
        pace.step()
    return summed(levels, size).detach()


def summed(levels: list[Tensor], size: int) -> Tensor:
    """Depth of maps of falling size, each in units of its own pixels."""
    maps = (functional.interpolate(t, (size, size), mode="bilinear") / len(t[0, 0]) for t in levels)
    return sum(maps, torch.full((1, 1, size, size), DISTANCE))


def degrees(depth: Tensor, truth: Tensor) -> float:
    """Mean angle between the normals of two depth maps."""
    here, there = (depth_to_normals(d, pixel_size=1 / len(d[0, 0])) for d in (depth, truth))
    sine = torch.linalg.cross(here, there, dim=1).norm(dim=1)
    return float(torch.rad2deg(torch.atan2(sine, (here * there).sum(1))).mean())


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, dict[str, float]]:
    """Mean angular error, degrees, of the local and of the global model on each relief."""
    size, steps = (12, 60) if fast else (24, 200)
    found, rows = {}, []
    for name, (height, albedo, angle) in list(CASES.items())[: 2 if fast else None]:
        oblique = angle > 25
        width = 0.05 if oblique else None
        bounces = DepthSettings(oblique, width, False, 2, ambient_tail=True, cells=size)
        picture = photograph(height, albedo, angle, size)
        truth = depth_map(height, (torch.arange(size) + 0.5) / size - 0.5)
        panels, found[name] = [picture / picture.max(), normal_colours(truth)], {}
        for model, settings in (("local", LOCAL), ("global", bounces)):
            layer = ShadeDepth(settings, lights(angle), pixel_size=1 / size)
            for known in (albedo, None):
                depth = recover(picture, layer, known, steps)
                title = model if known else f"{model}, albedo unknown"
                found[name][title] = degrees(depth, truth)
                panels += [normal_colours(depth)] if known else []
        rows.append([panel[0].permute(1, 2, 0).numpy() for panel in panels])
    titles = ("photograph", "true normals", "local model", "global model")
    write_panels(out, rows[:4], titles, names=[*found][:4], scale=6)
    return found


def normal_colours(depth: Tensor) -> Tensor:
    """Normals as colours, `1 3 n n`."""
    return ((depth_to_normals(depth, pixel_size=1 / len(depth[0, 0])) + 1) / 2) ** 2.2


if __name__ == "__main__":
    for relief, errors in main().items():
        print(relief, {model: round(error, 2) for model, error in errors.items()})
