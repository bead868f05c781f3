"""Plots of the demo."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchradiometry.errors import MissingDependencyError
from torchradiometry.files import linear_to_srgb
from torchradiometry.places import atomic_path, writing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_learning_curve", "sample_photograph", "show_radiance", "write_panels"]


def draw_learning_curve(path: Path, losses: Sequence[float], degrees: Sequence[float]) -> None:
    """Loss and mean angle over training steps, raw and smoothed."""
    _matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.2), layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, values, name in zip(panels, (losses, degrees), ("loss", "degrees"), strict=True):
        window = max(1, len(values) // 40)
        sums = list(accumulate(values, initial=0.0))
        smooth = [(b - a) / window for a, b in zip(sums, sums[window:], strict=False)]
        axes.plot(range(1, len(values) + 1), values, color="0.75", linewidth=0.7, label="each step")
        axes.plot([k + window / 2 for k in range(len(smooth))], smooth, label=f"mean of {window}")
        axes.set(xlabel="step", ylabel=name, ylim=(0, None))
    panels[1].legend(frameon=False)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110)


def write_panels(
    path: Path,
    rows: Sequence[Sequence[NDArray[np.floating]]],
    columns: Sequence[str],
    *,
    names: Sequence[str] = (),
    exposure: float = 1.0,
    scale: int = 1,
) -> None:
    """Pictures of one size beside each other, each column and row with its name.

    Args:
        path: a `.png`.
        rows: pictures `H x W x 3`, linear.
        columns: what stands above each column.
        names: what stands on the left of each row.
        exposure: factor before sRGB encoding.
        scale: pixels on the screen for each of a picture, across and down.
    """
    _matplotlib()
    from matplotlib.figure import Figure

    height, width = (scale * n for n in rows[0][0].shape[:2])
    left, top, gap, dots = (18 if names else 0), 18, 4, 100
    across = left + len(columns) * (width + gap) - gap
    down = top + len(rows) * (height + gap) - gap
    figure = Figure(figsize=(across / dots, down / dots), dpi=dots)
    for r, row in enumerate(rows):
        below = 1 - (top + r * (height + gap) + height) / down
        if names:
            place = below + height / 2 / down
            figure.text(4 / across, place, names[r], rotation=90, va="center", fontsize=7.5)
        for c, picture in enumerate(row):
            start = (left + c * (width + gap)) / across
            axes = figure.add_axes((start, below, width / across, height / down))
            axes.imshow(
                linear_to_srgb((exposure * np.asarray(picture)).clip(0, 1)),
                interpolation="nearest",
                aspect="auto",
            )
            axes.set_axis_off()
            if r == 0:
                axes.set_title(columns[c], fontsize=7.5, pad=3)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=dots, pil_kwargs={"optimize": True})


def show_radiance(axes: Axes, radiance: Tensor, title: str, exposure: float) -> None:
    """A linear picture `H W 3`, or `H W`, as a screen shows it."""
    radiance = radiance if radiance.ndim == 3 else radiance.unsqueeze(-1).expand(-1, -1, 3)
    axes.imshow(linear_to_srgb((exposure * radiance).clamp(0, 1).double().numpy()))
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()


def sample_photograph() -> Path:
    """The portrait photograph that matplotlib ships (Grace Hopper, US Navy, public domain)."""
    _matplotlib()
    from matplotlib.cbook import get_sample_data

    return Path(str(get_sample_data("grace_hopper.jpg", asfileobj=False)))


def _matplotlib() -> None:
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise MissingDependencyError(
            "matplotlib", "no installation", "run: pip install 'torchradiometry[learn]'"
        ) from error
