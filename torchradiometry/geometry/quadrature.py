"""Integrals over the hemisphere: Gauss-Legendre in cos(theta), equal steps in azimuth.

    integral f dw = int_0^1 du int_0^2pi dphi f,   u = cos(theta)   (dw = sin(theta) dtheta dphi)

With m polar and k azimuth nodes the rule is exact for all polynomials in x, y, z of degree
below min(2 m, k); for example the solid angle (2 pi), the cosine (pi) and cos^n lobes
(2 pi / (n + 1)) for n < 2 m.

References: P. J. Davis and P. Rabinowitz, *Methods of Numerical Integration*, 2nd ed. (1984),
5.6; the lecture integrals: D. Forsyth and J. Ponce (2011), 2.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchradiometry.errors import require_kind, require_whole
from torchradiometry.numerics import safe_sqrt

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["HemisphereQuadrature", "hemisphere_quadrature", "integrate_hemisphere"]


class HemisphereQuadrature(NamedTuple):
    """Nodes and weights over the hemisphere about +z.

    Attributes:
        direction: unit, above the horizon.
        weight: sr; they sum to 2 pi.
    """

    direction: Float[Tensor, "sample 3"]
    weight: Float[Tensor, "sample"]


def hemisphere_quadrature(
    polar: int = 16,
    azimuth: int = 32,
    dtype: torch.dtype | None = None,
    device: torch.device | str | None = None,
) -> HemisphereQuadrature:
    """Product rule with `polar * azimuth` nodes.

    Args:
        polar: Gauss-Legendre nodes in cos(theta), 1...4096.
        azimuth: equal steps in phi, 1...65536.
        dtype: default: torch's default dtype.
        device: default: torch's default device.

    Returns:
        Directions about +z and weights in sr.

    Raises:
        DTypeError: no whole numbers.
        OutOfRangeError: fewer than one node, or too many.

    >>> rule = hemisphere_quadrature(4, 8)
    >>> integrate_hemisphere(lambda w: w[..., 2], rule) / torch.pi
    tensor(1.0000)
    """
    require_whole("polar", polar, 1, 2**12)
    require_whole("azimuth", azimuth, 1, 2**16)
    node, weight = (torch.from_numpy(a) for a in np.polynomial.legendre.leggauss(polar))
    cosine = ((node + 1) / 2).unsqueeze(-1)
    step = torch.arange(azimuth, dtype=torch.float64) + 0.5
    phi = (2 * math.pi / azimuth) * step
    sine = safe_sqrt((1 - cosine) * (1 + cosine))
    direction = torch.stack(
        (sine * torch.cos(phi), sine * torch.sin(phi), cosine.expand(-1, azimuth)), -1
    )
    share = (weight * math.pi / azimuth).unsqueeze(-1).expand(-1, azimuth)
    dtype = dtype or torch.get_default_dtype()
    device = torch.device(device) if device is not None else torch.get_default_device()
    return HemisphereQuadrature(
        direction.reshape(-1, 3).to(device, dtype), share.reshape(-1).to(device, dtype)
    )


def integrate_hemisphere(
    function: Callable[[Float[Tensor, "sample 3"]], Float[Tensor, "*batch sample"]],
    quadrature: HemisphereQuadrature,
) -> Float[Tensor, "*batch"]:
    """Integral of a function of the direction over the hemisphere about +z.

    Args:
        function: takes the directions, gives values with the sample axis last.
        quadrature: from `hemisphere_quadrature`.

    Returns:
        The integral, in the function's unit times sr.

    Differentiable in: whatever the function's values depend on.
    Export: compile yes, ONNX yes, when the function does.

    >>> lobe = lambda w: w[..., 2] ** 6  # cos^n: 2 pi / (n + 1)
    >>> integrate_hemisphere(lobe, hemisphere_quadrature(8, 16)) * 7 / (2 * torch.pi)
    tensor(1.0000)
    """
    require_kind("quadrature", quadrature, HemisphereQuadrature)
    return (function(quadrature.direction) * quadrature.weight).sum(-1)
