"""Normals through onnxruntime: without torch, atomically, every fault by name."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.deploy.test_photographs import folder  # noqa: F401 (a fixture)
from tests.deploy.test_woodham import matt
from torchradiometry.deploy.normals import (
    _resized,
    angular_error,
    estimate_normals,
    find_model,
    write_normals,
)
from torchradiometry.deploy.photographs import Photograph, read_photographs
from torchradiometry.deploy.surfaces import normals_file
from torchradiometry.deploy.woodham import least_squares_normals
from torchradiometry.errors import FileFormatError, InputFileError, InvalidValueError, ShapeError
from torchradiometry.files import read_counts, write_counts

SOURCES = Path(__file__).resolve().parents[2]


def ball(size: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Normals and mask of a half ball that fills a picture."""
    axis = (np.arange(size) + 0.5) / size * 2.2 - 1.1
    x, y = np.meshgrid(axis, -axis)
    room = 1 - x * x - y * y
    return np.stack([x, y, np.sqrt(np.clip(room, 0, None))], -1), room > 0.02


def test_nothing_imports_torch(tmp_path: Path) -> None:
    """The whole command in a fresh interpreter, on a made-up set."""
    photographs = matt()
    for k, image in enumerate(photographs.images):
        write_counts(tmp_path / f"{k}.png", np.round(image.clip(0, 1) * 65535).astype(np.uint16))
    write_counts(tmp_path / "mask.png", photographs.mask.astype(np.uint8) * 255)
    np.savetxt(tmp_path / "light_directions.txt", photographs.light_directions)
    np.savetxt(tmp_path / "light_intensities.txt", np.ones((9, 1)))
    program = (
        "import sys, json\n"
        "from torchradiometry.deploy import normals_file\n"
        f"report = normals_file({str(tmp_path)!r}, {str(tmp_path / 'n.npy')!r})\n"
        "assert 'torch' not in sys.modules, 'torch was imported'\n"
        "print(json.dumps(report))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=SOURCES
    )
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["lights"] == 9
    assert report["pixels"] == 28
    normals = np.load(tmp_path / "n.npy")
    assert normals.shape == (5, 7, 3)
    np.testing.assert_allclose(np.linalg.norm(normals[1:], axis=-1), 1, atol=1e-5)


def test_matt_surface_through_the_shipped_model() -> None:
    photographs = matt()
    error = angular_error(estimate_normals(photographs), photographs.ground_truth, photographs.mask)
    assert error.mean() < 5


@pytest.mark.parametrize("size", [24, 65, 150])
def test_one_image_of_any_size_through_the_shipped_model(size: int) -> None:
    normals, mask = ball(size)
    light = np.array([0.3, 0.4, 0.87])
    image = np.repeat((normals @ light).clip(0)[..., None], 3, -1).astype(np.float32)
    found = estimate_normals(Photograph(image, mask, "ball"))
    assert (found[~mask] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(found[mask], axis=-1), 1, atol=1e-5)
    error = angular_error(found, normals, mask).mean()
    flat = angular_error(np.broadcast_to([0.0, 0.0, 1.0], found.shape), normals, mask).mean()
    assert error < flat / 2


def test_resizing_keeps_constants_and_ramps() -> None:
    ramp = np.arange(12.0)[:, None] * np.ones(9)
    smaller = _resized(ramp, (6, 3))
    np.testing.assert_allclose(smaller[1:-1, 0], np.arange(0.5, 12, 2)[1:-1])
    np.testing.assert_allclose(_resized(np.ones((5, 4)), (13, 2)), 1)


def test_npy_is_exact_and_png_is_close(tmp_path: Path) -> None:
    normals, mask = ball()
    normals = (normals * mask[..., None]).astype(np.float32)
    np.testing.assert_array_equal(np.load(write_normals(tmp_path / "n.npy", normals)), normals)
    counts = read_counts(write_normals(tmp_path / "n.png", normals))
    assert counts.dtype == np.uint16
    np.testing.assert_allclose(counts[mask] / 32767.5 - 1, normals[mask], atol=2e-5)
    assert (counts[~mask] == 0).all()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["n.npy", "n.png"]


def test_faults_of_writing(tmp_path: Path) -> None:
    normals, _ = ball(8)
    with pytest.raises(FileFormatError, match=r"\.npy, \.png"):
        write_normals(tmp_path / "n.jpg", normals)
    with pytest.raises(InputFileError, match="does not exist"):
        write_normals(tmp_path / "absent" / "n.npy", normals)
    with pytest.raises(ShapeError, match="H x W x 3"):
        write_normals(tmp_path / "n.npy", normals[..., :2])
    with pytest.raises(InvalidValueError, match="NaN"):
        write_normals(tmp_path / "n.npy", normals * np.nan)
    assert list(tmp_path.iterdir()) == []


def test_faults_of_the_command(folder: Path) -> None:  # noqa: F811
    out = folder / "n.npy"
    with pytest.raises(InputFileError, match="no such file or folder"):
        normals_file(folder / "absent", out)
    with pytest.raises(InputFileError, match="no mask"):
        normals_file(folder / "001.png", out)
    with pytest.raises(FileFormatError, match="ending"):
        normals_file(folder, folder / "n.txt")
    with pytest.raises(InputFileError, match="ONNX"):
        normals_file(folder, out, model=folder / "absent.onnx")
    with pytest.raises(FileFormatError, match="a photometric model"):
        normals_file(folder, out, model=find_model("shading"))
    with pytest.raises(InputFileError, match="no such model"):
        find_model("absent")
    assert not out.exists()


def test_angular_error_needs_equal_shapes() -> None:
    with pytest.raises(ShapeError, match="normals"):
        angular_error(np.zeros((2, 2, 3)), np.zeros((2, 3, 3)), np.ones((2, 2), bool))


@pytest.mark.data
@pytest.mark.parametrize("name", ["ball", "bear", "cat", "pot1"])
def test_never_worse_than_least_squares_on_real_objects(benchmark_data: Path, name: str) -> None:
    photographs = read_photographs(benchmark_data / "diligent" / name)
    mask = np.zeros_like(photographs.mask)
    mask[::3, ::3] = photographs.mask[::3, ::3]
    fewer = type(photographs)(
        photographs.images, mask, photographs.light_directions, photographs.ground_truth, name
    )
    ours = angular_error(estimate_normals(fewer), fewer.ground_truth, mask).mean()
    baseline = angular_error(least_squares_normals(fewer), fewer.ground_truth, mask).mean()
    assert ours < baseline
