"""The kinds of extreme, as data: a name, which tensors they change, and what is asked of them.

A kind applies to a subject that has tensors of its roles; a new member of `tests/cases.py` is
covered by the kinds of what it takes and holds. Changes are made in float64 and rounded to the
dtype of the run; where the extreme is no number of that dtype, the kind does not apply there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from tests.hard_cases.subjects import Leaves, is_light, role

#: what shines, in any unit
POWER = {"radiance", "irradiance", "intensity", "coefficients", "exitance"}
#: unit vectors, of surfaces, of sources and of the eye
DIRECTIONS = {"normal", "direction", "axis", "up", "incident_direction", "outgoing_direction"}
#: shares that are reflected or seen
REFLECTANCE = {"albedo", "specular"}
#: lengths and places, m
PLACES = {"position", "center", "corners"}
LENGTHS = PLACES | {"radius", "depth"}

#: the changed tensors, or None where the kind does not apply
Change = Callable[[Leaves], Leaves | None]


class Kind(NamedTuple):
    """A kind of extreme.

    Attributes:
        name: as in the table.
        change: easy tensors -> the tensors that become hard.
        smooth: the gradient is that of float64 too; otherwise (kinks, jumps) it is finite.
        values: the values are those of float64 too; otherwise (on a jump) they are finite.
    """

    name: str
    change: Change
    smooth: bool = True
    values: bool = True


def each(roles: set[str], change: Callable[[Tensor], Tensor]) -> Change:
    """Every tensor of these roles, changed."""

    def changed(leaves: Leaves) -> Leaves | None:
        return {k: change(t) for k, t in leaves.items() if role(k) in roles} or None

    return changed


def _index(name: str, tensor: Tensor) -> tuple:
    """The first pixel of an image `B C H W`, the first point of `... point c`."""
    image = tensor.ndim == 4 and not name.endswith("direction")
    return (0, slice(None), 0, 0) if image else (0,) * (tensor.ndim - 1)


def at_first(leaves: Leaves, name: str, value: Tensor | None = None) -> Tensor:
    """An input at its first pixel or point; or the whole input with this value put there."""
    tensor = leaves[f"input.{name}"]
    place = _index(name, tensor)
    if value is None:
        return tensor[place]
    tensor = tensor.clone()
    tensor[place] = value
    return tensor


def first_point(change: Callable[[Tensor], Tensor], *names: str) -> Change:
    """The inputs of these names, changed at the first pixel or point."""

    def changed(leaves: Leaves) -> Leaves | None:
        there = [n for n in names if f"input.{n}" in leaves]
        found = {n: change(at_first(leaves, n)) for n in there}
        return {f"input.{n}": at_first(leaves, n, v) for n, v in found.items()} or None

    return changed


def the_light(leaves: Leaves, *roles: str) -> Tensor | None:
    """The first of the lights' tensors of these roles, its first light."""
    for key, tensor in leaves.items():
        if is_light(key) and role(key) in roles:
            return tensor[0]
    return None


def _middle(place: Tensor) -> Tensor:
    """A place itself, or the middle of a polygon."""
    return place.mean(-2) if place.ndim == 2 else place


def first_place(change: Callable[[Tensor, Tensor], Tensor | None]) -> Change:
    """The first point, put where `change(place of the first near light, point)` says."""

    def changed(leaves: Leaves) -> Leaves | None:
        light = the_light(leaves, *PLACES)
        if light is None or "input.position" not in leaves:
            return None
        point = change(light, at_first(leaves, "position"))
        return None if point is None else {"input.position": at_first(leaves, "position", point)}

    return changed


