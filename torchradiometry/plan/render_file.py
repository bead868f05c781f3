"""From a scene file and a tolerance to a plan, and to a picture file."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from torchradiometry.errors import InputFileError, OutOfRangeError
from torchradiometry.files import PICTURE_ENDINGS, write_picture
from torchradiometry.places import check_place
from torchradiometry.plan.plan import Plan
from torchradiometry.plan.planner import Planner
from torchradiometry.render.picture import render_scene
from torchradiometry.scene.defaults import with_default_view
from torchradiometry.scene.load import load_scene
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.standard import STANDARD_SCENES

__all__ = ["open_scene", "plan_file", "render_file"]


def open_scene(scene: str | Path, width: int, height: int) -> tuple[Scene, tuple[str, ...]]:
    """A scene file, or a standard scene by its name, with one camera and some light.

    Args:
        scene: glTF, GLB or a mesh; or a name in `STANDARD_SCENES`, unless such a file exists.
        width, height: of the first camera's picture, pixels.

    Returns:
        The scene, and faults that a picture survives.

    Raises:
        InputFileError, FileFormatError: it cannot be read.
        RadiometryError: the first grave fault of an invalid scene.
    """
    if str(scene) in STANDARD_SCENES and not Path(scene).exists():
        return STANDARD_SCENES[str(scene)](width, height), ()
    if not Path(scene).suffix and not Path(scene).exists():
        names = ", ".join(STANDARD_SCENES)
        raise InputFileError(str(scene), "no such file", f"name a scene file, or one of: {names}")
    loaded = with_default_view(load_scene(scene), width=width, height=height)
    slight = loaded.require_renderable()
    first = replace(loaded.cameras[0], width=width, height=height)
    made = replace(loaded, cameras=(first, *loaded.cameras[1:]))
    return made, tuple(str(fault) for fault in slight)


def plan_file(
    scene: str | Path,
    *,
    width: int = 256,
    height: int = 256,
    tolerance: float | None = None,
    seconds: float | None = None,
    out: str | Path | None = None,
) -> Plan:
    """The plan of a scene file's picture; arguments and errors as of `render_file`.

    Args:
        scene: as of `open_scene`.
        width, height: pixels.
        tolerance: relative L1 error of the picture; or
        seconds: time it may take.
        out: a `.json` file to keep the plan in.
    """
    if out is not None:
        check_place(out, (".json",))
    _check_size(width, height)
    planner = Planner(tolerance, seconds=seconds)
    made, _ = open_scene(scene, width, height)
    found = planner.plan(made, made.cameras[0])
    if out is not None:
        found.save(out)
    return found


def render_file(
    scene: str | Path,
    out: str | Path,
    *,
    width: int = 256,
    height: int = 256,
    tolerance: float = 0.03,
    planned: Callable[[Plan], None] | None = None,
) -> dict[str, Any]:
    """Plan, render and write the picture of a scene file.

    The first camera of the file is used, with the picture size given here; a scene without a
    camera or a light gets the default ones.

    Args:
        scene: glTF, GLB or a mesh, or the name of a standard scene.
        out: ends in `.npy`, `.exr`, `.hdr` or `.png`.
        width, height: pixels.
        tolerance: relative L1 error of the picture, 0 < tolerance < 1.
        planned: called with the plan before rendering: it predicts the time.

    Returns:
        `out`, `seconds`, `predicted_error`, `plan`, `stages`, `patches`, `rays`, `operator` (which
        one exchanges light between patches, and why) and `warnings` (faults of the scene that
        a picture survives), ready for JSON.

    Raises:
        InputFileError, FileFormatError: the scene cannot be read, or the ending of `out` is
            unknown or its folder missing (found out before rendering).
        OutOfRangeError: a tolerance or size out of range.
        RadiometryError: the first grave fault of an invalid scene.
    """
    begin = time.perf_counter()
    check_place(out, PICTURE_ENDINGS)
    _check_size(width, height)
    planner = Planner(tolerance)
    made, warnings = open_scene(scene, width, height)
    plan = planner.plan(made, made.cameras[0])
    if planned is not None:
        planned(plan)
    with torch.no_grad():
        picture = render_scene(made, made.cameras[0], plan.settings)
    pixels = picture.radiance
    write_picture(out, pixels.expand(*pixels.shape[:2], 3).cpu().numpy())
    indirect = picture.indirect
    return {
        "out": str(out),
        "seconds": time.perf_counter() - begin,
        "predicted_error": plan.predicted_error,
        "plan": plan.to_dict(),
        "stages": picture.seconds,
        "patches": picture.patches,
        "rays": picture.rays,
        "operator": indirect.exchange.reason if indirect else "none: no interreflection",
        "warnings": list(warnings),
    }


def _check_size(width: int, height: int) -> None:
    if width < 1 or height < 1:
        raise OutOfRangeError("width, height", f"{width} x {height}", "pass at least 1 pixel each")
