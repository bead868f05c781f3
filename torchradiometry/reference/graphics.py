"""An OpenGL context without a screen: EGL first, then OSMesa.

Nothing is imported and no variable is set until a context is asked for. PyOpenGL decides
while it is *imported* which platform it talks to (`PYOPENGL_PLATFORM`), so the platform is
chosen before, by asking libEGL itself for a device that starts; the variable is put back as
it was afterwards. A choice that the user made (`PYOPENGL_PLATFORM=egl` or `osmesa`,
`EGL_DEVICE_ID`) is respected.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import importlib
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any, NamedTuple

from torchradiometry.errors import MissingDependencyError, NoGraphicsError
from torchradiometry.reference.osmesa import OSMesaContext, number_contexts

__all__ = ["Graphics", "graphics_context", "load_graphics"]

#: EGL_PLATFORM_DEVICE_EXT of the EGL_EXT_platform_device extension
PLATFORM_DEVICE = 0x313F
#: what to do where there is no OpenGL, in one sentence
INSTALL = (
    "install software OpenGL with `apt-get install libegl1 libegl-mesa0 libgl1` "
    "(or libosmesa6, and set PYOPENGL_PLATFORM=osmesa)"
)


class Graphics(NamedTuple):
    """The libraries behind a context, loaded once a process."""

    pyrender: ModuleType
    gl: ModuleType  #: OpenGL.GL
    platform: str  #: "egl" or "osmesa"


@functools.cache
def load_graphics() -> Graphics:
    """Import pyrender and PyOpenGL for a machine without a screen.

    Raises:
        MissingDependencyError: pyrender is not installed.
        NoGraphicsError: neither EGL nor OSMesa can draw here.
    """
    platform = _platform()
    asked = os.environ.get("PYOPENGL_PLATFORM")
    os.environ["PYOPENGL_PLATFORM"] = platform
    try:
        with _quiet():
            if platform == "osmesa":
                number_contexts(importlib.import_module("OpenGL.platform"))
            pyrender = importlib.import_module("pyrender")
            gl = importlib.import_module("OpenGL.GL")
            if platform == "egl":
                importlib.import_module("pyrender.platforms.egl")
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            "render_reference",
            f"no module {error.name!r}",
            "install it with `pip install torchradiometry[render]`",
        ) from error
    except Exception as error:  # PyOpenGL raises ImportError, AttributeError, TypeError ...
        raise NoGraphicsError("OpenGL", f"{type(error).__name__}: {error}", INSTALL) from error
    finally:
        _restore("PYOPENGL_PLATFORM", asked)
    return Graphics(pyrender, gl, platform)


@contextmanager
def graphics_context(width: int, height: int) -> Iterator[Graphics]:
    """A current OpenGL context of its own, destroyed at the end.

    Raises:
        NoGraphicsError: no context can be made.
    """
    graphics = load_graphics()
    with _quiet():
        platform = _start(graphics, width, height)
        try:
            yield graphics
        finally:
            _stop(graphics, platform)


@contextmanager
def _quiet() -> Iterator[None]:
    """Third-party deprecation notices are not this package's user's business."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", SyntaxWarning)
        warnings.simplefilter("ignore", ImportWarning)
        yield


def _restore(name: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value


def _platform() -> str:
    """Which of the two platforms works, before PyOpenGL is imported."""
    asked = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    if asked in ("egl", "osmesa"):
        return asked
    if "OpenGL.osmesa" in sys.modules:
        return "osmesa"
    if _egl_device() is not None:
        return "egl"
    if ctypes.util.find_library("OSMesa"):
        return "osmesa"
    raise NoGraphicsError("OpenGL", "neither a working EGL device nor OSMesa", INSTALL)


@functools.cache
def _egl_device() -> int | None:
    """Index of the first EGL device that starts; a GPU without permission is passed over."""
    try:
        egl = ctypes.CDLL(ctypes.util.find_library("EGL") or "libEGL.so.1")
        address = egl.eglGetProcAddress
        address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
        pointers = [address(b"eglQueryDevicesEXT"), address(b"eglGetPlatformDisplayEXT")]
    except (OSError, AttributeError):
        return None
    if None in pointers:
        return None
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    display = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)
    found, devices = ctypes.c_int(0), (ctypes.c_void_p * 64)()
    query(pointers[0])(64, devices, ctypes.addressof(found))
    egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
    for index in range(found.value):
        handle = display(pointers[1])(PLATFORM_DEVICE, devices[index], None)
        if handle and egl.eglInitialize(handle, None, None):
            return index
    return None


def _start(graphics: Graphics, width: int, height: int) -> Any:
    """Make a context and make it current."""
    try:
        platform = _new_platform(graphics, width, height)
        platform.init_context()
        platform.make_current()
        version = graphics.gl.glGetString(graphics.gl.GL_VERSION)
    except Exception as error:  # assertions, EGLError, GLError, TypeError of a null pointer
        raise NoGraphicsError(
            f"OpenGL through {graphics.platform}", f"{type(error).__name__} {error}", INSTALL
        ) from error
    if not version:
        raise NoGraphicsError(f"OpenGL through {graphics.platform}", "an empty context", INSTALL)
    return platform


def _new_platform(graphics: Graphics, width: int, height: int) -> Any:
    if graphics.platform == "osmesa":
        return OSMesaContext(width, height)
    module = importlib.import_module("pyrender.platforms.egl")
    index = int(os.environ.get("EGL_DEVICE_ID", _egl_device() or 0))
    return module.EGLPlatform(width, height, device=module.get_device_by_index(index))


def _stop(graphics: Graphics, platform: Any) -> None:
    """Destroy the context, but leave the EGL display running: others may draw on it."""
    contextdata = importlib.import_module("OpenGL.contextdata")
    contextdata.cleanupContext()
    if graphics.platform == "osmesa":
        platform.delete_context()
        return
    egl = importlib.import_module("OpenGL.EGL")
    egl.eglMakeCurrent(
        platform._egl_display, egl.EGL_NO_SURFACE, egl.EGL_NO_SURFACE, egl.EGL_NO_CONTEXT
    )
    egl.eglDestroyContext(platform._egl_display, platform._egl_context)
