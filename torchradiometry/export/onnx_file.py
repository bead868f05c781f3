"""A layer as an ONNX file, and the proof that onnxruntime computes the same.

    file = export_onnx(module, example, path)
    check = check_onnx(file, module)          # on sizes other than the example's

The file holds everything: weights inside (no external data), standard operators of opset 20
only (no custom domain), and in `metadata_props` what a reader needs to feed it: the package
version, and for each input and output its axes, quantity and unit.

| key in `metadata_props` | holds |
|---|---|
| `torchradiometry.version` | the package version |
| `torchradiometry.inputs` | JSON: name -> `{"axes": [...], "quantity": ..., "unit": ...}` |
| `torchradiometry.outputs` | JSON: name -> `{"unit": ...}` |

An axis is a name (dynamic) or a number as text (fixed).

References: ONNX, *Open Neural Network Exchange Intermediate Representation Specification*;
PyTorch, `torch.onnx.export(dynamo=True)`.
"""

from __future__ import annotations

import inspect
import json
import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from torchradiometry import __version__
from torchradiometry.errors import (
    DTypeError,
    FileFormatError,
    MissingDependencyError,
    ShapeError,
)
from torchradiometry.export.vocabulary import InputNote, note_for
from torchradiometry.places import atomic_path

__all__ = ["OPSET", "export_onnx"]

#: the ONNX operator set of every file; onnxruntime reads it since 1.17
OPSET = 20
#: loggers of the exporter that report what concerns nobody here (torchvision is absent)
NOISY = ("torch.onnx._internal.exporter", "torch.onnx", "onnxscript", "onnx_ir")


def export_onnx(
    module: nn.Module,
    example: Mapping[str, Tensor] | Sequence[Tensor],
    path: str | Path,
    *,
    axes: Mapping[str, Sequence[str]] | None = None,
    units: Mapping[str, str] | None = None,
    outputs: Mapping[str, str] | None = None,
) -> Path:
    """Write a layer as one self-contained ONNX file with named, dynamic axes.

    Args:
        module: any `nn.Module` of the package (or a network); exported in `eval` mode and
            given back in the mode it had.
        example: tensors by argument name, or in the order of the arguments of `forward`. A
            dynamic axis needs a size of at least 2 in them.
        path: where to write; nothing is left there when the export fails.
        axes: for each input the names of its axes; a number as text is a fixed axis. By
            default known by the input's name (`normal` is `batch 3 height width`); 4-d inputs
            with another name are `batch C height width`.
        units: units by input name, where the name is not one of the package's.
        outputs: name and unit of each output; by default `{"radiance": "W/m2/sr"}`.

    Returns:
        The path.

    Raises:
        DTypeError: `example` holds something that is not a tensor.
        ShapeError: axes that do not match the example, or a dynamic axis of size 1.
        InputFileError: the folder of `path` does not exist.
        MissingDependencyError: onnx or onnxscript is not installed.
        FileFormatError: the graph needs operators outside the ONNX standard.
    """
    _require_exporter()
    tensors = _named(module, example)
    notes = {
        name: note_for(name, tensor, (axes or {}).get(name), (units or {}).get(name))
        for name, tensor in tensors.items()
    }
    outputs = outputs or {"radiance": "W/m2/sr"}
    with atomic_path(path) as temporary:
        program = _exported(module, tensors, notes, list(outputs))
        _refuse_custom_operators(program.model, path)
        _annotate(program.model, notes, outputs)
        program.save(str(temporary), external_data=False)
    return Path(path)


def _named(
    module: nn.Module, example: Mapping[str, Tensor] | Sequence[Tensor]
) -> dict[str, Tensor]:
    """The example by argument name, in the order of the call."""
    if not isinstance(example, Mapping):
        names = input_names(module)
        if len(example) > len(names):
            raise ShapeError("example", f"{len(example)} tensors", f"pass at most {names}")
        example = dict(zip(names, example, strict=False))
    for name, tensor in example.items():
        if not isinstance(tensor, Tensor):
            raise DTypeError(f"example {name}", f"a {type(tensor).__name__}", "pass a tensor")
    # copies, because the exporter takes one tensor passed twice for one input
    return {name: tensor.detach().clone() for name, tensor in example.items()}


