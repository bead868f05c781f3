"""Photographs under known distant lights, as linear radiance per unit of light.

A pixel of photograph i of a camera with a linear response is proportional to

    I_i = E_i rho/pi max(0, n . l_i)        (a matt surface without shadows)

so dividing by the light's intensity E_i makes photographs of one object comparable. A stored
count v of an 8-bit file that was cut down from 16 bits stands for the middle of its interval,
(v + 1/2) / 256; 16-bit files are v / 65535; float files are taken as they are.

A folder holds

| file | what |
|---|---|
| `001.png`, `002.webp` ... | the photographs, in the order of their numbers, linear |
| `mask.png` | white on the object |
| `light_directions.txt` | a row for each photograph: x right, y up, z to the camera; unit |
| `light_intensities.txt` | a row for each photograph: one number, or red green blue |
| `Normal_gt.mat` or `normal_gt.npy` | optional: true normals `H x W x 3` in the same frame |

the layout of the DiLiGenT benchmark.

References: B. Shi et al., "A benchmark dataset and evaluation for non-Lambertian and
uncalibrated photometric stereo", TPAMI 2019; IEC 61966-2-1 (sRGB).
"""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchradiometry.errors import (
    FileFormatError,
    InputFileError,
    InvalidValueError,
    MissingDependencyError,
    OutOfRangeError,
    ResourceLimitError,
    ShapeError,
)
from torchradiometry.files import MAX_BYTES, MAX_TEXT, check_readable, read_counts, srgb_to_linear

__all__ = [
    "Photograph",
    "Photographs",
    "find_photograph_sets",
    "read_photograph",
    "read_photographs",
]

PHOTOGRAPH_ENDINGS = (".png", ".webp", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".exr", ".npy")
#: all photographs of a set together, as float32
MAX_SET_BYTES = 2**32
#: variables of a MATLAB file that are looked through
MAX_PARTS = 2**12
#: how far from 1 the length of a light direction may be: the rounding of printed decimals
UNIT_TOLERANCE = 1e-2


@dataclass(frozen=True, eq=False)
class Photographs:
    """Photographs of one object under N distant lights.

    Attributes:
        images: `N H W 3`, float32, linear, divided by the intensity of the light.
        mask: `H W`, True on the object.
        light_directions: `N 3`, unit, x right, y up, z to the camera.
        ground_truth: `H W 3` unit normals, or None.
        name: the folder's name.
        radiometry: what was done to the stored counts, in words.
    """

    images: NDArray[np.float32]
    mask: NDArray[np.bool_]
    light_directions: NDArray[np.float32]
    ground_truth: NDArray[np.float32] | None
    name: str
    radiometry: str = "as given"

    def grey(self) -> NDArray[np.float32]:
        """Luminance of the pixels in the mask, `pixel N` (weights of ITU-R BT.601)."""
        return grey(self.images[:, self.mask]).T

    def under(self, lights: Iterable[int]) -> Photographs:
        """The same object under some of its lights, named by their numbers from 0."""
        kept = list(lights)
        return Photographs(
            self.images[kept],
            self.mask,
            self.light_directions[kept],
            self.ground_truth,
            self.name,
            self.radiometry,
        )


@dataclass(frozen=True, eq=False)
class Photograph:
    """One photograph and where its object is.

    Attributes:
        image: `H W 3`, float32, linear.
        mask: `H W`, True on the object.
        name: the file's name.
        radiometry: what was done to the stored counts, in words.
    """

    image: NDArray[np.float32]
    mask: NDArray[np.bool_]
    name: str
    radiometry: str = "as given"


def grey(rgb: NDArray[np.floating]) -> NDArray[np.float32]:
    """0.2989 R + 0.5870 G + 0.1140 B over the last axis."""
    return (rgb @ np.array([0.2989, 0.5870, 0.1140], dtype=rgb.dtype)).astype(np.float32)


def find_photograph_sets(folder: str | Path) -> list[Path]:
    """The folder itself if it holds photographs and lights, otherwise its folders that do.

    Raises:
        InputFileError: no such folder, or no set in it.
    """
    folder = _existing_folder(folder)
    if (folder / "light_directions.txt").is_file() or (folder / "mask.png").is_file():
        return [folder]
    found = sorted(p.parent for p in folder.glob("*/light_directions.txt"))
    if not found:
        raise InputFileError(
            str(folder),
            "no photographs under known lights",
            "put mask.png, light_directions.txt, light_intensities.txt and 001.png ... in it",
        )
    return found


