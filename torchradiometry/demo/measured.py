"""A measured ladder of a scene, with a progress bar."""

from __future__ import annotations

from pathlib import Path

from torchradiometry.demo.progress import progress_bar
from torchradiometry.plan.tradeoff_file import tradeoff_file

__all__ = ["tradeoff_folder"]


def tradeoff_folder(
    scene: str | Path, out: str | Path, *, width: int, height: int, repeats: int
) -> dict[str, object]:
    """`tradeoff_file`, which takes minutes: a bar says how many rungs are left, and the time."""
    with progress_bar(("Measuring rungs", 1)) as (advance,):
        return tradeoff_file(
            scene,
            out,
            width=width,
            height=height,
            repeats=repeats,
            progress=lambda done, total, name: advance(done, name, total),
        )
