"""Patch size: how finely reflected light is resolved.

The pilot looks how much reflected light bends within coarse patches (`resolution`). The error
falls about in proportion to the longest edge, where faces are larger than that; smaller faces stay
as they are. Patches follow importance where there is a camera (`render.importance`).
"""

from __future__ import annotations

from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot
from torchradiometry.render.indirect import CLUSTER_ERROR, MOST_DENSE

__all__ = ["PatchSize"]

#: parts of the half diagonal of the scene to choose among
PARTS = tuple(1.5 * 2 ** (k / 4) for k in range(20))


@final
class PatchSize(AbstractEffect):
    """Resolution of reflected light."""

    name = "patches"
    adds = "gradients of reflected light, contacts, creases"
    needs = ("bounces",)

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        scale, found = pilot.world.rays.scale, pilot.reflections
        if found.decay <= 0 or pilot.light <= 0:
            return (Level("none", 0.0, "exact", {"patch_size": None}),)
        levels = []
        for parts in PARTS:
            size = scale / parts
            error = pilot.patch_error(size)
            count = pilot.patching.count(size, True)
            clustered = CLUSTER_ERROR if count > MOST_DENSE else 0.0
            chosen = {"patch_size": size, "importance": pilot.camera is not None}
            levels.append(Level(f"{size:.3g} m", error + clustered, "estimate", chosen))
        kept = levels[:1]
        for level in levels[1:]:
            if level.error < kept[-1].error:
                kept.append(level)
        return tuple(kept)

    def why(self, pilot: Pilot, level: Level) -> str:
        if level.name == "none":
            return "no light is exchanged"
        size, importance = level.settings["patch_size"], level.settings["importance"]
        return f"about {pilot.patching.count(size, importance):.0f} patches"
