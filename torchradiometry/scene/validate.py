"""What is wrong with a scene: every fault by name, with the mesh and the face.

Each check is one vectorised test over a mesh; a fault names the first face or vertex at fault
and how many there are.

| fault | error |
|---|---|
| NaN or infinite numbers | `InvalidValueError` |
| an index that points at no vertex | `IndexRangeError` |
| a face without area, a normal that is not unit or points backwards | `DegenerateGeometryError` |
| albedo, specular or their sum outside 0..1, negative emission or shininess | `OutOfRangeError` |
| no surface, no light, no camera | `EmptySceneError` |
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import (
    DegenerateGeometryError,
    EmptySceneError,
    IndexRangeError,
    InvalidValueError,
    OutOfRangeError,
    RadiometryError,
)
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.geometry.patches import vector_area
from torchradiometry.numerics import dot, safe_norm, safe_normalize
from torchradiometry.scene.surface import Surface
from torchradiometry.sources.base import AbstractSource

__all__ = ["Fault", "require_none", "scene_faults"]

#: how far a shading normal may be from length 1 (float32 files, 8-bit and 16-bit encodings)
UNIT_TOLERANCE = 1e-2
#: a face is called flat-out degenerate when its area is below this share of the square of its
#: longest edge: float32 coordinates carry no more digits than that
AREA_SHARE = torch.finfo(torch.float32).eps


class Fault(NamedTuple):
    """One thing that is wrong.

    Attributes:
        where: the mesh and what of it, with the first face or vertex at fault.
        what: what was found there.
        mend: how to mend it.
        error: the class of error that `Scene.require_valid` raises for it.
        grave: False if the scene can be rendered all the same.
    """

    where: str
    what: str
    mend: str
    error: type[RadiometryError]
    grave: bool = True

    def __str__(self) -> str:
        return f"{self.where}: {self.what}; {self.mend}"


def require_none(faults: Sequence[Fault]) -> None:
    """Raise the error of the first fault; the number of the others is told."""
    if faults:
        first, more = faults[0], len(faults) - 1
        what = first.what + (f" (and {more} more faults)" if more else "")
        raise first.error(first.where, what, first.mend)


def scene_faults(
    surfaces: Sequence[Surface],
    sources: Sequence[AbstractSource],
    cameras: Sequence[AbstractCamera],
) -> tuple[Fault, ...]:
    """All faults of the surfaces, then of the sources, then of the whole."""
    found = [fault for surface in surfaces for fault in _surface_faults(surface)]
    found += [fault for k, source in enumerate(sources) for fault in _source_faults(k, source)]
    if not any(surface.count for surface in surfaces):
        found.append(Fault("scene", "no faces", "add a surface", EmptySceneError))
    shines = any(bool((surface.emission > 0).any()) for surface in surfaces)
    if not sources and not shines:
        mend = "add a source or give a surface an emission"
        found.append(Fault("scene", "no light", mend, EmptySceneError))
    if not cameras:
        found.append(Fault("scene", "no camera", "add a camera", EmptySceneError))
    return tuple(found)


def _surface_faults(surface: Surface) -> Iterator[Fault]:
    yield from _vertex_faults(surface)
    faces, count = surface.faces, len(surface.vertices)
    outside = ((faces < 0) | (faces >= count)).any(-1)
    mend = f"use vertex indices 0 to {count - 1}"
    yield from _at(surface, "face", outside, "indices out of range", mend, IndexRangeError)
    yield from _face_faults(surface, faces[~outside], torch.nonzero(~outside).squeeze(-1))
    yield from _colour_faults(surface)


def _vertex_faults(surface: Surface) -> Iterator[Fault]:
    bad = ~torch.isfinite(surface.vertices).all(-1)
    mend = "remove or repair them"
    yield from _at(surface, "vertex", bad, "NaN or infinite coordinates", mend, InvalidValueError)
    if surface.normals is not None:
        bad = ~torch.isfinite(surface.normals).all(-1)
        mend = "leave the normals out to shade flat"
        yield from _at(surface, "normal", bad, "NaN or infinite numbers", mend, InvalidValueError)
        length = safe_norm(surface.normals.detach())
        long = ~bad & ((length - 1).abs() > UNIT_TOLERANCE)
        mend = "normalise them"
        yield from _at(surface, "normal", long, "length other than 1", mend,
                       DegenerateGeometryError, grave=False)  # fmt: skip
    if surface.texture is not None:
        bad = ~torch.isfinite(surface.texture.coordinates).all(-1)
        mend = "give finite texture coordinates"
        yield from _at(surface, "vertex", bad, "NaN or infinite texture coordinates", mend,
                       InvalidValueError)  # fmt: skip


def _face_faults(surface: Surface, faces: Tensor, index: Tensor) -> Iterator[Fault]:
    """Zero area, and shading normals on the wrong side; `faces` point at vertices that exist."""
    corners = surface.vertices.detach().double()[faces]
    area = vector_area(corners)
    longest = safe_norm(corners.roll(-1, -2) - corners).amax(-1)
    thin = torch.isfinite(area).all(-1) & (safe_norm(area) <= AREA_SHARE * longest**2)
    yield from _at(surface, "face", thin, "no area", "remove it", DegenerateGeometryError, index,
                   grave=False)  # fmt: skip
    if surface.normals is not None:
        shading = surface.normals.detach().double()[faces].sum(-2)
        turned = ~thin & (dot(safe_normalize(area), safe_normalize(shading)) < 0)
        mend = "turn the normals or the order of the corners"
        yield from _at(surface, "face", turned, "normals against the winding", mend,
                       DegenerateGeometryError, index, grave=False)  # fmt: skip


def _colour_faults(surface: Surface) -> Iterator[Fault]:
    colours = {
        "albedo": (surface.albedo, 1.0),
        "emission": (surface.emission, torch.inf),
        "specular": (surface.specular, 1.0),
        "shininess": (surface.shininess, torch.inf),
    }
    if surface.glossy:
        colours["albedo + specular"] = (surface.albedo + surface.specular, 1.0)
    if surface.texture is not None:
        colours["texture"] = (surface.texture.image, 1.0)
    for name, (value, most) in colours.items():
        where = f"surface {surface.name!r}, {name}"
        value = value.detach()
        if not bool(torch.isfinite(value).all()):
            mend = "give finite numbers"
            yield Fault(where, "NaN or infinite numbers", mend, InvalidValueError)
        elif bool(((value < 0) | (value > most)).any()):
            low, high = float(value.min()), float(value.max())
            mend = "keep it >= 0" if most == torch.inf else "keep it in 0..1"
            yield Fault(where, f"values from {low:.4g} to {high:.4g}", mend, OutOfRangeError)


def _source_faults(number: int, source: AbstractSource) -> Iterator[Fault]:
    for name, value in source.state_dict().items():
        where = f"source {number} ({type(source).__name__}), {name}"
        if not bool(torch.isfinite(value).all()):
            yield Fault(where, "NaN or infinite numbers", "give finite numbers", InvalidValueError)
        elif _is_power(name) and bool((value < 0).any()):
            yield Fault(where, f"{float(value.min()):.4g}", "keep it >= 0", OutOfRangeError)


def _is_power(name: str) -> bool:
    return name.rsplit(".", 1)[-1] in ("irradiance", "intensity", "radiance", "radiant_intensity")


def _at(
    surface: Surface,
    part: str,
    wrong: Tensor,
    what: str,
    mend: str,
    error: type[RadiometryError],
    index: Tensor | None = None,
    *,
    grave: bool = True,
) -> Iterator[Fault]:
    """One fault for all entries that are wrong, naming the first."""
    rows = torch.nonzero(wrong).squeeze(-1)
    if rows.numel():
        first = int(rows[0] if index is None else index[rows[0]])
        number = "" if rows.numel() == 1 else f" ({rows.numel()} of them)"
        yield Fault(f"surface {surface.name!r}, {part} {first}", what + number, mend, error, grave)
