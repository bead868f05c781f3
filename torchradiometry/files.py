"""Pictures and other files: the only place that reads and writes them.

Writing is atomic (`places`). Reading is bounded: a file of more than `MAX_BYTES` or a picture of
more than `MAX_PIXELS` is refused before it is decoded. Arrays in memory are linear radiance; only
`.png` is tone-mapped.

| ending | holds |
|---|---|
| `.npy` | float32, linear, exact |
| `.exr` | float32, linear, exact (OpenEXR) |
| `.hdr` | shared-exponent 8-bit mantissas, linear, about 0.4 % (Radiance RGBE) |
| `.png` | 8-bit sRGB, for the eye |
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchradiometry.errors import (
    FileFormatError,
    InputFileError,
    InvalidValueError,
    MissingDependencyError,
    ResourceLimitError,
    ShapeError,
)
from torchradiometry.places import as_path, atomic_path, check_place

__all__ = [
    "MAX_BYTES",
    "MAX_PIXELS",
    "MAX_SETTINGS",
    "MAX_TEXT",
    "PICTURE_ENDINGS",
    "check_readable",
    "decode_picture",
    "linear_to_srgb",
    "opencv",
    "read_counts",
    "read_json",
    "read_picture",
    "srgb_to_linear",
    "write_counts",
    "write_picture",
]

MAX_BYTES = 2**30
MAX_PIXELS = 2**27
#: tables and settings, which are text
MAX_TEXT, MAX_SETTINGS = 2**24, 2**16
#: as Python objects JSON grows about twentyfold
MAX_JSON = 2**26
PICTURE_ENDINGS = (".npy", ".exr", ".hdr", ".png")


def check_readable(path: str | Path, what: str, most: int = MAX_BYTES) -> Path:
    """The path, if it is a file of at most `most` bytes; otherwise a named error."""
    path = as_path(path)
    if path.is_dir():
        raise InputFileError(str(path), "a folder", f"name the {what} itself")
    if not path.is_file():
        raise InputFileError(str(path), "no such file", f"name an existing {what}")
    if not os.access(path, os.R_OK):
        raise InputFileError(str(path), "no permission to read it", "allow it, or name another")
    size = path.stat().st_size
    if size > most:
        raise ResourceLimitError(
            str(path), f"{size} bytes", f"pass a {what} of at most {most} bytes"
        )
    return path


def read_json(path: str | Path, what: str) -> Any:
    """What a JSON file of bounded size holds.

    Raises:
        InputFileError, ResourceLimitError: as `check_readable`, of at most `MAX_JSON` bytes.
        FileFormatError: no JSON, or nested too deep.
    """
    path = check_readable(path, what, MAX_JSON)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        got = f"no {what}: no JSON ({type(error).__name__})"
        raise FileFormatError(str(path), got, "write it again") from error


def srgb_to_linear(encoded: NDArray[np.floating]) -> NDArray[np.floating]:
    """Linear 0..1 from sRGB-encoded 0..1 (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear: NDArray[np.floating]) -> NDArray[np.floating]:
    """sRGB-encoded 0..1 from linear 0..1 (IEC 61966-2-1); values outside are clipped."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def read_picture(path: str | Path) -> NDArray[np.float32]:
    """A picture file as float32, `H x W x 3` (or `H x W` if grey), stored values unchanged.

    8-bit files give 0..1 in steps of 1/255, 16-bit files of 1/65535; nothing is linearised:
    the caller knows whether the file was linear or sRGB. Alpha is dropped.
    """
    return _scaled(read_counts(path))


def decode_picture(data: bytes, where: str) -> NDArray[np.float32]:
    """A PNG or JPEG file in memory as float32, as `read_picture` gives it.

    Args:
        data: the bytes of the file.
        where: what it is called in an error.

    Raises:
        FileFormatError: neither PNG nor JPEG, or damaged.
        ResourceLimitError: more than `MAX_PIXELS`, as its header says.
    """
    if _stored_size(data) is None:
        raise FileFormatError(where, "a picture that is neither PNG nor JPEG", "convert it to PNG")
    return _scaled(_decoded(data, where))


def _decoded(data: bytes, where: str) -> NDArray:
    """What OpenCV reads in the bytes of a picture. From a name it would read half a JPEG as whole,
    and no name that is not Unicode."""
    radiance = data.startswith(b"#?")
    size = _radiance_size(data) if radiance else _stored_size(data)
    if size is not None:  # OpenCV's own bound holds only where it was loaded here
        _check_pixels(where, size[0] * size[1])
    cv2, stored = opencv(), np.frombuffer(data, np.uint8)
    try:
        pixels = cv2.imdecode(stored, cv2.IMREAD_UNCHANGED) if data else None
    except Exception as error:
        reason = str(error).partition("\n")[0]
        raise FileFormatError(where, f"unreadable data ({reason})", "pass a picture") from error
    if pixels is None:
        mend = "pass a picture file" + ", and make room for temporary files" * radiance
        raise FileFormatError(where, "no whole picture that can be decoded", mend)
    return _rgb(pixels)


def _stored_size(data: bytes) -> tuple[int, int] | None:
    """Width and height in the header of a PNG or JPEG file; None if it is neither."""
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    at = 2
    while data[:2] == b"\xff\xd8" and at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 1 if marker == 0xFF else 2 + length
    return None


def _radiance_size(data: bytes) -> tuple[int, int] | None:
    """Width and height in the header of a Radiance file, the largest that it names."""
    named = re.findall(rb"-Y (\d{1,18}) \+X (\d{1,18})", data[: 2**16])
    sizes = [(int(width), int(height)) for height, width in named]
    return max(sizes, key=math.prod, default=None)


def _scaled(pixels: NDArray) -> NDArray[np.float32]:
    full_scale = {np.dtype(np.uint8): 255.0, np.dtype(np.uint16): 65535.0}.get(pixels.dtype, 1.0)
    return np.ascontiguousarray(pixels.astype(np.float32) / np.float32(full_scale))


def _rgb(pixels: NDArray) -> NDArray:
    """RGB or grey from OpenCV's BGR(A)."""
    if pixels.ndim == 3:
        pixels = pixels[..., 2::-1] if pixels.shape[2] >= 3 else pixels[..., 0]
    return np.ascontiguousarray(pixels)


