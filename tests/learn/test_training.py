"""Training: it learns, stays silent, and a killed run ends with the same bits."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchradiometry.errors import FileFormatError, InputFileError, OutOfRangeError
from torchradiometry.learn import PhotometricTraining, ShadingTraining, load_checkpoint, train
from torchradiometry.learn.losses import angle_degrees
from torchradiometry.learn.networks import robust_normals
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
