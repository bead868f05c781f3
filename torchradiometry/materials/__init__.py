"""HOW SURFACES REFLECT: BRDFs in 1/sr, without the cosine."""

from torchradiometry.materials.base import AbstractMaterial
from torchradiometry.materials.blinn_phong import BlinnPhong, blinn_phong_brdf
from torchradiometry.materials.checks import (
    directional_hemispherical_reflectance,
    energy_excess,
    mirror_quadrature,
    reciprocity_error,
)
from torchradiometry.materials.lambertian import Lambertian, lambertian_brdf
from torchradiometry.materials.lambertian_specular import (
    LambertianSpecular,
    lambertian_specular_reflectance,
)
from torchradiometry.materials.microfacet import Microfacet, microfacet_brdf
from torchradiometry.materials.mirror import mirror_direction
from torchradiometry.materials.oren_nayar import OrenNayar, oren_nayar_brdf
from torchradiometry.materials.phong import (
    NormalizedPhong,
    OriginalPhong,
    Phong,
    mean_lobe_reflectance,
    normalized_phong_brdf,
    original_phong_brdf,
    phong_brdf,
)
from torchradiometry.materials.sum import SumMaterial

__all__ = [
    "AbstractMaterial",
    "BlinnPhong",
    "Lambertian",
    "LambertianSpecular",
    "Microfacet",
    "NormalizedPhong",
    "OrenNayar",
    "OriginalPhong",
    "Phong",
    "SumMaterial",
    "blinn_phong_brdf",
    "directional_hemispherical_reflectance",
    "energy_excess",
    "lambertian_brdf",
    "lambertian_specular_reflectance",
    "mean_lobe_reflectance",
    "microfacet_brdf",
    "mirror_direction",
    "mirror_quadrature",
    "normalized_phong_brdf",
    "oren_nayar_brdf",
    "original_phong_brdf",
    "phong_brdf",
    "reciprocity_error",
]
