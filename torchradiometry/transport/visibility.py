"""How much of each other patches see, by rays between stratified points of both.

    V_ij = (segments from i to j that are free) / (segments in front of both)

Every pair gets the same evenly spread four-dimensional sequence (two numbers for each end),
shifted by its own random vector. Pairs whose first `samples` segments disagree lie in a
penumbra and get three times as many more. The standard error of a pair with visibility V is
at most sqrt(V (1 - V) / n), n = 4 x samples in penumbras.

Only pairs that a triangle could come between are sampled: a triangle whose plane has the whole
scene on one side (the wall of a convex room) blocks nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

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
    shift = torch.Generator().manual_seed(seed)
    blocks = [
        _refined(patches, rays, i, j, samples, shift)
        for i, j in zip(receiver.split(BLOCK), emitter.split(BLOCK), strict=True)
    ]
    return torch.cat(blocks) if blocks else patches.corners.new_zeros(0)


def _refined(
    patches: Patches,
    rays: AbstractRayCaster,
    i: Tensor,
    j: Tensor,
    samples: int,
    generator: torch.Generator,
) -> Tensor:
    shift = torch.rand(len(i), 4, generator=generator, dtype=torch.float64).to(patches.corners)
    where = sequence(4 * samples, 4, patches.corners)
    free, valid = _segments(patches, rays, i, j, where[:samples], shift)
    mixed = torch.nonzero((free > 0) & (free < valid)).squeeze(-1)
    more, more_valid = _segments(
        patches, rays, i[mixed], j[mixed], where[samples:], shift[mixed]
    )
    free = free.index_add(0, mixed, more)
    valid = valid.index_add(0, mixed, more_valid)
    return torch.where(valid > 0, guarded_divide(free, valid), 1)


def _segments(
    patches: Patches,
    rays: AbstractRayCaster,
    i: Tensor,
    j: Tensor,
    where: Float[Tensor, "sample 4"],
    shift: Float[Tensor, "pair 4"],
) -> tuple[Tensor, Tensor]:
    """How many segments are free, and how many lie in front of both patches."""
    u = (where + shift.unsqueeze(1)).frac()
    normal = patches.normal
    here = sample_patches(patches.corners[i].unsqueeze(1), u[..., :2])
    there = sample_patches(patches.corners[j].unsqueeze(1), u[..., 2:])
    n, m = normal[i].unsqueeze(1), normal[j].unsqueeze(1)
    valid = ((n * (there - here)).sum(-1) > 0) & ((m * (here - there)).sum(-1) > 0)
    free = rays.visible(rays.lift(here, n), rays.lift(there, m)) & valid
    return free.sum(-1).to(here), valid.sum(-1).to(here)
