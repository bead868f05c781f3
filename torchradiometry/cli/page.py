"""The command that writes the browser page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import torchradiometry
from torchradiometry.cli.options import Json, Out, print_report

__all__ = ["page"]


def page(
    out: Out,
    runtime: Annotated[
        Path | None,
        typer.Option(help="node_modules with onnxruntime-web [default: web/node_modules]."),
    ] = None,
    json: Json = False,
) -> None:
    """A folder with a web page: normals of photographs, lit again by the pointer.

    It holds our models and onnxruntime-web, fetches nothing and sends nothing; open its index.html
    or serve the folder. Before: npm install onnxruntime-web (the version it asks for).

    Example: torchradiometry page --out relight
    """
    report = torchradiometry.demo.browser_page(out, runtime=runtime)
    megabytes = float(str(report["bytes"])) / 1e6
    print_report(report, json, f"Open {report['page']} ({megabytes:.0f} MB), or serve its folder.")
