"""Pictures beside each other keep their pixels; bars keep to plain text."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from torchradiometry.demo import tradeoff_folder
from torchradiometry.demo.curve import write_panels
from torchradiometry.demo.progress import progress_bar
from torchradiometry.files import read_picture, srgb_to_linear


def test_panels_keep_every_pixel(tmp_path: Path) -> None:
    pictures = np.random.default_rng(0).random((2, 3, 6, 9, 3)).astype(np.float32)
    out = tmp_path / "more" / "panels.png"
    write_panels(out, pictures, ("a", "b", "c"), names=("up", "down"), scale=2)
    found = srgb_to_linear(read_picture(out))
    assert found.shape == (18 + 2 * 12 + 4, 18 + 3 * 18 + 2 * 4, 3)
    for r, row in enumerate(pictures):
        for c, picture in enumerate(row):
            top, left = 18 + r * 16, 18 + c * 22
            shown = found[top : top + 12 : 2, left : left + 18 : 2]
            np.testing.assert_allclose(shown, picture, atol=0.01)


def test_a_ladder_tells_how_far_it_is(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    tradeoff_folder("ball", tmp_path / "ball", width=8, height=6, repeats=1)
    said = capfd.readouterr().err
    done, total = re.search(r"Measuring rungs.* (\d+)/(\d+) ", said).groups()
    assert done == total
    assert "plan 1 %" in said


def test_no_colour_where_none_is_wanted(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    with progress_bar(("Rungs", 2)) as (advance,):
        advance(2, "")
    assert "\x1b[3" not in capfd.readouterr().err


def test_a_note_is_shown_as_it_is(capfd: pytest.CaptureFixture[str]) -> None:
    """It may be the name of a folder, which is no markup."""
    with progress_bar(("Objects", 1)) as (advance,):
        advance(1, "[/b][red]ball")
    assert "[/b][red]ball" in capfd.readouterr().err
