"""Benchmarks as a command: a table of every object, beside published rows if they are named.

A published file is a CSV with a header. Photometric: `method` and a column an object, in degrees.
Shading: `condition`, `algorithm` and `N_MAE_rad`, one number for all objects.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import NamedTuple, TypeAlias

from rich.console import Console
from rich.table import Table

from torchradiometry.demo.progress import progress_bar
from torchradiometry.deploy.normals import find_model
from torchradiometry.deploy.photographs import find_photograph_sets
from torchradiometry.deploy.runtime import open_model
from torchradiometry.errors import FileFormatError
from torchradiometry.files import MAX_TEXT, check_readable
from torchradiometry.learn.benchmarks import (
    SingleEvaluation,
    evaluate_singles,
    find_objects,
    geometric_mean,
    photometric_benchmark,
)
from torchradiometry.learn.evaluation import Evaluation
from torchradiometry.places import atomic_path, check_place

__all__ = ["Benchmark", "run_benchmark"]

#: method -> object or "mean" -> degrees or radians
Rows: TypeAlias = dict[str, dict[str, float]]


class Benchmark(NamedTuple):
    """What the `evaluate` command shows.

    Attributes:
        report: for JSON.
        table: for the eye.
    """

    report: dict[str, object]
    table: str


def run_benchmark(
    kind: str,
    folder: str | Path,
    *,
    model: str | Path | None = None,
    control: str | Path | None = None,
    lights: int = 10,
    draws: int = 5,
    table: str | Path | None = None,
    published: str | Path | None = None,
) -> Benchmark:
    """Measure a model on real photographs: what the `evaluate` command calls.

    Args:
        kind: `photometric` or `shading`.
        folder: one object, or a folder of objects.
        model: an ONNX file; by default the shipped one of this kind.
        control: shading: the ONNX file that is shown the outlines; by default the model.
        lights: photometric: lights in a draw.
        draws: photometric: draws of each object, of seeds 0, 1 ...; 0 leaves them out.
        table: a `.csv` file for every measurement.
        published: a CSV file of published rows to show beside.

    Raises:
        InputFileError: a missing file or folder.
        FileFormatError: a file that does not hold what it should.
    """
    if table is not None:
        check_place(table, (".csv",))
    model = find_model(kind) if model is None else Path(model)
    open_model(model)  # a file that is no model fails before any work
    if kind == "photometric":
        sets = len(find_photograph_sets(folder))
        others = {} if published is None else _published_degrees(Path(published))
        with progress_bar(("Objects", sets)) as (advance,):
            found = photometric_benchmark(folder, model, lights, draws, advance)
        rows, unit = _degrees(found), "mean angle, degrees"
        others = _means_over(others, rows)
        measured: Sequence[Evaluation | SingleEvaluation] = found
    else:
        objects = find_objects(folder)
        others = {} if published is None else _published_radians(Path(published))
        with progress_bar(("Objects", len(objects))) as (advance,):
            singles = evaluate_singles(folder, model, control, advance)
        rows, unit = _radians(singles), "N-MAE, radians; mean is geometric"
        measured = singles
    if table is not None:
        _write_csv(Path(table), measured)
    report: dict[str, object] = {
        "kind": kind,
        "model": str(model),
        "unit": unit,
        "rows": rows,
        "published": others,
        "measurements": [each._asdict() for each in measured],
    }
    return Benchmark(report, _drawn(unit, rows, others))


def _degrees(found: Sequence[Evaluation]) -> Rows:
    """Model and least squares under all lights, and under fewer as the mean of the draws."""
    names = list(dict.fromkeys(each.name for each in found))
    whole = {each.name: each for each in found if each.seed is None}
    some = {name: [e for e in found if e.name == name and e.seed is not None] for name in names}
    rows: Rows = {
        "this model, all lights": {name: whole[name].degrees for name in names},
        "least squares, all lights": {name: whole[name].least_squares for name in names},
    }
    drawn = {name: each for name, each in some.items() if each}
    if drawn:
        first = next(iter(drawn.values()))
        what = f"{first[0].lights} lights, mean of {len(first)}"
        rows[f"this model, {what}"] = {n: fmean(e.degrees for e in d) for n, d in drawn.items()}
        rows[f"least squares, {what}"] = {
            n: fmean(e.least_squares for e in d) for n, d in drawn.items()
        }
    return {method: row | {"mean": fmean(row.values())} for method, row in rows.items()}


def _radians(found: Sequence[SingleEvaluation]) -> Rows:
    rows: Rows = {
        "this model": {each.name: each.radians for each in found},
        "its outline alone": {each.name: each.outline for each in found},
    }
    return {n: row | {"mean": geometric_mean(list(row.values()))} for n, row in rows.items()}


def _means_over(others: Rows, rows: Rows) -> Rows:
    """Published rows cut down to the objects that were measured, with their mean, best first."""
    names = [name for name in next(iter(rows.values())) if name != "mean"]
    cut = {m: {n: row[n] for n in names} for m, row in others.items() if set(names) <= set(row)}
    whole = {method: row | {"mean": fmean(row.values())} for method, row in cut.items()}
    return dict(sorted(whole.items(), key=lambda item: item[1]["mean"]))


def _published_degrees(path: Path) -> Rows:
    rows: Rows = {}
    for line in _lines(path, ("method",)):
        numbers = {k: v for k, v in line.items() if k not in ("method", "avg") and v}
        rows[line["method"]] = _numbers(path, numbers)
    return rows


def _published_radians(path: Path) -> Rows:
    rows: Rows = {}
    for line in _lines(path, ("condition", "algorithm", "N_MAE_rad")):
        if line["N_MAE_rad"]:
            name = f"{line['algorithm']} ({line['condition']}, other objects)"
            rows[name] = _numbers(path, {"mean": line["N_MAE_rad"]})
    return dict(sorted(rows.items(), key=lambda item: item[1]["mean"]))


def _lines(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    check_readable(path, "table of published rows", MAX_TEXT)
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            lines = [{k: v or "" for k, v in line.items() if k} for line in reader]
            header = list(reader.fieldnames or [])
    except (csv.Error, UnicodeDecodeError) as error:
        raise FileFormatError(str(path), f"no table ({error})", "pass a CSV file") from error
    missing = [column for column in columns if column not in header]
    if missing:
        raise FileFormatError(str(path), f"no column {missing[0]}", f"give it {', '.join(columns)}")
    return lines


def _numbers(path: Path, texts: Mapping[str, str]) -> dict[str, float]:
    try:
        return {name: float(text) for name, text in texts.items()}
    except ValueError as error:
        raise FileFormatError(str(path), f"a text ({error})", "write numbers") from error


def _write_csv(path: Path, measured: Sequence[Evaluation | SingleEvaluation]) -> None:
    lines = io.StringIO()
    writer = csv.writer(lines)
    writer.writerow(measured[0]._fields)
    writer.writerows(measured)
    with atomic_path(path) as temporary:  # a name may be no Unicode
        temporary.write_bytes(lines.getvalue().encode(errors="backslashreplace"))


def _drawn(unit: str, rows: Rows, others: Rows) -> str:
    columns = list(next(iter(rows.values())))
    drawn = Table(title=unit)
    drawn.add_column("method")
    for column in columns:
        drawn.add_column(column, justify="right")
    for part in (rows, others):
        for method, row in part.items():
            digits = 3 if "radians" in unit else 2
            cells = (f"{row[c]:.{digits}f}" if c in row else "" for c in columns)
            drawn.add_row(method, *cells)
        drawn.add_section()
    text = io.StringIO()
    plain = Console(file=text, width=60 + 11 * len(columns), markup=False, emoji=False)
    plain.print(drawn)
    return text.getvalue().rstrip()
