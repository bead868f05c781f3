"""Pairs of patches that see each other wholly, or not at all, because of one convex blocker.

For a convex planar blocker with the unit normal n and the edges k (outward normal w_k in its
plane), a point c has the height h = n . c - o and lies g_k = w_k . c - o_k outside of edge k.

**Hidden.** Let all corners of one patch have h > 0 and all of the other h < 0. The segment from a
to b meets the plane at  x = (|h_b| a + |h_a| b) / (|h_a| + |h_b|), inside of edge k if

    g_k(a) / |h_a| + g_k(b) / |h_b| <= 0.

With a fixed, b -> x is a projective map whose denominator keeps its sign, so it maps the hull
of the corners b_j onto the hull of their images; the same holds for a. If all corner-to-corner
segments pass through the convex blocker, all segments between the patches do. The sum has
one term for each patch: the largest g_k / |h| over the corners of each decides.

**Visible.** A plane through the line of edge k is c_k h + g_k = 0 with any slope c_k, and the
blocker lies on its side g <= 0. Corners with h > 0 lie beyond it if c_k >= -g_k / h, those with
h < 0 if c_k <= g_k / |h|: every patch has an interval of slopes with all its corners beyond. If
the intervals of two patches meet, the plane separates the pair's convex hull from the
blocker, and nothing of it comes between. The same is true if both lie on one side of the
blocker's own plane, or if the blocker lies behind one of the patches.

Both tests have parts that belong to one patch alone, so a pair costs a few comparisons. What is
wholly visible for all blockers and what is hidden by one needs no rays.

References: E. Haines and J. Wallace, "Shaft Culling for Efficient Ray-Cast Radiosity",
Eurographics Workshop on Rendering (1991), for the task.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import require_axes
from torchradiometry.geometry.patches import Patches, check_patches, vector_area
from torchradiometry.numerics import guarded_divide, safe_normalize
from torchradiometry.transport.rules import check_pairs

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["certain_pairs"]

#: slopes that are tried at once, as bits of one number, before the intervals are compared
SLOPES = 15
#: bit of blockers that lie behind a patch: the sign
BEHIND = -(2**63)
#: pairs x blockers that are looked up at a time
BLOCK = 2**18


class _Shadows(NamedTuple):
    """What each blocker says about every patch."""

    bits: Int[Tensor, "patch *blocker"]  #: sides of the plane, tried slopes, `BEHIND`
    lowest: Float[Tensor, "patch *blocker side"]  #: smallest slope that leaves it beyond
    highest: Float[Tensor, "patch *blocker side"]  #: largest
    reach: Float[Tensor, "patch *blocker side"]  #: largest g / |h|
    strictly: Float[Tensor, "patch *blocker"]  #: +1 or -1 wholly off the plane, 0 otherwise


@torch.no_grad()
def certain_pairs(
    patches: Patches,
    blockers: Float[Tensor, "blocker 4 3"],
    receiver: Int[Tensor, "pair"],
    emitter: Int[Tensor, "pair"],
    margin: float = 0.0,
) -> tuple[Bool[Tensor, "pair"], Bool[Tensor, "pair"]]:
    """Which pairs surely see each other wholly, and which surely see nothing of each other.

    Args:
        patches: one-sided, convex.
        blockers: planar, convex, m; see `convex_blockers`.
        receiver, emitter: indices of the pairs.
        margin: a blocker that reaches into the pair's hull by less does not block; one that is
            nearer to a patch does not hide it, m.

    Returns:
        (visible, hidden). Pairs that are neither may still be either.

    Raises:
        DTypeError, ShapeError, InvalidValueError, OutOfRangeError: patches as of `form_factors`.
        DTypeError, ShapeError, IndexRangeError: pairs as of `pair_visibility`.

    >>> square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> pair = Patches(torch.stack((square, square.flip(0) + torch.tensor([0.0, 0, 2]))))
    >>> wall = (square * 3 + torch.tensor([-1.0, -1, 1])).unsqueeze(0)
    >>> certain_pairs(pair, wall, torch.tensor([0]), torch.tensor([1]))
    (tensor([False]), tensor([True]))
    """
    check_patches(patches)
    check_pairs(patches.count, receiver, emitter)
    require_axes("blockers", blockers, None, 4, 3)
    visible = torch.ones_like(receiver, dtype=torch.bool)
    hidden = torch.zeros_like(visible)
    if len(blockers) == 0:
        return visible, hidden
    corners = patches.corners.detach().to(torch.float64)
    middle = corners.reshape(-1, 3).mean(0)
    screens = blockers.detach().to(corners) - middle
    each = [_shadows(corners - middle, screen, margin) for screen in screens]
    shadows = _Shadows(*(torch.stack(values, 1) for values in zip(*each, strict=True)))
    for place in torch.arange(len(receiver), device=receiver.device).split(BLOCK // len(blockers)):
        i, j = receiver[place], emitter[place]
        first, second = shadows.bits[i], shadows.bits[j]
        free = ((first & second & ~BEHIND) != 0) | ((first | second) < 0)
        pair, blocker = torch.nonzero(~free, as_tuple=True)
        i, j = i[pair], j[pair]
        visible[place[pair[~_separated(shadows, i, j, blocker)]]] = False
        hidden[place[pair[_covered(shadows, i, j, blocker)]]] = True
    return visible & ~hidden, hidden


def _separated(shadows: _Shadows, i: Tensor, j: Tensor, blocker: Tensor) -> Bool[Tensor, "trial"]:
    lowest = torch.maximum(shadows.lowest[i, blocker], shadows.lowest[j, blocker])
    highest = torch.minimum(shadows.highest[i, blocker], shadows.highest[j, blocker])
    return (lowest <= highest).any(-1)


def _covered(shadows: _Shadows, i: Tensor, j: Tensor, blocker: Tensor) -> Bool[Tensor, "trial"]:
    opposite = shadows.strictly[i, blocker] * shadows.strictly[j, blocker] < 0
    reach = shadows.reach[i, blocker] + shadows.reach[j, blocker]
    return opposite & (reach <= 0).all(-1)


def _shadows(
    corners: Float[Tensor, "patch corner 3"], screen: Float[Tensor, "side 3"], margin: float
) -> _Shadows:
    normal = safe_normalize(vector_area(screen))
    edge = screen.roll(-1, 0) - screen
    outward = safe_normalize(torch.linalg.cross(edge, normal.expand_as(edge)))
    height = (corners - screen[0]) @ normal
    beside = (corners @ outward.mT) - (outward * screen).sum(-1)
    real = (edge != 0).any(-1)
    slope = guarded_divide(beside, height.abs().unsqueeze(-1))
    above, below = (height > 0).unsqueeze(-1), (height < 0).unsqueeze(-1)
    level = ~above & ~below & (beside < -margin)
    # a plane may cut off `margin` of a corner: measured along w, a stricter length than across
    easier = guarded_divide(beside + margin, height.abs().unsqueeze(-1))
    lowest = torch.where(above, -easier, -torch.inf).amax(1)
    highest = torch.where(below, easier, torch.inf).amin(1)
    lowest = torch.where(level.any(1) | ~real, torch.inf, lowest)
    off = (height.amin(1) > margin).double() - (height.amax(1) < -margin).double()
    reach = torch.where(real, slope.amax(1), -torch.inf)
    front = safe_normalize(vector_area(corners))
    behind = (screen @ front.mT - (front * corners[:, 0]).sum(-1)).amax(0) <= margin
    sides = torch.stack((height.amin(1) >= -margin, height.amax(1) <= margin), -1)
    bits = _packed(sides, lowest, highest) | torch.where(behind, BEHIND, 0)
    return _Shadows(bits, lowest, highest, reach, off)


def _packed(sides: Tensor, lowest: Tensor, highest: Tensor) -> Int[Tensor, "patch"]:
    """One bit for each side of the plane, and for each tried slope within an edge's interval."""
    angle = torch.arange(1, SLOPES + 1, device=sides.device) * (math.pi / (SLOPES + 1))
    tried = (1 / torch.tan(angle)).to(lowest)
    within = (lowest.unsqueeze(-1) <= tried) & (tried <= highest.unsqueeze(-1))
    every = torch.cat((sides, within.flatten(1)), 1)
    power = 2 ** torch.arange(every.shape[1], device=sides.device)
    return (every * power).sum(-1)
