"""Training as a command: a description in, a folder with the network and its record out.

| file | holds |
|---|---|
| `training.toml` | what is trained; written first |
| `checkpoint.pt` | the state, replaced in one step; where `--resume` goes on |
| `curve.png` | loss and degrees of each step |
| `model.onnx` | the network for onnxruntime, checked against torch |
| `metrics.json` | settings, figures, machine; written last, so it stands for a complete folder |
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import nn

from torchradiometry import __version__
from torchradiometry.demo.curve import draw_learning_curve
from torchradiometry.demo.progress import progress_bar
from torchradiometry.errors import FileFormatError, InputFileError, OutOfRangeError
from torchradiometry.export.onnx_file import export_onnx, input_names
from torchradiometry.export.parity import OnnxCheck, check_onnx
from torchradiometry.learn.networks import PhotometricNetwork
from torchradiometry.learn.samples.data import generator_for
from torchradiometry.learn.samples.single_images import photograph_shapes
from torchradiometry.learn.samples.stored_samples import StoredSamples, write_samples
from torchradiometry.learn.training.loop import Machine, Trained, train
from torchradiometry.learn.training.processes import joined_processes, started_together
from torchradiometry.learn.training.settings import KINDS, Training, kind_of
from torchradiometry.learn.training.settings_file import (
    read_training,
    training_table,
    write_training,
)
from torchradiometry.places import (
    atomic_path,
    check_folder_place,
    clear_half_files,
    make_folder,
)

__all__ = ["dataset_folder", "export_network", "torch_threads", "train_folder"]

CHECKPOINT, SETTINGS = "checkpoint.pt", "training.toml"


def train_folder(
    kind: str,
    out: str | Path,
    *,
    config: str | Path | None = None,
    steps: int | None = None,
    seed: int | None = None,
    bfloat16: bool = False,
    resume: bool = False,
    data: str | Path | None = None,
    device: str = "cpu",
    threads: int = 1,
    workers: int = 0,
) -> dict[str, object]:
    """Train a network and leave a complete folder: what the `train` command calls.

    Args:
        kind: `photometric` or `shading`.
        out: the folder; made if it is not there.
        config: a TOML file; by default the one in `out` when resuming, else the defaults.
        steps: in place of the description's.
        seed: in place of the description's.
        bfloat16: round matrix products to bfloat16, whatever the description says.
        resume: go on from the folder's checkpoint, or begin if there is none, which standard
            error says.
        data: a folder of `write_samples` to take the batches from.
        device: of the network, such as `cuda`.
        threads: of torch; more than one may change the last bits.
        workers: processes that make batches ahead.

    Returns:
        What `metrics.json` holds, and `out`; nothing in the processes that do not write.

    Raises:
        InputFileError: a missing file, no place for the folder, or a checkpoint in it and no
            `resume`.
        FileFormatError: settings, checkpoint or data that do not fit.
        OutOfRangeError: a value outside its range, or a device that is not there.
        KeyboardInterrupt: with a sentence that says how to go on.
    """
    out = Path(out)
    training = _chosen(kind, out, config, resume)
    given: dict[str, Any] = {"steps": steps, "seed": seed, "bfloat16": bfloat16 or None}
    training = replace(training, **{k: v for k, v in given.items() if v is not None})
    stored = None if data is None else _stored(data, training)
    place, writes = _device(device), started_together().writes
    if writes:
        _prepare(out, training, resume)
    try:
        with torch_threads(threads), joined_processes(place) as processes:
            machine = Machine(place, workers, processes)
            trained = _train(training, out / CHECKPOINT, resume, stored, machine)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_how_to_go_on(out)) from None
    return _finished(out, training, trained, machine, threads) if writes else {}


def dataset_folder(
    kind: str,
    out: str | Path,
    count: int,
    *,
    seed: int | None = None,
    config: str | Path | None = None,
    threads: int = 1,
) -> dict[str, object]:
    """Write a fixed data set, or go on writing it: what the `dataset` command calls.

    Args:
        kind: `photometric` or `shading`.
        out: the folder; made if it is not there.
        count: how many batches.
        seed: in place of the description's.
        config: a TOML file that describes the training whose batches they are.
        threads: of torch; more than one may change the last bits.

    Returns:
        `out`, `kind`, `count`, `seed` and `bytes`.

    Raises:
        InputFileError: a missing file, or no place for the folder.
        FileFormatError: settings that are none, or a folder of other settings.
        OutOfRangeError: a value outside its range.
    """
    if count < 1:
        raise OutOfRangeError("count", str(count), "use at least 1")
    out = check_folder_place(out, "data set")
    training = _chosen(kind, out, config, resume=False)
    training = replace(training, steps=count, seed=training.seed if seed is None else seed)
    surfaces = [("Shading surfaces", training.surfaces_made())] if training.surfaces_made() else []
    with torch_threads(threads), progress_bar(*surfaces, ("Writing batches", count)) as bars:
        written = write_samples(training, out, bars[-1], bars[0] if surfaces else None)
    return {
        "out": str(out),
        "kind": written.kind,
        "count": len(written),
        "seed": training.seed,
        "bytes": sum(path.stat().st_size for path in out.glob("*.npz")),
    }


def export_network(network: nn.Module, path: Path) -> OnnxCheck:
    """Write a network as ONNX with dynamic axes, and compare it with torch on other sizes."""
    if isinstance(network, PhotometricNetwork):
        example = {
            "intensity": torch.rand(8, 12, generator=torch.Generator().manual_seed(0)),
            "direction": nn.functional.normalize(torch.eye(3).repeat(4, 1) + 0.3, dim=-1),
        }
        axes = {"intensity": ("pixel", "light"), "direction": ("light", "3")}
        export_onnx(network, example, path, axes=axes, outputs={"normal": "1"})
        return check_onnx(path, network, sizes={"pixel": 100, "light": 17})
    seen = photograph_shapes(3, 40, generator_for(0))._asdict()
    images = {name: seen.pop(name) for name in input_names(network)}
    export_onnx(
        network,
        {name: image[:2] for name, image in images.items()},
        path,
        axes={n: ("batch", str(i.shape[1]), "height", "width") for n, i in images.items()},
        units=dict.fromkeys(images, "1"),
        outputs=dict.fromkeys(seen, "1"),
    )
    return check_onnx(path, network, inputs={n: i[..., :37, :31] for n, i in images.items()})


@contextmanager
def torch_threads(threads: int) -> Iterator[None]:
    """So many threads of torch inside the block.

    Small tensors gain little from two threads, which wait for each other on a busy machine.
    """
    if threads < 1:
        raise OutOfRangeError("threads", str(threads), "use at least 1")
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _chosen(kind: str, out: Path, config: str | Path | None, resume: bool) -> Training:
    """The description that the arguments name, before single values are replaced."""
    if config is None and resume and (out / SETTINGS).is_file():
        config = out / SETTINGS
    training = KINDS[kind]() if config is None else read_training(config)
    if kind_of(training) != kind:
        raise FileFormatError(
            str(config), f'kind = "{kind_of(training)}"', f"name settings of kind {kind!r}"
        )
    return training


def _stored(data: str | Path, training: Training) -> StoredSamples:
    stored = StoredSamples(data)
    if stored.kind != kind_of(training):
        raise FileFormatError(
            str(data), f"{stored.kind} batches", f"name a data set of {kind_of(training)} ones"
        )
    if len(stored) < training.steps:
        raise OutOfRangeError(
            "steps", f"{training.steps} with {len(stored)} batches in {data}", "write more of them"
        )
    return stored


def _prepare(out: Path, training: Training, resume: bool) -> None:
    check_folder_place(out, "training")
    if (out / CHECKPOINT).exists() and not resume:
        raise InputFileError(
            str(out), "a training that is there already", "pass --resume or another --out"
        )
    make_folder(out, "training")
    clear_half_files(out)
    if not (out / CHECKPOINT).exists():
        if resume:
            print(f"no checkpoint in {out}: the training begins anew", file=sys.stderr)
        write_training(out / SETTINGS, training)


def _train(
    training: Training,
    checkpoint: Path,
    resume: bool,
    stored: StoredSamples | None,
    machine: Machine,
) -> Trained:
    options: dict[str, Any] = {
        "checkpoint": checkpoint,
        "resume": resume,
        "samples": stored,
        "machine": machine,
    }
    if not machine.processes.writes:
        return train(training, **options)
    steps = ("Training", training.steps)
    if stored is not None or not training.surfaces_made():
        with progress_bar(steps) as (advance,):
            return train(training, advance, **options)
    with progress_bar(("Shading surfaces", training.surfaces_made()), steps) as (surfaces, advance):
        return train(training, advance, surfaces_advance=surfaces, **options)


def _how_to_go_on(out: Path) -> str:
    if (out / CHECKPOINT).exists():
        return f"interrupted; the last checkpoint is kept, go on with --resume --out {out}"
    return f"interrupted before the first checkpoint; begin again with --resume --out {out}"


def _finished(
    out: Path, training: Training, trained: Trained, machine: Machine, threads: int
) -> dict[str, object]:
    """Curve, model and figures of a trained network; `metrics.json` comes last."""
    network = trained.network.cpu()
    draw_learning_curve(out / "curve.png", trained.losses, trained.degrees)
    check = export_network(network, out / "model.onnx")
    tail = max(1, training.steps // 10)
    report: dict[str, object] = {
        "training": training_table(training),
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "bytes": (out / "model.onnx").stat().st_size,
        "loss": sum(trained.losses[-tail:]) / tail,
        "degrees": sum(trained.degrees[-tail:]) / tail,
        # the length of a difference of unit normals, at most sqrt(3) times its largest component
        "onnx_degrees": math.degrees(math.sqrt(3) * check.max_absolute),
        "seconds": trained.seconds,
        "device": str(machine.device),
        "processes": machine.processes.count,
        "threads": threads,
        "versions": {"torchradiometry": __version__, "torch": str(torch.__version__)},
    }
    with atomic_path(out / "metrics.json") as temporary:
        temporary.write_text(json.dumps(report, indent=2) + "\n")
    return {"out": str(out), **report}


def _device(name: str) -> torch.device:
    """The device of this process, if it is there."""
    try:
        device = torch.device(name)
        if device.type == "cuda" and device.index is None:
            device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)))
        torch.empty(1, device=device).item()
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise OutOfRangeError(
            "device", f"{name!r}, which torch cannot use here", "use cpu or a device it has"
        ) from error
    return device
