"""Natural light from afar: nine spherical harmonics of the environment's radiance.

    L(w) = sum_lm L_lm Y_lm(w),   E(n) = sum_lm A_l L_lm Y_lm(n),   A = pi, 2 pi/3, pi/4

The real, orthonormal basis in the order (l, m) = (0,0), (1,-1), (1,0), (1,1), (2,-2), (2,-1),
(2,0), (2,1), (2,2), for w = (x, y, z):

    sqrt(1/4pi);   sqrt(3/4pi) (y, z, x);
    sqrt(15/4pi) xy, sqrt(15/4pi) yz, sqrt(5/16pi) (3 z^2 - 1), sqrt(15/4pi) xz,
    sqrt(15/16pi) (x^2 - y^2)

A is the clamped cosine in the same basis: Lambertian surfaces forget what is finer (A_3 = 0,
A_4 = -pi/24). Of a single distant source, the worst case, the nine hold 99.2 % of the squared
irradiance; the root mean square error over all normals is 8.8 % of its root mean square.
Where the cut series rings below zero the irradiance is clamped to 0.

References: R. Ramamoorthi and P. Hanrahan, "An Efficient Representation for Irradiance
Environment Maps", SIGGRAPH 2001, eq. 3, 8 and 9; R. Basri and D. Jacobs, "Lambertian Reflectance
and Linear Subspaces", PAMI 25 (2003).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.arguments import as_numbers
from torchradiometry.errors import ShapeError, require_axes, require_floating
from torchradiometry.numerics import (
    alike,
    narrow,
    single,
)
from torchradiometry.sources.base import AbstractSource, Arrival, light_first

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = [
    "HarmonicSource",
    "cosine_coefficients",
    "harmonic_arrival",
    "harmonic_basis",
    "project_harmonics",
]

_Y0 = math.sqrt(1 / (4 * math.pi))
#: Factors of 1; y, z, x; xy, yz, 3 z^2 - 1, xz, x^2 - y^2 that make the nine orthonormal.
_NORM = (
    _Y0,
    *(math.sqrt(3) * _Y0,) * 3,
    math.sqrt(15) * _Y0,
    math.sqrt(15) * _Y0,
    math.sqrt(5) / 2 * _Y0,
    math.sqrt(15) * _Y0,
    math.sqrt(15) / 2 * _Y0,
)
#: A_l of each of the nine, in sr: Ramamoorthi and Hanrahan (2001), eq. 8.
_COSINE = (math.pi, *(2 * math.pi / 3,) * 3, *(math.pi / 4,) * 5)


def harmonic_basis(direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 9"]:
    """The nine real spherical harmonics Y_lm of order 0, 1 and 2 at unit directions.

    Args:
        direction: unit.

    Returns:
        Values in 1/sqrt(sr), in the order of this file's heading; orthonormal on the sphere.

    Differentiable in: direction.
    Export: compile yes, ONNX yes.
    References: Ramamoorthi and Hanrahan (2001), eq. 3.

    >>> harmonic_basis(torch.tensor([0.0, 0.0, 1.0]))[[0, 2, 6]]
    tensor([0.2821, 0.4886, 0.6308])
    """
    require_axes("direction", direction, 3)
    x, y, z = direction.unbind(-1)
    one = torch.ones_like(x)
    shape = (one, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, (x - y) * (x + y))
    norm = torch.tensor(_NORM, dtype=direction.dtype, device=direction.device)
    return torch.stack(shape, -1) * norm


def cosine_coefficients(like: Tensor) -> Float[Tensor, "9"]:
    """A_l of the nine, in sr: irradiance per radiance; dtype and device of `like`."""
    return torch.tensor(_COSINE, dtype=like.dtype, device=like.device)


def project_harmonics(
    direction: Float[Tensor, "sample 3"],
    radiance: Float[Tensor, "*batch sample channel"],
    weight: Float[Tensor, "sample"],
) -> Float[Tensor, "*batch 9 channel"]:
    """Coefficients L_lm = sum L(w) Y_lm(w) dw of sampled radiance.

    Args:
        direction: unit, over the whole sphere.
        radiance: W/m2/sr at the directions.
        weight: solid angle of each sample, sr; they sum to 4 pi.

    Returns:
        Nine coefficients a channel, W/m2/sqrt(sr).

    Differentiable in: all.
    Export: compile yes, ONNX yes.
    References: Ramamoorthi and Hanrahan (2001), eq. 2.

    >>> w = torch.cat([torch.eye(3), -torch.eye(3)])  # exact for constants
    >>> project_harmonics(w, torch.ones(6, 1), torch.full((6,), 4 * torch.pi / 6))[0] * _Y0
    tensor([1.0000])
    """
    require_axes("direction", direction, None, 3)
    require_axes("radiance", radiance, None, None)
    require_axes("weight", weight, None)
    dtype = torch.promote_types(direction.dtype, radiance.dtype)
    direction, radiance, weight = alike(*single(direction, radiance, weight))
    basis = harmonic_basis(direction) * weight.unsqueeze(-1)
    return narrow(basis.mT @ radiance, dtype)


def harmonic_arrival(
    coefficients: Float[Tensor, "*batch light 9 channel"],
    normal: Float[Tensor, "*batch point 3"],
) -> Arrival:
    """Light of environments given by nine harmonics, reported along the normal.

    E(n) = max(0, sum A_l L_lm Y_lm(n)).

    Args:
        coefficients: L_lm, W/m2/sqrt(sr), in the order of this file's heading.
        normal: unit.

    Returns:
        The arrival; direction = normal, distance infinite.

    Differentiable in: coefficients, normal (kink where the series turns negative).
    Export: compile yes, ONNX yes.
    References: Ramamoorthi and Hanrahan (2001), eq. 9.
    """
    require_floating("normal", normal)
    inner, coefficients = single(normal, coefficients)
    kernel = (harmonic_basis(inner) * cosine_coefficients(inner)).unsqueeze(-1)
    held = light_first(coefficients.flatten(-2), normal)
    held = held.unflatten(-1, (9, coefficients.shape[-1]))
    irradiance = narrow((kernel * held).sum(-2).clamp(min=0), normal.dtype)
    direction = normal.expand(irradiance.shape[0], *normal.shape)
    return Arrival(direction, irradiance, torch.full_like(direction[..., 0], torch.inf))


@final
class HarmonicSource(AbstractSource):
    """Distant environments, blurred as Lambertian surfaces see them.

    Args:
        coefficients: `light 9 channel` or `batch light 9 channel` (or one bare `9 channel`),
            W/m2/sqrt(sr); `project_harmonics` makes them from samples of radiance.
        learnable: keep them as an `nn.Parameter`.

    Raises:
        ShapeError: not nine coefficients.

    >>> grey = HarmonicSource([[1 / _Y0]] + [[0.0]] * 8)  # radiance 1 from everywhere: E = pi
    >>> grey(None, torch.tensor([[0.0, 0.6, 0.8]])).irradiance
    tensor([[[3.1416]]])
    """

    has_direction = False
    needs_position = False
    coefficients: Tensor

    def __init__(self, coefficients: object, *, learnable: bool = False) -> None:
        super().__init__()
        held = as_numbers("coefficients", coefficients)
        if held.ndim < 2 or held.shape[-2] != 9:
            raise ShapeError(
                "coefficients",
                f"a tensor of shape {tuple(held.shape)}",
                "pass `light 9 channel` or `batch light 9 channel`",
            )
        self._hold(
            "coefficients", held.unsqueeze(0) if held.ndim == 2 else held, learnable, light_axis=-3
        )

    @property
    def lights(self) -> int:
        return self.coefficients.shape[-3]

    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
    ) -> Arrival:
        return harmonic_arrival(self.coefficients, normal)

    def extra_repr(self) -> str:
        return f"lights={self.lights}, coefficients=9 [W/m2/sqrt(sr)]"
