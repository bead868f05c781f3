"""What every ray caster answers: what does a ray hit first, and is a segment blocked.

    x(t) = o + t d,   t > 0            closest:   smallest t with x(t) on a triangle
                                       occluded:  is there any with both ends excluded

Rays that start on a surface must not find that surface. Every caster states one length, its
`tolerance` = scale 2^-18 (scale: the half diagonal of the triangles' bounding box), which is
above the rounding of its arithmetic by a factor of about 30. It is used twice: `occluded`
leaves out that length at both ends of the segment, and `lift` moves points off the surface
they lie on by it, along the normal. Lifted points are safe at any grazing angle; points that
were not lifted are safe where the segment makes an angle of more than about 2^-5 with the
surface. Blockers closer to an end than the tolerance are not seen.

Ray casting is not differentiable: hits are integers, and visibility is used detached.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.arguments import broadcast_shape
from torchradiometry.errors import (
    DTypeError,
    ShapeError,
    require_axes,
    require_kind,
)
from torchradiometry.geometry.patches import check_corners
from torchradiometry.numerics import dot, guarded_divide

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["RELATIVE_TOLERANCE", "AbstractRayCaster", "Hits", "check_triangles", "hit_details"]

#: shortest length that counts, over the half diagonal of the scene: 32 roundings of float32
#: coordinates of size 1 (2^-24 each, and at most 2 more by the intersection) fit into it
RELATIVE_TOLERANCE = 2.0**-18


class Hits(NamedTuple):
    """What rays hit first.

    Attributes:
        triangle: index of the triangle, -1 where nothing was hit.
        distance: in units of the ray's direction (m if it is unit); infinite where nothing.
        barycentric: weights of the triangle's corners, 0 where nothing was hit.
    """

    triangle: Int[Tensor, "ray"]
    distance: Float[Tensor, "ray"]
    barycentric: Float[Tensor, "ray 3"]

    @property
    def found(self) -> Bool[Tensor, "ray"]:
        """True where something was hit."""
        return self.triangle >= 0


class AbstractRayCaster(ABC):
    """Triangles that answer rays. Subclasses are final and take `corners "triangle 3 3"`.

    Attributes:
        corners: the triangles, float64, m.
        centre: middle of their bounding box, m.
        scale: half diagonal of the bounding box, m.
    """

    corners: Float[Tensor, "triangle 3 3"]
    centre: Float[Tensor, "3"]
    scale: float

    def _hold(self, corners: Float[Tensor, "triangle 3 3"]) -> None:
        check_triangles(corners)
        self.corners = corners.detach().to(torch.float64)
        points = self.corners.reshape(-1, 3)
        if len(points) == 0:
            points = self.corners.new_zeros(1, 3)
        low, high = points.amin(0), points.amax(0)
        self.centre = (low + high) / 2
        self.scale = float(((high - low) / 2).norm()) or 1.0

    @property
    def tolerance(self) -> float:
        """The shortest length that counts, m: scale 2^-18."""
        return self.scale * RELATIVE_TOLERANCE

    def lift(
        self, point: Float[Tensor, "*batch 3"], normal: Float[Tensor, "*batch 3"]
    ) -> Float[Tensor, "*batch 3"]:
        """Points moved off their surface by `tolerance`, to the side of the unit normal."""
        broadcast_shape("point, normal", point.shape, normal.shape)
        return point + self.tolerance * normal

    def beyond(
        self, point: Float[Tensor, "*batch 3"], direction: Float[Tensor, "*batch 3"]
    ) -> Float[Tensor, "*batch 3"]:
        """Points outside the bounding sphere of the triangles, seen in unit `direction`.

        They stand for the infinite end of a ray to a distant source.
        """
        reach = (point - self.centre.to(point)).norm(dim=-1, keepdim=True) + 2 * self.scale
        return point + reach * direction

    @abstractmethod
    def closest(self, origin: Float[Tensor, "ray 3"], direction: Float[Tensor, "ray 3"]) -> Hits:
        """The first hit of each ray beyond its origin.

        Args:
            origin: m.
            direction: need not be unit; a zero vector hits nothing, nor does one that is NaN.

        Raises:
            ShapeError: not `ray 3` both.
            DTypeError: integers.
        """

    @abstractmethod
    def occluded(
        self, origin: Float[Tensor, "ray 3"], target: Float[Tensor, "ray 3"]
    ) -> Bool[Tensor, "ray"]:
        """True where a triangle cuts the open segment, `tolerance` left out at both ends.

        Raises:
            ShapeError: not `ray 3` both.
            DTypeError: integers.
        """

    def visible(
        self, origin: Float[Tensor, "*batch 3"], target: Float[Tensor, "*batch 3"]
    ) -> Bool[Tensor, "*batch"]:
        """Not `occluded`, for points of any (broadcast) shape; `ShapeError` if they have none."""
        require_axes("origin", origin, 3)
        require_axes("target", target, 3)
        shape = broadcast_shape("origin, target", origin.shape, target.shape)
        origin, target = origin.expand(shape), target.expand(shape)
        blocked = self.occluded(origin.reshape(-1, 3), target.reshape(-1, 3))
        return ~blocked.reshape(origin.shape[:-1])


def check_triangles(corners: Float[Tensor, "triangle 3 3"]) -> None:
    """Raise a named error unless `corners` is a finite `triangle 3 3`."""
    require_kind("corners", corners, Tensor)
    if corners.ndim != 3 or corners.shape[1:] != (3, 3):
        raise ShapeError("corners", f"shape {tuple(corners.shape)}", "pass `triangle 3 3`")
    if corners.is_complex():
        raise DTypeError("corners", f"a tensor of {corners.dtype}", "pass real numbers")
    check_corners("corners", corners)


def check_rays(origin: Tensor, other: Tensor, name: str) -> None:
    """Raise a named error unless both are `ray 3`; `name`: of the other."""
    for where, tensor in (("origin", origin), (name, other)):
        require_kind(where, tensor, Tensor)
        require_axes(where, tensor, 3)
    if origin.ndim != 2 or origin.shape != other.shape:
        got = f"shapes {tuple(origin.shape)}, {tuple(other.shape)}"
        raise ShapeError(f"origin, {name}", got, "pass `ray 3` both")


def shortened(
    origin: Float[Tensor, "ray 3"], target: Float[Tensor, "ray 3"], margin: float
) -> tuple[Tensor, Tensor]:
    """Start and extent of segments without `margin` at both ends; extent 0 if none is left."""
    extent = target - origin
    share = (margin / extent.norm(dim=-1, keepdim=True)).clamp(max=0.5)  # margin / 0 gives 0.5
    return origin + share * extent, (1 - 2 * share) * extent


def hit_details(
    corners: Float[Tensor, "triangle 3 3"],
    triangle: Int[Tensor, "ray"],
    origin: Float[Tensor, "ray 3"],
    direction: Float[Tensor, "ray 3"],
) -> Hits:
    """Distance and barycentric weights of known hits, in the arithmetic of float64.

        S_a = d . ((b - o) x (c - o)),  and b, c likewise;   weight = S / sum S
        t = (a - o) . n / d . n,        n = (b - a) x (c - a)

    Returned in the dtype of `origin`.
    """
    o, d = origin.to(torch.float64), direction.to(torch.float64)
    found = triangle >= 0
    if len(corners) == 0:
        return _nothing(origin)
    a, b, c = (corners[triangle.clamp(min=0)] - o.unsqueeze(1)).unbind(1)
    volumes = torch.stack([dot(d, torch.linalg.cross(*pair)) for pair in ((b, c), (c, a), (a, b))])
    weights = guarded_divide(volumes, volumes.sum(0)).mT.clamp(0, 1)
    weights = guarded_divide(weights, weights.sum(-1, keepdim=True))
    normal = torch.linalg.cross(b - a, c - a)
    distance = guarded_divide(dot(a, normal), dot(d, normal)).clamp(min=0)
    return Hits(
        triangle,
        torch.where(found, distance, torch.inf).to(origin.dtype),
        torch.where(found.unsqueeze(-1), weights, 0).to(origin.dtype),
    )


def _nothing(origin: Float[Tensor, "ray 3"]) -> Hits:
    rays = origin[:, 0]
    nowhere = torch.full_like(rays, -1, dtype=torch.int64)
    return Hits(nowhere, torch.full_like(rays, torch.inf), torch.zeros_like(origin))
