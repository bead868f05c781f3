"""Pinhole and orthographic cameras: pixels to rays, points to pixels.

    pinhole        u = cx + f x / d        v = cy - f y / d        f = (H / 2) / tan(yfov / 2)
    orthographic   u = cx + s x            v = cy - s y            s = H / (2 ymag)

(x, y, z) is a point in the camera frame of glTF: right-handed, x right, y up, the camera looks
along -z; d = -z is its depth, the distance along the viewing axis, positive in front. Pixel
coordinates (u, v) run right and down; the centre of the top-left pixel is (0.5, 0.5) and
(cx, cy) = (W/2, H/2). Pixels are square. kornia projects and unprojects; its frame (y down,
z forward) is ours turned by half a turn about x.

References: glTF 2.0 specification, section 3.10 (cameras); R. Hartley and A. Zisserman,
*Multiple View Geometry*, 2nd ed. (2004), section 6.1.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING, NamedTuple, final

import torch
from kornia.geometry.camera import (
    project_points,
    project_points_orthographic,
    unproject_points,
    unproject_points_orthographic,
)
from kornia.geometry.conversions import (
    denormalize_points_with_intrinsics,
    normalize_points_with_intrinsics,
)
from torch import Tensor

from torchradiometry.arguments import as_numbers
from torchradiometry.errors import (
    DegenerateGeometryError,
    DTypeError,
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
    require_axes,
)
from torchradiometry.numerics import safe_norm, safe_normalize, wide

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AbstractCamera", "OrthographicCamera", "PinholeCamera", "Rays", "look_at", "rigid"]

#: how far the rotation of `camera_to_world` may be from orthonormal: a matrix written with
#: six decimals, or multiplied up in float32, stays well below it
RIGID_TOLERANCE = 1e-4
#: sine of the smallest angle between the viewing direction and `up` that still fixes a roll
#: to about four digits in float32
PARALLEL_SINE = 1e-3


class Rays(NamedTuple):
    """Half-lines in world space."""

    origin: Float[Tensor, "*batch 3"]
    direction: Float[Tensor, "*batch 3"]


@dataclass(frozen=True, eq=False, kw_only=True)
class AbstractCamera(ABC):
    """What every camera answers.

    Attributes:
        width, height: picture size in pixels.
        camera_to_world: `4 4`, rigid; its columns are the camera's x (right), y (up), z
            (backwards) axes and its position, in m. Its dtype and device are the camera's.
    """

    width: int
    height: int
    camera_to_world: Float[Tensor, "4 4"]

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            size = getattr(self, name)
            if not isinstance(size, int) or isinstance(size, bool):
                raise DTypeError(f"camera.{name}", f"{size!r}", "pass a whole number of pixels")
            if size < 1:
                raise OutOfRangeError(f"camera.{name}", f"{size}", "use at least 1 pixel")
        _require_rigid(self.camera_to_world)

    @property
    @abstractmethod
    def scale(self) -> float:
        """Pixels per unit: of tangent (pinhole) or per metre (orthographic)."""

    @abstractmethod
    def _to_pixels(self, points: Tensor) -> Tensor:
        """Pixels of points in kornia's camera frame, float64."""

    @abstractmethod
    def _from_pixels(self, pixels: Tensor, depth: Tensor) -> Tensor:
        """Points in kornia's camera frame at `depth` (`*batch 1`), float64."""

    @abstractmethod
    def rays(self, pixels: Float[Tensor, "*batch 2"]) -> Rays:
        """World-space rays through pixel coordinates; directions are unit vectors."""

    @property
    def position(self) -> Float[Tensor, "3"]:
        """Where the camera stands, world, m."""
        return self.camera_to_world[:3, 3]

    @property
    def forward(self) -> Float[Tensor, "3"]:
        """Unit viewing direction, world."""
        return -self.camera_to_world[:3, 2]

    @property
    def intrinsics(self) -> Float[Tensor, "3 3"]:
        """K = [[s, 0, W/2], [0, s, H/2], [0, 0, 1]], in pixels, with s = `scale`."""
        s, cx, cy = self.scale, self.width / 2, self.height / 2
        rows = [[s, 0.0, cx], [0.0, s, cy], [0.0, 0.0, 1.0]]
        return torch.tensor(
            rows, dtype=self.camera_to_world.dtype, device=self.camera_to_world.device
        )

    def pixel_grid(self) -> Float[Tensor, "height width 2"]:
        """Coordinates (right, down) of the pixel centres; the first is (0.5, 0.5)."""
        dtype, device = self.camera_to_world.dtype, self.camera_to_world.device
        v = torch.arange(self.height, dtype=dtype, device=device) + 0.5
        u = torch.arange(self.width, dtype=dtype, device=device) + 0.5
        rows, columns = torch.meshgrid(v, u, indexing="ij")
        return torch.stack((columns, rows), -1)

    def depth(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Distance of world points along the viewing axis, m; positive in front."""
        return self._seen(points)[..., 2].to(points.dtype)

    def project(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 2"]:
        """Pixel coordinates of world points.

        A pinhole mirrors points behind it (depth < 0) through its centre; ask `depth` which
        points lie in front. Exactly at depth 0 kornia leaves the division out.

        Differentiable in: points, camera_to_world.
        """
        return self._to_pixels(self._seen(points)).to(points.dtype)

    def unproject(
        self, pixels: Float[Tensor, "*batch 2"], depth: Float[Tensor, "*batch"]
    ) -> Float[Tensor, "*batch 3"]:
        """World points at pixel coordinates and depths (m, along the viewing axis).

        Differentiable in: pixels, depth, camera_to_world.
        """
        uv, d = wide(pixels, depth)
        uv, d = torch.broadcast_tensors(uv, d.unsqueeze(-1))
        return self._placed(self._from_pixels(uv, d[..., :1])).to(pixels.dtype)

    def to(self, dtype: torch.dtype | None = None, device: object = None) -> AbstractCamera:
        """The same camera in another dtype or on another device."""
        matrix = self.camera_to_world
        matrix = matrix.to(dtype=dtype or matrix.dtype, device=device or matrix.device)  # type: ignore[call-overload]
        return replace(self, camera_to_world=matrix)

    def _seen(self, points: Tensor) -> Tensor:
        """World points in kornia's camera frame (x right, y down, z forward), float64."""
        if points.shape[-1:] != (3,):
            raise ShapeError("points", f"shape {tuple(points.shape)}", "pass `*batch 3`")
        p, matrix = wide(points, self.camera_to_world)
        return ((p - matrix[:3, 3]) @ matrix[:3, :3]) * _half_turn(p)

    def _placed(self, points: Tensor) -> Tensor:
        """The inverse of `_seen`."""
        (matrix,) = wide(self.camera_to_world)
        return (points * _half_turn(points)) @ matrix[:3, :3].T + matrix[:3, 3]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class PinholeCamera(AbstractCamera):
    """A perspective camera.

    Args:
        width, height: picture size in pixels.
        yfov: vertical field of view in radians, 0 < yfov < pi.
        camera_to_world: `4 4`, rigid (see `look_at`).

    Raises:
        OutOfRangeError: a field of view outside (0, pi), for one given in degrees.

    >>> camera = PinholeCamera(width=4, height=2, yfov=math.pi / 2, camera_to_world=torch.eye(4))
    >>> camera.project(torch.tensor([0.0, 0.0, -5.0]))
    tensor([2., 1.])
    >>> camera.rays(torch.tensor([2.0, 1.0])).direction
    tensor([ 0.,  0., -1.])
    """

    yfov: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.yfov, (int, float)) and 0 < self.yfov < math.pi):
            mend = "pass radians, 0 < yfov < pi"
            if isinstance(self.yfov, (int, float)) and math.pi <= self.yfov < 180:
                mend += f" (if this was in degrees: {math.radians(self.yfov):.4g})"
            raise OutOfRangeError("camera.yfov", f"{self.yfov!r}", mend)

    @property
    def scale(self) -> float:
        """The focal length in pixels."""
        return self.height / 2 / math.tan(self.yfov / 2)

    def rays(self, pixels: Float[Tensor, "*batch 2"]) -> Rays:
        """World-space rays from the camera's centre through pixel coordinates.

        Differentiable in: pixels, camera_to_world.
        """
        uv, matrix = wide(pixels, self.camera_to_world)
        inside = self._from_pixels(uv, torch.ones_like(uv[..., :1])) * _half_turn(uv)
        direction = safe_normalize(inside @ matrix[:3, :3].T).to(pixels.dtype)
        return Rays(self.position.to(pixels.dtype).expand_as(direction), direction)

    def _to_pixels(self, points: Tensor) -> Tensor:
        flat = points.reshape(-1, 3)
        return project_points(flat, self._matrix(flat)).reshape(*points.shape[:-1], 2)

    def _from_pixels(self, pixels: Tensor, depth: Tensor) -> Tensor:
        flat, d = pixels.reshape(-1, 2), depth.reshape(-1, 1)
        return unproject_points(flat, d, self._matrix(flat)).reshape(*pixels.shape[:-1], 3)

    def _matrix(self, like: Tensor) -> Tensor:
        return _intrinsics(self, like)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class OrthographicCamera(AbstractCamera):
    """A camera with parallel rays.

    Args:
        width, height: picture size in pixels.
        ymag: half the height of the view, m, > 0 (glTF's `ymag`).
        camera_to_world: `4 4`, rigid (see `look_at`).

    >>> camera = OrthographicCamera(width=2, height=2, ymag=1.0, camera_to_world=torch.eye(4))
    >>> camera.project(torch.tensor([0.5, 0.5, -7.0]))
    tensor([1.5000, 0.5000])
    """

    ymag: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.ymag, (int, float)) and 0 < self.ymag < math.inf):
            mend = "pass half the height of the view in m, > 0"
            raise OutOfRangeError("camera.ymag", f"{self.ymag!r}", mend)

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return self.height / (2 * self.ymag)

    def rays(self, pixels: Float[Tensor, "*batch 2"]) -> Rays:
        """World-space rays that start in the camera's plane and run along its axis.

        Differentiable in: pixels, camera_to_world.
        """
        origin = self.unproject(pixels, torch.zeros_like(pixels[..., 0]))
        return Rays(origin, self.forward.to(pixels.dtype).expand_as(origin))

    def _to_pixels(self, points: Tensor) -> Tensor:
        flat = project_points_orthographic(points.reshape(-1, 3))
        pixels = denormalize_points_with_intrinsics(flat, _intrinsics(self, flat))
        return pixels.reshape(*points.shape[:-1], 2)

    def _from_pixels(self, pixels: Tensor, depth: Tensor) -> Tensor:
        flat = pixels.reshape(-1, 2)
        metres = normalize_points_with_intrinsics(flat, _intrinsics(self, flat))
        points = unproject_points_orthographic(metres, depth.reshape(-1, 1))
        return points.reshape(*pixels.shape[:-1], 3)


