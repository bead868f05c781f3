"""Checkpoints: the whole state of a training between two steps, in one file.

A checkpoint replaces its predecessor in one step (`files.atomic_path`), so a process that is
killed at any moment leaves the old one or the new one, whole. It is read without pickle's
freedom to run code, and it is refused where it belongs to a training with other settings.
"""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict

import torch
from torch import nn

from torchradiometry.errors import FileFormatError
from torchradiometry.files import atomic_path, check_readable
from torchradiometry.learn.training.settings import Training
from torchradiometry.learn.training.settings_file import training_table

__all__ = ["Curve", "load_checkpoint", "restore_checkpoint", "save_checkpoint"]


class Curve(TypedDict):
    """What the steps left.

    Attributes:
        losses: chord loss of each.
        degrees: mean angle of each.
        seconds: spent on all of them, and on the surfaces before the first.
    """

    losses: list[float]
    degrees: list[float]
    seconds: float


def save_checkpoint(
    path: str | Path,
    training: Training,
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    curve: Curve,
) -> None:
    """Replace the checkpoint at `path` in one step.

    Raises:
        InputFileError: its folder does not exist.
    """
    state = {
        "training": training_table(training),
        "network": network.state_dict(),
        "optimizer": optimizer.state_dict(),
        "curve": curve,
    }
    with atomic_path(path) as temporary:
        torch.save(state, temporary)


def restore_checkpoint(
    path: str | Path,
    training: Training,
    network: nn.Module,
    optimizer: torch.optim.Optimizer | None = None,
) -> Curve:
    """Put a checkpoint's state into a network and an optimiser; the curve up to there.

    Raises:
        InputFileError: no such file.
        FileFormatError: no checkpoint, or one of another training.
    """
    check_readable(path, "checkpoint")
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
        described, curve = state["training"], state["curve"]
    except Exception as error:
        raise FileFormatError(
            str(path), f"no checkpoint ({type(error).__name__})", "name one that train() wrote"
        ) from error
    if described != training_table(training):
        raise FileFormatError(
            str(path), "the checkpoint of another training", "resume with the same settings"
        )
    try:
        network.load_state_dict(state["network"])
        if optimizer is not None:
            optimizer.load_state_dict(state["optimizer"])
        return Curve(losses=curve["losses"], degrees=curve["degrees"], seconds=curve["seconds"])
    except (RuntimeError, ValueError, LookupError, TypeError, AttributeError) as error:
        got = f"weights or a curve that do not fit ({type(error).__name__})"
        raise FileFormatError(str(path), got, "name one that train() wrote") from error


def load_checkpoint(path: str | Path, training: Training) -> nn.Module:
    """The network of a checkpoint, in evaluation mode.

    Raises:
        InputFileError: no such file.
        FileFormatError: not a checkpoint of this training.
    """
    network = training.network()
    restore_checkpoint(path, training, network)
    return network.eval()
