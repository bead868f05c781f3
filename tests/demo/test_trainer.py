"""Training as a command: a complete folder, and the same bits after any kind of stop."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchradiometry.demo import dataset_folder, train_folder
from torchradiometry.demo.trainer import torch_threads
from torchradiometry.deploy.runtime import open_model
from torchradiometry.errors import FileFormatError, InputFileError, OutOfRangeError
from torchradiometry.export import OnnxCheck
from torchradiometry.learn.samples.data import SurfaceOptions
from torchradiometry.learn.training.checkpoints import load_checkpoint
from torchradiometry.learn.training.loop import train
from torchradiometry.learn.training.settings import (
    PhotometricTraining,
    ShadingTraining,
    Training,
    kind_of,
)
from torchradiometry.learn.training.settings_file import read_training, write_training

PHOTOMETRIC = PhotometricTraining(
    steps=8,
    surfaces=SurfaceOptions(shapes=2, pixels=40, lights=12, size=24),
    batch_shapes=4,
    batch_pixels=8,
    cells=8,
    features=16,
    depth=1,
    checkpoint_every=3,
)
SHADING = ShadingTraining(steps=4, images=2, size=24, shapes=5, features=8, checkpoint_every=3)
FILES = ["checkpoint.pt", "curve.png", "metrics.json", "model.onnx", "training.toml"]


def same_weights(folder: Path, training: Training) -> bool:
    """Whether a folder's checkpoint has the weights of an undisturbed training."""
    with torch_threads(1):
        expected = train(training).network.state_dict()
    found = load_checkpoint(folder / "checkpoint.pt", training).state_dict()
    return all(torch.equal(found[name], expected[name]) for name in expected)


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "torchradiometry", "train", *map(str, arguments)]


def touch(network: torch.nn.Module, path: Path) -> OnnxCheck:
    """An empty model.onnx: the exporter takes seconds."""
    path.touch()
    return OnnxCheck(0.0, 0.0, (), True, 0.0)


