"""The command line: argument parsing only; every command is one library call.

`--json` prints one JSON object on standard output and nothing else there; progress and
errors go to standard error. Bad input ends with one sentence and exit code 2, an interrupt
with 130.

Rooms are reached through the lazy package (`torchradiometry.deploy`), so that `normals` runs
without loading torch.
"""

from __future__ import annotations

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import typer

import torchradiometry
from torchradiometry.errors import RadiometryError

__all__ = ["app", "main"]

app = typer.Typer(
    name="torchradiometry",
    help="Radiometry as PyTorch layers, from one dot product to full interreflection.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Out = Annotated[Path, typer.Option("--out", help="Where the result goes.", show_default=False)]


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"torchradiometry {torchradiometry.__version__}")
        raise typer.Exit


def _print_report(report: dict[str, object], as_json: bool, sentence: str) -> None:
    typer.echo(json_module.dumps(report) if as_json else sentence)


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Radiometry as PyTorch layers, from one dot product to full interreflection."""


@app.command()
def demo(
    fast: Annotated[bool, typer.Option("--fast", help="Smaller and shorter, for a check.")] = False,
    images: Annotated[
        Path | None,
        typer.Option("--images", help="Photographs under known lights, or a folder of such sets."),
    ] = None,
    out: Out = Path("demo-output"),
    json: Json = False,
) -> None:
    """Render, train, export and run a network on real photographs; make a page of it.

    Example: torchradiometry demo --images my-photographs --out demo-output
    """
    report = torchradiometry.demo.run_demo(out, images=images, fast=fast)
    _print_report(report, json, f"Open {report['page']} ({report['seconds']:.0f} s).")


@app.command()
def render(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="glTF, GLB or a mesh.")],
    out: Out,
    width: Annotated[int, typer.Option(min=1, max=16384, help="Pixels across.")] = 256,
    height: Annotated[int, typer.Option(min=1, max=16384, help="Pixels down.")] = 256,
    tolerance: Annotated[
        float, typer.Option(help="Largest relative L1 error of the picture, 0..1.")
    ] = 0.03,
    json: Json = False,
) -> None:
    """Render SCENE to .npy (float32 linear radiance), .exr, .hdr or .png (tone-mapped).

    Example: torchradiometry render room.glb --width 320 --height 240 --out room.exr
    """
    report = torchradiometry.plan.render_file(
        scene, out, width=width, height=height, tolerance=tolerance
    )
    _print_report(report, json, f"{report['out']}: {report['seconds']:.2f} s.")


@app.command()
def tradeoff(
    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="glTF, GLB, a mesh, or a standard scene's name.")
    ],
    out: Out,
    width: Annotated[int, typer.Option(min=1, max=16384, help="Pixels across.")] = 96,
    height: Annotated[int, typer.Option(min=1, max=16384, help="Pixels down.")] = 72,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each rung.")] = 3,
    json: Json = False,
) -> None:
    """Measure accuracy versus time, from one dot product to the finest picture of SCENE.

    Writes tradeoff.csv, .json, .pdf and .png into the folder --out; takes minutes.

    Example: torchradiometry tradeoff cornell --out tradeoff-cornell
    """
    report = torchradiometry.plan.tradeoff_file(
        scene, out, width=width, height=height, repeats=repeats
    )
    _print_report(report, json, f"{report['out']}: {report['seconds']:.0f} s.")


@app.command()
def plan(
    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="glTF, GLB, a mesh, or a standard scene's name.")
    ],
    tolerance: Annotated[
        float | None, typer.Option(help="Largest relative L1 error of the picture, 0..1.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Time that the picture may take, instead of a tolerance.")
    ] = None,
    width: Annotated[int, typer.Option(min=1, max=16384, help="Pixels across.")] = 256,
    height: Annotated[int, typer.Option(min=1, max=16384, help="Pixels down.")] = 256,
    out: Annotated[
        Path | None, typer.Option("--out", help="A .json file to keep the plan in.")
    ] = None,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Measure this machine's prices first (seconds).")
    ] = False,
    json: Json = False,
) -> None:
    """Which effects a picture of SCENE needs, why, and what it will take.

    Example: torchradiometry plan cornell --tolerance 0.03
    """
    if calibrate:
        torchradiometry.plan.calibrate()
    if tolerance is None and seconds is None:
        tolerance = 0.03
    found = torchradiometry.plan.plan_file(
        scene, width=width, height=height, tolerance=tolerance, seconds=seconds
    )
    if out is not None:
        found.save(out)
    _print_report(found.to_dict(), json, found.table())


@app.command()
def normals(
    images: Annotated[
        Path, typer.Argument(metavar="INPUT", help="A folder of photographs, or one photograph.")
    ],
    out: Out,
    mask: Annotated[
        Path | None, typer.Option(help="Mask of one photograph; white is the object.")
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="ONNX model to run instead of the one that is shipped.")
    ] = None,
    json: Json = False,
) -> None:
    """Surface normals from photographs: x right, y up, z to the camera; .npy or .png.

    INPUT is a folder with NNN.png (or .webp ...), mask.png, light_directions.txt and
    light_intensities.txt, or one image together with --mask.

    Example: torchradiometry normals photographs/ --out normals.npy
    """
    report = torchradiometry.deploy.normals_file(images, out, mask=mask, model=model)
    _print_report(report, json, f"{report['out']}: {report['seconds']:.2f} s.")


@app.command()
def export(
    layer: Annotated[str | None, typer.Argument(metavar="LAYER", help="One of --list.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="The .onnx file to write.")] = None,
    list_layers: Annotated[
        bool, typer.Option("--list", help="Print the layers that can be exported.")
    ] = False,
    json: Json = False,
) -> None:
    """Write a shading layer as an ONNX file and check it under onnxruntime.

    Example: torchradiometry export phong-point --out phong.onnx
    """
    if list_layers:
        rows = torchradiometry.export.export_catalogue()
        text = "\n".join(f"{row['name']:28s} {', '.join(map(str, row['inputs']))}" for row in rows)
        _print_report({"layers": rows}, json, text)
        return
    if layer is None or out is None:
        raise typer.BadParameter("name a LAYER and --out FILE.onnx, or pass --list")
    report = torchradiometry.export.export_file(layer, out)
    _print_report(
        report,
        json,
        f"{report['out']}: onnxruntime agrees within {report['max_relative']:.1e} (relative).",
    )


def main() -> None:
    """Run the command line; a named error is one sentence and exit code 2."""
    try:
        app()
    except RadiometryError as error:
        typer.echo(f"torchradiometry: {error}", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        typer.echo("torchradiometry: interrupted.", err=True)
        sys.exit(130)


if __name__ == "__main__":
    main()
