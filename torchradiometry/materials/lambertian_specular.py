"""Lambertian surface with a highlight: paint, plastic, varnish.

    f_r = rho / pi + lobe(wi, wo)

and the energy check rho + (reflectance of the lobe at normal incidence) <= 1, which for the
normalised lobes is rho + k_s <= 1 (Lafortune and Willems 1994, section 3). Normal incidence is
where `NormalizedPhong`, `BlinnPhong` and `Phong` reflect most, so the check holds at every
angle; for `OriginalPhong`, which gains energy at grazing incidence, it does not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import OutOfRangeError
from torchradiometry.materials.base import AbstractMaterial
from torchradiometry.materials.lambertian import lambertian_brdf
from torchradiometry.materials.lobes import AbstractLobe
from torchradiometry.materials.phong import NormalizedPhong

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["LambertianSpecular", "lambertian_specular_reflectance"]

#: rounding of albedo and specular that still counts as albedo + specular = 1
ROUNDING = 8 * torch.finfo(torch.float32).eps


def lambertian_specular_reflectance(
    albedo: Float[Tensor, "*batch channel"], lobe: AbstractLobe
) -> Float[Tensor, "*batch channel"]:
    """Reflectance (DHR) at normal incidence of a diffuse base with a lobe: <= 1 is physical."""
    return albedo + lobe.normal_reflectance()


@final
class LambertianSpecular(AbstractMaterial):
    """A diffuse base with one specular lobe.

    Args:
        albedo: rho, `*batch channel`, 0..1.
        specular: k_s, `*batch channel`, as the lobe takes it.
        shininess: n, `*batch 1`, >= 0.
        lobe: the class of the lobe: `NormalizedPhong` (the default), `BlinnPhong`, `Phong` or
            `OriginalPhong`.
        learnable: keep all three as `nn.Parameter`s; learning does not keep the energy check.

    Raises:
        OutOfRangeError: albedo and lobe together reflect more than 1 at normal incidence.
            (`SumMaterial` adds without a check.)
    """

    albedo: Tensor

    def __init__(
        self,
        albedo: object,
        specular: object,
        shininess: object,
        *,
        lobe: type[AbstractLobe] = NormalizedPhong,
        learnable: bool = False,
    ) -> None:
        super().__init__()
        self._hold("albedo", albedo, learnable, lowest=0, highest=1)
        self.lobe = lobe(specular, shininess, learnable=learnable)
        most = lambertian_specular_reflectance(self.albedo, self.lobe).max().item()
        if most > 1 + ROUNDING:
            raise OutOfRangeError(
                "albedo, specular",
                f"a reflectance of {most:g} at normal incidence",
                "lower either until albedo + the lobe's share (k_s; 2 pi k_s / (n+2) for the "
                "lobes that are not normalised) is at most 1",
            )

    def forward(
        self,
        incident_direction: Float[Tensor, "*batch 3"],
        outgoing_direction: Float[Tensor, "*batch 3"],
        normal: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch channel"]:
        diffuse = lambertian_brdf(self.albedo, incident_direction, outgoing_direction, normal)
        return diffuse + self.lobe(incident_direction, outgoing_direction, normal)

    def diffuse_albedo(self) -> Float[Tensor, "*batch channel"]:
        return self.albedo

    def normal_reflectance(self) -> Float[Tensor, "*batch channel"]:
        """Reflectance (DHR) at normal incidence."""
        return lambertian_specular_reflectance(self.albedo, self.lobe)

    def extra_repr(self) -> str:
        return "albedo [1]"
