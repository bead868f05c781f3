"""Parity and latency of every exported member: `python -m tests.benchmarks.runtimes`.

Each source, material, layer, transport and solver of `tests/cases.py`, and both models, is
exported once and run by Python's onnxruntime, by Node (onnxruntime-node) and in headless Chromium
(onnxruntime-web, WebAssembly), one thread each, on sizes that the exporter has not seen; the
difference from torch is max |a - b| / max |b|. What does not export or run is named. Finished
members are kept in --cache, so that a run which was stopped goes on; `--again` times them anew.
Before: `npm ci --ignore-scripts` in web/, and Chromium.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
from collections.abc import Callable
from pathlib import Path
from statistics import quantiles
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tests import cases
from tests.cases import OTHER, SMALL, Case, Sizes
from tests.contracts.test_graphs import axes, build
from tests.runtimes import Python, Script
from torchradiometry.deploy import find_model, open_model, run_model
from torchradiometry.export import export_onnx
from torchradiometry.places import atomic_path

FAMILIES = {
    "source": cases.SOURCES,
    "material": cases.MATERIALS,
    "layer": cases.LAYERS,
    "transport": cases.TRANSPORT,
    "solver": cases.SOLVERS,
}
RUNTIMES: dict[str, Callable[[], Any]] = {
    "python": Python,
    "node": lambda: Script("run_node.mjs"),
    "browser": lambda: Script("run_browser.mjs"),
}
#: what is timed: pixels or points; fewer for what grows with the square of its patches
IMAGE, PATCHES = Sizes(1, 128, 128, 2), Sizes(1, 16, 16, 2)
REPEATS, SECONDS = 15, 3.0
#: a difference in the table that is at least this is printed in bold: a hundred roundings
LOUD = {torch.float32: 1e-5, torch.float64: 1e-12}


class Work(NamedTuple):
    """What to run: the file, its inputs by name, and what torch gives."""

    path: Path
    inputs: dict[str, NDArray[Any]]
    expected: list[NDArray[Any]]
    size: str


def members() -> dict[str, Case]:
    return {f"{kind} {case.name}": case for kind, family in FAMILIES.items() for case in family}


def sizes_of(case: Case) -> Sizes:
    return PATCHES if case.inputs in (cases.enclosure, cases.triangles) else IMAGE


def exported(name: str, case: Case, dtype: torch.dtype, folder: Path) -> Work:
    """The member's file, written once; torch's answer on the larger sizes.

    Raises:
        RuntimeError: it does not export; the first line of the reason.
    """
    path = folder / (re.sub(r"\W+", "-", name) + ".onnx")
    failed = path.with_suffix(".failed")
    module = build(case, dtype)
    small, other = case.inputs(dtype, SMALL), case.inputs(dtype, OTHER)
    if failed.exists():
        raise RuntimeError(failed.read_text())
    large = case.inputs(dtype, sizes_of(case))
    with torch.no_grad():
        expected = module(*large)
    if not path.exists():
        try:
            _export(module, small, other, len(expected), path)
        except Exception as error:
            failed.write_text(_reason(error))
            raise RuntimeError(_reason(error)) from error
    inputs = {n: t.numpy() for n, t in zip(module.input_names, large, strict=True)}
    shape = " x ".join(map(str, expected[0].shape))
    return Work(path, inputs, [t.numpy() for t in expected], shape)


def _export(
    module: nn.Module,
    small: tuple[Tensor, ...],
    other: tuple[Tensor, ...],
    outputs: int,
    path: Path,
) -> None:
    names = dict(zip(module.input_names, zip(small, other, strict=True), strict=True))
    export_onnx(
        module,
        small,
        path,
        axes={name: axes(*pair) for name, pair in names.items()},
        outputs={f"output{i}": "1" for i in range(outputs)},
    )


def _reason(error: BaseException) -> str:
    """The innermost cause, its first line."""
    while error.__cause__ is not None:
        error = error.__cause__
    lines = [line for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {(lines or [''])[0].strip()[:160]}"


def model_work(name: str) -> Work:
    """A shipped network on made-up photographs; the reference is Python's onnxruntime."""
    random = np.random.default_rng(0)
    if name == "shading":
        image = random.uniform(0.1, 1, (1, 3, 64, 64)).astype(np.float32)
        inputs = {"image": image, "mask": np.ones((1, 1, 64, 64), np.float32)}
    else:
        light = random.normal(size=(32, 3)) * 0.4 + [0, 0, 1]
        direction = (light / np.linalg.norm(light, axis=1, keepdims=True)).astype(np.float32)
        facing = np.float32([0.2, 0.1, 0.97]) @ direction.T
        intensity = (facing * random.uniform(0.8, 1.2, (256, 32))).astype(np.float32)
        inputs = {"intensity": intensity, "direction": direction}
    path = find_model(name)
    expected = list(run_model(open_model(path, threads=1), inputs))
    return Work(path, inputs, expected, " x ".join(map(str, expected[0].shape)))