def read_counts(path: str | Path) -> NDArray:
    """A picture file as it is stored: uint8, uint16 or float32, `H x W x 3` RGB or `H x W`.

    For those who must know how many bits a pixel had; alpha is dropped.
    """
    path = check_readable(path, "picture")
    if path.suffix.lower() == ".npy":
        return _read_npy(path)
    data = path.read_bytes()
    return (_read_exr if path.suffix.lower() == ".exr" else _decoded)(data, str(path))


def write_counts(path: str | Path, counts: NDArray[np.unsignedinteger]) -> Path:
    """Write `H x W (x 3)` uint8 or uint16 RGB as it is to a `.png`, atomically."""
    path = Path(path)
    with atomic_path(path) as temporary:
        temporary.write_bytes(_encoded(path, counts[..., ::-1] if counts.ndim == 3 else counts))
    return path


def _encoded(path: Path, stored: NDArray) -> bytes:
    """A picture in the format that the ending names; a full disk is not OpenCV's to tell."""
    done, data = opencv().imencode(path.suffix, stored)
    if not done:
        mend = "make room for temporary files, or use .npy"
        raise FileFormatError(str(path), "a picture OpenCV cannot write", mend)
    return data.tobytes()


def _read_npy(path: Path) -> NDArray[np.float32]:
    try:
        array = np.load(path, allow_pickle=False, mmap_mode="r")
    except Exception as error:  # its header is parsed as Python text: tokens and syntax go wrong
        reason = str(error).partition("\n")[0]
        raise FileFormatError(
            str(path), f"no array ({reason})", "pass a NumPy .npy file"
        ) from error
    _check_pixels(path, array.size)
    if array.dtype.kind not in "biuf":
        raise FileFormatError(str(path), f"an array of {array.dtype}"[:200], "save real numbers")
    return array.astype(np.float32)


