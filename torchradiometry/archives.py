"""Zip archives and the arrays in them (`.npz`), unpacked within a bound.

A few bytes of an archive can stand for terabytes: parts are packed a thousandfold, may lie over
each other, and say of themselves how large they are. So the sizes are summed before anything
is unpacked, and no part is unpacked beyond what it says.

References: PKWARE, *APPNOTE.TXT* (the format of zip files), 4.3.15, 4.3.16.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchradiometry.errors import FileFormatError, InputFileError, ResourceLimitError
from torchradiometry.files import MAX_BYTES, check_readable

__all__ = ["read_arrays", "read_parts"]

#: bytes of an archive's list of contents, some ten thousand parts
MAX_CONTENTS = 2**20


def read_arrays(path: str | Path, what: str, names: Sequence[str]) -> list[NDArray[Any]]:
    """Arrays of an `.npz` file by name, of at most `MAX_BYTES` together when unpacked.

    Raises:
        InputFileError, ResourceLimitError: as `check_readable`; too much to unpack.
        FileFormatError: no such archive, or an array is not in it.
    """
    path = check_readable(path, what)
    try:
        parts = read_parts(path, what, [f"{name}.npy" for name in names])
        return [np.load(io.BytesIO(part), allow_pickle=False) for part in parts.values()]
    except (InputFileError, ResourceLimitError):
        raise
    except Exception as error:
        got = f"no {what} with {', '.join(names)} ({type(error).__name__})"
        raise FileFormatError(str(path), got, "save these arrays under their names") from error


def read_parts(path: str | Path, what: str, names: Sequence[str] | None = None) -> dict[str, bytes]:
    """Parts of a zip archive by name, all by default, of at most `MAX_BYTES` together.

    What an archive says of its sizes is not believed: each part is unpacked only as far as it
    is said to reach. A list of contents of more than `MAX_CONTENTS` bytes is not read.

    Raises:
        InputFileError, ResourceLimitError: as `check_readable`; too much to unpack.
        ValueError, LookupError, zipfile.BadZipFile ...: damaged; the caller names it.
    """
    path = check_readable(path, what)
    if _contents_size(path) > MAX_CONTENTS:
        raise ResourceLimitError(str(path), "an archive of very many parts", f"pass a {what}")
    with zipfile.ZipFile(path) as archive:
        entries = [archive.getinfo(name) for name in names or archive.namelist()]
        unpacked = sum(entry.file_size for entry in entries)
        if unpacked > MAX_BYTES:
            got = f"{unpacked} bytes when unpacked"
            raise ResourceLimitError(str(path), got, f"pass a {what} of at most {MAX_BYTES} bytes")
        parts = {}
        for entry in entries:
            if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError("an unusual compression, which unpacks without a bound")
            with archive.open(entry) as part:
                parts[entry.filename] = part.read(entry.file_size)
        return parts


def _contents_size(path: Path) -> int:
    """Bytes of the list of contents, as the end of the archive says."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 2**16 - 98))
        tail = file.read()
    end = tail.rfind(b"PK\5\6")
    if end < 0 or end + 22 > len(tail):
        raise zipfile.BadZipFile("no archive")
    size = int.from_bytes(tail[end + 12 : end + 16], "little")
    if end >= 76 and tail[end - 20 : end].startswith(b"PK\6\7"):  # a wider record is before it
        wider = int.from_bytes(tail[end - 36 : end - 28], "little")
        return max(wider, size % (2**32 - 1))
    return size
