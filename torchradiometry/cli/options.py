"""What several commands share: the options' types, and how a report is printed."""

from __future__ import annotations

import json as json_module
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Out = Annotated[Path, typer.Option("--out", help="Where the result goes.", show_default=False)]
Width = Annotated[int, typer.Option(min=1, max=16384, help="Pixels across.")]
Height = Annotated[int, typer.Option(min=1, max=16384, help="Pixels down.")]
Scene = Annotated[
    str, typer.Argument(metavar="SCENE", help="glTF, GLB, a mesh, or a standard scene's name.")
]
Model = Annotated[
    Path | None, typer.Option(help="ONNX model to run instead of the one that is shipped.")
]
Config = Annotated[Path | None, typer.Option(help="A TOML file that describes the training.")]
Seed = Annotated[int | None, typer.Option("--seed", help="Of data and first weights.")]
Threads = Annotated[int, typer.Option(min=1, help="Of torch; several may change last bits.")]
Kind = Enum("Kind", {"photometric": "photometric", "shading": "shading"})
Response = Enum("Response", {"debevec": "debevec", "srgb": "srgb", "linear": "linear"})
KindArgument = Annotated[
    Kind, typer.Argument(help="Many photographs under known lights, or one.", show_default=False)
]


def print_report(report: dict[str, object], as_json: bool, sentence: str) -> None:
    """One JSON object, or one sentence."""
    typer.echo(json_module.dumps(report) if as_json else sentence)