def read_photographs(folder: str | Path) -> Photographs:
    """Read and check a folder of photographs under known distant lights.

    Args:
        folder: laid out as the module says.

    Returns:
        Images divided by the lights' intensities, mask, unit light directions.

    Raises:
        InputFileError: the folder, the mask, a light file or every photograph is missing.
        FileFormatError: a file does not hold what it should.
        ShapeError: counts or sizes that do not fit together, or an empty mask.
        InvalidValueError: NaN or infinite lights or pixels.
        OutOfRangeError: fewer than three lights, a light direction that is not unit or an
            intensity that is not positive.
        ResourceLimitError: more than `MAX_SET_BYTES`.
    """
    folder = _existing_folder(folder)
    mask = _read_mask(folder / "mask.png")
    files = _photograph_files(folder)
    directions = _read_table(folder / "light_directions.txt", (3,))
    intensities = _read_table(folder / "light_intensities.txt", (1, 3))
    for table, name in (
        (directions, "light_directions.txt"),
        (intensities, "light_intensities.txt"),
    ):
        if len(table) != len(files):
            raise ShapeError(
                str(folder / name),
                f"{len(table)} lights for {len(files)} photographs",
                "give one row to each photograph",
            )
    directions = _unit_directions(directions, folder / "light_directions.txt")
    if (intensities <= 0).any():
        raise OutOfRangeError(
            str(folder / "light_intensities.txt"), "a value <= 0", "intensities are positive"
        )
    images, stored = _read_images(files, mask, intensities)
    truth = _read_ground_truth(folder, mask.shape)
    lights = directions.astype(np.float32)
    done = f"{stored} taken as linear, divided by light_intensities.txt"
    return Photographs(images, mask, lights, truth, folder.name, done)


def read_photograph(path: str | Path, mask: str | Path, *, linear: bool = False) -> Photograph:
    """Read one photograph and its mask; 8- and 16-bit files are taken as sRGB and linearised.

    Args:
        path: of the photograph; float files (`calibrate` writes them) are linear already.
        mask: white on the object.
        linear: take counts as proportional to radiance.

    Raises:
        InputFileError: a missing file.
        FileFormatError: not a picture.
        ShapeError: photograph and mask differ in size, or the mask is empty.
    """
    path = Path(path)
    inside = _read_mask(Path(mask))
    counts = _rgb(read_counts(path), path)
    encoded = counts.dtype.kind == "u" and not linear
    light = srgb_to_linear(counts / np.iinfo(counts.dtype).max) if encoded else _linear(counts)
    _same_size(path, counts.shape[:2], inside.shape)
    image = np.asarray(light, dtype=np.float32)
    _finite(path, image)
    done = "linearised from sRGB" if encoded else f"{_stored(counts.dtype)} taken as linear"
    return Photograph(image, inside, path.name, done)


def _existing_folder(folder: str | Path) -> Path:
    folder = Path(folder)
    if not folder.exists():
        raise InputFileError(str(folder), "no such folder", "name an existing folder")
    if not folder.is_dir():
        raise InputFileError(str(folder), "a file", "name a folder of photographs")
    return folder


def _photograph_files(folder: Path) -> list[Path]:
    """The numbered pictures, in the order of their numbers."""
    files = [
        p for p in folder.iterdir() if p.stem.isdigit() and p.suffix.lower() in PHOTOGRAPH_ENDINGS
    ]
    if not files:
        raise InputFileError(str(folder), "no photographs", "name them 001.png, 002.png ...")
    return sorted(files, key=lambda p: int(p.stem))


def _read_mask(path: Path) -> NDArray[np.bool_]:
    if not path.is_file():
        raise InputFileError(str(path), "no mask", "add a picture that is white on the object")
    counts = read_counts(path)
    full = np.iinfo(counts.dtype).max if counts.dtype.kind == "u" else 1.0
    colour = counts if counts.ndim == 2 else counts[..., :3].max(-1)
    inside = colour > full / 2
    if not inside.any():
        raise ShapeError(str(path), "an empty mask", "paint the object white")
    return inside


