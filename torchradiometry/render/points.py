"""Surface points: where light is wanted, and where rays end."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import safe_normalize
from torchradiometry.render.world import World

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Receivers", "SurfacePoints", "look", "see"]


class Receivers(NamedTuple):
    """Points on surfaces that receive light.

    Attributes:
        position: m.
        normal: shading normal, unit.
        facet: geometric normal of the same side, unit; shadow rays start on its side.
    """

    position: Float[Tensor, "point 3"]
    normal: Float[Tensor, "point 3"]
    facet: Float[Tensor, "point 3"]

    def take(self, index: Int[Tensor, "chosen"]) -> Receivers:
        """Some of the points."""
        return Receivers(*(t[index] for t in self))

    def split(self, rows: int) -> list[Receivers]:
        """Blocks of at most `rows` points."""
        return [Receivers(*t) for t in zip(*(t.split(rows) for t in self), strict=True)]


class SurfacePoints(NamedTuple):
    """Where camera rays end.

    Attributes:
        triangle: -1 where nothing was met.
        face: the one-sided face that was met, -1 for nothing and for black backs.
        barycentric: in the triangle.
        position: m.
        normal: shading normal on the side of the camera.
        facet: geometric normal on that side.
        outgoing: unit, back along the ray.
    """

    triangle: Int[Tensor, "ray"]
    face: Int[Tensor, "ray"]
    barycentric: Float[Tensor, "ray 3"]
    position: Float[Tensor, "ray 3"]
    normal: Float[Tensor, "ray 3"]
    facet: Float[Tensor, "ray 3"]
    outgoing: Float[Tensor, "ray 3"]

    @property
    def receivers(self) -> Receivers:
        """The points as receivers of light."""
        return Receivers(self.position, self.normal, self.facet)

    def take(self, index: Tensor) -> SurfacePoints:
        """Some of the points, by index or mask."""
        return SurfacePoints(*(t[index] for t in self))

    def grouped(self, group: Int[Tensor, "ray"], count: Float[Tensor, "group"]) -> SurfacePoints:
        """The mean of each group of points on one triangle."""
        first = torch.zeros_like(count, dtype=torch.int64).index_copy(0, group, self._numbers())

        def mean(value: Tensor) -> Tensor:
            total = value.new_zeros(len(count), 3).index_add(0, group, value)
            return total / count.unsqueeze(-1)

        barycentric, position, normal = (mean(t) for t in self[2:5])
        outgoing = safe_normalize(mean(self.outgoing))
        return SurfacePoints(
            self.triangle[first], self.face[first], barycentric, position,
            safe_normalize(normal), self.facet[first], outgoing,
        )  # fmt: skip

    def _numbers(self) -> Int[Tensor, "ray"]:
        return torch.arange(len(self.face), device=self.face.device)

    def on_face(self, world: World) -> Float[Tensor, "ray 3"]:
        """Barycentric weights on the face: a back runs through its corners the other way round."""
        back = (self.face >= len(world.triangles.surface)).unsqueeze(-1)
        return torch.where(back, self.barycentric.flip(-1), self.barycentric)


def look(
    world: World, origin: Float[Tensor, "*ray 3"], direction: Float[Tensor, "*ray 3"]
) -> tuple[Bool[Tensor, "*ray"], Bool[Tensor, "*ray"]]:
    """Which rays meet a reflecting side, and which a black back; the others meet nothing."""
    way = direction.reshape(-1, 3)
    hits = world.rays.closest(origin.expand_as(direction).reshape(-1, 3), way)
    triangle = hits.triangle.clamp(min=0)
    front = (world.normal[triangle] * way).sum(-1) < 0
    front = front | world.triangles.two_sided[triangle]
    shape = direction.shape[:-1]
    return (hits.found & front).reshape(shape), (hits.found & ~front).reshape(shape)


def see(
    world: World, origin: Float[Tensor, "ray 3"], direction: Float[Tensor, "ray 3"]
) -> SurfacePoints:
    """The surface points that rays meet first."""
    hits = world.rays.closest(origin, direction)
    triangle = hits.triangle.clamp(min=0)
    position = origin + torch.where(hits.found, hits.distance, 0).unsqueeze(-1) * direction
    facet = world.normal[triangle]
    front = (facet * direction).sum(-1) < 0
    face = torch.where(front, triangle, world.faces.back[triangle])
    side = torch.where(front, 1.0, -1.0).to(facet).unsqueeze(-1)
    corner = world.triangles.normals[triangle]
    normal = safe_normalize((corner * hits.barycentric.unsqueeze(-1)).sum(1))
    # shading normals that look into their own face (creases, careless files) give way to it
    normal = torch.where((normal * facet).sum(-1, keepdim=True) > 0, normal, facet)
    return SurfacePoints(
        hits.triangle,
        torch.where(hits.found, face, -1),
        hits.barycentric,
        position,
        normal * side,
        facet * side,
        -safe_normalize(direction),
    )
