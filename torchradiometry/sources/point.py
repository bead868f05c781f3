"""Near point source: light that spreads over ever larger spheres.

    E_facing = I / r^2,   wi = (x_s - x) / r,   r = |x_s - x|

I is the radiant intensity (W/sr, the same in all directions), x_s the lamp, x the surface
point. The law is exact for a lamp without size; a lamp of diameter d is a point to better
than 1 % from about 5 d on. r is never clamped to 1 or any other length of the scene.

What happens very close to the lamp, where I/r^2 has no value:

* nearer than `lamp_radius(dtype)` (2.3e-13 m in float32, 2.8e-103 m in float64; the cube
  root of the smallest normal number, below which 1/r^3 cannot be held) the point counts as
  *on* the lamp: no light, zero direction, zero gradient;
* where I/r^2 is a number of the dtype but its slope I/r^3 is not, the value is kept and the
  gradient in the positions is 0;
* half precision is computed in float32; an irradiance beyond float16's largest number is that
  number, 65504 W/m2, with gradient 0.

References: J. H. Lambert, *Photometria* (1760), the law of inverse squares; F. E. Nicodemus
et al., NBS Monograph 160 (1977).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.numerics import narrow, safe_norm, safe_normalize, single, tiny
from torchradiometry.sources.base import AbstractSource, Arrival, light_first

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["PointSource", "guard_offset", "lamp_radius", "point_arrival"]


def lamp_radius(dtype: torch.dtype) -> float:
    """Distance in m below which a point counts as on the lamp: 1/r^3 is a number above it.

    >>> lamp_radius(torch.float32)  # doctest: +ELLIPSIS
    2.273...e-13
    """
    return tiny(dtype) ** (1 / 3)


def point_arrival(
    lamp: Float[Tensor, "*batch light 3"],
    intensity: Float[Tensor, "*batch light channel"],
    position: Float[Tensor, "*batch point 3"],
) -> Arrival:
    """Light of point sources at the given positions: E = I / r^2.

    Args:
        lamp: positions of the lamps, m.
        intensity: W/sr, >= 0.
        position: surface points, m.

    Returns:
        The arrival: unit direction to the lamp, W/m2 on a facing plane, distance in m. On
        the lamp (see the module) no light from direction 0 at distance 0.

    Differentiable in: lamp, intensity, position.
    Export: compile yes, ONNX yes.
    References: see the module.

    >>> x = torch.zeros(1, 3)
    >>> point_arrival(torch.tensor([[0.0, 0.0, 2.0]]), torch.tensor([[8.0]]), x).irradiance
    tensor([[[2.]]])
    """
    dtype = position.dtype
    intensity, inner, lamp = single(light_first(intensity, position), position, lamp)
    offset = guard_offset(light_first(lamp, position) - inner, intensity, dtype)
    distance = safe_norm(offset)
    lit = distance > 0
    # neither r^2 nor 1/r^2 need be a number of the dtype; products, whose backward pass multiplies
    # a gradient of 0 by finite numbers only
    closeness = 1 / torch.where(lit, distance, 1).unsqueeze(-1)
    facing = torch.where(lit.unsqueeze(-1), intensity * closeness * closeness, 0)
    found = Arrival(safe_normalize(offset), facing, distance)
    return found if offset.dtype == dtype else Arrival(*(narrow(t, dtype) for t in found))


def guard_offset(
    offset: Float[Tensor, "*batch 3"],
    intensity: Float[Tensor, "*batch channel"],
    dtype: torch.dtype,
) -> Float[Tensor, "*batch 3"]:
    """The offset to a lamp, as results in `dtype` can bear it.

    Args:
        offset: lamp - surface point, m, in `dtype` or wider.
        intensity: W/sr.
        dtype: of the irradiance that is made from it.

    Returns:
        0 on the lamp; the offset without its gradient where I/r^3 is no number of `dtype`;
        the offset itself everywhere else.

    Differentiable in: offset.
    Export: compile yes, ONNX yes.
    """
    still, power = offset.detach(), intensity.detach().abs().amax(-1)
    distance = safe_norm(still)
    outside = distance >= min(lamp_radius(dtype), lamp_radius(torch.float32))
    radius = torch.where(outside, distance, 1)
    # 8: the largest factor that the derivatives of I/r^2 times a unit direction bring.
    gentle = power / radius / radius / radius < torch.finfo(dtype).max / 8
    still = torch.where(outside.unsqueeze(-1), still, 0)
    return torch.where((outside & gentle).unsqueeze(-1), offset, still)


@final
class PointSource(AbstractSource):
    """Near point lights, equally bright in all directions.

    Args:
        position: `light 3` or `batch light 3` (or one bare 3-vector), m.
        intensity: `light channel` or `batch light channel`, W/sr; a lamp of flux Phi has
            Phi / (4 pi) (`quantities.intensity_from_flux`).
        learnable: keep both as `nn.Parameter`s.

    >>> lamp = PointSource([0.0, 0.0, 3.0], [9.0])
    >>> lamp(torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]])).irradiance
    tensor([[[1.]]])
    """

    position: Tensor
    intensity: Tensor

    def __init__(self, position: object, intensity: object, *, learnable: bool = False) -> None:
        super().__init__()
        self._hold("position", position, learnable, last=3)
        self._hold("intensity", intensity, learnable, least=0)

    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
    ) -> Arrival:
        return point_arrival(self.position, self.intensity, self._near(position))

    def extra_repr(self) -> str:
        return f"lights={self.position.shape[-2]}, position [m], intensity [W/sr]"
