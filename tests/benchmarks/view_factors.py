"""Form factors against pyviewfactor: `python -m tests.benchmarks.view_factors`.

The matrix of the inside of a unit cube cut into squares, nothing in the way, one thread each, by
processor time; errors against `unoccluded_exchange` at 1e-13, which other quadrature checks in the
tests. pyviewfactor 1.1 integrates contours (the inner integral closed, the outer one by 30 Gauss
points) in loops that Numba compiles; its first call, which compiles, is left out. It rounds corners
to 8 decimals unless told otherwise, so it runs with 15 too.
Equal accuracy: our loosest `rtol` whose worst pair is no worse than its worst pair.

Needs `pip install pyviewfactor` (with Numba).
"""

from __future__ import annotations

import os

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import argparse
from collections.abc import Callable
from importlib.metadata import version

import numpy as np
import torch
from torch import Tensor

from tests.benchmarks.form_factors import RTOLS, cube, timed
from torchradiometry import Patches, unoccluded_exchange

try:
    import pyviewfactor
    import pyvista
except ImportError:
    pyviewfactor = pyvista = None


def rival_mesh(patches: Patches) -> pyvista.PolyData:
    """The same squares as a mesh of pyvista."""
    count, sides = patches.corners.shape[:2]
    faces = np.arange(count * sides).reshape(count, sides)
    faces = np.concatenate([np.full((count, 1), sides), faces], 1)
    return pyvista.PolyData(patches.corners.reshape(-1, 3).numpy(), faces.ravel())


def rival(mesh: pyvista.PolyData, area: Tensor, decimals: int) -> Tensor:
    """Exchange areas by pyviewfactor, whose F[i, j] is the share of what j sends that i gets."""
    found = pyviewfactor.compute_viewfactor_matrix(
        mesh, skip_obstruction=True, rounding_decimal=decimals
    )
    return torch.from_numpy(found) * area


def print_table(parts: int, repeats: int) -> None:
    """Both ways to each accuracy, one row each."""
    patches = cube(parts)
    mesh, exact = rival_mesh(patches), unoccluded_exchange(patches, 1e-13)
    ways: dict[str, Callable[[], Tensor]] = {
        f"pyviewfactor, corners to {decimals} decimals": lambda d=decimals: rival(  # type: ignore[misc]
            mesh, patches.area, d
        )
        for decimals in (8, 15)
    }
    for rtol in RTOLS:
        ways[f"ours, rtol {rtol:g}"] = lambda r=rtol: unoccluded_exchange(patches, r)  # type: ignore[misc]
    for way, call in ways.items():
        found, median, spread = timed(call, repeats)
        row = float((found.sum(-1) / patches.area - 1).abs().max())
        pair = float((found / exact - 1)[exact > 0].abs().max())
        total = float((found - exact).abs().sum() / exact.sum())
        errors = f"{row:.1e} | {pair:.1e} | {total:.1e}"
        print(f"| {patches.count} | {way} | {errors} | {median:.2f} | {spread:.2f} |", flush=True)


def main() -> None:
    """Print the table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--parts", type=int, nargs="+", default=[9, 18])
    options = parser.parse_args()
    if pyviewfactor is None:
        parser.error("pyviewfactor is not installed")
    torch.set_num_threads(1)
    print(f"pyviewfactor {version('pyviewfactor')}, torch {torch.__version__}\n")
    print("| patches | way | worst row sum - 1 | worst pair | relative L1 | s | spread |")
    print("|---|---|---|---|---|---|---|")
    with torch.no_grad():
        for parts in options.parts:
            print_table(parts, options.repeats)


if __name__ == "__main__":
    main()
