"""Rough matt surface: clay, plaster, unglazed ceramics; the moon.

Small facets that are Lambertian each make the whole flatter than Lambert's law: brighter
towards its outline, and back towards the light. With r the roughness, mu the cosines of wi and
wo to the normal, and s = wi . wo - mu_i mu_o,

    f_r = rho/pi A (1 + r s/t)  +  rho_m/pi A r (c - G(mu_i)/pi) (c - G(mu_o)/pi) / (c - d)

    t = max(mu_i, mu_o) where s > 0, else 1         A = 1 / (1 + c r),  c = 1/2 - 2/(3 pi)
    G = sin(theta) (theta - sin(theta) mu) + 2/3 (tan(theta) (1 - sin(theta)^3) - sin(theta))
    rho_m = rho^2 a / (1 - rho (1 - a)),  a = A (1 + d r),  d = 2/3 - 28/(15 pi)

The first term is light that leaves after one facet, the second after several: A (1 + r G/pi) is
the share of a white surface's single bounces, a its mean over the hemisphere, and what is
missing is given back. A white surface (rho = 1) reflects everything at every angle.

References: M. Oren and S. K. Nayar, "Generalization of Lambert's Reflectance Model", SIGGRAPH
(1994); Y. Fujii, "A tiny improvement of Oren-Nayar reflectance model" (2012); J. Portsmouth, P.
Kutz and S. Hill, "EON: A Practical Energy-Preserving Rough Diffuse BRDF", JCGT 14 (2025).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.materials.base import AbstractMaterial, check_directions
from torchradiometry.numerics import angle_of, dot, safe_sqrt, wide

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["OrenNayar", "oren_nayar_brdf"]

#: c and d: means of s/t over all directions, seen from above and over the hemisphere
FROM_ABOVE = 1 / 2 - 2 / (3 * math.pi)
ON_AVERAGE = 2 / 3 - 28 / (15 * math.pi)


def oren_nayar_brdf(
    albedo: Float[Tensor, "*batch channel"],
    roughness: Float[Tensor, "*batch 1"],
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch channel"]:
    """BRDF of a rough diffuse surface, 0 below it; at roughness 0 it is rho/pi.

    Args:
        albedo: rho, of the facets, 0..1.
        roughness: r, 0..1; about the standard deviation of the facets' slopes, in radians.
        incident_direction: unit, to the source.
        outgoing_direction: unit, to the eye.
        normal: unit.

    Returns:
        f_r in 1/sr, found in float64 and returned in the dtype of the inputs.

    Differentiable in: all arguments; the kink at s = 0 (wi at right angles to wo as seen from
        above) has a finite gradient.
    Export: compile yes, ONNX yes.
    References: Portsmouth et al. (2025), eq. 21 to 26.

    >>> up = torch.tensor([0.0, 0.0, 1.0])
    >>> oren_nayar_brdf(torch.tensor([math.pi / 4]), torch.tensor([0.0]), up, up, up)
    tensor([0.2500])
    """
    check_directions(incident_direction, outgoing_direction, normal)
    wi, wo, n = wide(incident_direction, outgoing_direction, normal)
    rho, r = wide(albedo, roughness)
    mu_i, mu_o = dot(wi, n).unsqueeze(-1), dot(wo, n).unsqueeze(-1)
    above = (mu_i > 0) & (mu_o > 0)
    mu_i, mu_o = (torch.where(above, mu, 1).clamp(max=1) for mu in (mu_i, mu_o))
    s = dot(wi, wo).unsqueeze(-1) - mu_i * mu_o
    t = torch.where(s > 0, torch.maximum(mu_i, mu_o), 1)
    scale = _scale(r)
    mean = scale * (1 + ON_AVERAGE * r)
    again = rho * rho * mean / (1 - rho * (1 - mean))
    missing = _missing(mu_i) * _missing(mu_o) / (FROM_ABOVE - ON_AVERAGE)
    found = scale / math.pi * (rho * (1 + r * s / t) + again * r * missing)
    dtype = torch.promote_types(albedo.dtype, incident_direction.dtype)
    return torch.where(above, found, 0).to(dtype)


def _scale(roughness: Tensor) -> Tensor:
    """A."""
    return 1 / (1 + FROM_ABOVE * roughness)


def _missing(mu: Tensor) -> Tensor:
    """c - G/pi, with tan (1 - sin^3) = sin mu (1 + sin + sin^2) / (1 + sin), finite at mu = 0."""
    sine = safe_sqrt((1 - mu) * (1 + mu))
    grows = sine * (angle_of(sine, mu) - sine * mu)
    falls = sine * (mu * (1 + sine + sine * sine) / (1 + sine) - 1)
    return FROM_ABOVE - (grows + falls * (2 / 3)) / math.pi


@final
class OrenNayar(AbstractMaterial):
    """A rough matt surface that loses no light.

    Args:
        albedo: rho of the facets, `*batch channel`, 0..1.
        roughness: r, `*batch 1`, 0..1; 0 is `Lambertian`.
        learnable: keep both as `nn.Parameter`s.
    """

    albedo: Tensor
    roughness: Tensor

    def __init__(self, albedo: object, roughness: object, *, learnable: bool = False) -> None:
        super().__init__()
        self._hold("albedo", albedo, learnable, lowest=0, highest=1)
        self._hold("roughness", roughness, learnable, lowest=0, highest=1, last=1)

    def forward(
        self,
        incident_direction: Float[Tensor, "*batch 3"],
        outgoing_direction: Float[Tensor, "*batch 3"],
        normal: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch channel"]:
        return oren_nayar_brdf(
            self.albedo, self.roughness, incident_direction, outgoing_direction, normal
        )

    def diffuse_albedo(self) -> Float[Tensor, "*batch channel"]:
        """Share of light from everywhere that it sends everywhere: rho a / (1 - rho (1 - a))."""
        mean = _scale(self.roughness) * (1 + ON_AVERAGE * self.roughness)
        return self.albedo * mean / (1 - self.albedo * (1 - mean))

    def extra_repr(self) -> str:
        return "albedo [1], roughness [1]"
