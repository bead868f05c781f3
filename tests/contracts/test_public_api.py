"""What the package promises by name; a change here is a change users see."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import torchradiometry

SNAPSHOT = Path(__file__).with_name("public_api.txt")


def public_names() -> list[str]:
    return [
        f"{room}.{name}"
        for room in torchradiometry.ROOMS
        for name in sorted(import_module(f"torchradiometry.{room}").__all__)
    ]


def test_public_names_match_the_snapshot() -> None:
    assert public_names() == SNAPSHOT.read_text().split()


def test_no_name_stands_in_two_rooms() -> None:
    names = [entry.split(".")[1] for entry in public_names()]
    assert len(names) == len(set(names))


def test_every_public_name_is_reachable_from_the_top() -> None:
    for entry in public_names():
        room, name = entry.split(".")
        expected = getattr(import_module(f"torchradiometry.{room}"), name)
        assert getattr(torchradiometry, name) is expected


def test_star_import_brings_every_public_name() -> None:
    found: dict[str, object] = {}
    exec("from torchradiometry import *", found)
    assert {entry.split(".")[1] for entry in public_names()} <= set(found)
    assert set(dir(torchradiometry)) >= {"LambertianShading", "shade", "__version__"}


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="LambertianShader"):
        _ = torchradiometry.LambertianShader


@pytest.mark.parametrize("touch", ["", "torchradiometry.LambertianShading"])
def test_import_leaves_optional_libraries_alone(touch: str) -> None:
    code = (
        "import torch, sys, torchradiometry\n"
        f"{touch}\n"
        "heavy = {'pyrender', 'onnxruntime', 'cv2', 'matplotlib', 'onnx', 'typer', 'jaxtyping'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