@pytest.fixture
def no_export(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torchradiometry.demo.trainer.export_network", touch)


@pytest.mark.parametrize("training", [PHOTOMETRIC, SHADING], ids=kind_of)
def test_a_training_leaves_a_complete_folder(tmp_path: Path, training: Training) -> None:
    config = write_training(tmp_path / "mine.toml", replace(training, steps=3))
    out = tmp_path / "out"
    report = train_folder(kind_of(training), out, config=config, steps=training.steps)
    assert sorted(path.name for path in out.iterdir()) == FILES
    assert json.loads((out / "metrics.json").read_text()).items() <= report.items()
    assert read_training(out / "training.toml") == training
    assert same_weights(out, training)
    assert open_model(out / "model.onnx").outputs[0] == "normal"
    assert report["onnx_degrees"] < 0.05
    assert report["bytes"] == (out / "model.onnx").stat().st_size
    assert 0 < report["degrees"] < 90


@pytest.mark.usefixtures("no_export")
def test_the_same_command_never_destroys_a_training(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = write_training(tmp_path / "t.toml", SHADING)
    train_folder("shading", tmp_path, config=config, resume=True)
    assert f"no checkpoint in {tmp_path}: the training begins anew" in capsys.readouterr().err
    before = (tmp_path / "checkpoint.pt").read_bytes()
    with pytest.raises(InputFileError, match="there already; pass --resume"):
        train_folder("shading", tmp_path)
    with pytest.raises(FileFormatError, match="another training"):
        train_folder("shading", tmp_path, resume=True, steps=9)
    assert (tmp_path / "checkpoint.pt").read_bytes() == before
    again = train_folder("shading", tmp_path, resume=True)  # nothing is left to do
    assert "begins anew" not in capsys.readouterr().err
    assert again["training"]["steps"] == SHADING.steps
    assert (tmp_path / "checkpoint.pt").read_bytes() == before


@pytest.mark.slow
@pytest.mark.usefixtures("no_export")
@pytest.mark.parametrize("training", [PHOTOMETRIC, SHADING], ids=kind_of)
def test_killed_and_resumed_it_ends_with_the_same_bits(tmp_path: Path, training: Training) -> None:
    """SIGKILL once a checkpoint is there, wherever the process is then."""
    training = replace(training, steps=40, checkpoint_every=2)
    config, out = write_training(tmp_path / "t.toml", training), tmp_path / "out"
    line = command(kind_of(training), "--config", config, "--out", out)
    killed = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    while not (out / "checkpoint.pt").exists():
        assert killed.poll() is None, killed.stderr.read()
        time.sleep(0.01)
    killed.kill()
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    reached = len(torch.load(out / "checkpoint.pt")["curve"]["losses"])
    assert 0 < reached < training.steps
    assert not (out / "metrics.json").exists()
    (out / ".halfhalf.tmp.pt").touch()  # killed while it wrote
    train_folder(kind_of(training), out, resume=True)
    assert sorted(path.name for path in out.iterdir()) == FILES
    assert same_weights(out, training)


@pytest.mark.slow
def test_ctrl_c_keeps_the_last_checkpoint_and_says_how_to_go_on(tmp_path: Path) -> None:
    training = replace(SHADING, steps=10000, checkpoint_every=2)
    config, out = write_training(tmp_path / "t.toml", training), tmp_path / "out"
    line = command("shading", "--config", config, "--out", out)
    stopped = subprocess.Popen(
        line,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # a shell's background job ignores Ctrl-C, and so would what it starts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    while not (out / "checkpoint.pt").exists():
        assert stopped.poll() is None, stopped.stderr.read()
        time.sleep(0.01)
    stopped.send_signal(signal.SIGINT)
    printed, said = stopped.communicate()
    assert (stopped.returncode, printed) == (130, "")
    (sentence,) = [each for each in said.splitlines() if each.startswith("torchradiometry: ")]
    assert sentence.endswith(f"the last checkpoint is kept, go on with --resume --out {out}.")
    assert "Traceback" not in said
    assert sorted(path.name for path in out.iterdir()) == ["checkpoint.pt", "training.toml"]
    load_checkpoint(out / "checkpoint.pt", training)


def test_an_interrupt_before_the_first_checkpoint_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("torchradiometry.demo.trainer.train", interrupted)
    with pytest.raises(KeyboardInterrupt, match="before the first checkpoint"):
        train_folder("shading", tmp_path)


@pytest.mark.slow
def test_torchrun_starts_one_command_on_two_processes(tmp_path: Path) -> None:
    training = replace(SHADING, steps=3)
    config, out = write_training(tmp_path / "t.toml", training), tmp_path / "out"
    torchrun = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    arguments = command("shading", "--config", config, "--out", out, "--json")[1:]
    done = subprocess.run(
        [sys.executable, *torchrun, *arguments],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["processes"] == 2  # one of them reports
    assert sorted(path.name for path in out.iterdir()) == FILES


@pytest.mark.usefixtures("no_export")
def test_batches_from_disk_give_the_same_weights(tmp_path: Path) -> None:
    config = write_training(tmp_path / "t.toml", SHADING)
    report = dataset_folder("shading", tmp_path / "data", SHADING.steps, config=config)
    assert report["count"] == SHADING.steps
    assert report["bytes"] > 0
    train_folder("shading", tmp_path / "out", config=config, data=tmp_path / "data")
    assert same_weights(tmp_path / "out", SHADING)
    with pytest.raises(OutOfRangeError, match="9 with 4 batches"):
        train_folder("shading", tmp_path / "more", config=config, data=tmp_path / "data", steps=9)
    with pytest.raises(FileFormatError, match="shading batches"):
        train_folder("photometric", tmp_path / "other", data=tmp_path / "data")
    with pytest.raises(OutOfRangeError, match="count"):
        dataset_folder("shading", tmp_path / "none", 0)


def test_bad_arguments_fail_before_any_work(tmp_path: Path) -> None:
    config = write_training(tmp_path / "t.toml", SHADING)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(FileFormatError, match='kind = "shading"'):
        train_folder("photometric", tmp_path / "out", config=config)
    with pytest.raises(OutOfRangeError, match="device"):
        train_folder("shading", tmp_path / "out", device="abacus")
    with pytest.raises(InputFileError, match="a file"):
        train_folder("shading", config)
    with pytest.raises(InputFileError, match="does not exist around it"):
        train_folder("shading", tmp_path / "deep" / "out")
    assert sorted(tmp_path.iterdir()) == before
