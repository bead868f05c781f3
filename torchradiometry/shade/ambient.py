"""Ambient shading: one radiance from everywhere, in place of all light not followed.

    L = rho * L_a * V_a                (uniform ambient radiance L_a)
    L = rho / pi * E(n) * V_a          (a dome: E depends on the normal)

With L_a equal from the whole hemisphere E = pi L_a, so pi cancels. V_a is the share of the
ambient light that reaches the pixel (ambient occlusion; cosine-weighted in 0..1).

It stands for interreflection where that is not computed. Left out: light that bounced off
the surface under the occluder (V_a > 0 in a white corner is too dark, by up to the factor
1/(1 - rho)), colour that a neighbour lends, any dependence on direction, highlights.

References: D. Forsyth and J. Ponce, *Computer Vision: A Modern Approach*, 2nd ed. (2011),
2.1.4 (ambient illumination); M. S. Langer and H. H. Buelthoff, "Depth discrimination from
shading under diffuse lighting", Perception 29 (2000).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, final

from torch import Tensor, nn

from torchradiometry.arguments import as_numbers
from torchradiometry.errors import DTypeError, ShapeError, require_device, require_floating
from torchradiometry.materials.base import check_range
from torchradiometry.shade.lambertian import check_channels, image_irradiance
from torchradiometry.shade.layout import check_image, chosen_sources
from torchradiometry.sources.base import AbstractSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AmbientShading", "ambient_shading"]


def ambient_shading(
    albedo: Float[Tensor, "B C H W"],
    radiance: Float[Tensor, "B C"] | Float[Tensor, "C"] | Float[Tensor, "B C H W"],
    visibility: Float[Tensor, "B 1 H W"] | None = None,
) -> Float[Tensor, "B C H W"]:
    """L = albedo * ambient radiance * ambient visibility, W/m2/sr.

    Args:
        albedo: 0..1.
        radiance: W/m2/sr from every direction: one for all images, one per image or a map.
        visibility: share of the ambient light that arrives, 0..1; None is 1.

    Returns:
        Linear radiance.

    Raises:
        ShapeError: another rank, channel count or size.

    Differentiable in: all arguments.
    Export: compile yes, ONNX yes.

    >>> import torch
    >>> ambient_shading(torch.full((1, 1, 1, 1), 0.5), torch.tensor([3.0])).item()
    1.5
    """
    check_image("albedo", albedo)
    require_floating("radiance", radiance)
    require_device("radiance", radiance, "albedo", albedo)
    if radiance.ndim in (1, 2):
        radiance = radiance.reshape(*radiance.shape, 1, 1)
        radiance = radiance if radiance.ndim == 4 else radiance.unsqueeze(0)
    if radiance.ndim != 4:
        got = f"a tensor of shape {tuple(radiance.shape)}"
        raise ShapeError("radiance", got, "pass C, B x C or B x C x H x W")
    check_channels("albedo", albedo, radiance)
    ambient = albedo * radiance
    return ambient if visibility is None else ambient * _checked(visibility, albedo)


def _checked(visibility: Tensor, like: Tensor) -> Tensor:
    check_image("visibility", visibility, 1, like)
    return visibility


@final
class AmbientShading(nn.Module):
    """Image layer: a diffuse surface in light from everywhere.

    Args:
        radiance: ambient radiance in W/m2/sr, `C` or `B C`.
        sources: in its place, sources whose irradiance depends on the normal (`AmbientDome`,
            `HarmonicSource`). Exactly one of the two, here or in the call.
        learnable: keep `radiance` as an `nn.Parameter`.

    >>> import torch
    >>> layer = AmbientShading(radiance=[2.0])
    >>> layer(torch.full((1, 3, 1, 1), 0.5)).flatten()
    tensor([1., 1., 1.])
    """

    radiance: Tensor | None

    def __init__(
        self,
        radiance: object = None,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
        *,
        learnable: bool = False,
    ) -> None:
        super().__init__()
        if radiance is not None and sources is not None:
            raise DTypeError("AmbientShading", "radiance and sources", "pass one of the two")
        self.sources = nn.ModuleList([] if sources is None else chosen_sources([], sources))
        if radiance is None:
            self.radiance = None
            return
        tensor = as_numbers("radiance", radiance).detach()
        check_range("radiance", tensor, lowest=0.0)
        tensor = tensor.reshape(1) if tensor.ndim == 0 else tensor
        if learnable:
            self.radiance = nn.Parameter(tensor.clone())
        else:
            self.register_buffer("radiance", tensor)

    def forward(
        self,
        albedo: Float[Tensor, "B C H W"],
        normal: Float[Tensor, "B 3 H W"] | None = None,
        visibility: Float[Tensor, "B 1 H W"] | None = None,
        radiance: Float[Tensor, "B C"] | None = None,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
    ) -> Float[Tensor, "B C H W"]:
        """Radiance `B C H W` in W/m2/sr.

        Args:
            albedo: 0..1.
            normal: unit; needed with sources only.
            visibility: ambient visibility (occlusion), 0..1.
            radiance: ambient radiance where the constructor was given neither.
            sources: domes where the constructor was given neither.
        """
        held = self.radiance
        if held is not None and (radiance is not None or sources is not None):
            raise DTypeError("radiance", "a second ambient light", "pass it in one place")
        ambient = radiance if held is None else held
        if ambient is not None:
            return ambient_shading(albedo, ambient, visibility)
        received = self._received(normal, sources)
        return ambient_shading(albedo, received / math.pi, visibility)

    def _received(
        self, normal: Tensor | None, sources: AbstractSource | Sequence[AbstractSource] | None
    ) -> Tensor:
        chosen = chosen_sources(self.sources, sources)
        if normal is None:
            raise ShapeError("normal", "None", "pass B x 3 x H x W: a dome shines by the normal")
        return image_irradiance(normal, chosen)

    def extra_repr(self) -> str:
        return "albedo [1], ambient radiance [W/m2/sr] -> radiance [W/m2/sr]"
