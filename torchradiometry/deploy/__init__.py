"""WITHOUT TORCH: run exported models on photographs through onnxruntime and NumPy."""

from torchradiometry.deploy.exposures import (
    Merged,
    calibrate_files,
    debevec_response,
    linear_response,
    merge_exposures,
    srgb_response,
)
from torchradiometry.deploy.heights import integrate_normals
from torchradiometry.deploy.light import fit_light, shine
from torchradiometry.deploy.normals import (
    angular_error,
    estimate_normals,
    find_model,
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
from torchradiometry.deploy.surfaces import (
    SurfaceEstimate,
    estimate_surface,
    normals_file,
    write_surface,
)
from torchradiometry.deploy.woodham import least_squares_normals, solve_least_squares

__all__ = [
    "Merged",
    "Model",
    "ModelInput",
    "Photograph",
    "Photographs",
    "SurfaceEstimate",
    "angular_error",
    "calibrate_files",
    "debevec_response",
    "estimate_normals",
    "estimate_surface",
    "find_model",
    "find_photograph_sets",
    "fit_light",
    "integrate_normals",
    "least_squares_normals",
    "linear_response",
    "merge_exposures",
    "normals_file",
    "open_model",
    "read_photograph",
    "read_photographs",
    "run_model",
    "shine",
    "solve_least_squares",
    "srgb_response",
    "write_normals",
    "write_surface",
]
