"""Interreflection: light that comes by way of other surfaces, bounce by bounce.

    left out    E_1 + E_2 + ... is missing
    ambient     one number stands for it, calibrated by the balance of light (`render.ambient`)
    k bounces   E_1 ... E_k on patches, and a calibrated ambient tail for the rest

No point receives more than E_max directly (pi times the largest radiance, and what distant lamps
send), and a bounce keeps at most the share q of it, q the largest albedo. So k bounces miss at most

    E_max q^(k+1) / (1 - q)      at every point,

a bound; the pilot's own series is mostly far below it.
"""

from __future__ import annotations

import math
from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot
from torchradiometry.plan.reflections import COARSE

__all__ = ["Interreflection"]

#: numbers of bounces to choose among
BOUNCES = (1, 2, 4, 8, 16, 32, 64)
#: faces up to which light is exchanged between all of them
MOST_FACES = 48_000
#: factor on what the coarse pilot says is left after some bounces
MARGIN = 1.25
#: error below which more bounces are not asked for
NOTHING = 1e-4


@final
class Interreflection(AbstractEffect):
    """Reflected light."""

    name = "interreflection"
    adds = "light in shadows, and everything that is lit by other surfaces"

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        found, lit = pilot.reflections, pilot.light > 0
        none = {"bounces": 0, "ambient": False}
        if found.decay <= 0 or not lit:
            return (Level("left out", 0.0, "exact", none),)
        missing = pilot.mean_error(found.irradiance)
        # what the pilot's own patches blur adds to how uneven reflected light is
        blur = pilot.patch_error(COARSE * pilot.world.rays.scale)
        missing, kind = min((missing, "estimate"), (_bound(pilot, 0), "bound"))
        levels = [
            Level("left out", missing, kind, none),
            Level(
                "ambient",
                pilot.mean_error(found.irradiance - found.ambient) + blur,
                "estimate",
                {"bounces": 0, "ambient": True},
            ),
        ]
        if len(pilot.world.faces.corners) > MOST_FACES:
            return tuple(levels)
        for count in BOUNCES:
            left = MARGIN * pilot.mean_error(found.irradiance - found.after(count))
            error, kind = min((left, "estimate"), (_bound(pilot, count), "bound"))
            settings = {"bounces": count, "ambient": False}
            if error < levels[-1].error:
                levels.append(Level(f"{count} bounces", error, kind, settings))
            if error < NOTHING:
                break
        return tuple(levels)

    def why(self, pilot: Pilot, level: Level) -> str:
        found = pilot.reflections
        if found.decay <= 0:
            return "nothing reflects, or no surface sees another"
        if pilot.light <= 0:
            return "no light arrives"
        if level.name == "left out":
            return "surfaces hardly light each other"
        if level.name == "ambient":
            return "reflected light is nearly even"
        return f"surfaces see each other; albedos up to {found.decay:.2g}"


def _bound(pilot: Pilot, bounces: int) -> float:
    """Largest relative L1 error by what is left after some bounces; infinite beside near lamps."""
    q = pilot.reflections.decay
    if q >= 1 or any(s.needs_position or not s.has_direction for s in pilot.scene.sources):
        return math.inf
    largest = math.pi * float(pilot.world.triangles.emission.max())
    for source in pilot.scene.sources:
        largest += float(source(None, pilot.points.normal[:1]).irradiance.detach().sum(0).max())
    reflected = float(pilot.albedo.sum()) / pilot.light
    return reflected * largest * q ** (bounces + 1) / (1 - q)
