"""The effects a planner chooses among, in the order in which light meets them."""

from torchradiometry.plan.effect import AbstractEffect
from torchradiometry.plan.effects.bleeding import ColourBleeding
from torchradiometry.plan.effects.bounces import Interreflection
from torchradiometry.plan.effects.extent import SourceExtent
from torchradiometry.plan.effects.fall_off import FallOff
from torchradiometry.plan.effects.lobe import SpecularLobe
from torchradiometry.plan.effects.patches import PatchSize
from torchradiometry.plan.effects.penumbra import Penumbra
from torchradiometry.plan.effects.pixels import Supersampling
from torchradiometry.plan.effects.shadows import CastShadows

__all__ = [
    "EFFECTS",
    "CastShadows",
    "ColourBleeding",
    "FallOff",
    "Interreflection",
    "PatchSize",
    "Penumbra",
    "SourceExtent",
    "SpecularLobe",
    "Supersampling",
]

EFFECTS: tuple[AbstractEffect, ...] = (
    FallOff(),
    SourceExtent(),
    CastShadows(),
    Penumbra(),
    SpecularLobe(),
    Interreflection(),
    ColourBleeding(),
    PatchSize(),
    Supersampling(),
)
