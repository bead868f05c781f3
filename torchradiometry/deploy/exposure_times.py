"""Exposure times that a camera recorded in its photographs (EXIF).

    exposure = ExposureTime (tag 0x829A), s

The light a photograph gathers is proportional to it as long as aperture (FNumber, 0x829D) and
sensitivity (0x8827) stay the same, which is checked. Only this file reads EXIF.

References: CIPA DC-008, *Exchangeable image file format*, version 2.32, table 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from pathlib import Path
from typing import Any

from torchradiometry.errors import FileFormatError, InputFileError
from torchradiometry.files import check_readable, pillow

__all__ = ["recorded_exposures"]

#: the pointer to the block of photographic tags, and the tags
BLOCK, SECONDS, APERTURE, SENSITIVITY = 0x8769, 0x829A, 0x829D, 0x8827


def recorded_exposures(files: Sequence[str | Path]) -> list[float]:
    """The exposure time of each photograph, s.

    Raises:
        InputFileError: a file is missing, has no time, or was taken with another aperture or
            sensitivity than the first.
        FileFormatError: a file is no picture.
    """
    found = [_tags(Path(path)) for path in files]
    first = found[0]
    for path, tags in zip(files, found, strict=True):
        if not isinstance(tags[SECONDS], Real) or not tags[SECONDS] > 0:
            raise InputFileError(
                str(path), "no exposure time in it", "pass --times, one for each photograph"
            )
        for name, tag in (("aperture", APERTURE), ("sensitivity", SENSITIVITY)):
            if tags[tag] != first[tag]:
                raise InputFileError(
                    str(path),
                    f"another {name} ({tags[tag]} after {first[tag]})",
                    "keep it fixed, or pass --times that make up for it",
                )
    return [float(tags[SECONDS]) for tags in found]


def _tags(path: Path) -> dict[int, Any]:
    check_readable(path, "photograph")
    library = pillow()
    try:
        with library.open(path) as image:
            block = image.getexif().get_ifd(BLOCK)
    except Exception as error:
        if path.suffix.lower() in (".npy", ".exr", ".hdr"):
            block = {}
        else:
            raise FileFormatError(
                str(path), f"no picture ({type(error).__name__})", "pass photographs"
            ) from error
    return {tag: block.get(tag) for tag in (SECONDS, APERTURE, SENSITIVITY)}
