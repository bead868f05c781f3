"""One list a family; every member is run through every test of its family.

A new source, material, layer, solver or ray caster adds one line here; the completeness test
(`tests/contracts/test_completeness.py`) fails until it does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchradiometry import materials, sources


class Sizes(NamedTuple):
    """Sizes of the axes that stay dynamic in an exported graph."""

    batch: int = 2
    height: int = 3
    width: int = 4
    light: int = 2


SMALL, OTHER = Sizes(), Sizes(3, 5, 2, 4)


def rand(*shape: int, dtype: torch.dtype, seed: int = 0, low: float = 0.1, high: float = 1.0):
    """Reproducible uniform numbers."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(*shape, dtype=dtype, generator=generator) * (high - low) + low


def directions(*shape: int, dtype: torch.dtype, seed: int = 0) -> Tensor:
    """Reproducible unit vectors within about 60 degrees of +z, last axis 3."""
    generator = torch.Generator().manual_seed(seed)
    v = torch.randn(*shape, 3, dtype=dtype, generator=generator) * 0.4
    v[..., 2] = 1
    return v / v.norm(dim=-1, keepdim=True)


class Case(NamedTuple):
    """One member of a family: how to build it, and what to call it with.

    `build(dtype)` gives the module; `inputs(dtype, sizes)` its tensors, in order.
    """

    name: str
    member: object  #: the class or function that this line covers
    build: Callable[[torch.dtype], nn.Module]
    inputs: Callable[[torch.dtype, Sizes], tuple[Tensor, ...]]


def surface_points(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, Tensor]:
    """Positions near the origin and normals about +z, `batch point 3`."""
    points = sizes.height * sizes.width
    position = rand(sizes.batch, points, 3, dtype=dtype, seed=1, low=-0.5, high=0.5)
    return position, directions(sizes.batch, points, dtype=dtype, seed=2)


def surface_directions(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, Tensor, Tensor]:
    """Incident, outgoing and normal directions, `light batch point 3` and `batch point 3`."""
    points = sizes.height * sizes.width
    return (
        directions(sizes.light, sizes.batch, points, dtype=dtype, seed=3),
        directions(sizes.batch, points, dtype=dtype, seed=4),
        directions(sizes.batch, points, dtype=dtype, seed=5) * 0
        + torch.tensor([0, 0, 1.0]).to(dtype),
    )


# fmt: off
SOURCES = [
    Case("directional", sources.DirectionalSource, lambda t: sources.DirectionalSource(directions(2, dtype=t, seed=6), rand(2, 3, dtype=t, seed=7)), surface_points),
]

MATERIALS = [
    Case("lambertian", materials.Lambertian, lambda t: materials.Lambertian(rand(3, dtype=t, seed=8)), surface_directions),
]

LAYERS: list[Case] = [
]

SOLVERS: list[Case] = [
]

RAY_CASTERS: list[object] = [
]
# fmt: on