def first_normal(change: Callable[[Tensor], Tensor]) -> Change:
    """The first normal, made from the unit direction to the first light."""

    def changed(leaves: Leaves) -> Leaves | None:
        towards, place = the_light(leaves, "direction", "up"), the_light(leaves, *PLACES)
        if "input.incident_direction" in leaves:
            towards = at_first(leaves, "incident_direction")
        elif place is not None and "input.position" in leaves:
            towards = _middle(place) - at_first(leaves, "position")
        if towards is None or "input.normal" not in leaves:
            return None
        normal = change(towards / towards.norm())
        return {"input.normal": at_first(leaves, "normal", normal)}

    return changed


def _tilted(towards: Tensor, cosine: float) -> Tensor:
    """A unit vector with this cosine to a unit vector."""
    across = torch.linalg.cross(towards, towards.flip(-1) + torch.eye(3, dtype=towards.dtype)[0])
    return cosine * towards + math.sqrt(1 - cosine**2) * across / across.norm()


def with_input(name: str, change: Callable[[Tensor], Tensor]) -> Change:
    """One input, changed as a whole."""

    def changed(leaves: Leaves) -> Leaves | None:
        key = f"input.{name}"
        return {key: change(leaves[key])} if key in leaves else None

    return changed


def faces(*changed: list) -> Change:
    """The first triangles of an input `corners`, replaced by these (lists of corners)."""

    def change(corners: Tensor) -> Tensor:
        corners = corners.clone()
        corners[: len(changed)] = torch.tensor(changed, dtype=corners.dtype)
        return corners

    return with_input("corners", change)


def lights_faces(change: Callable[[Tensor], Tensor]) -> Change:
    """The corners of polygons that shine, `light corner 3`."""

    def changed(leaves: Leaves) -> Leaves | None:
        return {
            k: change(t) for k, t in leaves.items() if is_light(k) and role(k) == "corners"
        } or None

    return changed


def moved(by: float) -> Change:
    """Every place, moved; only where there are lights or faces to be seen from it."""

    def changed(leaves: Leaves) -> Leaves | None:
        return {k: t + by for k, t in leaves.items() if role(k) in PLACES} or None

    return changed


def hole(value: float) -> Change:
    """One depth of this value."""
    return first_point(lambda d: torch.full_like(d, value), "depth")


def _needle(corners: Tensor) -> Tensor:
    """Squeezed across its first edge to 1e-6 of its width."""
    first = corners[:, :1]
    along = corners[:, 1:2] - first
    along = along / along.norm(dim=-1, keepdim=True)
    spread = corners - first
    share = (spread * along).sum(-1, keepdim=True) * along
    return first + share + 1e-6 * (spread - share)


def _repeated(corners: Tensor) -> Tensor:
    corners = corners.clone()
    corners[:, 1] = corners[:, 0]
    return corners


def _diagonal(factors: Tensor) -> Tensor:
    return torch.eye(len(factors), dtype=factors.dtype) + 0 * factors


def _hidden(factors: Tensor) -> Tensor:
    """Row and column 0 of the first patch: it has no area."""
    factors = factors.clone()
    factors[0], factors[:, 0] = 0, 0
    return factors


def full(value: float) -> Callable[[Tensor], Tensor]:
    return lambda t: torch.full_like(t, value)


def times(factor: float) -> Callable[[Tensor], Tensor]:
    return lambda t: t * factor


FLOOR = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
BESIDE = [[1, 0, 0], [1, 1, 0], [0, 1, 0]]
WALL = [[0, 0, 0], [0, 1, 0], [0, 0, 1]]

