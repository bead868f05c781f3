"""Step 5: real photographs through onnxruntime.

Sets of photographs under known lights go through the network that was just trained, beside
Woodham's least squares; where a true answer is known both are scored in degrees. Without any,
the shipped single-image model looks at a portrait, and the layers relight what it found.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from torchradiometry.demo.curve import sample_photograph
from torchradiometry.demo.page import Figure, Section, Table
from torchradiometry.demo.progress import progress_bar
from torchradiometry.deploy.normals import angular_error, estimate_normals
from torchradiometry.deploy.photographs import (
    Photographs,
    find_photograph_sets,
    read_photograph,
    read_photographs,
)
from torchradiometry.deploy.woodham import least_squares_normals
from torchradiometry.files import srgb_to_linear, write_picture
from torchradiometry.shade.lambertian import LambertianShading
from torchradiometry.sources.directional import DirectionalSource

__all__ = ["portrait_section", "sets_of", "sets_section"]

#: middle and half axes of the face in the portrait, pixels (row, column)
FACE_MIDDLE, FACE_AXES = (232, 265), (96, 84)
#: the error that the error maps show as white, degrees
WHITE_DEGREES = 45.0


def sets_of(images: Path) -> list[Path]:
    """The photograph sets of a folder; called first, so that a wrong folder fails at once."""
    return find_photograph_sets(images)


def sets_section(folder: Path, sets: Sequence[Path], model: Path) -> Section:
    """Normals of every set by the network and by least squares, with figures and degrees."""
    figures: list[Figure] = []
    rows: list[tuple[str, ...]] = []
    degrees: dict[str, object] = {}
    with progress_bar(("Normals from photographs", len(sets))) as (advance,):
        for number, path in enumerate(sets, 1):
            photographs = read_photographs(path)
            found = estimate_normals(photographs, model)
            baseline = least_squares_normals(photographs)
            scores = [_score(normals, photographs) for normals in (found, baseline)]
            figures += _set_figures(folder, photographs, found)
            rows.append(_row(photographs, scores))
            degrees[photographs.name] = {"network": scores[0], "least_squares": scores[1]}
            advance(number, photographs.name)
    table = Table(("object", "lights", "network, degrees", "least squares, degrees"), rows)
    words = (
        "Real photographs, which the training never saw, run through onnxruntime. The error is "
        "the mean angle to the measured normals, where they are known.",
    )
    per_object = 3 if len(figures) == 3 * len(sets) else 4
    data = {"degrees": degrees}
    return Section("5. Real photographs", words, figures, (table,), per_object, data)


def portrait_section(folder: Path) -> Section:
    """One photograph: normals by the shipped model, and the face relit by our layer."""
    source = sample_photograph()
    mask = _write_face_mask(folder / "portrait-mask.png", source)
    photograph = read_photograph(source, mask)
    normals = estimate_normals(photograph)
    top, left = (max(0, m - a - 12) for m, a in zip(FACE_MIDDLE, FACE_AXES, strict=True))
    bottom, right = (m + a + 12 for m, a in zip(FACE_MIDDLE, FACE_AXES, strict=True))
    box = (slice(top, bottom), slice(left, right))
    write_picture(folder / "portrait.png", photograph.image[box], exposure=1.0)
    write_picture(folder / "portrait-normals.png", _colours(normals)[box], exposure=1.0)
    for name, direction in (("left", [-0.8, 0.3, 0.55]), ("right", [0.8, 0.3, 0.55])):
        relit = _relit(normals, photograph.mask, direction)
        write_picture(folder / f"portrait-{name}.png", relit[box], exposure=1.0)
    words = (
        "A real photograph under unknown light (Grace Hopper; public domain, shipped with "
        "matplotlib). The single-image model of this package runs in onnxruntime; "
        "LambertianShading then lights the shape it found from two sides.",
        "One photograph under unknown light does not determine a shape: this is a guess from "
        "shading and outline. With several photographs under known lights the network above "
        "measures it: pass --images DIR.",
    )
    figures = (
        Figure("portrait.png", "The photograph."),
        Figure("portrait-normals.png", "Normals: x red, y green, z blue."),
        Figure("portrait-left.png", "Relit from the left, white albedo."),
        Figure("portrait-right.png", "Relit from the right."),
    )
    return Section(
        "5. A real photograph", words, figures, data={"pixels": int(photograph.mask.sum())}
    )


def _score(normals: NDArray[np.float32], photographs: Photographs) -> float | None:
    if photographs.ground_truth is None:
        return None
    return float(angular_error(normals, photographs.ground_truth, photographs.mask).mean())


def _row(photographs: Photographs, scores: Sequence[float | None]) -> tuple[str, ...]:
    cells = ("unknown" if score is None else f"{score:.2f}" for score in scores)
    return (photographs.name, str(len(photographs.light_directions)), *cells)


def _set_figures(folder: Path, photographs: Photographs, normals: NDArray) -> list[Figure]:
    """A photograph, the normals, and the error map where the answer is known."""
    name = photographs.name
    image = photographs.images[np.argmax(photographs.light_directions[:, 2])]
    image = image / max(float(np.percentile(image[photographs.mask], 99)), np.finfo("f4").tiny)
    box = _box(photographs.mask)
    write_picture(folder / f"{name}.png", image[box], exposure=1.0)
    write_picture(folder / f"{name}-normals.png", _colours(normals)[box], exposure=1.0)
    figures = [Figure(f"{name}.png", name), Figure(f"{name}-normals.png", "network's normals")]
    if photographs.ground_truth is not None:
        error = np.zeros((*photographs.mask.shape, 3), np.float32)
        angle = angular_error(normals, photographs.ground_truth, photographs.mask)
        error[photographs.mask] = (angle / WHITE_DEGREES)[:, None]
        write_picture(folder / f"{name}-error.png", error[box], exposure=1.0)
        figures.append(Figure(f"{name}-error.png", f"error; white is {WHITE_DEGREES:.0f} degrees"))
    return figures


def _box(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _colours(normals: NDArray) -> NDArray:
    """(n + 1) / 2 as seen on a screen: linear values whose sRGB code is that number."""
    inside = (normals != 0).any(-1, keepdims=True)
    return np.where(inside, srgb_to_linear((normals + 1) / 2), 0)


def _relit(normals: NDArray, mask: NDArray, direction: list[float]) -> NDArray:
    layer = LambertianShading(DirectionalSource(direction, [np.pi]))
    image = torch.from_numpy(normals).movedim(-1, 0)[None]
    albedo = torch.from_numpy(mask.astype(np.float32))[None, None].expand(-1, 3, -1, -1)
    return layer(image, albedo)[0].movedim(0, -1).numpy()


def _write_face_mask(path: Path, source: Path) -> Path:
    height, width = 600, 512  # of the portrait
    rows, columns = np.mgrid[:height, :width]
    inside = ((rows - FACE_MIDDLE[0]) / FACE_AXES[0]) ** 2 + (
        (columns - FACE_MIDDLE[1]) / FACE_AXES[1]
    ) ** 2 <= 1
    return write_picture(path, np.repeat(inside[..., None], 3, 2).astype(np.float32), exposure=1.0)
