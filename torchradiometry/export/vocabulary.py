"""What the inputs of an exported graph are called, how their axes run, and sample values.

One table, by input name: axes, quantity and unit. The quantity also says how a random value
of it looks (a normal is a unit vector, a shininess lies in 1..30), so that a checker can make
inputs of any size for a graph it has never seen.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import ShapeError
from torchradiometry.numerics import safe_normalize

__all__ = ["VOCABULARY", "InputNote", "note_for", "random_inputs", "random_value"]


class InputNote(NamedTuple):
    """What the metadata says about one input."""

    axes: tuple[str, ...]
    quantity: str
    unit: str

    def dynamic(self) -> dict[int, str]:
        """Axis number -> name, for the axes that are not fixed."""
        return {i: axis for i, axis in enumerate(self.axes) if not axis.isdigit()}


IMAGE = ("height", "width")
#: by input name; `C` stands for the channel count of the example
VOCABULARY: dict[str, InputNote] = {
    "normal": InputNote(("batch", "3", *IMAGE), "normal", "1"),
    "albedo": InputNote(("batch", "C", *IMAGE), "albedo", "1"),
    "position": InputNote(("batch", "3", *IMAGE), "position", "m"),
    "visibility": InputNote(("batch", "light", *IMAGE), "visibility", "1"),
    "specular": InputNote(("batch", "C", *IMAGE), "albedo", "1"),
    "shininess": InputNote(("batch", "1", *IMAGE), "shininess", "1"),
    "outgoing_direction": InputNote(("batch", "3", *IMAGE), "normal", "1"),
    "radiance": InputNote(("batch", "C"), "radiance", "W/m2/sr"),
    "irradiance": InputNote(("batch", "C", *IMAGE), "irradiance", "W/m2"),
    "depth": InputNote(("batch", "1", *IMAGE), "depth", "m"),
    "points": InputNote(("batch", "3", *IMAGE), "points", "m"),
    "intrinsics": InputNote(("3", "3"), "intrinsics", "pixel"),
    "source_direction": InputNote(("light", "3"), "normal", "1"),
    "source_irradiance": InputNote(("light", "C"), "irradiance", "W/m2"),
    "source_position": InputNote(("light", "3"), "source_position", "m"),
    "source_center": InputNote(("light", "3"), "source_position", "m"),
    "source_intensity": InputNote(("light", "C"), "radiant_intensity", "W/sr"),
    "source_radiance": InputNote(("light", "C"), "radiance", "W/m2/sr"),
    "source_radius": InputNote(("light", "1"), "radius", "m"),
    "source_axis": InputNote(("light", "3"), "spot_axis", "1"),
    "source_inner_cone": InputNote(("light", "1"), "inner_cone", "rad"),
    "source_outer_cone": InputNote(("light", "1"), "outer_cone", "rad"),
    "source_corners": InputNote(("light", "C", "3"), "polygon", "m"),
    "source_up": InputNote(("light", "3"), "normal", "1"),
    "source_coefficients": InputNote(("light", "9", "C"), "harmonics", "W/m2/sr^0.5"),
}


def note_for(
    name: str, tensor: Tensor, axes: Sequence[str] | None = None, unit: str | None = None
) -> InputNote:
    """Axes, quantity and unit of an input, from the table unless given.

    Args:
        name: input name; `source3_direction` is looked up as `source_direction`.
        tensor: the example.
        axes: the names of its axes, one each; a number as text is a fixed axis.
        unit: its unit.

    Raises:
        ShapeError: axes that do not match the example, or a dynamic axis of size 1 (the
            exporter would take it for a fixed one).
    """
    plain = re.sub(r"^source\d+_", "source_", name)
    if plain in VOCABULARY:
        known = VOCABULARY[plain]
    else:
        names = ("batch", "C", *IMAGE) if tensor.ndim == 4 else ("C",) * tensor.ndim
        known = InputNote(names, "number", "1")
    given = tuple(axes) if axes is not None else _fit(known.axes, tensor.ndim)
    got = f"axes {given} for a tensor of shape {tuple(tensor.shape)}"
    if len(given) != tensor.ndim:
        raise ShapeError(name, got, "name every axis once")
    pairs = list(zip(given, tensor.shape, strict=True))
    full = tuple(str(size) if axis == "C" else axis for axis, size in pairs)
    for axis, size in zip(full, tensor.shape, strict=True):
        if axis.isdigit() and int(axis) != size:
            raise ShapeError(name, got, f"its axis of size {size} is fixed to {axis}")
        if not axis.isdigit() and size < 2:
            raise ShapeError(name, got, f"give the dynamic axis {axis} a size of at least 2")
    return InputNote(full, known.quantity, unit or known.unit)


def _fit(axes: tuple[str, ...], ndim: int) -> tuple[str, ...]:
    """A source's tensors may carry a batch axis in front (`batch light k`)."""
    return ("batch", *axes) if ndim == len(axes) + 1 and axes[0] == "light" else axes


