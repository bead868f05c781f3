"""Every example runs, quickly, and its figures make sense."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_local_and_global(tmp_path: Path) -> None:
    shares = load("local_and_global").main(fast=True, out=tmp_path / "room.png")
    assert 0.2 < shares["direct"] < shares["one bounce"] < 1
    assert (tmp_path / "room.png").stat().st_size > 500


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_every_example_has_a_test_here(path: Path) -> None:
    assert f"def test_{path.stem}" in Path(__file__).read_text()
