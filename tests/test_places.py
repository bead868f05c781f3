"""places: what the system says against writing is a named error, and leaves nothing behind."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import torch

from torchradiometry import files
from torchradiometry.demo.curve import draw_learning_curve
from torchradiometry.demo.page import staged_folder, write_page
from torchradiometry.deploy.normals import write_normals
from torchradiometry.errors import FileFormatError, InputFileError, OutputFileError
from torchradiometry.learn.samples.stored_samples import write_samples
from torchradiometry.learn.training.checkpoints import save_checkpoint
from torchradiometry.learn.training.settings import ShadingTraining
from torchradiometry.places import atomic_path, check_folder_place, check_place, make_folder
from torchradiometry.plan import Costs
from torchradiometry.scene.build import cornell_like_room
from torchradiometry.scene.write import save_scene

resource = pytest.importorskip("resource", reason="no limits of files on this system")

RADIANCE = np.random.default_rng(1).uniform(0, 20, (64, 64, 3)).astype(np.float32)
COUNTS = np.random.default_rng(1).integers(0, 2**16, (64, 64, 3), np.uint16)
TRAINING = ShadingTraining(steps=3, images=2, size=24, shapes=5, features=8)


@contextmanager
def longest_file(size: int) -> Iterator[None]:
    """Writes beyond `size` bytes fail within it, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def write_checkpoint(folder: Path) -> None:
    network = torch.nn.Linear(40, 40)
    optimizer = torch.optim.Adam(network.parameters())
    curve = {"losses": [], "degrees": [], "seconds": [0.0, 0.0]}
    save_checkpoint(folder / "a.pt", TRAINING, network, optimizer, curve)


def write_staged(folder: Path) -> None:
    with staged_folder(folder / "page") as stage:
        write_page(stage, "title", "lead", [])


WRITERS: dict[str, Callable[[Path], object]] = {
    "picture .npy": lambda folder: files.write_picture(folder / "a.npy", RADIANCE),
    "picture .exr": lambda folder: files.write_picture(folder / "a.exr", RADIANCE),
    "picture .png": lambda folder: files.write_picture(folder / "a.png", RADIANCE),
    "counts": lambda folder: files.write_counts(folder / "a.png", COUNTS),
    "normals": lambda folder: write_normals(folder / "a.npy", RADIANCE),
    "scene": lambda folder: save_scene(cornell_like_room(), folder / "a.glb"),
    "prices": lambda folder: Costs().save(folder / "a.json"),
    "samples": lambda folder: write_samples(TRAINING, folder / "data"),
    "checkpoint": write_checkpoint,
    "curve": lambda folder: draw_learning_curve(folder / "a.png", [1.0, 0.5], [9.0, 3.0]),
    "page": write_staged,
}


@pytest.mark.parametrize("writer", WRITERS.values(), ids=WRITERS)
def test_a_full_disk_is_named_and_no_file_is_left(
    tmp_path: Path, writer: Callable[[Path], object]
) -> None:
    with pytest.raises(OutputFileError, match="a write that failed"), longest_file(100):
        writer(tmp_path)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_file_that_was_there_survives_a_full_disk(tmp_path: Path) -> None:
    path = files.write_picture(tmp_path / "a.npy", RADIANCE)
    with pytest.raises(OutputFileError), longest_file(100):
        files.write_picture(path, 2 * RADIANCE)
    np.testing.assert_array_equal(files.read_picture(path), RADIANCE)
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_nobody_may_write_in_is_named_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    with pytest.raises(OutputFileError, match="no permission to write in"):
        check_place(tmp_path / "a.npy")
    for name in ("new", "."):
        with pytest.raises(OutputFileError, match="no permission to write in"):
            check_folder_place(tmp_path / name, "page")


def test_a_folder_that_the_system_does_not_make_is_named() -> None:
    if not Path("/proc/self").is_dir():
        pytest.skip("no /proc, where no folder can be made")
    with pytest.raises(OutputFileError, match="/proc/new: got a write that failed"):
        make_folder("/proc/new", "page")


def test_an_error_of_ours_keeps_its_name_while_a_file_is_written(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file"), atomic_path(tmp_path / "a.npy"):
        files.read_picture(tmp_path / "b.npy")
    assert list(tmp_path.iterdir()) == []


def test_endings_are_checked_in_either_case(tmp_path: Path) -> None:
    assert check_place(tmp_path / "a.CSV", (".csv",)) == tmp_path / "a.CSV"
    with pytest.raises(FileFormatError, match=r"the ending '.txt'; use .csv, .json\."):
        check_place(tmp_path / "a.txt", (".csv", ".json"))
