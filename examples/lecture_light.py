"""Solid angle and irradiance of a panel, and the cosine law.

Run it: `python examples/lecture_light.py`. It writes
`docs/pictures/lecture_light.png`, and prints how far A / r^2 is off at 1 m.
"""

from __future__ import annotations

import math
from pathlib import Path

import torch
from matplotlib.figure import Figure

from torchradiometry.geometry import polygon_irradiance, solid_angle_polygon

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "lecture_light.png"
#: a square of 1 m that shines down, about the vertical axis
PANEL = torch.tensor([[0.5, -0.5, 0], [-0.5, -0.5, 0], [-0.5, 0.5, 0], [0.5, 0.5, 0]]).double()
UP = torch.tensor([0.0, 0, 1]).double()


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Solid angle of a panel by distance, its irradiance over a floor and on a tilted receiver."""
    figure = Figure(figsize=(9.6, 3.1), layout="constrained")
    angle, floor, tilted = figure.subplots(1, 3)
    distance = torch.logspace(-1.5, 1, 20 if fast else 80, dtype=torch.float64)
    below = distance.reshape(-1, 1, 1) * -UP
    exact = solid_angle_polygon(below.squeeze(1), PANEL.expand(len(distance), 4, 3)).abs()
    angle.loglog(distance, exact, label="exact")
    angle.loglog(distance, 1 / distance.square(), "--", label="A / r²")
    angle.axhline(2 * math.pi, color="0.7", lw=0.8)
    angle.text(0.8, 7.5, "half space: 2π", fontsize=8, color="0.4")
    angle.set(xlabel="distance, m", ylabel="solid angle of 1 m², sr", ylim=(5e-3, 1e2))
    angle.legend(frameon=False, fontsize=8)

    size = 24 if fast else 120
    axis = torch.linspace(-2, 2, size, dtype=torch.float64)
    x, y = torch.meshgrid(axis, axis, indexing="xy")
    points = torch.stack((x, y, torch.full_like(x, -1)), -1)
    lit = polygon_irradiance(points, UP.expand_as(points), PANEL)
    drawn = floor.contourf(x, y, lit, 24, cmap="inferno")
    floor.set(title="irradiance of the floor 1 m below, W/m²", aspect="equal", xlabel="m")
    floor.title.set_fontsize(9)
    figure.colorbar(drawn, ax=floor, shrink=0.8)

    tilt = torch.linspace(0, math.pi, 181, dtype=torch.float64)
    normal = torch.stack((tilt.sin(), torch.zeros_like(tilt), tilt.cos()), -1)
    for height in (0.25, 1.0, 4.0):
        turned = polygon_irradiance((-height * UP).expand_as(normal), normal, PANEL)
        tilted.plot(tilt.rad2deg(), turned / turned[0], label=f"panel at {height:g} m")
    tilted.plot(tilt.rad2deg(), tilt.cos().clamp(min=0), "k:", lw=1, label="max(0, cos)")
    tilted.set(xlabel="tilt of the receiver, degrees", ylabel="irradiance, of its value at 0")
    tilted.legend(frameon=False, fontsize=8)
    figure.savefig(out, dpi=110)
    near = 1 / float(solid_angle_polygon((-UP).double(), PANEL).abs())
    return {"A / r^2 over the solid angle at 1 m": near, "irradiance at 1 m": float(lit.max())}


if __name__ == "__main__":
    print({name: round(value, 4) for name, value in main().items()})
