"""From a file to a picture: what is asked for is checked before anything is computed."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from torchradiometry import errors, files, plan, scene
from torchradiometry.render.indirect import MOST_DENSE
from torchradiometry.scene.standard import STANDARD_SCENES


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "room.glb"
    scene.save_scene(STANDARD_SCENES["white room"](40, 30), path)
    return path


@pytest.mark.parametrize("ending", [".npy", ".png"])
def test_render_file(file: Path, ending: str) -> None:
    out = file.with_name(f"picture{ending}")
    report = plan.render_file(file, out, width=16, height=12, tolerance=0.02)
    assert {"out", "seconds", "plan", "predicted_error"} <= set(json.loads(json.dumps(report)))
    assert report["operator"] == f"a matrix: {report['patches']} patches, at most {MOST_DENSE}"
    assert report["predicted_error"] <= 0.02
    pixels = files.read_picture(out)
    assert pixels.shape == (12, 16, 3)
    assert np.isfinite(pixels).all()
    assert pixels.max() > 0


def test_standard_scenes_are_known_by_name(file: Path) -> None:
    found = plan.plan_file("white room", width=16, height=12, tolerance=0.02)
    assert found.settings.bounces > 0
    assert found.predicted_error <= 0.02
    hurried = plan.plan_file(file, width=16, height=12, seconds=1e-6)
    assert hurried.settings.bounces == 0
    with pytest.raises(errors.OutOfRangeError, match="one of the two"):
        plan.plan_file(file)


def test_render_file_leaves_nothing_behind_on_bad_input(file: Path) -> None:
    folder = file.parent
    with pytest.raises(errors.FileFormatError, match="ending"):
        plan.render_file(file, folder / "picture.jpeg")
    with pytest.raises(errors.InputFileError, match="folder"):
        plan.render_file(file, folder / "nowhere" / "picture.png")
    with pytest.raises(errors.InputFileError):
        plan.render_file(folder / "missing.glb", folder / "picture.png")
    with pytest.raises(errors.OutOfRangeError):
        plan.render_file(file, folder / "picture.png", tolerance=2.0)
    with pytest.raises(errors.OutOfRangeError):
        plan.render_file(file, folder / "picture.png", width=0)
    assert [p.name for p in folder.iterdir()] == ["room.glb"]
    assert torch.is_grad_enabled()