def random_inputs(
    notes: Mapping[str, InputNote],
    sizes: Mapping[str, int],
    dtypes: Mapping[str, torch.dtype],
    seed: int = 0,
) -> dict[str, Tensor]:
    """Reproducible inputs of the given axis sizes, physically sensible by quantity.

    Raises:
        ShapeError: an axis without a size.
    """
    generator = torch.Generator().manual_seed(seed)
    made = {}
    for name, note in notes.items():
        missing = [a for a in note.axes if not a.isdigit() and a not in sizes]
        if missing:
            raise ShapeError("sizes", f"none for the axis {missing[0]} of {name}", "name its size")
        shape = tuple(int(a) if a.isdigit() else sizes[a] for a in note.axes)
        made[name] = random_value(note, shape, generator).to(dtypes[name])
    return made


def random_value(note: InputNote, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    """One input in float64: a value such as the quantity takes in use."""
    uniform = torch.rand(shape, dtype=torch.float64, generator=generator)
    if note.quantity in ("normal", "spot_axis"):
        return _towards(uniform, 1.0 if note.quantity == "normal" else -1.0, note)
    if note.quantity == "source_position":
        return uniform - 0.5 + 2.5 * _z_axis(shape, note)
    if note.quantity == "points":
        return uniform * 0.1 + _plane(shape)
    if note.quantity == "polygon":
        return _polygons(uniform)
    if note.quantity == "intrinsics":
        return torch.tensor([[40.0, 0.0, 20.0], [0.0, 40.0, 20.0], [0.0, 0.0, 1.0]]).double()
    low, high = RANGES.get(note.quantity, (0.1, 1.0))
    return low + (high - low) * uniform


#: range of the uniform sample of a scalar quantity
RANGES = {
    "albedo": (0.05, 0.95),
    "visibility": (0.0, 1.0),
    "shininess": (1.0, 30.0),
    "position": (-0.5, 0.5),
    "depth": (1.0, 1.2),
    "radius": (0.1, 0.4),
    "inner_cone": (0.1, 0.3),
    "outer_cone": (0.5, 0.9),
    "harmonics": (0.0, 0.3),
    "irradiance": (0.5, 3.0),
    "radiant_intensity": (1.0, 5.0),
}


def _vector_axis(note: InputNote) -> int:
    return note.axes.index("3")


def _z_axis(shape: tuple[int, ...], note: InputNote) -> Tensor:
    """1 in the z component, 0 elsewhere, of a tensor of vectors."""
    axis = _vector_axis(note)
    z = torch.zeros(3, dtype=torch.float64)
    z[2] = 1
    view = [1] * len(shape)
    view[axis] = 3
    return z.reshape(view)


def _towards(uniform: Tensor, z: float, note: InputNote) -> Tensor:
    """Unit vectors within about 60 degrees of +z or -z."""
    vectors = (uniform - 0.5) * 2 + 1.5 * z * _z_axis(tuple(uniform.shape), note)
    return safe_normalize(vectors.movedim(_vector_axis(note), -1)).movedim(-1, _vector_axis(note))


def _plane(shape: tuple[int, ...]) -> Tensor:
    """Camera-frame points of a plane at z = -1, `B 3 H W`."""
    y, x = torch.meshgrid(
        torch.linspace(0.5, -0.5, shape[2], dtype=torch.float64),
        torch.linspace(-0.5, 0.5, shape[3], dtype=torch.float64),
        indexing="ij",
    )
    return torch.stack([x, y, torch.full_like(x, -1.0)])


def _polygons(uniform: Tensor) -> Tensor:
    """Regular polygons of random size above the origin that shine down, `... corner 3`."""
    corners = uniform.shape[-2]
    turn = -2 * math.pi * torch.arange(corners, dtype=torch.float64) / corners
    circle = torch.stack([torch.cos(turn), torch.sin(turn), torch.zeros_like(turn)], -1)
    size = 0.3 + uniform[..., :1, :1]
    lift = torch.tensor([0.0, 0.0, 2.0], dtype=torch.float64)
    return circle * size + lift + uniform[..., :1, :] * 0.2
