"""Rays through Intel's Embree: fast on the CPU, in float32.

Embree keeps coordinates in float32. So that neither the place nor the size of a scene costs
digits, triangles and rays are first moved to the middle of the scene and divided by its half
diagonal, in float64; rays that come from afar start where they enter the scene's bounding
sphere, and segments are cut to it. Embree's *robust* mode keeps shared edges closed. From its
answer only the triangle's index is used: distance and barycentric weights are computed anew
in float64.

References: I. Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray Tracing", ACM
TOG 33(4) (2014).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import torch
from torch import Tensor

from torchradiometry.errors import MissingDependencyError
from torchradiometry.geometry.patches import vector_area
from torchradiometry.numerics import guarded_divide
from torchradiometry.transport.rays import (
    AbstractRayCaster,
    Hits,
    check_rays,
    hit_details,
    shortened,
)

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["EmbreeRays"]


def _embreex() -> tuple[Any, Any]:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise MissingDependencyError(
            "embreex",
            "no installation",
            "run: pip install 'torchradiometry[rays]', or use BruteForceRays",
        ) from error
    return EmbreeScene, TriangleMesh


@final
class EmbreeRays(AbstractRayCaster):
    """Fast rays on the CPU; tensors elsewhere are copied there and back.

    Args:
        corners: `triangle 3 3`, m.

    Raises:
        MissingDependencyError: embreex is not installed.
    """

    def __init__(self, corners: Float[Tensor, "triangle 3 3"]) -> None:
        scene, mesh = _embreex()
        self._hold(corners.cpu())
        self._scene = scene(robust=True)
        unit = (self.corners - self.centre) / self.scale
        # Embree hits the line that a triangle without area is
        area = vector_area(unit)
        self._solid = (
            ((area * area).sum(-1) > torch.finfo(area.dtype).eps ** 2).nonzero().squeeze(-1)
        )
        if len(self._solid):
            mesh(self._scene, unit[self._solid].to(torch.float32).numpy())

    def closest(self, origin: Float[Tensor, "ray 3"], direction: Float[Tensor, "ray 3"]) -> Hits:
        check_rays(origin, direction, "direction")
        start, heading = self._unit(origin), direction.detach().cpu().to(torch.float64)
        length = heading.norm(dim=-1, keepdim=True)
        heading = heading / torch.where(length > 0, length, 1)
        start = start + heading * _entry(start, heading, torch.ones_like(length))
        triangle = self._run(start, heading, "INTERSECT", None)
        triangle = torch.where(length.squeeze(-1) > 0, triangle, -1).to(origin.device)
        return hit_details(self.corners.to(origin.device), triangle, origin, direction)

    def occluded(
        self, origin: Float[Tensor, "ray 3"], target: Float[Tensor, "ray 3"]
    ) -> Bool[Tensor, "ray"]:
        check_rays(origin, target, "target")
        start, extent = shortened(
            self._unit(origin), self._unit(target), self.tolerance / self.scale
        )
        squared = (extent * extent).sum(-1, keepdim=True)
        # with an extent that is not unit, lengths along the ray run from 0 to 1
        skipped = _entry(start, extent, squared).clamp(max=1)
        if bool(skipped.any()):
            start, extent = start + skipped * extent, (1 - skipped) * extent
        blocked = self._run(start, extent, "OCCLUDED", torch.ones(len(start))) >= 0
        return (blocked & (squared.squeeze(-1) > 0)).to(origin.device)

    def _unit(self, point: Float[Tensor, "ray 3"]) -> Float[Tensor, "ray 3"]:
        return (point.detach().cpu().to(torch.float64) - self.centre) / self.scale

    def _run(self, start: Tensor, heading: Tensor, query: str, length: Tensor | None) -> Tensor:
        if len(self._solid) == 0 or len(start) == 0:
            return torch.full((len(start),), -1, dtype=torch.int64)
        o, d = (t.to(torch.float32).contiguous().numpy() for t in (start, heading))
        reach = None if length is None else length.to(torch.float32).numpy()
        hit = torch.from_numpy(self._scene.run(o, d, dists=reach, query=query)).long()
        return torch.where(hit >= 0, self._solid[hit.clamp(min=0)], -1)


def _entry(start: Tensor, heading: Tensor, squared: Tensor) -> Tensor:
    """How far along its heading a ray may be moved before it meets the sphere of radius 1.5.

    In lengths of the heading (`squared` is its square), at least 0.
    """
    along = (start * heading).sum(-1, keepdim=True)
    reach = 1.5 * squared.sqrt()
    return torch.where(squared > 0, guarded_divide(-along - reach, squared), 0).clamp(min=0)
