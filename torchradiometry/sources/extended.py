"""From the vector irradiance of an extended source to what an `Arrival` reports.

    wi = Phi / |Phi|,   E_facing = L |Phi|     so that  E_facing (n . wi) = L n . Phi

Phi is the integral of the direction over the part of the source above the receiver's
horizon (unit radiance). The product is exact for Lambertian surfaces; for other BRDFs it is
the one-direction approximation, and the source's `samples` option converges.

References: J. Arvo, "The Irradiance Jacobian for Partially Occluded Polyhedral Sources",
SIGGRAPH 1994, section 2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from torchradiometry.numerics import dot, guarded_divide, safe_norm, safe_normalize

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

__all__ = ["direction_and_length", "sample_rows", "summed"]

#: The rounding of `wi` is repaired in E_facing only within this factor, so that a different
#: order of summation in the shader cannot blow it up at grazing incidence.
_REPAIR = 2.0


def direction_and_length(
    vector: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    otherwise: Float[Tensor, "*batch 3"],
    dtype: torch.dtype,
) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch"]]:
    """Direction and length of a float64 vector irradiance, in the caller's dtype.

    A unit vector in float32 has a cosine that is wrong by 1e-7, which is much at grazing
    incidence. The length makes up for it, so that length * (n . direction) keeps the digits
    of n . vector.

    Args:
        vector: Phi in sr, float64; zero where nothing arrives.
        normal: of the receiver, float64, unit.
        otherwise: unit direction to report where nothing arrives.
        dtype: of the answer.

    Returns:
        Unit direction and length in sr.
    """
    exact = safe_normalize(vector)
    length = safe_norm(vector)
    exact = torch.where((length > 0).unsqueeze(-1), exact, otherwise)
    direction = exact.to(dtype)
    rounded = dot(normal.to(dtype), direction).double()
    repair = guarded_divide(dot(normal, exact), rounded, 1.0).detach().clamp(1 / _REPAIR, _REPAIR)
    return direction, (length * repair).to(dtype)


def summed(
    received: Float[Tensor, "light *batch point"],
    radiance: Float[Tensor, "light *batch 1 channel"],
    visibility: Float[Tensor, "light *batch point"] | None,
) -> Float[Tensor, "*batch point channel"]:
    """E = sum over lights of L n . Phi V, without the detour by a direction, W/m2.

    Args:
        received: n . Phi of each light, sr.
        radiance: W/m2/sr.
        visibility: 0..1.

    Differentiable in: all.
    Export: compile yes, ONNX yes.
    """
    if visibility is not None:
        received = received * visibility
    return (received.unsqueeze(-1) * radiance).sum(0)


def sample_rows(
    direction: Float[Tensor, "light *batch point sample 3"],
    strength: Float[Tensor, "light *batch point sample"],
    distance: Float[Tensor, "light *batch point sample"],
    radiance: Float[Tensor, "light *batch 1 channel"],
) -> tuple[Tensor, Tensor, Tensor]:
    """Samples as rows of their own on the light axis: direction, irradiance, distance.

    Row `light * samples + sample` belongs to that sample of that light.
    """
    irradiance = strength.unsqueeze(-1) * radiance.unsqueeze(-2)
    direction, irradiance = direction.movedim(-2, 1), irradiance.movedim(-2, 1)
    return (
        direction.flatten(0, 1),
        irradiance.flatten(0, 1),
        distance.movedim(-1, 1).flatten(0, 1),
    )
