"""Supersampling: pixels that show an edge, or light that bends.

One ray a pixel is right where the picture is linear. With s^2 rays a pixel where light bends and
(2s)^2 at edges, the error of those pixels falls as the 3/2-th power of the rays along a side
(stratified sampling of an edge).

References: D. Mitchell, "Consequences of Stratified Sampling in Graphics", SIGGRAPH 1996.
"""

from __future__ import annotations

from typing import final

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot

__all__ = ["Supersampling"]

#: settings to choose among; factor on the error of one ray, for s = 2 and more
SIDES, FACTOR = (1, 2, 3, 4, 6), 1.5


@final
class Supersampling(AbstractEffect):
    """Smooth edges."""

    name = "supersampling"
    adds = "smooth edges of surfaces, shadows and textures"

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        error = pilot.one_ray_error + pilot.unseen
        # inside textures s^2 rays are drawn, at edges (2s)^2
        along = 1 if any(s.texture is not None for s in pilot.scene.surfaces) else 2
        if pilot.camera is None:
            return (Level("left out", 0.0, "exact", {"supersampling": 1}),)
        return tuple(
            Level(
                "left out" if s == 1 else f"{s} x {s}",
                error * (1 if s == 1 else FACTOR * (along * s) ** -1.5),
                "estimate",
                {"supersampling": s},
            )
            for s in SIDES
        )

    def why(self, pilot: Pilot, level: Level) -> str:
        if level.name == "left out":
            return "no picture" if pilot.camera is None else "edges matter little"
        return f"{pilot.edge_share:.1%} of the pixels show edges"
