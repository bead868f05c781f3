"""WHO EMITS: each source answers which light arrives at a point."""

from torchradiometry.sources.base import AbstractSource, Arrival, arrive, irradiance, light_first
from torchradiometry.sources.directional import DirectionalSource, directional_arrival

__all__ = [
    "AbstractSource",
    "Arrival",
    "DirectionalSource",
    "arrive",
    "directional_arrival",
    "irradiance",
    "light_first",
]
