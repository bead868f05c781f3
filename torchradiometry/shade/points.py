"""Shading of surface points: any material under any list of sources.

    L(wo) = sum over lights of  f_r(wi, wo) E_facing max(0, n . wi) V

the reflected part of the rendering equation for light that comes straight from the sources.
Light without direction (`has_direction=False`, domes) meets the diffuse part of the material
only: L = rho_d / pi * E.

References: J. T. Kajiya, "The Rendering Equation", SIGGRAPH (1986), eq. 1; F. E. Nicodemus et
al., NBS Monograph 160 (1977), eq. 3-5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, final

import torch
from torch import nn

from torchradiometry.errors import DTypeError, ShapeError, require_axes, require_device
from torchradiometry.materials.base import AbstractMaterial
from torchradiometry.numerics import clamped_cosine, narrow, single
from torchradiometry.shade.layout import chosen_sources
from torchradiometry.sources.base import AbstractSource

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

__all__ = ["PointShading", "shade_points"]


def shade_points(
    material: AbstractMaterial,
    sources: Sequence[AbstractSource],
    position: Float[Tensor, "*batch point 3"] | None,
    normal: Float[Tensor, "*batch point 3"],
    outgoing_direction: Float[Tensor, "*batch point 3"],
    visibility: Float[Tensor, "light *batch point"] | None = None,
) -> Float[Tensor, "*batch point channel"]:
    """Radiance that leaves points towards the eye, W/m2/sr.

    Args:
        material: its parameters broadcast against the points (`point channel`, or one for all).
        sources: at least one.
        position: m; None where all sources are distant.
        normal: unit.
        outgoing_direction: unit, to the eye.
        visibility: 0..1, the lights of all sources in their order.

    Returns:
        Linear radiance; where the eye is below the surface 0, except for light without
        direction, which has no material lobe to ask.

    Raises:
        ShapeError: a near source without positions; a wrong number of lights or points.

    Differentiable in: all tensors, the parameters of material and sources.
    Export: compile yes, ONNX yes.
    """
    _check(sources, position, normal, outgoing_direction, visibility)
    total: Tensor | None = None
    first, dtype = 0, normal.dtype
    normal, outgoing_direction = single(normal, outgoing_direction)
    position = None if position is None else single(position)[0]
    visibility = None if visibility is None else single(visibility)[0]
    for source in sources:
        share = None if visibility is None else visibility[first : first + source.lights]
        first = first + source.lights
        part = _one_source(material, source, position, normal, outgoing_direction, share)
        total = part if total is None else total + part
    if total is None:
        raise ShapeError("sources", "an empty list", "pass at least one source")
    return narrow(total, dtype)


def _one_source(
    material: AbstractMaterial,
    source: AbstractSource,
    position: Tensor | None,
    normal: Tensor,
    outgoing_direction: Tensor,
    visibility: Tensor | None,
) -> Tensor:
    if not source.has_direction:
        diffuse = material.diffuse_albedo()
        received = source.irradiance_on(position, normal, visibility)
        return received * (torch.zeros_like(received) if diffuse is None else diffuse / math.pi)
    arrival = source(position, normal)
    weight = clamped_cosine(normal, arrival.direction)
    weight = weight if visibility is None else weight * visibility
    brdf = material(arrival.direction, outgoing_direction, normal)
    return (brdf * arrival.irradiance * weight.unsqueeze(-1)).sum(0)


def _check(
    sources: Sequence[AbstractSource],
    position: Tensor | None,
    normal: Tensor,
    outgoing_direction: Tensor,
    visibility: Tensor | None,
) -> None:
    points = {"normal": normal, "outgoing_direction": outgoing_direction}
    for where, tensor in (points if position is None else points | {"position": position}).items():
        require_axes(where, tensor, 3)
        if tensor.dtype != normal.dtype:
            got = f"{tensor.dtype} beside normals in {normal.dtype}"
            raise DTypeError(where, got, "bring all to one dtype")
        require_device(where, tensor, "normals", normal)
    near = [type(source).__name__ for source in sources if source.needs_position]
    if near and position is None:
        raise ShapeError("position", "None", f"{near[0]} is a near source; pass positions in m")
    for held in (t for source in sources for t in source.state_dict().values()):
        require_device("sources", held, "normals", normal)
    lights = sum(source.lights for source in sources)
    if visibility is not None and visibility.shape[0] != lights:
        raise ShapeError(
            "visibility", f"{visibility.shape[0]} lights", f"the sources hold {lights} lights"
        )


@final
class PointShading(nn.Module):
    """Scene layer: one material under given lights, at surface points.

    Args:
        material: how the surface reflects.
        sources: what shines; their learnable tensors and the material's are the layer's.

    >>> from torchradiometry.materials.lambertian import Lambertian
    >>> from torchradiometry.sources.directional import DirectionalSource
    >>> layer = PointShading(Lambertian([math.pi / 4]), DirectionalSource([0.0, 0.0, 1.0], [2.0]))
    >>> up = torch.tensor([[0.0, 0.0, 1.0]])
    >>> layer(None, up, up)
    tensor([[0.5000]])
    """

    def __init__(
        self, material: AbstractMaterial, sources: AbstractSource | Sequence[AbstractSource]
    ) -> None:
        super().__init__()
        self.material = material
        self.sources = nn.ModuleList(chosen_sources([], sources))

    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
        outgoing_direction: Float[Tensor, "*batch point 3"],
        visibility: Float[Tensor, "light *batch point"] | None = None,
    ) -> Float[Tensor, "*batch point channel"]:
        """Radiance in W/m2/sr; see `shade_points` for the arguments."""
        chosen = chosen_sources(self.sources, None)
        return shade_points(self.material, chosen, position, normal, outgoing_direction, visibility)

    def extra_repr(self) -> str:
        return "position [m], normal [1] -> radiance [W/m2/sr]"
