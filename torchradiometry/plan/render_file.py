"""From a scene file and a tolerance to a picture file."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import torch

from torchradiometry.errors import FileFormatError, InputFileError, OutOfRangeError
from torchradiometry.files import PICTURE_ENDINGS, write_picture
from torchradiometry.plan.render_plan import plan_render
from torchradiometry.render.picture import render_scene
from torchradiometry.scene.defaults import with_default_view
from torchradiometry.scene.load import load_scene

__all__ = ["render_file"]


def render_file(
    scene: str | Path,
    out: str | Path,
    *,
    width: int = 256,
    height: int = 256,
    tolerance: float = 0.03,
) -> dict[str, object]:
    """Plan, render and write the picture of a scene file.

    The first camera of the file is used, with the picture size given here; a scene without a
    camera or a light gets the default ones.

    Args:
        scene: glTF, GLB or a mesh.
        out: ends in `.npy`, `.exr`, `.hdr` or `.png`.
        width, height: pixels.
        tolerance: relative L1 error of the picture, 0 < tolerance < 1.

    Returns:
        `out`, `seconds`, `predicted_error`, `plan`, `stages`, `patches`, `operator` (matrix or
        tree of clusters, and why), `rays` (which caster, and why) and `warnings` (faults of the
        scene that a picture survives), ready for JSON.

    Raises:
        InputFileError, FileFormatError: the scene cannot be read, or the ending of `out` is
            unknown or its folder missing (found out before rendering).
        OutOfRangeError: a tolerance or size out of range.
        RadiometryError: the first grave fault of an invalid scene.
    """
    begin = time.perf_counter()
    _check_request(Path(out), width, height, tolerance)
    loaded = with_default_view(load_scene(scene), width=width, height=height)
    slight = loaded.require_renderable()
    camera = replace(loaded.cameras[0], width=width, height=height)
    plan = plan_render(loaded, camera, tolerance)
    with torch.no_grad():
        picture = render_scene(loaded, camera, plan.settings)
    pixels, indirect = picture.radiance, picture.indirect
    write_picture(out, pixels.expand(*pixels.shape[:2], 3).cpu().numpy())
    return {
        "out": str(out),
        "seconds": time.perf_counter() - begin,
        "predicted_error": plan.predicted_error,
        "plan": plan.to_dict(),
        "stages": picture.seconds,
        "patches": picture.patches,
        "operator": indirect.exchange.reason if indirect else "none: no interreflection",
        "rays": picture.rays,
        "warnings": [str(fault) for fault in slight],
    }


def _check_request(out: Path, width: int, height: int, tolerance: float) -> None:
    """Find out what would fail at the end before anything is computed."""
    if out.suffix.lower() not in PICTURE_ENDINGS:
        raise FileFormatError(str(out), f"the ending {out.suffix!r}", f"use {PICTURE_ENDINGS}")
    if not out.parent.is_dir():
        raise InputFileError(str(out), "a folder that does not exist", f"create {out.parent}")
    if width < 1 or height < 1:
        raise OutOfRangeError("width, height", f"{width} x {height}", "pass at least 1 pixel each")
    if not 0 < tolerance < 1:
        raise OutOfRangeError("tolerance", f"{tolerance!r}", "pass a number between 0 and 1")
