"""The demo's page: escaped, complete, and all or nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from torchradiometry.demo.page import Figure, Section, Table, staged_folder, write_page
from torchradiometry.errors import InputFileError

SECTION = Section(
    title="1. <Compare>",
    words=("a & b",),
    figures=(Figure("ball.png", 'the "ball"'),),
    tables=(Table(("what", "degrees"), (("network", "4.2"),)),),
)


def test_page_holds_every_part_and_escapes_it(tmp_path: Path) -> None:
    html = write_page(tmp_path, "Title <1>", "lead", [SECTION]).read_text()
    for part in ("Title &lt;1&gt;", "1. &lt;Compare&gt;", "a &amp; b", "ball.png", "<td>4.2</td>"):
        assert part in html
    assert "<Compare>" not in html


def test_staged_files_arrive_together(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    (target / "kept.txt").write_text("mine")
    with staged_folder(target) as stage:
        (stage / "index.html").write_text("page")
        assert not (target / "index.html").exists()
    assert sorted(p.name for p in target.iterdir()) == ["index.html", "kept.txt"]
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_interrupt_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with staged_folder(tmp_path / "out") as stage:
            (stage / "index.html").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_bad_targets_are_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for target in (tmp_path / "file", tmp_path / "none" / "out"):
        with pytest.raises(InputFileError), staged_folder(target):
            pass
