"""The ladder climbs as far as a scene calls for, and the study says what it measured."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchradiometry.errors import (
    EmptySceneError,
    FileFormatError,
    InputFileError,
    OutOfRangeError,
    ShapeError,
)
from torchradiometry.plan import memory
from torchradiometry.plan.ladder import MOST_PATCHES, Rung, ladder
from torchradiometry.plan.tradeoff import Tradeoff, tradeoff
from torchradiometry.plan.tradeoff_file import tradeoff_file
from torchradiometry.render import RenderSettings, render_scene
from torchradiometry.render.indirect import first_patches
from torchradiometry.render.world import prepare
from torchradiometry.scene import Scene, box
from torchradiometry.scene.standard import STANDARD_SCENES

SIZE = (16, 12)
LOCAL = Rung("local", RenderSettings(bounces=0, supersampling=1))
SHORT = (
    LOCAL,
    Rung("the same", RenderSettings(bounces=0, supersampling=1, seed=0)),
    Rung("1 bounce", RenderSettings(bounces=1, supersampling=1, ambient_tail=False)),
    Rung("2 bounces", RenderSettings(bounces=2, supersampling=1, ambient_tail=False)),
    Rung("all", RenderSettings(bounces=64, supersampling=1)),
)


def names(scene: str) -> list[str]:
    return [rung.name for rung in ladder(STANDARD_SCENES[scene](*SIZE))]


@pytest.fixture(scope="module")
def study() -> Tradeoff:
    scene = STANDARD_SCENES["groove"](*SIZE)
    return tradeoff(scene, repeats=2, rungs=SHORT, choices=(LOCAL,))


def test_a_convex_body_needs_neither_bounces_nor_areas() -> None:
    assert names("ball") == ["one dot product", "+ shadows", "+ edges", "finest"]


def test_fall_off_is_for_near_lamps_and_penumbras_for_shining_faces() -> None:
    assert "+ fall-off" in names("lamp and ball")
    assert "+ penumbras" not in names("lamp and ball")
    assert "+ penumbras" in names("columns")
    assert "+ fall-off" not in names("columns")


def test_a_room_climbs_every_kind_of_rung() -> None:
    rungs = ladder(STANDARD_SCENES["cornell"](*SIZE))
    found = [rung.name for rung in rungs]
    assert {"+ area", "+ ambient", "1 bounce", "1 bounce, tail", "finest"} <= set(found)
    assert sum(name.startswith("radiosity") for name in found) == 3
    assert found.index("+ ambient") < found.index("1 bounce") < found.index("finest")
    sizes = [r.settings.patch_size for r in rungs if r.name.startswith(("radio", "finest"))]
    assert sizes == sorted(sizes, reverse=True)


def test_the_finest_picture_has_a_bounded_number_of_patches() -> None:
    scene = STANDARD_SCENES["groove"](*SIZE)
    finest = ladder(scene)[-1].settings
    patches = first_patches(prepare(scene, finest), finest).corners
    assert MOST_PATCHES / 4 < len(patches) <= MOST_PATCHES


def test_errors_fall_to_zero_at_the_reference(study: Tradeoff) -> None:
    errors = [row.error for row in study.rows if not row.chosen]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == 0
    assert errors[0] > 0.1


def test_a_rung_that_changes_nothing_is_skipped(study: Tradeoff) -> None:
    assert study.skipped == ("the same",)
    assert [row.name for row in study.rows] == ["local", "1 bounce", "2 bounces", "all", "local"]


def test_choices_are_measured_like_rungs(study: Tradeoff) -> None:
    assert [row.chosen for row in study.rows] == [False] * 4 + [True]
    assert study.rows[-1].error == study.rows[0].error


def test_times_patches_and_peaks_are_counted(study: Tradeoff) -> None:
    for row in study.rows:
        assert min(row.seconds, row.gradient_seconds) > 0
        assert min(row.spread, row.gradient_spread) >= 0
        assert (row.megabytes is None) == (not memory.reset_peak_memory())
        assert (row.patches == 0) == (row.settings.bounces == 0)


def test_errors_are_measured_against_the_reference_that_is_given() -> None:
    scene = STANDARD_SCENES["groove"](*SIZE)
    picture = render_scene(scene, scene.cameras[0], LOCAL.settings).radiance
    study = tradeoff(scene, reference=1.25 * picture, repeats=1, rungs=SHORT[:1])
    assert study.rows[0].error == pytest.approx(0.2, abs=1e-6)
    assert study.rows[0].spread == 0
    assert study.reference != tradeoff(scene, repeats=1, rungs=SHORT[:1]).reference


def test_tables_hold_every_row(study: Tradeoff, tmp_path: Path) -> None:
    kept = json.loads(study.save_json(tmp_path / "a.json").read_text())
    assert kept == json.loads(json.dumps(study.to_dict()))
    assert kept["rows"][1]["settings"]["bounces"] == 1
    text = study.save_csv(tmp_path / "a.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    assert [row["name"] for row in rows] == [row.name for row in study.rows]
    assert [float(row["error"]) for row in rows] == [row.error for row in study.rows]
    assert "bounces=2" in rows[2]["settings"].split()


@pytest.mark.parametrize("ending", ["pdf", "png", "svg"])
def test_the_plot_is_written_in_every_format(study: Tradeoff, tmp_path: Path, ending: str) -> None:
    assert study.save_plot(tmp_path / f"a.{ending}").stat().st_size > 1000


def test_the_plot_refuses_other_formats(study: Tradeoff, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="ending"):
        study.save_plot(tmp_path / "a.jpg")
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_measured_is_said() -> None:
    scene = STANDARD_SCENES["groove"](*SIZE)
    dark = Scene((box("crate", (1.0, 1.0, 1.0)),), (), scene.cameras)
    with pytest.raises(EmptySceneError, match="without light"):
        tradeoff(dark, repeats=1)
    with pytest.raises(EmptySceneError, match="camera"):
        tradeoff(replace(scene, cameras=()))
    with pytest.raises(EmptySceneError, match="triangles"):
        tradeoff(Scene((), (), scene.cameras))
    with pytest.raises(OutOfRangeError, match="repeats"):
        tradeoff(scene, repeats=0)
    with pytest.raises(OutOfRangeError, match="rungs"):
        tradeoff(scene, rungs=())
    with pytest.raises(ShapeError, match="reference"):
        tradeoff(scene, reference=torch.zeros(3, 3, 3))


#: in a process of its own: memory that other tests give back while it runs would count
MEMORY = """
import torch
from torchradiometry.plan import memory
if memory.reset_peak_memory():
    before = memory.peak_memory()
    block = torch.ones(2**24)
    held = memory.peak_memory() - before
    del block
    memory.reset_peak_memory()
    print(held, memory.peak_memory() - before)
"""


def test_memory_counts_what_is_held_and_not_what_was() -> None:
    if not memory.reset_peak_memory():
        assert not memory.CLEAR.exists() or memory.peak_memory() is None
        return
    done = subprocess.run(
        [sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True
    )
    held, left = map(int, done.stdout.split())
    assert left < 2**25 < held


def test_a_folder_with_the_study_of_a_scene(tmp_path: Path) -> None:
    report = tradeoff_file("ball", tmp_path / "out", width=8, height=6, repeats=1)
    found = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert found == [f"tradeoff.{ending}" for ending in ("csv", "json", "pdf", "png")]
    assert report["width"] == 8
    assert sum(row["chosen"] for row in report["rows"]) == 3
    assert "seconds" in json.loads(json.dumps(report))


def test_a_place_that_cannot_be_written_is_found_out_first(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match="a file"):
        tradeoff_file("ball", tmp_path / "file")
    with pytest.raises(InputFileError, match="does not exist"):
        tradeoff_file("ball", tmp_path / "none" / "out")
