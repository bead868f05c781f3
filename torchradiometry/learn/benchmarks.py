"""The benchmarks' own measures on folders of real photographs with known normals.

| benchmark | error of an object | of all objects |
|---|---|---|
| photometric (DiLiGenT) | mean angle over the mask, degrees | arithmetic mean |
| shading (MIT-Berkeley) | mean angle, radians (N-MAE) | geometric mean |

The second is over the pixels whose true normal is finite: central differences of the height Z
over 3 x 3 pixels, the three rows weighted 1 2 1,

    n = (-dZ/dx, -dZ/dy, 1) / |.|,   dZ/dx = sum over rows r of w_r (Z_r,right - Z_r,left) / 8

with y up. Beside it stands the *outline alone*: the same model, or a control that was trained so,
shown an object that is white all over. The difference is what shading told.

A folder of the second kind holds `diffuse.png` (linear), `mask.png` and `geometry.npz` with `Z`,
the height towards the viewer in pixels, NaN outside.

References: B. Shi et al., "A benchmark dataset and evaluation for non-Lambertian and
uncalibrated photometric stereo", TPAMI 2019; R. Grosse et al., "Ground truth dataset and
baseline evaluations for intrinsic image algorithms", ICCV 2009; J. T. Barron and J. Malik,
"Shape, illumination, and reflectance from shading", TPAMI 2015, section 6 (N-MAE).
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchradiometry.archives import read_arrays
from torchradiometry.deploy.normals import angular_error, estimate_normals
from torchradiometry.deploy.photographs import (
    Photograph,
    Photographs,
    find_photograph_sets,
    read_photograph,
    read_photographs,
)
from torchradiometry.errors import (
    FileFormatError,
    InputFileError,
    OutOfRangeError,
    ShapeError,
    require_whole,
)
from torchradiometry.learn.evaluation import Evaluation, evaluate
from torchradiometry.learn.samples.data import Advance

__all__ = [
    "SingleEvaluation",
    "drawn_lights",
    "evaluate_draws",
    "evaluate_single",
    "evaluate_singles",
    "find_objects",
    "geometric_mean",
    "photometric_benchmark",
    "surface_normals",
]


class SingleEvaluation(NamedTuple):
    """One object's row of the single-image benchmark.

    Attributes:
        name: of the object.
        pixels: how many pixels were compared.
        radians: N-MAE of the model.
        outline: N-MAE of the model shown the outline alone, radians.
        seconds: of the model, once.
    """

    name: str
    pixels: int
    radians: float
    outline: float
    seconds: float


def drawn_lights(available: int, lights: int, seed: int) -> list[int]:
    """`lights` of the available ones: the published draw of this seed.

    >>> drawn_lights(96, 4, seed=0)
    [36, 87, 5, 13]
    """
    require_whole("available", available, 0, 2**24)
    require_whole("lights", lights, 0)
    require_whole("seed", seed, 0)
    return np.random.default_rng(seed).permutation(available)[:lights].tolist()


def evaluate_draws(
    photographs: Photographs, model: str | Path | None = None, lights: int = 10, draws: int = 5
) -> list[Evaluation]:
    """`evaluate` under some of the lights, drawn by the seeds 0, 1 ... `draws` - 1.

    Args:
        photographs: with `ground_truth`.
        model: an ONNX file; by default the shipped one.
        lights: how many of them in a draw, at least 3.
        draws: how many draws.
    """
    if lights < 3:
        raise OutOfRangeError("lights", str(lights), "draw at least 3")
    chosen = [drawn_lights(len(photographs.images), lights, seed) for seed in range(draws)]
    rows = [evaluate(photographs.under(each), model) for each in chosen]
    return [row._replace(seed=seed) for seed, row in enumerate(rows)]


def photometric_benchmark(
    folder: str | Path,
    model: str | Path | None = None,
    lights: int = 10,
    draws: int = 5,
    advance: Advance | None = None,
) -> list[Evaluation]:
    """Every object under all its lights, and under draws of some where it has more.

    Args:
        folder: one set of photographs with its true normals, or a folder of sets.
        model: an ONNX file; by default the shipped one.
        lights: lights in a draw.
        draws: draws of each object; 0 leaves them out.
        advance: called after each object as `advance(done, name)`.

    Returns:
        For each object the row of all lights, then those of its draws.
    """
    rows = []
    for done, path in enumerate(find_photograph_sets(folder), 1):
        photographs = read_photographs(path)
        rows.append(evaluate(photographs, model))
        if draws and len(photographs.images) > lights:
            rows += evaluate_draws(photographs, model, lights, draws)
        if advance is not None:
            advance(done, photographs.name)
    return rows


def surface_normals(height: NDArray[np.floating]) -> NDArray[np.float64]:
    """Unit normals `H W 3` of heights `H W` in pixels; NaN where the 3 x 3 pixels are not there.

    >>> x = np.arange(5.0)
    >>> surface_normals(np.tile(-x, (5, 1)))[2, 2, [0, 2]].round(4)
    array([0.7071, 0.7071])
    """
    z = np.pad(np.asarray(height, dtype=np.float64), 1, constant_values=np.nan)
    rows, columns = height.shape

    def shifted(down: int, right: int) -> NDArray[np.float64]:
        return z[1 + down : 1 + down + rows, 1 + right : 1 + right + columns]

    weights = ((-1, 1), (0, 2), (1, 1))
    to_right = sum(w * (shifted(r, 1) - shifted(r, -1)) for r, w in weights) / 8
    upwards = sum(w * (shifted(-1, c) - shifted(1, c)) for c, w in weights) / 8
    normal = np.stack([-to_right, -upwards, np.ones_like(z[1:-1, 1:-1])], -1)
    normal[~np.isfinite(height)] = np.nan
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def evaluate_single(
    folder: str | Path, model: str | Path | None = None, control: str | Path | None = None
) -> SingleEvaluation:
    """N-MAE of one object, with its photograph and with its outline alone.

    Args:
        folder: with `diffuse.png`, `mask.png` and `geometry.npz`.
        model: an ONNX file; by default the shipped one.
        control: an ONNX file that is shown the outline, such as one trained on outlines; by
            default the model itself.

    Raises:
        InputFileError: one of the three files is missing.
        FileFormatError: `geometry.npz` holds no `Z`.
        ShapeError: `Z` and the photograph differ in size, or no pixel can be compared.
    """
    folder = Path(folder)
    photograph = read_photograph(folder / "diffuse.png", folder / "mask.png", linear=True)
    truth = surface_normals(_height(folder / "geometry.npz", photograph.mask.shape))
    compared = np.isfinite(truth).all(-1) & photograph.mask
    if not compared.any():
        raise ShapeError(str(folder), "no pixel with a known normal", "check geometry.npz")

    def radians(shown: Photograph, by: str | Path | None) -> float:
        found = estimate_normals(shown, by)
        return float(np.radians(angular_error(found, truth, compared)).mean())

    began = time.perf_counter()
    error = radians(photograph, model)
    seconds = time.perf_counter() - began
    white = Photograph(np.ones_like(photograph.image), photograph.mask, photograph.name)
    outline = radians(white, model if control is None else control)
    return SingleEvaluation(folder.name, int(compared.sum()), error, outline, seconds)


def find_objects(folder: str | Path) -> list[Path]:
    """The folder itself if it is an object's, otherwise its folders that are.

    Raises:
        InputFileError: no such folder, or no object in it.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputFileError(str(folder), "no such folder", "name a folder of objects")
    if (folder / "geometry.npz").is_file():
        return [folder]
    found = sorted(path.parent for path in folder.glob("*/geometry.npz"))
    if not found:
        raise InputFileError(
            str(folder), "no object", "put diffuse.png, mask.png and geometry.npz in a folder each"
        )
    return found


