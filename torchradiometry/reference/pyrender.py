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

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
import trimesh

from torchradiometry.errors import DTypeError, ShapeError
from torchradiometry.geometry.cameras import AbstractCamera, OrthographicCamera, PinholeCamera
from torchradiometry.materials.base import AbstractMaterial
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.materials.phong import NormalizedPhong, OriginalPhong, Phong
from torchradiometry.reference.graphics import Graphics, graphics_context
from torchradiometry.reference.lights import (
    array,
    colours,
    light_records,
    require_count,
    with_shadows,
)
from torchradiometry.reference.rasterizer import (
    LIGHTS_PER_PASS,
    Array,
    LightRecord,
    SurfaceRecord,
    Targets,
    mesh_class,
    renderer_class,
    texture_class,
)
from torchradiometry.scene.scene import Scene, Triangles
from torchradiometry.scene.surface import Surface, Texture

if TYPE_CHECKING:
    from jaxtyping import Float, Int
    from torch import Tensor

__all__ = ["ReferenceBuffers", "render_reference"]

#: the numbers of the lobes in shaders/mesh.frag
LOBES: dict[type, int] = {Phong: 1, NormalizedPhong: 2, OriginalPhong: 3, BlinnPhong: 4}
#: near plane as a share of the far plane where a surface touches the eye
NEAREST = 2.0**-20


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
        ResourceLimitError: a picture larger than OpenGL's limit.

    Differentiable in: nothing.
    Export: no, it calls OpenGL.
    References: see the module.
    """
    require_count(area_samples)
    glosses = _glosses(scene, materials)
    triangles = scene.triangles
    origin = _origin(triangles, camera)
    corners = array(triangles.corners) - origin
    lights = light_records(scene.sources, scene.surfaces, origin, area_samples)
    if shadows:
        vertices = corners.reshape(-1, 3)
        lights = list(chain.from_iterable(with_shadows(light, vertices) for light in lights))
    with graphics_context(camera.width, camera.height) as graphics:
        renderer = renderer_class(graphics)(camera.width, camera.height)
        try:
            _aim(renderer, camera, origin, corners)
            stage = _stage(graphics, renderer, scene, triangles, corners, glosses)
            targets, radiance = _draw(graphics, renderer, stage, lights)
        finally:
            renderer.delete()
    return _buffers(targets, radiance, origin, renderer.depth_offset)


def _glosses(
    scene: Scene, materials: Sequence[AbstractMaterial | None] | None
) -> list[AbstractMaterial | None]:
    """One highlight or None per surface."""
    count = len(scene.surfaces)
    glosses = [None] * count if materials is None else list(materials)
    if len(glosses) != count:
        raise ShapeError(
            "materials", f"{len(glosses)} for {count} surfaces", "pass one (or None) per surface"
        )
    for gloss in glosses:
        if gloss is not None and type(gloss) not in LOBES:
            names = ", ".join(kind.__name__ for kind in LOBES)
            raise DTypeError("materials", f"a {type(gloss).__name__}", f"use {names} or None")
    return glosses


def _origin(triangles: Triangles, camera: AbstractCamera) -> Array:
    """Where the frame of the pass has its origin, world, m."""
    if isinstance(camera, PinholeCamera):
        return array(camera.position)
    corners = array(triangles.corners).reshape(-1, 3)
    return (corners.min(0) + corners.max(0)) / 2


def _aim(renderer: Any, camera: AbstractCamera, origin: Array, corners: Array) -> None:
    """View, projection and camera uniforms; near and far planes enclose what is in front."""
    axes = array(camera.camera_to_world[:3, :3])
    eye = array(camera.position) - origin
    depth = (corners - eye) @ -axes[:, 2]
    far = max(float(depth.max()), 0.0) * 1.001 or 1.0
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = axes.T, -axes.T @ eye
    orthographic = isinstance(camera, OrthographicCamera)
    offset = 0.0
    if isinstance(camera, PinholeCamera):
        near = max(_clearance(camera, corners - eye), NEAREST * far)
        renderer.projection = _perspective(camera, near)
    elif isinstance(camera, OrthographicCamera):
        offset = max(float(depth.min()) - (far - float(depth.min())) * 1e-3, 0.0)
        renderer.projection = _parallel(camera, far - offset)
        view[2, 3] += offset  # step forward to just before the scene
        far -= offset
    else:
        raise DTypeError("camera", f"a {type(camera).__name__}", "use a pinhole or orthographic")
    renderer.view = view
    renderer.depth_offset = offset
    renderer.camera_uniforms = {
        "orthographic": int(orthographic),
        "eye": eye,
        "backward": axes[:, 2],
        "far": far,
    }


def _clearance(camera: PinholeCamera, corners: Array) -> float:
    """Depth of a near plane that cuts off nothing the camera can see, m."""
    nearest = trimesh.triangles.closest_point(corners, np.zeros((len(corners), 3)))
    distance = float(np.nanmin(np.linalg.norm(nearest, axis=-1)))
    slope = math.tan(camera.yfov / 2) * math.hypot(1, camera.width / camera.height)
    return 0.99 * distance / math.hypot(1, slope)


def _perspective(camera: PinholeCamera, near: float) -> Array:
    """OpenGL projection without a far plane."""
    focal = 1 / math.tan(camera.yfov / 2)
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = focal * camera.height / camera.width, focal
    matrix[2] = [0, 0, -1, -2 * near]
    matrix[3, 2] = -1
    return matrix


def _parallel(camera: OrthographicCamera, far: float) -> Array:
    """OpenGL projection from the plane of the eye to `far`."""
    matrix = np.diag(
        [camera.height / camera.width / camera.ymag, 1 / camera.ymag, -2 / far, 1.0]
    )
    matrix[2, 3] = -1.0
    return matrix


def _stage(
    graphics: Graphics,
    renderer: Any,
    scene: Scene,
    triangles: Triangles,
    corners: Array,
    glosses: list[AbstractMaterial | None],
) -> Any:
    """A pyrender scene with one mesh per surface and a camera that only marks the spot."""
    pyrender = graphics.pyrender
    stage = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0])
    stage.add(pyrender.PerspectiveCamera(yfov=1.0))
    material = pyrender.MetallicRoughnessMaterial(doubleSided=True, alphaMode="OPAQUE")
    renderer.surfaces = {}
    normals = array(triangles.normals)
    for k, surface in enumerate(scene.surfaces):
        mine = (triangles.surface == k).cpu().numpy()
        if not mine.any():
            continue
        primitive = pyrender.Primitive(
            positions=corners[mine].reshape(-1, 3),
            normals=normals[mine].reshape(-1, 3),
            texcoord_0=_coordinates(surface),
            material=material,
        )
        node = stage.add(mesh_class(graphics)([primitive]))
        renderer.surfaces[node] = _record(graphics, k, surface, glosses[k])
    return stage


def _coordinates(surface: Surface) -> Array | None:
    if surface.texture is None:
        return None
    return array(surface.texture.coordinates[surface.faces]).reshape(-1, 2)


def _record(
    graphics: Graphics, k: int, surface: Surface, gloss: AbstractMaterial | None
) -> SurfaceRecord:
    albedo, emission = colours(surface.albedo[None])[0], colours(surface.emission[None])[0]
    specular, shininess, lobe = np.zeros(3), 0.0, 0
    if gloss is not None:
        if gloss.specular.ndim != 1 or gloss.shininess.ndim != 1:
            raise ShapeError("materials", "a material per point", "pass one for the surface")
        lobe, shininess = LOBES[type(gloss)], float(gloss.shininess)
        specular = colours(gloss.specular[None])[0]
    texture = None if surface.texture is None else _texture(graphics, surface.texture, albedo)
    return SurfaceRecord(
        k, surface.two_sided, albedo, emission, lobe, specular, shininess, texture
    )


def _texture(graphics: Graphics, texture: Texture, albedo: Array) -> Any:
    """Albedo times picture in float32, first row at the bottom as OpenGL has it."""
    image = array(texture.image)[::-1] * albedo
    made = texture_class(graphics)()
    made.floats = np.ascontiguousarray(np.broadcast_to(image, (*image.shape[:2], 3)), np.float32)
    made.wrap = texture.wrap
    return made


def _draw(
    graphics: Graphics, renderer: Any, stage: Any, lights: list[LightRecord]
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
        lamp = stage.add(_lamp(graphics, batch[0])) if shadow else None
        mode = flags.OFFSCREEN | (flags.SHADOWS_DIRECTIONAL | flags.SHADOWS_SPOT) * shadow
        targets = renderer.render(stage, mode)
        radiance += targets.radiance[..., :3]
        first = first or targets
        renderer.geometry_known = True
        if lamp is not None:
            stage.remove_node(lamp)
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
