"""SHAPE FROM SHADING: random shapes shaded by the layers, networks, losses, training."""

from torchradiometry.learn.benchmarks import (
    SingleEvaluation,
    drawn_lights,
    evaluate_draws,
    evaluate_single,
    evaluate_singles,
    find_objects,
    geometric_mean,
    photometric_benchmark,
    surface_normals,
)
from torchradiometry.learn.evaluation import Evaluation, evaluate, evaluate_folder
from torchradiometry.learn.lambert_fit import least_squares, robust_normals
from torchradiometry.learn.light import estimate_light
from torchradiometry.learn.losses import (
    albedo_loss,
    angle_degrees,
    chord_loss,
    integrability_loss,
    rendering_loss,
)
from torchradiometry.learn.networks import (
    PhotometricNetwork,
    ShadingNetwork,
    observation_map,
    relative_to_mean,
)
from torchradiometry.learn.samples.data import (
    PhotometricSamples,
    ShadingSamples,
    SurfaceOptions,
    make_bank,
    make_shapes,
)
from torchradiometry.learn.samples.geometry_bank import SurfaceBank, make_surfaces, random_lights
from torchradiometry.learn.samples.images import Materials, Observations, observe, random_materials
from torchradiometry.learn.samples.lit_shapes import ShapeBank, light_shapes
from torchradiometry.learn.samples.mesh_shapes import mesh_shapes
from torchradiometry.learn.samples.shapes import Shapes, height_to_normals, random_shapes
from torchradiometry.learn.samples.single_images import SingleImages, photograph, photograph_shapes
from torchradiometry.learn.samples.stored_samples import StoredSamples, write_samples
from torchradiometry.learn.training.checkpoints import load_checkpoint
from torchradiometry.learn.training.loop import Machine, Trained, train
from torchradiometry.learn.training.processes import Processes, joined_processes
from torchradiometry.learn.training.settings import PhotometricTraining, ShadingTraining
from torchradiometry.learn.training.settings_file import read_training, write_training

__all__ = [
    "Evaluation",
    "Machine",
    "Materials",
    "Observations",
    "PhotometricNetwork",
    "PhotometricSamples",
    "PhotometricTraining",
    "Processes",
    "ShadingNetwork",
    "ShadingSamples",
    "ShadingTraining",
    "ShapeBank",
    "Shapes",
    "SingleEvaluation",
    "SingleImages",
    "StoredSamples",
    "SurfaceBank",
    "SurfaceOptions",
    "Trained",
    "albedo_loss",
    "angle_degrees",
    "chord_loss",
    "drawn_lights",
    "estimate_light",
    "evaluate",
    "evaluate_draws",
    "evaluate_folder",
    "evaluate_single",
    "evaluate_singles",
    "find_objects",
    "geometric_mean",
    "height_to_normals",
    "integrability_loss",
    "joined_processes",
    "least_squares",
    "light_shapes",
    "load_checkpoint",
    "make_bank",
    "make_shapes",
    "make_surfaces",
    "mesh_shapes",
    "observation_map",
    "observe",
    "photograph",
    "photograph_shapes",
    "photometric_benchmark",
    "random_lights",
    "random_materials",
    "random_shapes",
    "read_training",
    "relative_to_mean",
    "rendering_loss",
    "robust_normals",
    "surface_normals",
    "train",
    "write_samples",
    "write_training",
]
