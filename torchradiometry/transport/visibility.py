"""How much of each other patches see: exactly where geometry tells, else by stratified rays.

    V_ij = (segments from i to j that are free) / (segments in front of both)

Pairs whose hull no blocker enters, and pairs that one convex blocker hides, need no rays
(`shafts`); in the largest scenes only the largest blockers are tried, and only for hiding. Every
other pair draws `samples` segments between stratified points of both patches. As many
segments again as pairs that were found in a penumbra get 3 x `samples` are then dealt out to
all of them by weight and doubt (Neyman 1934),

    n_p  ~  w_p sqrt(m_p (1 - m_p)),      m_p = (free + 1/2) / (segments + 1),

which makes sum_p (w_p error_p)^2 smallest. m_p is the mean of V under Jeffreys' prior, which
expects most pairs near 0 or 1: four free segments make a pair likely visible, and prove nothing.
The stated error is the root mean square of V - free/segments under the same prior,

    error_p^2 = m (1 - m) / (n + 2) + (free/n - m)^2,

so that it is not 0 where all segments agree. Strata make the true error smaller, not larger:
over the pairs of the Cornell-like room it is about 0.7 of what is stated.

References: J. Neyman, "On the two different aspects of the representative method", J. R. Stat.
Soc. 97 (1934); H. Jeffreys, Proc. R. Soc. A 186 (1946), for the prior.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import (
    require_kind,
    require_whole,
)
from torchradiometry.geometry.patches import Patches, check_patches
from torchradiometry.numerics import guarded_divide, safe_sqrt
from torchradiometry.transport.blockers import convex_blockers, possible_blockers
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import check_pairs, sample_patches, sequence
from torchradiometry.transport.shafts import certain_pairs

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["TRIALS", "PairVisibility", "pair_visibility", "possible_blockers"]

#: segments that are drawn at a time
BLOCK = 2**19
#: convex blockers that are tried on all pairs for each segment that a pair would draw: a trial
#: costs about a tenth of a segment and saves most of them
TRIALS = 8
#: a pair draws at most this many times the segments it began with
MOST = 16
#: doubt, over the largest, that earns no second segments
NEGLIGIBLE = 2.0**-64
#: segments of each answer that are imagined beforehand (Jeffreys)
PRIOR = 0.5


class PairVisibility(NamedTuple):
    """Visibility of pairs.

    Attributes:
        visibility: 0..1.
        error: standard error of it; 0 where it is exact.
    """

    visibility: Float[Tensor, "pair"]
    error: Float[Tensor, "pair"]


@torch.no_grad()
def pair_visibility(
    patches: Patches,
    rays: AbstractRayCaster,
    receiver: Int[Tensor, "pair"],
    emitter: Int[Tensor, "pair"],
    samples: int = 4,
    seed: int = 0,
    weight: Float[Tensor, "pair"] | None = None,
) -> PairVisibility:
    """Share of the segments between two patches that nothing blocks, and its standard error.

    Args:
        patches: one-sided.
        rays: the blockers.
        receiver, emitter: indices of the pairs.
        samples: segments of every pair that is not certain; in the mean 4 x as many in penumbras.
        seed: of the random shifts.
        weight: how much the error of a pair matters, >= 0 (its unoccluded exchange area).
            None: all the same.

    Returns:
        0..1 each, detached.

    Raises:
        DTypeError, ShapeError, InvalidValueError, OutOfRangeError: patches as of `form_factors`.
        DTypeError, OutOfRangeError: samples that are no whole number from 1 to 65536.
        DTypeError, ShapeError, IndexRangeError: indices that are not whole, not as many of both,
            or of no patch.
    """
    check_patches(patches)
    require_kind("rays", rays, AbstractRayCaster, "ray caster, such as EmbreeRays(triangles)")
    require_whole("samples", samples, 1, 2**16)
    check_pairs(patches.count, receiver, emitter)
    generator = torch.Generator().manual_seed(seed)
    visible, hidden = _certain(patches, rays, receiver, emitter, samples)
    doubtful = torch.nonzero(~(visible | hidden)).squeeze(-1)
    visibility = visible.to(patches.corners)
    error = torch.zeros_like(visibility)
    if len(doubtful):
        points = _points(patches, rays, 4 * samples, generator)
        matters = visibility.new_ones(len(receiver)) if weight is None else weight.to(visibility)
        i, j, matters = receiver[doubtful], emitter[doubtful], matters[doubtful].detach()
        found = _sampled(points, rays, i, j, samples, matters, generator)
        visibility[doubtful], error[doubtful] = found
    return PairVisibility(visibility, error)


def _certain(
    patches: Patches, rays: AbstractRayCaster, i: Tensor, j: Tensor, samples: int
) -> tuple[Bool[Tensor, "pair"], Bool[Tensor, "pair"]]:
    """Pairs that surely are wholly visible, and surely hidden."""
    points = patches.corners.detach().reshape(-1, 3).to(torch.float64)
    triangles = rays.corners.to(points.device)
    possible = possible_blockers(triangles, points, rays.tolerance)
    blockers = convex_blockers(triangles[possible])
    most = TRIALS * samples
    few = len(blockers) <= most
    if not few:
        size = Patches(blockers).area.argsort(descending=True)
        blockers = blockers[size[:most]]
    visible, hidden = certain_pairs(patches, blockers, i, j, rays.tolerance)
    return visible & few, hidden


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


def _sampled(
    points: _Points,
    rays: AbstractRayCaster,
    i: Tensor,
    j: Tensor,
    samples: int,
    weight: Tensor,
    generator: torch.Generator,
) -> tuple[Float[Tensor, "pair"], Float[Tensor, "pair"]]:
    """Visibility and its error, in two rounds of segments."""
    start = torch.randint(points.position.shape[1], (2, len(i)), generator=generator).to(i.device)
    drawn = torch.full_like(i, samples)
    free, valid = _segments(points, rays, i, j, start, torch.zeros_like(drawn), drawn)
    mixed = ((free > 0) & (free < valid)).sum()
    mean = _mean(free, valid)
    doubt = weight * safe_sqrt(mean * (1 - mean))
    more = _shares(doubt, 3 * samples * int(mixed), samples, MOST * samples)
    again = torch.nonzero(more).squeeze(-1)
    ends = (i[again], j[again], start[:, again], drawn[again], more[again])
    extra, extra_valid = _segments(points, rays, *ends)
    free = free.index_add(0, again, extra)
    valid = valid.index_add(0, again, extra_valid)
    return torch.where(valid > 0, guarded_divide(free, valid), 1), _error(free, valid)


def _error(free: Tensor, valid: Tensor) -> Float[Tensor, "pair"]:
    """Root mean square of V - free/valid under the prior; 0 if no segment is valid."""
    mean = _mean(free, valid)
    off = guarded_divide(free, valid) - mean
    spread = mean * (1 - mean) / (valid + 2 * PRIOR + 1)
    return torch.where(valid > 0, safe_sqrt(spread + off * off), 0)


def _mean(free: Tensor, valid: Tensor) -> Float[Tensor, "pair"]:
    """Expected V after `free` of `valid` segments."""
    return (free + PRIOR) / (valid + 2 * PRIOR)


def _shares(doubt: Float[Tensor, "pair"], total: int, drawn: int, most: int) -> Int[Tensor, "pair"]:
    """Whole numbers n_p - drawn with n_p ~ doubt, from 0 to most - drawn, that sum to `total`.

    The factor of proportionality is found by bisection of its logarithm; the sum is at most
    `total`.
    """
    doubt = guarded_divide(doubt, doubt.max())
    some = doubt[doubt > NEGLIGIBLE]
    total = min(total, (most - drawn) * len(some))
    if total == 0:
        return torch.zeros_like(doubt, dtype=torch.int64)
    low, high = math.log(drawn / float(some.max())), math.log(most / float(some.min()))
    for _ in range(64):
        middle = (low + high) / 2
        spent = (math.exp(middle) * doubt - drawn).clamp(0, most - drawn).floor().sum()
        low, high = (middle, high) if spent <= total else (low, middle)
    return (math.exp(low) * doubt - drawn).clamp(0, most - drawn).floor().long()


def _coprime(count: int) -> int:
    """A step through the emitter's points that meets each once and far from its neighbours."""
    return next(
        k for k in range(max(1, round(count * 0.382)), count + 1) if math.gcd(k, count) == 1
    )


