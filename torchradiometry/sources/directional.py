"""Distant source: parallel light, the same direction and irradiance at every point.

    E_facing = E0,   wi = d,   r = infinity

The limit of a point source moved away while its power grows: the sun on a scene.

References: D. Forsyth and J. Ponce, *Computer Vision: A Modern Approach*, 2nd ed. (2011), 2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import require_axes
from torchradiometry.numerics import (
    alike,
    narrow,
    safe_normalize,
    single,
)
from torchradiometry.sources.base import AbstractSource, Arrival, check_batch, light_first

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["DirectionalSource", "directional_arrival", "directional_irradiance"]


def directional_arrival(
    direction: Float[Tensor, "*batch light 3"],
    irradiance: Float[Tensor, "*batch light channel"],
    normal: Float[Tensor, "*batch point 3"],
) -> Arrival:
    """Light of distant sources at points with the given normals.

    Args:
        direction: to the source; need not be unit, the zero vector gives no light.
        irradiance: W/m2 on a plane that faces the source, >= 0.
        normal: only its shape is used.

    Returns:
        The arrival; distance is infinite.

    Differentiable in: direction, irradiance.
    Export: compile yes, ONNX yes.
    """
    require_axes("normal", normal, 3)
    towards = light_first(safe_normalize(direction), normal).expand(-1, *normal.shape[:-1], 3)
    facing = light_first(irradiance, normal)
    facing = facing.expand(-1, *normal.shape[:-1], irradiance.shape[-1])
    return Arrival(towards, facing, torch.full_like(towards[..., 0], torch.inf))


def directional_irradiance(
    direction: Float[Tensor, "*batch light 3"],
    irradiance: Float[Tensor, "*batch light channel"],
    normal: Float[Tensor, "*batch point 3"],
    visibility: Float[Tensor, "light *batch point"] | None = None,
) -> Float[Tensor, "*batch point channel"]:
    """E = sum over lights of E0 max(0, n . d) V, as two matrix products.

    The products are written transposed (`light 3 @ 3 point`, `channel light @ light point`),
    so an image that was permuted to points is neither copied nor strided on the way.

    Args:
        direction: to the source; need not be unit.
        irradiance: W/m2 on a plane that faces the source, >= 0.
        normal: unit.
        visibility: 0..1.

    Returns:
        W/m2.

    Differentiable in: all arguments; at the horizon the gradient is 0.
    Export: compile yes, ONNX yes.

    >>> up, sun = torch.tensor([[0.0, 0.0, 1.0]]), torch.tensor([[0.6, 0.0, 0.8]])
    >>> directional_irradiance(sun, torch.tensor([[10.0]]), up)
    tensor([[8.]])
    """
    require_axes("direction", direction, None, 3)
    require_axes("irradiance", irradiance, None, None)
    require_axes("normal", normal, None, 3)
    check_batch(direction, normal)
    dtype = normal.dtype
    direction, irradiance, normal = alike(*single(direction, irradiance, normal))
    cosine = torch.relu_(safe_normalize(direction) @ normal.mT)  # in place: fresh memory is slow
    if visibility is not None:
        cosine = (cosine * visibility.movedim(0, -2)).to(irradiance.dtype)
    return narrow((irradiance.mT @ cosine).mT, dtype)


@final
class DirectionalSource(AbstractSource):
    """Distant lights.

    Args:
        direction: `light 3` or `batch light 3` (or one bare 3-vector), to the source.
        irradiance: `light channel` or `batch light channel`, W/m2 on a facing plane.
        learnable: keep both as `nn.Parameter`s.

    >>> sun = DirectionalSource([0.0, 0.0, 1.0], [3.0])
    >>> sun(None, torch.tensor([[0.0, 0.0, 1.0]])).irradiance
    tensor([[[3.]]])
    """

    needs_position = False
    direction: Tensor
    irradiance: Tensor

    def __init__(self, direction: object, irradiance: object, *, learnable: bool = False) -> None:
        super().__init__()
        self._hold("direction", direction, learnable, last=3)
        self._hold("irradiance", irradiance, learnable, least=0)

    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
    ) -> Arrival:
        return directional_arrival(self.direction, self.irradiance, normal)

    def irradiance_on(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
        visibility: Float[Tensor, "light *batch point"] | None = None,
    ) -> Float[Tensor, "*batch point channel"]:
        return directional_irradiance(self.direction, self.irradiance, normal, visibility)

    def extra_repr(self) -> str:
        return f"lights={self.direction.shape[-2]}, direction [1], irradiance [W/m2]"
