"""OUT OF TORCH: layers as ONNX files, and the proof that they compute the same."""

from torchradiometry.export.catalogue import (
    ExportLayer,
    export_catalogue,
    export_file,
    export_layer,
)
from torchradiometry.export.onnx_file import OPSET, export_onnx
from torchradiometry.export.parity import OnnxCheck, check_onnx
from torchradiometry.export.sources_as_inputs import SourcesAsInputs

__all__ = [
    "OPSET",
    "ExportLayer",
    "OnnxCheck",
    "SourcesAsInputs",
    "check_onnx",
    "export_catalogue",
    "export_file",
    "export_layer",
    "export_onnx",
]
