"""Lambertian surface: equally bright from everywhere.

    f_r = rho / pi

rho is the albedo, the share of the irradiance that is reflected.

References: J. H. Lambert, *Photometria* (1760); D. Forsyth and J. Ponce, *Computer Vision: A
Modern Approach*, 2nd ed. (2011), 2.1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.materials.base import AbstractMaterial, check_directions
from torchradiometry.numerics import dot

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Lambertian", "lambertian_brdf"]


def lambertian_brdf(
    albedo: Float[Tensor, "*batch channel"],
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch channel"]:
    """BRDF rho/pi above the surface, 0 below it.

    Args:
        albedo: diffuse reflectance, 0..1.
        incident_direction: unit, to the source.
        outgoing_direction: unit, to the eye.
        normal: unit.

    Returns:
        f_r in 1/sr.

    Differentiable in: albedo.
    Export: compile yes, ONNX yes.

    >>> up = torch.tensor([0.0, 0.0, 1.0])
    >>> lambertian_brdf(torch.tensor([math.pi / 4]), up, up, up)
    tensor([0.2500])
    """
    check_directions(incident_direction, outgoing_direction, normal)
    above = (dot(incident_direction, normal) > 0) & (dot(outgoing_direction, normal) > 0)
    return torch.where(above.unsqueeze(-1), albedo / math.pi, 0)


@final
class Lambertian(AbstractMaterial):
    """A diffuse surface.

    Args:
        albedo: `*batch channel`, 0..1.
        learnable: keep it as an `nn.Parameter`.
    """

    albedo: Tensor

    def __init__(self, albedo: object, *, learnable: bool = False) -> None:
        super().__init__()
        self._hold("albedo", albedo, learnable, lowest=0, highest=1)

    def forward(
        self,
        incident_direction: Float[Tensor, "*batch 3"],
        outgoing_direction: Float[Tensor, "*batch 3"],
        normal: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch channel"]:
        return lambertian_brdf(self.albedo, incident_direction, outgoing_direction, normal)

    def diffuse_albedo(self) -> Float[Tensor, "*batch channel"]:
        return self.albedo

    def extra_repr(self) -> str:
        return "albedo [1]"
