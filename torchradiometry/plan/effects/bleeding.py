"""Colour bleeding: a red wall reddens what it lights.

Left out, surfaces reflect towards each other as grey ones of the same mean albedo, and one channel
is solved for all.
"""

from __future__ import annotations

from typing import final

import torch

from torchradiometry.plan.effect import AbstractEffect, Level
from torchradiometry.plan.pilot import Pilot

__all__ = ["ColourBleeding"]


@final
class ColourBleeding(AbstractEffect):
    """Coloured reflected light."""

    name = "colour bleeding"
    adds = "the colours of surfaces on each other"
    needs = ("bounces",)

    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        albedo = pilot.world.triangles.albedo
        off = {"colour_bleeding": False}
        if albedo.shape[-1] == 1 or bool(torch.all(albedo == albedo[:, :1])):
            return (Level("left out", 0.0, "exact", off),)
        found = pilot.reflections
        error = pilot.mean_error(found.irradiance - found.grey())
        return (
            Level("left out", error, "estimate", off),
            Level("in full", 0.0, "exact", {"colour_bleeding": True}),
        )

    def why(self, pilot: Pilot, level: Level) -> str:
        if level.kind == "exact" and level.name == "left out":
            return "all surfaces are grey"
        if level.name == "left out":
            return "coloured surfaces light little"
        return "coloured surfaces light others"
