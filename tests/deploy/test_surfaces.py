"""Heights, paint and light without torch: the same as with it, and all of it in one file."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.deploy.test_normals import SOURCES, ball
from tests.deploy.test_woodham import matt
from torchradiometry.deploy import surfaces
from torchradiometry.deploy.heights import integrate_normals
from torchradiometry.deploy.light import fit_light, shine
from torchradiometry.deploy.photographs import Photograph
from torchradiometry.deploy.surfaces import (
    SurfaceEstimate,
    estimate_surface,
    normals_file,
    write_surface,
)
from torchradiometry.errors import FileFormatError, InputFileError, ShapeError
from torchradiometry.files import linear_to_srgb, write_counts
from torchradiometry.geometry.heights import normals_to_heights
from torchradiometry.learn.light import estimate_light
from torchradiometry.sources.harmonics import HarmonicSource


def images_of(*parts: np.ndarray) -> list[torch.Tensor]:
    """`H W C` as `1 C H W`."""
    return [torch.from_numpy(np.ascontiguousarray(p)).permute(2, 0, 1)[None] for p in parts]


def noisy(size: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Normals of a ball with noise, and a mask of two pieces and a lonely pixel."""
    generator = np.random.default_rng(seed)
    normal, mask = ball(size)
    normal = normal + 0.2 * generator.standard_normal(normal.shape)
    mask[:, size // 2] = False
    mask[0, 0] = True
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True), mask


@pytest.mark.parametrize("size", [1, 2, 17, 40])
def test_heights_are_those_of_torch(size: int) -> None:
    normal, mask = noisy(size)
    ours = integrate_normals(normal, mask, 0.25)
    (image,), inside = images_of(normal), torch.from_numpy(mask)[None, None]
    theirs = normals_to_heights(image, inside, 0.25).height[0, 0].numpy()
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8)


def test_heights_of_hard_cases() -> None:
    normal, mask = ball(9)
    assert np.isnan(integrate_normals(normal, np.zeros_like(mask))).all()
    walls = np.zeros((5, 6, 3))
    walls[:, :3, 0] = 1
    assert np.isfinite(integrate_normals(walls, np.ones((5, 6), bool))).all()
    normal[4, 4] = np.nan
    found = integrate_normals(normal, mask)
    assert np.isnan(found[4, 4])
    assert np.isfinite(found[mask & ~np.isnan(normal).any(-1)]).all()
    with pytest.raises(ShapeError, match="H x W x 3"):
        integrate_normals(normal[..., 0], mask)


def lit(size: int = 32, seed: int = 1) -> tuple[np.ndarray, ...]:
    """Image, normals, albedo of the pixels of a ball under random light, in part in shadow."""
    generator = np.random.default_rng(seed)
    normal, mask = ball(size)
    normal = normal[mask] / np.linalg.norm(normal[mask], axis=-1, keepdims=True)
    albedo = generator.uniform(0.1, 0.9, normal.shape)
    light = generator.standard_normal((9, 3))
    light[0] = 3
    image = albedo / np.pi * shine(normal, light)
    image[: len(image) // 6] *= 0.3
    return image, normal, albedo, light


def test_light_is_that_of_torch_and_true() -> None:
    image, normal, albedo, light = lit()
    ours = fit_light(image, normal, albedo)
    parts = (torch.from_numpy(p.T[None, :, None].copy()) for p in (image, normal, albedo))
    theirs = estimate_light(*parts, torch.ones(1, 1, 1, len(image))).numpy()[0]
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours, light, rtol=0, atol=3e-4)


def test_light_shines_as_the_source_does() -> None:
    _, normal, _, light = lit()
    source = HarmonicSource(torch.from_numpy(light))
    theirs = source(None, torch.from_numpy(normal)).irradiance[0].numpy()
    np.testing.assert_allclose(shine(normal, light), theirs, rtol=1e-12, atol=1e-12)


def test_light_of_hard_cases() -> None:
    image, normal, albedo, _ = lit()
    assert (fit_light(0 * image, normal, albedo) == 0).all()
    assert (fit_light(image, normal, 0 * albedo) == 0).all()
    assert (fit_light(image[:0], normal[:0], albedo[:0]) == 0).all()
    assert np.isfinite(fit_light(image, 0 * normal + [0, 0, 1], albedo)).all()
    with pytest.raises(ShapeError, match="pixel x C"):
        fit_light(image, normal[:5], albedo)


def test_many_pixels_are_thinned_out(monkeypatch: pytest.MonkeyPatch) -> None:
    image, normal, albedo, light = lit()
    order = np.random.default_rng(2).permutation(len(image))
    monkeypatch.setattr("torchradiometry.deploy.light.PIXELS", 200)
    found = fit_light(image[order], normal[order], albedo[order])
    np.testing.assert_allclose(found, light, rtol=0, atol=3e-3)


