"""pyrender's `Renderer` with a floating-point framebuffer and our own lights.

pyrender draws into 8 bits after a gamma of 2.2 and knows four lights of a kind. The subclass
built here keeps its mesh upload, program cache, forward pass and shadow pass, and replaces

* the framebuffer: four `GL_RGBA32F` targets (radiance, normal, position + depth, albedo +
  instance) and a 32-bit float depth buffer, read as `GL_FLOAT`;
* the shaders: the folder `shaders` beside this file;
* the light uniforms: `LightRecord`s, a batch a pass; a light with a shadow map has a pass to
  itself.

The class is made when a context exists, because importing pyrender needs a platform.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchradiometry.errors import ResourceLimitError
from torchradiometry.reference.graphics import Graphics

__all__ = [
    "LightRecord",
    "ShadowMap",
    "SurfaceRecord",
    "Targets",
    "mesh_class",
    "renderer_class",
    "texture_class",
]

SHADERS = Path(__file__).parent / "shaders"
#: MAX_LIGHTS in shaders/mesh.frag
LIGHTS_PER_PASS = 32

Array = NDArray[np.float64]


class ShadowMap(NamedTuple):
    """The camera of a shadow map, in the frame of the pass."""

    view: Array  #: 4 4, world to light
    projection: Array  #: 4 4
    far: float  #: m, the depth stored as 1
    texel: float  #: width of a texel: m (distant) or m per m of depth (near)
    face: Array  #: 3, axis of the cube face it covers; zero for all directions
    size: int  #: texels along a side


class LightRecord(NamedTuple):
    """One light as mesh.frag reads it; positions in the frame of the pass."""

    kind: int  #: 0 distant, 1 point, 2 spot, 3 emitter
    power: Array  #: 3; W/m2 on a facing plane (distant) or W/sr
    position: Array  #: 3, m
    direction: Array  #: 3, unit; to a distant source, otherwise the way it shines
    cone: Array  #: 2; 1 - cos of the inner and the outer half angle
    two_sided: bool = False
    shadow: ShadowMap | None = None


class SurfaceRecord(NamedTuple):
    """What mesh.frag needs to know about one surface."""

    instance: int
    two_sided: bool
    albedo: Array  #: 3
    emission: Array  #: 3, W/m2/sr
    lobe: int  #: 0 none, 1 Phong, 2 normalised Phong, 3 Blinn
    specular: Array  #: 3
    shininess: float
    texture: Any = None  #: a pyrender texture, or None


class Targets(NamedTuple):
    """The four float targets, rows from the top."""

    radiance: NDArray[np.float32]  #: H W 4
    normal: NDArray[np.float32]  #: H W 4
    position: NDArray[np.float32]  #: H W 4, a: depth along the view axis
    albedo: NDArray[np.float32]  #: H W 4, a: instance + 1


def _start(self: Any, width: int, height: int) -> None:
    """pyrender's own start, with our shaders."""
    self.base.__init__(self, width, height)
    cache = self.graphics.pyrender.shader_program.ShaderProgramCache
    self._program_cache = cache(shader_dir=str(SHADERS))


def _configure_main_framebuffer(self: Any) -> None:
    """Four float colour targets and a float depth target, made once."""
    if self._main_fb is not None:
        return
    gl, width, height = self.gl, self.viewport_width, self.viewport_height
    _require_small(gl, "camera", width, height, gl.GL_MAX_RENDERBUFFER_SIZE)
    self._main_cb = [int(b) for b in np.atleast_1d(gl.glGenRenderbuffers(5))]
    self._main_fb = self._main_fb_ms = int(gl.glGenFramebuffers(1))
    self._main_fb_dims = (width, height)
    gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._main_fb)
    colours = [gl.GL_COLOR_ATTACHMENT0 + i for i in range(4)]
    for buffer, attachment in zip(self._main_cb, [*colours, gl.GL_DEPTH_ATTACHMENT], strict=True):
        depth = attachment == gl.GL_DEPTH_ATTACHMENT
        gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, buffer)
        storage = gl.GL_DEPTH_COMPONENT32F if depth else gl.GL_RGBA32F
        gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, storage, width, height)
        gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, attachment, gl.GL_RENDERBUFFER, buffer)
    gl.glDrawBuffers(4, np.array(colours, np.uint32))


