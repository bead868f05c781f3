"""Normals from photographs through an ONNX model, in NumPy and onnxruntime alone.

| model | in | out |
|---|---|---|
| `photometric` | `intensity` pixel x light, `direction` light x 3 | `normal` pixel x 3 |
| `shading` | `image` and `mask`, batch x 3 or 1 x H x W | `normal`, `albedo` 3 x H x W each |

Many photographs under known lights go to the first, pixel by pixel; a single photograph goes
to the second, shrunk to the size it was trained on. The error against a known answer is

    angle = atan2(|n x n*|, n . n*)   in degrees.

References: R. J. Woodham (1980); S. Ikehata, "CNN-PS", ECCV 2018.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchradiometry.deploy.photographs import (
    Photograph,
    Photographs,
)
from torchradiometry.deploy.runtime import Model, open_model, run_model
from torchradiometry.errors import FileFormatError, InputFileError, InvalidValueError, ShapeError
from torchradiometry.files import write_counts
from torchradiometry.places import atomic_path, check_place

__all__ = [
    "angular_error",
    "estimate_normals",
    "find_model",
    "write_normals",
]

#: pixels in one call of the photometric model: what it computes stays in the processor's cache
PIXELS_AT_ONCE = 256
#: the longer side of what the shading model sees; it was trained on 64 x 64
SHADING_SIZE = 64


def find_model(name: str) -> Path:
    """A shipped model: `torchradiometry/models/NAME` when installed, `models/NAME` in the sources.

    Raises:
        InputFileError: it is in neither place.
    """
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "models", package.parent / "models"):
        path = folder / name / "model.onnx"
        if path.is_file():
            return path
    raise InputFileError(f"model {name!r}", "no such model", "train it or pass --model FILE.onnx")


def estimate_normals(
    photographs: Photographs | Photograph, model: str | Path | None = None
) -> NDArray[np.float32]:
    """Unit normals `H W 3` (x right, y up, z to the camera); 0 outside the mask.

    Args:
        photographs: a set under known lights (photometric model) or one image (shading model).
        model: an ONNX file; by default the shipped one.

    Raises:
        InputFileError: no such model.
        FileFormatError: a model with other inputs.
        InvalidValueError: the model gave NaN or infinite numbers.
    """
    return estimate_both(photographs, model)[0]


def estimate_both(
    photographs: Photographs | Photograph, model: str | Path | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Normals, and the paint that a shading model sees, `H W 3` relative to its mean, or None."""
    if isinstance(photographs, Photographs):
        opened = _opened(model, "photometric", {"intensity", "direction"})
        return _photometric(photographs, opened), None
    return _from_one_image(photographs, _opened(model, "shading", {"image", "mask"}))


