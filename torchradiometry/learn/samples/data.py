"""Training samples by number: sample k of a seed is the same in every run and every worker.

`PhotometricSamples` keeps a bank of surfaces with their shadows and bounces and gives each
training batch new materials, lights, turns and noise. `ShadingSamples` does the same for whole
small images. A bank may hold only the surfaces that the batches show (`surfaces_shown`). Both are
`torch.utils.data.Dataset`s whose items are ready
batches (use `DataLoader(samples, batch_size=None, num_workers=...)`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor
from torch.utils.data import Dataset

from torchradiometry.errors import IndexRangeError, OutOfRangeError, require_kind, require_whole
from torchradiometry.learn.samples.geometry_bank import SurfaceBank, make_surfaces
from torchradiometry.learn.samples.images import Observations, observe
from torchradiometry.learn.samples.lit_shapes import ShapeBank, light_shapes
from torchradiometry.learn.samples.mesh_shapes import mesh_shapes
from torchradiometry.learn.samples.shapes import random_shapes
from torchradiometry.learn.samples.single_images import OBJECTS, SingleImages, photograph

__all__ = [
    "Advance",
    "PhotometricSamples",
    "ShadingSamples",
    "SurfaceOptions",
    "generator_for",
    "make_bank",
    "make_shapes",
    "surfaces_shown",
]

#: called as advance(done, note): how much of a long step is done
Advance = Callable[[int, str], None]


@dataclass(frozen=True)
class SurfaceOptions:
    """How large a bank of surfaces is and what light reaches it.

    Attributes:
        shapes: number of shapes.
        pixels: pixels kept of each.
        lights: lights of each.
        size: pixels along an edge of a shape.
        shadows: cast shadows.
        indirect: light from neighbouring surfaces.
        area: lamps have a size (penumbras), and the room is not quite dark.
    """

    shapes: int = 200
    pixels: int = 400
    lights: int = 100
    size: int = 64
    shadows: bool = True
    indirect: bool = True
    area: bool = True

    def __post_init__(self) -> None:
        for name in ("shapes", "pixels", "lights"):
            if getattr(self, name) < 1:
                raise OutOfRangeError(name, str(getattr(self, name)), "use at least 1")


def generator_for(*numbers: int) -> torch.Generator:
    """A generator that depends on all the numbers (a seed, a step) and on nothing else."""
    state = 0x9E3779B97F4A7C15
    for number in numbers:
        state = ((state ^ (number & 0xFFFFFFFFFFFFFFFF)) * 0xBF58476D1CE4E5B9) % 2**64
        state ^= state >> 31
    return torch.Generator().manual_seed(state % 2**63)


def surfaces_shown(stream: int, seed: int, batches: int, surfaces: int, each: int) -> list[int]:
    """Numbers of the surfaces that a training's batches show: those that a bank needs."""
    drawn = (
        torch.randint(surfaces, (each,), generator=generator_for(seed, stream, k))
        for k in range(batches)
    )
    return torch.cat(list(drawn)).unique().tolist()


def make_bank(
    options: SurfaceOptions,
    seed: int,
    advance: Advance | None = None,
    only: Sequence[int] | None = None,
) -> SurfaceBank:
    """The surfaces of a seed; shape k does not depend on how many there are.

    Args:
        options: how many, and what light reaches them.
        seed: of the surfaces.
        advance: called after each.
        only: numbers of those to make; by default all.
    """
    require_kind("options", options, SurfaceOptions)
    parts = []
    for done, k in enumerate(range(options.shapes) if only is None else only, 1):
        made = make_surfaces(
            1,
            options.pixels,
            options.lights,
            options.size,
            generator_for(seed, 1, k),
            area=options.area,
        )
        parts.append(made)
        if advance is not None:
            advance(done, "surfaces")
    return SurfaceBank(*(torch.cat(each) for each in zip(*parts, strict=True)))


