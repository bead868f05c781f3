"""The benchmarks' measures on made-up objects, and on the real ones where they lie beside."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.demo.test_run import write_sphere_set
from torchradiometry.demo import run_benchmark
from torchradiometry.deploy import (
    angular_error,
    estimate_normals,
    find_model,
    read_photographs,
)
from torchradiometry.errors import FileFormatError, InputFileError, OutOfRangeError, ShapeError
from torchradiometry.files import write_counts
from torchradiometry.learn.benchmarks import (
    drawn_lights,
    evaluate_draws,
    evaluate_single,
    evaluate_singles,
    photometric_benchmark,
    surface_normals,
)

SIZE = 48


def height_of_ball(size: int = SIZE) -> NDArray[np.float64]:
    """Height in pixels of a half ball, NaN outside."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    room = (0.45 * size) ** 2 - x * x - y * y
    return np.sqrt(np.where(room > 4, room, np.nan))


def write_object(folder: Path, size: int = SIZE) -> Path:
    """A matt ball under one light, as the single-image benchmark lays it out."""
    folder.mkdir(parents=True)
    height = height_of_ball(size)
    normal = np.nan_to_num(surface_normals(height))
    grey = (normal @ np.array([0.3, 0.4, 0.87])).clip(0)
    write_counts(folder / "diffuse.png", np.dstack([65535 * 0.8 * grey] * 3).astype(np.uint16))
    write_counts(folder / "mask.png", np.isfinite(height).astype(np.uint8) * 255)
    np.savez(folder / "geometry.npz", Z=height.astype(np.float32))
    return folder


def test_normals_of_heights_are_those_of_the_surface() -> None:
    height = height_of_ball(200)
    found = surface_normals(height)
    y, x = np.mgrid[:200, :200] - 99.5
    radius = 90.0
    exact = np.stack([x, -y, height], -1) / radius  # image rows run down, y runs up
    inner = np.isfinite(found).all(-1) & (x * x + y * y < 80**2)
    np.testing.assert_allclose(np.linalg.norm(found[inner], axis=-1), 1)
    np.testing.assert_allclose(found[inner], exact[inner], atol=2e-3)


def test_a_normal_needs_all_its_nine_pixels() -> None:
    height = np.zeros((7, 7))
    height[3, 3] = np.nan
    finite = np.isfinite(surface_normals(height)).all(-1)
    expected = np.zeros((7, 7), bool)
    expected[1:6, 1:6] = True
    expected[2:5, 2:5] = False
    np.testing.assert_array_equal(finite, expected)


def test_one_object_is_scored_beside_its_outline(tmp_path: Path) -> None:
    found = evaluate_single(write_object(tmp_path / "ball"))
    assert found.name == "ball"
    assert found.pixels == np.isfinite(surface_normals(height_of_ball())).all(-1).sum()
    assert 0 < found.radians < found.outline < 1.5
    assert found.radians < np.radians(15)
    control = evaluate_single(tmp_path / "ball", control=find_model("shading"))
    assert control[:4] == found[:4]
    with pytest.raises(FileFormatError, match="a model of"):
        evaluate_single(tmp_path / "ball", control=find_model("photometric"))


def test_draws_of_lights_are_the_published_ones(tmp_path: Path) -> None:
    assert drawn_lights(96, 10, 3) == np.random.default_rng(3).permutation(96)[:10].tolist()
    photographs = read_photographs(write_sphere_set(tmp_path / "ball", lights=9))
    rows = evaluate_draws(photographs, lights=4, draws=3)
    assert [(row.seed, row.lights) for row in rows] == [(0, 4), (1, 4), (2, 4)]
    chosen = photographs.under(drawn_lights(9, 4, 2))
    error = angular_error(estimate_normals(chosen), chosen.ground_truth, chosen.mask)
    assert rows[2].degrees == pytest.approx(error.mean())
    with pytest.raises(OutOfRangeError, match="lights"):
        evaluate_draws(photographs, lights=2)


def test_photometric_benchmark_takes_every_set(tmp_path: Path) -> None:
    write_sphere_set(tmp_path / "a", lights=6)
    write_sphere_set(tmp_path / "b", lights=4)
    done: list[str] = []
    rows = photometric_benchmark(
        tmp_path, lights=4, draws=2, advance=lambda k, name: done.append(name)
    )
    assert done == ["a", "b"]
    assert [(row.name, row.lights, row.seed) for row in rows] == [
        ("a", 6, None),
        ("a", 4, 0),
        ("a", 4, 1),
        ("b", 4, None),  # no more lights than a draw has
    ]


