"""WHAT THE EYE GETS: layers from surface, material and light to radiance."""

from torchradiometry.shade.ambient import AmbientShading, ambient_shading
from torchradiometry.shade.lambertian import (
    LambertianShading,
    image_irradiance,
    lambertian_shading,
)
from torchradiometry.shade.large_scenes import hierarchical_operator
from torchradiometry.shade.layout import to_image, to_points, validate_layer_inputs
from torchradiometry.shade.phong import PhongShading, phong_shading, view_directions
from torchradiometry.shade.points import PointShading, shade_points
from torchradiometry.shade.radiosity import RadiosityShading

__all__ = [
    "AmbientShading",
    "LambertianShading",
    "PhongShading",
    "PointShading",
    "RadiosityShading",
    "ambient_shading",
    "hierarchical_operator",
    "image_irradiance",
    "lambertian_shading",
    "phong_shading",
    "shade_points",
    "to_image",
    "to_points",
    "validate_layer_inputs",
    "view_directions",
]