def difference(found: list[NDArray[Any]], expected: list[NDArray[Any]]) -> float:
    """max |a - b| / max |b| over all outputs; infinite where shapes or finiteness differ."""
    worst = 0.0
    for a, b in zip(found, expected, strict=True):
        if a.shape != b.shape or not np.isfinite(a.astype(float)).all():
            return float("inf")
        scale = float(abs(b.astype(float)).max()) if b.size else 1.0
        gap = abs(a.astype(float) - b.astype(float)).max() if b.size else 0.0
        worst = max(worst, float(gap) / (scale or 1.0))
    return worst


def timed(times: list[float]) -> dict[str, float]:
    low, median, high = quantiles(times, n=4)
    return {"median": median, "spread": high - low, "least": min(times)}


def torch_times(case: Case, dtype: torch.dtype) -> dict[str, float]:
    """The module itself, on the same inputs."""
    import time

    module, large = build(case, dtype), case.inputs(dtype, sizes_of(case))
    times: list[float] = []
    with torch.no_grad():
        module(*large)
        end = time.perf_counter() + SECONDS
        while len(times) < REPEATS and (len(times) < 3 or time.perf_counter() < end):
            began = time.perf_counter()
            module(*large)
            times.append(1e3 * (time.perf_counter() - began))
    return timed(times)


def measure(work: Work, runtimes: dict[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = {"size": work.size, "bytes": work.path.stat().st_size}
    for name, runtime in runtimes.items():
        answer = runtime.run(work.path, work.inputs, REPEATS, SECONDS)
        if answer.error:
            row[name] = {"error": answer.error}
        else:
            row[name] = {"difference": difference(answer.outputs, work.expected)}
            row[name] |= timed(answer.times)
    return row


def measure_all(dtype: torch.dtype, cache: Path, again: bool, only: str | None) -> dict[str, Any]:
    """Rows by member, kept after each one."""
    folder = cache / str(dtype).removeprefix("torch.")
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "rows.json"
    rows: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else {}
    runtimes = {name: start() for name, start in RUNTIMES.items()}
    rows["about"] = {name: runtime.about for name, runtime in runtimes.items()}
    models = ("shading", "photometric") if dtype == torch.float32 else ()
    wanted = [*(f"model {name}" for name in models), *members()]
    for name in wanted:
        if (name in rows and not again) or (only and not re.search(only, name)):
            continue
        rows[name] = _row(name, dtype, folder, runtimes)
        with atomic_path(kept) as temporary:
            temporary.write_text(json.dumps(rows, indent=1))
        print(name, rows[name], flush=True)
    for runtime in runtimes.values():
        runtime.close()
    return rows


def _row(name: str, dtype: torch.dtype, folder: Path, runtimes: dict[str, Any]) -> dict[str, Any]:
    if name.startswith("model "):
        return measure(model_work(name.removeprefix("model ")), runtimes)
    case = members()[name]
    try:
        work = exported(name, case, dtype, folder)
    except RuntimeError as error:
        return {"failed": str(error)}
    return {**measure(work, runtimes), "torch": torch_times(case, dtype)}


def cell(found: dict[str, Any], loud: float) -> str:
    """Difference and time of one runtime."""
    if "error" in found:
        return f"fails: {found['error'][:60]} |"
    gap = f"{found['difference']:.0e}"
    return f"{f'**{gap}**' if found['difference'] >= loud else gap} | {ms(found)}"


def ms(found: dict[str, float]) -> str:
    digits = 2 if found["median"] < 10 else 1 if found["median"] < 100 else 0
    return f"{found['median']:.{digits}f} ± {found['spread'] / 2:.{digits}f}"


def table(rows: dict[str, Any], dtype: torch.dtype) -> str:
    """Markdown: first what runs, then what does not export."""
    lines = [
        "| member | output | torch, ms | Python | ms | Node | ms | browser | ms |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        if name == "about" or "failed" in row:
            continue
        cells = " | ".join(cell(row[runtime], LOUD[dtype]) for runtime in RUNTIMES)
        eager = ms(row["torch"]) if "torch" in row else ""
        lines.append(f"| {name} | {row['size']} | {eager} | {cells} |")
    failed = [f"- {n}: {row['failed']}" for n, row in rows.items() if "failed" in row]
    return "\n".join([*lines, "", *failed])


def main() -> None:
    """Measure what is missing, and print Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=Path("runtimes-cache"))
    parser.add_argument("--dtype", choices=["float32", "float64"], default="float32")
    parser.add_argument("--again", action="store_true", help="measure every member anew")
    parser.add_argument("--only", help="members whose name this expression finds")
    parser.add_argument("--table", action="store_true", help="print what is there")
    options = parser.parse_args()
    dtype = getattr(torch, options.dtype)
    torch.set_num_threads(1)
    if options.table:
        rows = json.loads((options.cache / options.dtype / "rows.json").read_text())
    else:
        rows = measure_all(dtype, options.cache, options.again, options.only)
    about = ", ".join(rows["about"].values())
    print(f"\n{platform.machine()}, torch {torch.__version__}, {about}; one thread\n")
    print(table(rows, dtype))


if __name__ == "__main__":
    main()
