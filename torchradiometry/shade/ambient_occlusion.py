"""Ambient occlusion on a depth map: how much of the sky each pixel sees, and where it is.

    V(x) = 1/pi  integral over the visible sky of  max(0, n . w) dw          0..1
    b(x) = mean direction of the visible sky, weighted by the cosine; unit

V is what `AmbientShading` multiplies under a uniform dome; under light that varies slowly with
direction (spherical harmonics) the irradiance is close to V E(b).

See `transport.depth_maps.sky` for the equations: closed forms along each azimuth.

References: as `transport.depth_maps.horizons`; H. Landis, "Production-Ready Global Illumination",
SIGGRAPH 2002 course 16 (bent normals).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import ShapeError, require_whole
from torchradiometry.geometry.image_space import checked_size, height_field, image_normals, view_of
from torchradiometry.numerics import single
from torchradiometry.shade.layout import check_image
from torchradiometry.transport.depth_maps.horizons import sliced_pixels
from torchradiometry.transport.depth_maps.sky import horizon, open_sky

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AmbientOcclusion", "ambient_occlusion"]


def ambient_occlusion(
    depth: Float[Tensor, "B 1 H W"],
    intrinsics: Float[Tensor, "B 3 3"] | None = None,
    pixel_size: float | Tensor | None = None,
    normal: Float[Tensor, "B 3 H W"] | None = None,
    *,
    azimuths: int = 8,
    reach: int | None = None,
) -> tuple[Float[Tensor, "B 1 H W"], Float[Tensor, "B 3 H W"]]:
    """Sky visibility, 0..1, and the unit bent normal.

    Args:
        depth: m along the viewing axis; NaN or infinite where nothing is seen.
        intrinsics: `3 3` or `B 3 3` of a pinhole camera.
        pixel_size: side of a pixel of a parallel camera, m; one of the two.
        normal: unit; None: `depth_to_normals`.
        azimuths: half-slices through each pixel.
        reach: how many pixels far a horizon is looked for; None is across the map.

    Returns:
        Both 0 where nothing is seen.

    Raises:
        DTypeError: depth that is not floating-point.
        ShapeError: wrong axes or sizes, both or neither of `intrinsics` and `pixel_size`, or
            no reach in a graph whose height and width stay dynamic.

    Differentiable in: depth, normal, the camera. Kinks where the highest point of a horizon
        changes.
    Export: compile yes, ONNX yes; batch, height and width may stay dynamic with a `reach`.

    References: see the module.
    """
    view = view_of(depth, intrinsics, pixel_size)
    field = height_field(depth, view.perspective)
    if normal is None:
        normal = image_normals(field, view)
    else:
        check_image("normal", normal, 3, depth)
        (normal,) = single(normal)
        normal = torch.where(field.seen.unsqueeze(1), normal, 0)
    size = depth.shape[-2:]
    if reach is None:
        if torch.compiler.is_exporting():
            raise ShapeError("reach", "None", "pass a number of pixels: exported graphs fix it")
        reach = max(max(size) - 1, 1)
    pixels = sliced_pixels(field, view, normal, azimuths)
    share, bent = open_sky(pixels, horizon(field, pixels, reach))
    image = torch.cat((share.unsqueeze(0), bent)).permute(2, 0, 1).unflatten(-1, size)
    image = (image * field.seen.unsqueeze(1)).to(depth.dtype)
    return image[:, :1], image[:, 1:]


@final
class AmbientOcclusion(nn.Module):
    """Image layer: depth map in, sky visibility `B 1 H W` and bent normal `B 3 H W` out.

    Args:
        azimuths: half-slices through each pixel, >= 4.
        reach: how many pixels far a horizon is looked for; None is across the map.
        pixel_size: side of a pixel of a parallel camera, m; None for a pinhole, whose `intrinsics`
            are then passed to `forward`.

    Raises:
        OutOfRangeError: too few azimuths or pixels.

    >>> share, bent = AmbientOcclusion(pixel_size=0.1)(torch.ones(1, 1, 4, 4))
    >>> share.min().item(), bent[0, :, 0, 0].tolist()  # a plane sees the whole sky
    (1.0, [0.0, 0.0, 1.0])
    """

    def __init__(
        self, azimuths: int = 8, reach: int | None = None, *, pixel_size: float | None = None
    ) -> None:
        super().__init__()
        require_whole("azimuths", azimuths, 4, 2**12)
        if reach is not None:
            require_whole("reach", reach, 1)
        self.azimuths, self.reach = azimuths, reach
        self.pixel_size = checked_size(pixel_size)

    def forward(
        self,
        depth: Float[Tensor, "B 1 H W"],
        intrinsics: Float[Tensor, "B 3 3"] | None = None,
        normal: Float[Tensor, "B 3 H W"] | None = None,
    ) -> tuple[Float[Tensor, "B 1 H W"], Float[Tensor, "B 3 H W"]]:
        """Sky visibility and bent normal; see `ambient_occlusion`."""
        return ambient_occlusion(
            depth, intrinsics, self.pixel_size, normal, azimuths=self.azimuths, reach=self.reach
        )

    def extra_repr(self) -> str:
        return (
            f"azimuths={self.azimuths}, reach={self.reach} [px], pixel_size={self.pixel_size} [m]"
        )