def _require_small(gl: Any, what: str, width: int, height: int, name: int) -> None:
    """Raise `ResourceLimitError` for a picture larger than OpenGL's limit `name`."""
    limit = int(gl.glGetIntegerv(name))
    if max(width, height) > limit:
        got = f"{width} x {height} pixels"
        raise ResourceLimitError(what, got, f"this OpenGL draws at most {limit} a side")


def _delete_main_framebuffer(self: Any) -> None:
    if self._main_fb is not None:
        self.gl.glDeleteFramebuffers(1, [self._main_fb])
        self.gl.glDeleteRenderbuffers(len(self._main_cb), self._main_cb)
    self._main_fb = self._main_fb_ms = self._main_cb = None


def _read_main_framebuffer(self: Any, scene: Any, flags: int) -> Targets:
    """All four targets as float32, first row at the top; radiance alone after the first pass."""
    gl, (width, height) = self.gl, self._main_fb_dims
    gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, self._main_fb)
    images = []
    for i in range(1 if self.geometry_known else 4):
        gl.glReadBuffer(gl.GL_COLOR_ATTACHMENT0 + i)
        pixels = gl.glReadPixels(0, 0, width, height, gl.GL_RGBA, gl.GL_FLOAT)
        image = np.frombuffer(pixels, np.float32).reshape(height, width, 4)
        images.append(image[::-1])
    return Targets(*images, *[images[0]] * (4 - len(images)))


def _configure_shadow_mapping_viewport(self: Any, light: Any, flags: int) -> None:
    """pyrender's own, for maps of any size."""
    self.base._configure_shadow_mapping_viewport(self, light, flags)
    size = self.lights[0].shadow.size
    self.gl.glViewport(0, 0, size, size)


def _get_camera_matrices(self: Any, scene: Any) -> tuple[Array, Array]:
    return self.view, self.projection


def _get_light_cam_matrices(
    self: Any, scene: Any, light_node: Any, flags: int
) -> tuple[Array, Array]:
    shadow = self.lights[0].shadow
    return shadow.view, shadow.projection


def _bind_lighting(self: Any, scene: Any, program: Any, node: Any, flags: int) -> None:
    """All uniforms of mesh.frag: camera, surface, lights, shadow map."""
    for name, value in self.camera_uniforms.items():
        program.set_uniform(name, value)
    _bind_surface(self, program, self.surfaces[node])
    program.set_uniform("light_count", len(self.lights))
    for i, light in enumerate(self.lights):
        _bind_light(program, f"lights[{i}].", light)
    shadow = self.lights[0].shadow if self.lights else None
    program.set_uniform("shadowed", int(shadow is not None))
    if shadow is not None:
        (light_node,) = scene.light_nodes
        self._bind_texture(light_node.light.shadow_texture, "shadow_map", program)
        program.set_uniform("light_view", shadow.view)
        program.set_uniform("light_matrix", shadow.projection @ shadow.view)
        program.set_uniform("light_far", shadow.far)
        program.set_uniform("texel", shadow.texel)
        program.set_uniform("face", shadow.face)


def _bind_surface(self: Any, program: Any, surface: SurfaceRecord) -> None:
    emission = np.zeros(3) if self.geometry_known else surface.emission
    program.set_uniform("instance", surface.instance)
    program.set_uniform("two_sided", int(surface.two_sided))
    program.set_uniform("albedo", surface.albedo)
    program.set_uniform("emission", emission)
    program.set_uniform("lobe", surface.lobe)
    program.set_uniform("specular", surface.specular)
    program.set_uniform("shininess", surface.shininess)
    program.set_uniform("has_texture", int(surface.texture is not None))
    if surface.texture is not None:
        self._bind_texture(surface.texture, "albedo_texture", program)


