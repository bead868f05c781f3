"""WITHOUT TORCH: run exported models on photographs through onnxruntime and NumPy."""

from torchradiometry.deploy.exposures import (
    Merged,
    calibrate_files,
    debevec_response,
    linear_response,
    merge_exposures,
    srgb_response,
)
from torchradiometry.deploy.normals import (
    angular_error,
    estimate_normals,
    find_model,
    normals_file,
    write_normals,
)
from torchradiometry.deploy.photographs import (
    Photograph,
    Photographs,
    find_photograph_sets,
    read_photograph,
    read_photographs,
)
from torchradiometry.deploy.runtime import Model, ModelInput, open_model, run_model
from torchradiometry.deploy.woodham import least_squares_normals, solve_least_squares

__all__ = [
    "Merged",
    "Model",
    "ModelInput",
    "Photograph",
    "Photographs",
    "angular_error",
    "calibrate_files",
    "debevec_response",
    "estimate_normals",
    "find_model",
    "find_photograph_sets",
    "least_squares_normals",
    "linear_response",
    "merge_exposures",
    "normals_file",
    "open_model",
    "read_photograph",
    "read_photographs",
    "run_model",
    "solve_least_squares",
    "srgb_response",
    "write_normals",
]
