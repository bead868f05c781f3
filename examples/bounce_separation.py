"""One photograph, taken apart by how often its light was reflected.

Irradiance is what the lights send and what the surface sends itself, E = M + F rho E. Where depth
and albedo are known, F rho is known, and direct light follows from the photograph's radiance L;
nothing need be known of the lights:

    direct       M = (1 - F rho) E,      E = pi L / rho
    k bounces    E_k = F rho E_{k-1},    E_0 = M

F rho is one call of `reflected_irradiance` with a single bounce. 1 - F rho is the cancellation
operator that Seitz, Matsushita and Kutulakos measured; here it is computed from the depth map.

The photograph is made by `render`, from the triangles of a finer mesh, with shadows by rays, and
so is the truth, with 0, 1, 2 and 3 bounces. An error is the sum over the pixels of the absolute
difference, over the sum of the truth. In the shadow there is no direct light at all: the share of
the photograph's radiance that is left there is the hardest of the errors.

Run it: `python examples/bounce_separation.py`. It writes `docs/pictures/bounce_separation.png`.
Above: the photograph; direct light and one, two and three bounces as they are recovered from it
(bounces twice as bright). Below: the same as rendered.

References: S. Seitz, Y. Matsushita and K. Kutulakos, "A Theory of Inverse Light Transport", ICCV
2005.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor

from torchradiometry.demo.curve import write_panels
from torchradiometry.geometry import OrthographicCamera, depth_to_mesh, depth_to_normals
from torchradiometry.render import RenderSettings, develop, view_scene
from torchradiometry.scene import Scene, Surface
from torchradiometry.shade.interreflection import reflected_irradiance
from torchradiometry.sources import DirectionalSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "bounce_separation.png"
#: of red, green and blue
ALBEDO = torch.tensor([0.9, 0.8, 0.6])
#: towards a low sun, and what it sends to a plane that faces it
SUN = DirectionalSource([0.8, 0.3, 1.0], [math.pi])
#: radius of the bowl's sphere and of its rim, m; m from the camera to its rim
SPHERE, RIM, DISTANCE = 0.48, 0.45, 2.0
BOUNCES = 3


def bowl(axis: Tensor) -> Tensor:
    """Depth `1 1 n n` of a hollow spherical cap in a plane, at places along both axes, m."""
    square = axis.square() + axis.square().unsqueeze(-1)
    deep = (SPHERE**2 - square).clamp(min=0).sqrt() - math.sqrt(SPHERE**2 - RIM**2)
    return (DISTANCE + deep.clamp(min=0))[None, None]


def photographs(size: int, bounces: list[int]) -> list[Tensor]:
    """`1 3 size size`, W/m2/sr, of one square metre, with each number of bounces."""
    corners = size * 3 // 2 + 1  # of the triangles, which are the patches
    depth, side = bowl(torch.linspace(-0.5, 0.5, corners)), 1 / (corners - 1)
    vertices, faces = depth_to_mesh(depth, pixel_size=side)
    normals = depth_to_normals(depth, pixel_size=side)[0].flatten(1).T
    scene = Scene((Surface("bowl", vertices, faces, ALBEDO, normals=normals),), (SUN,))
    camera = OrthographicCamera(width=size, height=size, ymag=0.5, camera_to_world=torch.eye(4))
    settings = RenderSettings(bounces=1, ambient_tail=False, patch_size=1.0, gather=True)
    with torch.no_grad():
        view = view_scene(scene, camera, settings)
        ways = [view._replace(settings=replace(settings, bounces=count)) for count in bounces]
        ways = [way if way.settings.bounces else way._replace(exchange=None) for way in ways]
        return [develop(way, scene).radiance.permute(2, 0, 1)[None].float() for way in ways]


def separate(picture: Tensor, depth: Tensor, albedo: Tensor, bounces: int) -> list[Tensor]:
    """Radiance by direct light and by light after 1, 2, ... bounces, each `1 3 n n`."""
    size = picture.shape[-1]

    def once_more(irradiance: Tensor) -> Tensor:
        return reflected_irradiance(
            depth, albedo, irradiance, pixel_size=1 / size, cells=(size, size), azimuths=16
        )

    total = math.pi * picture / albedo
    series = [total - once_more(total)]
    for _ in range(bounces):
        series.append(once_more(series[-1]))
    return [albedo * irradiance / math.pi for irradiance in series]


def error(found: Tensor, truth: Tensor) -> float:
    """Sum of absolute differences over the sum of the truth."""
    return float((found - truth).abs().sum() / truth.sum())


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Relative errors of the photograph taken for direct light, and of what is recovered."""
    size = 16 if fast else 32
    depth = bowl((torch.arange(size) + 0.5) / size - 0.5)
    albedo = ALBEDO.reshape(1, 3, 1, 1).expand(1, 3, size, size)
    *sums, picture = photographs(size, [*range(BOUNCES + 1), 64])
    truth = [sums[0], *(more - less for less, more in pairwise(sums))]
    found = separate(picture, depth, albedo, BOUNCES)
    shadow = (truth[0] == 0).expand_as(picture)
    errors = {
        "photograph as direct light": error(picture, truth[0]),
        "direct light": error(found[0], truth[0]),
        **{f"bounce {k}": error(found[k], truth[k]) for k in range(1, BOUNCES + 1)},
        "left in the shadow": float(found[0][shadow].abs().sum() / picture[shadow].sum()),
    }
    rows = []
    for series in (found, truth):
        row = [picture, series[0], *(2 * bounce for bounce in series[1:])]
        rows.append([panel[0].permute(1, 2, 0).numpy() for panel in row])
    titles = ["photograph", "direct light", *(f"bounce {k}, x 2" for k in range(1, BOUNCES + 1))]
    names, exposure = ("found", "rendered"), float(1 / picture.max())
    write_panels(out, rows, titles, names=names, exposure=exposure, scale=4)
    return errors


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name}: {100 * value:.1f} %")