def _segments(
    points: _Points,
    rays: AbstractRayCaster,
    i: Tensor,
    j: Tensor,
    start: Int[Tensor, "2 pair"],
    drawn: Int[Tensor, "pair"],
    number: Int[Tensor, "pair"],
) -> tuple[Float[Tensor, "pair"], Float[Tensor, "pair"]]:
    """How many of `number` further segments are free, and how many lie in front of both patches.

    The k-th segment joins the k-th point of one patch, counted from `start`, to a far neighbour
    of the (k-1)-th partner; after a whole turn the partners are shifted by one.
    """
    free, valid = points.offset.new_zeros(2, len(i)).unbind()
    count = points.position.shape[1]
    pair = torch.repeat_interleave(torch.arange(len(i), device=i.device), number)
    before = number.cumsum(0) - number
    step = torch.arange(len(pair), device=i.device) - before[pair] + drawn[pair]
    for p, k in zip(pair.split(BLOCK), step.split(BLOCK), strict=True):
        a, b = i[p], j[p]
        here = points.position[a, (start[0, p] + k) % count]
        partner = start[1, p] + k * _coprime(count) + k // count
        there = points.position[b, partner % count]
        above = (there * points.normal[a]).sum(-1) > points.offset[a]
        both = above & ((here * points.normal[b]).sum(-1) > points.offset[b])
        clear = torch.zeros_like(both)
        clear[both] = rays.visible(here[both], there[both])
        free = free.index_add(0, p, clear.to(free))
        valid = valid.index_add(0, p, both.to(valid))
    return free, valid
