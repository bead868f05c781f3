"""Supersampling: pixels that show an edge, or light that bends.

One ray a pixel is right where the picture is linear. With s^2 rays a pixel where light bends (the
edges of shadows, textures) and (2s)^2 at edges of surfaces, the error of those pixels falls as
the 3/2-th power of the rays along a side (stratified sampling of an edge).

References: D. Mitchell, "Consequences of Stratified Sampling in Graphics", SIGGRAPH 1996.
"""

from __future__ import annotations

from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot

__all__ = ["Supersampling"]

#: settings to choose among, beside one ray
SIDES = (2, 3, 4, 6)
#: factors on the error of one ray at edges and inside of surfaces, and the power of rays a side
EDGE, INSIDE, POWER = 1.6, 1.1, -1.5


@final
class Supersampling(AbstractEffect):
    """Smooth edges."""

    name = "supersampling"
    adds = "smooth edges of surfaces, shadows and textures"

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        if pilot.camera is None:
            return (Level("left out", 0.0, "exact", {"supersampling": 1}),)
        at_edges, inside, _, _ = pilot.one_ray
        at_edges += pilot.unseen
        if any(s.texture is not None or s.glossy for s in pilot.scene.surfaces):
            at_edges, inside = 0.0, at_edges + inside
        levels = [Level("left out", at_edges + inside, "estimate", {"supersampling": 1})]
        for s in SIDES:
            error = EDGE * at_edges * (2 * s) ** POWER + INSIDE * inside * s**POWER
            levels.append(Level(f"{s} x {s}", error, "estimate", {"supersampling": s}))
        return tuple(levels)

    def why(self, pilot: Pilot, level: Level) -> str:
        if level.name == "left out":
            return "no picture" if pilot.camera is None else "edges matter little"
        return f"{pilot.one_ray.share:.1%} of the pixels show edges"
