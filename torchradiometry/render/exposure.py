"""Which parts of patches lie free, which are buried in other bodies, and is the scene closed.

From points of every patch rays go out over its hemisphere. A ray that meets the black back of
a one-sided face has met the inside of a body. A point all of whose rays do so is buried (the
floor under a box): it neither sends nor receives, and the patch's exposed area shrinks. A
patch is enclosed if all rays of its free points meet fronts: what leaves it, arrives at other
patches, and its row of form factors sums to 1. Few rays show that a room is closed; as soon as one
of them leaves the scene, all points look more closely.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.patches import Patches
from torchradiometry.render.direct import cosine_directions
from torchradiometry.render.points import look
from torchradiometry.render.world import World
from torchradiometry.transport.rules import sample_patches, sequence

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["Exposure", "exposure_of"]

#: points of a patch
POINTS = 16
#: rays from each point, and more where one of the first met a back, or where any met nothing
FIRST, MORE = 4, 8
#: patches that are sampled at a time
BLOCK = 2**11


class Exposure(NamedTuple):
    """What the probing rays found.

    Attributes:
        share: of the patch that lies free, 0..1.
        enclosed: the patch sees nothing but fronts of faces.
        point: stratified points of the patches, m.
        free: which of them lie free.
    """

    share: Float[Tensor, "patch"]
    enclosed: Bool[Tensor, "patch"]
    point: Float[Tensor, "patch point 3"]
    free: Bool[Tensor, "patch point"]

    @property
    def closed(self) -> bool:
        """Every patch that is not wholly buried is enclosed."""
        return bool((self.enclosed | (self.share == 0)).all())


@torch.no_grad()
def exposure_of(world: World, patches: Patches, seed: int) -> Exposure:
    """Probe the hemisphere of every patch."""
    generator = torch.Generator().manual_seed(seed)
    parts = [
        _probe(world, Patches(c), n, generator)
        for c, n in zip(
            patches.corners.detach().split(BLOCK), patches.normal.detach().split(BLOCK), strict=True
        )
    ]
    point, buried, fronts = (torch.cat(column) for column in zip(*parts, strict=True))
    enclosed = (fronts | buried).all(-1) & ~buried.all(-1)
    return Exposure((~buried).to(point).mean(-1), enclosed, point, ~buried)


def _probe(
    world: World, patches: Patches, normal: Tensor, generator: torch.Generator
) -> tuple[Tensor, ...]:
    """Points of patches; whether each is buried, and whether it sees nothing but fronts."""
    count, like = patches.count, patches.corners
    shift = torch.rand(count, 1, 2, generator=generator, dtype=torch.float64).to(like)
    where = (sequence(POINTS, 2, like) + shift).frac()
    point = sample_patches(patches.corners.unsqueeze(1), where)
    turn = torch.rand(count * POINTS, 1, 2, generator=generator, dtype=torch.float64).to(like)
    n = normal.repeat_interleave(POINTS, 0)
    place = (sequence(FIRST + MORE, 2, like) + turn).frac()
    start = world.rays.lift(point.reshape(-1, 3), n)
    seen = _looked(world, start, n, place[:, :FIRST])
    again = torch.nonzero(seen[1] | seen[2].any()).squeeze(-1)
    seen[:, again] |= _looked(world, start[again], n[again], place[again, FIRST:])
    front, back, nothing = seen.reshape(3, count, POINTS)
    return point, back & ~front & ~nothing, ~back & ~nothing


def _looked(
    world: World,
    start: Float[Tensor, "point 3"],
    normal: Float[Tensor, "point 3"],
    where: Float[Tensor, "point ray 2"],
) -> Bool[Tensor, "3 point"]:
    """Whether any ray of a point meets a front, a black back, or nothing."""
    direction = cosine_directions(where, normal)
    front, back = look(world, start.unsqueeze(1), direction)
    return torch.stack((front, back, ~front & ~back)).any(-1)
