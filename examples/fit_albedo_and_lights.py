"""Paint and lamps from photographs, by gradient descent through a layer.

A ball was photographed six times under one lamp each, in the dark. Neither its paint nor any of the
lamps is known; its shape is. The layer that makes pictures is turned round:

    minimise over albedo, directions, irradiances    mean (LambertianShading - photographs)^2

by Adam. Photographs say nothing of who is bright, the paint or the lamps: as in every such problem
one factor is free, and here the mean of the paint is held at its true value.

Errors: mean angle of the lamps' directions, and relative L1 of paint and irradiances.

Run it: `python examples/fit_albedo_and_lights.py`. It writes
`docs/pictures/fit_albedo_and_lights.png`: three photographs; the paint, and what was found of it
after 10, 50 and all steps.
"""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from torchradiometry.demo.curve import write_panels
from torchradiometry.shade import LambertianShading
from torchradiometry.sources import DirectionalSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "fit_albedo_and_lights.png"
PHOTOGRAPHS, NOISE = 6, 0.002
#: steps after which the paint is shown
SHOWN = (10, 50)


def ball(size: int) -> tuple[Tensor, Tensor]:
    """Normals `1 3 size size` of a ball, and its mask."""
    axis = torch.linspace(-1.05, 1.05, size)
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    square = x.square() + y.square()
    inside = (square < 1).float()
    normal = torch.stack((x, y, (1 - square).clamp(min=0).sqrt())) * inside
    return normal[None], inside[None, None]


def paint(normal: Tensor) -> Tensor:
    """Stripes and dots in three colours, 0.1 to 0.8, `1 3 H W`."""
    x, y, z = normal[0]
    stripe = torch.sigmoid(12 * torch.sin(7 * x + 2 * y))
    dots = torch.sigmoid(10 * (torch.cos(9 * y) * torch.cos(9 * z) - 0.4))
    colours = torch.tensor([[0.8, 0.25, 0.2], [0.2, 0.5, 0.75], [0.75, 0.7, 0.3]])
    mixed = colours[0] * stripe[..., None] + colours[1] * (1 - stripe[..., None])
    return torch.lerp(mixed, colours[2], dots[..., None]).permute(2, 0, 1)[None]


def true_lamps() -> DirectionalSource:
    """One lamp for each photograph."""
    turn = torch.arange(PHOTOGRAPHS) * (2 * math.pi / PHOTOGRAPHS) + 0.3
    tilt = torch.linspace(0.35, 0.9, PHOTOGRAPHS)
    direction = torch.stack((tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos()), -1)
    strength = torch.linspace(1.5, 3.5, PHOTOGRAPHS).unsqueeze(-1)
    return DirectionalSource(direction.unsqueeze(1), strength.unsqueeze(1))


@torch.no_grad()
def errors_of(albedo: Tensor, truth: Tensor, found: DirectionalSource, lamps: DirectionalSource):
    """Degrees of the directions, relative L1 of paint and irradiances."""
    cosine = functional.cosine_similarity(found.direction, lamps.direction, dim=-1).clamp(-1, 1)
    return {
        "directions, degrees": float(cosine.acos().rad2deg().mean()),
        "irradiance": float((found.irradiance / lamps.irradiance - 1).abs().mean()),
        "paint": float((albedo - truth).abs().sum() / truth.sum()),
    }


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Fit; errors at the end."""
    size, steps = (24, 300) if fast else (112, 600)
    normal, inside = ball(size)
    truth, lamps, layer = paint(normal), true_lamps(), LambertianShading()
    normals = normal.expand(PHOTOGRAPHS, -1, -1, -1)
    generator = torch.Generator().manual_seed(0)
    seen = layer(normals, truth.expand(PHOTOGRAPHS, -1, -1, -1), lamps)
    seen = (seen + NOISE * torch.randn(seen.shape, generator=generator)) * inside
    mean = (truth * inside).sum() / inside.sum() / 3

    raw = torch.zeros_like(truth, requires_grad=True)
    facing = torch.tensor([[[0.0, 0, 1]]]).expand(PHOTOGRAPHS, -1, -1)
    found = DirectionalSource(facing, torch.full((PHOTOGRAPHS, 1, 1), 2.0), learnable=True)
    groups = [{"params": [raw], "lr": 0.1}, {"params": list(found.parameters()), "lr": 0.03}]
    optimiser = torch.optim.Adam(groups)
    shown = []

    def albedo() -> Tensor:
        values = raw.sigmoid()
        return values * (mean * 3 * inside.sum() / (values * inside).sum())

    for step in range(steps):
        for group, rate in zip(groups, (0.1, 0.03), strict=True):
            group["lr"] = rate * 0.5 * (1 + math.cos(math.pi * step / steps))
        optimiser.zero_grad()
        picture = layer(normals, albedo().expand(PHOTOGRAPHS, -1, -1, -1), found)
        ((picture - seen) * inside).square().mean().backward()
        optimiser.step()
        if step + 1 in SHOWN:
            shown.append((albedo() * inside).detach())
    with torch.no_grad():
        fitted = albedo() * inside
    first = [seen[k : k + 1] / seen.max() for k in (0, 2, 4)]
    panels = [p[0].permute(1, 2, 0).numpy() for p in (*first, truth * inside, *shown, fitted)]
    titles = [f"photograph {k + 1}" for k in (0, 2, 4)] + ["true paint"]
    titles += [f"after {step} steps" for step in (*SHOWN, steps)]
    write_panels(out, [panels], titles)
    return errors_of(fitted, truth * inside, found, lamps)


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name}: {value:.4f}")
