"""WHAT A CAMERA RECORDS: direct light per pixel, indirect light from patches."""

from torchradiometry.render.direct import (
    direct_irradiance,
    emitter_irradiance,
    lamp_irradiance,
    sky_visibility,
)
from torchradiometry.render.indirect import Indirect, indirect_light
from torchradiometry.render.picture import Picture, render_scene
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World, prepare

__all__ = [
    "Indirect",
    "Picture",
    "RenderSettings",
    "World",
    "direct_irradiance",
    "emitter_irradiance",
    "indirect_light",
    "lamp_irradiance",
    "prepare",
    "render_scene",
    "sky_visibility",
]
