"""Every public name stands in the API pages, as the site's generator reads them."""

from __future__ import annotations

import re
from pathlib import Path

import griffe
import pytest

import torchradiometry
from tests.contracts.test_public_api import SNAPSHOT

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^::: torchradiometry\.(\S+)$", re.M)


@pytest.fixture(scope="module")
def source() -> griffe.Module:
    """The package as mkdocstrings has it: read, not imported."""
    package = griffe.load("torchradiometry", search_paths=[ROOT], allow_inspection=False)
    assert isinstance(package, griffe.Module)
    return package


def missing(source: griffe.Module, room: str, blocks: list[str]) -> set[str]:
    """Public names that are not on a page with these blocks.

    A room's block shows its members that have a docstring; modules, and functions that their
    own module hides, need a block each.
    """
    lines = (line.split(".") for line in SNAPSHOT.read_text().split())
    alone = {path.rsplit(".", 1)[1] for path in blocks if "." in path}
    members = source[room].members

    def inside(name: str) -> bool:
        found = members.get(name)
        return bool(room in blocks and found and not found.is_module and found.has_docstring)

    return {name for place, name in lines if place == room and not inside(name)} - alone


@pytest.mark.parametrize("room", torchradiometry.ROOMS)
def test_every_public_name_is_on_its_api_page(source: griffe.Module, room: str) -> None:
    blocks = BLOCK.findall((ROOT / "docs" / "api" / f"{room}.md").read_text())
    assert all(source[path] for path in blocks)
    assert missing(source, room, blocks) == set()
    assert f"api/{room}.md" in (ROOT / "mkdocs.yml").read_text()


def test_a_name_left_out_is_noticed(source: griffe.Module) -> None:
    alone = "shade.ambient_occlusion.ambient_occlusion"
    assert missing(source, "shade", ["shade"]) == {"ambient_occlusion"}
    assert missing(source, "shade", [alone]) >= {"LambertianShading", "ShadeDepth"}
