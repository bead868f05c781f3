"""Specular lobe: highlights, and surfaces that show in others.

    left out    shiny surfaces are dull: L_s is missing
    k rays      L_s along k directions of every pixel (`render.lobes`); its noise remains

What lobes send to other surfaces is spread evenly at every level. That much light of the picture
may lie in the wrong place: the share that lobes have in reflected light, and what lobes show of
lobes.
"""

from __future__ import annotations

import math
from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.highlights import FEW
from torchradiometry.plan.pilot import Pilot

__all__ = ["SpecularLobe"]

#: rays of a pixel to choose among, and the power of 1 / rays by which the noise falls
RAYS, POWER = (4, 16, 64, 256), 0.7
#: factor on the light that lobes sent to where it may not belong
SPREAD = 1.0


@final
class SpecularLobe(AbstractEffect):
    """Highlights of lamps and of other surfaces."""

    name = "specular lobe"
    adds = "highlights, and reflections of other surfaces"

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        off = {"lobe_samples": 0}
        if not any(surface.glossy for surface in pilot.scene.surfaces):
            return (Level("left out", 0.0, "exact", off),)
        found = pilot.highlights
        if pilot.light <= 0:
            return (Level("left out", 0.0, "exact", off),)
        spread = self.spread(pilot)
        if pilot.camera is None or not found.shiny:
            return (Level("left out", spread, "estimate", off),)
        missing = pilot.error_of(math.pi * found.radiance.sum(-1))
        noise = pilot.error_of(math.pi * (found.noisy - found.radiance).abs().sum(-1))
        levels = [Level("left out", missing + pilot.unseen + spread, "estimate", off)]
        for count in RAYS:
            error = noise * (FEW / count) ** POWER + spread
            if error < levels[-1].error:
                levels.append(Level(f"{count} rays", error, "estimate", {"lobe_samples": count}))
        return tuple(levels)

    def spread(self, pilot: Pilot) -> float:
        """Relative L1 error by spreading evenly what lobes send to other surfaces."""
        reflected = (pilot.albedo * pilot.reflections.irradiance).sum(-1)
        even = pilot.sent_by_lobes * reflected + math.pi * pilot.highlights.even.sum(-1)
        return SPREAD * pilot.error_of(even)

    def why(self, pilot: Pilot, level: Level) -> str:
        if level.kind == "exact":
            return "no surface is shiny" if pilot.light > 0 else "no light arrives"
        if pilot.camera is None:
            return "no eye to see highlights"
        if level.name == "left out":
            return "highlights are faint" if pilot.highlights.shiny else "nothing shiny is seen"
        return f"{pilot.highlights.shiny:.0%} of what is seen is shiny"
