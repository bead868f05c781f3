"""Spot source: a near point source that shines into a cone, as in glTF.

    E_facing = I t(a) / r^2,
    t(a) = clamp((cos a - cos outer) / (cos inner - cos outer), 0, 1)^2

a is the angle between the axis of the lamp and the ray that leaves it; I is the intensity on
the axis, and everywhere in the inner cone. Differences of cosines lose their digits in
narrow cones, so the formula is evaluated in float64 with versines, 1 - cos a = |u - v|^2 / 2
(u, v unit) and 1 - cos c = 2 sin^2(c/2).

Where inner = outer the cone is hard: 1 up to and including the angle, 0 beyond, gradient 0.
The same holds where learning has pushed inner past outer. glTF's sample shader instead keeps
the difference of the cosines above 0.001, so it blurs such cones by up to a few degrees.

References: Khronos, *KHR_lights_punctual* (glTF 2.0 extension), "Inner and Outer Cone Angles".
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import DegenerateGeometryError, OutOfRangeError, require_axes
from torchradiometry.numerics import narrow, safe_normalize, single, wide
from torchradiometry.sources.base import AbstractSource, Arrival, light_first
from torchradiometry.sources.point import guard_offset, point_arrival

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["SpotSource", "cone_attenuation", "spot_arrival"]


def cone_attenuation(
    direction: Float[Tensor, "*batch 3"],
    axis: Float[Tensor, "*batch 3"],
    inner_cone: Float[Tensor, "*batch"],
    outer_cone: Float[Tensor, "*batch"],
) -> Float[Tensor, "*batch"]:
    """Share t of the axial intensity that leaves a spot lamp in a direction.

    t = clamp((cos a - cos outer) / (cos inner - cos outer), 0, 1)^2

    Args:
        direction: away from the lamp; need not be unit.
        axis: the direction the cone points to; need not be unit.
        inner_cone: half-angle of the full light, radians, 0..outer_cone.
        outer_cone: half-angle beyond which there is none, radians, 0..pi/2.

    Returns:
        0..1.

    Differentiable in: all arguments; a hard cone (inner >= outer) has gradient 0, and t has a
        kink at the inner cone.
    Export: compile yes, ONNX yes.
    References: KHR_lights_punctual.

    >>> ray, axis = torch.tensor([0.0, 0.6, -0.8]), torch.tensor([0.0, 0.0, -1.0])
    >>> cone_attenuation(ray, axis, torch.tensor(0.0), torch.acos(torch.tensor(0.6)))
    tensor(0.2500)
    """
    require_axes("direction", direction, 3)
    require_axes("axis", axis, 3)
    require_axes("inner_cone", inner_cone)
    require_axes("outer_cone", outer_cone)
    u, v, inner, outer = wide(direction, axis, inner_cone, outer_cone)
    versine = (safe_normalize(u) - safe_normalize(v)).square().sum(-1) / 2
    versine_inner, versine_outer = 2 * torch.sin(inner / 2) ** 2, 2 * torch.sin(outer / 2) ** 2
    width = versine_outer - versine_inner
    soft = width > 0
    ramp = ((versine_outer - versine) / torch.where(soft, width, 1)).clamp(0, 1) ** 2
    hard = (versine <= versine_outer).to(ramp.dtype)
    return torch.where(soft, ramp, hard).to(direction.dtype)


def spot_arrival(
    lamp: Float[Tensor, "*batch light 3"],
    axis: Float[Tensor, "*batch light 3"],
    intensity: Float[Tensor, "*batch light channel"],
    inner_cone: Float[Tensor, "*batch light 1"],
    outer_cone: Float[Tensor, "*batch light 1"],
    position: Float[Tensor, "*batch point 3"],
) -> Arrival:
    """Light of spot sources at the given positions: E = I t(a) / r^2.

    Args:
        lamp: positions of the lamps, m.
        axis: the direction each cone points to, away from the lamp; need not be unit.
        intensity: W/sr on the axis, >= 0.
        inner_cone: half-angle of the full light, radians.
        outer_cone: half-angle beyond which there is none, radians.
        position: surface points, m.

    Returns:
        The arrival, as of a point source, times the cone's attenuation.

    Differentiable in: all arguments; kinks and hard cones as in `cone_attenuation`.
    Export: compile yes, ONNX yes.
    References: see the module.
    """
    dtype = position.dtype
    # once, so that half precision meets the sum of the two gradients and not their overflows
    lamp, intensity, position = single(lamp, intensity, position)
    reach = point_arrival(lamp, intensity, position)
    # not the rounded direction of `reach`: its error of 1e-7 rad is large in a narrow cone
    start, end = wide(light_first(lamp, position), position)
    offset = guard_offset(start - end, light_first(intensity, position), dtype)
    share = cone_attenuation(
        -offset,
        light_first(axis, position),
        light_first(inner_cone, position).squeeze(-1),
        light_first(outer_cone, position).squeeze(-1),
    )
    facing = reach.irradiance * share.to(reach.irradiance.dtype).unsqueeze(-1)
    found = reach._replace(irradiance=facing)
    return found if facing.dtype == dtype else Arrival(*(narrow(t, dtype) for t in found))


@final
class SpotSource(AbstractSource):
    """Near lamps that shine into a cone.

    Args:
        position: `light 3` or `batch light 3` (or one bare 3-vector), m.
        axis: the same shape, the direction the cone points to, away from the lamp.
        intensity: `light channel` or `batch light channel`, W/sr on the axis.
        inner_cone: `light 1` or `batch light 1` (or one number), radians, 0..outer_cone.
        outer_cone: the same shape, radians, inner_cone..pi/2.
        learnable: keep all five as `nn.Parameter`s.

    Raises:
        OutOfRangeError: cones not in 0 <= inner <= outer <= pi/2 (degrees, for example).
        DegenerateGeometryError: an axis without direction.

    >>> lamp = SpotSource([0, 0, 2.0], [0, 0, -1.0], [8.0])
    >>> lamp(torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]])).irradiance
    tensor([[[2.]]])
    """

    position: Tensor
    axis: Tensor
    intensity: Tensor
    inner_cone: Tensor
    outer_cone: Tensor

    def __init__(
        self,
        position: object,
        axis: object,
        intensity: object,
        inner_cone: object = 0.0,
        outer_cone: object = math.pi / 4,
        *,
        learnable: bool = False,
    ) -> None:
        super().__init__()
        self._hold("position", position, learnable, last=3)
        self._hold("axis", axis, learnable, last=3)
        self._hold("intensity", intensity, learnable, least=0)
        self._hold("inner_cone", inner_cone, learnable, last=1)
        self._hold("outer_cone", outer_cone, learnable, last=1)
        _check_axis(self.axis)
        _check_cones(self.inner_cone.detach(), self.outer_cone.detach())

    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
    ) -> Arrival:
        return spot_arrival(
            self.position,
            self.axis,
            self.intensity,
            self.inner_cone,
            self.outer_cone,
            self._near(position),
        )

    def extra_repr(self) -> str:
        return (
            f"lights={self.position.shape[-2]}, position [m], axis [1], intensity [W/sr], "
            "inner_cone [rad], outer_cone [rad]"
        )


def _check_axis(axis: Tensor) -> None:
    if not (axis.detach() != 0).any(-1).all():
        raise DegenerateGeometryError(
            "axis", "the zero vector", "pass the direction that the cone points to"
        )


def _check_cones(inner: Tensor, outer: Tensor) -> None:
    """0 <= inner <= outer <= pi/2, with the likeliest mistake named."""
    # pi/2 rounded to the dtype may lie above math.pi / 2 (it does in float32)
    largest = torch.tensor(math.pi / 2, dtype=outer.dtype).item()
    for name, angle in (("inner_cone", inner), ("outer_cone", outer)):
        if (angle > largest).any():
            raise OutOfRangeError(
                name,
                f"{angle.max().item():g}",
                "give radians, at most pi/2 (math.radians turns degrees into them)",
            )
        if (angle < 0).any():
            raise OutOfRangeError(name, f"{angle.min().item():g}", "give radians, at least 0")
    if (inner > outer).any():
        got = f"{inner.max().item():g} rad beside an outer_cone of {outer.min().item():g} rad"
        raise OutOfRangeError("inner_cone", got, "make it at most outer_cone")
