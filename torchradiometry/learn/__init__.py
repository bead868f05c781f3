"""SHAPE FROM SHADING: random shapes shaded by the layers, networks, losses, training."""

from torchradiometry.learn.data import (
    PhotometricSamples,
    ShadingSamples,
    SurfaceOptions,
    make_bank,
    make_shapes,
)
from torchradiometry.learn.evaluation import Evaluation, evaluate, evaluate_folder
from torchradiometry.learn.geometry_bank import SurfaceBank, make_surfaces, random_lights
from torchradiometry.learn.images import Materials, Observations, observe, random_materials
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
    least_squares,
    observation_map,
    relative_to_mean,
    robust_normals,
)
from torchradiometry.learn.shapes import Shapes, height_to_normals, random_shapes
from torchradiometry.learn.single_images import (
    ShapeBank,
    SingleImages,
    photograph,
    photograph_shapes,
    shape_bank,
)
from torchradiometry.learn.training import (
    PhotometricTraining,
    ShadingTraining,
    Trained,
    load_checkpoint,
    train,
)

__all__ = [
    "Evaluation",
    "Materials",
    "Observations",
    "PhotometricNetwork",
    "PhotometricSamples",
    "PhotometricTraining",
    "ShadingNetwork",
    "ShadingSamples",
    "ShadingTraining",
    "ShapeBank",
    "Shapes",
    "SingleImages",
    "SurfaceBank",
    "SurfaceOptions",
    "Trained",
    "albedo_loss",
    "angle_degrees",
    "chord_loss",
    "evaluate",
    "evaluate_folder",
    "height_to_normals",
    "integrability_loss",
    "least_squares",
    "load_checkpoint",
    "make_bank",
    "make_shapes",
    "make_surfaces",
    "observation_map",
    "observe",
    "photograph",
    "photograph_shapes",
    "random_lights",
    "random_materials",
    "random_shapes",
    "relative_to_mean",
    "rendering_loss",
    "robust_normals",
    "shape_bank",
    "train",
]
