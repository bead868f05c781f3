"""The JSON tree of a glTF file, read with its types and ranges checked.

Nothing in a file is trusted: each look-up names the place in the tree where it found something
else than the format allows.

References: Khronos, *glTF 2.0 Specification* (2021), chapter 5 (properties reference).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from torchradiometry.errors import FileFormatError, ResourceLimitError

__all__ = ["LETTERS", "Fields"]

MEND = "repair the file, or export it again"
#: entries of one list of the tree, and letters of what an error quotes or a node is called
MAX_ENTRIES, LETTERS = 2**18, 200


@dataclass(frozen=True)
class Fields:
    """One JSON object of a file, with its place in the tree.

    Args:
        file: name of the file, for messages.
        place: where in the tree, such as `nodes[3]`.
        values: the object.
    """

    file: str
    place: str
    values: dict[str, Any]

    def fault(self, key: str, got: str, mend: str = MEND) -> FileFormatError:
        """The error for what was got at `key`."""
        place = f"{self.place}.{key}" if self.place and key else self.place or key
        return FileFormatError(f"{self.file}, {place}", got[:LETTERS], mend)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def integer(self, key: str, default: int | None = None, most: int | None = None) -> int:
        """A whole number >= 0, at most `most`; an error if absent and no default is given."""
        value = self._found(key, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise self.fault(key, _shown(value))
        if most is not None and value > most:
            raise self.fault(key, f"{value}, beyond {most}")
        return value

    def index(self, key: str, table: list[Fields]) -> Fields:
        """The member of `table` that the index at `key` names."""
        if not table:
            raise self.fault(key, "an index into an empty or missing list")
        return table[self.integer(key, most=len(table) - 1)]

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number."""
        return self._finite(key, self._found(key, default))

    def numbers(self, key: str, count: int, default: tuple[float, ...]) -> tuple[float, ...]:
        """`count` finite numbers."""
        values = self.values.get(key)
        if values is None:
            return default
        if not isinstance(values, list) or len(values) != count:
            raise self.fault(key, _shown(values), f"give {count} numbers")
        return tuple(self._finite(key, value) for value in values)

    def text(self, key: str, default: str | None = None) -> str:
        """A string."""
        value = self._found(key, default)
        if not isinstance(value, str):
            raise self.fault(key, _shown(value))
        return value

    def flag(self, key: str) -> bool:
        """A truth value, false by default."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            raise self.fault(key, _shown(value))
        return value

    def record(self, key: str) -> Fields:
        """The object at `key`, empty if absent."""
        return self._record(key, self.values.get(key, {}))

    def extension(self, name: str) -> Fields | None:
        """The object of a glTF extension here, or None."""
        extensions = self.record("extensions")
        return extensions.record(name) if name in extensions else None

    def records(self, key: str) -> list[Fields]:
        """The list of objects at `key`, empty if absent."""
        return [self._record(f"{key}[{k}]", v) for k, v in enumerate(self._list(key))]

    def integers(self, key: str) -> list[int]:
        """The list of whole numbers >= 0 at `key`, empty if absent."""
        values = self._list(key)
        if not all(isinstance(v, int) and not isinstance(v, bool) and v >= 0 for v in values):
            raise self.fault(key, _shown(values), "list indices")
        return values

    def texts(self, key: str) -> list[str]:
        """The list of strings at `key`, empty if absent."""
        return [str(value) for value in self._list(key)]

    def _list(self, key: str) -> list[Any]:
        values = self.values.get(key, [])
        if not isinstance(values, list):
            raise self.fault(key, _shown(values), "make it a list")
        if len(values) > MAX_ENTRIES:
            where = f"{self.file}, {self.place}.{key}".replace(", .", ", ")
            got = f"{len(values)} entries"
            raise ResourceLimitError(where, got, f"give at most {MAX_ENTRIES}")
        return values

    def _record(self, key: str, value: object) -> Fields:
        if not isinstance(value, dict):
            raise self.fault(key, _shown(value), "make it an object")
        return Fields(self.file, f"{self.place}.{key}" if self.place else key, value)

    def _found(self, key: str, default: object) -> Any:
        value = self.values.get(key, default)
        if value is None:
            raise self.fault(key, "nothing", "the format requires it; " + MEND)
        return value

    def _finite(self, key: str, value: object) -> float:
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            raise self.fault(key, _shown(value), "give numbers")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.fault(key, _shown(value), "give finite numbers")
        return number


def _shown(value: object) -> str:
    """A short description of an unexpected value."""
    text = repr(value) if isinstance(value, (int, float, str, bool, type(None))) else ""
    return text if 0 < len(text) <= 60 else f"a {type(value).__name__}"
