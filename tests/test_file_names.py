"""File names of every kind the system allows: read, written and shown, Unicode or not."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes

import numpy as np
import pytest

from tests.demo.test_run import write_sphere_set
from tests.test_places import RADIANCE, WRITERS
from torchradiometry import files
from torchradiometry.demo.benchmark import run_benchmark
from torchradiometry.demo.page import Figure, Section, write_page
from torchradiometry.scene.build import cornell_like_room
from torchradiometry.scene.write import save_scene

NAMES = {
    "Latin-1, which is no Unicode": b"caf\xe9",
    "Chinese": "图像".encode(),
    "marks of an address": b"a #1 50%?&'\"",
    "a line break": b"two\nlines",
    "marks of a terminal's text": b"[red]x [b] :cat:",
}


@pytest.fixture(params=NAMES.values(), ids=NAMES)
def folder(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    made = tmp_path / os.fsdecode(request.param)
    try:
        made.mkdir()
    except OSError as error:
        pytest.skip(f"this file system has no such names: {error}")
    return made


@pytest.mark.parametrize("writer", WRITERS.values(), ids=WRITERS)
def test_every_writer_takes_it(folder: Path, writer: Callable[[Path], object]) -> None:
    writer(folder)
    names = [path.name for path in folder.rglob("*") if path.is_file()]
    assert names
    assert not any(".tmp" in name for name in names)


@pytest.mark.parametrize("ending", files.PICTURE_ENDINGS)
def test_a_picture_under_it_is_read(folder: Path, ending: str) -> None:
    path = files.write_picture(folder / (folder.name + ending), RADIANCE)
    plain = files.write_picture(folder.parent / f"a{ending}", RADIANCE)
    np.testing.assert_array_equal(files.read_picture(path), files.read_picture(plain))


def test_an_object_of_that_name_is_measured_and_listed(folder: Path) -> None:
    write_sphere_set(folder.parent / "ball").rename(folder / folder.name)
    table = folder.parent / "t.csv"
    found = run_benchmark("photometric", folder, draws=0, table=table)
    assert found.report["rows"]["this model, all lights"][folder.name] < 5
    shown = folder.name.encode(errors="backslashreplace").decode()
    assert all(word in found.table for word in folder.name.split())
    with table.open(newline="", encoding="utf-8") as file:
        assert [line["name"] for line in csv.DictReader(file)] == [shown]


def test_a_page_finds_its_pictures(folder: Path) -> None:
    sources = []

    class Pictures(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            sources.extend(value for name, value in attrs if name == "src")

    (folder / f"{folder.name}.png").touch()
    figure = Figure(f"{folder.name}.png", folder.name)
    Pictures().feed(write_page(folder, "t", "l", [Section("s", (), (figure,))]).read_text("utf-8"))
    (source,) = sources
    assert not set(source) & set("#?\n")
    assert (folder / os.fsdecode(unquote_to_bytes(source))).is_file()


def test_a_command_reads_and_writes_it(folder: Path) -> None:
    room = save_scene(cornell_like_room(), folder / f"{folder.name}.glb")
    out = folder / f"{folder.name}.exr"
    done = run("render", room, "--out", out, "--tolerance", "0.3")
    assert done.returncode == 0, done.stderr[-500:]
    assert files.read_picture(out).max() > 0
    done = run("plan", folder / "none.glb")
    assert done.returncode == 2
    assert b"no such file" in done.stderr
    assert b"Traceback" not in done.stderr


def run(*words: str | Path) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "torchradiometry", *words]
    return subprocess.run(command, capture_output=True, check=False, timeout=300)
