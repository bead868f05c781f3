"""Checkpoints: the whole state of a training between two steps, in one file.

A checkpoint replaces its predecessor in one step (`places.atomic_path`), so a process that is
killed at any moment leaves the old one or the new one, whole. It is read without pickle's
freedom to run code or to make anything but tensors, after its parts are unpacked within a bound,
and it is refused where it belongs to a training with other settings.
"""

from __future__ import annotations

import io
import pickletools
import zipfile
from pathlib import Path
from typing import Any, TypedDict

import torch
from torch import nn

from torchradiometry.archives import read_parts
from torchradiometry.errors import FileFormatError, InputFileError, ResourceLimitError
from torchradiometry.learn.training.settings import Training
from torchradiometry.learn.training.settings_file import training_table
from torchradiometry.places import atomic_path

__all__ = ["Curve", "load_checkpoint", "restore_checkpoint", "save_checkpoint"]

#: what a checkpoint is made of, and the bytes of its description (weights are beside it)
MADE_OF = {"torch._utils _rebuild_tensor_v2", "torch FloatStorage", "collections OrderedDict"}
MAX_DESCRIPTION = 2**23


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
    held = io.BytesIO()  # a full disk is the system's to tell, not the archive's
    torch.save(state, held)
    with atomic_path(path) as temporary:
        temporary.write_bytes(held.getbuffer())


def restore_checkpoint(
    path: str | Path,
    training: Training,
    network: nn.Module,
    optimizer: torch.optim.Optimizer | None = None,
) -> Curve:
    """Put a checkpoint's state into a network and an optimiser; the curve up to there.

    Raises:
        InputFileError: no such file.
        ResourceLimitError: more than 1 GiB, packed or not.
        FileFormatError: no checkpoint, or one of another training.
    """
    try:
        state = torch.load(_stored(path), map_location="cpu", weights_only=True)
        described, curve = state["training"], state["curve"]
        same = bool(described == training_table(training))
    except (InputFileError, ResourceLimitError):
        raise
    except Exception as error:
        raise FileFormatError(
            str(path), f"no checkpoint ({type(error).__name__})", "name one that train() wrote"
        ) from error
    if not same:
        raise FileFormatError(
            str(path), "the checkpoint of another training", "resume with the same settings"
        )
    try:
        network.load_state_dict(state["network"])
        if optimizer is not None:
            _check_fits(state["optimizer"], optimizer)
            optimizer.load_state_dict(state["optimizer"])
        losses, degrees = ([float(x) for x in curve[key]] for key in ("losses", "degrees"))
        return Curve(losses=losses, degrees=degrees, seconds=float(curve["seconds"]))
    except (RuntimeError, ValueError, LookupError, TypeError, AttributeError) as error:
        got = f"weights or a curve that do not fit ({type(error).__name__})"
        raise FileFormatError(str(path), got, "name one that train() wrote") from error


def _stored(path: str | Path) -> io.BytesIO:
    """The same archive with nothing packed, if its description makes nothing but tensors."""
    plain = io.BytesIO()
    with zipfile.ZipFile(plain, "w") as archive:
        for name, part in read_parts(path, "checkpoint").items():
            if name.endswith(".pkl"):
                _check_description(part)
            archive.writestr(name, part)
    plain.seek(0)
    return plain


def _check_description(part: bytes) -> None:
    """Lists the steps without taking them."""
    if len(part) > MAX_DESCRIPTION:
        raise ValueError(f"a description of {len(part)} bytes")
    for step, argument, _ in pickletools.genops(part):
        if step.name in ("GLOBAL", "STACK_GLOBAL", "INST") and argument not in MADE_OF:
            raise ValueError(f"a {argument}, which is no part of a checkpoint")


def _check_fits(state: dict[str, Any], optimizer: torch.optim.Optimizer) -> None:
    """ValueError where an optimiser's state has other settings or sizes than the network."""
    own = optimizer.state_dict()["param_groups"]
    given, free = state["param_groups"], {"lr": 0.0}
    if [{**group, **free} for group in given] != [{**group, **free} for group in own]:
        raise ValueError("other settings")
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    for number, held in state["state"].items():
        sizes = {value.shape for value in held.values()}
        if not sizes <= {torch.Size(()), parameters[number].shape}:
            raise ValueError("other sizes")


def load_checkpoint(path: str | Path, training: Training) -> nn.Module:
    """The network of a checkpoint, in evaluation mode.

    Raises:
        InputFileError: no such file.
        FileFormatError: not a checkpoint of this training.
    """
    network = training.network()
    restore_checkpoint(path, training, network)
    return network.eval()
