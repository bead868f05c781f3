"""pyrender as an independent rasterised truth, in linear radiance.

    L = L_e + sum over lights of f_r E max(0, n . wi) V,     V from shadow maps

The same physics as the package's layers, by other means: OpenGL finds the visible surface and
interpolates normals, and a GLSL shader of our own (`shaders/mesh.frag`), which shares no line
with the PyTorch code, evaluates lights and BRDFs. It is evidence for local shading, depth,
normals and visibility; it knows nothing of interreflection.

pyrender's own pictures cannot serve: its material always has a Fresnel highlight of 4 %, its
output is 8 bits after a gamma of 2.2, and it stops at four lights of a kind.

The arithmetic is float32. Geometry is passed relative to the eye (perspective) or to the
middle of the scene (orthographic), so that digits are spent where they are seen.

References: Khronos, *OpenGL 3.3 core*; *glTF 2.0*, KHR_lights_punctual; L. Williams, "Casting
Curved Shadows on Curved Surfaces", SIGGRAPH 1978 (shadow maps).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch

from torchradiometry.errors import DTypeError, IndexRangeError, InvalidValueError, ShapeError
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.materials.base import AbstractMaterial
from torchradiometry.reference.graphics import Graphics, graphics_context
from torchradiometry.reference.lights import (
    array,
    light_records,
    require_count,
    with_shadows,
)
from torchradiometry.reference.rasterizer import (
    LIGHTS_PER_PASS,
    Array,
    LightRecord,
    Targets,
    renderer_class,
    texture_class,
)
from torchradiometry.reference.stage import LOBES, Gloss, aim, origin_of, stage
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.validate import require_none, scene_faults

if TYPE_CHECKING:
    from jaxtyping import Float, Int
    from torch import Tensor

__all__ = ["ReferenceBuffers", "render_reference"]


class ReferenceBuffers(NamedTuple):
    """What the rasteriser saw at each pixel centre; rows from the top.

    Attributes:
        radiance: linear, W/m2/sr; 0 where nothing is hit. float64 sums of float32 passes.
        depth: m along the viewing axis (not along the ray); infinite where nothing is hit.
        normal: unit shading normal in world axes, of the front; turned to the eye on the back
            of a two-sided surface; 0 where nothing is hit.
        position: world, m; 0 where nothing is hit.
        albedo: diffuse reflectance with textures looked up; 0 where nothing is hit.
        instance: index into `scene.surfaces`; -1 where nothing is hit.
    """

    radiance: Float[Tensor, "height width 3"]
    depth: Float[Tensor, "height width"]
    normal: Float[Tensor, "height width 3"]
    position: Float[Tensor, "height width 3"]
    albedo: Float[Tensor, "height width 3"]
    instance: Int[Tensor, "height width"]


@torch.no_grad()
def render_reference(
    scene: Scene,
    camera: AbstractCamera,
    *,
    materials: Sequence[AbstractMaterial | None] | None = None,
    shadows: bool = False,
    area_samples: int = 0,
) -> ReferenceBuffers:
    """Rasterise a scene in linear floating-point radiance with pyrender.

    Direct light only. One sample at the centre of each pixel. Surfaces glow with their
    emission; a one-sided surface seen from behind is black and still blocks view and light.

    Args:
        scene: surfaces with 1 or 3 channels; directional, point and spot sources, unbatched.
        camera: pinhole or orthographic.
        materials: for each surface the highlight that is added to its Lambertian albedo
            (`Phong`, `NormalizedPhong`, `OriginalPhong` or `BlinnPhong`), or None; the
            default is Lambertian throughout.
        shadows: cast shadows by 2048 x 2048 shadow maps: one for a distant or narrow spot
            light, the six faces of a cube for other near lights. Their edges are uncertain by
            about two texels.
        area_samples: about how many cosine emitters stand for each surface with emission;
            0 lets it glow without lighting others.

    Returns:
        The buffers, on the CPU, float64 and int64; accurate to float32.

    Raises:
        NoGraphicsError: no OpenGL; the message names the Debian packages.
        MissingDependencyError: pyrender is not installed.
        DTypeError, ShapeError: a source, camera or material it cannot draw, more than one
            picture, channels other than 1 or 3.
        InvalidValueError, IndexRangeError: NaN, or faces that name no vertex.
        OutOfRangeError: a polygonal or spherical source without `area_samples`.
        EmptySceneError: no triangles.
        ResourceLimitError: a picture or texture larger than OpenGL's limit.

    Differentiable in: nothing.
    Export: no, it calls OpenGL.
    References: see the module.
    """
    require_count(area_samples)
    faults = scene_faults(scene.surfaces, scene.sources, (camera,))
    require_none([f for f in faults if f.error in (InvalidValueError, IndexRangeError)])
    glosses = _glosses(scene, materials)
    triangles = scene.triangles
    origin = origin_of(triangles, camera)
    corners = array(triangles.corners) - origin
    lights = light_records(scene.sources, scene.surfaces, origin, area_samples)
    if shadows:
        vertices = corners.reshape(-1, 3)
        lights = list(chain.from_iterable(with_shadows(light, vertices) for light in lights))
    with graphics_context(camera.width, camera.height) as graphics:
        renderer = renderer_class(graphics)(camera.width, camera.height)
        try:
            aim(renderer, camera, origin, corners)
            staged = stage(graphics, renderer, scene, triangles, corners, glosses)
            targets, radiance = _draw(graphics, renderer, staged, lights)
        finally:
            renderer.delete()
    return _buffers(targets, radiance, origin, renderer.depth_offset)


def _glosses(
    scene: Scene, materials: Sequence[AbstractMaterial | None] | None
) -> list[Gloss | None]:
    """One highlight or None per surface."""
    count = len(scene.surfaces)
    given = [None] * count if materials is None else materials
    if len(given) != count:
        raise ShapeError(
            "materials", f"{len(given)} for {count} surfaces", "pass one (or None) per surface"
        )
    glosses: list[Gloss | None] = []
    for gloss in given:
        if gloss is not None and not isinstance(gloss, Gloss):
            names = ", ".join(kind.__name__ for kind in LOBES)
            raise DTypeError("materials", f"a {type(gloss).__name__}", f"use {names} or None")
        glosses.append(gloss)
    return glosses


def _draw(
    graphics: Graphics, renderer: Any, staged: Any, lights: list[LightRecord]
) -> tuple[Targets, Array]:
    """All passes: the buffers of the first, and the sum of the radiance of all."""
    first: Targets | None = None
    radiance = np.zeros((renderer.viewport_height, renderer.viewport_width, 3))
    flags = graphics.pyrender.RenderFlags
    textures = [s.texture for s in renderer.surfaces.values() if s.texture is not None]
    for texture in textures:
        texture._add_to_context()
    for batch in _batches(lights):
        renderer.lights = batch
        shadow = bool(batch) and batch[0].shadow is not None
        lamp = staged.add(_lamp(graphics, batch[0])) if shadow else None
        mode = flags.OFFSCREEN | (flags.SHADOWS_DIRECTIONAL | flags.SHADOWS_SPOT) * shadow
        targets = renderer.render(staged, mode)
        radiance += targets.radiance[..., :3]
        first = first or targets
        renderer.geometry_known = True
        if lamp is not None:
            staged.remove_node(lamp)
    for texture in textures:
        texture.delete()
    assert first is not None
    return first, radiance


def _batches(lights: list[LightRecord]) -> Iterator[list[LightRecord]]:
    """Passes: each light with a shadow map alone, the others together; at least one pass."""
    plain = [light for light in lights if light.shadow is None]
    if plain or not lights:
        for start in range(0, max(len(plain), 1), LIGHTS_PER_PASS):
            yield plain[start : start + LIGHTS_PER_PASS]
    for light in lights:
        if light.shadow is not None:
            yield [light]


def _lamp(graphics: Graphics, light: LightRecord) -> Any:
    """A pyrender light that owns a float shadow map."""
    assert light.shadow is not None
    pyrender, size = graphics.pyrender, light.shadow.size
    lamp = pyrender.DirectionalLight() if light.kind == 0 else pyrender.SpotLight()
    lamp.shadow_texture = texture_class(graphics)(width=size, height=size)
    return lamp


def _buffers(
    targets: Targets, radiance: Array, origin: Array, depth_offset: float
) -> ReferenceBuffers:
    """Tensors in world coordinates; the background as documented."""
    instance = torch.from_numpy(np.rint(targets.albedo[..., 3]).astype(np.int64) - 1)
    hit = instance >= 0
    place = torch.from_numpy(targets.position.astype(np.float64))
    return ReferenceBuffers(
        radiance=torch.from_numpy(radiance),
        depth=torch.where(hit, place[..., 3] + depth_offset, torch.inf),
        normal=torch.from_numpy(targets.normal[..., :3].astype(np.float64)),
        position=torch.where(hit[..., None], place[..., :3] + torch.from_numpy(origin), 0),
        albedo=torch.from_numpy(targets.albedo[..., :3].astype(np.float64)),
        instance=instance,
    )
