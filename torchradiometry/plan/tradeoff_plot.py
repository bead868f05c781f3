"""Error over time of the measured ladder, as a figure that a paper can print.

Both axes are logarithmic. A filled mark is a rung's forward time, the bar beside it its spread,
the fine line leads to its time with gradients; the grey steps are the best error so far. Every
name stands at the nearest place where it covers nothing, joined to its mark by a thin line.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from torchradiometry.errors import MissingDependencyError
from torchradiometry.places import atomic_path, check_place

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

__all__ = ["ENDINGS", "draw_tradeoff", "require_matplotlib"]

Row = Mapping[str, object]
Line = tuple[tuple[float, float], tuple[float, float]]

ENDINGS = (".pdf", ".png", ".svg")
#: of the figure, inches, and dots per inch where it has pixels
SIZE, DOTS = (6.4, 4.4), 200
#: of what a mark needs, points
MARK = 7.0
#: distance of a name from its mark: steps tried, points
STEPS = (7, 13, 20, 28, 38, 50, 64, 80, 100, 125, 150)
#: directions tried, first to the right
WAYS = 24
#: colour and mark of each kind of rung (Okabe and Ito's colours, told apart by all eyes)
KINDS = {
    "direct light": ("#0072B2", "o"),
    "ambient light": ("#CC79A7", "D"),
    "bounces": ("#E69F00", "v"),
    "bounces and tail": ("#009E73", "^"),
    "chosen": ("#D55E00", "*"),
}


def require_matplotlib() -> None:
    """Raise the named error where matplotlib is missing."""
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise MissingDependencyError(
            "matplotlib", "no installation", "run: pip install 'torchradiometry[learn]'"
        ) from error


def draw_tradeoff(path: str | Path, rows: Sequence[Row]) -> Path:
    """Write the figure.

    Args:
        path: ends in `.pdf`, `.png` or `.svg`.
        rows: as `Measured.to_dict()` gives them; those of error 0 are not drawn.

    Raises:
        FileFormatError: another ending.
        MissingDependencyError: matplotlib is not installed.
    """
    path = check_place(path, ENDINGS)
    require_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.add_subplot()
    drawn = [row for row in rows if _number(row, "error") > 0]
    lines = _draw_rungs(axes, drawn)
    _dress(axes, drawn)
    figure.set_dpi(DOTS)
    _name_rungs(figure, axes, drawn, lines)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=DOTS)
    return path


def kind_of(row: Row) -> str:
    """Which of `KINDS` a row is."""
    settings = row["settings"]
    assert isinstance(settings, Mapping)
    if row["chosen"]:
        return "chosen"
    if settings.get("bounces") == 0:
        return "ambient light" if settings.get("ambient") else "direct light"
    return "bounces and tail" if settings.get("ambient_tail", True) else "bounces"


def _number(row: Row, key: str) -> float:
    return float(row[key])  # type: ignore[arg-type]


def _draw_rungs(axes: Axes, rows: Sequence[Row]) -> list[Line]:
    """Marks, spreads, times with gradients, the best error so far; and the lines among them."""
    lines = _frontier(rows)
    for start, end in lines:
        axes.plot(*zip(start, end, strict=True), color="0.8", linewidth=1.2, zorder=1)
    for row in rows:
        x, y, later = (_number(row, key) for key in ("seconds", "error", "gradient_seconds"))
        colour, mark = KINDS[kind_of(row)]
        axes.plot([x, later], [y, y], color=colour, linewidth=0.6, marker="|", markersize=4,
                  markevery=[1], zorder=2)  # fmt: skip
        half = _number(row, "spread") / 2
        axes.errorbar(x, y, xerr=half, color=colour, marker=mark,
                      markersize=8 if mark == "*" else 4.5, linewidth=1.2, zorder=3)  # fmt: skip
        lines += [((x - half, y), (max(later, x + half), y))]
    return lines


def _frontier(rows: Sequence[Row]) -> list[Line]:
    """Steps down through the rungs that no quicker one surpasses."""
    points = sorted((_number(row, "seconds"), _number(row, "error")) for row in rows)
    best = [p for k, p in enumerate(points) if all(p[1] < error for _, error in points[:k])]
    lines: list[Line] = []
    for (x, y), (later, lower) in pairwise(best):
        lines += [((x, y), (later, y)), ((later, y), (later, lower))]
    return lines


def _dress(axes: Axes, rows: Sequence[Row]) -> None:
    """Scales, labels, legend, and room for the names."""
    from matplotlib.lines import Line2D
    from matplotlib.ticker import FuncFormatter

    axes.set(xscale="log", yscale="log")
    axes.margins(x=0.18, y=0.18)
    axes.set(xlabel="seconds (fine line: with gradients)", ylabel="relative L1 error")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g} %"))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.grid(which="major", color="0.93", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    used = {kind_of(row) for row in rows}
    marks = [
        Line2D([], [], color=colour, marker=mark, linestyle="", markersize=5, label=name)
        for name, (colour, mark) in KINDS.items()
        if name in used
    ]
    axes.legend(handles=marks, frameon=False, fontsize=7, ncols=len(marks) or 1,
                loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)  # fmt: skip


def _name_rungs(figure: Figure, axes: Axes, rows: Sequence[Row], lines: Sequence[Line]) -> None:
    """Write each name where it covers neither a mark nor a line nor another name."""
    figure.draw_without_rendering()
    pixels = axes.transData.transform
    places = [pixels((_number(r, "seconds"), _number(r, "error"))) for r in rows]
    half = MARK / 2 * DOTS / 72
    taken = [_box(x - half, y - half, 2 * half, 2 * half) for x, y in places]
    for start, end in (pixels(line) for line in lines):
        low, size = (min(a, b) - 1 for a, b in zip(start, end, strict=True)), abs(end - start) + 2
        taken.append(_box(*low, *size))
    for row, (x, y) in zip(rows, places, strict=True):
        label = axes.annotate(
            str(row["name"]), (_number(row, "seconds"), _number(row, "error")), (0, 0),
            textcoords="offset points", fontsize=6.5, ha="center", va="center", zorder=4,
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.4, "shrinkA": 0,
                        "shrinkB": 2},
        )  # fmt: skip
        size = label.get_window_extent().size
        offset = _free_offset((x, y), size, taken, axes.get_window_extent())
        label.set_position(offset)
        dx, dy = (DOTS / 72 * o for o in offset)
        taken.append(_box(x + dx - size[0] / 2, y + dy - size[1] / 2, *size))


def _free_offset(
    place: tuple[float, float], size: Sequence[float], taken: Sequence[Bbox], frame: Bbox
) -> tuple[float, float]:
    """The nearest offset in points of a box of `size` pixels that meets nothing in the frame."""
    unit = DOTS / 72
    fewest, best = math.inf, (0.0, float(STEPS[0]))
    for step in STEPS:
        for turn in range(WAYS):
            angle = 2 * math.pi * turn / WAYS
            # the box's nearest point, and not its middle, is `step` away
            dx = math.cos(angle) * (step + size[0] / 2 / unit)
            dy = math.sin(angle) * (step + size[1] / 2 / unit)
            x, y = place[0] + dx * unit - size[0] / 2, place[1] + dy * unit - size[1] / 2
            box = _box(x, y, size[0], size[1])
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1
            inside = inside and frame.y0 <= box.y0 and box.y1 <= frame.y1
            covered = sum(box.overlaps(other) for other in taken) + (0 if inside else len(taken))
            if covered == 0:
                return dx, dy
            if covered < fewest:
                fewest, best = covered, (dx, dy)
    return best


def _box(x: float, y: float, width: float, height: float) -> Bbox:
    from matplotlib.transforms import Bbox

    return Bbox.from_bounds(x, y, width, height)
