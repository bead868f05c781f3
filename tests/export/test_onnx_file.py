"""export_onnx and check_onnx: one small layer, its metadata, and everything that can go wrong."""

from __future__ import annotations

import json
import logging
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from tests.tolerances import assert_close
from torchradiometry import __version__
from torchradiometry.deploy import runtime
from torchradiometry.deploy.model_size import MAX_PARTS, graph_parts
from torchradiometry.deploy.runtime import open_model, run_model
from torchradiometry.errors import (
    DTypeError,
    FileFormatError,
    InputFileError,
    MissingDependencyError,
    OutOfRangeError,
    ResourceLimitError,
    ShapeError,
)
from torchradiometry.export import OnnxCheck, SourcesAsInputs, check_onnx, export_onnx, onnx_file
from torchradiometry.shade import AmbientShading, LambertianShading
from torchradiometry.sources import DirectionalSource, PointSource

NORMAL = torch.tensor([0.0, 0.0, 1.0]).reshape(1, 3, 1, 1).repeat(2, 1, 3, 4)
ALBEDO = torch.full((2, 3, 3, 4), 0.5)
SUNS = DirectionalSource([[0.0, 0.6, 0.8], [0.0, 0.0, 1.0]], [[1.0, 2.0, 3.0], [0.5, 0.5, 0.5]])


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SourcesAsInputs]:
    """A Lambertian layer with its lights as inputs; exported once."""
    module = SourcesAsInputs(LambertianShading(SUNS), ["normal", "albedo"])
    module.train()
    example = {"normal": NORMAL, "albedo": ALBEDO, **module.example()}
    path = export_onnx(module, example, tmp_path_factory.mktemp("onnx") / "lambertian.onnx")
    assert module.training
    return path, module


def test_parity_on_other_sizes(exported: tuple[Path, SourcesAsInputs]) -> None:
    check = check_onnx(*exported)
    assert isinstance(check, OnnxCheck)
    assert check.passed
    assert check.max_relative <= check.tolerance
    shapes = [shape["normal"] for shape in check.shapes]
    assert tuple(NORMAL.shape) not in shapes
    assert len({shape["source_direction"][0] for shape in check.shapes} - {2}) == 2


def test_sizes_may_be_chosen(exported: tuple[Path, SourcesAsInputs]) -> None:
    check = check_onnx(*exported, sizes={"light": 11, "width": 1})
    assert check.shapes[0]["source_irradiance"] == (11, 3)
    assert check.shapes[0]["albedo"][3] == 1
    assert check.passed


def test_parity_on_given_inputs(exported: tuple[Path, SourcesAsInputs]) -> None:
    path, module = exported
    inputs = {"normal": NORMAL[:1], "albedo": ALBEDO[:1], **module.example()}
    assert check_onnx(path, module, inputs=inputs).passed


def test_another_module_does_not_pass(exported: tuple[Path, SourcesAsInputs]) -> None:
    class Brighter(nn.Module):
        input_names = exported[1].input_names

        def forward(self, *tensors: torch.Tensor) -> torch.Tensor:
            return exported[1](*tensors) * 1.001

    check = check_onnx(exported[0], Brighter())
    assert not check.passed
    assert check.max_relative == pytest.approx(1e-3, rel=0.01)


def test_runs_without_the_module(exported: tuple[Path, SourcesAsInputs]) -> None:
    model = open_model(exported[0], threads=1)
    inputs = {
        "normal": NORMAL.numpy()[:1, :, :1, :2],
        "albedo": ALBEDO.numpy()[:1, :, :1, :2],
        "source_direction": np.array([[0, 0, 1]], np.float32),
        "source_irradiance": np.array([[np.pi, 2 * np.pi, 0]], np.float32),
    }
    (radiance,) = run_model(model, inputs)
    assert_close(torch.as_tensor(radiance[0, :, 0, 0]), [0.5, 1.0, 0.0])


