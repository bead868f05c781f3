"""Unit vectors: mirror direction, a frame around a normal, polar angles.

    reflect     r = 2 (n . d) n - d
    frame       t, b with t x b = n, without a branch in its formula (Duff et al. 2017)
    spherical   d = (sin(theta) cos(phi), sin(theta) sin(phi), cos(theta))

References: T. Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6 (2017), listing 3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from torchradiometry.errors import require_axes
from torchradiometry.numerics import (
    dot,
    narrow,
    single,
)

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

__all__ = ["local_frame", "reflect", "spherical_direction"]


def reflect(
    direction: Float[Tensor, "*batch 3"], normal: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Mirror direction 2 (n . d) n - d; both directions point away from the surface.

    Args:
        direction: unit.
        normal: unit.

    Returns:
        Unit vectors, in the plane of both, on the other side of the normal.

    Differentiable in: direction, normal.
    Export: compile yes, ONNX yes.

    >>> reflect(torch.tensor([0.6, 0.0, 0.8]), torch.tensor([0.0, 0.0, 1.0]))
    tensor([-0.6000,  0.0000,  0.8000])
    """
    require_axes("direction", direction, 3)
    require_axes("normal", normal, 3)
    dtype = torch.promote_types(direction.dtype, normal.dtype)
    direction, normal = single(direction, normal)
    return narrow(2 * dot(normal, direction).unsqueeze(-1) * normal - direction, dtype)


def local_frame(
    normal: Float[Tensor, "*batch 3"],
) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3"]]:
    """Tangent and bitangent of a normal: (t, b, n) is right-handed and orthonormal.

    With s = sign(n_z), a = -1 / (s + n_z), c = n_x n_y a:
    t = (1 + s n_x^2 a, s c, -s n_x), b = (c, s + n_y^2 a, -n_y).

    Args:
        normal: unit.

    Returns:
        Two unit vectors. The denominator is at least 1, so value and gradient are finite for
        every unit normal; the frame jumps where n_z changes sign.

    Differentiable in: normal.
    Export: compile yes, ONNX yes.
    References: Duff et al. (2017), listing 3.

    >>> local_frame(torch.tensor([0.0, 0.0, 1.0]))
    (tensor([1., 0., 0.]), tensor([0., 1., 0.]))
    """
    require_axes("normal", normal, 3)
    dtype = normal.dtype
    x, y, z = single(normal)[0].unbind(-1)
    sign = torch.where(z < 0, -1.0, 1.0).to(x.dtype)
    a = -1 / (sign + z)
    c = x * y * a
    tangent = torch.stack((1 + sign * x * x * a, sign * c, -sign * x), -1)
    bitangent = torch.stack((c, sign + y * y * a, -y), -1)
    return narrow(tangent + 0, dtype), narrow(bitangent + 0, dtype)


def spherical_direction(
    polar: Float[Tensor, "*batch"], azimuth: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch 3"]:
    """Unit vector at polar angle theta from +z and azimuth phi from +x towards +y.

    Args:
        polar: theta in rad, 0...pi.
        azimuth: phi in rad.

    Returns:
        Unit vectors.

    Differentiable in: polar, azimuth.
    Export: compile yes, ONNX yes.

    >>> spherical_direction(torch.tensor(0.0), torch.tensor(1.0))
    tensor([0., 0., 1.])
    """
    require_axes("polar", polar)
    require_axes("azimuth", azimuth)
    polar, azimuth = torch.broadcast_tensors(polar, azimuth)
    sine = torch.sin(polar)
    return torch.stack((sine * torch.cos(azimuth), sine * torch.sin(azimuth), torch.cos(polar)), -1)
