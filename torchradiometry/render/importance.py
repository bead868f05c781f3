"""Importance: what a place adds to a picture, and patches as large as that allows.

    I(x) = seen by the camera  +  BOUNCED x (met on the way on from what is seen)  +  EVERYWHERE

Light is followed backwards: from what camera rays meet, cosine-weighted directions go on, `STEPS`
times, each time with the albedo that was met. A little importance lies on all surfaces alike, as
few paths do not show everything. Each flat or smooth part of a surface has one density i of
importance per area, drawn to that of its side of the whole surface where few paths tell (facets).
At a given number of patches, n ~ sum A / h^2, the error of the picture, sum A i h^1.3, is least for

    h ~ i^(-1/3.3)

so patches of a room that is hardly seen are several times as large as those in front of the camera.

References: B. Smits, J. Arvo and D. Salesin, "An Importance-Driven Radiosity Algorithm",
SIGGRAPH 1992.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide
from torchradiometry.render.direct import cosine_directions
from torchradiometry.render.points import SurfacePoints, see
from torchradiometry.render.world import World
from torchradiometry.transport.rules import sequence

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["EVERYWHERE", "Visits", "backwards", "relative_sizes"]

#: paths that go on from what is seen, and how often
PATHS, STEPS = 2048, 4
#: weight of what is met on the way on, and of all surfaces alike, beside what is seen
BOUNCED, EVERYWHERE = 0.4, 0.3
#: power of the density that patch sizes fall by, and how far they may differ from the mean one
POWER, MOST = 1 / 3.3, 6.0
#: paths by which a part must be visited to be believed more than the surface that it is of
FEW = 16
#: sizes in an octave: a few more or fewer rays find the same ones
IN_OCTAVE = 4


class Visits(NamedTuple):
    """Places that light comes from on its way to the camera.

    Attributes:
        points: on surfaces.
        weight: how much the light that leaves there counts.
    """

    points: SurfacePoints
    weight: Float[Tensor, "visit"]


@torch.no_grad()
def backwards(world: World, seen: Visits) -> Visits:
    """What is seen, and what is met on the way on from there.

    Args:
        world: a prepared scene.
        seen: what camera rays meet; only points with a `face` count.
    """
    albedo = world.triangles.reflectance.detach().mean(-1).double()
    share = torch.where(seen.points.face >= 0, seen.weight, 0)
    total = share.sum()
    found = [Visits(seen.points, guarded_divide(share, total.expand_as(share)))]
    place = (torch.arange(PATHS, device=share.device) + 0.5) * (total / PATHS)
    chosen = torch.searchsorted(share.cumsum(0), place).clamp(max=len(share) - 1)
    here = seen.points.take(chosen[share[chosen] > 0])
    weight = albedo.new_full((len(here.face),), BOUNCED / PATHS)
    number = sequence(PATHS, 2 * STEPS, here.position)[: len(here.face)]
    for _ in range(STEPS):
        way = cosine_directions(number[:, :2].unsqueeze(1), here.facet).squeeze(1)
        met = see(world, world.rays.lift(here.position, here.facet), way)
        kept = torch.nonzero(met.face >= 0).squeeze(-1)
        weight = (weight * albedo[here.triangle])[kept]
        here, number = met.take(kept), number[kept, 2:]
        found.append(Visits(here, weight))
    points = SurfacePoints(*(torch.cat(t) for t in zip(*(v.points for v in found), strict=True)))
    met_any = points.face >= 0
    return Visits(points.take(met_any), torch.cat([v.weight for v in found])[met_any])


@torch.no_grad()
def relative_sizes(world: World, seen: Visits) -> Float[Tensor, "face"]:
    """Size of the patches of every one-sided face, relative to the mean of what is seen.

    Args:
        world: a prepared scene.
        seen: what camera rays meet; if nothing, all sizes are 1.
    """
    a, b, c = world.faces.corners.detach().unbind(1)
    albedo = world.triangles.reflectance.detach().mean(-1).double()
    paint = albedo[world.faces.triangle]
    area = torch.linalg.cross(b - a, c - a).norm(dim=-1)
    points, weight = backwards(world, seen)
    visited = paint.new_zeros(len(area)).index_add(0, points.face, weight * albedo[points.triangle])
    if float(visited.sum()) <= 0:
        return torch.ones_like(area)
    visited, reflects = visited / visited.sum(), area * paint / (area * paint).sum()
    backs = torch.arange(len(area), device=area.device) >= len(world.normal)
    part, side = world.parts, 2 * world.triangles.surface[world.faces.triangle] + backs
    share, own = (_over(part, t) for t in (visited, area))
    around = guarded_divide(_over(side, visited), _over(side, area))
    paths = PATHS * share
    density = (paths * guarded_divide(share, own) + FEW * around) / (paths + FEW)
    density = density + EVERYWHERE * guarded_divide(_over(part, reflects), own)
    mean = (density * density * area).sum() / (density * area).sum()
    low, high = mean * MOST ** (-1 / POWER), mean * MOST ** (1 / POWER)
    octaves = POWER * (mean / density.clamp(low, high)).log2()
    return 2 ** ((octaves * IN_OCTAVE).round() / IN_OCTAVE)


def _over(group: Int[Tensor, "face"], value: Float[Tensor, "face"]) -> Float[Tensor, "face"]:
    """The sum over each face's group."""
    total = value.new_zeros(int(group.max()) + 1).index_add(0, group, value)
    return total[group]