def test_metadata_tells_how_to_feed_it(exported: tuple[Path, SourcesAsInputs]) -> None:
    model = open_model(exported[0])
    assert model.metadata["torchradiometry.version"] == __version__
    inputs = json.loads(model.metadata["torchradiometry.inputs"])
    assert inputs["normal"]["axes"] == ["batch", "3", "height", "width"]
    assert inputs["source_irradiance"] == {
        "axes": ["light", "3"],
        "quantity": "irradiance",
        "unit": "W/m2",
    }
    assert json.loads(model.metadata["torchradiometry.outputs"]) == {
        "radiance": {"unit": "W/m2/sr"}
    }
    axes = {item.name: item.axes for item in model.inputs}
    assert axes["albedo"] == ("batch", 3, "height", "width")


def test_the_file_tells_nothing_about_the_machine(exported: tuple[Path, SourcesAsInputs]) -> None:
    data = exported[0].read_bytes()
    for secret in (b".py", str(Path.cwd()).encode(), sys.prefix.encode()):
        assert secret not in data


def test_only_standard_operators(exported: tuple[Path, SourcesAsInputs]) -> None:
    onnx = pytest.importorskip("onnx")
    model = onnx.load(exported[0])
    onnx.checker.check_model(model, full_check=True)
    assert [(item.domain, item.version) for item in model.opset_import] == [("", onnx_file.OPSET)]
    assert not any(tensor.external_data for tensor in model.graph.initializer)


def test_nothing_is_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    export_onnx(AmbientShading([1.0]), (ALBEDO,), tmp_path / "a.onnx")
    assert capfd.readouterr() == ("", "")
    assert not [r for r in caplog.records if r.levelno >= logging.WARNING]
    assert [p.name for p in tmp_path.iterdir()] == ["a.onnx"]


def test_one_tensor_passed_twice_stays_two_inputs(tmp_path: Path) -> None:
    class Difference(nn.Module):
        def forward(self, normal: torch.Tensor, position: torch.Tensor) -> torch.Tensor:
            return normal - 2 * position

    path = export_onnx(Difference(), (NORMAL, NORMAL), tmp_path / "d.onnx")
    assert check_onnx(path, Difference()).passed


@pytest.mark.parametrize(
    ("example", "options", "error", "message"),
    [
        ((NORMAL, ALBEDO[:1, :, :, :1]), {}, ShapeError, "dynamic axis"),
        ((NORMAL, "grey"), {}, DTypeError, "pass a tensor"),
        ((NORMAL,) * 9, {}, ShapeError, "at most"),
        ((NORMAL, ALBEDO), {"axes": {"normal": ("batch", "3")}}, ShapeError, "every axis once"),
        (
            (NORMAL, ALBEDO),
            {"axes": {"normal": ("batch", "4", "height", "width")}},
            ShapeError,
            "fixed to 4",
        ),
    ],
)
def test_bad_examples_are_named_and_leave_nothing(
    tmp_path: Path, example: tuple, options: dict, error: type, message: str
) -> None:
    with pytest.raises(error, match=message):
        export_onnx(LambertianShading(SUNS), example, tmp_path / "x.onnx", **options)
    assert not list(tmp_path.iterdir())


def test_a_failing_export_leaves_nothing(tmp_path: Path) -> None:
    near = LambertianShading(PointSource([0.0, 0.0, 1.0], [1.0]))
    with pytest.raises(Exception, match="near source"):
        export_onnx(near, (NORMAL, ALBEDO), tmp_path / "x.onnx")
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputFileError, match="folder"):
        export_onnx(AmbientShading([1.0]), (ALBEDO,), tmp_path / "none" / "x.onnx")


def test_missing_exporter_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "onnxscript", None)
    with pytest.raises(MissingDependencyError, match=r"torchradiometry\[onnx\]"):
        export_onnx(AmbientShading([1.0]), (ALBEDO,), tmp_path / "x.onnx")


def test_missing_runtime_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, exported: tuple[Path, SourcesAsInputs]
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingDependencyError, match=r"torchradiometry\[onnx\]"):
        open_model(exported[0])