def input_names(module: nn.Module) -> tuple[str, ...]:
    """Argument names of a module: its `input_names`, or those of its `forward`."""
    declared = getattr(module, "input_names", None)
    return tuple(declared) if declared else tuple(inspect.signature(module.forward).parameters)


def call_named(module: nn.Module, tensors: Mapping[str, Tensor]) -> Any:
    """module(...) with tensors by name."""
    if getattr(module, "input_names", None):
        return module(*(tensors[name] for name in input_names(module)))
    return module(**tensors)


def _exported(
    module: nn.Module,
    tensors: Mapping[str, Tensor],
    notes: Mapping[str, InputNote],
    outputs: list[str],
) -> Any:
    dynamic = {name: note.dynamic() for name, note in notes.items()}
    # a module with `input_names` takes its tensors in order, through one `*tensors`
    in_order = bool(getattr(module, "input_names", None))
    names = list(input_names(module)) if in_order else list(tensors)
    positional = tuple(tensors[name] for name in names) if in_order else ()
    with _quiet(), _evaluating(module), torch.no_grad():
        return torch.onnx.export(
            module,
            positional,
            kwargs=None if in_order else dict(tensors),
            dynamo=True,
            dynamic_shapes={"tensors": tuple(dynamic[n] for n in names)} if in_order else dynamic,
            input_names=names,
            output_names=outputs,
            opset_version=OPSET,
            external_data=False,
            verbose=False,
            custom_translation_table={torch.ops.aten.scalar_tensor.default: _exact_number},
        )


def _exact_number(
    s: Any, dtype: int = 1, layout: str = "", device: str = "", pin_memory: bool = False
) -> Any:
    """A Python number of the graph as a constant of the (ONNX) dtype that it meets.

    The exporter's own rule makes it a float32 first and then casts, so that pi in a float64
    graph would be wrong from the eighth digit on.
    """
    operators = import_module("onnxscript").opset20
    if not isinstance(s, (bool, int, float)):
        return operators.Cast(s, to=dtype)
    value = import_module("onnx").helper.make_tensor("number", dtype, [], [s])
    return operators.Constant(value=value)


def _refuse_custom_operators(model: Any, path: str | Path) -> None:
    domains = {node.domain for node in model.graph.all_nodes()} - {"", "ai.onnx"}
    if domains:
        raise FileFormatError(
            str(path), f"operators of {sorted(domains)}", "export layers of standard operators only"
        )


def _annotate(model: Any, notes: Mapping[str, InputNote], outputs: Mapping[str, str]) -> None:
    """Metadata for the reader; the exporter's own (source paths, stack traces) is dropped."""
    for node in model.graph.all_nodes():
        node.metadata_props.clear()
        node.doc_string = None
        for value in node.outputs:
            value.metadata_props.clear()
    inputs = {name: note._asdict() for name, note in notes.items()}
    model.metadata_props.clear()
    model.graph.metadata_props.clear()
    model.metadata_props["torchradiometry.version"] = __version__
    model.metadata_props["torchradiometry.inputs"] = json.dumps(inputs)
    model.metadata_props["torchradiometry.outputs"] = json.dumps(
        {name: {"unit": unit} for name, unit in outputs.items()}
    )
    model.producer_name, model.producer_version = "torchradiometry", __version__
    for value in model.graph.inputs:
        note = notes[value.name]
        value.metadata_props.clear()
        value.doc_string = f"{note.quantity} [{note.unit}], axes {' x '.join(note.axes)}"
    for value in model.graph.outputs:
        value.doc_string = f"[{outputs[value.name]}]"


@contextmanager
def _evaluating(module: nn.Module) -> Iterator[None]:
    """`eval` mode inside, every sub-module's own mode afterwards."""
    modes = {part: part.training for part in module.modules()}
    module.eval()
    try:
        yield
    finally:
        for part, training in modes.items():
            part.training = training


@contextmanager
def _quiet() -> Iterator[None]:
    """No warning and no log line of the exporter; errors still come through."""
    loggers = [logging.getLogger(name) for name in NOISY]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.ERROR)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _require_exporter() -> None:
    for library in ("onnx", "onnxscript"):
        try:
            import_module(library)
        except ImportError as error:
            raise MissingDependencyError(
                library, "no installation", "run: pip install 'torchradiometry[onnx]'"
            ) from error
