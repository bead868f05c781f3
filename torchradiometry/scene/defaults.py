"""A view and a light for a scene that was loaded without them.

The camera looks from in front, above and to the right at the middle of the scene, from
r / sin(half the smaller field of view), where r is the radius of the sphere around its bounds.
The light is distant and comes from over the viewer's left shoulder.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from torchradiometry.errors import DegenerateGeometryError, require_whole
from torchradiometry.geometry.cameras import AbstractCamera, PinholeCamera, look_at
from torchradiometry.numerics import safe_norm, safe_normalize
from torchradiometry.scene.scene import Scene
from torchradiometry.sources.directional import DirectionalSource

__all__ = ["default_camera", "default_light", "with_default_view"]

#: from the middle of the scene to the eye, and to the light
VIEW, LIGHT = (0.5, 0.45, 1.0), (-0.4, 1.0, 0.8)
#: vertical field of view, rad, and the share of the picture left free around the scene
FIELD_OF_VIEW, MARGIN = math.radians(40), 0.05


def with_default_view(scene: Scene, *, width: int = 640, height: int = 480) -> Scene:
    """The scene, with a camera if it has none and a distant light if nothing in it shines.

    Args:
        scene: any scene with vertices.
        width, height: of the added camera's picture, pixels.

    Raises:
        EmptySceneError: no surfaces to look at.
        DegenerateGeometryError: the scene has no extent, or one that is not finite.
    """
    cameras = scene.cameras or (default_camera(scene, width=width, height=height),)
    shines = bool(scene.sources) or bool(scene.emissive)
    sources = scene.sources if shines else (default_light(scene),)
    return replace(scene, cameras=cameras, sources=sources)


def default_camera(scene: Scene, *, width: int = 640, height: int = 480) -> AbstractCamera:
    """A pinhole camera that sees the whole scene from in front, above and the right."""
    require_whole("width", width, 1)
    require_whole("height", height, 1)
    low, high = scene.bounds
    middle, radius = (low + high) / 2, float(safe_norm(high - low)) / 2
    if not 0 < radius < math.inf:
        got = f"bounds of radius {radius:g} m"
        raise DegenerateGeometryError("scene", got, "place a camera yourself")
    narrow = min(1.0, width / height) * math.tan(FIELD_OF_VIEW / 2)
    distance = radius * (1 + MARGIN) / math.sin(math.atan(narrow))
    eye = middle + distance * safe_normalize(low.new_tensor(VIEW))
    place = look_at(eye, middle)
    return PinholeCamera(width=width, height=height, yfov=FIELD_OF_VIEW, camera_to_world=place)


def default_light(scene: Scene) -> DirectionalSource:
    """A distant light of pi W/m2: a white surface that faces it has radiance 1."""
    like = scene.surfaces[0].vertices
    power = torch.full((scene.channels,), math.pi, dtype=like.dtype, device=like.device)
    return DirectionalSource(safe_normalize(like.new_tensor(LIGHT)), power)
