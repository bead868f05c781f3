"""Cast shadows: surfaces that keep light from others."""

from __future__ import annotations

from dataclasses import replace
from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot

__all__ = ["CastShadows"]


@final
class CastShadows(AbstractEffect):
    """One shadow ray to each source, or its visible part."""

    name = "cast shadows"
    adds = "dark where something stands before the source"

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        off = {"shadow_samples": 0}
        if not pilot.blocks or not _shines(pilot):
            return (Level("left out", 0.0, "exact", off),)
        error = pilot.direct_error(replace(pilot.fine, shadow_samples=0)) + pilot.unseen
        return (
            Level("left out", error, "estimate", off),
            Level("cast", 0.0, "exact", {"shadow_samples": 1}),
        )

    def why(self, pilot: Pilot, level: Level) -> str:
        if not _shines(pilot):
            return "nothing shines"
        if level.kind == "exact" and level.name == "left out":
            return "no face can come between a surface and a source"
        return "faces shade others" if level.name == "cast" else "shadows are small or faint"


def _shines(pilot: Pilot) -> bool:
    return len(pilot.world.emitters.corners) > 0 or len(pilot.scene.sources) > 0
