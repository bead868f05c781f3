"""What to train, as typed descriptions: everything that decides the weights, and nothing else.

A description names the data, the network and the optimiser of one training; two runs of the
same description end with the same bits (on one processor with one thread). Where it runs (device,
processes, worker processes for the data) is no part of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import torch

from torchradiometry.errors import OutOfRangeError
from torchradiometry.learn.networks import PhotometricNetwork, ShadingNetwork
from torchradiometry.learn.samples.data import (
    Advance,
    PhotometricSamples,
    ShadingSamples,
    SurfaceOptions,
    make_bank,
    make_shapes,
    surfaces_shown,
)

__all__ = ["KINDS", "PhotometricTraining", "ShadingTraining", "Training", "kind_of"]


@dataclass(frozen=True)
class PhotometricTraining:
    """How to train a `PhotometricNetwork`.

    Attributes:
        steps: optimiser steps; the whole cost.
        surfaces: the bank of surfaces and which light reaches them.
        batch_shapes: shapes in a batch.
        batch_pixels: pixels of each.
        cells: edge of the observation map.
        features: width of the perceptron.
        depth: its hidden layers.
        rate: peak learning rate.
        seed: of data and first weights.
        checkpoint_every: steps between checkpoints.
        bfloat16: multiply matrices in bfloat16 (weights and what they read stay float32).
    """

    steps: int = 1500
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    batch_shapes: int = 16
    batch_pixels: int = 32
    cells: int = 16
    features: int = 384
    depth: int = 3
    rate: float = 1.5e-3
    seed: int = 1
    checkpoint_every: int = 250
    bfloat16: bool = False

    def __post_init__(self) -> None:
        _check_steps(self.steps, self.checkpoint_every)

    def network(self) -> PhotometricNetwork:
        """A network with the first weights of this seed."""
        with _seeded(self.seed):
            return PhotometricNetwork(self.cells, self.features, self.depth)

    def samples(self, advance: Advance | None = None) -> PhotometricSamples:
        """The batches of this seed; making the bank is the long part."""
        shown = self._shown()
        bank = make_bank(self.surfaces, self.seed, advance, shown)
        given = (self.steps, self.seed, self.batch_shapes, self.batch_pixels)
        return PhotometricSamples(bank, self.surfaces, *given, only=shown)

    def surfaces_made(self) -> int:
        """How many surfaces `samples` makes before the first batch: those that batches show."""
        return len(self._shown())

    def _shown(self) -> list[int]:
        stream, many = PhotometricSamples.STREAM, self.surfaces.shapes
        return surfaces_shown(stream, self.seed, self.steps, many, self.batch_shapes)


@dataclass(frozen=True)
class ShadingTraining:
    """How to train a `ShadingNetwork`.

    Attributes:
        steps: optimiser steps; the whole cost.
        images: images in a batch.
        size: pixels along their edge.
        shapes: how many different shapes.
        meshes: files whose shapes every second one is; none: random shapes alone.
        shadows: shadows of lamps and of the sky.
        indirect: light that surfaces send each other.
        outline: show the network nothing but outlines: the control.
        features: channels of the network.
        rate: peak learning rate.
        seed: of data and first weights.
        checkpoint_every: steps between checkpoints.
        bfloat16: multiply matrices in bfloat16 (weights and what they read stay float32).
    """

    steps: int = 3000
    images: int = 16
    size: int = 64
    shapes: int = 1500
    meshes: tuple[str, ...] = ()
    shadows: bool = True
    indirect: bool = True
    outline: bool = False
    features: int = 32
    rate: float = 1.5e-3
    seed: int = 1
    checkpoint_every: int = 250
    bfloat16: bool = False

    def __post_init__(self) -> None:
        _check_steps(self.steps, self.checkpoint_every)

    def network(self) -> ShadingNetwork:
        """A network with the first weights of this seed."""
        with _seeded(self.seed):
            return ShadingNetwork(self.features)

    def samples(self, advance: Advance | None = None) -> ShadingSamples:
        """The batches of this seed; making the shapes is the long part."""
        shown = self._shown()
        bank = make_shapes(self.shapes, self.size, self.seed, advance, self.meshes, shown)
        effects = (self.shadows, self.indirect, self.outline)
        given = (self.steps, self.seed, self.images, *effects)
        return ShadingSamples(bank, *given, shapes=self.shapes, only=shown)

    def surfaces_made(self) -> int:
        """How many surfaces `samples` makes before the first batch: those that batches show."""
        return len(self._shown())

    def _shown(self) -> list[int]:
        stream = ShadingSamples.STREAM
        return surfaces_shown(stream, self.seed, self.steps, self.shapes, self.images)


Training: TypeAlias = PhotometricTraining | ShadingTraining

#: what a settings file, a data set and the command line call them
KINDS: dict[str, type[PhotometricTraining] | type[ShadingTraining]] = {
    "photometric": PhotometricTraining,
    "shading": ShadingTraining,
}


def kind_of(training: Training) -> str:
    """Its name in `KINDS`."""
    return next(name for name, kind in KINDS.items() if isinstance(training, kind))


def _check_steps(steps: int, every: int) -> None:
    if steps < 1 or every < 1:
        raise OutOfRangeError("steps", f"{min(steps, every)}", "use at least 1")


class _seeded:
    """First weights from a seed, leaving the global generator as it was."""

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def __enter__(self) -> None:
        self.state = torch.get_rng_state()
        torch.manual_seed(self.seed)

    def __exit__(self, *_: object) -> None:
        torch.set_rng_state(self.state)
