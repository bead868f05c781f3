"""Plots of the demo."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path

from torchradiometry.errors import MissingDependencyError
from torchradiometry.files import atomic_path

__all__ = ["draw_learning_curve", "sample_photograph"]


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