def photographed(size: int = 48) -> tuple[Photograph, np.ndarray]:
    """A white ball in coloured natural light, and its heights."""
    normal, mask = ball(size)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    light = np.zeros((9, 3))
    light[:4] = np.array([[1.0], [0.45], [0.5], [0.3]]) * [0.8, 0.7, 0.5]
    image = np.where(mask[..., None], shine(normal, light) / np.pi, 0).astype(np.float32)
    height = np.where(mask, normal[..., 2], np.nan) * size / 2.2
    return Photograph(image, mask, "ball"), height - np.nanmean(height)


def test_one_photograph_gives_everything() -> None:
    photograph, height = photographed()
    found = estimate_surface(photograph)
    inside, outside = photograph.mask, ~photograph.mask
    assert found.explained is not None
    assert 0.97 < found.explained <= 1
    assert found.albedo is not None
    assert found.albedo[inside].mean() == pytest.approx(1, abs=1e-5)
    assert (found.albedo[outside] == 0).all()
    assert np.isnan(found.height[outside]).all()
    error = (found.height - height)[inside]
    assert np.sqrt(np.mean(error**2)) < 0.5 * np.nanstd(height)


def test_photographs_under_known_lights_give_heights() -> None:
    found = estimate_surface(matt())
    assert found.albedo is None
    assert found.light is None
    assert np.isfinite(found.height[found.mask]).all()
    assert list(found.arrays()) == ["normal", "height", "mask"]


def test_a_model_without_paint_gives_no_light(monkeypatch: pytest.MonkeyPatch) -> None:
    photograph, _ = photographed(24)
    monkeypatch.setattr(
        "torchradiometry.deploy.normals.run_model",
        lambda model, inputs: (inputs["mask"] * np.array([0, 0.6, 0.8]).reshape(3, 1, 1),),
    )
    found = estimate_surface(photograph)
    inside = found.normal[photograph.mask]
    np.testing.assert_allclose(inside, np.broadcast_to([0, 0.6, 0.8], inside.shape), atol=1e-6)
    assert found.light is None


def test_a_black_photograph_is_finite() -> None:
    photograph, _ = photographed(24)
    found = estimate_surface(Photograph(0 * photograph.image, photograph.mask, "night"))
    assert found.light is not None
    assert (found.light == 0).all()
    assert found.explained == 1
    assert np.isfinite(found.height[found.mask]).all()


def test_the_command_writes_it_without_torch(tmp_path: Path) -> None:
    photograph, _ = photographed()
    encoded = np.round(linear_to_srgb(photograph.image.clip(0, 1)) * 65535)
    write_counts(tmp_path / "ball.png", encoded.astype(np.uint16))
    write_counts(tmp_path / "mask.png", photograph.mask.astype(np.uint8) * 255)
    program = (
        "import sys\n"
        "from torchradiometry.cli import app\n"
        "try:\n"
        "    app()\n"
        "finally:\n"
        "    assert 'torch' not in sys.modules, 'torch was imported'\n"
    )
    words = ["normals", "ball.png", "--mask", "mask.png", "--out", "ball.npz", "--json"]
    done = subprocess.run(
        [sys.executable, "-c", program, *words],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={"PYTHONPATH": str(SOURCES), "PATH": ""},
    )
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    with np.load(tmp_path / "ball.npz") as stored:
        assert sorted(stored) == sorted(report["arrays"])
        assert stored["normal"].shape == (48, 48, 3)
        np.testing.assert_allclose(stored["light"], report["light"])
        np.testing.assert_array_equal(stored["mask"], photograph.mask)
    assert report["explained"] > 0.97
    assert sorted(p.name for p in tmp_path.iterdir()) == ["ball.npz", "ball.png", "mask.png"]


def test_other_endings_hold_the_normals(tmp_path: Path) -> None:
    normal, mask = ball(12)
    normal = (normal * mask[..., None]).astype(np.float32)
    surface = SurfaceEstimate(normal, integrate_normals(normal, mask).astype(np.float32), mask)
    np.testing.assert_array_equal(np.load(write_surface(tmp_path / "n.npy", surface)), normal)
    with pytest.raises(FileFormatError, match=r"\.npz, \.npy, \.png"):
        write_surface(tmp_path / "n.mat", surface)
    with pytest.raises(InputFileError, match="does not exist"):
        write_surface(tmp_path / "absent" / "n.npz", surface)


def test_nothing_is_estimated_for_a_file_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surfaces, "read_photograph", None)
    with pytest.raises(FileFormatError, match="ending"):
        normals_file(tmp_path, tmp_path / "n.jpg")