def look_at(
    eye: Float[Tensor, "3"] | list[float] | tuple[float, ...],
    target: Float[Tensor, "3"] | list[float] | tuple[float, ...],
    up: Float[Tensor, "3"] | list[float] | tuple[float, ...] = (0.0, 1.0, 0.0),
) -> Float[Tensor, "4 4"]:
    """`camera_to_world` of a camera at `eye` that looks at `target`.

    Args:
        eye, target: world points, m.
        up: any vector that shall point upwards in the picture.

    Raises:
        DegenerateGeometryError: eye and target coincide, up is zero or parallel to the view.

    Differentiable in: eye, target, up.

    >>> look_at([0.0, 0.0, 5.0], [0.0, 0.0, 0.0])[:3, 3]
    tensor([0., 0., 5.])
    """
    eye, target, up = _vectors(eye=eye, target=target, up=up)
    backwards = safe_normalize(eye - target)
    if not bool(backwards.any()):
        raise DegenerateGeometryError("look_at", "eye == target", "look at another point")
    right = torch.linalg.cross(safe_normalize(up), backwards)
    if not float(safe_norm(right.detach())) > PARALLEL_SINE:
        got = "an up vector that is zero or parallel to the view"
        raise DegenerateGeometryError("look_at", got, "choose another up")
    right = safe_normalize(right)
    axes = torch.stack((right, torch.linalg.cross(backwards, right), backwards, eye), -1)
    return torch.cat((axes, axes.new_tensor([[0.0, 0.0, 0.0, 1.0]])))


