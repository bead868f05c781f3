"""Specular lobes: powers of the cosine between two directions, with all their digits.

    lobe = max(0, cos angle(a, b))^n = exp(n log1p(-v)),   v = 1 - cos = |a - b|^2 / 2

cos^n multiplies the relative error of the cosine by n, so a float32 dot product leaves two
digits at n = 1e5 and none at 1e7. Near the peak, where the lobe lives, the versine v comes
from the difference of the two vectors without cancellation; it is found in float64. The
relative error of the lobe is then about eps sqrt(75 n) at worst over the part of it that is
above eps of the peak: 2 10^-14 at n = 100, 2 10^-12 at n = 1e6; in float32 it is the rounding of
the result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from torchradiometry.geometry.directions import reflect
from torchradiometry.numerics import dot, safe_normalize, wide

if TYPE_CHECKING:
    from jaxtyping import Bool, Float
    from torch import Tensor

__all__ = ["above_horizon", "cosine_power", "half_vector_lobe", "mirror_lobe"]


def above_horizon(
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
) -> Bool[Tensor, "*batch 1"]:
    """True where source and eye are both above the surface: elsewhere every BRDF is 0."""
    above = (dot(incident_direction, normal) > 0) & (dot(outgoing_direction, normal) > 0)
    return above.unsqueeze(-1)


def cosine_power(
    a: Float[Tensor, "*batch 3"],
    b: Float[Tensor, "*batch 3"],
    exponent: Float[Tensor, "*batch 1"],
) -> Float[Tensor, "*batch 1"]:
    """max(0, cos angle(a, b))^n of unit vectors, stable for every n >= 0.

    As `numerics.power_lobe`: n = 0 gives 1 everywhere, the horizon has gradient 0.

    Args:
        a: unit, float64.
        b: unit, float64.
        exponent: n >= 0, float64.

    Returns:
        0..1.

    Differentiable in: all arguments.
    Export: compile yes, ONNX yes.

    >>> up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    >>> cosine_power(up, up, torch.tensor([1e6], dtype=torch.float64)).item()
    1.0
    """
    versine = (a - b).square().sum(-1, keepdim=True) / 2
    front = versine < 1
    outside = torch.where(exponent > 0, 0.0, 1.0).to(versine.dtype)
    log_cosine = torch.log1p(-torch.where(front, versine, 0))
    return torch.where(front, torch.exp(exponent * log_cosine), outside)


def mirror_lobe(
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    shininess: Float[Tensor, "*batch 1"],
) -> Float[Tensor, "*batch 1"]:
    """cos^n of the angle between the outgoing and the mirror direction, in float64 (Phong)."""
    wi, wo, n, exponent = wide(incident_direction, outgoing_direction, normal, shininess)
    # float32 unit vectors are unit to 1e-7 only, which n would multiply
    mirrored = reflect(safe_normalize(wi), safe_normalize(n))
    return cosine_power(mirrored, safe_normalize(wo), exponent)


def half_vector_lobe(
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    shininess: Float[Tensor, "*batch 1"],
) -> Float[Tensor, "*batch 1"]:
    """cos^n of the angle between normal and half vector, in float64 (Blinn)."""
    wi, wo, n, exponent = wide(incident_direction, outgoing_direction, normal, shininess)
    half = safe_normalize(safe_normalize(wi) + safe_normalize(wo))
    return cosine_power(half, safe_normalize(n), exponent)