# fmt: off
KINDS = [
    # surfaces
    Kind("easy", lambda leaves: {}),
    Kind("a zero normal", first_point(times(0), "normal"), smooth=False),
    Kind("normals of length 1000", with_input("normal", times(1e3))),
    Kind("normals of length 1e-3", with_input("normal", times(1e-3))),
    Kind("normal to the light", first_normal(lambda d: d), smooth=False),
    Kind("grazing light, cosine 1e-3", first_normal(lambda d: _tilted(d, 1e-3)), smooth=False),
    Kind("grazing light, cosine 1e-7", first_normal(lambda d: _tilted(d, 1e-7)), smooth=False, values=False),
    Kind("edge-on light, cosine 0", first_normal(lambda d: _tilted(d, 0.0)), smooth=False, values=False),
    Kind("light behind the surface", first_normal(lambda d: -d), smooth=False),
    # directions
    Kind("a zero direction to the light", first_point(times(0), "incident_direction"), smooth=False),
    Kind("a zero direction to the eye", first_point(times(0), "outgoing_direction"), smooth=False),
    Kind("directions of length 1000", each({"incident_direction", "outgoing_direction"}, times(1e3))),
    Kind("the eye below the surface", first_point(lambda d: d * torch.tensor([1.0, 1, -1], dtype=d.dtype), "outgoing_direction"), smooth=False),
    Kind("light and eye along the normal", lambda leaves: {k: t * 0 + torch.tensor([0, 0, 1.0], dtype=t.dtype) for k, t in leaves.items() if role(k) in DIRECTIONS and k.startswith("input.")} if "input.incident_direction" in leaves else None, smooth=False),
    Kind("light and eye opposite", lambda leaves: {"input.incident_direction": at_first(leaves, "incident_direction", torch.tensor([1.0, 0, 0], dtype=torch.float64)), "input.outgoing_direction": at_first(leaves, "outgoing_direction", torch.tensor([-1.0, 0, 0], dtype=torch.float64))} if "input.incident_direction" in leaves else None, smooth=False),
    Kind("a source of zero direction", lambda leaves: {k: t * 0 for k, t in leaves.items() if is_light(k) and role(k) in {"direction", "axis", "up"}} or None, smooth=False),
    Kind("source directions of length 2^40", lambda leaves: {k: t * 2.0**40 for k, t in leaves.items() if is_light(k) and role(k) in {"direction", "axis", "up"}} or None),
    Kind("source directions of length 2^-40", lambda leaves: {k: t * 2.0**-40 for k, t in leaves.items() if is_light(k) and role(k) in {"direction", "axis", "up"}} or None),
    # reflectance
    Kind("albedo 0", each(REFLECTANCE, full(0))),
    Kind("albedo 1e-30", each(REFLECTANCE, full(1e-30))),
    Kind("albedo 1", each(REFLECTANCE, full(1))),
    Kind("albedo 1.5", each(REFLECTANCE, full(1.5))),
    Kind("albedo -0.1", each(REFLECTANCE, full(-0.1))),
    Kind("shininess 0", each({"shininess"}, full(0)), smooth=False),
    Kind("shininess 0.5", each({"shininess"}, full(0.5)), smooth=False),
    Kind("shininess 1e6", each({"shininess"}, full(1e6))),
    Kind("shininess 1e6 in the mirror direction", lambda leaves: {**each({"shininess"}, full(1e6))(leaves), "input.outgoing_direction": at_first(leaves, "incident_direction") * 0 + torch.tensor([0, 0, 1.0]).double(), "input.incident_direction": leaves["input.incident_direction"] * 0 + torch.tensor([0, 0, 1.0]).double()} if each({"shininess"}, full(1e6))(leaves) and "input.incident_direction" in leaves else None, smooth=False),
    Kind("roughness 0", each({"roughness"}, full(0)), smooth=False),
    Kind("roughness 1e-4", each({"roughness"}, full(1e-4)), smooth=False),
    Kind("roughness 1", each({"roughness"}, full(1))),
    Kind("visibility 0", each({"visibility"}, full(0))),
    Kind("visibility 1", each({"visibility"}, full(1))),
    # light
    Kind("no power", each(POWER, full(0))),
    Kind("power 1e-12", each(POWER, times(1e-12))),
    Kind("power 1e12", each(POWER, times(1e12))),
    Kind("sphere of radius 0", each({"radius"}, full(0)), smooth=False),
    Kind("inside the sphere", each({"radius"}, full(10))),
    Kind("a cone of one angle", lambda leaves: {k: torch.full_like(t, 0.3) for k, t in leaves.items() if role(k) in {"inner_cone", "outer_cone"}} or None, smooth=False),
    Kind("a cone of angle 0", lambda leaves: {k: torch.full_like(t, 0) for k, t in leaves.items() if role(k) in {"inner_cone", "outer_cone"}} or None, smooth=False),
    # places
    Kind("a point at the source", first_place(lambda light, x: _middle(light)), smooth=False, values=False),
    Kind("a point 1e-3 from the source", first_place(lambda light, x: _middle(light) - torch.tensor([0, 0, 1e-3], dtype=x.dtype))),
    Kind("a point at a polygon's corner", first_place(lambda light, x: light[0] if light.ndim == 2 else None), smooth=False, values=False),
    Kind("a point on a polygon's edge", first_place(lambda light, x: (light[0] + light[1]) / 2 if light.ndim == 2 else None), smooth=False, values=False),
    Kind("a point in a polygon's plane", first_place(lambda light, x: 3 * light[0] - 2 * light.mean(-2) if light.ndim == 2 else None), smooth=False, values=False),
    Kind("a point behind the source", first_place(lambda light, x: 2 * _middle(light) - x), smooth=False),
    Kind("sources 1e6 m away", lambda leaves: {k: t * 1e6 for k, t in leaves.items() if is_light(k) and role(k) in PLACES} or None),
    Kind("scene times 2^40", each(LENGTHS, times(2.0**40))),
    Kind("scene times 2^-40", each(LENGTHS, times(2.0**-40))),
    Kind("scene moved by 1e6", moved(1e6), smooth=False),
    Kind("a source without area", lights_faces(lambda c: c[:, :1].expand_as(c).clone()), smooth=False),
    Kind("a source with a repeated corner", lights_faces(_repeated)),
    Kind("a needle source", lights_faces(_needle), smooth=False),
    # triangles
    Kind("a face without area", faces([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), smooth=False),
    Kind("a face of one point", faces([[0.5, 0.5, 0.5]] * 3), smooth=False),
    Kind("a needle face", faces([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0]]), smooth=False),
    Kind("a repeated vertex", faces([[0, 0, 0], [0, 0, 0], [0, 1, 0]]), smooth=False),
    Kind("two coincident faces", faces(FLOOR, FLOOR), smooth=False),
    Kind("two faces back to back", faces(FLOOR, FLOOR[::-1]), smooth=False),
    Kind("coplanar touching faces", faces(FLOOR, BESIDE), smooth=False),
    Kind("faces that meet in an edge", faces(FLOOR, WALL), smooth=False),
    Kind("faces 1e-6 apart", faces(FLOOR, [[x, y, 1e-6] for x, y, _ in FLOOR[::-1]]), smooth=False),
    # depth maps
    Kind("a depth that is NaN", hole(math.nan), smooth=False),
    Kind("an infinite depth", hole(math.inf), smooth=False),
    Kind("a depth of 0", hole(0), smooth=False),
    Kind("a negative depth", hole(-1), smooth=False),
    Kind("a depth of 1e-3", hole(1e-3), smooth=False),
    Kind("a depth of 1e4", hole(1e4), smooth=False),
    Kind("no depth seen", with_input("depth", full(math.nan)), smooth=False),
    Kind("a flat depth map", with_input("depth", full(2)), smooth=False),
    Kind("focal length 0", with_input("intrinsics", lambda k: k * torch.tensor([0, 0, 1.0]).to(k).unsqueeze(-1)), smooth=False, values=False),
    # patches
    Kind("patches that see nothing", with_input("form_factors", times(1e-12))),
    Kind("a patch that nobody sees", with_input("form_factors", _hidden)),
    Kind("patches that see only themselves", with_input("form_factors", _diagonal)),
    Kind("rows of form factors that sum to 1.5", with_input("form_factors", times(1.5))),
]
# fmt: on
