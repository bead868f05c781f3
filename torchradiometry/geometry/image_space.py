"""Image space (u, v, h): where the lines of the world stay straight for every camera.

    parallel camera   u = cx + fx x         v = cy - fy y         h = d0 - d
    pinhole           u = cx + fx x / d     v = cy - fy y / d     h = d0 / d - 1

(x, y, -d) is a point in the camera frame (x right, y up, z to the camera), (u, v) its pixel
coordinates (right, down), h its height towards the camera over the level d0. Both are projective
maps of space: straight lines stay straight, planes stay planes, and of two points on the ray of a
pixel the higher one hides the lower. A depth map is a height field h(u, v), whatever the camera.

A ray that leaves P = (u, v, h) in direction l is, after r metres, at P + s D with

    parallel   D = (fx l_x, -fy l_y, l_z),    s = r
    pinhole    D = (fx l_x + l_z (u - cx), -fy l_y + l_z (v - cy), l_z (1 + h)),
               s = r / (d - r l_z), without end once that has passed the plane of the pinhole.

The pixel's own ray to the eye, the unit vector v^, and a direction e = (du, dv) in the image span a
plane of space, a *slice*. In a slice a direction is known by its angle theta from v^; what lies k
steps e away is seen under

    cot theta = alpha (h(P + k e) - h(P)) / k + beta,

alpha and beta being known for each pixel and e. With t^ the unit vector of the slice at right
angles to v^, the direction is v^ cos(theta) + t^ sin(theta).

References: R. Hartley and A. Zisserman, *Multiple View Geometry*, 2nd ed. (2004), chapter 3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from torchradiometry.errors import ShapeError, require_between, require_floating
from torchradiometry.numerics import single

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = [
    "HeightField",
    "Slices",
    "View",
    "checked_size",
    "height_field",
    "image_normals",
    "is_seen",
    "pixel_axis",
    "ray_slope",
    "slices",
    "view_of",
]


class View(NamedTuple):
    """How a camera maps points to pixels.

    Attributes:
        fx, fy: pixels per unit of tangent (pinhole) or per metre (parallel), `B|1 1 1`.
        cx, cy: pixel of the axis, `B|1 1 1`.
        perspective: a pinhole.
    """

    fx: Float[Tensor, "B 1 1"]
    fy: Float[Tensor, "B 1 1"]
    cx: Float[Tensor, "B 1 1"]
    cy: Float[Tensor, "B 1 1"]
    perspective: bool

    def tangents(
        self, u: Float[Tensor, "*batch"], v: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """(x/d, y/d) of the rays through pixels; 0 for a parallel camera."""
        if not self.perspective:
            zero = torch.zeros_like(u - v)
            return zero, zero
        return (u - self.cx) / self.fx, (self.cy - v) / self.fy

    def map(self, change: Callable[[Tensor], Tensor]) -> View:
        """Every tensor changed."""
        return View(
            change(self.fx), change(self.fy), change(self.cx), change(self.cy), self.perspective
        )


class HeightField(NamedTuple):
    """A depth map in image space.

    Attributes:
        height: h, `B H W`, in m (parallel) or 1 (pinhole); 0 where nothing is seen.
        seen: where the depth is a number.
        level: d0, m, `B 1 1`.
    """

    height: Float[Tensor, "B H W"]
    seen: Bool[Tensor, "B H W"]
    level: Float[Tensor, "B 1 1"]


class Slices(NamedTuple):
    """What slices through pixels turn heights into; see the module.

    Attributes:
        alpha, beta: of cot theta.
        eye: v^, unit, from the surface to the eye: its three components.
        side: t^, unit: its three components.
        density: |d phi / d a|, phi the slice's azimuth about v^, a the angle of e in the image.
    """

    alpha: Tensor
    beta: Tensor
    eye: tuple[Tensor, Tensor, Tensor]
    side: tuple[Tensor, Tensor, Tensor]
    density: Tensor


def checked_size(pixel_size: float | None) -> float | None:
    """The side of a pixel, which must be a length if there is one."""
    if pixel_size is not None:
        require_between("pixel_size", pixel_size, 0, math.inf, "a length in m, > 0")
    return pixel_size


def view_of(
    depth: Float[Tensor, "B 1 H W"],
    intrinsics: Float[Tensor, "B 3 3"] | None = None,
    pixel_size: float | Tensor | None = None,
) -> View:
    """The view of a depth map: a pinhole with `intrinsics`, or parallel with `pixel_size`.

    Args:
        depth: m along the viewing axis.
        intrinsics: `3 3` or `B 3 3`, in pixels.
        pixel_size: side of a pixel, m.

    Raises:
        DTypeError: depth that is not a tensor of real floating-point numbers.
        ShapeError: wrong axes, another batch of intrinsics, or both or neither of `intrinsics`
            and `pixel_size`.
        OutOfRangeError: a pixel size that is no length.
    """
    require_floating("depth", depth)
    if depth.ndim != 4 or depth.shape[1] != 1 or 0 in depth.shape[2:]:
        got = f"a tensor of shape {tuple(depth.shape)}"
        raise ShapeError("depth", got, "pass B x 1 x H x W")
    if (intrinsics is None) == (pixel_size is None):
        got = "both or neither"
        raise ShapeError("intrinsics, pixel_size", got, "pass the one that fits the camera")
    if not isinstance(pixel_size, Tensor):
        checked_size(pixel_size)
    (depth,) = single(depth)
    if intrinsics is not None:
        require_floating("intrinsics", intrinsics)
        if intrinsics.shape[-2:] != (3, 3) or intrinsics.ndim not in (2, 3):
            got = f"a tensor of shape {tuple(intrinsics.shape)}"
            raise ShapeError("intrinsics", got, "pass `3 3` or `B 3 3`")
        if intrinsics.ndim == 3 and intrinsics.shape[0] not in (1, depth.shape[0]):
            got = f"{intrinsics.shape[0]} matrices for {depth.shape[0]} depth maps"
            raise ShapeError("intrinsics", got, "pass one, or one for each map")
        matrix = intrinsics.reshape(-1, 3, 3).to(depth)[..., None, None]
        return View(matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 0, 2], matrix[:, 1, 2], True)
    size = torch.as_tensor(pixel_size, dtype=depth.dtype, device=depth.device)
    scale = 1 / size.reshape(-1, 1, 1)
    columns, rows = pixel_axis(depth.shape[-1], depth), pixel_axis(depth.shape[-2], depth)
    # half the sum of the first and the last centre: a tensor even where sizes are symbols
    cx, cy = (((axis[:1] + axis[-1:]) / 2).reshape(1, 1, 1) for axis in (columns, rows))
    return View(scale, scale, cx, cy, False)


def pixel_axis(size: int, like: Tensor) -> Float[Tensor, "size"]:
    """Coordinates of the pixel centres along an axis; the first is 0.5."""
    return torch.arange(size, dtype=like.dtype, device=like.device) + 0.5


def is_seen(depth: Float[Tensor, "B 1 H W"], perspective: bool) -> Bool[Tensor, "B 1 H W"]:
    """Where a depth is a finite number and, for a pinhole, in front of it."""
    seen = depth.abs() < torch.inf
    return seen & (depth > 0) if perspective else seen


def height_field(depth: Float[Tensor, "B 1 H W"], perspective: bool) -> HeightField:
    """A depth map as heights over a level of its own.

    NaN and infinite depths are not seen, nor, by a pinhole, what is not in front of it. Heights are
    (d0 - d) and (d0 - d) / d. With the level in the middle of a pinhole's depths, and at the
    smallest of a parallel camera's, float32 heights hold the digits of float32 depths: each as
    many as its own depth has, however far a background lies behind it.

    Half precision becomes float32: squares of depths are beyond its range.

    Differentiable in: depth (the level is a constant: nothing depends on it).
    Export: compile yes, ONNX yes.
    """
    (depth,) = single(depth)
    seen = is_seen(depth, perspective).squeeze(1)
    clean = torch.where(seen, depth.squeeze(1), 1)
    level = _level(torch.where(seen, clean.detach(), torch.inf), seen, perspective)
    height = level - clean
    height = torch.where(seen, height / clean if perspective else height, 0)
    return HeightField(height, seen, level)


def _level(held: Tensor, seen: Tensor, perspective: bool) -> Float[Tensor, "B 1 1"]:
    """d0 of depths that are infinite where nothing is seen; 1 where nothing is."""
    nearest = held.abs().amin((1, 2), keepdim=True)
    level = nearest
    if perspective:
        level = nearest / 2 + torch.where(seen, held, 0).amax((1, 2), keepdim=True) / 2
    return torch.where(nearest < torch.inf, level, 1)


def image_normals(field: HeightField, view: View) -> Float[Tensor, "B 3 H W"]:
    """Unit normals towards the camera, of the planes through neighbouring heights.

        parallel   n ~ (-fx h_u, fy h_v, 1)
        pinhole    n ~ (-fx h_u, fy h_v, 1 + h - x fx h_u + y fy h_v),   (x, y) the tangents

    Slopes are central where both neighbours are seen, one-sided where one is; without one in the
    row or in the column the normal is zero.

    Differentiable in: heights, the view.
    Export: compile yes, ONNX yes.
    """
    (across, known), (down, also) = _slope(field, -1), _slope(field, -2)
    nx, ny = -view.fx * across, view.fy * down
    nz = torch.ones_like(field.height)
    if view.perspective:
        u = pixel_axis(field.height.shape[-1], field.height)
        v = pixel_axis(field.height.shape[-2], field.height).unsqueeze(-1)
        x, y = view.tangents(u, v)
        nz = nz + field.height + x * nx + y * ny
    length = (nx * nx + ny * ny + nz * nz).rsqrt()
    length = torch.where(known & also & field.seen, length, 0)
    return torch.stack((nx * length, ny * length, nz * length), 1)


def ray_slope(
    view: View,
    height: Float[Tensor, "*batch"],
    pixel: tuple[Tensor, Tensor],
    direction: tuple[Tensor, Tensor, Tensor],
) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """D, the image direction of rays: what u, v and h change by; all arguments broadcast.

    Args:
        view: its tensors broadcast against the others.
        height: h where the rays start.
        pixel: u and v where they start.
        direction: l in the camera frame: x, y and z.

    Differentiable in: all tensors.
    Export: compile yes, ONNX yes.
    """
    lx, ly, lz = direction
    across, down = view.fx * lx, -view.fy * ly
    if not view.perspective:
        return across, down, lz
    u, v = pixel
    return across + lz * (u - view.cx), down + lz * (v - view.cy), lz * (1 + height)


def slices(
    view: View,
    height: Float[Tensor, "*batch"],
    pixel: tuple[Tensor, Tensor],
    step: tuple[Tensor, Tensor],
) -> Slices:
    """The slices through pixels along image directions; all arguments broadcast.

    Args:
        view: its tensors broadcast against the others.
        height: h of the pixels.
        pixel: u and v.
        step: du and dv of e, not both 0.

    Differentiable in: all tensors.
    Export: compile yes, ONNX yes.
    """
    across, down = step[0] / view.fx, -step[1] / view.fy
    square = across * across + down * down
    x, y = view.tangents(*pixel)
    reach = (1 + x * x + y * y).sqrt()
    eye = (-x / reach, -y / reach, 1 / reach)
    towards = across * eye[0] + down * eye[1]
    # |dr|^2 - towards^2 for dr = (across, down, 0), written without the difference
    length = (square / (reach * reach) + ((across * y - down * x) / reach).square()).sqrt()
    side = (
        (across - towards * eye[0]) / length,
        (down - towards * eye[1]) / length,
        -towards * eye[2] / length,
    )
    scale = reach / (1 + height) if view.perspective else reach
    density = (step[0].square() + step[1].square()) / (view.fx * view.fy * reach * length.square())
    return Slices(scale / length, towards / length, eye, side, density)


def _slope(field: HeightField, axis: int) -> tuple[Tensor, Tensor]:
    """dh per pixel along an axis, and where it is known."""
    height, seen = field.height, field.seen
    size = height.shape[axis]
    both = seen.narrow(axis, 1, size - 1) & seen.narrow(axis, 0, size - 1)
    step = torch.where(both, height.narrow(axis, 1, size - 1) - height.narrow(axis, 0, size - 1), 0)
    ahead, behind = ((0, 1), (1, 0)) if axis == -1 else ((0, 0, 0, 1), (0, 0, 1, 0))
    share = both.to(height.dtype)
    count = functional.pad(share, ahead) + functional.pad(share, behind)
    total = functional.pad(step, ahead) + functional.pad(step, behind)
    return total / count.clamp(min=1), count > 0
