"""Lambertian shading: the cosine law on a diffuse surface, pixel by pixel.

    L = rho / pi * E,    E = sum over lights of  E_facing max(0, n . wi) V

L radiance [W/m2/sr], rho albedo [1], E irradiance on the surface [W/m2], E_facing irradiance
on a plane that faces the light [W/m2], n normal, wi direction to the light, V visibility.

A local model: light that other surfaces reflect is left out (`AmbientShading` guesses it,
`RadiosityShading` computes it).

References: J. H. Lambert, *Photometria* (1760); D. Forsyth and J. Ponce, *Computer Vision: A
Modern Approach*, 2nd ed. (2011), 2.1-2.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import ShapeError
from torchradiometry.numerics import narrow, single
from torchradiometry.shade.layout import (
    check_image,
    check_sources,
    chosen_sources,
    to_image,
    to_points,
    visibility_to_points,
)
from torchradiometry.sources.base import AbstractSource, arriving_irradiance
from torchradiometry.sources.directional import DirectionalSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["LambertianShading", "diffuse_radiance", "image_irradiance", "lambertian_shading"]


def image_irradiance(
    normal: Float[Tensor, "B 3 H W"],
    sources: Sequence[AbstractSource],
    position: Float[Tensor, "B 3 H W"] | None = None,
    visibility: Float[Tensor, "B light H W"] | None = None,
) -> Float[Tensor, "B channel H W"]:
    """E on the surface at every pixel, W/m2.

    Args:
        normal: unit; zero where nothing is seen (E is 0 there).
        sources: at least one.
        position: m, in the frame of the sources; None where all of them are distant.
        visibility: 0..1, the lights of all sources in their order.

    Returns:
        One channel, or as many as the sources have.

    Raises:
        ShapeError: another rank, channel count, size or number of lights.

    Differentiable in: normal, position, visibility, the parameters of the sources. The kink
        at the horizon has gradient 0.
    Export: compile yes, ONNX yes.
    """
    return narrow(received_irradiance(normal, sources, position, visibility), normal.dtype)


def received_irradiance(
    normal: Float[Tensor, "B 3 H W"],
    sources: Sequence[AbstractSource],
    position: Float[Tensor, "B 3 H W"] | None,
    visibility: Float[Tensor, "B light H W"] | None,
) -> Float[Tensor, "B channel H W"]:
    """`image_irradiance` in float32 at least: the radiance may fit where it does not."""
    check_image("normal", normal, 3)
    check_sources(sources, normal, position)
    if visibility is not None:
        check_image("visibility", visibility, None, normal)
        (visibility,) = single(visibility)
    points = None if position is None else single(to_points(position))[0]
    (facing,) = single(to_points(normal))
    received = arriving_irradiance(sources, points, facing, visibility_to_points(visibility))
    return to_image(received, normal)


def lambertian_shading(
    normal: Float[Tensor, "B 3 H W"],
    albedo: Float[Tensor, "B C H W"],
    sources: Sequence[AbstractSource],
    position: Float[Tensor, "B 3 H W"] | None = None,
    visibility: Float[Tensor, "B light H W"] | None = None,
) -> Float[Tensor, "B C H W"]:
    """L = albedo / pi * E at every pixel, W/m2/sr.

    Args:
        normal: unit, x right, y up, z to the camera.
        albedo: 0..1; one channel serves all channels of the light, and the other way round.
        sources: at least one.
        position: m; None where all sources are distant.
        visibility: 0..1, the lights of all sources in their order.

    Returns:
        Linear radiance.

    Raises:
        ShapeError: another rank, channel count, size or number of lights.

    Differentiable in: all tensors and the parameters of the sources; dL/d(albedo) = E/pi also
        where the albedo is 0.
    Export: compile yes, ONNX yes.
    """
    check_image("normal", normal, 3)
    check_image("albedo", albedo, None, normal)
    received = received_irradiance(normal, sources, position, visibility)
    check_channels("albedo", albedo, received)
    if isinstance(sources[0], DirectionalSource) and not torch.is_grad_enabled():
        received = _times(received, albedo)  # matrix products made `received`: nobody holds it
        return narrow(received.mul_(1 / math.pi), albedo.dtype)
    return diffuse_radiance(albedo, received)


def diffuse_radiance(
    albedo: Float[Tensor, "B C H W"], received: Float[Tensor, "B C H W"]
) -> Float[Tensor, "B C H W"]:
    """L = albedo / pi * E, W/m2/sr, of the irradiance that was received.

    Every layer takes this one, so that they agree to the last bit where they agree at all.

    Half precision is multiplied in float32.

    Differentiable in: both.
    Export: compile yes, ONNX yes.
    """
    dtype = albedo.dtype
    albedo, received = single(albedo, received)
    return narrow((albedo * received).mul_(1 / math.pi), dtype)


def _times(received: Tensor, albedo: Tensor) -> Tensor:
    """albedo * received in the memory of `received`: fresh memory is dearer than the product.

    Memory of its own where it does not fit: an albedo of more channels, `torch.func.vmap` over the
    albedo alone.
    """
    (albedo,) = single(albedo)
    if albedo.shape[1] > received.shape[1] or torch.compiler.is_compiling():
        return albedo * received
    try:
        return received.mul_(albedo)
    except RuntimeError:
        return albedo * received


def check_channels(where: str, image: Tensor, received: Tensor) -> None:
    """Raise unless the channels of a map broadcast against those of the light."""
    channels = received.shape[1]
    if image.shape[1] != channels and 1 not in (image.shape[1], channels):
        raise ShapeError(
            where,
            f"{image.shape[1]} channels under light of {channels} channels",
            f"pass 1 or {channels} channels",
        )


@final
class LambertianShading(nn.Module):
    """Image layer: what a camera sees of a diffuse surface under given lights.

    Args:
        sources: lights that belong to the layer; their learnable tensors are the layer's
            parameters. None: pass sources with each call.

    >>> import torch
    >>> from torchradiometry.sources.directional import DirectionalSource
    >>> layer = LambertianShading(DirectionalSource([0.0, 0.6, 0.8], [10.0]))
    >>> normal = torch.tensor([0.0, 0.0, 1.0]).reshape(1, 3, 1, 1)
    >>> layer(normal, torch.full((1, 3, 1, 1), 0.5)).flatten()
    tensor([1.2732, 1.2732, 1.2732])
    """

    def __init__(self, sources: AbstractSource | Sequence[AbstractSource] | None = None) -> None:
        super().__init__()
        self.sources = nn.ModuleList([] if sources is None else chosen_sources([], sources))

    def forward(
        self,
        normal: Float[Tensor, "B 3 H W"],
        albedo: Float[Tensor, "B C H W"],
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
        position: Float[Tensor, "B 3 H W"] | None = None,
        visibility: Float[Tensor, "B light H W"] | None = None,
    ) -> Float[Tensor, "B C H W"]:
        """Radiance `B C H W` in W/m2/sr; see `lambertian_shading` for the arguments."""
        chosen = chosen_sources(self.sources, sources)
        return lambertian_shading(normal, albedo, chosen, position, visibility)

    def extra_repr(self) -> str:
        return "normal [1], albedo [1] -> radiance [W/m2/sr]"
