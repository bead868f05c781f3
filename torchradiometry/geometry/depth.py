"""Depth map -> points -> normals, perspective and orthographic.

    perspective    x = (u - cx) d / fx     y = -(v - cy) d / fy     z = -d
    orthographic   x = (u - W/2) p         y = -(v - H/2) p         z = -d
    normal         n = normalize( t_down x t_right )

d is the distance along the viewing axis in m, positive in front; (u, v) are pixel coordinates
(right, down; the centre of the top-left pixel is (0.5, 0.5)), p is the side of a pixel in m.
Points and normals are in the camera frame: x right, y up, z to the camera.

t_right and t_down are differences of neighbouring points: central where both neighbours are
there, one-sided at the border of the map or of its mask. Both lie in the surface exactly where
it is flat, so the normals of a plane are exact.

A pixel whose depth is NaN or infinite is *masked*: its point is NaN, its normal is zero, its
gradient is zero, and its neighbours do not see it. A pixel without a neighbour in its row or
none in its column has no plane through it; its normal is zero too.

References: R. Hartley and A. Zisserman, *Multiple View Geometry*, 2nd ed. (2004), section 6.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import torch
from kornia.geometry.camera import unproject_points, unproject_points_orthographic
from torch import Tensor, nn
from torch.nn import functional

from torchradiometry.errors import ShapeError, require_floating
from torchradiometry.geometry.image_space import checked_size, height_field, image_normals, view_of
from torchradiometry.numerics import safe_normalize, wide

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = [
    "DepthToNormals",
    "DepthToPoints",
    "depth_to_normals",
    "depth_to_points",
    "points_to_normals",
]


def depth_to_points(
    depth: Float[Tensor, "B 1 H W"],
    intrinsics: Float[Tensor, "B 3 3"] | None = None,
    pixel_size: float | Tensor | None = None,
) -> Float[Tensor, "B 3 H W"]:
    """Points in the camera frame (x right, y up, z to the camera), m.

    Args:
        depth: distance along the viewing axis, m; NaN or infinite where nothing is seen.
        intrinsics: `3 3` or `B 3 3` matrix K of a pinhole camera, in pixels
            (`PinholeCamera.intrinsics`).
        pixel_size: side of a pixel of an orthographic camera, m (1 / `camera.scale`). Give
            one of the two.

    Returns:
        Points; NaN where the depth is masked.

    Raises:
        ShapeError: wrong axes, or both or neither of `intrinsics` and `pixel_size`.

    Differentiable in: depth, intrinsics, pixel_size (if a tensor).
    Export: compile yes, ONNX yes.

    >>> depth_to_points(torch.ones(1, 1, 2, 2), pixel_size=2.0)[0, :, 0]
    tensor([[-1.,  1.],
            [ 1.,  1.],
            [-1., -1.]])
    """
    points, seen = _points(depth, intrinsics, pixel_size)
    return torch.where(seen, points, torch.nan).to(depth.dtype)


def points_to_normals(points: Float[Tensor, "B 3 H W"]) -> Float[Tensor, "B 3 H W"]:
    """Unit normals towards the camera, of points that neighbour each other as pixels do.

    Args:
        points: camera frame, as `depth_to_points` gives them; NaN or infinite where masked.

    Returns:
        Normals (x right, y up, z to the camera); zero where masked or undefined.

    Raises:
        ShapeError: not `B 3 H W`.

    Differentiable in: points.
    Export: compile yes, ONNX yes.
    """
    _require_axes("points", points, 3)
    seen = (points.abs() < torch.inf).all(1, keepdim=True)
    (clean,) = wide(torch.where(seen, points, 0))
    return _normals(clean, seen).to(points.dtype)


def depth_to_normals(
    depth: Float[Tensor, "B 1 H W"],
    intrinsics: Float[Tensor, "B 3 3"] | None = None,
    pixel_size: float | Tensor | None = None,
) -> Float[Tensor, "B 3 H W"]:
    """Unit normals of a depth map, towards the camera; arguments as of `depth_to_points`.

    Normals are those of planes through neighbouring heights in image space (`image_space`), where
    float32 loses none of the digits that the depth map has.

    Returns:
        Normals (x right, y up, z to the camera); zero where masked or undefined.

    Raises:
        ShapeError: wrong axes, or both or neither of `intrinsics` and `pixel_size`.

    Differentiable in: depth, intrinsics, pixel_size (if a tensor).
    Export: compile yes, ONNX yes.

    >>> slope = torch.tensor([[[[3.0, 4.0, 5.0]] * 2]])
    >>> depth_to_normals(slope, pixel_size=1.0)[0, :, 0, 0]
    tensor([0.7071, 0.0000, 0.7071])
    """
    view = view_of(depth, intrinsics, pixel_size)
    return image_normals(height_field(depth, view.perspective), view).to(depth.dtype)


class AbstractDepthLayer(nn.Module):
    """A layer over depth maps of one camera.

    Args:
        pixel_size: side of a pixel, m, for an orthographic camera; None for a pinhole, whose
            `intrinsics` are then the second argument of `forward`.
    """

    def __init__(self, pixel_size: float | None = None) -> None:
        super().__init__()
        self.pixel_size = checked_size(pixel_size)

    def extra_repr(self) -> str:
        return f"depth [m], pixel_size={self.pixel_size} [m]"


@final
class DepthToPoints(AbstractDepthLayer):
    """`depth_to_points` as a layer; `pixel_size` as there, for an orthographic camera."""

    def forward(
        self, depth: Float[Tensor, "B 1 H W"], intrinsics: Float[Tensor, "B 3 3"] | None = None
    ) -> Float[Tensor, "B 3 H W"]:
        """Points `B 3 H W` in m."""
        return depth_to_points(depth, intrinsics, self.pixel_size)


@final
class DepthToNormals(AbstractDepthLayer):
    """`depth_to_normals` as a layer; `pixel_size` as there, for an orthographic camera."""

    def forward(
        self, depth: Float[Tensor, "B 1 H W"], intrinsics: Float[Tensor, "B 3 3"] | None = None
    ) -> Float[Tensor, "B 3 H W"]:
        """Unit normals `B 3 H W`."""
        return depth_to_normals(depth, intrinsics, self.pixel_size)


def _points(
    depth: Tensor, intrinsics: Tensor | None, pixel_size: float | Tensor | None
) -> tuple[Tensor, Tensor]:
    """Points in float64, finite everywhere, and where they were seen (`B 1 H W`)."""
    _require_axes("depth", depth, 1)
    if (intrinsics is None) == (pixel_size is None):
        got = "both or neither"
        raise ShapeError("intrinsics, pixel_size", got, "pass the one that fits the camera")
    seen = depth.abs() < torch.inf
    (clean,) = wide(torch.where(seen, depth, 1))
    clean = clean.permute(0, 2, 3, 1)
    if intrinsics is not None:
        points = unproject_points(_pixels(clean), clean, _matrices(intrinsics, depth))
    else:
        size = torch.as_tensor(pixel_size, dtype=torch.float64, device=depth.device)
        grid = _pixels(clean)
        centre = (grid[:, :1, :1] + grid[:, -1:, -1:]) / 2
        plane = ((grid - centre) * size).expand(clean.shape[0], -1, -1, -1)
        points = unproject_points_orthographic(plane, clean)
    return points.permute(0, 3, 1, 2) * _half_turn(points), seen


def _pixels(like: Tensor) -> Tensor:
    """Centres of the pixels, `1 H W 2`, for `like` of axes `B H W c`."""
    _, height, width, _ = like.shape
    v = torch.arange(height, dtype=like.dtype, device=like.device) + 0.5
    u = torch.arange(width, dtype=like.dtype, device=like.device) + 0.5
    rows, columns = v.unsqueeze(1).expand(height, width), u.unsqueeze(0).expand(height, width)
    return torch.stack((columns, rows), -1).unsqueeze(0)


def _matrices(intrinsics: Tensor, depth: Tensor) -> Tensor:
    """K as `B 1 1 3 3` in float64."""
    require_floating("intrinsics", intrinsics)
    if intrinsics.shape[-2:] != (3, 3) or intrinsics.ndim not in (2, 3):
        got = f"a tensor of shape {tuple(intrinsics.shape)}"
        raise ShapeError("intrinsics", got, "pass `3 3` or `B 3 3`")
    (matrix,) = wide(intrinsics)
    return matrix.reshape(-1, 1, 1, 3, 3).to(depth.device)


def _half_turn(like: Tensor) -> Tensor:
    """From kornia's camera frame (y down, z forward) to ours, over the channel axis."""
    signs = torch.tensor([1.0, -1.0, -1.0], dtype=like.dtype, device=like.device)
    return signs.reshape(1, 3, 1, 1)


