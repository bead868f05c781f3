"""Running an exported model through onnxruntime, without torch.

    outputs = session(inputs)

`open_model` checks the file before onnxruntime sees it (exists, bounded size and number of
nodes, no weights outside the file), bounds threads, memory and time and turns every failure into
a named error; so does `run_model`. A model from outside can loop or ask for tensors of any
size: it is stopped. Only this file imports onnxruntime.

References: ONNX, *Open Neural Network Exchange Intermediate Representation*, metadata_props.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchradiometry.deploy.model_size import MAX_PARTS, MAX_WEIGHTS, graph_parts
from torchradiometry.errors import (
    DTypeError,
    FileFormatError,
    MissingDependencyError,
    OutOfRangeError,
    ResourceLimitError,
    ShapeError,
    require_whole,
)
from torchradiometry.files import check_readable

#: bytes that the tensors of all open models may take together
MAX_MEMORY = 2**33
#: seconds that opening a model may take, and one run of it
LOAD_SECONDS, SECONDS = 60.0, 600.0

__all__ = ["Model", "ModelInput", "open_model", "run_model"]

#: onnxruntime's names of the element types our graphs use
ELEMENT_TYPES: dict[str, np.dtype[Any]] = {
    "tensor(float)": np.dtype(np.float32),
    "tensor(double)": np.dtype(np.float64),
    "tensor(int64)": np.dtype(np.int64),
    "tensor(int32)": np.dtype(np.int32),
    "tensor(bool)": np.dtype(np.bool_),
    "tensor(uint8)": np.dtype(np.uint8),
}


class ModelInput(NamedTuple):
    """One input of a model: its name, its axes (a number or a name each) and element type."""

    name: str
    axes: tuple[int | str | None, ...]
    dtype: np.dtype[Any]


class Model(NamedTuple):
    """An opened model: the onnxruntime session, what goes in and out, and its metadata."""

    session: Any
    inputs: tuple[ModelInput, ...]
    outputs: tuple[str, ...]
    metadata: dict[str, str]


def open_model(path: str | Path, *, threads: int | None = None) -> Model:
    """Open an ONNX file for `run_model`.

    Args:
        path: an `.onnx` file of at most 256 MiB that holds its own weights.
        threads: threads of one run; by default the processors this process may use, at most 8.

    Returns:
        The model with its inputs, outputs and metadata.

    Raises:
        InputFileError: no such file.
        DTypeError, OutOfRangeError: no path, or threads that are no whole number from 1.
        ResourceLimitError: a larger file, more than 2^18 nodes, names and tensors, or no answer
            within a minute.
        FileFormatError: not a complete ONNX model, one that needs what onnxruntime lacks, or one
            with functions of its own or sparse tensors, which may unpack to any size.
        MissingDependencyError: onnxruntime is not installed.
    """
    if threads is not None:
        require_whole("threads", threads, 1, 2**10)
    path = check_readable(path, "ONNX model", MAX_WEIGHTS)
    data = path.read_bytes()  # bytes, not the path: files beside the model are out of its reach
    _check_graph(path, data)
    runtime = _onnxruntime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = threads or _threads()
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # fatal only: a failure is raised below, not printed
    options.add_session_config_entry("session.use_env_allocators", "1")
    _bound_memory()
    try:
        with _stopped(lambda: options.set_load_cancellation_flag(True), LOAD_SECONDS, path):
            session = runtime.InferenceSession(
                data,
                options,
                providers=["CPUExecutionProvider"],
                disabled_optimizers=["ConstantFolding"],  # it would have no bound
            )
    except ResourceLimitError:
        raise
    except Exception as error:
        raise FileFormatError(
            str(path), f"no model onnxruntime can run ({_first_line(error)})", "pass an ONNX model"
        ) from error
    return Model(
        session,
        tuple(_described(node, path) for node in session.get_inputs()),
        tuple(node.name for node in session.get_outputs()),
        dict(session.get_modelmeta().custom_metadata_map),
    )


def run_model(
    model: Model,
    inputs: Mapping[str, NDArray[Any]],
    outputs: tuple[str, ...] | None = None,
    *,
    seconds: float = SECONDS,
) -> tuple[NDArray[Any], ...]:
    """The outputs of a model for named input arrays, in the order of `Model.outputs`.

    Args:
        model: from `open_model`.
        inputs: one array for each input, with the dtype and rank it declares.
        outputs: the names wanted; all by default.
        seconds: after which the run is stopped.

    Raises:
        ShapeError: an input is missing, unknown, or of another rank or size.
        DTypeError: an input of another element type.
        OutOfRangeError: seconds of 0 or less.
        ResourceLimitError: no answer in that time, or tensors of more than 8 GiB.
    """
    if not seconds > 0:
        raise OutOfRangeError("seconds", f"{seconds!r}", "pass a time above 0")
    declared = {item.name: item for item in model.inputs}
    if set(inputs) != set(declared):
        raise ShapeError("inputs", f"{sorted(inputs)}", f"pass exactly {sorted(declared)}")
    arrays = {name: np.asarray(array) for name, array in inputs.items()}
    for name, array in arrays.items():
        _check(declared[name], array)
    options = _onnxruntime().RunOptions()
    options.log_severity_level = 4
    try:
        with _stopped(lambda: setattr(options, "terminate", True), seconds, "the model"):
            return tuple(model.session.run(list(outputs or model.outputs), arrays, options))
    except ResourceLimitError:
        raise
    except Exception as error:
        shapes = {name: array.shape for name, array in arrays.items()}
        if "bfc_arena" in str(error):
            got = f"tensors of more than {MAX_MEMORY} bytes for inputs {shapes}"
            raise ResourceLimitError("the model", got, "pass smaller inputs") from error
        raise ShapeError(
            "inputs", f"{shapes} ({_first_line(error)})", "pass sizes that agree with each other"
        ) from error


@contextmanager
def _stopped(stop: Callable[[], None], seconds: float, where: object) -> Iterator[None]:
    """Calls `stop` when the block takes longer, and names what it then raises."""
    over = threading.Event()

    def end() -> None:
        over.set()
        stop()

    watch = threading.Timer(seconds, end)
    watch.daemon = True
    watch.start()
    try:
        yield
    except Exception as error:
        if over.is_set():
            got = f"no answer after {seconds:g} s"
            raise ResourceLimitError(str(where), got, "pass a smaller model or inputs") from error
        raise
    finally:
        watch.cancel()


def _check_graph(path: Path, data: bytes) -> None:
    try:
        parts = graph_parts(data)
    except ValueError as error:
        raise FileFormatError(
            str(path), f"no model that is run here ({error})", "pass an ONNX model"
        ) from error
    if parts > MAX_PARTS:
        got = f"a graph of more than {MAX_PARTS} parts"
        raise ResourceLimitError(str(path), got, "pass a smaller model")


def _check(item: ModelInput, array: NDArray[Any]) -> None:
    if array.dtype != item.dtype:
        raise DTypeError(item.name, f"{array.dtype}", f"pass {item.dtype}")
    wrong = array.ndim != len(item.axes) or any(
        isinstance(axis, int) and axis != size
        for axis, size in zip(item.axes, array.shape, strict=True)
    )
    if wrong:
        axes = " x ".join(str(axis) for axis in item.axes)
        raise ShapeError(item.name, f"an array of shape {array.shape}", f"pass {axes}")


def _described(node: Any, path: Path) -> ModelInput:
    if node.type not in ELEMENT_TYPES:
        raise FileFormatError(
            str(path), f"input {node.name} of type {node.type}", "use float or integer tensors"
        )
    return ModelInput(node.name, tuple(node.shape), ELEMENT_TYPES[node.type])


@cache
def _bound_memory() -> None:
    """One pool of tensors for all sessions of this process, of at most `MAX_MEMORY`."""
    runtime = _onnxruntime()
    place = runtime.OrtMemoryInfo(
        "Cpu", runtime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, runtime.OrtMemType.DEFAULT
    )
    runtime.create_and_register_allocator(place, runtime.OrtArenaCfg({"max_mem": MAX_MEMORY}))


def _threads() -> int:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return max(1, min(8, usable or 1))


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]


def _onnxruntime() -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingDependencyError(
            "onnxruntime", "no installation", "run: pip install 'torchradiometry[onnx]'"
        ) from error
    return onnxruntime
