"""Ambient dome: the same radiance from everywhere, or from the half of space around `up`.

    everywhere   E = pi L
    half sky     E = pi L (1 + n . up) / 2

The second is the share of the half sky that a tilted surface sees. Nothing is occluded; the
shader multiplies ambient occlusion where it has it.

References: B. Y. H. Liu and R. C. Jordan, "The interrelationship and characteristic
distribution of direct, diffuse and total solar radiation", Solar Energy 4 (1960): the isotropic
sky on a tilted surface; D. Forsyth and J. Ponce, *Computer Vision: A Modern Approach*, 2nd ed.
(2011), 2.2.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import require_floating
from torchradiometry.numerics import dot, narrow, safe_normalize, single
from torchradiometry.sources.base import AbstractSource, Arrival, light_first

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AmbientDome", "dome_arrival"]


def dome_arrival(
    radiance: Float[Tensor, "*batch light channel"],
    normal: Float[Tensor, "*batch point 3"],
    up: Float[Tensor, "*batch light 3"] | None = None,
) -> Arrival:
    """Light of uniform domes: reported along the normal, so cosine 1 applies.

    Args:
        radiance: W/m2/sr, >= 0.
        normal: unit.
        up: middle of the half sky, need not be unit; None = radiance from everywhere.

    Returns:
        The arrival; direction = normal, distance infinite.

    Differentiable in: radiance, up, normal.
    Export: compile yes, ONNX yes.
    References: Liu and Jordan (1960).

    >>> level = torch.tensor([[0.0, 1.0, 0.0]])
    >>> dome_arrival(torch.tensor([[2.0]]), level).irradiance / torch.pi
    tensor([[[2.]]])
    """
    require_floating("normal", normal)
    inner, radiance = single(normal, radiance)
    share = torch.ones_like(inner[..., :1])
    if up is not None:
        towards = light_first(safe_normalize(*single(up)), normal)
        share = (1 + dot(towards, inner).unsqueeze(-1)).clamp(min=0) / 2
    # a tensor: the ONNX exporter would round a Python number to float32
    pi = torch.tensor(math.pi, dtype=inner.dtype, device=inner.device)
    irradiance = narrow(pi * light_first(radiance, normal) * share, normal.dtype)
    direction = normal.expand(irradiance.shape[0], *normal.shape)
    return Arrival(direction, irradiance, torch.full_like(direction[..., 0], torch.inf))


@final
class AmbientDome(AbstractSource):
    """Uniform ambient light.

    Args:
        radiance: `light channel` or `batch light channel`, W/m2/sr, >= 0.
        up: `light 3` or `batch light 3` (or one bare 3-vector): only the half of space
            around it shines. None: all of it.
        learnable: keep them as `nn.Parameter`s.

    Raises:
        OutOfRangeError: a negative radiance.

    >>> sky = AmbientDome([1.0], up=[0.0, 1.0, 0.0])
    >>> sky(None, torch.tensor([[1.0, 0.0, 0.0]])).irradiance / torch.pi  # a wall sees half
    tensor([[[0.5000]]])
    """

    has_direction = False
    needs_position = False
    radiance: Tensor
    up: Tensor | None

    def __init__(
        self, radiance: object, up: object | None = None, *, learnable: bool = False
    ) -> None:
        super().__init__()
        self._hold("radiance", radiance, learnable, least=0)
        if up is None:
            self.register_buffer("up", None)
        else:
            self._hold("up", up, learnable, last=3)

    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
    ) -> Arrival:
        return dome_arrival(self.radiance, normal, self.up)

    def extra_repr(self) -> str:
        half = "everywhere" if self.up is None else "half sky, up [1]"
        return f"lights={self.radiance.shape[-2]}, radiance [W/m2/sr], {half}"
