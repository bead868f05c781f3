"""How a picture is made: every knob of the renderer, with its unit and default."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torchradiometry.errors import DTypeError, OutOfRangeError, require_kind
from torchradiometry.transport.rays import AbstractRayCaster

__all__ = ["RenderSettings"]

#: settings that are on or off
FLAGS = (
    "ambient_tail",
    "importance",
    "penumbra",
    "extent",
    "near",
    "ambient",
    "colour_bleeding",
    "gather",
)


@dataclass(frozen=True, eq=False)
class RenderSettings:
    """What a picture costs and how good it gets.

    Args:
        bounces: interreflections, >= 0. 0 leaves direct light only: no patch is made.
        ambient_tail: stand in for the bounces that are left out by a calibrated ambient term.
        patch_size: longest edge of a radiosity patch, m; None: 1/6 of the half diagonal of
            the scene.
        patch_error: relative L1 error that patches may cause; they are then split where
            reflected light bends, starting from `patch_size`, until the estimate meets it or
            `budget` is spent. None: all patches have the same size.
        importance: True lets patches be larger than `patch_size` where the camera hardly looks and
            little light comes from, and smaller where it looks most; by the albedos that the
            scene has then. Without a camera all surfaces count alike.
        supersampling: rays along each side of a pixel in which the picture changes, >= 1; four
            times as many at the edge of an emitter. Other pixels get one ray.
        shadow_samples: shadow rays to each emitting polygon, >= 1; four times as many in
            penumbras; none are needed behind a few blockers. 0 draws no shadows at all.
        penumbra: False lets a point see all or nothing of an emitting polygon, by one ray to
            its middle.
        extent: False takes emitting polygons for small ones: all their light comes from their
            middle.
        near: False takes lamps for distant ones: every point receives what the middle of the
            scene receives.
        ambient: with 0 bounces, light that arrives everywhere alike stands in for reflected
            light, calibrated by what the surfaces receive and how much they see of each other.
        colour_bleeding: False reflects with grey albedos: reflected light has the colour of
            the sources.
        pair_samples: shadow segments between two patches; four times as many in penumbras.
        gather: gather reflected light at every camera ray from all patches instead of
            interpolating it: sharper at contacts, and slow.
        lobe_samples: rays of a pixel along the lobe of a shiny surface, and as many to each
            emitter; 0 leaves lobes out.
        sky_samples: rays to the sky under an ambient dome.
        budget: bytes that the form factors may use, as many what is gathered, and as many the
            rays of the camera.
        seed: of all random shifts; the same seed gives the same picture.
        rays: what answers rays; None: Embree, or brute force where embreex is missing.
    """

    bounces: int = 8
    ambient_tail: bool = True
    patch_size: float | None = None
    patch_error: float | None = None
    importance: bool = False
    supersampling: int = 2
    shadow_samples: int = 4
    penumbra: bool = True
    extent: bool = True
    near: bool = True
    ambient: bool = False
    colour_bleeding: bool = True
    pair_samples: int = 4
    gather: bool = False
    lobe_samples: int = 16
    sky_samples: int = 32
    budget: int = 2**32
    seed: int = 0
    rays: type[AbstractRayCaster] | None = None

    def __post_init__(self) -> None:
        lowest = {"bounces": 0, "supersampling": 1, "shadow_samples": 0, "pair_samples": 1}
        for name, low in {**lowest, "lobe_samples": 0, "sky_samples": 1, "budget": 1}.items():
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool):
                raise DTypeError(f"settings.{name}", f"{value!r}", "pass a whole number")
            if value < low:
                raise OutOfRangeError(f"settings.{name}", f"{value}", f"pass at least {low}")
        require_kind("settings.seed", self.seed, int, "whole number")
        for name in FLAGS:
            require_kind(f"settings.{name}", getattr(self, name), bool, "truth value")
        rays = self.rays
        if rays is not None and not (
            isinstance(rays, type) and issubclass(rays, AbstractRayCaster)
        ):
            raise DTypeError("settings.rays", f"{rays!r}", "pass a ray caster's class")
        size = self.patch_size
        number = isinstance(size, (int, float)) and not isinstance(size, bool)
        if size is not None and not (number and 0 < size < math.inf):
            raise OutOfRangeError("settings.patch_size", f"{size!r}", "pass a length in m, > 0")
        error = self.patch_error
        if error is not None and not (isinstance(error, (int, float)) and 0 < error < 1):
            raise OutOfRangeError("settings.patch_error", f"{error!r}", "pass 0 < error < 1")
