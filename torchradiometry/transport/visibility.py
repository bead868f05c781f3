"""How much of each other patches see, by rays between stratified points of both.

    V_ij = (segments from i to j that are free) / (segments in front of both)

Each patch has 4 x samples evenly spread points; a pair takes them in an order that begins at a
random place on either side. Pairs whose first `samples` segments disagree lie in a
penumbra and get three times as many more. The standard error of a pair with visibility V is
at most sqrt(V (1 - V) / n), n = 4 x samples in penumbras.

Only pairs that a triangle could come between are sampled: a triangle whose plane has the whole
scene on one side (the wall of a convex room) blocks nothing.
"""

from __future__ import annotations

from math import gcd
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import guarded_divide
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import sample_patches, sequence

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["pair_visibility", "possible_blockers"]

#: pairs that are sampled at a time
BLOCK = 2**17


def possible_blockers(
    corners: Float[Tensor, "triangle 3 3"], points: Float[Tensor, "point 3"], margin: float
) -> Bool[Tensor, "triangle"]:
    """False for triangles whose plane has all `points` on one side, up to `margin` (m)."""
    a, b, c = corners.detach().to(torch.float64).unbind(1)
    normal = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1)
    lowest, highest = [], []
    for n, o in zip(normal.split(1024), (normal * a).sum(-1).split(1024), strict=True):
        height = n @ points.detach().to(normal).mT - o.unsqueeze(-1)
        lowest.append(height.amin(-1))
        highest.append(height.amax(-1))
    if not lowest:
        return torch.zeros(0, dtype=torch.bool, device=corners.device)
    return (torch.cat(lowest) < -margin) & (torch.cat(highest) > margin)


@torch.no_grad()
def pair_visibility(
    patches: Patches,
    rays: AbstractRayCaster,
    receiver: Int[Tensor, "pair"],
    emitter: Int[Tensor, "pair"],
    samples: int = 4,
    seed: int = 0,
) -> Float[Tensor, "pair"]:
    """Share of the segments between two patches that nothing blocks, 0..1.

    Args:
        patches: one-sided.
        rays: the blockers.
        receiver, emitter: indices of the pairs.
        samples: segments of every pair; penumbras get 4 x as many in all.
        seed: of the random shifts.

    Returns:
        0..1, detached.
    """
    generator = torch.Generator().manual_seed(seed)
    points = _points(patches, rays, 4 * samples, generator)
    blocks = [
        _refined(points, rays, i, j, samples, generator)
        for i, j in zip(receiver.split(BLOCK), emitter.split(BLOCK), strict=True)
    ]
    return torch.cat(blocks) if blocks else patches.corners.new_zeros(0)


class _Points(NamedTuple):
    """Stratified points of all patches, lifted off them, and the planes of the patches."""

    position: Float[Tensor, "patch sample 3"]
    normal: Float[Tensor, "patch 3"]
    offset: Float[Tensor, "patch"]


def _points(
    patches: Patches, rays: AbstractRayCaster, count: int, generator: torch.Generator
) -> _Points:
    corners, normal = patches.corners.detach(), patches.normal.detach()
    shift = torch.rand(len(corners), 1, 2, generator=generator, dtype=torch.float64)
    where = (sequence(count, 2, corners) + shift.to(corners)).frac()
    position = rays.lift(sample_patches(corners.unsqueeze(1), where), normal.unsqueeze(1))
    return _Points(position, normal, (normal * corners[:, 0]).sum(-1))


def _refined(
    points: _Points,
    rays: AbstractRayCaster,
    i: Tensor,
    j: Tensor,
    samples: int,
    generator: torch.Generator,
) -> Tensor:
    count = points.position.shape[1]
    first = torch.randint(count, (2, len(i), 1), generator=generator).to(i.device)
    step = torch.arange(count, device=i.device)
    order = (first + torch.stack((step, step * _coprime(count))).unsqueeze(1)) % count
    free, valid = _segments(points, rays, i, j, order[..., :samples])
    mixed = torch.nonzero((free > 0) & (free < valid)).squeeze(-1)
    more, more_valid = _segments(points, rays, i[mixed], j[mixed], order[:, mixed, samples:])
    free = free.index_add(0, mixed, more)
    valid = valid.index_add(0, mixed, more_valid)
    return torch.where(valid > 0, guarded_divide(free, valid), 1)


def _coprime(count: int) -> int:
    """A step through the emitter's points that meets each once and far from its neighbours."""
    return next(k for k in range(max(1, round(count * 0.382)), count + 1) if gcd(k, count) == 1)


def _segments(
    points: _Points,
    rays: AbstractRayCaster,
    i: Tensor,
    j: Tensor,
    order: Int[Tensor, "2 pair sample"],
) -> tuple[Tensor, Tensor]:
    """How many segments are free, and how many lie in front of both patches."""
    a, b = i.unsqueeze(-1), j.unsqueeze(-1)
    here, there = points.position[a, order[0]], points.position[b, order[1]]
    above = torch.einsum("psx,px->ps", there, points.normal[i]) > points.offset[a]
    valid = above & (torch.einsum("psx,px->ps", here, points.normal[j]) > points.offset[b])
    free = rays.visible(here, there) & valid
    return free.sum(-1).to(here), valid.sum(-1).to(here)
