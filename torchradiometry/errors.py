"""The named errors: each says where, what was got, and how to mend it.

Every error the package raises on purpose derives from `RadiometryError` and from the
built-in class that a Python reader expects (`ValueError`, `TypeError`, `IndexError` ...), so
`except ValueError` keeps working. The message always has three parts, in this order: the
argument or object, what was got, what to do. The command line prints it as one sentence and
leaves with exit code 2.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

__all__ = [
    "DTypeError",
    "DegenerateGeometryError",
    "EmptySceneError",
    "FileFormatError",
    "IndexRangeError",
    "InputFileError",
    "InvalidValueError",
    "MissingDependencyError",
    "NoGraphicsError",
    "NotConvergedError",
    "NotConvergedWarning",
    "OutOfRangeError",
    "OutputFileError",
    "RadiometryError",
    "ResourceLimitError",
    "ShapeError",
    "SingularSystemError",
]


#: whole numbers from here on are not written out: Python refuses to for some
LONGEST = 10**15


class RadiometryError(Exception):
    """Base of every error raised on purpose: `where`, what was `got`, and how to `mend` it.

    Args:
        where: the argument, file or part of the scene at fault.
        got: what was found there.
        mend: what to do about it, as an imperative.

    >>> str(ShapeError("normal", "a tensor of shape (2, 4, 8, 8)", "pass B x 3 x H x W"))
    'normal: got a tensor of shape (2, 4, 8, 8); pass B x 3 x H x W.'
    """

    def __init__(self, where: str, got: str, mend: str) -> None:
        self.where, self.got, self.mend = where, got, mend
        super().__init__(f"{where}: got {got}; {mend}.")


class InvalidValueError(RadiometryError, ValueError):
    """A value is NaN or infinite where a finite number is needed."""


class OutOfRangeError(RadiometryError, ValueError):
    """A value lies outside its physical range (an albedo of 1.2, a negative radiance)."""


class DegenerateGeometryError(RadiometryError, ValueError):
    """A shape has no area, no direction or no plane (a zero-area face, a zero-length normal)."""


class ShapeError(RadiometryError, ValueError):
    """A tensor has the wrong rank, channel count or size."""


class DTypeError(RadiometryError, TypeError):
    """A tensor has the wrong dtype or device, or an argument the wrong Python type."""


class IndexRangeError(RadiometryError, IndexError):
    """A face, patch or instance index points at nothing."""


class SingularSystemError(RadiometryError, ArithmeticError):
    """The radiosity system has no unique solution (albedo 1 in a closed enclosure)."""


class NotConvergedError(RadiometryError, ArithmeticError):
    """An iteration stopped before its tolerance and the caller asked for an error."""


class NotConvergedWarning(UserWarning):
    """An iteration stopped before its tolerance; its last values were returned."""


class EmptySceneError(RadiometryError, ValueError):
    """The scene has nothing to shade, nothing that shines, or nothing that looks."""


class ResourceLimitError(RadiometryError, MemoryError):
    """The request would need more memory or time than its stated budget."""


class InputFileError(RadiometryError, OSError):
    """A file or folder is missing or cannot be read."""


class OutputFileError(RadiometryError, OSError):
    """The system lets no file be written: no permission, a full disk."""


class FileFormatError(RadiometryError, ValueError):
    """A file was read but does not hold what it should."""


class MissingDependencyError(RadiometryError, ImportError):
    """An optional library is not installed; the message names the extra that brings it."""


class NoGraphicsError(RadiometryError, RuntimeError):
    """No OpenGL context can be made; the message names the system package to install."""


def require_floating(where: str, tensor: Tensor) -> None:
    """Raise `DTypeError` unless it is a tensor that holds real floating-point numbers."""
    if not hasattr(tensor, "is_floating_point"):
        got = "None" if tensor is None else f"a {type(tensor).__name__}"
        raise DTypeError(where, got, "pass a tensor of floating-point numbers")
    if not tensor.is_floating_point():
        raise DTypeError(where, f"a tensor of {tensor.dtype}", "pass floating-point numbers")


def require_axes(where: str, tensor: Tensor, *axes: int | None) -> None:
    """Raise unless a tensor holds real numbers and ends in these axes (None: of any size).

    Raises:
        DTypeError: integer, complex or truth values.
        ShapeError: fewer axes, or others.
    """
    require_floating(where, tensor)
    shape = tensor.shape
    first = len(shape) - len(axes)
    if first < 0 or any(n is not None and n != shape[first + i] for i, n in enumerate(axes)):
        wanted = " ".join("n" if n is None else str(n) for n in axes)
        raise ShapeError(where, f"a tensor of shape {tuple(shape)}", f"pass `... {wanted}`")


def require_kind(where: str, value: object, kind: type, name: str | None = None) -> None:
    """Raise `DTypeError` unless a value is of a class; `name`: as what the class is known."""
    if not isinstance(value, kind):
        got = "None" if value is None else f"a {type(value).__name__}"
        raise DTypeError(where, got, f"pass a {name or kind.__name__}")


def require_device(where: str, tensor: Tensor, other: str, like: Tensor) -> None:
    """Raise `DTypeError` unless a tensor lies on the device of another, which is named too."""
    if tensor.device != like.device:
        got = f"a tensor on {tensor.device} beside {other} on {like.device}"
        raise DTypeError(where, got, "bring both to one device")


def require_whole(where: str, value: object, least: int, most: int | None = None) -> None:
    """Raise unless a value is a whole number of a range.

    Raises:
        DTypeError: another kind of value, truth values among them.
        OutOfRangeError: too small, or too large.
    """
    if not isinstance(value, int) or isinstance(value, bool):
        raise DTypeError(where, f"{value!r}", "pass a whole number")
    if value < least or (most is not None and value > most):
        got = f"{value}" if abs(value) < LONGEST else "a number of more than 15 digits"
        mend = f"pass {least} or more" + ("" if most is None else f", at most {most}")
        raise OutOfRangeError(where, got, mend)


def require_between(where: str, value: object, low: float, high: float, what: str) -> None:
    """Raise unless a number lies inside a range, its ends left out; `what`: to pass.

    Raises:
        DTypeError: no number.
        OutOfRangeError: NaN, or outside.
    """
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise DTypeError(where, f"{value!r}", f"pass {what}")
    if not low < value < high or abs(value) > sys.float_info.max:
        got = f"{value!r}" if not abs(value) >= LONGEST else "a number of more than 15 digits"
        raise OutOfRangeError(where, got, f"pass {what}")
