"""Six materials under one lamp, their lobes, and what share they reflect (DHR).

Run it: `python examples/lecture_reflection.py`. It writes
`docs/pictures/lecture_reflection.png`, and prints the share of each material.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import Tensor

from torchradiometry.demo.curve import show_radiance
from torchradiometry.geometry import spherical_direction
from torchradiometry.materials import (
    AbstractMaterial,
    BlinnPhong,
    Lambertian,
    LambertianSpecular,
    Microfacet,
    OrenNayar,
    SumMaterial,
    directional_hemispherical_reflectance,
)
from torchradiometry.shade import shade_points
from torchradiometry.sources import DirectionalSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "lecture_reflection.png"
UP = torch.tensor([0.0, 0, 1]).double()
MATERIALS: dict[str, Callable[[], AbstractMaterial]] = {
    "Lambertian, 0.6": lambda: Lambertian([0.6]),
    "Oren-Nayar, rough 0.9": lambda: OrenNayar([0.6], [0.9]),
    "Phong, n = 20": lambda: LambertianSpecular([0.5], 0.1, 20.0),
    "Phong, n = 200": lambda: LambertianSpecular([0.5], 0.1, 200.0),
    "Blinn-Phong, n = 80": lambda: SumMaterial([Lambertian([0.5]), BlinnPhong([0.1], [80.0])]),
    "microfacets, 0.2": lambda: SumMaterial([OrenNayar([0.5], [0.3]), Microfacet([0.06], [0.2])]),
}


def ball(size: int) -> tuple[Tensor, Tensor]:
    """Normals `point 3` of a ball seen from +z, and which pixels show it."""
    axis = torch.linspace(1.05, -1.05, size, dtype=torch.float64)
    y, x = torch.meshgrid(axis, -axis, indexing="ij")
    square = x.square() + y.square()
    normal = torch.stack((x, y, (1 - square).clamp(min=0).sqrt()), -1)
    return normal[square < 1], square < 1


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Balls, lobes at 45 degrees and reflectances of six materials."""
    figure = Figure(figsize=(9.6, 5.0), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1, 1.5])
    lamp = DirectionalSource([0.6, 0.7, 1.0], [math.pi]).double()
    normal, seen = ball(32 if fast else 160)
    for axes, (name, build) in zip(above.subplots(1, 6), MATERIALS.items(), strict=True):
        picture = torch.zeros(seen.shape, dtype=torch.float64)
        found = shade_points(build().double(), [lamp], None, normal, UP.expand_as(normal))
        picture[seen] = found.squeeze(-1)
        show_radiance(axes, picture, name, 1.0)
    polar = below.add_subplot(1, 2, 1, projection="polar")
    curve = below.add_subplot(1, 2, 2)
    angle = torch.linspace(-math.pi / 2, math.pi / 2, 181, dtype=torch.float64)
    wo = torch.stack((angle.sin(), torch.zeros_like(angle), angle.cos()), -1)
    wi = spherical_direction(torch.tensor(math.pi / 4), torch.tensor(math.pi)).double()
    tilts = torch.linspace(0, 85, 5 if fast else 18)
    shares = {}
    for name, build in MATERIALS.items():
        material = build().double()
        lobe = material(wi.expand_as(wo), wo, UP.expand_as(wo)).squeeze(-1)
        polar.plot(angle, lobe.clamp(max=0.6), lw=1.2)
        dhr = [directional_hemispherical_reflectance(material, math.radians(t)) for t in tilts]
        curve.plot(tilts, [float(share) for share in dhr], lw=1.2, label=name)
        shares[name] = float(dhr[0])
    polar.set(thetamin=-90, thetamax=90, theta_zero_location="N", theta_direction=-1)
    polar.set_title("BRDF for light from 45° on the left, 1/sr (cut at 0.6)", fontsize=9)
    polar.tick_params(labelsize=7)
    curve.set(
        xlabel="angle of incidence, degrees", ylabel="reflected share (DHR)", ylim=(0.4, 0.75)
    )
    curve.legend(frameon=False, fontsize=7)
    figure.savefig(out, dpi=110)
    return shares


if __name__ == "__main__":
    print({name: round(value, 4) for name, value in main().items()})