class PhotometricSamples(Dataset[Observations]):
    """Batches for `PhotometricNetwork`; item k is the k-th training step.

    Args:
        bank: from `make_bank`.
        options: the options it was made with.
        batches: how many items there are.
        seed: of materials, lights and noise.
        shapes: shapes in a batch.
        pixels: pixels of each.
        fewest: the smallest number of lights; each batch draws one between this and all.
        only: which of the surfaces the bank holds; by default all.
    """

    STREAM = 2

    def __init__(
        self,
        bank: SurfaceBank,
        options: SurfaceOptions,
        batches: int,
        seed: int,
        shapes: int = 16,
        pixels: int = 32,
        fewest: int = 8,
        only: Sequence[int] | None = None,
    ) -> None:
        self.bank, self.options, self.batches, self.seed = bank, options, batches, seed
        self.shapes, self.pixels, self.fewest = shapes, pixels, fewest
        self.rows = _rows(len(bank.normal), options.shapes, only)

    def __len__(self) -> int:
        return self.batches

    def __getitem__(self, index: int) -> Observations:
        _check_index(index, self.batches)
        generator = generator_for(self.seed, self.STREAM, index)
        which = self.rows[torch.randint(len(self.rows), (self.shapes, 1), generator=generator)]
        available = self.bank.normal.shape[1]
        pixel = torch.randint(available, (self.shapes, self.pixels), generator=generator)
        part = SurfaceBank(
            self.bank.normal[which, pixel],
            self.bank.visibility[which, pixel],
            self.bank.indirect[which, pixel],
            self.bank.openness[which, pixel],
            self.bank.direction[which[:, 0]],
        )
        lights = self._lights(generator)
        kept = self.options
        return observe(part, lights, generator, kept.shadows, kept.indirect, ambient=kept.area)

    def _lights(self, generator: torch.Generator) -> int:
        """Evenly spread on a logarithmic scale."""
        most = self.bank.direction.shape[1]
        fewest = min(self.fewest, most)
        share = float(torch.rand((), generator=generator))
        return min(most, int(fewest * ((most + 1) / fewest) ** share))


def make_shapes(
    shapes: int,
    size: int,
    seed: int,
    advance: Advance | None = None,
    meshes: Sequence[str | Path] = (),
    only: Sequence[int] | None = None,
) -> ShapeBank:
    """The shapes of a seed with their lamps; shape k does not depend on how many there are.

    Args:
        shapes: how many.
        size: pixels along an edge.
        seed: of the shapes.
        advance: called after each.
        meshes: files; where there are any, every second shape is one of them.
        only: numbers of those to make; by default all.

    Raises:
        DTypeError, OutOfRangeError: no whole numbers of at least one shape of 16 pixels.
    """
    require_whole("shapes", shapes, 1)
    require_whole("size", size, 16, 2**14)
    parts = []
    for done, k in enumerate(range(shapes) if only is None else only, 1):
        generator = generator_for(seed, 4, k)
        if meshes and k % 2:
            made = mesh_shapes(meshes, 1, size, generator)
        else:
            made = random_shapes(1, size, generator, OBJECTS)
        parts.append(light_shapes(made, generator))
        if advance is not None:
            advance(done, "shapes")
    return ShapeBank(*(torch.cat(each) for each in zip(*parts, strict=True)))


class ShadingSamples(Dataset[SingleImages]):
    """Batches for `ShadingNetwork`; item k is the k-th training step: new paint, light and camera.

    Args:
        bank: from `make_shapes`.
        batches: how many items there are.
        seed: of materials, lights and noise.
        images: images in a batch.
        shadows: shadows of lamps and of the sky.
        indirect: light that surfaces send each other.
        outline: white objects: nothing but their masks, the control that tells whether shading
            is used.
        shapes: how many shapes there are; by default those of the bank.
        only: which of them the bank holds; by default all.
    """

    STREAM = 3

    def __init__(
        self,
        bank: ShapeBank,
        batches: int,
        seed: int,
        images: int = 16,
        shadows: bool = True,
        indirect: bool = True,
        outline: bool = False,
        shapes: int | None = None,
        only: Sequence[int] | None = None,
    ) -> None:
        self.bank, self.batches, self.seed, self.images = bank, batches, seed, images
        self.shadows, self.indirect, self.outline = shadows, indirect, outline
        self.rows = _rows(len(bank.mask), len(bank.mask) if shapes is None else shapes, only)

    def __len__(self) -> int:
        return self.batches

    def __getitem__(self, index: int) -> SingleImages:
        _check_index(index, self.batches)
        generator = generator_for(self.seed, self.STREAM, index)
        which = self.rows[torch.randint(len(self.rows), (self.images,), generator=generator)]
        part = ShapeBank(*(each[which] for each in self.bank))
        made = photograph(part, generator, self.shadows, self.indirect)
        if self.outline:
            made = made._replace(image=made.mask.repeat(1, 3, 1, 1))
        return made


def _rows(held: int, surfaces: int, only: Sequence[int] | None) -> Tensor:
    """Where in the bank each surface stands; outside of it where it does not."""
    if only is None:
        return torch.arange(held)
    rows = torch.full((surfaces,), held)
    rows[list(only)] = torch.arange(held)
    return rows


def _check_index(index: int, batches: int) -> None:
    if not 0 <= index < batches:
        raise IndexRangeError("index", str(index), f"use 0..{batches - 1}")
