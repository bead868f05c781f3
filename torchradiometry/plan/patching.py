"""How many patches a size makes, and how many pairs of them can exchange light, before any is made.

The number is counted on the renderer's own grid. What share of the pairs face each other, and of
those what share something hides, is asked of a sample of points, each on a face that is drawn as
often as it has patches.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch

from torchradiometry.geometry.patches import vector_area
from torchradiometry.numerics import safe_normalize
from torchradiometry.render.importance import Visits, relative_sizes
from torchradiometry.render.indirect import patch_splits
from torchradiometry.render.world import World
from torchradiometry.transport.rules import sample_patches

if TYPE_CHECKING:
    from jaxtyping import Int

__all__ = ["Pairs", "Patching"]

#: pairs of patches that are looked at
PAIRS = 1024


class Pairs(NamedTuple):
    """Pairs of patches.

    Attributes:
        facing: share that lie in front of each other.
        hidden: share of those whose points something stands between.
    """

    facing: float
    hidden: float


class Patching:
    """Patches of a scene at any size.

    Args:
        world: a prepared scene.
        seen: what a camera looks at; None: everything, alike.
        seed: of the sample of pairs.
    """

    def __init__(self, world: World, seen: Visits | None, seed: int) -> None:
        self.world, self.seed = world, seed
        self.relative = (
            world.normal.new_ones(len(world.faces.corners))
            if seen is None
            else relative_sizes(world, seen)
        )
        self._counts: dict[tuple[float, bool], float] = {}
        self._pairs: dict[tuple[int, bool], Pairs] = {}

    def count(self, size: float, importance: bool) -> float:
        """How many patches that size (m) makes."""
        if (size, importance) not in self._counts:
            self._counts[size, importance] = float(self._splits(size, importance).square().sum())
        return self._counts[size, importance]

    def pairs(self, size: float, importance: bool) -> Pairs:
        """Of patches of about that size (m): to an octave."""
        scale = self.world.rays.scale
        octave = round(math.log2(scale / size)), importance
        if octave not in self._pairs:
            self._pairs[octave] = self._sampled(scale * 2.0 ** -octave[0], importance)
        return self._pairs[octave]

    def _splits(self, size: float, importance: bool) -> Int[torch.Tensor, "face"]:
        return patch_splits(self.world, size * self.relative if importance else size)

    def _sampled(self, size: float, importance: bool) -> Pairs:
        faces, rays = self.world.faces.corners, self.world.rays
        generator = torch.Generator().manual_seed(self.seed)
        reached = self._splits(size, importance).square().cumsum(0)
        where = torch.rand(2 * PAIRS, 3, generator=generator, dtype=torch.float64).to(faces)
        face = torch.searchsorted(reached, (where[:, 0] * reached[-1]).contiguous(), right=True)
        face = face.clamp(max=len(faces) - 1)
        here, there = sample_patches(faces[face], where[:, 1:]).chunk(2)
        one, other = safe_normalize(vector_area(faces))[face].chunk(2)
        way = there - here
        front = ((way * one).sum(-1) > 0) & ((way * other).sum(-1) < 0)
        if not bool(front.any()):
            return Pairs(0.0, 0.0)
        ends = (rays.lift(here[front], one[front]), rays.lift(there[front], other[front]))
        hidden = (~rays.visible(*ends)).double().mean()
        return Pairs(float(front.double().mean()), float(hidden))
