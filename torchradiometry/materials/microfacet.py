"""Glossy surface made of small mirrors: glaze, varnish, polished stone, metal.

    f_r = D(delta) G F(u) / (4 mu_i mu_o)

    D = a^2 / (pi (a^2 cos(delta)^2 + sin(delta)^2)^2)   (mirrors that face the half vector)
    G / (4 mu_i mu_o) = 1 / (2 (mu_o g(mu_i) + mu_i g(mu_o))),  g(mu) = sqrt(a^2 + (1 - a^2) mu^2)
    F = k_s + (1 - k_s) (1 - u)^5                        (what a mirror reflects)

delta is the angle between normal and half vector h, mu are the cosines of wi and wo to the
normal, u = wi . h. D is the distribution of Trowbridge and Reitz, known as GGX, whose tails are
longer than those of cos^n and nearer to measured highlights; G is Smith's share of mirrors that
no other one hides from light and eye together. Light that bounces twice between mirrors is
left out: of light from above, a white surface (k_s = 1) reflects 98.8 % at a = 0.1 and only
1 - ln 2 = 31 % at a = 1.

References: T. S. Trowbridge and K. P. Reitz, JOSA 65 (1975); R. L. Cook and K. E. Torrance, ACM
TOG 1 (1982); B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR
(2007), eq. 20, 33 and 34; E. Heitz, "Understanding the Masking-Shadowing Function in
Microfacet-Based BRDFs", JCGT 3 (2014), eq. 99; C. Schlick, CGF 13 (1994).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.materials.base import AbstractMaterial, check_directions
from torchradiometry.numerics import dot, safe_normalize, wide

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Microfacet", "microfacet_brdf"]

#: smallest a: a highlight of 0.01 degrees, far below any pixel
SMOOTHEST = 1e-4


def microfacet_brdf(
    specular: Float[Tensor, "*batch channel"],
    roughness: Float[Tensor, "*batch 1"],
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch channel"]:
    """BRDF of small mirrors above the surface, 0 below it.

    Args:
        specular: k_s, reflectance of a mirror hit head-on, 0..1 (0.04 for glass and varnish).
        roughness: a, `SMOOTHEST`..1, about the standard deviation of the mirrors' slopes.
        incident_direction: unit, to the source.
        outgoing_direction: unit, to the eye.
        normal: unit.

    Returns:
        f_r in 1/sr, found in float64 and returned in the dtype of the inputs.

    Differentiable in: all arguments; 0 at the two horizons, where the value jumps.
    Export: compile yes, ONNX yes.
    References: Walter et al. (2007), eq. 20 and 33; Heitz (2014), eq. 99.

    >>> up = torch.tensor([0.0, 0.0, 1.0])
    >>> microfacet_brdf(torch.tensor([1.0]), torch.tensor([1.0]), up, up, up) * 4 * math.pi
    tensor([1.])
    """
    check_directions(incident_direction, outgoing_direction, normal)
    wi, wo, n = (safe_normalize(v) for v in wide(incident_direction, outgoing_direction, normal))
    k, a = wide(specular, roughness)
    mu_i, mu_o = dot(wi, n).unsqueeze(-1), dot(wo, n).unsqueeze(-1)
    above = (mu_i > 0) & (mu_o > 0)
    mu_i, mu_o = (torch.where(above, mu, 1) for mu in (mu_i, mu_o))
    whole = wi + wo
    half = safe_normalize(whole)
    # sin^2 of the angle between unit vectors from their difference: all digits near the peak
    versine = (half - n).square().sum(-1, keepdim=True) / 2
    squared = versine * (2 - versine)
    a2 = a * a
    facing = a2 / (math.pi * (a2 + (1 - a2) * squared).square())
    seen = 1 / (2 * (mu_o * _reach(mu_i, a2) + mu_i * _reach(mu_o, a2)))
    u = dot(half, wi).unsqueeze(-1).clamp(0, 1)
    fresnel = k + (1 - k) * (1 - u) ** 5
    dtype = torch.promote_types(specular.dtype, incident_direction.dtype)
    return torch.where(above, fresnel * (facing * seen), 0).to(dtype)


def _reach(mu: Tensor, a2: Tensor) -> Tensor:
    """g(mu)."""
    return torch.sqrt(a2 + (1 - a2) * mu * mu)


@final
class Microfacet(AbstractMaterial):
    """Small mirrors (Trowbridge-Reitz, "GGX") with Smith's shadowing and Schlick's Fresnel term.

    Args:
        specular: k_s, `*batch channel`, 0..1.
        roughness: a, `*batch 1`, 1e-4..1.
        learnable: keep both as `nn.Parameter`s.
    """

    specular: Tensor
    roughness: Tensor

    def __init__(self, specular: object, roughness: object, *, learnable: bool = False) -> None:
        super().__init__()
        self._hold("specular", specular, learnable, lowest=0, highest=1)
        self._hold("roughness", roughness, learnable, lowest=SMOOTHEST, highest=1, last=1)

    def forward(
        self,
        incident_direction: Float[Tensor, "*batch 3"],
        outgoing_direction: Float[Tensor, "*batch 3"],
        normal: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch channel"]:
        return microfacet_brdf(
            self.specular, self.roughness, incident_direction, outgoing_direction, normal
        )

    def extra_repr(self) -> str:
        return "specular [1], roughness [1]"