def rigid(matrix: Float[Tensor, "4 4"]) -> Float[Tensor, "4 4"]:
    """The rotation and position of an affine matrix, its scale, shear and mirroring dropped.

    The viewing axis (third column) keeps its direction, the first column as much as the
    second axis leaves it: what glTF means by a camera on a scaled node.

    Raises:
        DegenerateGeometryError: the axes span no space.
    """
    require_axes("matrix", matrix, 4, 4)
    x, z = safe_normalize(matrix[:3, 0]), safe_normalize(matrix[:3, 2])
    x = x - (x * z).sum() * z
    if not bool(z.any()) or not float(safe_norm(x.detach())) > PARALLEL_SINE:
        raise DegenerateGeometryError(
            "camera_to_world", "axes that span no space", "use a scale other than 0"
        )
    x = safe_normalize(x)
    axes = torch.stack((x, torch.linalg.cross(z, x), z, matrix[:3, 3]), -1)
    return torch.cat((axes, axes.new_tensor([[0.0, 0.0, 0.0, 1.0]])))


def _vectors(**named: object) -> list[Tensor]:
    """The arguments as 3-vectors of one floating dtype, the widest of all; lists are as wide."""
    first = [as_numbers(f"look_at {name}", value) for name, value in named.items()]
    dtype = reduce(torch.promote_types, (t.dtype for t in first))
    tensors = [as_numbers(f"look_at {name}", value, dtype) for name, value in named.items()]
    for name, t in zip(named, tensors, strict=True):
        if t.shape != (3,):
            raise ShapeError(f"look_at {name}", f"shape {tuple(t.shape)}", "pass a 3-vector")
        if not bool(torch.isfinite(t).all()):
            raise InvalidValueError(f"look_at {name}", f"{t.tolist()}", "pass finite numbers")
    return [t.to(dtype=dtype, device=tensors[0].device) for t in tensors]