def test_tables_hold_means_published_rows_and_every_figure(tmp_path: Path) -> None:
    sets = tmp_path / "sets"
    sets.mkdir()
    write_sphere_set(sets / "ball", lights=6)
    write_sphere_set(sets / "cat", lights=6)
    rows = "method,ball,pot1,cat,avg\nworse [/b],3,9,5,9\nbetter,1,9,2,9\nholes,1,2,,9\n"
    (tmp_path / "published.csv").write_text(rows)
    found = run_benchmark(
        "photometric",
        sets,
        lights=4,
        draws=2,
        table=tmp_path / "t.csv",
        published=tmp_path / "published.csv",
    )
    assert list(found.report["published"]) == ["better", "worse [/b]"]
    assert found.report["published"]["worse [/b]"] == {"ball": 3, "cat": 5, "mean": 4}
    for row in found.report["rows"].values():
        assert row["mean"] == pytest.approx((row["ball"] + row["cat"]) / 2)
    with (tmp_path / "t.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 6
    some = [float(each["degrees"]) for each in lines if each["name"] == "cat" and each["seed"]]
    drawn = found.report["rows"]["this model, 4 lights, mean of 2"]
    assert drawn["cat"] == pytest.approx(np.mean(some))
    for word in (
        "mean angle, degrees",
        "this model",
        "least squares",
        "better",
        "worse [/b]",
        "4.00",
    ):
        assert word in found.table


def test_shading_table_has_the_geometric_mean(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_object(tmp_path / "objects" / name, SIZE + 8 * (name == "two"))
    rows = "condition,algorithm,N_MAE_rad\ngray,B,0.5\ngray,A,0.4\ngray,C,\n"
    (tmp_path / "published.csv").write_text(rows)
    found = run_benchmark("shading", tmp_path / "objects", published=tmp_path / "published.csv")
    each = found.report["rows"]["this model"]
    assert each["mean"] == pytest.approx(np.sqrt(each["one"] * each["two"]))
    assert list(found.report["published"].values()) == [{"mean": 0.4}, {"mean": 0.5}]
    assert "radians" in found.table
    assert [row["name"] for row in found.report["measurements"]] == ["one", "two"]


def test_faults_are_named(tmp_path: Path) -> None:
    for absent in (tmp_path / "none", tmp_path):
        with pytest.raises(InputFileError):
            evaluate_singles(absent)
    folder = write_object(tmp_path / "ball")
    (tmp_path / "p.csv").write_text("name,ball\n")
    with pytest.raises(FileFormatError, match="no column condition"):
        run_benchmark("shading", folder, published=tmp_path / "p.csv")
    (tmp_path / "p.csv").write_text("condition,algorithm,N_MAE_rad\na,b,many\n")
    with pytest.raises(FileFormatError, match="write numbers"):
        run_benchmark("shading", folder, published=tmp_path / "p.csv")
    np.savez(folder / "geometry.npz", Z=np.zeros((3, 3)))
    with pytest.raises(ShapeError, match="Z of shape"):
        evaluate_single(folder)
    np.savez(folder / "geometry.npz", Z=np.full((SIZE, SIZE), np.nan))
    with pytest.raises(ShapeError, match="no pixel"):
        evaluate_single(folder)
    np.savez(folder / "geometry.npz", height=np.zeros((SIZE, SIZE)))
    with pytest.raises(FileFormatError, match="no file of heights with Z"):
        evaluate_single(folder)
    (folder / "diffuse.png").unlink()
    with pytest.raises(InputFileError, match="no such file"):
        evaluate_single(folder)


@pytest.mark.data
def test_real_objects_have_a_reproducible_error(benchmark_data: Path) -> None:
    """Least squares on the 8-bit ball is published beside the data: 4.26 degrees."""
    (ball,) = photometric_benchmark(benchmark_data / "diligent" / "ball", draws=0)
    assert ball.least_squares == pytest.approx(4.26, abs=0.005)
    apple = evaluate_single(benchmark_data / "mit_berkeley" / "apple")
    assert 0.1 < apple.radians < apple.outline + 0.1
