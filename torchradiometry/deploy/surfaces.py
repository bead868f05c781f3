"""What photographs tell of a surface: normals, heights, paint and light, and the files they go to.

| from | normals | heights | albedo | light |
|---|---|---|---|---|
| photographs under known lights | photometric model | integrated | | known |
| one photograph | shading model | integrated | shading model | nine harmonics, fitted |

A model answers what has to be learnt, normals and paint. The rest is physics: heights are those
whose normals come closest (`heights`), the light is the one under which the paint on that surface
comes closest to the photograph (`light`),

    explained = 1 - sum |I - rho E(n) / pi|^2 / sum |I|^2.

A single photograph knows neither size nor exposure: heights are in pixels, of mean 0 on each piece
of the mask, the albedo is relative to its mean, and the light to that.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchradiometry.deploy.heights import integrate_normals
from torchradiometry.deploy.light import fit_light, shine
from torchradiometry.deploy.normals import (
    angular_error,
    estimate_both,
    estimate_normals,
    write_normals,
)
from torchradiometry.deploy.photographs import (
    Photograph,
    Photographs,
    find_photograph_sets,
    read_photograph,
    read_photographs,
)
from torchradiometry.errors import InputFileError
from torchradiometry.places import atomic_path, check_place

__all__ = ["SurfaceEstimate", "estimate_surface", "normals_file", "write_surface"]

ENDINGS = (".npz", ".npy", ".png")
#: what evenness of light is worth beside normals and albedo of a network: best on synthetic
#: photographs, where 0.001 and 0.03 are nearly as good
GUESSED = 0.01


@dataclass(frozen=True, eq=False)
class SurfaceEstimate:
    """What was found in photographs.

    Attributes:
        normal: `H W 3`, unit, x right, y up, z to the camera; 0 outside the mask.
        height: `H W`, pixels, towards the camera; NaN outside.
        mask: `H W`.
        albedo: `H W 3`, relative to its mean; 0 outside. None: not asked of this model.
        light: nine harmonics of each colour, `9 3`, in the order of `HarmonicSource`, per sqrt(sr),
            in the unit of the photograph for that albedo; None where albedo is.
        explained: share of the photograph's squares that they explain together, at most 1.
    """

    normal: NDArray[np.float32]
    height: NDArray[np.float32]
    mask: NDArray[np.bool_]
    albedo: NDArray[np.float32] | None = None
    light: NDArray[np.float64] | None = None
    explained: float | None = None

    def arrays(self) -> dict[str, Any]:
        """What there is, by name."""
        parts = {name: getattr(self, name) for name in ("normal", "height", "mask")}
        if self.albedo is not None and self.light is not None:
            parts |= {"albedo": self.albedo, "light": self.light}
        return parts


def estimate_surface(
    photographs: Photographs | Photograph, model: str | Path | None = None
) -> SurfaceEstimate:
    """Normals and heights; of one photograph also albedo and light.

    Args:
        photographs: a set under known lights (photometric model) or one image (shading model).
        model: an ONNX file; by default the shipped one.

    Raises:
        InputFileError: no such model.
        FileFormatError: a model with other inputs.
        InvalidValueError: the model gave NaN or infinite numbers.
    """
    normal, albedo = estimate_both(photographs, model)
    mask = photographs.mask
    height = integrate_normals(normal, mask).astype(np.float32)
    if albedo is None or not isinstance(photographs, Photograph):
        return SurfaceEstimate(normal, height, mask)
    seen, paint, facing = photographs.image[mask], albedo[mask], normal[mask]
    light = fit_light(seen, facing, paint, GUESSED)
    missed = float(np.square(seen - paint * shine(facing, light) / np.pi).sum())
    whole = float(np.square(seen, dtype=np.float64).sum())
    return SurfaceEstimate(normal, height, mask, albedo, light, 1 - missed / whole if whole else 1)


def write_surface(path: str | Path, surface: SurfaceEstimate) -> Path:
    """Write what was found: `.npz` with an array for each name; `.npy` and `.png` hold normals.

    Raises:
        FileFormatError: another ending.
        InputFileError: the folder does not exist.
    """
    path = check_place(path, ENDINGS)
    if path.suffix.lower() != ".npz":
        return write_normals(path, surface.normal)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **surface.arrays())
    return path


def normals_file(
    source: str | Path,
    out: str | Path,
    *,
    mask: str | Path | None = None,
    model: str | Path | None = None,
    linear: bool = False,
) -> dict[str, object]:
    """Read photographs, estimate, write, and report: the `normals` command.

    Args:
        source: a folder of photographs under known lights, or one image with `mask`.
        out: `.npz` for all that is found (`SurfaceEstimate`), `.npy` or `.png` for normals.
        mask: of the one image.
        model: an ONNX file; by default the shipped one.
        linear: the one image holds linear counts, not sRGB.

    Returns:
        `out`, `seconds`, `pixels`, `radiometry` (what was done to the stored counts), `lights`,
        and `degrees` where a true answer is known; for `.npz` also `arrays`, their names, and of
        one photograph `light` and `explained`.

    Raises:
        InputFileError: a missing file, folder or mask.
    """
    out = Path(out)
    check_place(out, ENDINGS)
    began = time.perf_counter()
    photographs = _read(Path(source), mask, linear)
    found: dict[str, object] = {}
    if out.suffix.lower() == ".npz":
        surface = estimate_surface(photographs, model)
        write_surface(out, surface)
        normals, found["arrays"] = surface.normal, list(surface.arrays())
        if surface.light is not None:
            found |= {"light": surface.light.tolist(), "explained": surface.explained}
    else:
        normals = estimate_normals(photographs, model)
        write_normals(out, normals)
    report: dict[str, object] = {
        "out": str(out),
        "seconds": time.perf_counter() - began,
        "pixels": int(photographs.mask.sum()),
        "radiometry": photographs.radiometry,
        **found,
    }
    if isinstance(photographs, Photographs):
        report["lights"] = len(photographs.light_directions)
        if photographs.ground_truth is not None:
            error = angular_error(normals, photographs.ground_truth, photographs.mask)
            report["degrees"] = float(error.mean())
    return report


def _read(source: Path, mask: str | Path | None, linear: bool) -> Photographs | Photograph:
    if not source.exists():
        raise InputFileError(str(source), "no such file or folder", "name photographs")
    if source.is_dir():
        sets = find_photograph_sets(source)
        if len(sets) > 1:
            names = ", ".join(found.name for found in sets)
            raise InputFileError(str(source), f"several sets ({names})", "name one of them")
        return read_photographs(sets[0])
    if mask is None:
        raise InputFileError(str(source), "no mask", "pass --mask, white on the object")
    return read_photograph(source, mask, linear=linear)