def evaluate_singles(
    folder: str | Path,
    model: str | Path | None = None,
    control: str | Path | None = None,
    advance: Advance | None = None,
) -> list[SingleEvaluation]:
    """`evaluate_single` of one object's folder, or of every object's in a folder.

    Raises:
        InputFileError: no such folder, or no object in it.
    """
    rows = []
    for done, path in enumerate(find_objects(folder), 1):
        rows.append(evaluate_single(path, model, control))
        if advance is not None:
            advance(done, path.name)
    return rows


def geometric_mean(values: Sequence[float]) -> float:
    """exp of the mean logarithm.

    Raises:
        OutOfRangeError: a value that is no finite number >= 0.

    >>> round(geometric_mean([1.0, 4.0]), 6)
    2.0
    """
    for value in values:
        if not 0 <= value < math.inf:
            raise OutOfRangeError("values", f"{value!r}", "pass finite numbers >= 0")
    return float(np.exp(np.mean(np.log(values))))


def _height(path: Path, size: tuple[int, ...]) -> NDArray[np.float64]:
    stored = read_arrays(path, "file of heights", ["Z"])[0]
    if stored.dtype.kind not in "fiu":
        raise FileFormatError(str(path), f"heights of type {stored.dtype}", "save H x W numbers")
    height = stored.astype(np.float64)
    if height.shape != size:
        raise ShapeError(str(path), f"Z of shape {height.shape}", f"pass {size} as the mask")
    return height
