"""The commands about networks: train one, make its data, measure it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import torchradiometry
from torchradiometry.cli.options import (
    Config,
    Json,
    KindArgument,
    Model,
    Out,
    Seed,
    Threads,
    print_report,
)

__all__ = ["dataset", "evaluate", "train"]


def train(
    kind: KindArgument,
    steps: Annotated[int | None, typer.Option(min=1, help="Optimiser steps.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where --out stands, or begin.")
    ] = False,
    config: Config = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder of the result [default: KIND-training].")
    ] = None,
    seed: Seed = None,
    data: Annotated[Path | None, typer.Option(help="Batches from a folder of `dataset`.")] = None,
    bfloat16: Annotated[bool, typer.Option("--bfloat16", help="Round matrix products.")] = False,
    device: Annotated[str, typer.Option(help="Of the network, such as cuda.")] = "cpu",
    threads: Threads = 1,
    workers: Annotated[int, typer.Option(min=0, help="Processes that make batches ahead.")] = 0,
    json: Json = False,
) -> None:
    """Train a network: checkpoint, training.toml, curve.png, model.onnx and metrics.json in --out.

    Killed at any moment and run again with --resume it ends with the same bits. On several
    processes: torchrun --nproc-per-node 2 -m torchradiometry train ...

    Example: torchradiometry train photometric --steps 1500 --out photometric-training
    """
    report = torchradiometry.demo.train_folder(
        kind.value,
        out or Path(f"{kind.value}-training"),
        config=config,
        steps=steps,
        seed=seed,
        bfloat16=bfloat16,
        resume=resume,
        data=data,
        device=device,
        threads=threads,
        workers=workers,
    )
    if report:  # one of several processes writes and reports
        sentence = f"{report['out']}: {report['degrees']:.2f} degrees on its last batches"
        print_report(report, json, f"{sentence} ({report['seconds']:.0f} s).")


def dataset(
    kind: KindArgument,
    out: Out,
    count: Annotated[int, typer.Option(min=1, help="How many batches.", show_default=False)],
    seed: Seed = None,
    config: Config = None,
    threads: Threads = 1,
    json: Json = False,
) -> None:
    """Write the training batches of a seed to disk; run again it goes on where it was.

    Example: torchradiometry dataset shading --out shading-data --count 400 --seed 1
    """
    report = torchradiometry.demo.dataset_folder(
        kind.value, out, count, seed=seed, config=config, threads=threads
    )
    sentence = f"{report['out']}: {report['count']} batches, {report['bytes']:,} bytes."
    print_report(report, json, sentence)


def evaluate(
    kind: KindArgument,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="One object, or a folder of them.")],
    model: Model = None,
    control: Annotated[Path | None, typer.Option(help="Shading: model shown the outlines.")] = None,
    lights: Annotated[int, typer.Option(min=3, help="Photometric: lights in a draw.")] = 10,
    draws: Annotated[int, typer.Option(min=0, help="Photometric: draws of each object.")] = 5,
    table: Annotated[Path | None, typer.Option(help="A .csv file for every figure.")] = None,
    published: Annotated[Path | None, typer.Option(help="CSV of rows to show beside.")] = None,
    json: Json = False,
) -> None:
    """How far a model is from the true normals of real objects, by the benchmark's own measure.

    Photometric: folders as `normals` takes them, with Normal_gt.mat or normal_gt.npy; mean angle.
    Shading: folders with diffuse.png (linear), mask.png and geometry.npz (Z); N-MAE.

    Example: torchradiometry evaluate photometric diligent/ --published diligent96.csv
    """
    found = torchradiometry.demo.run_benchmark(
        kind.value,
        folder,
        model=model,
        control=control,
        lights=lights,
        draws=draws,
        table=table,
        published=published,
    )
    print_report(found.report, json, found.table)
