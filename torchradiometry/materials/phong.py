"""Phong's highlight, in the three forms that are all called "Phong".

    alpha = angle between the outgoing direction and the mirror direction 2 (n.wi) n - wi

| class | f_r above the horizon | L_o for irradiance E on a facing plane |
|---|---|---|
| `OriginalPhong` | k_s cos^n(alpha) / cos(theta_i) | k_s cos^n(alpha) E |
| `Phong` | k_s cos^n(alpha) | k_s cos^n(alpha) E cos(theta_i) |
| `NormalizedPhong` | k_s (n+2)/(2 pi) cos^n(alpha) | the same, times (n+2)/(2 pi) |

Phong (1975) adds the highlight W(i) cos^n(s) to the shaded colour *without* the cosine of
incidence. A shader multiplies every BRDF by that cosine, so `OriginalPhong` divides by it: it
gives the pictures of the paper, but is not reciprocal and reflects more than it receives at
grazing incidence. `Phong` is the plain lobe as a BRDF, reciprocal, whose reflectance shrinks
as 2 pi k_s / (n+2). `NormalizedPhong` reflects exactly the share k_s at normal incidence and
less elsewhere, whatever n is.

With n -> infinity the lobe closes about the mirror direction and the reflectance
(directional-hemispherical) of `NormalizedPhong` tends to k_s cos(theta_i): k_s at normal
incidence, for the cosine that a mirror's BRDF divides by is not in the formula.

References: B. T. Phong, "Illumination for Computer Generated Pictures", CACM 18 (1975), p.
315; E. P. Lafortune and Y. D. Willems, "Using the Modified Phong Reflectance Model for
Physically Based Rendering", K.U. Leuven report CW 197 (1994), eq. 4 and section 3;
R. R. Lewis, "Making Shaders More Physically Plausible", CGF 13 (1994).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import require_axes
from torchradiometry.materials.lobes import AbstractLobe, mirror_lobe, product
from torchradiometry.numerics import tiny, wide

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = [
    "NormalizedPhong",
    "OriginalPhong",
    "Phong",
    "mean_lobe_reflectance",
    "normalized_phong_brdf",
    "original_phong_brdf",
    "phong_brdf",
]

#: even Legendre moments after the first
LEGENDRE = 8


def phong_brdf(
    specular: Float[Tensor, "*batch channel"],
    shininess: Float[Tensor, "*batch 1"],
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch channel"]:
    """BRDF k_s cos^n(alpha) above the surface, 0 below it.

    Args:
        specular: k_s in 1/sr, the height of the lobe, >= 0.
        shininess: n, >= 0; 0 makes the lobe constant (diffuse).
        incident_direction: unit, to the source.
        outgoing_direction: unit, to the eye.
        normal: unit.

    Returns:
        f_r in 1/sr.

    Differentiable in: all arguments; 0 at the two horizons, where the value jumps.
    Export: compile yes, ONNX yes.
    References: see the module.

    >>> up = torch.tensor([0.0, 0.0, 1.0])
    >>> phong_brdf(torch.tensor([0.5]), torch.tensor([20.0]), up, up, up)
    tensor([0.5000])
    """
    lobe = mirror_lobe(incident_direction, outgoing_direction, normal, shininess)
    dtype = torch.promote_types(specular.dtype, incident_direction.dtype)
    return (specular * lobe).to(dtype)


def normalized_phong_brdf(
    specular: Float[Tensor, "*batch channel"],
    shininess: Float[Tensor, "*batch 1"],
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch channel"]:
    """BRDF k_s (n+2)/(2 pi) cos^n(alpha): the share k_s is reflected at normal incidence.

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
    References: Lafortune and Willems (1994).

    >>> up = torch.tensor([0.0, 0.0, 1.0])
    >>> normalized_phong_brdf(torch.tensor([math.pi / 2]), torch.tensor([18.0]), up, up, up)
    tensor([5.])
    """
    lobe = mirror_lobe(incident_direction, outgoing_direction, normal, shininess)
    height = (shininess.to(lobe.dtype) + 2) * (0.5 / math.pi)
    dtype = torch.promote_types(specular.dtype, incident_direction.dtype)
    return (specular * (height * lobe)).to(dtype)


def mean_lobe_reflectance(
    shininess: Float[Tensor, "*batch"],
) -> Float[Tensor, "*batch"]:
    """Share of even light that `NormalizedPhong` of k_s = 1 reflects (bihemispherical).

    With Legendre moments a_l = int_0^1 t^n P_l dt and b_l = int_0^1 t P_l dt (Funk-Hecke),

        rho = (n+2) sum over l of (2l+1) b_l^2 a_l,    a_l = a_(l-2) (n-l+2) / (n+l+1)

    5/6 for small n > 0, 0.6875 at n = 4, 2/3 for a mirror; 1 at n = 0, where the lobe is all
    around.

    Args:
        shininess: n, >= 0.

    Returns:
        2/3..1, relative error 1e-4 (the sum ends at l = 16).

    Differentiable in: shininess.
    Export: compile yes, ONNX yes.
    References: R. Ramamoorthi and P. Hanrahan, "An Efficient Representation for Irradiance
    Environment Maps", SIGGRAPH 2001 (b_l); R. Basri and D. Jacobs, "Lambertian Reflectance and
    Linear Subspaces", TPAMI 25 (2003), section 3.1 (Funk-Hecke).

    >>> mean_lobe_reflectance(torch.tensor([0.0, 50.0]))
    tensor([1.0000, 0.6674])
    """
    require_axes("shininess", shininess)
    (n,) = wide(shininess)
    # (n + 2) a_l; both quotients as 1 and what is left, so that gradients keep their digits
    even, known = 1 + 1 / (n + 1), 0.5
    # l = 0 and 1; the other odd b_l are 0
    total = known * known * even + 1 / 3
    for order in range(2, 2 * LEGENDRE + 1, 2):
        even = even * (1 - (2 * order - 1) / (n + order + 1))
        known = known * (3 - order) / (order + 2)
        total = total + (2 * order + 1) * known * known * even
    return torch.where(n > 0, total, 1).to(shininess.dtype)


def original_phong_brdf(
    specular: Float[Tensor, "*batch channel"],
    shininess: Float[Tensor, "*batch 1"],
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch channel"]:
    """BRDF k_s cos^n(alpha) / cos(theta_i), so that the highlight is as Phong wrote it.

    Not reciprocal, and unbounded at grazing incidence; the product with the shader's cosine
    is bounded. Cosines up to sqrt(tiny) of the dtype (10^-19 in float32), below which the
    derivative 1/cos^2 is no number, count as below the horizon.

    Args:
        specular: k_s, the brightness of the highlight per irradiance on a facing plane, 1/sr.
        shininess: n, >= 0.
        incident_direction: unit, to the source.
        outgoing_direction: unit, to the eye.
        normal: unit.

    Returns:
        f_r in 1/sr.

    Differentiable in: all arguments; 0 at the two horizons, where the value jumps.
    Export: compile yes, ONNX yes.
    References: Phong (1975).

    >>> up, tilted = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.6, 0.0, 0.8])
    >>> mirrored = torch.tensor([-0.6, 0.0, 0.8])
    >>> original_phong_brdf(torch.tensor([0.4]), torch.tensor([9.0]), tilted, mirrored, up)
    tensor([0.5000])
    """
    plain = phong_brdf(specular, shininess, incident_direction, outgoing_direction, normal)
    cosine = product(*wide(incident_direction, normal))
    usable = cosine > math.sqrt(tiny(plain.dtype))
    return torch.where(usable, plain / torch.where(usable, cosine, 1), 0).to(plain.dtype)


@final
class Phong(AbstractLobe):
    """The plain lobe f_r = k_s cos^n(alpha); it reflects 2 pi k_s / (n+2) at normal incidence.

    Args:
        specular: k_s, `*batch channel`, 1/sr, >= 0.
        shininess: n, `*batch 1`, >= 0.
        learnable: keep both as `nn.Parameter`s.
    """

    brdf = staticmethod(phong_brdf)
    specular_unit = "1/sr"

    def normal_reflectance(self) -> Float[Tensor, "*batch channel"]:
        """Reflectance (DHR) at normal incidence, the largest over all angles."""
        return 2 * math.pi * self.specular / (self.shininess + 2)


@final
class NormalizedPhong(AbstractLobe):
    """The energy-normalised lobe f_r = k_s (n+2)/(2 pi) cos^n(alpha).

    Args:
        specular: k_s, reflectance at normal incidence, `*batch channel`, 0..1.
        shininess: n, `*batch 1`, >= 0.
        learnable: keep both as `nn.Parameter`s.
    """

    brdf = staticmethod(normalized_phong_brdf)
    specular_unit = "1"
    most_specular = 1

    def normal_reflectance(self) -> Float[Tensor, "*batch channel"]:
        """Reflectance (DHR) at normal incidence, the largest over all angles: k_s."""
        return self.specular


@final
class OriginalPhong(AbstractLobe):
    """Phong's highlight without the cosine of incidence; not reciprocal, not energy-bounded.

    Args:
        specular: k_s, `*batch channel`, 1/sr, >= 0.
        shininess: n, `*batch 1`, >= 0.
        learnable: keep both as `nn.Parameter`s.
    """

    brdf = staticmethod(original_phong_brdf)
    specular_unit = "1/sr"

    def normal_reflectance(self) -> Float[Tensor, "*batch channel"]:
        """Reflectance (DHR) at normal incidence; at other angles it is larger."""
        return 2 * math.pi * self.specular / (self.shininess + 2)
