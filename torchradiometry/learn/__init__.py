"""SHAPE FROM SHADING: random shapes shaded by the layers, networks, losses, training."""

from torchradiometry.learn.data import PhotometricSamples, ShadingSamples, SurfaceOptions, make_bank
from torchradiometry.learn.evaluation import Evaluation, evaluate, evaluate_folder
from torchradiometry.learn.geometry_bank import SurfaceBank, make_surfaces, random_lights
from torchradiometry.learn.images import Materials, Observations, observe, random_materials
from torchradiometry.learn.losses import angle_degrees, chord_loss
from torchradiometry.learn.networks import (
    PhotometricNetwork,
    ShadingNetwork,
    least_squares,
    observation_map,
)
from torchradiometry.learn.shapes import Shapes, height_to_normals, random_shapes
from torchradiometry.learn.single_images import SingleImages, photograph_shapes
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
    "Shapes",
    "SingleImages",
    "SurfaceBank",
    "SurfaceOptions",
    "Trained",
    "angle_degrees",
    "chord_loss",
    "evaluate",
    "evaluate_folder",
    "height_to_normals",
    "least_squares",
    "load_checkpoint",
    "make_bank",
    "make_surfaces",
    "observation_map",
    "observe",
    "photograph_shapes",
    "random_lights",
    "random_materials",
    "random_shapes",
    "train",
]
