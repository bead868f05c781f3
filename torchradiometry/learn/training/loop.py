"""Training by a fixed number of steps: seeded, stoppable, and resumed to the same bit.

Everything random in step k comes from a generator made from (seed, k), so a run that was
killed and resumed from its checkpoint ends with the weights of an undisturbed one. What a step
does is in `steps`, what is kept in `checkpoints`, what is trained in `settings`. Nothing is
printed; progress goes to the callback.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import torch
from torch import nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader, Dataset

from torchradiometry.errors import OutOfRangeError
from torchradiometry.learn.samples.data import Advance
from torchradiometry.learn.training.checkpoints import (
    Curve,
    load_checkpoint,
    restore_checkpoint,
    save_checkpoint,
)
from torchradiometry.learn.training.processes import ALONE, Processes
from torchradiometry.learn.training.settings import PhotometricTraining, ShadingTraining, Training
from torchradiometry.learn.training.steps import Batch, Scored, set_rate, take_step

__all__ = [
    "Machine",
    "PhotometricTraining",
    "ShadingTraining",
    "Trained",
    "Training",
    "load_checkpoint",
    "train",
]


@dataclass(frozen=True)
class Machine:
    """Where a training runs; it changes the time, and the weights at most by rounding.

    Attributes:
        device: of the network.
        workers: processes that make the batches ahead; 0 makes them in turn.
        processes: which of several processes this is, from `joined_processes`.
    """

    device: torch.device = field(default_factory=lambda: torch.device("cpu"))
    workers: int = 0
    processes: Processes = ALONE

    def __post_init__(self) -> None:
        if self.workers < 0:
            raise OutOfRangeError("workers", str(self.workers), "use 0 or more")


class Trained(NamedTuple):
    """What training leaves.

    Attributes:
        network: in evaluation mode.
        losses: chord loss of each step.
        degrees: mean angle of each step, on the synthetic batch before its update.
        seconds: spent in this call, and before its checkpoint in those that it resumes.
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
    samples: Dataset[Batch] | None = None,
    machine: Machine | None = None,
) -> Trained:
    """Train a network from its typed description.

    Args:
        training: what to train and for how many steps.
        advance: called after each step as `advance(steps done, "loss 0.123, 4.5 degrees")`.
        checkpoint: file to keep the state in, replaced atomically.
        resume: continue from `checkpoint` if it exists.
        stop_after: leave after this step, as if interrupted; a checkpoint is kept.
        surfaces_advance: called while the bank of surfaces is made.
        samples: batches by step, instead of those that `training` makes (`StoredSamples`).
        machine: where to run; by default one process on the CPU.

    Returns:
        The network and its learning curve.

    Raises:
        FileFormatError: the checkpoint is none, or of another training.
        InputFileError: the checkpoint's folder does not exist.
        OutOfRangeError: a batch has fewer items than there are processes.
    """
    began = time.perf_counter()
    machine = machine or Machine()
    # channels last: in bfloat16 the convolutions are then twice as fast
    network: nn.Module = training.network().to(machine.device)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimizer = torch.optim.AdamW(network.parameters(), lr=training.rate, weight_decay=1e-4)
    curve = Curve(losses=[], degrees=[], seconds=0.0)
    if resume and checkpoint is not None and Path(checkpoint).exists():
        curve = restore_checkpoint(checkpoint, training, network, optimizer)
    began -= curve["seconds"]
    if samples is None:
        samples = training.samples(surfaces_advance)
    scored = _connected(Scored(network, training.bfloat16), machine)
    last = training.steps if stop_after is None else min(stop_after, training.steps)
    steps = range(len(curve["losses"]), last)
    for step, batch in zip(steps, _batches(samples, steps, machine), strict=True):
        set_rate(optimizer, training, step)
        loss, degrees = take_step(scored, optimizer, batch, machine.processes)
        curve["losses"].append(loss)
        curve["degrees"].append(degrees)
        curve["seconds"] = time.perf_counter() - began
        done = step + 1
        kept = done % training.checkpoint_every == 0 or done == last
        if checkpoint is not None and kept and machine.processes.writes:
            save_checkpoint(checkpoint, training, network, optimizer, curve)
        if advance is not None:
            advance(done, f"loss {loss:.3f}, {degrees:.1f} degrees")
    network.eval()
    return Trained(network, curve["losses"], curve["degrees"], time.perf_counter() - began)


def _connected(scored: Scored, machine: Machine) -> nn.Module:
    """With gradients that are averaged over the processes, where there are several."""
    return DistributedDataParallel(scored) if machine.processes.count > 1 else scored


def _batches(samples: Dataset[Batch], steps: range, machine: Machine) -> Iterable[Batch]:
    """This process's share of the batch of each step, made ahead by the workers if any."""
    made: Iterable[Batch] = (samples[step] for step in steps)
    if machine.workers:
        made = DataLoader(
            samples,
            batch_size=None,
            sampler=steps,
            num_workers=min(machine.workers, max(1, len(steps))),
            generator=torch.Generator(),  # the global one stays as it is
        )
    for batch in made:
        share = machine.processes.share(batch)
        yield type(share)(*(part.to(machine.device) for part in share))
