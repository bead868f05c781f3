"""Training by a fixed number of steps: seeded, stoppable, and resumed to the same bit.

    theta_{k+1} = AdamW(theta_k, gradient of chord_loss(network(batch_k), truth_k)),
    rate_k = rate * min(1, k/warm) * (1 + cos(pi k / steps)) / 2

Everything random in step k comes from a generator made from (seed, k), so a run that was
killed and resumed from its checkpoint ends with the weights of an undisturbed one. Checkpoints
replace each other atomically. Nothing is printed; progress goes to the callback.

References: I. Loshchilov and F. Hutter, "Decoupled weight decay regularization", ICLR 2019,
and "SGDR", ICLR 2017 (the cosine).
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeAlias

import torch
from torch import Tensor, nn

from torchradiometry.errors import FileFormatError, OutOfRangeError
from torchradiometry.files import atomic_path, check_readable
from torchradiometry.learn.data import (
    Advance,
    PhotometricSamples,
    ShadingSamples,
    SurfaceOptions,
    make_bank,
    make_shapes,
)
from torchradiometry.learn.images import Observations
from torchradiometry.learn.losses import albedo_loss, angle_degrees, chord_loss
from torchradiometry.learn.networks import (
    PhotometricNetwork,
    ShadingNetwork,
    relative_to_mean,
)
from torchradiometry.learn.single_images import SingleImages

__all__ = [
    "PhotometricTraining",
    "ShadingTraining",
    "Trained",
    "Training",
    "load_checkpoint",
    "train",
]

Batch: TypeAlias = Observations | SingleImages

#: what the albedo counts beside the normals
PAINT = 0.1


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

    def __post_init__(self) -> None:
        _check_steps(self.steps, self.checkpoint_every)

    def network(self) -> PhotometricNetwork:
        """A network with the first weights of this seed."""
        with _seeded(self.seed):
            return PhotometricNetwork(self.cells, self.features, self.depth)

    def samples(self, advance: Advance | None = None) -> PhotometricSamples:
        """The batches of this seed; making the bank is the long part."""
        bank = make_bank(self.surfaces, self.seed, advance)
        return PhotometricSamples(
            bank, self.surfaces, self.steps, self.seed, self.batch_shapes, self.batch_pixels
        )


@dataclass(frozen=True)
class ShadingTraining:
    """How to train a `ShadingNetwork`.

    Attributes:
        steps: optimiser steps; the whole cost.
        images: images in a batch.
        size: pixels along their edge.
        shapes: how many different shapes.
        shadows: shadows of lamps and of the sky.
        outline: show the network nothing but outlines: the control.
        features: channels of the network.
        rate: peak learning rate.
        seed: of data and first weights.
        checkpoint_every: steps between checkpoints.
    """

    steps: int = 400
    images: int = 8
    size: int = 64
    shapes: int = 1500
    shadows: bool = True
    outline: bool = False
    features: int = 32
    rate: float = 1.5e-3
    seed: int = 1
    checkpoint_every: int = 250

    def __post_init__(self) -> None:
        _check_steps(self.steps, self.checkpoint_every)

    def network(self) -> ShadingNetwork:
        """A network with the first weights of this seed."""
        with _seeded(self.seed):
            return ShadingNetwork(self.features)

    def samples(self, advance: Advance | None = None) -> ShadingSamples:
        """The batches of this seed; making the shapes is the long part."""
        bank = make_shapes(self.shapes, self.size, self.seed, advance)
        return ShadingSamples(bank, self.steps, self.seed, self.images, self.shadows, self.outline)


Training: TypeAlias = PhotometricTraining | ShadingTraining


class Trained(NamedTuple):
    """What training leaves.

    Attributes:
        network: in evaluation mode.
        losses: chord loss of each step.
        degrees: mean angle of each step, on the synthetic batch before its update.
        seconds: spent in this call (a resumed run counts its own part).
    """

    network: nn.Module
    losses: list[float]
    degrees: list[float]
    seconds: float


def train(
    training: Training,
    advance: Advance | None = None,
    *,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    stop_after: int | None = None,
    surfaces_advance: Advance | None = None,
) -> Trained:
    """Train a network from its typed description.

    Args:
        training: what to train and for how many steps.
        advance: called after each step as `advance(steps done, "x.x degrees")`.
        checkpoint: file to keep the state in, replaced atomically.
        resume: continue from `checkpoint` if it exists.
        stop_after: leave after this step, as if interrupted; a checkpoint is kept.
        surfaces_advance: called while the bank of surfaces is made.

    Returns:
        The network and its learning curve.

    Raises:
        FileFormatError: the checkpoint is none, or of another training.
        InputFileError: the checkpoint's folder does not exist.
    """
    began = time.perf_counter()
    network = training.network()
    optimizer = torch.optim.AdamW(network.parameters(), lr=training.rate, weight_decay=1e-4)
    curve: dict[str, list[float]] = {"losses": [], "degrees": []}
    if resume and checkpoint is not None and Path(checkpoint).exists():
        _restore(checkpoint, training, network, optimizer, curve)
    samples = training.samples(surfaces_advance)
    last = training.steps if stop_after is None else min(stop_after, training.steps)
    for step in range(len(curve["losses"]), last):
        _set_rate(optimizer, training, step)
        loss, degrees = _step(network, optimizer, samples[step])
        curve["losses"].append(loss)
        curve["degrees"].append(degrees)
        done = step + 1
        if checkpoint is not None and (done % training.checkpoint_every == 0 or done == last):
            _save(checkpoint, training, network, optimizer, curve)
        if advance is not None:
            advance(done, f"{degrees:.1f} degrees")
    network.eval()
    return Trained(network, curve["losses"], curve["degrees"], time.perf_counter() - began)


def load_checkpoint(path: str | Path, training: Training) -> nn.Module:
    """The network of a checkpoint, in evaluation mode.

    Raises:
        InputFileError: no such file.
        FileFormatError: not a checkpoint of this training.
    """
    network = training.network()
    _restore(path, training, network, None, {})
    return network.eval()


def _step(
    network: nn.Module, optimizer: torch.optim.Optimizer, batch: Batch
) -> tuple[float, float]:
    """One update; the loss and the mean angle before it."""
    network.train()
    found, truth, weight, besides = _answer(network, batch)
    loss = chord_loss(found, truth, weight) + besides
    optimizer.zero_grad(set_to_none=True)
    torch.autograd.backward(loss)
    nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimizer.step()
    with torch.no_grad():
        angle = angle_degrees(found.detach(), truth)
        mean = angle.mean() if weight is None else (angle * weight).sum() / weight.sum()
    return float(loss.detach()), float(mean)


def _answer(
    network: nn.Module, batch: Batch
) -> tuple[Tensor, Tensor, Tensor | None, Tensor | float]:
    """Found and true normals with the vector last, the weight of each pixel, and other losses."""
    if isinstance(batch, Observations):
        return network(batch.intensity, batch.direction), batch.normal, None, 0.0
    found, paint = network(batch.image, batch.mask)
    besides = PAINT * albedo_loss(paint, relative_to_mean(batch.albedo, batch.mask), batch.mask)
    weight = batch.mask.squeeze(1)
    return found.movedim(1, -1), batch.normal.movedim(1, -1), weight, besides


def _set_rate(optimizer: torch.optim.Optimizer, training: Training, step: int) -> None:
    warm = min(1.0, (step + 1) / min(100, max(1, training.steps // 10)))
    falling = (1 + math.cos(math.pi * step / training.steps)) / 2
    for group in optimizer.param_groups:
        group["lr"] = training.rate * warm * falling


def _save(
    path: str | Path,
    training: Training,
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    curve: dict[str, list[float]],
) -> None:
    state = {
        "training": _description(training),
        "network": network.state_dict(),
        "optimizer": optimizer.state_dict(),
        "curve": curve,
    }
    with atomic_path(path) as temporary:
        torch.save(state, temporary)


def _restore(
    path: str | Path,
    training: Training,
    network: nn.Module,
    optimizer: torch.optim.Optimizer | None,
    curve: dict[str, list[float]],
) -> None:
    check_readable(path, "checkpoint")
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
        described = state["training"]
    except Exception as error:
        raise FileFormatError(
            str(path), f"no checkpoint ({type(error).__name__})", "name one that train() wrote"
        ) from error
    if described != _description(training):
        raise FileFormatError(
            str(path), "the checkpoint of another training", "resume with the same settings"
        )
    network.load_state_dict(state["network"])
    if optimizer is not None:
        optimizer.load_state_dict(state["optimizer"])
        curve.update(state["curve"])


def _description(training: Training) -> dict[str, object]:
    return {"kind": type(training).__name__, **asdict(training)}


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
