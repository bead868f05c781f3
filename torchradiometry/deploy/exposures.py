"""Photographs as linear radiance: exposure stacks merged, sRGB undone, light divided out.

A camera turns radiance L and exposure time t into a count by a response curve; g is its inverse,

    v = f(L t),   g = f^-1,   L = sum over exposures of w(v_j) g(v_j) / sum of w(v_j) t_j,

with w a hat that is 0 for black and for saturated counts: the most likely L when the noise is that
of photons. g is known (linear, sRGB) or is found from the stack itself, each colour for itself,
up to a factor: 1 at count 128. What comes out is proportional to radiance; divided by the
light's colour and intensity, it is per unit of light.

References: P. Debevec and J. Malik, "Recovering high dynamic range radiance maps from
photographs", SIGGRAPH 1997; IEC 61966-2-1 (sRGB).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from torchradiometry.deploy.exposure_times import recorded_exposures
from torchradiometry.errors import (
    DTypeError,
    InputFileError,
    OutOfRangeError,
    ResourceLimitError,
    ShapeError,
)
from torchradiometry.files import MAX_BYTES, opencv, read_counts, srgb_to_linear, write_picture
from torchradiometry.places import check_place

__all__ = [
    "Merged",
    "calibrate_files",
    "debevec_response",
    "linear_response",
    "merge_exposures",
    "srgb_response",
]

#: (photographs, times) -> what each count stands for, `count 3`, relative radiance times seconds
Response: TypeAlias = Callable[
    [Sequence[NDArray[np.unsignedinteger]], Sequence[float]], NDArray[np.float64]
]

ENDINGS = (".png", ".webp", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".exr", ".npy", ".hdr")
#: pixels that the response is found from, on a grid
SAMPLES = 120


class Merged(NamedTuple):
    """One picture out of several exposures.

    Attributes:
        radiance: `H W 3`, proportional to radiance.
        unheld: `H W`, True where some colour is black or saturated in every exposure.
    """

    radiance: NDArray[np.float32]
    unheld: NDArray[np.bool_]


def linear_response(
    photographs: Sequence[NDArray[np.unsignedinteger]], times: Sequence[float]
) -> NDArray[np.float64]:
    """Counts proportional to radiance: v / full."""
    _check_stack(photographs, times)
    if photographs[0].dtype.kind != "u":
        raise DTypeError("photographs", f"{photographs[0].dtype}", "pass counts of 8 or 16 bits")
    levels = np.iinfo(photographs[0].dtype).max + 1
    return np.repeat(np.arange(levels)[:, None] / (levels - 1), 3, 1)


def srgb_response(
    photographs: Sequence[NDArray[np.unsignedinteger]], times: Sequence[float]
) -> NDArray[np.float64]:
    """The curve of IEC 61966-2-1, which a developed photograph follows roughly at best."""
    return np.asarray(srgb_to_linear(linear_response(photographs, times)), dtype=np.float64)


def debevec_response(
    photographs: Sequence[NDArray[np.unsignedinteger]], times: Sequence[float]
) -> NDArray[np.float64]:
    """Found from the stack by Debevec and Malik's least squares (OpenCV's), made to rise.

    Raises:
        OutOfRangeError: fewer than two different times, or photographs not of 8 bits.
    """
    _check_stack(photographs, times)
    if photographs[0].dtype != np.uint8:
        raise OutOfRangeError(
            "response", f"{photographs[0].dtype} counts", "find curves of 8-bit photographs only"
        )
    if len(set(times)) < 2:
        raise OutOfRangeError("times", f"{times[0]} s alone", "pass two different exposures")
    method = opencv().createCalibrateDebevec(samples=SAMPLES)
    given = [np.ascontiguousarray(each) for each in photographs]
    try:
        curve = method.process(given, np.asarray(times, np.float32))
    except opencv().error as error:
        got = f"{photographs[0].shape[:2]} pixels, too few for a curve"
        raise ShapeError("photographs", got, "pass larger photographs") from error
    return np.maximum.accumulate(np.asarray(curve, dtype=np.float64).reshape(256, 3))


def merge_exposures(
    photographs: Sequence[NDArray], times: Sequence[float], response: Response
) -> Merged:
    """Radiance from several exposures of a still scene by a camera that did not move.

    Args:
        photographs: `H W 3` each, 8 or 16 bits, all of one size and type; floats are linear.
        times: exposure times, s, > 0.
        response: which curve the counts follow.

    Raises:
        ShapeError: sizes or types that differ, or another number of times.
        OutOfRangeError: a time that is not positive.

    >>> half, full = (np.full((2, 2, 3), v, np.uint16) for v in (10000, 20000))
    >>> merge_exposures([half, full], [0.5, 1.0], linear_response).radiance[0, 0] * 65535
    array([20000., 20000., 20000.], dtype=float32)
    """
    _check_stack(photographs, times)
    if photographs[0].dtype.kind != "u":
        light = sum(np.asarray(each, np.float64) for each in photographs)
        whole = np.asarray(light / sum(times), dtype=np.float32)
        return Merged(whole, np.zeros(whole.shape[:2], bool))
    curve = response(photographs, times)
    weight = _hat(len(curve))
    total, exposed = np.zeros(photographs[0].shape), np.zeros(photographs[0].shape)
    for counts, seconds in zip(photographs, times, strict=True):
        trust = weight[counts]
        total += trust * _looked_up(curve, counts)
        exposed += trust * seconds
    held = exposed > 0
    darkest, brightest = int(np.argmin(times)), int(np.argmax(times))
    bound = np.where(
        photographs[darkest] > len(curve) // 2,
        _looked_up(curve, photographs[darkest]) / times[darkest],
        _looked_up(curve, photographs[brightest]) / times[brightest],
    )
    radiance = np.where(held, total / np.where(held, exposed, 1), bound)
    return Merged(radiance.astype(np.float32), np.asarray(~held.all(-1)))


def calibrate_files(
    sources: Sequence[str | Path],
    out: str | Path,
    *,
    times: Sequence[float] | None = None,
    response: Response | None = None,
    light: Sequence[float] | None = None,
) -> dict[str, object]:
    """Read photographs, make one picture of linear radiance, and report: `calibrate`.

    Args:
        sources: one photograph, several exposures of one scene, or a folder of them.
        out: `.npy`, `.exr` or `.hdr`.
        times: exposure times, s; by default those that the camera recorded (EXIF).
        response: which curve the counts follow; by default that of sRGB for one photograph,
            for several what `debevec_response` finds in 8-bit files, and linear for 16 bits.
        light: intensity of the light, or its red, green and blue, to divide by.

    Returns:
        `out`, `seconds`, `size`, `unheld` (share of pixels that no exposure holds), and
        `radiometry`: what was done, in words.

    Raises:
        InputFileError: a missing file, no photographs, or times that are not known.
        FileFormatError: no pictures, or another ending of `out`.
        ShapeError: sizes or numbers that do not fit together.
        OutOfRangeError: times or light that are not positive.
    """
    began = time.perf_counter()
    out = Path(out)
    check_place(out, (".npy", ".exr", ".hdr"))
    per_unit = _light(light)
    files = _files(sources)
    steps: list[str] = []
    if len(files) > 1 and times is None:
        times = recorded_exposures(files)
        steps.append("read exposure times from EXIF")
    photographs = _read(files)
    seconds = list(times) if times is not None else [1.0]
    if response is None:
        response = _usual(photographs)
    merged = merge_exposures(photographs, seconds, response)
    steps.append(_told(photographs, seconds, response))
    if light is not None:
        steps.append(f"divided by the light's {', '.join(f'{c:g}' for c in light)}")
    write_picture(out, merged.radiance / per_unit)
    return {
        "out": str(out),
        "seconds": time.perf_counter() - began,
        "size": list(merged.unheld.shape),
        "unheld": float(merged.unheld.mean()),
        "radiometry": "; ".join(steps),
    }


def _usual(photographs: Sequence[NDArray]) -> Response:
    if len(photographs) == 1:
        return srgb_response
    return debevec_response if photographs[0].dtype == np.uint8 else linear_response


def _told(photographs: Sequence[NDArray], times: Sequence[float], response: Response) -> str:
    """One sentence about what was done to the counts."""
    dtype = photographs[0].dtype
    if dtype.kind != "u":
        curve = "float values taken as linear"
    else:
        words: dict[Response, str] = {
            linear_response: f"{8 * dtype.itemsize}-bit counts taken as linear",
            srgb_response: "linearised from sRGB",
            debevec_response: "response curve found by Debevec's method",
        }
        curve = words.get(response, "linearised by the given curve")
    if len(photographs) == 1:
        return curve
    return (
        f"merged {len(photographs)} exposures of {min(times):.3g} to {max(times):.3g} s ({curve})"
    )


def _hat(levels: int) -> NDArray[np.float64]:
    """0 at black and at saturation, 1 in the middle."""
    level = np.arange(levels) / (levels - 1)
    return 1 - abs(2 * level - 1)


def _looked_up(curve: NDArray[np.float64], counts: NDArray) -> NDArray[np.float64]:
    return np.stack([curve[counts[..., c], c] for c in range(3)], -1)


def _check_stack(photographs: Sequence[NDArray], times: Sequence[float]) -> None:
    if not photographs or len(photographs) != len(times):
        raise ShapeError(
            "times", f"{len(times)} for {len(photographs)} photographs", "pass one for each"
        )
    for seconds in times:
        if not 0 < seconds < float("inf"):
            raise OutOfRangeError("times", f"{seconds}", "pass positive seconds")
    first = photographs[0]
    for each in photographs:
        if each.shape != first.shape or each.dtype != first.dtype:
            raise ShapeError(
                "photographs",
                f"{each.dtype} of shape {each.shape} beside {first.dtype} of {first.shape}",
                "pass exposures of one size and type",
            )


def _light(light: Sequence[float] | None) -> NDArray[np.float32]:
    values = [1.0] if light is None else list(light)
    if len(values) not in (1, 3) or not all(0 < v < float("inf") for v in values):
        raise OutOfRangeError("light", f"{values}", "pass one positive number, or three")
    return np.asarray(values, dtype=np.float32)


def _files(sources: Sequence[str | Path]) -> list[Path]:
    paths = [Path(source) for source in sources]
    if len(paths) == 1 and paths[0].is_dir():
        folder = paths[0]
        paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in ENDINGS)
        if not paths:
            raise InputFileError(str(folder), "no photographs", "put the exposures in it")
    if not paths:
        raise InputFileError("sources", "no photographs", "name them")
    return paths


def _read(files: Sequence[Path]) -> list[NDArray]:
    photographs = []
    for path in files:
        counts = read_counts(path)
        if counts.ndim == 2:
            counts = np.repeat(counts[..., None], 3, 2)
        photographs.append(counts)
        if sum(each.nbytes for each in photographs) > MAX_BYTES:
            raise ResourceLimitError(
                str(path), f"a stack of more than {MAX_BYTES} bytes", "shrink the photographs"
            )
    return photographs
