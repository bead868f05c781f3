"""Blinn's form of Phong's highlight, with the half vector, normalised exactly.

    f_r = k_s C(n) cos^n(delta),   cos(delta) = n_surface . h,   h = (wi + wo) / |wi + wo|

    C(n) = (n+2)(n+4) / (8 pi (2^(-n/2) + n))

At normal incidence delta is half the outgoing angle, and the integral of
cos^n(theta/2) cos(theta) over the hemisphere is 8 pi (2^(-n/2) + n) / ((n+2)(n+4)): with this
C the material reflects exactly the share k_s there and less elsewhere. The (n+8)/(8 pi) seen
in many shaders is up to 7.5 % larger than C (near n = 9) and would reflect more than k_s.

The half-vector lobe with exponent n is about as wide as Phong's with n/4; unlike Phong's it
is stretched towards the horizon at grazing incidence, as reflections on roads and water are.

References: J. F. Blinn, "Models of Light Reflection for Computer Synthesized Pictures",
SIGGRAPH (1977), p. 193; T. Akenine-Moller et al., *Real-Time Rendering*, 3rd ed. (2008), 7.6;
F. Giesen, "Phong and Blinn-Phong Normalization Factors" (2009).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.materials.lobes import AbstractLobe, half_vector_lobe

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["BlinnPhong", "blinn_phong_brdf"]


def blinn_phong_brdf(
    specular: Float[Tensor, "*batch channel"],
    shininess: Float[Tensor, "*batch 1"],
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch channel"]:
    """BRDF k_s C(n) cos^n(delta) above the surface, 0 below it; delta is the half angle's.

    Args:
        specular: k_s, reflectance at normal incidence, 0..1.
        shininess: n, >= 0.
        incident_direction: unit, to the source.
        outgoing_direction: unit, to the eye.
        normal: unit.

    Returns:
        f_r in 1/sr.

    Differentiable in: all arguments; 0 at the two horizons, where the value jumps.
    Export: compile yes, ONNX yes.
    References: Blinn (1977); Giesen (2009).

    >>> up = torch.tensor([0.0, 0.0, 1.0])
    >>> blinn_phong_brdf(torch.tensor([math.pi]), torch.tensor([0.0]), up, up, up)
    tensor([1.])
    """
    lobe = half_vector_lobe(incident_direction, outgoing_direction, normal, shininess)
    n = shininess.to(lobe.dtype)
    height = (n + 2) / (8 * math.pi) * ((n + 4) / (torch.exp(-n * (math.log(2) / 2)) + n))
    dtype = torch.promote_types(specular.dtype, incident_direction.dtype)
    return (specular * (height * lobe)).to(dtype)


@final
class BlinnPhong(AbstractLobe):
    """The energy-normalised half-vector lobe.

    Args:
        specular: k_s, reflectance at normal incidence, `*batch channel`, 0..1.
        shininess: n, `*batch 1`, >= 0.
        learnable: keep both as `nn.Parameter`s.
    """

    brdf = staticmethod(blinn_phong_brdf)
    specular_unit = "1"
    most_specular = 1

    def normal_reflectance(self) -> Float[Tensor, "*batch channel"]:
        """Reflectance (DHR) at normal incidence, the largest over all angles: k_s."""
        return self.specular