def angular_error(
    normals: NDArray[np.floating], truth: NDArray[np.floating], mask: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Angle in degrees at each pixel of the mask, in the order of `mask.nonzero()`.

    >>> up, east = np.array([[[0, 0, 1.0]]]), np.array([[[1.0, 0, 1.0]]])
    >>> angular_error(up, east, np.array([[True]]))
    array([45.])
    """
    if normals.shape != truth.shape or normals.shape != (*mask.shape, 3):
        raise ShapeError(
            "normals", f"{normals.shape} beside {truth.shape}", f"pass {(*mask.shape, 3)} both"
        )
    a, b = normals[mask].astype(np.float64), truth[mask].astype(np.float64)
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, (a * b).sum(-1)))


def write_normals(path: str | Path, normals: NDArray[np.floating]) -> Path:
    """Write normals: `.npy` as float32, exact; `.png` as 16-bit RGB, (n + 1)/2, black outside.

    Raises:
        FileFormatError: another ending.
        InputFileError: the folder does not exist.
        InvalidValueError: NaN or infinite numbers.
        ShapeError: not `H x W x 3`.
    """
    path = check_place(path, (".npy", ".png"))
    normals = np.asarray(normals, dtype=np.float32)
    if normals.ndim != 3 or normals.shape[2] != 3:
        raise ShapeError("normals", f"shape {normals.shape}", "pass H x W x 3")
    if not np.isfinite(normals).all():
        raise InvalidValueError("normals", "NaN or infinite numbers", "write finite normals")
    if path.suffix.lower() == ".npy":
        with atomic_path(path) as temporary:
            np.save(temporary, normals, allow_pickle=False)
        return path
    inside = (normals != 0).any(-1, keepdims=True)
    return write_counts(
        path, np.where(inside, np.round((normals + 1) * 32767.5), 0).astype(np.uint16)
    )


def _opened(model: str | Path | None, name: str, wanted: set[str]) -> Model:
    path = find_model(name) if model is None else Path(model)
    opened = open_model(path)
    names = {item.name for item in opened.inputs}
    if names != wanted:
        raise FileFormatError(
            str(path), f"a model of {sorted(names)}", f"pass a {name} model, of {sorted(wanted)}"
        )
    return opened


def _photometric(photographs: Photographs, model: Model) -> NDArray[np.float32]:
    intensity = photographs.grey()
    direction = photographs.light_directions.astype(np.float32)
    found = [
        run_model(model, {"intensity": some, "direction": direction})[0]
        for some in _batches(intensity)
    ]
    return _placed(np.concatenate(found), photographs.mask)


def _batches(intensity: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    return [
        np.ascontiguousarray(intensity[k : k + PIXELS_AT_ONCE])
        for k in range(0, len(intensity), PIXELS_AT_ONCE)
    ]


def _placed(found: NDArray[np.floating], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Unit normals in their places; a pixel that saw no light faces the camera."""
    if not np.isfinite(found).all():
        raise InvalidValueError("the model", "NaN or infinite normals", "check the photographs")
    length = np.linalg.norm(found, axis=-1, keepdims=True)
    unit = np.where(length > 0, found / np.where(length > 0, length, 1), [0, 0, 1])
    normals = np.zeros((*mask.shape, 3), dtype=np.float32)
    normals[mask] = unit
    return normals


def _from_one_image(
    photograph: Photograph, model: Model
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Crop to the object, shrink, ask the model, enlarge, put back."""
    box = _box(photograph.mask)
    inside = photograph.mask[box].astype(np.float32)
    height, width = inside.shape
    shrink = min(1.0, SHADING_SIZE / max(height, width))
    size = (max(8, round(height * shrink)), max(8, round(width * shrink)))
    covered = _resized(inside, size)
    colours = [
        _resized(colour * inside, size) for colour in np.moveaxis(photograph.image[box], 2, 0)
    ]
    image = np.where(covered > 0, np.stack(colours) / np.where(covered > 0, covered, 1), 0)
    small = {
        "image": image[None].astype(np.float32),
        "mask": (covered >= 0.5).astype(np.float32)[None, None],
    }
    small["mask"] = np.where(small["mask"].any(), small["mask"], 1).astype(np.float32)
    found, *paint = run_model(model, small)
    weight = _resized(small["mask"][0, 0], (height, width))[..., None]

    def enlarged(image: NDArray[np.floating], unknown: list[float]) -> NDArray[np.float64]:
        """`1 3 h w`, 0 outside the mask, as `pixel 3` of the photograph."""
        larger = np.stack([_resized(part, (height, width)) for part in image[0]], -1)
        whole = np.zeros((*photograph.mask.shape, 3))
        whole[box] = np.where(weight > 0, larger / np.where(weight > 0, weight, 1), unknown)
        return whole[photograph.mask]

    normals = _placed(enlarged(found, [0, 0, 1]), photograph.mask)
    if not paint:
        return normals, None
    paints = enlarged(paint[0], [1, 1, 1])
    if not np.isfinite(paints).all() or not paints.mean() > 0:
        raise InvalidValueError("the model", "no finite, positive albedo", "check the photograph")
    albedo = np.zeros((*photograph.mask.shape, 3), dtype=np.float32)
    albedo[photograph.mask] = paints / paints.mean()
    return normals, albedo


def _box(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The smallest box around the object, with a margin of a sixteenth of its size."""
    slices = []
    for axis in (0, 1):
        found = np.flatnonzero(mask.any(1 - axis))
        low, high = int(found[0]), int(found[-1]) + 1
        margin = (high - low) // 16 + 1
        slices.append(slice(max(0, low - margin), min(mask.shape[axis], high + margin)))
    return slices[0], slices[1]


def _resized(image: NDArray[np.floating], size: tuple[int, int]) -> NDArray[np.float64]:
    """`H W` to another size: linear, averaged over the source pixels that a pixel covers."""
    rows, columns = (_resampling(old, new) for old, new in zip(image.shape, size, strict=True))
    return rows @ image.astype(np.float64) @ columns.T


def _resampling(old: int, new: int) -> NDArray[np.float64]:
    """Matrix `new x old` of tent weights, each row summing to 1."""
    centre = (np.arange(new)[:, None] + 0.5) * old / new - 0.5
    reach = max(1.0, old / new)
    weight = np.clip(1 - abs(np.arange(old)[None] - centre) / reach, 0, None)
    return weight / weight.sum(1, keepdims=True)