@pytest.mark.parametrize("kind", ["empty", "text", "truncated", "flipped", "zip"])
def test_hostile_files_are_named(
    kind: str, exported: tuple[Path, SourcesAsInputs], tmp_path: Path
) -> None:
    data = exported[0].read_bytes()
    content = {
        "empty": b"",
        "text": b"this is no model",
        "truncated": data[: len(data) // 2],
        "flipped": bytes(255 - byte for byte in data),
        "zip": b"PK\x03\x04" + data,
    }[kind]
    path = tmp_path / "bad.onnx"
    path.write_bytes(content)
    with pytest.raises(FileFormatError) as caught:
        check_onnx(path, exported[1])
    assert caught.value.where == str(path)


def test_missing_folder_and_huge_files_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        open_model(tmp_path / "none.onnx")
    with pytest.raises(InputFileError, match="a folder"):
        open_model(tmp_path)
    huge = tmp_path / "huge.onnx"
    with huge.open("wb") as file:
        file.truncate(2**31)
    with pytest.raises(ResourceLimitError):
        open_model(huge)


def test_weights_outside_the_file_are_refused(tmp_path: Path, monkeypatch) -> None:
    onnx = pytest.importorskip("onnx")
    weights = onnx.helper.make_tensor("w", onnx.TensorProto.FLOAT, [4], [1.0, 2.0, 3.0, 4.0])
    weights.raw_data = np.arange(4, dtype=np.float32).tobytes()
    weights.ClearField("float_data")
    info = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Add", ["x", "w"], ["y"])],
        "g",
        [info("x", onnx.TensorProto.FLOAT, [4])],
        [info("y", onnx.TensorProto.FLOAT, [4])],
        [weights],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 20)])
    model.ir_version = 10
    onnx.save(
        model, tmp_path / "m.onnx", save_as_external_data=True, location="w.bin", size_threshold=0
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileFormatError):
        open_model(tmp_path / "m.onnx")


def foreign_model(path: Path, metadata: dict[str, str]) -> Path:
    onnx = pytest.importorskip("onnx")
    info = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Abs", ["x"], ["y"])],
        "g",
        [info("x", onnx.TensorProto.FLOAT, [2])],
        [info("y", onnx.TensorProto.FLOAT, [2])],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 20)])
    model.ir_version = 10
    onnx.helper.set_model_props(model, metadata)
    onnx.save(model, path)
    return path


@pytest.mark.parametrize(
    "inputs", [None, "", "[]", "{", '{"x": 3}', '{"x": {"axes": 1}}', '{"z": {"axes": []}}']
)
def test_metadata_of_another_kind_is_named(tmp_path: Path, inputs: str | None) -> None:
    metadata = {} if inputs is None else {"torchradiometry.inputs": inputs}
    path = foreign_model(tmp_path / "f.onnx", metadata)
    with pytest.raises(FileFormatError, match="metadata"):
        check_onnx(path, nn.Identity())


def test_wrong_inputs_are_named(tmp_path: Path) -> None:
    model = open_model(foreign_model(tmp_path / "f.onnx", {}))
    good = np.zeros(2, np.float32)
    assert run_model(model, {"x": good})[0].shape == (2,)
    for inputs, error in (
        ({}, ShapeError),
        ({"x": good, "z": good}, ShapeError),
        ({"x": good.astype(np.float64)}, DTypeError),
        ({"x": good[None]}, ShapeError),
        ({"x": good[:1]}, ShapeError),
    ):
        with pytest.raises(error):
            run_model(model, inputs)


def test_sources_as_inputs_needs_sources_and_all_tensors() -> None:
    with pytest.raises(ShapeError, match="without sources"):
        SourcesAsInputs(LambertianShading(), ["normal", "albedo"])
    module = SourcesAsInputs(LambertianShading(SUNS), ["normal", "albedo"])
    with pytest.raises(ShapeError, match="in order"):
        module(NORMAL, ALBEDO)
    several = SourcesAsInputs(
        LambertianShading([SUNS, PointSource([0.0, 0, 1], [1.0])]), ["normal"]
    )
    assert several.input_names[1:] == (
        "source0_direction",
        "source0_irradiance",
        "source1_position",
        "source1_intensity",
    )


def test_sources_as_inputs_equals_the_layer_with_those_sources() -> None:
    module = SourcesAsInputs(LambertianShading(SUNS), ["normal", "albedo"])
    direction, power = torch.rand(5, 3), torch.rand(5, 3)
    expected = LambertianShading(DirectionalSource(direction, power))(NORMAL, ALBEDO)
    assert_close(module(NORMAL, ALBEDO, direction, power), expected)


