"""The pictures of our own that the browser page opens with: a clay figure, made by the layers.

One photograph in sRGB before a plain wall, and a folder of photographs under known lights,

    L = PhongShading(n, rho, k_s, shininess; lights),    counts = floor(256 L)   (linear, 8 bits)

of the same `limbs` shape of `learn.shapes`, painted in two colours.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchradiometry.files import linear_to_srgb, write_counts
from torchradiometry.learn.samples.shapes import random_shapes
from torchradiometry.materials.phong import NormalizedPhong
from torchradiometry.numerics import safe_normalize
from torchradiometry.shade.phong import PhongShading
from torchradiometry.sources.base import AbstractSource
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.dome import AmbientDome

__all__ = ["sample_photograph", "sample_set"]

#: pixels along an edge, and the shape: chosen for its looks
SIDE, SET_SIDE, SEED = 256, 96, 2
CLAY, GLAZE, SHEEN, SHININESS = (0.62, 0.36, 0.24), (0.30, 0.42, 0.55), 0.06, 30.0
#: the wall behind, linear; key light and room
WALL, KEY, ROOM = (0.014, 0.015, 0.017), (-0.5, 0.6, 0.75), 0.25
LIGHTS, SLANT = 8, math.radians(45)


class Figure(NamedTuple):
    """The figure: unit normals and albedo `1 3 H W`, and where it is, `H W`."""

    normal: Tensor
    albedo: Tensor
    mask: Tensor


def sample_photograph() -> dict[str, bytes]:
    """`figure.png`, an sRGB photograph before a plain wall."""
    figure = _figure(SIDE)
    key = DirectionalSource(_unit(KEY), torch.full((3,), 2.6))
    radiance = _shaded(figure, key, AmbientDome(torch.full((3,), ROOM)))
    wall = torch.tensor(WALL).view(3, 1, 1)
    picture = torch.where(figure.mask, radiance, wall).permute(1, 2, 0).numpy()
    return {"figure.png": _png(np.round(255 * linear_to_srgb(picture)).astype(np.uint8))}


def sample_set() -> dict[str, bytes]:
    """`001.png` ... under a ring of lights and one above, with mask and light files."""
    figure = _figure(SET_SIDE)
    turns = [2 * math.pi * k / (LIGHTS - 1) for k in range(LIGHTS - 1)]
    aside, up = math.sin(SLANT), math.cos(SLANT)
    directions = [(aside * math.cos(t), aside * math.sin(t), up) for t in turns] + [(0, 0, 1)]
    files = {"mask.png": _png((255 * figure.mask).to(torch.uint8).numpy())}
    for number, direction in enumerate(directions, 1):
        light = DirectionalSource(_unit(direction), torch.full((3,), math.pi))
        radiance = _shaded(figure, light) * figure.mask
        counts = (256 * radiance).clamp(0, 255).to(torch.uint8)
        files[f"{number:03d}.png"] = _png(counts.permute(1, 2, 0).numpy())
    rows = "\n".join(" ".join(f"{v:.6f}" for v in direction) for direction in directions)
    files["light_directions.txt"] = f"{rows}\n".encode()
    files["light_intensities.txt"] = ("1 1 1\n" * LIGHTS).encode()
    return files


def _figure(side: int) -> Figure:
    generator = torch.Generator().manual_seed(SEED)
    shapes = random_shapes(1, side, generator, ("limbs",))
    across = torch.linspace(-1, 1, side).view(1, 1, side)
    glazed = torch.sin(9 * across + 4 * across.mT) > 0.55
    clay, glaze = (torch.tensor(colour).view(1, 3, 1, 1) for colour in (CLAY, GLAZE))
    albedo = torch.where(glazed, glaze, clay).expand_as(shapes.normal)
    return Figure(shapes.normal, albedo, shapes.mask[0])


def _shaded(figure: Figure, *sources: AbstractSource) -> Tensor:
    """Radiance `3 H W`."""
    layer = PhongShading(NormalizedPhong, sources)
    gloss = torch.full_like(figure.albedo, SHEEN)
    return layer(figure.normal, figure.albedo, gloss, torch.full_like(gloss[:, :1], SHININESS))[0]


def _unit(direction: tuple[float, ...]) -> Tensor:
    return safe_normalize(torch.tensor(direction, dtype=torch.float32))


def _png(counts: NDArray[np.uint8]) -> bytes:
    """A PNG file in memory."""
    with tempfile.TemporaryDirectory() as folder:
        return write_counts(Path(folder) / "picture.png", counts).read_bytes()
