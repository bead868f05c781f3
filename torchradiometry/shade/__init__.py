"""WHAT THE EYE GETS: layers from surface, material and light to radiance."""

from torchradiometry.shade.ambient import AmbientShading, ambient_shading
from torchradiometry.shade.ambient_occlusion import AmbientOcclusion, ambient_occlusion
from torchradiometry.shade.cast_shadow import CastShadow, cast_shadows
from torchradiometry.shade.depth_map import DepthSettings, ShadeDepth
from torchradiometry.shade.interreflection import InterreflectionShading, reflected_irradiance
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
    "AmbientOcclusion",
    "AmbientShading",
    "CastShadow",
    "DepthSettings",
    "InterreflectionShading",
    "LambertianShading",
    "PhongShading",
    "PointShading",
    "RadiosityShading",
    "ShadeDepth",
    "ambient_occlusion",
    "ambient_shading",
    "cast_shadows",
    "hierarchical_operator",
    "image_irradiance",
    "lambertian_shading",
    "phong_shading",
    "reflected_irradiance",
    "shade_points",
    "to_image",
    "to_points",
    "validate_layer_inputs",
    "view_directions",
]
