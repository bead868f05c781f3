"""The main job in miniature: every step runs, the page is whole, bad input fails first."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.demo.test_trainer import touch
from torchradiometry.demo import network, run_demo
from torchradiometry.errors import InputFileError
from torchradiometry.files import write_picture
from torchradiometry.learn.samples.data import SurfaceOptions
from torchradiometry.learn.training.settings import PhotometricTraining

TINY = PhotometricTraining(
    steps=4, surfaces=SurfaceOptions(shapes=2, pixels=40, lights=12, size=24), features=16, depth=1
)


def write_sphere_set(folder: Path, lights: int = 6, size: int = 24) -> Path:
    """A white ball under known lights, as 8-bit photographs with their true normals."""
    folder.mkdir()
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j]
    inside = x**2 + y**2 < 0.9
    normal = np.dstack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, None))]) * inside[..., None]
    azimuth = np.linspace(0, 2 * np.pi, lights, endpoint=False)
    tilt = np.full(lights, 0.6)
    direction = np.stack(
        [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)], -1
    )
    for number, light in enumerate(direction, 1):
        grey = np.clip(normal @ light, 0, 1) * 200
        cv2.imwrite(str(folder / f"{number:03d}.png"), np.dstack([grey] * 3).astype(np.uint8))
    write_picture(folder / "mask.png", np.dstack([inside] * 3).astype(np.float32), exposure=1.0)
    np.savetxt(folder / "light_directions.txt", direction)
    np.savetxt(folder / "light_intensities.txt", np.ones((lights, 3)))
    np.save(folder / "normal_gt.npy", normal.astype(np.float32))
    return folder


@pytest.fixture
def tiny_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "demo_training", lambda fast: TINY)


@pytest.mark.gl
@pytest.mark.usefixtures("tiny_training")
def test_photograph_sets_end_in_a_complete_page(tmp_path: Path) -> None:
    images = write_sphere_set(tmp_path / "ball")
    report = run_demo(tmp_path / "out", images=images, fast=True)
    page = Path(str(report["page"])).read_text()
    assert page.count("<h2>") == 5
    for name in re.findall(r'src="([^"]+)"', page):
        assert (tmp_path / "out" / name).stat().st_size > 0
    steps = json.loads(json.dumps(report["steps"]))
    degrees = next(data for title, data in steps.items() if title.startswith("5"))["degrees"]
    assert degrees["ball"]["least_squares"] < 3
    assert 0 < degrees["ball"]["network"] < 90
    compared = next(data for title, data in steps.items() if title.startswith("1"))
    assert compared["median"] < 0.003
    assert compared["worst"] < 0.01
    assert sorted(p.name for p in tmp_path.iterdir()) == ["ball", "out"]


@pytest.mark.gl
@pytest.mark.usefixtures("tiny_training")
def test_without_images_the_shipped_model_looks_at_a_portrait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "export_network", touch)
    report = run_demo(tmp_path / "out", fast=True)
    assert "Grace Hopper" in Path(str(report["page"])).read_text()
    assert (tmp_path / "out" / "portrait-normals.png").stat().st_size > 1000


def test_a_folder_without_photographs_fails_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for images in (tmp_path / "empty", tmp_path / "missing"):
        with pytest.raises(InputFileError):
            run_demo(tmp_path / "out", images=images, fast=True)
    assert [p.name for p in tmp_path.iterdir()] == ["empty"]
