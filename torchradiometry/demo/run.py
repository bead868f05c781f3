"""The main job, end to end: compare, shade, train, export, run on real photographs.

Everything is checked before the long work begins (the folder of photographs, the place of the
page); the result appears in one folder when it is complete.
"""

from __future__ import annotations

import time
from pathlib import Path

from torchradiometry.demo.compare import compare_with_rasteriser
from torchradiometry.demo.network import train_and_export
from torchradiometry.demo.page import Section, staged_folder, write_page
from torchradiometry.demo.photographs import portrait_section, sets_of, sets_section
from torchradiometry.demo.progress import progress_bar

__all__ = ["run_demo"]

LEAD = (
    "Light is simulated by PyTorch layers, checked against a rasteriser, used to train a network "
    "that sees shape in shading, and the network is run, without torch, on real photographs."
)


def run_demo(
    out: str | Path, *, images: str | Path | None = None, fast: bool = False
) -> dict[str, object]:
    """Run the five steps and leave a folder with `index.html`.

    Args:
        out: folder for the page; made if it is not there.
        images: one set of photographs under known lights, or a folder of sets; by default a
            portrait that matplotlib ships.
        fast: smaller pictures and a shorter training.

    Returns:
        `page`, `seconds`, and the figures of each step under its title.

    Raises:
        InputFileError: no photographs in `images`, or no place for `out`.
        MissingDependencyError: an extra is not installed.
    """
    began = time.perf_counter()
    out = Path(out)
    sets = None if images is None else sets_of(Path(images))
    with staged_folder(out) as folder:
        sections = _steps(folder, sets, fast)
        write_page(folder, "torchradiometry: from shading to shape", LEAD, sections)
    return {
        "page": str(out / "index.html"),
        "seconds": time.perf_counter() - began,
        "steps": {section.title: section.data for section in sections},
    }


def _steps(folder: Path, sets: list[Path] | None, fast: bool) -> list[Section]:
    with progress_bar(("Comparing with a rasteriser", 1)) as (advance,):
        compared = compare_with_rasteriser(folder, 192 if fast else 384)
        advance(1, "")
    trained = train_and_export(folder, fast)
    photographs = (
        portrait_section(folder) if sets is None else sets_section(folder, sets, trained.model)
    )
    return [compared, *trained.sections, photographs]
