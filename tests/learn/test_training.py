"""Training: it learns, stays silent, and a killed run ends with the same bits."""

import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchradiometry import archives
from torchradiometry.errors import (
    FileFormatError,
    InputFileError,
    OutOfRangeError,
    ResourceLimitError,
)
from torchradiometry.learn import PhotometricTraining, ShadingTraining, load_checkpoint, train
from torchradiometry.learn.lambert_fit import robust_normals
from torchradiometry.learn.losses import angle_degrees
from torchradiometry.learn.samples.data import SurfaceOptions

PHOTOMETRIC = PhotometricTraining(
    steps=40,
    surfaces=SurfaceOptions(shapes=4, pixels=50, lights=16, size=24),
    batch_shapes=4,
    batch_pixels=16,
    cells=8,
    features=32,
    depth=1,
    checkpoint_every=4,
)
SHADING = ShadingTraining(steps=6, images=2, size=24, shapes=5, features=8, checkpoint_every=2)


@pytest.mark.parametrize("training", [PHOTOMETRIC, SHADING])
def test_resumed_training_ends_with_the_same_bits(
    tmp_path: Path, training: PhotometricTraining | ShadingTraining
) -> None:
    whole = train(training)
    kept = tmp_path / "checkpoint.pt"
    middle = training.steps // 2 - 1
    train(training, checkpoint=kept, stop_after=middle)
    steps: list[int] = []
    resumed = train(training, lambda done, note: steps.append(done), checkpoint=kept, resume=True)
    assert steps == list(range(middle + 1, training.steps + 1))
    assert resumed.losses == whole.losses
    for a, b in zip(whole.network.parameters(), resumed.network.parameters(), strict=True):
        assert torch.equal(a, b)
    loaded = load_checkpoint(kept, training)
    for a, b in zip(whole.network.parameters(), loaded.parameters(), strict=True):
        assert torch.equal(a, b)
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint.pt"]


def test_training_beats_the_robust_fit(capsys: pytest.CaptureFixture[str]) -> None:
    """A fresh network answers with the robust fit exactly; a short training improves on it."""
    training = replace(PHOTOMETRIC, steps=300, batch_shapes=8)
    trained, fresh = train(training), training.network().eval()
    assert not trained.network.training
    batches = [training.samples()[k] for k in range(10)]

    def degrees(network: torch.nn.Module) -> float:
        with torch.no_grad():
            found = [network(b.intensity, b.direction) for b in batches]
        errors = [angle_degrees(n, b.normal) for n, b in zip(found, batches, strict=True)]
        return float(torch.cat(errors).mean())

    start = [robust_normals(b.intensity, b.direction) for b in batches]
    fitted = torch.cat([angle_degrees(n, b.normal) for n, b in zip(start, batches, strict=True)])
    assert degrees(fresh) == pytest.approx(float(fitted.mean()), rel=1e-3)
    assert degrees(trained.network) < 0.95 * degrees(fresh)
    assert capsys.readouterr() == ("", "")


def test_training_leaves_the_global_generator_alone() -> None:
    before = torch.get_rng_state()
    train(SHADING, stop_after=1)
    assert torch.equal(torch.get_rng_state(), before)


def test_faults_of_checkpoints(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.pt"
    with pytest.raises(InputFileError, match="no such file"):
        load_checkpoint(path, SHADING)
    path.write_bytes(b"nothing")
    with pytest.raises(FileFormatError, match="no checkpoint"):
        train(SHADING, checkpoint=path, resume=True)
    train(SHADING, checkpoint=path, stop_after=1)
    with pytest.raises(FileFormatError, match="another training"):
        load_checkpoint(path, ShadingTraining(steps=7))
    with pytest.raises(InputFileError, match="does not exist"):
        train(SHADING, checkpoint=tmp_path / "absent" / "c.pt", stop_after=1)
    with pytest.raises(OutOfRangeError, match="steps"):
        ShadingTraining(steps=0)


class Allocation:
    """Pickled as a call that makes 30 MB of zeros: no code of its own, and no tensor."""

    def __reduce__(self) -> tuple[type, tuple[int]]:
        return bytearray, (3 * 10**7,)


def changed(path: Path, key: str, value: object) -> Path:
    """A copy of a checkpoint in which one entry is another one."""
    state = torch.load(path, weights_only=True)
    *outer, last = key.split("/")
    place = state
    for name in outer:
        place = place[int(name) if name.isdigit() else name]
    place[last] = value
    torch.save(state, path.parent / "changed.pt")
    return path.parent / "changed.pt"


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("training/steps", Allocation()),
        ("training/steps", torch.zeros(2)),
        ("curve/losses", [[1.0]]),
        ("optimizer/param_groups/0/betas", ("a", "b")),
        ("optimizer/state/0/exp_avg", torch.zeros(1).expand(2**40)),
        ("optimizer/state/0/exp_avg", torch.zeros((), dtype=torch.float64).expand(2**40)),
    ],
)
def test_a_checkpoint_that_means_something_else_is_named(
    tmp_path: Path, key: str, value: object
) -> None:
    path = tmp_path / "checkpoint.pt"
    train(SHADING, checkpoint=path, stop_after=1)
    hostile = changed(path, key, value)
    with pytest.raises(FileFormatError):
        train(SHADING, checkpoint=hostile, resume=True)


def test_a_packed_checkpoint_unpacks_within_a_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """torch itself would unpack any number of bytes."""
    plain, small = tmp_path / "checkpoint.pt", tmp_path / "small.pt"
    train(SHADING, checkpoint=plain, stop_after=1)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(small, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            new.writestr(name, old.read(name))
    weights, same = load_checkpoint(plain, SHADING), load_checkpoint(small, SHADING)
    assert all(map(torch.equal, weights.state_dict().values(), same.state_dict().values()))
    monkeypatch.setattr(archives, "MAX_BYTES", 1000)
    with pytest.raises(ResourceLimitError, match="when unpacked"):
        load_checkpoint(small, SHADING)
