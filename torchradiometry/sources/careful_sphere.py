"""A second look, with 32 digits, at spheres whose irradiance cancels.

    E = s^2 psi c - cos(sigma) sin(psi) q + atan(q sin(psi) / cos(sigma)),   q = s sin(omega)

with the symbols of `sphere`. How far the horizon cuts into the sphere, s^2 - c^2, how near the
point is to it, 1 - s^2, and a grazing cosine are differences of the numbers given; the sum is
far smaller than its terms where a far sphere only peeks over the horizon.

References: J. M. Snyder, Microsoft Research MSR-TR-96-11 (1996), 3.3; as of
`geometry.double_double`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.geometry.double_double import Double, angle, cross, inner, power_of_two

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["careful_sphere"]


def careful_sphere(
    offset: Float[Tensor, "row 3"], normal: Float[Tensor, "row 3"], radius: Float[Tensor, "row"]
) -> Float[Tensor, "row"]:
    """Irradiance of spheres of unit radiance at points outside, W/m2, float64.

    Args:
        offset, normal, radius: as of `sphere_irradiance`, float64, none of them 0.

    Returns:
        Within 1e-15 of the exact value for spheres of more than 1e-6 rad that peek over the horizon
        by more than 1e-4 of their radius.

    Differentiable in: all.
    Export: no; it is taken for the few rows that need it.
    """
    unit = power_of_two(torch.maximum(offset.abs().amax(-1), radius))
    to, up = Double.of((offset / unit.unsqueeze(-1)).mT), Double.of(normal.mT)
    r, length, distance = Double.of(radius / unit), inner(up, up).root(), inner(to, to).root()
    s, cosine = r.over(distance), inner(up, to).over(length.times(distance))
    slant = inner(to, to).minus(r.times(r)).root().over(distance)
    across = cross(up, to)
    lateral = inner(across, across).root().over(length.times(distance))
    cut = (cosine.high.abs() < s.high) & (lateral.high > 0)
    one = Double.of(torch.ones_like(s.high))
    outline = s.times(lateral).where(cut, one)
    depth = s.minus(cosine).times(s.plus(cosine)).root().over(outline).where(cut, one)
    slanted = slant.times(cosine).over(outline)
    psi = angle(depth, Double(-slanted.high, -slanted.low))
    lever = outline.times(depth)
    part = s.times(s).times(psi).times(cosine).minus(slant.times(lever)).plus(angle(lever, slant))
    whole = s.times(s).times(cosine).value.clamp(min=0) * math.pi
    return torch.where(cut, part.value, whole) * length.value
