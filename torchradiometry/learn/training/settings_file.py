"""Training descriptions as TOML files: read strictly, written so that they read back equal.

    kind = "photometric"
    steps = 1500
    [surfaces]
    shapes = 200

A key that is left out has its default; an unknown key, a value of the wrong type and a file of
another kind are named errors.

References: *TOML v1.0.0*, https://toml.io.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from torchradiometry.errors import FileFormatError, MissingDependencyError
from torchradiometry.files import MAX_SETTINGS, check_readable
from torchradiometry.learn.training.settings import KINDS, Training, kind_of
from torchradiometry.places import atomic_path

__all__ = ["read_training", "training_from_table", "training_table", "write_training"]

T = TypeVar("T")

#: what to write for a field of each type
WANTED = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


def read_training(path: str | Path) -> Training:
    """The training that a TOML file describes.

    Raises:
        InputFileError: no such file.
        FileFormatError: not TOML, no or another `kind`, an unknown key, a value of another type.
        OutOfRangeError: a value outside its range.
    """
    path = check_readable(path, "settings file", MAX_SETTINGS)
    try:
        table = _tomllib().loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError
        reason = str(error).partition("\n")[0]
        raise FileFormatError(str(path), f"no TOML ({reason})", "write key = value") from error
    return training_from_table(table, str(path))


def write_training(path: str | Path, training: Training) -> Path:
    """Write a training as TOML, atomically; `read_training` gives an equal one."""
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(_lines(training_table(training))) + "\n", encoding="utf-8")
    return Path(path)


def training_table(training: Training) -> dict[str, Any]:
    """`kind` and every field, nested: what TOML, JSON and checkpoints hold."""
    table = {"kind": kind_of(training), **asdict(training)}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in table.items()}


def training_from_table(table: Mapping[str, Any], where: str) -> Training:
    """The training that `training_table` described.

    Raises:
        FileFormatError: no or another `kind`, an unknown key, a value of another type.

    >>> training_from_table({"kind": "shading", "steps": 7}, "here").steps
    7
    """
    rest = dict(table)
    kind = rest.pop("kind", None)
    if not isinstance(kind, str) or kind not in KINDS:
        got = "no kind" if kind is None else f"kind = {kind!r}"
        raise FileFormatError(where, got, f"write kind = {' or '.join(map(json.dumps, KINDS))}")
    return _built(KINDS[kind], rest, where, "")


def _built(kind: type[T], table: Mapping[str, Any], where: str, prefix: str) -> T:
    hints = get_type_hints(kind)
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    for key in table:
        if key not in known:
            near = get_close_matches(key, known, 1)
            mend = f"write {prefix}{near[0]}" if near else f"use {', '.join(known)}"
            raise FileFormatError(where, f"the unknown key {prefix}{key}", mend)
    values = {k: _value(hints[k], v, where, prefix + k) for k, v in table.items()}
    return kind(**values)


def _value(hint: Any, value: Any, where: str, key: str) -> Any:
    """A TOML value as a field of type `hint`; None stands for a key that is left out."""
    if get_origin(hint) in (Union, UnionType):
        (hint,) = (each for each in get_args(hint) if each is not NoneType)
    if is_dataclass(hint) and isinstance(hint, type):
        if isinstance(value, Mapping):
            return _built(hint, value, where, f"{key}.")
        raise _wrong(where, key, value, f"a table [{key}]")
    if get_origin(hint) is tuple:
        if isinstance(value, list | tuple):
            return tuple(_value(get_args(hint)[0], each, where, key) for each in value)
        raise _wrong(where, key, value, "a list")
    if hint is float and type(value) is int:
        return float(value)
    if type(value) is not hint:
        raise _wrong(where, key, value, WANTED[hint])
    return value


def _wrong(where: str, key: str, value: Any, wanted: str) -> FileFormatError:
    return FileFormatError(where, f"{key} = {value!r}", f"write {wanted}")


def _lines(table: Mapping[str, Any], name: str = "") -> list[str]:
    """Plain values first, then each table under its name."""
    kept = {key: value for key, value in table.items() if value is not None}
    plain = {key: value for key, value in kept.items() if not isinstance(value, Mapping)}
    lines = [f"{key} = {_text(value)}" for key, value in plain.items()]
    for key, value in kept.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{name}{key}]", *_lines(value, f"{name}{key}.")]
    return lines


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)


def _tomllib() -> Any:
    """The standard library's reader; before Python 3.11 the package it was made of."""
    name = "tomllib" if sys.version_info >= (3, 11) else "tomli"
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingDependencyError(
            name, "no installation", "run: pip install 'torchradiometry[learn]'"
        ) from error
