"""Several processes: the same weights on each, and those of one process up to rounding."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from torchradiometry.errors import OutOfRangeError
from torchradiometry.learn.samples.data import SurfaceOptions
from torchradiometry.learn.training.loop import Machine, train
from torchradiometry.learn.training.processes import ALONE, Processes, started_together
from torchradiometry.learn.training.settings import PhotometricTraining, ShadingTraining, Training
from torchradiometry.learn.training.settings_file import write_training

PHOTOMETRIC = PhotometricTraining(
    steps=6,
    surfaces=SurfaceOptions(shapes=2, pixels=40, lights=12, size=24),
    batch_shapes=5,  # shares of three and of two shapes
    batch_pixels=8,
    cells=8,
    features=16,
    depth=1,
)
#: two images whose masks differ, so that the shares weigh differently
SHADING = ShadingTraining(steps=6, images=2, size=24, shapes=5, features=8)
ONE_OF_TWO = """
import sys, torch
from torchradiometry.learn import Machine, joined_processes, read_training, train
out = sys.argv[1]
torch.set_num_threads(1)
with joined_processes(torch.device("cpu")) as processes:
    assert processes.count == 2
    for name in ("photometric", "shading"):
        trained = train(read_training(f"{out}/{name}.toml"), machine=Machine(processes=processes))
        kept = {"weights": trained.network.state_dict(), "losses": trained.losses}
        torch.save(kept, f"{out}/{name}-{processes.rank}.pt")
"""


@pytest.fixture(scope="module")
def together(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both trainings on two processes, as torchrun starts them."""
    folder = tmp_path_factory.mktemp("together")
    (folder / "one_of_two.py").write_text(ONE_OF_TWO)
    write_training(folder / "photometric.toml", PHOTOMETRIC)
    write_training(folder / "shading.toml", SHADING)
    torchrun = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command = [sys.executable, *torchrun, str(folder / "one_of_two.py"), str(folder)]
    done = subprocess.run(
        command, env={**os.environ, "OMP_NUM_THREADS": "1"}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("training", [PHOTOMETRIC, SHADING])
def test_two_processes_end_with_the_weights_of_one(together: Path, training: Training) -> None:
    name = "photometric" if training is PHOTOMETRIC else "shading"
    first, second = (torch.load(together / f"{name}-{rank}.pt") for rank in (0, 1))
    alone = train(training)
    for key, weight in first["weights"].items():
        assert torch.equal(weight, second["weights"][key])
        # Adam divides by the gradient's size, so rounding of a gradient near 0 shows up to the
        # rate: 6 steps of at most 1.5e-3
        torch.testing.assert_close(
            weight, alone.network.state_dict()[key], rtol=1e-3, atol=0.1 * 6 * training.rate
        )
    assert first["losses"] == second["losses"]
    assert first["losses"] == pytest.approx(alone.losses, rel=1e-3)


def test_every_item_is_in_one_share() -> None:
    batch = SHADING.samples()[0]
    shares = [Processes(rank, 2).share(batch) for rank in (0, 1)]
    for part, *halves in zip(batch, *shares, strict=True):
        assert torch.equal(torch.cat(halves), part)
    assert ALONE.share(batch) is batch
    with pytest.raises(OutOfRangeError, match="2 items for 3 processes"):
        Processes(0, 3).share(batch)


def test_the_environment_says_which_process_this_is(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RANK", "WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    assert started_together() == ALONE
    assert started_together().writes
    monkeypatch.setenv("RANK", "2")
    monkeypatch.setenv("WORLD_SIZE", "3")
    assert started_together() == Processes(2, 3)
    assert not started_together().writes


def test_workers_make_the_same_batches_and_leave_chance_alone() -> None:
    before = torch.get_rng_state()
    ahead = train(SHADING, machine=Machine(workers=2))
    assert torch.equal(torch.get_rng_state(), before)
    assert ahead.losses == train(SHADING).losses
    with pytest.raises(OutOfRangeError, match="workers"):
        Machine(workers=-1)


@pytest.mark.parametrize("training", [PHOTOMETRIC, SHADING])
def test_bfloat16_rounds_products_and_keeps_weights(training: Training) -> None:
    from dataclasses import replace

    exact, rounded = train(training), train(replace(training, bfloat16=True))
    assert rounded.losses != exact.losses
    # 8 bits of mantissa: 2^-8 a product, times a few layers
    assert rounded.losses == pytest.approx(exact.losses, rel=0.03)
    assert {p.dtype for p in rounded.network.parameters()} == {torch.float32}


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("training", [PHOTOMETRIC, SHADING])
def test_a_graphics_card_trains_the_same_network(training: Training) -> None:
    there = train(training, machine=Machine(device=torch.device("cuda")))
    assert there.losses == pytest.approx(train(training).losses, rel=1e-2)
