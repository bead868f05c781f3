"""Every ray against every triangle, exactly and on any device.

    S(a, b) = d . ((a - o) x (b - o)) = d . (a x b) + (d x o) . (a - b)

is six times the volume spanned by the ray and the edge a-b. A ray passes through a triangle
when its three edge volumes have one sign. The volume of an edge is computed **once** for all
triangles that share the edge (corners with equal coordinates are merged first), so that two
neighbours always agree on which side a ray passes: no ray slips between them, at edges or at
vertices. All volumes of a block of rays are one matrix product.

Arithmetic is float64 whatever the inputs are. Memory stays under `budget` bytes because rays
are taken in blocks; time grows as rays x triangles.

References: N. Amenta, "Finding a line transversal of axial objects in three dimensions",
SODA (1992), for Pluecker coordinates of lines; S. Woop, C. Benthin and I. Wald, "Watertight
Ray/Triangle Intersection", JCGT 2(1) (2013), for why shared edges must be shared sums.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import require_whole
from torchradiometry.transport.rays import (
    AbstractRayCaster,
    Hits,
    check_rays,
    hit_details,
    shortened,
)

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["BruteForceRays"]


@final
class BruteForceRays(AbstractRayCaster):
    """Exact, without any library, on any device.

    Args:
        corners: `triangle 3 3`, m; the answers come from its device.
        budget: bytes that one block of rays may use; a block has one ray at least.

    Raises:
        ShapeError, InvalidValueError: no finite `triangle 3 3`.
        DTypeError, OutOfRangeError: a budget that is no whole number from 1.

    >>> wall = torch.tensor([[[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 2.0, 1.0]]])
    >>> rays = BruteForceRays(wall)
    >>> rays.closest(torch.zeros(1, 3), torch.tensor([[0.25, 0.25, 1.0]])).distance
    tensor([1.])
    """

    def __init__(self, corners: Float[Tensor, "triangle 3 3"], budget: int = 2**28) -> None:
        self._hold(corners)
        require_whole("budget", budget, 1)
        self.budget = budget
        centred = self.corners - self.centre
        points, index = torch.unique(centred.reshape(-1, 3), dim=0, return_inverse=True)
        index = index.reshape(-1, 3)
        ends = torch.stack([index[:, [1, 2, 0]], index[:, [2, 0, 1]]], -1)
        edges, edge = torch.unique(ends.sort(-1).values.reshape(-1, 2), dim=0, return_inverse=True)
        a, b = points[edges[:, 0]], points[edges[:, 1]]
        self._lines = torch.cat([torch.linalg.cross(a, b), a - b], -1).mT
        self._edge = edge.reshape(-1, 3)
        self._sign = torch.where(ends[..., 0] < ends[..., 1], 1.0, -1.0).to(centred)
        first, second, third = centred.unbind(1)
        self._normal = torch.linalg.cross(second - first, third - first)
        self._offset = (first * self._normal).sum(-1)

    def closest(self, origin: Float[Tensor, "ray 3"], direction: Float[Tensor, "ray 3"]) -> Hits:
        check_rays(origin, direction, "direction")
        found = [self._first(o, d) for o, d in zip(*self._blocks(origin, direction), strict=True)]
        triangle = torch.cat(found) if found else origin.new_zeros(0, dtype=torch.int64)
        return hit_details(self.corners, triangle, origin, direction)

    def occluded(
        self, origin: Float[Tensor, "ray 3"], target: Float[Tensor, "ray 3"]
    ) -> Bool[Tensor, "ray"]:
        check_rays(origin, target, "target")
        start, extent = shortened(origin.to(self.corners), target.to(self.corners), self.tolerance)
        found = [
            (self._crossings(o, d) <= 1).any(-1)
            for o, d in zip(*self._blocks(start, extent), strict=True)
        ]
        return torch.cat(found) if found else origin.new_zeros(0, dtype=torch.bool)

    def _blocks(self, origin: Tensor, direction: Tensor) -> tuple[tuple[Tensor, ...], ...]:
        numbers = self._lines.shape[1] + 12 * len(self.corners)
        block = max(1, self.budget // (8 * max(numbers, 1)))
        return (origin - self.centre.to(origin.dtype)).to(self.corners).split(block), direction.to(
            self.corners
        ).split(block)

    def _first(self, origin: Tensor, direction: Tensor) -> Tensor:
        if len(self.corners) == 0:
            return torch.full_like(origin[:, 0], -1, dtype=torch.int64)
        distance, triangle = self._crossings(origin, direction).min(-1)
        return torch.where(torch.isfinite(distance), triangle, -1)

    def _crossings(self, origin: Tensor, direction: Tensor) -> Tensor:
        """Distance `ray triangle` of each crossing beyond the origin; infinite where none."""
        rays = torch.cat([direction, torch.linalg.cross(direction, origin)], -1)
        volumes = (rays @ self._lines)[:, self._edge] * self._sign
        inside = (volumes >= 0).all(-1) | (volumes <= 0).all(-1)
        cosine = direction @ self._normal.mT
        crosses = inside & (cosine != 0)
        distance = (self._offset - origin @ self._normal.mT) / torch.where(crosses, cosine, 1)
        return torch.where(crosses & (distance > 0), distance, torch.inf)
