"""Plots of the demo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from torchradiometry.errors import MissingDependencyError
from torchradiometry.files import atomic_path

__all__ = ["draw_learning_curve", "sample_photograph"]


def draw_learning_curve(path: Path, degrees: Sequence[float]) -> None:
    """Mean angle over training steps, raw and smoothed."""
    _matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3.2), layout="constrained")
    axes = figure.add_subplot()
    window = max(1, len(degrees) // 40)
    smooth = [sum(degrees[k : k + window]) / window for k in range(len(degrees) - window + 1)]
    axes.plot(range(1, len(degrees) + 1), degrees, color="0.75", linewidth=0.7, label="each step")
    axes.plot([k + window / 2 for k in range(len(smooth))], smooth, label=f"mean of {window}")
    axes.set(xlabel="step", ylabel="degrees", ylim=(0, None))
    axes.legend(frameon=False)
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
