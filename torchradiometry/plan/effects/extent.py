"""Area or point: a shining face sends light from all of its area, not from its middle."""

from __future__ import annotations

from dataclasses import replace
from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot

__all__ = ["SourceExtent"]


@final
class SourceExtent(AbstractEffect):
    """Shining faces that are large or near."""

    name = "area of sources"
    adds = "the true fall-off and softness of large sources"

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        if len(pilot.world.emitters.corners) == 0:
            return (Level("left out", 0.0, "exact", {"extent": False}),)
        error = pilot.direct_error(replace(pilot.fine, extent=False))
        return (
            Level("left out", error, "estimate", {"extent": False}),
            Level("exact", 0.0, "exact", {"extent": True}),
        )

    def why(self, pilot: Pilot, level: Level) -> str:
        if len(pilot.world.emitters.corners) == 0:
            return "no face shines"
        return "sources are large or near" if level.name == "exact" else "sources are small and far"
