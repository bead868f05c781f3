"""The catalogue: every entry is complete and runs; some go the whole way."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from torchradiometry.errors import FileFormatError, OutOfRangeError
from torchradiometry.export import check_onnx, export_catalogue, export_file, export_layer
from torchradiometry.export.catalogue import LAYERS
from torchradiometry.export.onnx_file import call_named
from torchradiometry.export.vocabulary import random_inputs

SIZES = {"batch": 3, "height": 4, "width": 5, "light": 3}


@pytest.mark.parametrize("name", LAYERS)
def test_every_layer_runs_on_sensible_inputs_of_any_size(name: str) -> None:
    layer = LAYERS[name]()
    dtypes = {key: tensor.dtype for key, tensor in layer.example.items()}
    inputs = random_inputs(layer.notes, SIZES, dtypes)
    out = call_named(layer.module, inputs)
    assert out.shape == (3, 3, 4, 5)
    assert torch.isfinite(out).all()
    assert (out != 0).any()  # a check on all-black pictures would check nothing


def test_the_list_names_inputs_axes_and_units_and_is_json() -> None:
    entries = {entry["name"]: entry for entry in json.loads(json.dumps(export_catalogue()))}
    assert {"lambertian", "phong", "ambient", "normals-from-depth"} <= set(entries)
    assert entries["phong-point"]["inputs"]["source_intensity"] == {
        "axes": ["light", "3"],
        "unit": "W/sr",
    }
    assert entries["lambertian"]["outputs"] == {"radiance": "W/m2/sr"}
    assert entries["lambertian"]["inputs"] == entries["lambertian-directional"]["inputs"]


@pytest.mark.parametrize("name", ["lambertian-visibility", "ambient", "normals-from-depth"])
def test_the_whole_way(name: str, tmp_path: Path) -> None:
    path = export_layer(name, tmp_path / "layer.onnx")
    check = check_onnx(path, LAYERS[name]().module)
    assert check.passed, check


def test_an_unknown_name_is_named_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OutOfRangeError, match="lambertian"):
        export_layer("lambert", tmp_path / "x.onnx")
    assert not list(tmp_path.iterdir())


def test_a_file_of_another_ending_is_refused_and_nothing_is_made(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"'\.png'"):
        export_file("lambertian", tmp_path / "layer.png")
    assert list(tmp_path.iterdir()) == []
