"""Least squares: exact on matt surfaces, and the published figures on real ones."""

from pathlib import Path

import numpy as np
import pytest

from torchradiometry.deploy.normals import angular_error
from torchradiometry.deploy.photographs import Photographs, read_photographs
from torchradiometry.deploy.woodham import least_squares_normals, solve_least_squares
from torchradiometry.errors import DegenerateGeometryError


def matt(seed: int = 0) -> Photographs:
    """A matt 5 x 7 object whose every pixel sees every light."""
    random = np.random.default_rng(seed)
    lights = random.normal(size=(9, 3)) * [0.3, 0.3, 0.05] + [0, 0, 1]
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    normals = random.normal(size=(5, 7, 3)) * 0.3 + [0, 0, 1]
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    grey = random.uniform(0.2, 0.9, (5, 7)) * np.einsum("nk,hwk->nhw", lights, normals)
    mask = np.ones((5, 7), bool)
    mask[0] = False
    images = np.repeat(grey[..., None], 3, -1).astype(np.float32)
    return Photographs(images, mask, lights.astype(np.float32), normals.astype(np.float32), "matt")


def test_matt_normals_are_exact() -> None:
    photographs = matt()
    found = least_squares_normals(photographs)
    assert (found[0] == 0).all()
    assert angular_error(found, photographs.ground_truth, photographs.mask).max() < 0.01


def test_a_black_pixel_faces_the_camera() -> None:
    photographs = matt()
    photographs.images[:, 2, 2] = 0
    np.testing.assert_array_equal(least_squares_normals(photographs)[2, 2], [0, 0, 1])


def test_lights_in_one_plane_are_named() -> None:
    lights = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [-0.6, 0, 0.8]])
    with pytest.raises(DegenerateGeometryError, match="one plane"):
        solve_least_squares(np.ones((2, 3)), lights)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "degrees"), [("ball", 4.26), ("bear", 8.46), ("cat", 8.52), ("pot1", 9.11)]
)
def test_figures_on_real_objects(benchmark_data: Path, name: str, degrees: float) -> None:
    photographs = read_photographs(benchmark_data / "diligent" / name)
    found = least_squares_normals(photographs)
    error = angular_error(found, photographs.ground_truth, photographs.mask)
    assert error.mean() == pytest.approx(degrees, abs=0.006)
