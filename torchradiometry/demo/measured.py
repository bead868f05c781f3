"""A measured ladder of a scene, with a progress bar."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from torchradiometry.demo.progress import Advance, progress_bar
from torchradiometry.plan.tradeoff_file import tradeoff_file

__all__ = ["tradeoff_folder"]


def tradeoff_folder(
    scene: str | Path, out: str | Path, *, width: int, height: int, repeats: int
) -> dict[str, object]:
    """`tradeoff_file`, which takes minutes: a bar says how many rungs are left, and the time."""
    with ExitStack() as shown:
        bars: list[Advance] = []

        def tell(done: int, total: int, name: str) -> None:
            if not bars:  # nothing is shown before what may be wrong with the arguments
                bars.extend(shown.enter_context(progress_bar(("Measuring rungs", total))))
            bars[0](done, name)

        return tradeoff_file(scene, out, width=width, height=height, repeats=repeats, progress=tell)
