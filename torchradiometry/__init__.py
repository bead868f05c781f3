"""Radiometry as PyTorch layers, from one dot product to full interreflection.

The public names of every room are reachable from here (`torchradiometry.LambertianShading`);
a room is imported when one of its names is first used, so `import torchradiometry` itself
costs nothing and a command that needs no torch does not load it.

Light travels down this list: quantities, geometry, sources, materials, transport, solve,
shade, scene, render, plan; beside them learn, reference, export, deploy and demo.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torchradiometry import cli, demo, deploy, export, learn, plan  # noqa: F401
    from torchradiometry.deploy import *
    from torchradiometry.errors import *
    from torchradiometry.export import *
    from torchradiometry.geometry import *
    from torchradiometry.learn import *
    from torchradiometry.materials import *
    from torchradiometry.plan import *
    from torchradiometry.quantities import *
    from torchradiometry.reference import *
    from torchradiometry.render import *
    from torchradiometry.scene import *
    from torchradiometry.shade import *
    from torchradiometry.solve import *
    from torchradiometry.sources import *
    from torchradiometry.transport import *

__version__ = "0.1.0"

#: rooms whose public names are re-exported, in the order in which a name is looked up
ROOMS = (
    "errors",
    "quantities",
    "geometry",
    "deploy",
    "sources",
    "materials",
    "transport",
    "solve",
    "shade",
    "scene",
    "render",
    "plan",
    "learn",
    "reference",
    "export",
)
MODULES = (*ROOMS, "numerics", "files", "demo", "cli")


def __getattr__(name: str) -> object:
    if name in MODULES:
        return import_module(f"{__name__}.{name}")
    if name == "__all__":  # asked for by `from torchradiometry import *`
        return _public_names()
    if not name.startswith("_"):
        for room in ROOMS:
            module = import_module(f"{__name__}.{room}")
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*_public_names(), *MODULES, "__version__"})


def _public_names() -> list[str]:
    return [name for room in ROOMS for name in import_module(f"{__name__}.{room}").__all__]
