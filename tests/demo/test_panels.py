"""Pictures beside each other keep their pixels; a bar learns its length on the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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


def test_a_bar_may_learn_its_length_on_the_way(capfd: pytest.CaptureFixture[str]) -> None:
    with progress_bar(("Rungs", 1)) as (advance,):
        advance(3, "the last", 4)
    assert "3/4" in capfd.readouterr().err


def test_no_colour_where_none_is_wanted(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    with progress_bar(("Rungs", 2)) as (advance,):
        advance(2, "")
    assert "\x1b[3" not in capfd.readouterr().err