def _read_table(path: Path, widths: tuple[int, ...]) -> NDArray[np.float64]:
    check_readable(path, "text file", MAX_TEXT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty file: named below
            table = np.loadtxt(path, ndmin=2, dtype=np.float64)
    except ValueError as error:
        raise FileFormatError(str(path), f"no table ({error})", "write rows of numbers") from error
    if table.size == 0 or table.shape[1] not in widths:
        raise FileFormatError(
            str(path),
            f"a table of shape {table.shape}",
            f"write rows of {' or '.join(map(str, widths))} numbers",
        )
    if not np.isfinite(table).all():
        raise InvalidValueError(str(path), "NaN or infinite numbers", "write finite numbers")
    return table


def _unit_directions(directions: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    if len(directions) < 3:
        raise OutOfRangeError(str(path), f"{len(directions)} lights", "use at least three")
    length = np.linalg.norm(directions, axis=1)
    wrong = np.flatnonzero(abs(length - 1) > UNIT_TOLERANCE)
    if wrong.size:
        raise OutOfRangeError(
            str(path),
            f"a direction of length {length[wrong[0]]:.4g} in row {wrong[0] + 1}",
            "divide each row by its length",
        )
    return directions / length[:, None]


def _read_images(
    files: list[Path], mask: NDArray[np.bool_], intensities: NDArray[np.float64]
) -> tuple[NDArray[np.float32], str]:
    """Images per unit of light, and in words what was stored."""
    needed = len(files) * mask.size * 12
    if needed > MAX_SET_BYTES:
        raise ResourceLimitError(
            str(files[0].parent),
            f"photographs that need {needed} bytes",
            f"crop or shrink them to at most {MAX_SET_BYTES} bytes",
        )
    images = np.empty((len(files), *mask.shape, 3), dtype=np.float32)
    stored = set()
    for image, path, intensity in zip(images, files, intensities, strict=True):
        counts = _rgb(read_counts(path), path)
        _same_size(path, counts.shape[:2], mask.shape)
        image[:] = _linear(counts) / intensity.astype(np.float32)
        stored.add(_stored(counts.dtype))
        _finite(path, image)
    return images, " and ".join(sorted(stored))


def _stored(dtype: np.dtype) -> str:
    return f"{8 * dtype.itemsize}-bit counts" if dtype.kind == "u" else "float values"


def _linear(counts: NDArray) -> NDArray[np.float32]:
    """Stored counts of a camera with a linear response as 0..1."""
    if counts.dtype == np.uint8:
        return (counts.astype(np.float32) + np.float32(0.5)) / np.float32(256)
    if counts.dtype == np.uint16:
        return counts.astype(np.float32) / np.float32(65535)
    return counts.astype(np.float32)


def _rgb(counts: NDArray, path: Path) -> NDArray:
    """`H W 3`; grey pictures are repeated."""
    if counts.ndim == 2:
        return np.repeat(counts[..., None], 3, axis=2)
    if counts.ndim != 3 or counts.shape[2] != 3:
        raise ShapeError(str(path), f"an array of shape {counts.shape}", "pass H x W (x 3)")
    return counts


def _same_size(path: Path, size: tuple[int, ...], mask: tuple[int, ...]) -> None:
    if tuple(size) != tuple(mask):
        raise ShapeError(
            str(path),
            f"{size[1]} x {size[0]} pixels where the mask has {mask[1]} x {mask[0]}",
            "make photographs and mask the same size",
        )


def _finite(path: Path, image: NDArray[np.float32]) -> None:
    if not np.isfinite(image).all():
        raise InvalidValueError(str(path), "NaN or infinite pixels", "write finite values")


def _read_ground_truth(folder: Path, size: tuple[int, ...]) -> NDArray[np.float32] | None:
    if (folder / "Normal_gt.mat").is_file():
        truth = _read_mat(folder / "Normal_gt.mat")
    elif (folder / "normal_gt.npy").is_file():
        truth = read_counts(folder / "normal_gt.npy")
    else:
        return None
    if truth.shape != (*size, 3):
        raise ShapeError(
            str(folder), f"true normals of shape {truth.shape}", f"pass {(*size, 3)} as the mask"
        )
    return truth.astype(np.float32)


def _read_mat(path: Path) -> NDArray:
    try:
        from scipy.io import loadmat
    except ImportError as error:
        raise MissingDependencyError(
            "SciPy", "no installation", "run: pip install 'torchradiometry[onnx]'"
        ) from error
    try:
        _check_unpacked(check_readable(path, "MATLAB file"))
        return np.asarray(loadmat(path, variable_names=["Normal_gt"])["Normal_gt"])
    except ResourceLimitError:
        raise
    except Exception as error:
        raise FileFormatError(
            str(path), f"no array Normal_gt ({error})", "save H x W x 3 under that name"
        ) from error


def _check_unpacked(path: Path) -> None:
    """Refuse compressed variables of more than `MAX_BYTES`, unpacked in pieces and thrown away.

    Level 5 MAT-files: 128 bytes of header, then `type size data`; type 15 is a zlib stream.
    """
    room = MAX_BYTES
    with path.open("rb") as file:
        order = "<" if file.read(128).endswith(b"IM") else ">"
        parts = 0
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(order + "II", tag)
            parts += 1
            if parts > MAX_PARTS:
                got = f"more than {MAX_PARTS} variables"
                raise ResourceLimitError(str(path), got, "save the normals alone")
            if kind != 15:
                file.seek(size, 1)
                continue
            stream, packed = zlib.decompressobj(), file.read(size)
            while packed and not stream.eof and room >= 0:
                room -= len(stream.decompress(packed, 2**20))
                packed = stream.unconsumed_tail
            if room < 0:
                got = f"more than {MAX_BYTES} bytes when unpacked"
                raise ResourceLimitError(str(path), got, "save H x W x 3 of one object")