def _normals(points: Tensor, seen: Bool[Tensor, "B 1 H W"]) -> Tensor:
    """Normals of finite points; `seen` tells which of them count."""
    down, right = _tangent(points, seen, -2), _tangent(points, seen, -1)
    normal = torch.linalg.cross(down, right, dim=1)
    normal = safe_normalize(normal.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)
    return torch.where(seen, normal, 0)


def _tangent(points: Tensor, seen: Tensor, axis: int) -> Tensor:
    """Next minus previous point along an axis, or whichever half of it exists; else zero."""
    size = points.shape[axis]
    step = points.narrow(axis, 1, size - 1) - points.narrow(axis, 0, size - 1)
    both = seen.narrow(axis, 1, size - 1) & seen.narrow(axis, 0, size - 1)
    step = torch.where(both, step, 0)
    ahead, behind = ((0, 1), (1, 0)) if axis == -1 else ((0, 0, 0, 1), (0, 0, 1, 0))
    return functional.pad(step, ahead) + functional.pad(step, behind)


def _require_axes(name: str, tensor: Tensor, channels: int) -> None:
    require_floating(name, tensor)
    if tensor.ndim != 4 or tensor.shape[1] != channels or 0 in tensor.shape[2:]:
        got = f"a tensor of shape {tuple(tensor.shape)}"
        raise ShapeError(name, got, f"pass B x {channels} x H x W")
