"""How well a model does on real photographs with a known answer, beside least squares.

    error = mean over the mask of the angle between found and true normal, in degrees

the measure of the DiLiGenT tables. The model is run by onnxruntime, as it will be used.

References: B. Shi et al., "A benchmark dataset and evaluation for non-Lambertian and
uncalibrated photometric stereo", TPAMI 2019.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from torchradiometry.deploy.normals import angular_error, estimate_normals
from torchradiometry.deploy.photographs import (
    Photographs,
    find_photograph_sets,
    read_photographs,
)
from torchradiometry.deploy.woodham import least_squares_normals
from torchradiometry.errors import InputFileError

__all__ = ["Evaluation", "evaluate", "evaluate_folder"]


class Evaluation(NamedTuple):
    """One object's row of a benchmark table.

    Attributes:
        name: of the object.
        lights: how many photographs were used.
        pixels: how many pixels were compared.
        degrees: mean angle of the model.
        median: median angle of the model, degrees.
        least_squares: mean angle of Woodham's method, degrees.
        seconds: of the model.
        seed: of the draw of lights; None where they were chosen or all.
    """

    name: str
    lights: int
    pixels: int
    degrees: float
    median: float
    least_squares: float
    seconds: float
    seed: int | None = None


def evaluate(photographs: Photographs, model: str | Path | None = None) -> Evaluation:
    """Compare a model and least squares with the true normals of one object.

    Args:
        photographs: with `ground_truth`.
        model: an ONNX file; by default the shipped one.

    Raises:
        InputFileError: the true normals are not known.
    """
    if photographs.ground_truth is None:
        raise InputFileError(
            photographs.name, "no true normals", "add Normal_gt.mat or normal_gt.npy"
        )
    began = time.perf_counter()
    found = estimate_normals(photographs, model)
    seconds = time.perf_counter() - began
    error = angular_error(found, photographs.ground_truth, photographs.mask)
    baseline = angular_error(
        least_squares_normals(photographs), photographs.ground_truth, photographs.mask
    )
    return Evaluation(
        photographs.name,
        len(photographs.images),
        int(photographs.mask.sum()),
        float(error.mean()),
        float(np.median(error)),
        float(baseline.mean()),
        seconds,
    )


def evaluate_folder(
    folder: str | Path, model: str | Path | None = None, lights: Sequence[int] | None = None
) -> list[Evaluation]:
    """`evaluate` for every set of photographs in a folder.

    Args:
        folder: one set, or a folder of sets.
        model: an ONNX file; by default the shipped one.
        lights: numbers of the photographs to use, from 0; None is all.
    """
    return [evaluate(chosen, model) for chosen in _chosen(folder, lights)]


def _chosen(folder: str | Path, lights: Sequence[int] | None) -> Iterable[Photographs]:
    for path in find_photograph_sets(folder):
        photographs = read_photographs(path)
        yield photographs if lights is None else photographs.under(lights)
