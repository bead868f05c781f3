"""Mirror: where a perfectly smooth surface sends light, and what the lobes tend to.

    wr = 2 (n . wi) n - wi

A mirror has no BRDF that can be sampled: it is rho delta(wo - wr) / cos(theta_i), a peak of no
width. A lobe of exponent n about wr integrates to 2 pi / (n+1) and vanishes elsewhere as
n -> infinity, so the limits are known:

    reflectance of NormalizedPhong   -> k_s cos(theta_i)    (k_s exactly at normal incidence)
    reflectance of Phong             -> 0                   (as 2 pi k_s cos(theta_i) / n)

A mirror's own reflectance is the same at every angle; the factor cos(theta_i) is what
`OriginalPhong` divides by.

References: F. E. Nicodemus et al., NBS Monograph 160 (1977), section VI; R. R. Lewis (1994).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from torchradiometry.errors import require_axes
from torchradiometry.geometry.directions import reflect

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

__all__ = ["mirror_direction"]


def mirror_direction(
    incident_direction: Float[Tensor, "*batch 3"], normal: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Where a mirror sends the light: wr = 2 (n . wi) n - wi, away from the surface.

    Args:
        incident_direction: unit, to the source.
        normal: unit.

    Returns:
        Unit vectors, as far from the normal as the incident ones, on its other side.

    Differentiable in: both.
    Export: compile yes, ONNX yes.

    >>> import torch
    >>> mirror_direction(torch.tensor([0.6, 0.0, 0.8]), torch.tensor([0.0, 0.0, 1.0]))
    tensor([-0.6000,  0.0000,  0.8000])
    """
    require_axes("incident_direction", incident_direction, 3)
    require_axes("normal", normal, 3)
    return reflect(incident_direction, normal)
