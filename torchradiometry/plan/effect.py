"""An effect: something that light does, what leaving it out costs in accuracy, and what it takes.

An effect has levels, from left out to as good as it gets. A level knows the settings that switch
it on and the relative L1 error of the picture that remains at it, all else being exact; errors of
several effects add up at most. The kind says what that number is:

    exact      0, by geometry: nothing of the kind happens in this scene
    bound      no scene of these albedos exceeds it
    estimate   measured on the pilot's pixels or patches, with a margin

A new effect is one file in `plan/effects` and one entry in `EFFECTS`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple

from torchradiometry.plan.pilot import Pilot

__all__ = ["AbstractEffect", "Level", "Settings"]

Settings = Mapping[str, Any]


class Level(NamedTuple):
    """One way to treat an effect.

    Attributes:
        name: `left out`, `exact`, `8 bounces`...
        error: relative L1 error of the picture that remains, >= 0.
        kind: `exact`, `bound` or `estimate`.
        settings: fields of `RenderSettings` that bring it about.
    """

    name: str
    error: float
    kind: str
    settings: Settings


class AbstractEffect(ABC):
    """What light does, as something that can be left out.

    Attributes:
        name: as tables show it.
        adds: what the picture gains.
        needs: fields of `RenderSettings` that must not be 0 or False for it to show at all.
    """

    name: str
    adds: str
    needs: tuple[str, ...] = ()

    @abstractmethod
    def levels(self, pilot: Pilot) -> tuple[Level, ...]:
        """From left out to best. One level if the scene leaves no choice."""

    @abstractmethod
    def why(self, pilot: Pilot, level: Level) -> str:
        """The reason of a level in this scene, one clause."""
