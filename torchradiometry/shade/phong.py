"""Phong shading: a diffuse base with a highlight, pixel by pixel.

    L = rho / pi * E  +  sum over lights of  f_s(wi, wo) E_facing max(0, n . wi) V

f_s is one of the specular lobes of `materials` in 1/sr: `Phong` (k_s cos^n alpha, the
default), `NormalizedPhong`, `BlinnPhong`, or `OriginalPhong` (without the cosine of incidence,
as the paper has it). Light without direction (domes) has no highlight and feeds the diffuse
part only. An area source makes a highlight as a single light from the direction of its vector
irradiance would: right while the lobe is wider than the source.

The eye: an orthographic camera looks along -z, so wo = (0, 0, 1) everywhere; a perspective
camera at the origin of the positions' frame has wo = -x/|x|.

References: B. T. Phong, "Illumination for Computer Generated Pictures", CACM 18 (1975); D.
Forsyth and J. Ponce, *Computer Vision: A Modern Approach*, 2nd ed. (2011), 2.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, final

from torch import Tensor, nn

from torchradiometry.errors import DTypeError, ShapeError
from torchradiometry.materials.lobes import AbstractLobe, Brdf, product
from torchradiometry.materials.phong import Phong
from torchradiometry.numerics import narrow, safe_normalize, single
from torchradiometry.shade.lambertian import check_channels, lambertian_shading
from torchradiometry.shade.layout import (
    check_image,
    chosen_sources,
    to_image,
    to_points,
    visibility_to_points,
)
from torchradiometry.sources.base import AbstractSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["PhongShading", "phong_shading", "specular_irradiance", "view_directions"]


def view_directions(
    normal: Float[Tensor, "B 3 H W"],
    position: Float[Tensor, "B 3 H W"] | None = None,
    *,
    perspective: bool = False,
) -> Float[Tensor, "B 3 H W"]:
    """Unit directions to the eye: (0, 0, 1), or -x/|x| with a perspective camera at the origin.

    Args:
        normal: only its shape, dtype and device are used.
        position: m, in the camera frame (x right, y up, z to the camera); perspective only.
        perspective: the camera is a pinhole at the origin.

    Raises:
        ShapeError: perspective without positions.

    Differentiable in: position.
    Export: compile yes, ONNX yes.
    """
    check_image("normal", normal, 3)
    if perspective:
        if position is None:
            raise ShapeError("position", "None", "a perspective view needs B x 3 x H x W in m")
        check_image("position", position, 3, normal)
        return -safe_normalize(position.movedim(1, -1)).movedim(-1, 1)
    return normal.new_tensor([0.0, 0.0, 1.0]).reshape(3, 1, 1).expand_as(normal)


def specular_irradiance(
    brdf: Brdf,
    shininess: Float[Tensor, "*batch point 1"],
    sources: Sequence[AbstractSource],
    position: Float[Tensor, "*batch point 3"] | None,
    normal: Float[Tensor, "*batch point 3"],
    outgoing_direction: Float[Tensor, "*batch point 3"],
    visibility: Float[Tensor, "light *batch point"] | None = None,
) -> Float[Tensor, "*batch point channel"]:
    """Sum over lights of lobe * E_facing * cos * V for a lobe of height k_s = 1, W/m2/sr.

    The lobe has no colour, so k_s factors out and only one number per light and point is kept
    beside the light itself; sources are added one after the other.

    Differentiable in: all tensors and the parameters of the sources.
    Export: compile yes, ONNX yes.
    """
    one, first = normal.new_ones(1), 0
    total: Tensor | None = None
    for source in sources:
        share = None if visibility is None else visibility[first : first + source.lights]
        first = first + source.lights
        if not source.has_direction:
            continue
        arrival = source(position, normal)
        weight = brdf(one, shininess, arrival.direction, outgoing_direction, normal)
        weight = weight * product(arrival.direction, normal).relu()
        weight = weight if share is None else weight * share.unsqueeze(-1)
        part = weight.mT * arrival.irradiance.mT  # channel by channel, as images are stored
        part = part.squeeze(0) if part.shape[0] == 1 else part.sum(0)
        total = part if total is None else total + part
    return normal.new_zeros(*normal.shape[:-1], 1) if total is None else total.mT


def phong_shading(
    lobe: type[AbstractLobe],
    normal: Float[Tensor, "B 3 H W"],
    albedo: Float[Tensor, "B C H W"],
    specular: Float[Tensor, "B C H W"],
    shininess: Float[Tensor, "B 1 H W"],
    sources: Sequence[AbstractSource],
    outgoing_direction: Float[Tensor, "B 3 H W"],
    position: Float[Tensor, "B 3 H W"] | None = None,
    visibility: Float[Tensor, "B light H W"] | None = None,
) -> Float[Tensor, "B C H W"]:
    """Diffuse plus specular radiance at every pixel, W/m2/sr.

    Args:
        lobe: `Phong`, `NormalizedPhong`, `BlinnPhong` or `OriginalPhong`.
        normal: unit, x right, y up, z to the camera.
        albedo: 0..1.
        specular: k_s as the lobe takes it.
        shininess: n, >= 0.
        sources: at least one.
        outgoing_direction: unit, to the eye.
        position: m; None where all sources are distant.
        visibility: 0..1, the lights of all sources in their order.

    Returns:
        Linear radiance.

    Raises:
        ShapeError: another rank, channel count, size or number of lights.

    Differentiable in: all tensors and the parameters of the sources. The kinks at the
        horizons of light and eye have finite gradients.
    Export: compile yes, ONNX yes.
    """
    diffuse = lambertian_shading(normal, albedo, sources, position, visibility)
    check_image("specular", specular, None, normal)
    check_image("shininess", shininess, 1, normal)
    check_image("outgoing_direction", outgoing_direction, 3, normal)
    if not any(source.has_direction for source in sources):
        return diffuse
    dtype = diffuse.dtype
    exponent, facing, eye = single(
        *(to_points(image) for image in (shininess, normal, outgoing_direction))
    )
    highlight = specular_irradiance(
        lobe.brdf,
        exponent,
        sources,
        None if position is None else single(to_points(position))[0],
        facing,
        eye,
        None if visibility is None else visibility_to_points(*single(visibility)),
    )
    image = to_image(highlight, normal)
    check_channels("specular", specular, image)
    diffuse, specular = single(diffuse, specular)
    return narrow(diffuse + specular * image, dtype)


@final
class PhongShading(nn.Module):
    """Image layer: what a camera sees of a surface with a highlight.

    Args:
        lobe: the class of the specular lobe: `Phong` (the default), `NormalizedPhong`,
            `BlinnPhong` or `OriginalPhong`.
        sources: lights that belong to the layer; None: pass sources with each call.
        perspective: the camera is a pinhole at the origin of the positions' frame; otherwise
            it is orthographic and looks along -z.

    >>> import torch
    >>> from torchradiometry.sources.directional import DirectionalSource
    >>> layer = PhongShading(sources=DirectionalSource([0.0, 0.0, 1.0], [2.0]))
    >>> normal = torch.tensor([0.0, 0.0, 1.0]).reshape(1, 3, 1, 1)
    >>> grey, shininess = torch.zeros(1, 1, 1, 1), torch.full((1, 1, 1, 1), 50.0)
    >>> layer(normal, grey, grey + 0.25, shininess).item()
    0.5
    """

    def __init__(
        self,
        lobe: type[AbstractLobe] = Phong,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
        *,
        perspective: bool = False,
    ) -> None:
        super().__init__()
        lobes = AbstractLobe.__subclasses__()
        if lobe not in lobes:
            names = ", ".join(member.__name__ for member in lobes)
            raise DTypeError("lobe", f"{lobe!r}", f"pass one of the classes {names}")
        self.lobe, self.perspective = lobe, perspective
        self.sources = nn.ModuleList([] if sources is None else chosen_sources([], sources))

    def forward(
        self,
        normal: Float[Tensor, "B 3 H W"],
        albedo: Float[Tensor, "B C H W"],
        specular: Float[Tensor, "B C H W"],
        shininess: Float[Tensor, "B 1 H W"],
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
        position: Float[Tensor, "B 3 H W"] | None = None,
        visibility: Float[Tensor, "B light H W"] | None = None,
        outgoing_direction: Float[Tensor, "B 3 H W"] | None = None,
    ) -> Float[Tensor, "B C H W"]:
        """Radiance `B C H W` in W/m2/sr; see `phong_shading` for the arguments."""
        chosen = chosen_sources(self.sources, sources)
        check_image("normal", normal, 3)
        if outgoing_direction is None:
            outgoing_direction = view_directions(normal, position, perspective=self.perspective)
        return phong_shading(
            self.lobe,
            normal,
            albedo,
            specular,
            shininess,
            chosen,
            outgoing_direction,
            position,
            visibility,
        )

    def extra_repr(self) -> str:
        eye = "perspective" if self.perspective else "orthographic"
        return f"lobe={self.lobe.__name__}, {eye} -> radiance [W/m2/sr]"
