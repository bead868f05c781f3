"""Reflected light gathered at points: exact nearby, from the middle far away, times visibility.

    E(x) = sum_j G_j(x) R_j,   G_j = share_j V_j(x) E_j(x) / pi

E_j is Lambert's contour integral of patch j for unit radiance if x lies within `NEAR` radii of
it, otherwise A cos cos / r^2 to its middle; share_j is what of the patch lies free. V_j is the
free share of rays to the patch's points: the first `FIRST` of them, and `MORE` where those
disagree. Rays are spared where no blocker's bounding sphere comes near the segment.

In a closed scene sum_j G_j = 1; the rows are divided by their sum there.

References: M. Cohen and J. Wallace, *Radiosity and Realistic Image Synthesis* (1993), ch. 9
(local gather).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.numerics import guarded_divide
from torchradiometry.render.exposure import Exposure
from torchradiometry.render.points import Receivers
from torchradiometry.render.world import World

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["gather_weights"]

#: distance, in radii of the patch, below which it is integrated exactly
NEAR = 4.0
#: rays to each patch, and to those of which the first see a part only
FIRST, MORE = 2, 6
#: points x patches that are held at a time
BLOCK = 2**18


def gather_weights(
    world: World, patches: Patches, exposure: Exposure, points: Receivers
) -> Float[Tensor, "point patch"]:
    """G: irradiance at points for unit radiosity of each patch, 0..1; detached.

    Args:
        world: what blocks.
        patches: the senders.
        exposure: what of them lies free.
        points: the receivers.
    """
    rows = max(1, BLOCK // max(1, patches.count))
    blocks = [_rows(world, patches, exposure, part) for part in points.split(rows)]
    found = torch.cat(blocks)
    if not exposure.closed:
        return found
    total = found.sum(-1, keepdim=True)
    return torch.where(total > 0, guarded_divide(found, total), 0)


@torch.no_grad()
def _rows(
    world: World, patches: Patches, exposure: Exposure, points: Receivers
) -> Float[Tensor, "point patch"]:
    middle = patches.centroid
    radius = (patches.corners - middle.unsqueeze(1)).norm(dim=-1).amax(-1)
    distance = torch.cdist(points.position, middle)
    here = points.normal @ middle.mT - (points.normal * points.position).sum(-1, keepdim=True)
    there = (patches.normal * middle).sum(-1) - points.position @ patches.normal.mT
    weight = -here.clamp(min=0) * there.clamp(max=0)
    weight = patches.area * guarded_divide(weight, math.pi * distance**4)
    point, patch = torch.nonzero(distance < NEAR * radius, as_tuple=True)
    near = polygon_irradiance(points.position[point], points.normal[point], patches.corners[patch])
    weight = weight.index_put((point, patch), near / math.pi) * exposure.share
    point, patch = torch.nonzero(weight > 0, as_tuple=True)
    doubtful = _doubtful(world, points.position[point], middle[patch], radius[patch])
    point, patch = point[doubtful], patch[doubtful]
    seen = _seen(world, exposure, points, point, patch)
    return weight.index_put((point, patch), weight[point, patch] * seen)


def _doubtful(
    world: World,
    start: Float[Tensor, "pair 3"],
    end: Float[Tensor, "pair 3"],
    radius: Float[Tensor, "pair"],
) -> Bool[Tensor, "pair"]:
    """Pairs whose connection comes near a blocker."""
    if world.blockers is None:
        return torch.ones_like(radius, dtype=torch.bool)
    found = torch.zeros_like(radius, dtype=torch.bool)
    along = end - start
    square = (along * along).sum(-1)
    for corners in world.blockers:
        centre = corners.mean(0)
        size = (corners - centre).norm(dim=-1).max()
        place = guarded_divide(((centre - start) * along).sum(-1), square).clamp(0, 1)
        gap = (start + place.unsqueeze(-1) * along - centre).norm(dim=-1)
        found = found | (gap < size + place * radius)
    return found


def _seen(
    world: World,
    exposure: Exposure,
    points: Receivers,
    point: Int[Tensor, "pair"],
    patch: Int[Tensor, "pair"],
) -> Float[Tensor, "pair"]:
    """Free share of the rays of each pair."""
    count = exposure.point.shape[1]
    lifted = world.rays.lift(points.position, points.facet)
    first = (point * 5 + patch * 3) % count

    def rays(pair: Tensor, low: int, high: int) -> tuple[Tensor, Tensor]:
        step = torch.arange(low, high, device=pair.device) * 7
        which = (first[pair].unsqueeze(-1) + step) % count
        there = patch[pair].unsqueeze(-1)
        valid = exposure.free[there, which]
        target = exposure.point[there, which]
        free = world.rays.visible(lifted[point[pair]].unsqueeze(1), target) & valid
        return free.sum(-1).to(lifted), valid.sum(-1).to(lifted)

    free, total = rays(torch.arange(len(point), device=point.device), 0, FIRST)
    mixed = torch.nonzero(((free > 0) & (free < total)) | (total == 0)).squeeze(-1)
    more = rays(mixed, FIRST, FIRST + MORE)
    free, total = free.index_add(0, mixed, more[0]), total.index_add(0, mixed, more[1])
    return torch.where(total > 0, guarded_divide(free, total), 0)