def _bind_light(program: Any, prefix: str, light: LightRecord) -> None:
    program.set_uniform(prefix + "kind", light.kind)
    program.set_uniform(prefix + "power", light.power)
    program.set_uniform(prefix + "position", light.position)
    program.set_uniform(prefix + "direction", light.direction)
    program.set_uniform(prefix + "cone", light.cone)
    program.set_uniform(prefix + "two_sided", int(light.two_sided))


def _bind_and_draw_primitive(
    self: Any, primitive: Any, pose: Array, program: Any, flags: int
) -> None:
    """Draw without culling, into shadow maps too: black backs block light."""
    if self.lights and self.lights[0].shadow is not None:
        program.set_uniform("light_far", self.lights[0].shadow.far)
    depth_only = self.graphics.pyrender.RenderFlags.DEPTH_ONLY
    self.base._bind_and_draw_primitive(self, primitive, pose, program, flags & ~depth_only)


@functools.cache
def renderer_class(graphics: Graphics) -> type:
    """The subclass of `pyrender.Renderer`; see the module."""
    base = graphics.pyrender.Renderer
    members: dict[str, Any] = {
        "graphics": graphics,
        "gl": graphics.gl,
        "base": base,
        "__init__": _start,
        "geometry_known": False,
        "lights": [],
    }
    for method in (
        _configure_main_framebuffer,
        _delete_main_framebuffer,
        _read_main_framebuffer,
        _configure_shadow_mapping_viewport,
        _get_camera_matrices,
        _get_light_cam_matrices,
        _bind_lighting,
        _bind_and_draw_primitive,
    ):
        members[method.__name__] = method
    return type("FloatRenderer", (base,), members)


@functools.cache
def texture_class(graphics: Graphics) -> type:
    """A `pyrender.Texture` of 32-bit floats: an albedo map, or a shadow map without `source`."""
    base, gl = graphics.pyrender.Texture, graphics.gl

    def add_to_context(self: Any) -> None:
        depth = self.floats is None
        kept = gl.GL_DEPTH_COMPONENT32F if depth else gl.GL_RGB32F
        given = gl.GL_DEPTH_COMPONENT if depth else gl.GL_RGB
        height, width = (self.height, self.width) if depth else self.floats.shape[:2]
        _require_small(gl, "texture", width, height, gl.GL_MAX_TEXTURE_SIZE)
        filtering = gl.GL_NEAREST if depth else gl.GL_LINEAR
        wrap = {
            "repeat": gl.GL_REPEAT,
            "mirror": gl.GL_MIRRORED_REPEAT,
            "clamp": gl.GL_CLAMP_TO_EDGE,
        }
        self._texid = gl.glGenTextures(1)
        gl.glBindTexture(gl.GL_TEXTURE_2D, self._texid)
        gl.glTexImage2D(
            gl.GL_TEXTURE_2D, 0, kept, width, height, 0, given, gl.GL_FLOAT, self.floats
        )
        for name, value in (
            (gl.GL_TEXTURE_MIN_FILTER, filtering),
            (gl.GL_TEXTURE_MAG_FILTER, filtering),
            (gl.GL_TEXTURE_WRAP_S, wrap[self.wrap[0]]),
            (gl.GL_TEXTURE_WRAP_T, wrap[self.wrap[1]]),
        ):
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, value)
        gl.glBindTexture(gl.GL_TEXTURE_2D, 0)

    members = {"floats": None, "wrap": ("clamp", "clamp"), "_add_to_context": add_to_context}
    return type("FloatTexture", (base,), members)


@functools.cache
def mesh_class(graphics: Graphics) -> type:
    """A `pyrender.Mesh` whose bounds do not ask NumPy 2 for `np.infty`."""

    def bounds(self: Any) -> Array:
        boxes = np.stack([p.bounds for p in self.primitives])
        return np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)])

    return type("BoundedMesh", (graphics.pyrender.Mesh,), {"bounds": property(bounds)})
