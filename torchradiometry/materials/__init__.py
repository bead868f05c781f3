"""HOW SURFACES REFLECT: BRDFs in 1/sr, without the cosine."""

from torchradiometry.materials.base import AbstractMaterial
from torchradiometry.materials.lambertian import Lambertian, lambertian_brdf

__all__ = ["AbstractMaterial", "Lambertian", "lambertian_brdf"]
