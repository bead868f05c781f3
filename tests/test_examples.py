"""Every example runs, quickly, and its figures make sense."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses look up their annotations
    spec.loader.exec_module(module)
    return module


def test_local_and_global(tmp_path: Path) -> None:
    shares = load("local_and_global").main(fast=True, out=tmp_path / "room.png")
    assert 0.2 < shares["direct"] < shares["one bounce"] < 1
    assert (tmp_path / "room.png").stat().st_size > 500


def test_gilchrist(tmp_path: Path) -> None:
    white, black = load("gilchrist").main(fast=True, out=tmp_path / "rooms.png").values()
    assert black["dynamic range"] > 10 * white["dynamic range"] > 10
    assert black["shadow depth"] > 2 * white["shadow depth"] > 0
    assert black["sharpness"] > 5 * white["sharpness"] > 0
    assert 0 < black["reflected share"] < 0.1 < 0.8 < white["reflected share"] < 1
    assert (tmp_path / "rooms.png").stat().st_size > 500


def test_reflexes(tmp_path: Path) -> None:
    found = load("reflexes").main(fast=True, out=tmp_path / "reflexes.png")
    for measured, wanted in found.values():
        assert measured == pytest.approx(wanted, rel=0.02, abs=0.02)
    assert (tmp_path / "reflexes.png").stat().st_size > 500


def test_smoothing(tmp_path: Path) -> None:
    found = load("smoothing").main(fast=True, out=tmp_path / "bowl.png")
    for measured, wanted in found.values():
        assert measured == pytest.approx(wanted, rel=0.02, abs=0.02)
    assert (tmp_path / "bowl.png").stat().st_size > 500


def test_concave_relief(tmp_path: Path) -> None:
    found = load("concave_relief").main(fast=True, out=tmp_path / "reliefs.png")
    for errors in found.values():
        assert errors["global"] < errors["local"] / 2
    assert (tmp_path / "reliefs.png").stat().st_size > 500


def test_bounce_separation(tmp_path: Path) -> None:
    errors = load("bounce_separation").main(fast=True, out=tmp_path / "bounces.png")
    assert errors["direct light"] < errors["photograph as direct light"] / 10
    assert errors["left in the shadow"] < 0.1
    assert errors["bounce 1"] < 0.1
    assert (tmp_path / "bounces.png").stat().st_size > 500


def test_lecture_light(tmp_path: Path) -> None:
    found = load("lecture_light").main(fast=True, out=tmp_path / "light.png")
    assert found["A / r^2 over the solid angle at 1 m"] == pytest.approx(1.2416, abs=1e-3)
    assert (tmp_path / "light.png").stat().st_size > 500


def test_lecture_reflection(tmp_path: Path) -> None:
    shares = load("lecture_reflection").main(fast=True, out=tmp_path / "reflection.png")
    assert shares["Lambertian, 0.6"] == pytest.approx(0.6, abs=1e-6)
    assert shares["Phong, n = 20"] == pytest.approx(shares["Phong, n = 200"], abs=1e-6)
    assert (tmp_path / "reflection.png").stat().st_size > 500


def test_lecture_sources(tmp_path: Path) -> None:
    dark = load("lecture_sources").main(fast=True, out=tmp_path / "sources.png")
    assert dark["the whole sky"] < dark["a lamp in a cone (spot)"]
    assert (tmp_path / "sources.png").stat().st_size > 500


def test_lecture_interreflection(tmp_path: Path) -> None:
    found = load("lecture_interreflection").main(fast=True, out=tmp_path / "room.png")
    lit = [found[name] for name in ("direct light", "+ 1 bounce", "+ 2 bounces")]
    assert 0.3 < lit[0] < lit[1] < lit[2] < 1
    assert (tmp_path / "room.png").stat().st_size > 500


def test_relight(tmp_path: Path) -> None:
    found = load("relight").main(fast=True, out=tmp_path / "faces.png")
    assert 0.8 < found["explained"] <= 1
    assert all(found[name] > 2 * found["all sides"] > 0 for name in ("left", "right", "below"))
    assert (tmp_path / "faces.png").stat().st_size > 500


def test_photometric_stereo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main = load("photometric_stereo").main
    found = main(fast=True, out=tmp_path / "normals.png", source=tmp_path / "nowhere")["relief"]
    assert "no photographs" in capsys.readouterr().out
    assert found["network"] < 0.6 * found["least squares"] < 6
    assert (tmp_path / "normals.png").stat().st_size > 500


def test_fit_albedo_and_lights(tmp_path: Path) -> None:
    found = load("fit_albedo_and_lights").main(fast=True, out=tmp_path / "ball.png")
    assert found["directions, degrees"] < 3
    assert found["irradiance"] < 0.05
    assert found["paint"] < 0.05
    assert (tmp_path / "ball.png").stat().st_size > 500


def test_inverse_room(tmp_path: Path) -> None:
    found = load("inverse_room").main(fast=True, out=tmp_path / "room.png")
    assert found["all light"]["albedo, worst"] < 0.05
    assert found["all light"]["lamp"] < 0.1
    assert found["direct light alone"]["albedo, mean"] > 5 * found["all light"]["albedo, mean"]
    assert (tmp_path / "room.png").stat().st_size > 500


@pytest.mark.gl
def test_rasteriser(tmp_path: Path) -> None:
    found = load("rasteriser").main(fast=True, out=tmp_path / "ball.png")
    assert found["median"] < 1e-5
    assert found["worst"] < 1e-2
    assert (tmp_path / "ball.png").stat().st_size > 500


def test_penumbra(tmp_path: Path) -> None:
    found = load("penumbra").main(fast=True, out=tmp_path / "penumbra.png")
    assert found["half of the lamp"] == pytest.approx(0.5, abs=1e-9)
    assert found["slope over finite difference"] == pytest.approx(1, abs=1e-4)
    assert found["4 rays"] > 2 * found["64 rays"] > 0
    assert (tmp_path / "penumbra.png").stat().st_size > 500


def test_plan_a_scene(tmp_path: Path) -> None:
    found = load("plan_a_scene").main(fast=True, out=tmp_path / "plan.png")
    assert found["direct light"] > 2 * found["2 and a tail"] > 0
    assert found["plan for 3%"] < found["plan for 10%"] < 0.1
    assert (tmp_path / "plan.png").stat().st_size > 500


def test_train_and_ship(tmp_path: Path) -> None:
    found = load("train_and_ship").main(fast=True, out=tmp_path / "curve.png")
    assert found["torch against onnxruntime"] < 1e-4
    assert found["60 steps"] < found["least squares"]
    assert (tmp_path / "curve.png").stat().st_size > 500


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_every_example_has_a_test_here(path: Path) -> None:
    assert f"def test_{path.stem}" in Path(__file__).read_text()
