"""A fixed data set on disk: the batches of a training, written once and read back bit for bit.

    folder/manifest.json         what they are: the training's settings, and how many
    folder/00000000.npz ...      item k: one array a field, as the layers made it

Each file appears in one step when it is complete, so a writer that was stopped goes on where it
was, and what it writes is what it would have written. Arrays only, no pickle.

References: NumPy, *NEP 1: a simple file format for NumPy arrays*.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from torchradiometry.archives import read_arrays
from torchradiometry.errors import (
    FileFormatError,
    IndexRangeError,
    InputFileError,
)
from torchradiometry.files import read_json
from torchradiometry.learn.samples.data import Advance
from torchradiometry.learn.samples.images import Observations
from torchradiometry.learn.samples.single_images import SingleImages
from torchradiometry.learn.training.settings import Training
from torchradiometry.learn.training.settings_file import training_from_table, training_table
from torchradiometry.learn.training.steps import Batch
from torchradiometry.places import (
    atomic_path,
    check_folder_place,
    clear_half_files,
    make_folder,
)

__all__ = ["StoredSamples", "write_samples"]

#: what an item of each kind is
BATCHES: dict[str, type[Observations] | type[SingleImages]] = {
    "photometric": Observations,
    "shading": SingleImages,
}
#: of the layout of the folder
LAYOUT = 2


class StoredSamples(Dataset[Batch]):
    """The batches that `write_samples` wrote; item k is equal to the training's, bit for bit.

    Args:
        folder: that it wrote.

    Attributes:
        training: whose batches they are, with as many steps as there are batches.

    Raises:
        InputFileError: no such folder, or batches are missing in it.
        FileFormatError: its manifest is none.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.training = _read_manifest(self.folder)
        self.kind = str(training_table(self.training)["kind"])
        missing = [k for k in range(len(self)) if not _item(self.folder, k).is_file()]
        if missing:
            raise InputFileError(
                str(self.folder),
                f"{len(missing)} of {len(self)} batches missing",
                "write the data set again: it goes on where it was",
            )

    def __len__(self) -> int:
        return self.training.steps

    def __getitem__(self, index: int) -> Batch:
        if not 0 <= index < len(self):
            raise IndexRangeError("index", str(index), f"use 0..{len(self) - 1}")
        path, kind = _item(self.folder, index), BATCHES[self.kind]
        arrays = read_arrays(path, "batch", kind._fields)
        try:
            return kind(*map(torch.from_numpy, arrays))
        except TypeError as error:
            got = f"no batch ({type(error).__name__})"
            raise FileFormatError(str(path), got, "delete it and write it again") from error


def write_samples(
    training: Training,
    folder: str | Path,
    advance: Advance | None = None,
    surfaces_advance: Advance | None = None,
) -> StoredSamples:
    """Write the batches of a training, one for each of its steps; those that are there stay.

    Args:
        training: whose batches; with more steps than before the data set grows.
        folder: made if it is not there.
        advance: called after each as `advance(how many are there, "")`.
        surfaces_advance: called while the bank of surfaces is made.

    Returns:
        The data set.

    Raises:
        InputFileError: no place for the folder, or a file in its place.
        FileFormatError: the folder holds the batches of another training.
    """
    folder = Path(folder)
    training = _prepared(folder, training)
    missing = [k for k in range(training.steps) if not _item(folder, k).exists()]
    if missing:
        samples = training.samples(surfaces_advance)
        for done, k in enumerate(missing, training.steps - len(missing) + 1):
            _write_item(_item(folder, k), samples[k])
            if advance is not None:
                advance(done, "")
    return StoredSamples(folder)


def _prepared(folder: Path, training: Training) -> Training:
    """The folder with its manifest; the training with as many steps as it will hold."""
    check_folder_place(folder, "data set")
    if (folder / "manifest.json").exists():
        held = _read_manifest(folder)
        if replace(held, steps=training.steps) != training:
            raise FileFormatError(
                str(folder), "the data set of other settings", "name another folder"
            )
        training = replace(training, steps=max(held.steps, training.steps))
    make_folder(folder, "data set")
    clear_half_files(folder)
    manifest = {"layout": LAYOUT, "training": training_table(training)}
    with atomic_path(folder / "manifest.json") as temporary:
        temporary.write_text(json.dumps(manifest, indent=2) + "\n")
    return training


def _write_item(path: Path, batch: Batch) -> None:
    arrays: dict[str, Any] = {name: part.numpy() for name, part in batch._asdict().items()}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def _read_manifest(folder: Path) -> Training:
    path = folder / "manifest.json"
    manifest = read_json(path, "data set's manifest")
    try:
        layout, table = manifest["layout"], manifest["training"]
    except (ValueError, KeyError, TypeError) as error:
        raise FileFormatError(
            str(path), f"no manifest ({type(error).__name__})", "write the data set again"
        ) from error
    if layout != LAYOUT:
        raise FileFormatError(str(path), f"layout {layout}", f"write it again, as layout {LAYOUT}")
    return training_from_table(table, str(path))


def _item(folder: Path, index: int) -> Path:
    return folder / f"{index:08d}.npz"
