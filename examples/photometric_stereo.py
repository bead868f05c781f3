"""Normals from photographs under known lamps: least squares, and the shipped network.

Woodham's least squares (1980) takes a surface for matt and wholly lit. A relief casts shadows,
shines and lights itself: what the layers know of that, the network was trained on.

The photographs are made up: a glossy relief under twelve lamps, by `ShadeDepth` with cast shadows
and a bounce, plus a `BlinnPhong` highlight. With real ones beside the repository, laid out as
`torchradiometry normals` takes them (`../shared/data/diligent`, or `main(source=...)`), their
errors under twelve of their lamps are reported too; without, a sentence says so. Those are not
ours to publish, so the picture is of the made-up ones.

Run it: `python examples/photometric_stereo.py`. It writes `docs/pictures/photometric_stereo.png`:
three photographs, the true normals, those of least squares and those of the network.

References: R. Woodham, "Photometric method for determining surface orientation from multiple
images", Optical Engineering 19 (1980).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from torchradiometry.demo.curve import write_panels
from torchradiometry.deploy import (
    Photographs,
    angular_error,
    estimate_normals,
    find_photograph_sets,
    least_squares_normals,
    read_photographs,
)
from torchradiometry.geometry import depth_to_normals
from torchradiometry.materials import BlinnPhong
from torchradiometry.shade import DepthSettings, ShadeDepth
from torchradiometry.sources import DirectionalSource

ROOT = Path(__file__).resolve().parent.parent
PICTURE, SOURCE = ROOT / "docs" / "pictures" / "photometric_stereo.png", ROOT.parent / "shared/data"
LAMPS = 12
METHODS = {"least squares": least_squares_normals, "network": estimate_normals}


def relief(size: int) -> Tensor:
    """Depth `1 1 size size` of some bumps and a dent in a plate, m; a pixel is 1 / size m."""
    axis = torch.linspace(-1, 1, size)
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    height = 0.0 * x
    for u, v, width, high in (
        (-0.4, 0.35, 0.25, 0.16),
        (0.45, 0.4, 0.2, 0.12),
        (0.0, -0.35, 0.4, 0.18),
    ):
        height = height + high * torch.exp(-((x - u) ** 2 + (y - v) ** 2) / width**2)
    height = height - 0.10 * torch.exp(-((x - 0.5) ** 2 + (y + 0.4) ** 2) / 0.05)
    return (2 - height)[None, None]


def lamps() -> Tensor:
    """Unit directions `12 3`, two rings about the camera."""
    turn = torch.arange(LAMPS) * (2 * math.pi / LAMPS * 2.5)
    tilt = torch.where(torch.arange(LAMPS) % 2 == 0, 0.5, 1.0)
    return torch.stack((tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos()), -1)


def made_up(size: int) -> Photographs:
    """Photographs of the relief, and its true normals."""
    depth, directions = relief(size), lamps()
    axis = torch.linspace(-3, 3, size)
    paint = 0.45 + 0.15 * torch.sin(2 * axis) * torch.cos(3 * axis).unsqueeze(1)
    albedo = torch.stack((paint + 0.2, paint, 0.7 * paint))[None]
    gloss = {"specular": torch.full_like(depth, 0.04), "shininess": torch.full_like(depth, 40.0)}
    settings = DepthSettings(cast_shadows=True, ambient_occlusion=False, bounces=1)
    images = []
    for direction in directions:
        layer = ShadeDepth(
            settings,
            [DirectionalSource(direction, [math.pi])],
            pixel_size=1 / size,
            lobe=BlinnPhong,
        )
        with torch.no_grad():
            images.append(layer(depth, albedo, **gloss)[0].permute(1, 2, 0))
    normal = depth_to_normals(depth, pixel_size=1 / size)[0].permute(1, 2, 0)
    return Photographs(
        torch.stack(images).numpy(),
        np.ones((size, size), dtype=bool),
        directions.numpy(),
        normal.numpy(),
        "relief",
    )


def degrees(photographs: Photographs) -> dict[str, float]:
    """Mean angle of each method to the truth."""
    found = {}
    for name, method in METHODS.items():
        error = angular_error(method(photographs), photographs.ground_truth, photographs.mask)
        found[name] = float(error.mean())
    return found


def main(
    fast: bool = False, out: Path = PICTURE, source: Path = SOURCE / "diligent"
) -> dict[str, dict[str, float]]:
    """Errors in degrees for the relief, and for each real set that there is."""
    photographs = made_up(32 if fast else 96)
    errors = {"relief": degrees(photographs)}
    normals = [photographs.ground_truth, *(method(photographs) for method in METHODS.values())]
    coloured = [((normal + 1) / 2) ** 2.2 for normal in normals]
    seen = [photographs.images[k] / photographs.images.max() * 1.6 for k in (0, 3, 7)]
    titles = ["photograph 1", "photograph 4", "photograph 8", "true normals", *METHODS]
    write_panels(out, [[*seen, *coloured]], titles, scale=1 if fast else 2)
    if not source.is_dir():
        print(f"no photographs in {source.name}: the made-up relief alone")
        return errors
    for path in find_photograph_sets(source)[: 1 if fast else None]:
        real = read_photographs(path)
        chosen = np.random.default_rng(0).permutation(len(real.images))
        if real.ground_truth is not None:
            errors[path.name] = degrees(real.under(chosen[:LAMPS].tolist()))
    return errors


if __name__ == "__main__":
    for name, numbers in main().items():
        print(name, {method: f"{value:.1f} degrees" for method, value in numbers.items()})
