"""An OpenGL 3.3 core context in plain memory, through Mesa's OSMesa library.

pyrender has such a class, but it needs a newer PyOpenGL than the one pyrender asks for, so
the functions are called directly. The values below are those of GL/osmesa.h.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from types import ModuleType
from typing import Any

__all__ = ["OSMesaContext", "number_contexts"]

GL_UNSIGNED_BYTE, GL_RGBA = 0x1401, 0x1908
FORMAT, DEPTH_BITS, PROFILE, CORE_PROFILE, MAJOR, MINOR = 0x22, 0x30, 0x33, 0x34, 0x36, 0x37
ATTRIBUTES = (FORMAT, GL_RGBA, DEPTH_BITS, 24, PROFILE, CORE_PROFILE, MAJOR, 3, MINOR, 3, 0)


class OSMesaContext:
    """A context with a buffer of its own; pictures are drawn into framebuffer objects.

    Args:
        width, height: of the buffer, pixels.
    """

    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        self.buffer = ctypes.create_string_buffer(4 * width * height)
        self.library = ctypes.CDLL(ctypes.util.find_library("OSMesa") or "libOSMesa.so.8")
        self.context: ctypes.c_void_p | None = None

    def init_context(self) -> None:
        """Make the context."""
        create = self.library.OSMesaCreateContextAttribs
        create.restype = ctypes.c_void_p
        self.context = ctypes.c_void_p(create((ctypes.c_int * 11)(*ATTRIBUTES), None))
        if not self.context.value:
            raise OSError("OSMesa makes no OpenGL 3.3 core context")

    def make_current(self) -> None:
        """Direct the OpenGL calls of this thread to the context."""
        current = self.library.OSMesaMakeCurrent
        current.restype = ctypes.c_ubyte
        if not current(self.context, self.buffer, GL_UNSIGNED_BYTE, *self.size):
            raise OSError("OSMesa does not make its context current")

    def delete_context(self) -> None:
        """Free the context."""
        self.library.OSMesaDestroyContext.restype = None
        self.library.OSMesaDestroyContext(self.context)
        self.context = None


def number_contexts(platform: ModuleType) -> None:
    """Let `OpenGL.platform` name the current context by a number.

    PyOpenGL 3.1.0 names it by a pointer object, which cannot be the key of a dictionary; its
    own bookkeeping and pyrender's shader cache need one.
    """
    function = platform.PLATFORM.OSMesa["OSMesaGetCurrentContext"]
    function.restype = ctypes.c_void_p

    def current() -> int:
        return function() or 0

    holders: tuple[Any, ...] = (platform, platform.PLATFORM)
    for holder in holders:
        holder.GetCurrentContext = holder.CurrentContextIsValid = current
