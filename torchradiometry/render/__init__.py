"""WHAT A CAMERA RECORDS: direct light per pixel, indirect light from patches."""

from torchradiometry.render.adaptive import adaptive_exchange, patch_errors
from torchradiometry.render.direct import (
    direct_irradiance,
    emitter_weights,
    lamp_irradiance,
    sky_visibility,
)
from torchradiometry.render.importance import Visits, backwards, relative_sizes
from torchradiometry.render.indirect import Exchange, Indirect, solve_exchange
from torchradiometry.render.lobes import Lobes, lobe_light, look_along_lobes
from torchradiometry.render.picture import (
    Picture,
    View,
    develop,
    indirect_light,
    render_scene,
    view_scene,
)
from torchradiometry.render.points import Receivers
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World, prepare

__all__ = [
    "Exchange",
    "Indirect",
    "Lobes",
    "Picture",
    "Receivers",
    "RenderSettings",
    "View",
    "Visits",
    "World",
    "adaptive_exchange",
    "backwards",
    "develop",
    "direct_irradiance",
    "emitter_weights",
    "indirect_light",
    "lamp_irradiance",
    "lobe_light",
    "look_along_lobes",
    "patch_errors",
    "prepare",
    "relative_sizes",
    "render_scene",
    "sky_visibility",
    "solve_exchange",
    "view_scene",
]
