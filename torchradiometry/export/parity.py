"""Does onnxruntime compute what torch computes? On sizes the exporter has not seen.

    max_absolute = max |a - b|
    max_relative = max |a - b| / |b|   over values of at least 1/1000 of the largest |b|

a from onnxruntime, b from the module. Smaller values are left out of the relative figure:
theirs is rounding of a sum of larger ones.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchradiometry.deploy.runtime import Model, open_model, run_model
from torchradiometry.errors import FileFormatError
from torchradiometry.export.onnx_file import call_named
from torchradiometry.export.vocabulary import InputNote, random_inputs

__all__ = ["OnnxCheck", "check_onnx", "read_notes"]

#: largest max_relative that passes: about 100 roundings in float32, which a chain of some
#: twenty operations and a power of exponent 30 stay below; in float64 the accuracy promised
TOLERANCE = {torch.float32: 2.0**-17, torch.float64: 2.0**-40}  # 64 and 4096 last digits
#: axis sizes that are tried: no size of any example, not all even, one of them 1
SIZES = (
    {"batch": 3, "height": 7, "width": 5, "light": 4},
    {"batch": 1, "height": 1, "width": 9, "light": 1},
)
SMALL_SHARE = 1e-3


class OnnxCheck(NamedTuple):
    """Result of `check_onnx`.

    Attributes:
        max_absolute: largest difference, in the unit of the output.
        max_relative: largest relative difference; see the module.
        shapes: for each run the shape of each input.
        passed: every relative difference is within `tolerance`, and all numbers are finite.
        tolerance: for the dtype of the outputs.
    """

    max_absolute: float
    max_relative: float
    shapes: tuple[dict[str, tuple[int, ...]], ...]
    passed: bool
    tolerance: float


def check_onnx(
    path: str | Path,
    module: nn.Module,
    *,
    inputs: Mapping[str, Tensor] | None = None,
    sizes: Mapping[str, int] | None = None,
    seed: int = 0,
) -> OnnxCheck:
    """Compare an exported file under onnxruntime with its module.

    Args:
        path: from `export_onnx`.
        module: the module it was exported from.
        inputs: tensors by input name; by default random ones of several sizes, physically
            sensible by the quantities in the file's metadata.
        sizes: axis name -> size for the random inputs, in place of the built-in ones.
        seed: of the random inputs.

    Returns:
        The differences. Nothing is raised when they are large: look at `passed`.

    Raises:
        InputFileError: no such file.
        FileFormatError: not an ONNX model, or one without the package's metadata.
        MissingDependencyError: onnxruntime is not installed.
    """
    model = open_model(path)
    if inputs is not None:
        trials = [dict(inputs)]
    else:
        notes = read_notes(model, path)
        dtypes = {i.name: getattr(torch, i.dtype.name) for i in model.inputs}
        chosen = [{**SIZES[0], **sizes}] if sizes else SIZES
        trials = [random_inputs(notes, size, dtypes, seed) for size in chosen]
    return _merged([_compare(model, module, trial) for trial in trials])


def read_notes(model: Model, path: str | Path) -> dict[str, InputNote]:
    """Axes, quantity and unit of each input, from the metadata of a file.

    Raises:
        FileFormatError: the metadata is missing or is not what `export_onnx` writes.
    """
    try:
        raw = json.loads(model.metadata["torchradiometry.inputs"])
        notes = {
            str(name): InputNote(
                tuple(str(axis) for axis in note["axes"]), str(note["quantity"]), str(note["unit"])
            )
            for name, note in raw.items()
        }
        if set(notes) != {item.name for item in model.inputs}:
            raise KeyError("inputs and metadata name different things")
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise FileFormatError(
            str(path), f"no usable torchradiometry metadata ({error!r})", "use export_onnx"
        ) from error
    return notes


def _compare(model: Model, module: nn.Module, tensors: dict[str, Tensor]) -> OnnxCheck:
    # cleared first: the module may have been left in another mode than it was exported in
    was_training = module.training
    module.eval()
    try:
        with torch.no_grad():
            expected = call_named(module, tensors)
    finally:
        module.train(was_training)
    references = [expected] if isinstance(expected, Tensor) else list(expected)
    arrays = {name: tensor.numpy(force=True) for name, tensor in tensors.items()}
    found = [torch.as_tensor(array) for array in run_model(model, arrays)]
    shapes = ({name: tuple(tensor.shape) for name, tensor in tensors.items()},)
    tolerance = max(TOLERANCE.get(b.dtype, 0.0) for b in references)
    if [a.shape for a in found] != [b.shape for b in references]:
        return OnnxCheck(torch.inf, torch.inf, shapes, False, tolerance)
    pairs = [(a.double(), b.cpu().double()) for a, b in zip(found, references, strict=True)]
    finite = all(bool(torch.isfinite(a).all() and torch.isfinite(b).all()) for a, b in pairs)
    absolute = max(float((a - b).abs().max()) if a.numel() else 0.0 for a, b in pairs)
    relative = max(_relative(a, b) for a, b in pairs)
    return OnnxCheck(absolute, relative, shapes, finite and relative <= tolerance, tolerance)


def _relative(a: Tensor, b: Tensor) -> float:
    """Largest |a - b| / |b| over values that are not small, 0 where all values are 0."""
    size = b.abs()
    if not a.numel():
        return 0.0
    floor = (size.max() * SMALL_SHARE).clamp(min=torch.finfo(torch.float64).tiny)
    return float(((a - b).abs() / torch.maximum(size, floor)).max())


def _merged(checks: list[OnnxCheck]) -> OnnxCheck:
    return OnnxCheck(
        max(check.max_absolute for check in checks),
        max(check.max_relative for check in checks),
        tuple(shape for check in checks for shape in check.shapes),
        all(check.passed for check in checks),
        max(check.tolerance for check in checks),
    )
