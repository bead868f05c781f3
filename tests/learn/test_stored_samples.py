"""Data sets on disk: the training's own batches bit for bit, whole or named as incomplete."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchradiometry.errors import FileFormatError, IndexRangeError, InputFileError
from torchradiometry.learn.samples.data import (
    PhotometricSamples,
    ShadingSamples,
    SurfaceOptions,
    make_bank,
    make_shapes,
)
from torchradiometry.learn.samples.stored_samples import StoredSamples, write_samples
from torchradiometry.learn.training.loop import train
from torchradiometry.learn.training.settings import PhotometricTraining, ShadingTraining, Training

PHOTOMETRIC = PhotometricTraining(
    steps=4,
    surfaces=SurfaceOptions(shapes=2, pixels=20, lights=12, size=24),
    batch_shapes=3,
    batch_pixels=5,
    cells=8,
    features=16,
    depth=1,
)
SHADING = ShadingTraining(steps=3, images=2, size=24, shapes=5, features=8)


def equal(a: tuple[torch.Tensor, ...], b: tuple[torch.Tensor, ...]) -> bool:
    return type(a) is type(b) and all(torch.equal(x, y) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("training", [PHOTOMETRIC, SHADING])
def test_read_back_they_are_the_batches_that_training_makes(
    tmp_path: Path, training: Training
) -> None:
    done: list[int] = []
    stored = write_samples(training, tmp_path / "data", lambda k, note: done.append(k))
    assert done == list(range(1, training.steps + 1))
    fresh = training.samples()
    assert len(stored) == training.steps
    assert all(equal(stored[k], fresh[k]) for k in range(len(stored)))
    with pytest.raises(IndexRangeError, match="index"):
        stored[len(stored)]
    from_disk, on_the_fly = train(training, samples=stored), train(training)
    assert from_disk.losses == on_the_fly.losses
    assert equal(
        tuple(from_disk.network.state_dict().values()),
        tuple(on_the_fly.network.state_dict().values()),
    )


@pytest.mark.parametrize("training", [PHOTOMETRIC, SHADING])
def test_only_the_surfaces_that_batches_show_are_made(training: Training) -> None:
    made: list[int] = []
    if isinstance(training, ShadingTraining):
        training = replace(training, steps=1, shapes=30)
        every = ShadingSamples(make_shapes(30, 24, training.seed), 1, training.seed, 2)
    else:
        options = replace(training.surfaces, shapes=30)
        training = replace(training, steps=1, surfaces=options)
        bank = make_bank(options, training.seed)
        every = PhotometricSamples(bank, options, 1, training.seed, 3, 5)
    some = training.samples(lambda done, note: made.append(done))
    assert made == list(range(1, training.surfaces_made() + 1))
    assert 1 < len(made) <= 3
    assert equal(some[0], every[0])


def test_a_stopped_writer_goes_on_and_ends_with_the_same_bytes(tmp_path: Path) -> None:
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    write_samples(SHADING, whole)

    def stop(done: int, note: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_samples(SHADING, stopped, stop)
    with pytest.raises(InputFileError, match="1 of 3 batches missing"):
        StoredSamples(stopped)
    before = (stopped / "00000000.npz").stat().st_mtime_ns
    write_samples(SHADING, stopped)
    assert (stopped / "00000000.npz").stat().st_mtime_ns == before
    names = sorted(path.name for path in whole.iterdir())
    assert sorted(path.name for path in stopped.iterdir()) == names
    assert all((whole / n).read_bytes() == (stopped / n).read_bytes() for n in names)


def test_it_grows_and_never_shrinks(tmp_path: Path) -> None:
    write_samples(SHADING, tmp_path / "data")
    assert len(write_samples(replace(SHADING, steps=5), tmp_path / "data")) == 5
    assert len(write_samples(replace(SHADING, steps=2), tmp_path / "data")) == 5


def test_faults_are_named(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    with pytest.raises(InputFileError, match="no such file"):
        StoredSamples(folder)
    with pytest.raises(InputFileError, match="does not exist around it"):
        write_samples(SHADING, folder / "deep")
    stored = write_samples(SHADING, folder)
    with pytest.raises(FileFormatError, match="other settings"):
        write_samples(replace(SHADING, seed=2), folder)
    with pytest.raises(InputFileError, match="a file"):
        write_samples(SHADING, folder / "manifest.json")
    (folder / "00000001.npz").write_bytes(b"half")
    with pytest.raises(FileFormatError, match="no batch"):
        stored[1]
    for text in ("nonsense", "{}", '{"layout": 9, "training": {}}'):
        (folder / "manifest.json").write_text(text)
        with pytest.raises(FileFormatError):
            StoredSamples(folder)
