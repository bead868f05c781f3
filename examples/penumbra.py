"""Half shadows: what a lamp of a size leaves on a floor behind the edge of a screen.

The irradiance of a floor point is an integral over the part of the lamp that it sees,

    E(x) = L  int over the visible part of  cos cos / r^2 dA

`visible_irradiance` cuts that part out and integrates it in closed form; shadow rays count how many
of some points of the lamp are seen. Both are drawn along a line across the shadow's edge, and the
exact one moves with the screen: dE/d(screen) is a number, where rays have none.

Where the screen's edge lies straight under the middle of the lamp, half of the lamp is seen from
the point below: E is half of what it is without the screen.

Run it: `python examples/penumbra.py`. It writes `docs/pictures/penumbra.png`.
"""

from __future__ import annotations

import math
from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import Tensor

from torchradiometry.files import linear_to_srgb
from torchradiometry.geometry import polygon_irradiance
from torchradiometry.transport import visible_irradiance

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "penumbra.png"
#: m above the floor: the lamp, and the screen under one half of it
LAMP, SCREEN = 2.0, 0.7
SIZES = (0.1, 0.4, 1.6)
UP = torch.tensor([0.0, 0, 1], dtype=torch.float64)


def lamp(size: float) -> Tensor:
    """A square that shines down, m."""
    h = size / 2
    corners = [[h, -h, LAMP], [-h, -h, LAMP], [-h, h, LAMP], [h, h, LAMP]]
    return torch.tensor(corners, dtype=torch.float64)


def screen(edge: Tensor | float) -> Tensor:
    """A plate with its edge at x = `edge`, reaching far to +x; its corner is at y = 0."""
    edge = torch.as_tensor(edge, dtype=torch.float64)
    fixed = torch.tensor([[0.0, 0, SCREEN], [9, 0, SCREEN], [9, 9, SCREEN], [0, 9, SCREEN]])
    moved = torch.tensor([[1.0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]])
    return (fixed.double() + edge * moved.double()).unsqueeze(0)


def by_rays(points: Tensor, size: float, count: int) -> Tensor:
    """The same irradiance with one shadow ray to each of `count` random points of the lamp."""
    generator = torch.Generator().manual_seed(0)
    shape = (len(points), count, 2)
    place = (torch.rand(*shape, generator=generator, dtype=torch.float64) - 0.5) * size
    target = torch.cat((place, torch.full((*shape[:-1], 1), LAMP, dtype=torch.float64)), -1)
    way = target - points.unsqueeze(1)
    crossing = points.unsqueeze(1) + SCREEN / LAMP * way
    hidden = (crossing[..., 0] > 0) & (crossing[..., 1] > 0)
    r2 = way.square().sum(-1)
    weight = (way[..., 2] / r2.sqrt()).square() / r2 * size**2
    return torch.where(hidden, 0, weight).mean(1)


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Draw pictures and profiles; errors of rays, and two checks of the exact way."""
    pixels = 24 if fast else 140
    axis = torch.linspace(-1, 1, pixels, dtype=torch.float64)
    x, y = torch.meshgrid(axis, axis, indexing="xy")
    floor = torch.stack((x, y, torch.zeros_like(x)), -1).reshape(-1, 3)
    figure = Figure(figsize=(9.6, 2.7), layout="constrained")
    *pictures, profile = figure.subplots(1, 4, width_ratios=[1, 1, 1, 1.7])
    for axes, size in zip(pictures, SIZES, strict=True):
        lit = visible_irradiance(floor, UP.expand_as(floor), lamp(size), screen(0.0))
        shown = (0.9 * lit / lit.max()).reshape(pixels, pixels).flip(0).numpy()
        axes.imshow(linear_to_srgb(shown), cmap="gray", vmin=0, vmax=1)
        axes.set_title(f"a lamp of {size:g} m", fontsize=9)
        axes.set_axis_off()

    size = 0.4
    count = 41 if fast else 161
    line = torch.zeros(count, 3, dtype=torch.float64)
    line[:, 0], line[:, 1] = torch.linspace(-0.4, 0.4, count), 1.5
    exact = visible_irradiance(line, UP.expand_as(line), lamp(size), screen(0.0))
    errors = {}
    for rays, colour in ((4, "0.8"), (64, "0.55")):
        found = by_rays(line, size, rays)
        errors[f"{rays} rays"] = float((found - exact).abs().sum() / exact.sum())
        profile.plot(line[:, 0], found, color=colour, lw=0.9, label=f"{rays} shadow rays")
    profile.plot(line[:, 0], exact, color="C0", lw=1.6, label="exact")
    profile.set(xlabel="across the shadow's edge, m", ylabel="irradiance, W/m²")
    profile.legend(frameon=False, fontsize=8)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)

    below = torch.tensor([[0.0, 1.5, 0.0]], dtype=torch.float64)
    whole = polygon_irradiance(below, UP.expand_as(below), lamp(size))
    half = visible_irradiance(below, UP.expand_as(below), lamp(size), screen(0.0))
    errors["half of the lamp"] = float(half / whole)
    edge = torch.zeros((), dtype=torch.float64, requires_grad=True)
    visible_irradiance(below, UP.expand_as(below), lamp(size), screen(edge)).sum().backward()
    step = 1 / 1024
    ends = [
        visible_irradiance(below, UP.expand_as(below), lamp(size), screen(s)) for s in (step, -step)
    ]
    slope = float((ends[0] - ends[1]) / (2 * step))
    errors["slope over finite difference"] = float(edge.grad) / slope
    assert math.isfinite(slope)
    return errors


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name}: {value:.4f}")
