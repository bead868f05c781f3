"""Near or distant: light of a lamp falls off as 1/r^2 and turns as one walks around it.

Taken as distant, a lamp sends to every point what it sends to the middle of the scene.
"""

from __future__ import annotations

from dataclasses import replace
from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot

__all__ = ["FallOff"]


@final
class FallOff(AbstractEffect):
    """Lamps that are near."""

    name = "near fall-off"
    adds = "brighter and turned light close to a lamp"

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        if not any(source.needs_position for source in pilot.scene.sources):
            return (Level("left out", 0.0, "exact", {"near": False}),)
        error = pilot.direct_error(replace(pilot.fine, near=False))
        return (
            Level("left out", error, "estimate", {"near": False}),
            Level("exact", 0.0, "exact", {"near": True}),
        )

    def why(self, pilot: Pilot, level: Level) -> str:
        if not pilot.scene.sources:
            return "the scene has no lamps"
        if level.kind == "exact" and level.name == "left out":
            return "all lamps are distant"
        return "lamps are near" if level.name == "exact" else "lamps are far enough"
