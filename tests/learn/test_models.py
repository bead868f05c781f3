"""The shipped models: they run, and their cards say what `metrics.json` says."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks.photographs import (
    MODELS,
    OBJECTS,
    PHOTOGRAPH,
    beside_least_squares,
    main,
    markdown,
    one_photograph,
    reflected,
    sphere_normals,
)
from torchradiometry.deploy import Photographs, read_photographs
from torchradiometry.learn import read_training
from torchradiometry.learn.training.settings import kind_of

SHIPPED = sorted(path.parent for path in MODELS.glob("*/model.onnx"))
#: what two processors and two versions of onnxruntime may differ by, degrees, and the rounding
SAME = 0.02


def metrics(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


def sphere(lights: np.ndarray, size: int = 48) -> Photographs:
    """A matt ball of albedo 0.5 under distant lights of irradiance pi."""
    row, column = np.indices((size, size))
    mask = (row - size / 2) ** 2 + (column - size / 2) ** 2 < (0.45 * size) ** 2
    normal = (sphere_normals(mask) * mask[..., None]).astype(np.float32)
    seen = 0.5 * np.clip(normal @ lights.T, 0, None)
    images = np.repeat(np.moveaxis(seen, -1, 0)[..., None], 3, -1).astype(np.float32)
    return Photographs(images, mask, lights.astype(np.float32), normal, "ball")


@pytest.fixture(scope="module")
def ball() -> Photographs:
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    lights = np.stack([0.4 * np.cos(around), 0.4 * np.sin(around), 0 * around + 0.84**0.5], -1)
    return sphere(lights)


def test_two_models_are_shipped() -> None:
    assert [folder.name for folder in SHIPPED] == ["photometric", "shading"]


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_card_shows_the_measured_table(folder: Path) -> None:
    """Line by line, so that a figure cannot stand beside another object's name."""
    card, found = (folder / "card.md").read_text(), metrics(folder)
    assert markdown(found["mean_angle_degrees"]) in card
    assert f"{found['parameters']:,} parameters, {found['bytes'] / 1e6:.1f} MB" in card


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_other_figures_of_a_card_are_measured_ones(folder: Path) -> None:
    """Prose repeats the table's figures and has none of its own, but for its history."""
    card = (folder / "card.md").read_text()
    prose = re.sub(r"```.*?```|^\|.*?$", "", card, flags=re.DOTALL | re.MULTILINE)
    prose = prose.split("**How it was chosen.**")[0]
    measured = {
        f"{v:.2f}" for row in metrics(folder)["mean_angle_degrees"].values() for v in row.values()
    }
    assert set(re.findall(r"\d+\.\d\d\b", prose)) <= measured


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_metrics_describe_the_file_beside_them(folder: Path) -> None:
    size = (folder / "model.onnx").stat().st_size
    assert metrics(folder)["bytes"] == size < 8e6


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_the_command_of_a_card_writes_this_model(folder: Path) -> None:
    (command,) = re.findall(r"```bash\n(.*?)```", (folder / "card.md").read_text(), re.DOTALL)
    train, copy = command.strip().splitlines()
    settings, made = f"models/{folder.name}/training.toml", f"{folder.name}-training"
    assert train == f"torchradiometry train {folder.name} --config {settings} --out {made}"
    assert copy == f"cp {made}/model.onnx models/{folder.name}/"
    training = read_training(folder / "training.toml")
    assert kind_of(training) == folder.name
    parameters = sum(p.numel() for p in training.network().parameters())
    assert parameters == metrics(folder)["parameters"]


def test_photometric_model_is_better_than_no_model(ball: Photographs) -> None:
    found = beside_least_squares(ball, MODELS / "photometric" / "model.onnx")
    assert found["this model"] < 5


def test_photometric_mean_rows_are_means() -> None:
    rows = metrics(MODELS / "photometric")["mean_angle_degrees"]
    for lights in (96, 10):
        for column, mean in rows[f"mean, {lights} lights"].items():
            each = [rows[f"{name}, {lights} lights"][column] for name in OBJECTS]
            assert mean == pytest.approx(np.mean(each), abs=0.01)


def test_shading_model_sees_a_ball(ball: Photographs) -> None:
    found = one_photograph(ball, 0, MODELS / "shading" / "model.onnx")
    assert found["facing the camera"] == pytest.approx(45, abs=0.5)  # the mean over a half ball
    assert found["this model"] < 0.5 * found["facing the camera"]


def test_lights_are_found_in_a_chrome_sphere() -> None:
    """The highlight of v-mirroring normals n = (l + v)/|l + v| gives l back."""
    row, column = np.indices((201, 201))
    mask = (row - 100) ** 2 + (column - 100) ** 2 <= 90**2
    light = np.array([0.4, -0.3, 0.75**0.5])
    half = light + np.array([0, 0, 1])
    normal = sphere_normals(mask)
    image = np.repeat((normal @ half > 0.999 * np.linalg.norm(half))[..., None], 3, -1).astype(
        np.float32
    )
    assert reflected(image, mask, normal) @ light > np.cos(np.radians(0.5))


def test_absent_photographs_change_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = [(folder / "metrics.json").read_bytes() for folder in SHIPPED]
    assert main(["--data", str(tmp_path / "absent")]) == 1
    assert "nothing measured, nothing written" in capsys.readouterr().out
    assert [(folder / "metrics.json").read_bytes() for folder in SHIPPED] == before


@pytest.mark.data
def test_metrics_are_found_again_on_a_real_ball(benchmark_data: Path) -> None:
    real = read_photographs(benchmark_data / "diligent" / "ball")
    many, one = (MODELS / name for name in ("photometric", "shading"))
    found = beside_least_squares(real, many / "model.onnx")
    assert found == pytest.approx(metrics(many)["mean_angle_degrees"]["ball, 96 lights"], abs=SAME)
    found = one_photograph(real, PHOTOGRAPH - 1, one / "model.onnx")
    assert found == pytest.approx(metrics(one)["mean_angle_degrees"]["ball"], abs=SAME)