def asking(path: Path, nodes: list, held: list = (), sparse: list = ()) -> Path:
    """A model of a few bytes whose one input `x` and output `y` are one number."""
    onnx = pytest.importorskip("onnx")
    one = onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [1])
    out = onnx.helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, [1])
    graph = onnx.helper.make_graph(nodes, "g", [one], [out], list(held))
    graph.sparse_initializer.extend(sparse)
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 20)])
    model.ir_version = 10
    onnx.save(model, path)
    return path


def test_a_model_that_asks_for_too_much_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """32 GiB of zeros, a loop without end, and more nodes than can be opened in the time."""
    onnx = pytest.importorskip("onnx")
    node, info = onnx.helper.make_node, onnx.helper.make_tensor_value_info
    numbers, truth = onnx.TensorProto.FLOAT, onnx.TensorProto.BOOL
    x = {"x": np.ones(1, np.float32)}
    zeros = [
        node("ConstantOfShape", ["n"], ["z"]),
        node("ReduceSum", ["z"], ["s"], keepdims=0),
        node("Add", ["x", "s"], ["y"]),
    ]
    size = onnx.helper.make_tensor("n", onnx.TensorProto.INT64, [1], [2**33])
    large = open_model(asking(tmp_path / "large.onnx", zeros, [size]))
    with pytest.raises(ResourceLimitError, match="tensors of more than"):
        run_model(large, x)
    again = onnx.helper.make_graph(
        [node("Identity", ["c"], ["d"]), node("Neg", ["v"], ["w"])],
        "b",
        [info("k", onnx.TensorProto.INT64, []), info("c", truth, []), info("v", numbers, [1])],
        [info("d", truth, []), info("w", numbers, [1])],
    )
    yes = onnx.helper.make_tensor("t", truth, [], [True])
    loop = [node("Loop", ["", "t", "x"], ["y"], body=again)]
    endless = open_model(asking(tmp_path / "endless.onnx", loop, [yes]))
    with pytest.raises(ResourceLimitError, match="no answer after"):
        run_model(endless, x, seconds=0.1)
    with pytest.raises(OutOfRangeError, match="seconds"):
        run_model(endless, x, seconds=0.0)
    names = ["x", *(f"a{k}" for k in range(9_999)), "y"]
    chain = [node("Neg", [a], [b]) for a, b in pairwise(names)]
    long = asking(tmp_path / "long.onnx", chain)
    monkeypatch.setattr(runtime, "LOAD_SECONDS", 0.01)
    with pytest.raises(ResourceLimitError, match="no answer after"):
        open_model(long)


def test_a_graph_that_would_grow_is_refused_before_it_is_built(tmp_path: Path) -> None:
    """Too many nodes, functions (each level may multiply the next) and sparse tensors."""
    onnx = pytest.importorskip("onnx")
    node = onnx.helper.make_node("Neg", ["x"], ["y"])
    path = asking(tmp_path / "m.onnx", [node])
    model = onnx.load(path)
    assert graph_parts(path.read_bytes()) < 20
    data = path.read_bytes()
    with path.open("wb") as file:  # messages of one field are joined: each has one node more
        field = b"\x3a\x0b\x0a\x09\x0a\x01x\x12\x01y\x22\x01N"
        file.write(data + field * (MAX_PARTS // 4))
    with pytest.raises(ResourceLimitError, match="parts"):
        open_model(path)
    model.functions.append(
        onnx.helper.make_function("own", "F", ["a"], ["b"], [node], model.opset_import)
    )
    onnx.save(model, path)
    with pytest.raises(FileFormatError, match="functions"):
        open_model(path)
    few = onnx.helper.make_tensor("w", onnx.TensorProto.FLOAT, [1], [1.0])
    where = onnx.helper.make_tensor("i", onnx.TensorProto.INT64, [1], [0])
    sparse = onnx.helper.make_sparse_tensor(few, where, [2**20, 2**20])
    with pytest.raises(FileFormatError, match="sparse"):
        open_model(asking(path, [node], sparse=[sparse]))
    constant = onnx.helper.make_node("Constant", [], ["y"], sparse_value=sparse)
    with pytest.raises(FileFormatError, match="sparse"):
        open_model(asking(path, [constant]))
