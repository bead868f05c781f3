"""The command line: argument parsing only; every command is one library call.

`--json` prints one JSON object on standard output and nothing else there; progress and
errors go to standard error. Bad input ends with one sentence and exit code 2, an interrupt
with 130.

Rooms are reached through the lazy package (`torchradiometry.deploy`), so that `normals` runs
without loading torch.
"""

from __future__ import annotations

import sys
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import torchradiometry
from torchradiometry.cli.interrupt import heard_interrupts
from torchradiometry.cli.options import (
    Height,
    Json,
    Model,
    Out,
    Response,
    Scene,
    Width,
    print_report,
)
from torchradiometry.cli.page import page
from torchradiometry.cli.training import dataset, evaluate, train
from torchradiometry.errors import RadiometryError

__all__ = ["app", "main"]


class _Commands(TyperGroup):
    """Commands that end with one sentence and exit code 130 when they are interrupted."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            typer.echo(f"torchradiometry: {str(stop) or 'interrupted'}.", err=True)
            raise typer.Exit(130) from stop


app = typer.Typer(
    cls=_Commands,
    name="torchradiometry",
    help="Radiometry as PyTorch layers, from one dot product to full interreflection.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"torchradiometry {torchradiometry.__version__}")
        raise typer.Exit


@app.callback()
def _about(
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
    print_report(report, json, f"Open {report['page']} ({report['seconds']:.0f} s).")


@app.command()
def render(
    scene: Scene,
    out: Out,
    width: Width = 256,
    height: Height = 256,
    tolerance: Annotated[
        float, typer.Option(help="Largest relative L1 error of the picture, 0..1.")
    ] = 0.03,
    json: Json = False,
) -> None:
    """Render SCENE to .npy (float32 linear radiance), .exr, .hdr or .png (tone-mapped).

    Example: torchradiometry render room.glb --width 320 --height 240 --out room.exr
    """
    report = torchradiometry.plan.render_file(
        scene, out, width=width, height=height, tolerance=tolerance, planned=_say_plan
    )
    print_report(report, json, f"{report['out']}: {report['seconds']:.2f} s.")


def _say_plan(found: Any) -> None:
    """What a picture will take, on standard error."""
    seconds, error = found.predicted_seconds, found.predicted_error
    typer.echo(f"Rendering: about {seconds:.2g} s, predicted error {error:.1%}.", err=True)


@app.command()
def tradeoff(
    scene: Scene,
    out: Out,
    width: Width = 96,
    height: Height = 72,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each rung.")] = 3,
    json: Json = False,
) -> None:
    """Measure accuracy versus time, from one dot product to the finest picture of SCENE.

    Writes tradeoff.csv, .json, .pdf and .png into the folder --out; takes minutes.

    Example: torchradiometry tradeoff cornell --out tradeoff-cornell
    """
    report = torchradiometry.demo.tradeoff_folder(
        scene, out, width=width, height=height, repeats=repeats
    )
    print_report(report, json, f"{report['out']}: {report['seconds']:.0f} s.")


@app.command()
def plan(
    scene: Scene,
    tolerance: Annotated[
        float | None, typer.Option(help="Largest relative L1 error of the picture, 0..1.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Time that the picture may take, instead of a tolerance.")
    ] = None,
    width: Width = 256,
    height: Height = 256,
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
        scene, width=width, height=height, tolerance=tolerance, seconds=seconds, out=out
    )
    print_report(found.to_dict(), json, found.table())


@app.command()
def normals(
    images: Annotated[
        Path, typer.Argument(metavar="INPUT", help="A folder of photographs, or one photograph.")
    ],
    out: Out,
    mask: Annotated[
        Path | None, typer.Option(help="Mask of one photograph; white is the object.")
    ] = None,
    model: Model = None,
    linear: Annotated[bool, typer.Option("--linear", help="One photograph: not sRGB.")] = False,
    json: Json = False,
) -> None:
    """Surface normals from photographs: x right, y up, z to the camera; .npy, .png or .npz.

    INPUT is a folder with NNN.png (or .webp ...), mask.png, light_directions.txt and
    light_intensities.txt, or one image together with --mask. In .npz there are also heights
    and, of one image, albedo and light.

    Example: torchradiometry normals photographs/ --out normals.npy
    """
    report = torchradiometry.deploy.normals_file(images, out, mask=mask, model=model, linear=linear)
    sentence = f"{report['out']}: {report['seconds']:.2f} s ({report['radiometry']})."
    print_report(report, json, sentence)


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
        print_report({"layers": rows}, json, text)
        return
    if layer is None or out is None:
        raise typer.BadParameter("name a LAYER and --out FILE.onnx, or pass --list")
    report = torchradiometry.export.export_file(layer, out)
    print_report(
        report,
        json,
        f"{report['out']}: onnxruntime agrees within {report['max_relative']:.1e} (relative).",
    )


for command in (page, train, dataset, evaluate):
    app.command()(command)


@app.command()
def calibrate(
    photographs: Annotated[
        list[Path], typer.Argument(metavar="PHOTOGRAPHS...", help="Files, or one folder of them.")
    ],
    out: Out,
    times: Annotated[
        str | None, typer.Option(help="Exposure times, s, such as 1/250,1/60,0.1 [default: EXIF].")
    ] = None,
    response: Annotated[Response | None, typer.Option(help="What the counts mean.")] = None,
    light: Annotated[
        str | None, typer.Option(help="Intensity of the light to divide by, or its red,green,blue.")
    ] = None,
    json: Json = False,
) -> None:
    """Linear radiance (.npy, .exr, .hdr) from a photograph, or from several exposures of a scene.

    One photograph is linearised from sRGB. Exposures are merged: the camera's response is found
    from 8-bit files (Debevec), 16-bit files are taken as linear. It says which it did.

    Example: torchradiometry calibrate stack/ --times 1/250,1/60,1/15 --out scene.exr
    """
    deploy = torchradiometry.deploy
    chosen = None if response is None else getattr(deploy, f"{response.value}_response")
    report = deploy.calibrate_files(
        photographs,
        out,
        times=None if times is None else _numbers("--times", times),
        response=chosen,
        light=None if light is None else _numbers("--light", light),
    )
    print_report(report, json, f"{report['out']}: {report['radiometry']}.")


def _numbers(option: str, text: str) -> list[float]:
    """`1/250,0.1` as numbers."""
    try:
        return [float(Fraction(part.strip())) for part in text.split(",")]
    except (ValueError, ZeroDivisionError) as error:
        raise typer.BadParameter(f"{option}: write numbers such as 1/250,0.1") from error


def main() -> None:
    """Run the command line; an error, named or of the system, is one sentence and exit code 2."""
    try:
        with heard_interrupts():
            app(prog_name="torchradiometry")
    except RadiometryError as error:
        typer.echo(f"torchradiometry: {error}", err=True)
        sys.exit(2)
    except OSError as error:  # what no room has named, such as a folder that may not be read
        where = f"{error.filename}: " if error.filename else ""
        typer.echo(f"torchradiometry: {where}{error.strerror or error}.", err=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
