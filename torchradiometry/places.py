"""Places that are written to: a whole file, or none.

The bytes go to a temporary name in the same folder, which is renamed when they are complete, so
that an interrupted command leaves no half file. What the system says against it (no permission, a
full disk) is an `OutputFileError`; what can be known beforehand is asked before any work.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from torchradiometry.errors import (
    DTypeError,
    FileFormatError,
    InputFileError,
    OutputFileError,
    RadiometryError,
)

__all__ = [
    "as_path",
    "atomic_path",
    "check_folder_place",
    "check_place",
    "clear_half_files",
    "make_folder",
    "writing",
]


def as_path(path: str | Path) -> Path:
    """The path; `DTypeError` if it is none."""
    if not isinstance(path, str | os.PathLike):
        raise DTypeError("path", f"{path!r}"[:60], "pass a name or a `Path`")
    return Path(path)


@contextmanager
def writing(place: str | Path) -> Iterator[None]:
    """What the system says against writing there, as `OutputFileError`."""
    try:
        yield
    except RadiometryError:
        raise
    except OSError as error:
        got = f"a write that failed ({error.strerror or error})"
        raise OutputFileError(str(place), got, "make room there or name another place") from error


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary name beside `path`, renamed to it when the block ends without an error.

    The ending is kept, so libraries that look at it write the right format.

    Raises:
        InputFileError: its folder does not exist, or it is a folder.
        OutputFileError: the system lets no file be written there.
    """
    path = check_place(path)
    with writing(path):
        handle, name = tempfile.mkstemp(prefix=".", suffix=".tmp" + path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            temporary.chmod(0o666 & ~_umask())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def clear_half_files(folder: str | Path) -> None:
    """Delete what `atomic_path` left in a folder when its process was killed outright."""
    for path in Path(folder).glob(".????????.tmp*"):
        path.unlink(missing_ok=True)


def check_place(path: str | Path, endings: Sequence[str] = ()) -> Path:
    """The path, if a file may be there; otherwise a named error. Nothing is written yet.

    Args:
        path: of a file.
        endings: it must have one of these, in small letters or large; any if there are none.

    Raises:
        FileFormatError: another ending.
        InputFileError: its folder does not exist, or it is a folder.
        OutputFileError: nobody may write there.
    """
    path = as_path(path)
    if endings and path.suffix.lower() not in endings:
        raise FileFormatError(str(path), f"the ending {path.suffix!r}", f"use {', '.join(endings)}")
    if not path.parent.is_dir():
        raise InputFileError(str(path), "a folder that does not exist", f"create {path.parent}")
    if path.is_dir():
        raise InputFileError(str(path), "a folder", "name a file")
    _check_permission(path)
    return path


def check_folder_place(folder: str | Path, what: str) -> Path:
    """The path, if a folder is there or may be made there; otherwise a named error."""
    folder = as_path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputFileError(str(folder), "a file", f"name a folder for the {what}")
    if not folder.absolute().parent.is_dir():
        raise InputFileError(
            str(folder), "a folder that does not exist around it", f"create {folder.parent}"
        )
    _check_permission(folder / "file" if folder.is_dir() else folder)
    return folder


def make_folder(folder: str | Path, what: str) -> Path:
    """The folder, made if it is not there.

    Raises:
        InputFileError: a file is there, or no folder around it.
        OutputFileError: the system lets none be made.
    """
    folder = check_folder_place(folder, what)
    with writing(folder):
        folder.mkdir(exist_ok=True)
    return folder


def _check_permission(path: Path) -> None:
    if not os.access(path.absolute().parent, os.W_OK | os.X_OK):
        got = f"no permission to write in {path.parent}"
        raise OutputFileError(str(path), got, "name another place")


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