def _check_pixels(path: str | Path, pixels: int) -> None:
    if pixels > MAX_PIXELS:
        raise ResourceLimitError(
            str(path), f"{pixels} pixels", f"pass a picture of at most {MAX_PIXELS}"
        )


def _read_exr(data: bytes, where: str) -> NDArray[np.float32]:
    openexr = _openexr()
    pixels = 0  # of all parts and channels, which are all decoded
    try:
        for part in openexr.File(io.BytesIO(data), header_only=True).parts:
            low, high = (np.asarray(corner).tolist() for corner in part.header["dataWindow"])
            size = math.prod(b - a + 1 for a, b in zip(low, high, strict=True))
            pixels += size * -(-len(part.header["channels"]) // 4)
        _check_pixels(where, pixels)
        channels = openexr.File(io.BytesIO(data), separate_channels=False).channels()
        return np.asarray((channels.get("RGB") or channels.get("RGBA")).pixels)[..., :3]
    except ResourceLimitError:
        raise
    except Exception as error:
        raise FileFormatError(where, f"unreadable data ({error})", "pass a picture") from error


def write_picture(
    path: str | Path, radiance: NDArray[np.floating], *, exposure: float | None = None
) -> Path:
    """Write `H x W x 3` linear radiance in the format that the ending names, atomically.

    Args:
        path: ends in `.npy`, `.exr`, `.hdr` or `.png`.
        radiance: finite, linear, W/m2/sr.
        exposure: for `.png`: the factor before sRGB encoding; by default the 99th percentile of
            the pixels that are not black becomes white.

    Raises:
        FileFormatError: another ending.
        InvalidValueError: NaN or infinite pixels.
        ShapeError: not `H x W x 3`.
    """
    path, pixels = check_place(path, PICTURE_ENDINGS), np.asarray(radiance, dtype=np.float32)
    ending = path.suffix.lower()
    if pixels.ndim != 3 or pixels.shape[2] != 3:
        raise ShapeError("radiance", f"shape {pixels.shape}", "pass H x W x 3")
    if not np.isfinite(pixels).all():
        raise InvalidValueError("radiance", "NaN or infinite pixels", "write finite values")
    with atomic_path(path) as temporary:
        if ending == ".npy":
            np.save(temporary, pixels, allow_pickle=False)
        elif ending == ".exr":
            temporary.write_bytes(_exr(pixels))
        else:
            stored = _tone_mapped(pixels, exposure) if ending == ".png" else pixels
            temporary.write_bytes(_encoded(path, stored[..., ::-1]))
    return path


def _exr(pixels: NDArray[np.float32]) -> bytes:
    """An OpenEXR file in memory: by itself it writes no name that is not Unicode."""
    openexr, held = _openexr(), io.BytesIO()
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    openexr.File(header, {"RGB": np.ascontiguousarray(pixels)}).write(held)
    return held.getvalue()


def _tone_mapped(pixels: NDArray[np.float32], exposure: float | None) -> NDArray[np.uint8]:
    if exposure is None:
        seen = pixels.max(-1)[pixels.max(-1) > 0]
        white = float(np.percentile(seen, 99)) if seen.size else 0.0
        exposure = 1 / white if white > 0 else 1.0
    return np.round(255 * linear_to_srgb(pixels * exposure)).astype(np.uint8)


def opencv():  # type: ignore[no-untyped-def]
    """The module cv2, bounded and silent; only this file imports it."""
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PIXELS))  # before any decoding
    try:
        import cv2
    except ImportError as error:
        raise MissingDependencyError(
            "OpenCV", "no installation", "run: pip install 'torchradiometry[render]'"
        ) from error
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2


def pillow():  # type: ignore[no-untyped-def]
    """The module PIL.Image."""
    try:
        from PIL import Image
    except ImportError as error:
        raise MissingDependencyError(
            "Pillow", "no installation", "run: pip install 'torchradiometry[render]'"
        ) from error
    return Image


def _openexr():  # type: ignore[no-untyped-def]
    try:
        import OpenEXR
    except ImportError as error:
        raise MissingDependencyError(
            "OpenEXR", "no installation", "run: pip install 'torchradiometry[render]'"
        ) from error
    return OpenEXR
