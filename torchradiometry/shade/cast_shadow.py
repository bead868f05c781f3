"""Cast shadows on a depth map, as a visibility that other layers take.

    V(x, light) = 1 where nothing of the surface lies between the pixel's point and the light

Directional, near point, spot and area sources; see `transport.depth_maps.shadows` for the
equations. Hard shadows are exact on the triangles between neighbouring pixels and have no
gradient. With `width` each light is shaded as a disc of that angular radius, which is
continuous and differentiable: the penumbra of a light of that size behind a straight edge.

An area source casts the shadow of its middle; with `samples` it is many lights, each with its
own shadow, and their sum is its penumbra. Light without direction (domes) is not hidden here:
that is `AmbientOcclusion`'s business.

References: as `transport.depth_maps.shadows`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import ShapeError, require_between
from torchradiometry.geometry.depth import depth_to_points
from torchradiometry.geometry.image_space import checked_size, height_field, image_normals, view_of
from torchradiometry.numerics import single
from torchradiometry.shade.layout import check_sources, chosen_sources, to_points
from torchradiometry.sources.base import AbstractSource
from torchradiometry.transport.depth_maps.shadows import hard_shadows, soft_shadows

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["CastShadow", "cast_shadows"]


def cast_shadows(
    depth: Float[Tensor, "B 1 H W"],
    sources: Sequence[AbstractSource],
    intrinsics: Float[Tensor, "B 3 3"] | None = None,
    pixel_size: float | Tensor | None = None,
    width: float | None = None,
) -> Float[Tensor, "B light H W"]:
    """Visibility of every light from every pixel, 0..1.

    Args:
        depth: m along the viewing axis; NaN or infinite where nothing is seen.
        sources: in the camera frame (x right, y up, z to the camera), m.
        intrinsics: `3 3` or `B 3 3` of a pinhole camera.
        pixel_size: side of a pixel of a parallel camera, m; one of the two.
        width: angular radius of a light in radians; None for hard shadows.

    Returns:
        The lights of all sources in their order, as `LambertianShading` takes them; 0 where
        nothing is seen. Pixels that face away from a light may be reported either way: there the
        cosine is 0.

    Raises:
        DTypeError: depth that is not floating-point, or sources of another dtype or device.
        ShapeError: wrong axes, or both or neither of `intrinsics` and `pixel_size`.

    Differentiable in: with a width, depth, the sources and the camera.
    Export: compile yes, ONNX yes; batch, height and width may stay dynamic.

    References: see the module.

    >>> from torchradiometry.sources.directional import DirectionalSource
    >>> wall = torch.tensor([[[[5.0, 5.0, 5.0, 2.0]]]])
    >>> from_the_right = DirectionalSource([0.6, 0.0, 0.8], [1.0])
    >>> cast_shadows(wall, [from_the_right], pixel_size=1.0)[0, 0]
    tensor([[1., 0., 0., 1.]])
    """
    if len(sources) == 0:
        raise ShapeError("sources", "an empty list", "pass at least one source")
    view = view_of(depth, intrinsics, pixel_size)
    field = height_field(depth, view.perspective)
    facing, places = image_normals(field, view).to(depth.dtype), None
    if any(source.needs_position for source in sources):
        # any finite place will do where nothing is seen
        held = torch.where(field.seen.unsqueeze(1), depth, 1)
        places = depth_to_points(held, intrinsics, pixel_size)
    check_sources(sources, facing, places)
    normal, points = to_points(facing), None if places is None else to_points(places)
    found = []
    for source in sources:
        if not source.has_direction:
            found.append(field.seen.to(depth.dtype).expand(source.lights, *field.seen.shape))
            continue
        arrival = source(points if source.needs_position else None, normal)
        batch = normal.shape[:2]
        direction = arrival.direction.expand(-1, *batch, 3).unflatten(2, depth.shape[-2:])
        distance = arrival.distance.expand(-1, *batch).unflatten(2, depth.shape[-2:])
        direction, distance = single(direction, distance)
        x, y, z = direction.unbind(-1)
        light = (field, view, (x, y, z), distance)
        found.append(hard_shadows(*light) if width is None else soft_shadows(*light, width))
    return torch.cat(found).transpose(0, 1).to(depth.dtype)


@final
class CastShadow(nn.Module):
    """Image layer: depth map in, visibility of each light out.

    Args:
        sources: lights that belong to the layer; None: pass sources with each call.
        width: angular radius of a light in radians, 0 < width < pi/2, for shadows with gradients;
            None for hard ones.
        pixel_size: side of a pixel of a parallel camera, m; None for a pinhole, whose `intrinsics`
            are then passed to `forward`.

    Raises:
        OutOfRangeError: a width outside its range.
    """

    def __init__(
        self,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
        *,
        width: float | None = None,
        pixel_size: float | None = None,
    ) -> None:
        super().__init__()
        if width is not None:
            require_between("width", width, 0, 1.57, "radians, 0 < width < pi/2, or None")
        self.width, self.pixel_size = width, checked_size(pixel_size)
        self.sources = nn.ModuleList([] if sources is None else chosen_sources([], sources))

    def forward(
        self,
        depth: Float[Tensor, "B 1 H W"],
        intrinsics: Float[Tensor, "B 3 3"] | None = None,
        sources: AbstractSource | Sequence[AbstractSource] | None = None,
    ) -> Float[Tensor, "B light H W"]:
        """Visibility `B light H W`; see `cast_shadows`."""
        chosen = chosen_sources(self.sources, sources)
        return cast_shadows(depth, chosen, intrinsics, self.pixel_size, self.width)

    def extra_repr(self) -> str:
        kind = "hard" if self.width is None else f"width={self.width} [rad]"
        return f"depth [m], {kind}, pixel_size={self.pixel_size} [m] -> visibility [1]"
