"""What the rasteriser is given: a pyrender scene, its surfaces, and where the eye stands.

OpenGL keeps depth as a share of the far plane; mesh.frag writes it linearly, so a near plane
close to the eye costs no digits. It is placed at the nearest surface and cuts nothing off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh

from torchradiometry.errors import DTypeError, ShapeError
from torchradiometry.geometry.cameras import AbstractCamera, OrthographicCamera, PinholeCamera
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.materials.phong import NormalizedPhong, OriginalPhong, Phong
from torchradiometry.reference.graphics import Graphics
from torchradiometry.reference.lights import array, colours
from torchradiometry.reference.rasterizer import Array, SurfaceRecord, mesh_class, texture_class
from torchradiometry.scene.scene import Scene, Triangles
from torchradiometry.scene.surface import Surface, Texture

__all__ = ["LOBES", "Gloss", "aim", "origin_of", "stage"]

Gloss = Phong | NormalizedPhong | OriginalPhong | BlinnPhong
#: the numbers of the lobes in shaders/mesh.frag
LOBES: dict[type, int] = {Phong: 1, NormalizedPhong: 2, OriginalPhong: 3, BlinnPhong: 4}
#: near plane as a share of the far plane where a surface touches the eye
NEAREST = 2.0**-20


def origin_of(triangles: Triangles, camera: AbstractCamera) -> Array:
    """Where the frame of the pass has its origin, world, m."""
    if isinstance(camera, PinholeCamera):
        return array(camera.position)
    corners = array(triangles.corners).reshape(-1, 3)
    return (corners.min(0) + corners.max(0)) / 2


def aim(renderer: Any, camera: AbstractCamera, origin: Array, corners: Array) -> None:
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
    matrix = np.diag([camera.height / camera.width / camera.ymag, 1 / camera.ymag, -2 / far, 1.0])
    matrix[2, 3] = -1.0
    return matrix


def stage(
    graphics: Graphics,
    renderer: Any,
    scene: Scene,
    triangles: Triangles,
    corners: Array,
    glosses: Sequence[Gloss | None],
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


def _record(graphics: Graphics, k: int, surface: Surface, gloss: Gloss | None) -> SurfaceRecord:
    albedo, emission = colours(surface.albedo[None])[0], colours(surface.emission[None])[0]
    specular, shininess, lobe = np.zeros(3), 0.0, 0
    if gloss is not None:
        if gloss.specular.ndim != 1 or gloss.shininess.ndim != 1:
            raise ShapeError("materials", "a material per point", "pass one for the surface")
        lobe, shininess = LOBES[type(gloss)], float(gloss.shininess)
        specular = colours(gloss.specular[None])[0]
    texture = None if surface.texture is None else _texture(graphics, surface.texture, albedo)
    return SurfaceRecord(k, surface.two_sided, albedo, emission, lobe, specular, shininess, texture)


def _texture(graphics: Graphics, texture: Texture, albedo: Array) -> Any:
    """Albedo times picture in float32, first row at the bottom as OpenGL has it."""
    image = array(texture.image)[::-1] * albedo
    made = texture_class(graphics)()
    made.floats = np.ascontiguousarray(np.broadcast_to(image, (*image.shape[:2], 3)), np.float32)
    made.wrap = texture.wrap
    return made
