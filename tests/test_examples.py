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


def test_gilchrist(tmp_path: Path) -> None:
    white, black = load("gilchrist").main(fast=True, out=tmp_path / "rooms.png").values()
    assert black["dynamic range"] > 10 * white["dynamic range"] > 10
    assert black["shadow depth"] > 2 * white["shadow depth"] > 0
    assert black["sharpness"] > 5 * white["sharpness"] > 0
    assert 0 < black["reflected share"] < 0.1 < 0.8 < white["reflected share"] < 1
    assert (tmp_path / "rooms.png").stat().st_size > 500


def test_reflexes(tmp_path: Path) -> None:
    found = load("reflexes").main(fast=True, out=tmp_path / "reflexes.png")
    for measured, wanted in found.values():
        assert measured == pytest.approx(wanted, rel=0.02, abs=0.02)
    assert (tmp_path / "reflexes.png").stat().st_size > 500


def test_concave_relief(tmp_path: Path) -> None:
    found = load("concave_relief").main(fast=True, out=tmp_path / "reliefs.png")
    for errors in found.values():
        assert errors["global"] < errors["local"] / 2
        assert errors["global, albedo unknown"] < errors["local, albedo unknown"] / 2
    assert (tmp_path / "reliefs.png").stat().st_size > 500


def test_bounce_separation(tmp_path: Path) -> None:
    errors = load("bounce_separation").main(fast=True, out=tmp_path / "bounces.png")
    assert errors["direct light"] < errors["photograph as direct light"] / 10
    assert errors["left in the shadow"] < 0.1
    assert errors["bounce 1"] < 0.1
    assert (tmp_path / "bounces.png").stat().st_size > 500


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_every_example_has_a_test_here(path: Path) -> None:
    assert f"def test_{path.stem}" in Path(__file__).read_text()
