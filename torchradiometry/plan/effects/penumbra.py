"""Penumbra: a point that sees part of a source.

Behind few faces the visible part is clipped exactly; among many it is sampled, with an error that
falls faster than 1 / sqrt(rays), because the rays are spread evenly.
"""

from __future__ import annotations

from dataclasses import replace
from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot

__all__ = ["Penumbra"]

#: rays to choose among, and the power of 1 / rays by which their error is taken to fall
RAYS, POWER = (2, 4, 8, 16, 32), 0.75


@final
class Penumbra(AbstractEffect):
    """Soft edges of the shadows of shining faces."""

    name = "penumbra"
    adds = "soft shadow edges"
    needs = ("shadow_samples", "extent")

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        off = {"penumbra": False}
        if len(pilot.world.emitters.corners) == 0 or not pilot.blocks:
            return (Level("left out", 0.0, "exact", off),)
        error = pilot.direct_error(replace(pilot.fine, penumbra=False)) + pilot.unseen
        none = Level("left out", error, "estimate", off)
        on = {"penumbra": True}
        if pilot.world.blockers is not None:
            return none, Level("clipped", 0.0, "exact", {**on, "shadow_samples": 1})
        first = pilot.direct_error(replace(pilot.fine, shadow_samples=RAYS[0]))
        return none, *(
            Level(
                f"{n} rays", first * (RAYS[0] / n) ** POWER, "estimate", {**on, "shadow_samples": n}
            )
            for n in RAYS
        )

    def why(self, pilot: Pilot, level: Level) -> str:
        if len(pilot.world.emitters.corners) == 0:
            return "no face shines, lamps cast hard shadows"
        if level.name == "left out":
            return "shadow edges matter little" if level.error else "there are no shadows"
        if level.name == "clipped":
            return "few faces block: the visible part is cut out exactly"
        return "four times as many rays where a source is partly hidden"