def _half_turn(like: Tensor) -> Tensor:
    """diag(1, -1, -1): between glTF's camera frame and kornia's."""
    return torch.tensor([1.0, -1.0, -1.0], dtype=like.dtype, device=like.device)


def _intrinsics(camera: AbstractCamera, like: Tensor) -> Tensor:
    """K in float64, one per point as kornia wants it."""
    s = camera.scale
    rows = [[s, 0.0, camera.width / 2], [0.0, s, camera.height / 2], [0.0, 0.0, 1.0]]
    return torch.tensor(rows, dtype=torch.float64, device=like.device).expand(len(like), 3, 3)


def _require_rigid(matrix: Tensor) -> None:
    where = "camera_to_world"
    if not isinstance(matrix, Tensor) or not matrix.is_floating_point():
        raise DTypeError(where, f"a {type(matrix).__name__}", "pass a floating-point tensor")
    if matrix.shape != (4, 4):
        raise ShapeError(where, f"shape {tuple(matrix.shape)}", "pass a 4 x 4 matrix")
    m = matrix.detach().double()
    if not bool(torch.isfinite(m).all()):
        raise InvalidValueError(where, "NaN or infinite numbers", "pass finite numbers")
    gram = m[:3, :3].T @ m[:3, :3] - torch.eye(3, dtype=m.dtype, device=m.device)
    bottom = m[3] - m.new_tensor([0.0, 0.0, 0.0, 1.0])
    off = max(float(gram.abs().max()), float(bottom.abs().max()))
    if off > RIGID_TOLERANCE or float(torch.linalg.det(m[:3, :3])) < 0:
        mend = "pass a rotation and a position (drop scale and mirroring with `rigid`)"
        raise OutOfRangeError(where, "a matrix that is not rigid", mend)
