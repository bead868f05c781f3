"""What is no tensor, or no tensor of real numbers, is refused by name by every member.

Each argument in turn is None, a text, a list, a number, an array or a tensor of integers or of
complex numbers. A member may take it (None where an argument may be left out); what it may not do
is to fail with an error that does not say which argument is wrong.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.hard_cases.subjects import Subject
from tests.hard_cases.survey import FAMILIES, MEMBERS
from torchradiometry import geometry, materials, scene, shade, solve, sources, transport
from torchradiometry.deploy import open_model
from torchradiometry.errors import DTypeError, OutOfRangeError, RadiometryError, ShapeError
from torchradiometry.geometry import Patches

WRONG = {
    "None": None,
    "a text": "white",
    "a list": [[1.0]],
    "an array": np.zeros((2, 2)),
    "a number": 1.5,
    "integers": torch.ones(2, 2, dtype=torch.int64),
    "complex numbers": torch.ones(2, 3, dtype=torch.complex64),
}
#: arguments that the list of members itself computes with before it calls the member
TOUCHED = {
    *((f"geometry.{name}", "vertices") for name in ("face_areas", "face_corners", "face_normals")),
    ("geometry.vertex_normals", "vertices"),
    ("geometry.integrate_hemisphere", "weight"),
    ("materials.lambertian_specular_reflectance", "albedo"),
    ("shade.cast_shadows", "depth"),
    ("shade.image_irradiance", "normal"),
    ("shade.shade_points", "normal"),
    ("sources.arrive", "normal"),
    ("sources.arriving_irradiance", "normal"),
    ("sources.irradiance", "direction"),
    ("transport.certain_pairs", "corners"),
    ("transport.pair_visibility", "corners"),
    ("transport.visible_polygon", "position"),
}
FAMILY = {f"{family}-{c.name}": family for family, cases in FAMILIES.items() for c in cases}
ROOM = torch.full((2, 2), 0.25), torch.full((2, 3), 0.5), torch.ones(2, 3)


def tried(subject: Subject) -> list[tuple[str, str, Exception | None]]:
    """Argument, kind and error of every trial."""
    inputs = [t.float() for key, t in subject.easy.items() if key.startswith("input.")]
    module, found = subject.module(torch.float32), []
    for place, name in enumerate(subject.names):
        # modules and functions that solve make an operator of the matrix first
        if (subject.case.name, name) in TOUCHED or name == "form_factors":
            continue
        for kind, value in WRONG.items():
            try:
                module(*inputs[:place], value, *inputs[place + 1 :])
                found.append((name, kind, None))
            except Exception as error:  # which one it is, is the question
                found.append((name, kind, error))
    return found


@pytest.mark.parametrize("member", [m for m in MEMBERS if "quantities" not in m])
def test_an_argument_of_another_kind_is_named(member: str) -> None:
    found = tried(Subject(FAMILY[member], MEMBERS[member]))
    for name, kind, error in found:
        assert error is None or isinstance(error, RadiometryError), f"{name} is {kind}: {error!r}"
    assert any(isinstance(error, DTypeError) for *_, error in found) or not found


@pytest.mark.parametrize("value", [v for k, v in WRONG.items() if k != "None"], ids=str)
def test_form_factors_of_another_kind_are_named(value: object) -> None:
    with pytest.raises((DTypeError, ShapeError), match=r"operator|form_factors|exitance"):
        solve.solve_radiosity(value, *ROOM[1:])


@pytest.mark.parametrize("solver", [solve.Neumann(3), solve.Direct(), solve.GaussSeidel()])
def test_negative_form_factors_are_refused(solver: solve.AbstractSolver) -> None:
    with pytest.raises(OutOfRangeError, match=r"form_factors: got entries down to -0\.25"):
        solver.solve(-ROOM[0], *ROOM[1:])
    nearly = ROOM[0] - torch.eye(2) * (0.25 + 1e-6)  # a step of finite differences
    assert bool(solver.solve(nearly, *ROOM[1:]).radiosity.isfinite().all())


HELD = {
    "a source": lambda v: sources.PointSource(v, [1.0]),
    "power": lambda v: sources.DirectionalSource([0.0, 0, 1], v),
    "a polygon": lambda v: sources.PolygonSource(v, [1.0]),
    "harmonics": sources.HarmonicSource,
    "a material": materials.Lambertian,
    "shininess": lambda v: materials.NormalizedPhong(0.5, v),
    "ambient light": lambda v: shade.AmbientShading(v),
    "corners": lambda v: scene.quad("wall", v),
    "paint": lambda v: scene.box("crate", (1, 1, 1), albedo=v),
    "a size": lambda v: scene.box("crate", v),
    "a place": lambda v: scene.box("crate", (1, 1, 1), v),
    "a radius": lambda v: scene.sphere("ball", v),
    "a room": lambda v: scene.room(v),
    "a panel": lambda v: scene.room(panel=v),
    "an eye": lambda v: geometry.look_at(v, [0.0, 0, 0]),
    "patches": lambda v: geometry.subdivide(v, 0.5),
    "rays": transport.BruteForceRays,
    "a file": open_model,
}


@pytest.mark.parametrize("what", HELD)
@pytest.mark.parametrize("value", ["white", [[1.0], [1.0, 2.0]], object, {"x": 1}], ids=str)
def test_what_is_built_from_another_kind_is_named(what: str, value: object) -> None:
    with pytest.raises(RadiometryError):
        HELD[what](value)


def test_numbers_keep_the_digits_of_the_dtype_that_is_asked_for() -> None:
    crate = scene.box("crate", (0.2, 0.2, 0.2), (0.1, 0.1, 0.1), albedo=0.1, dtype=torch.float64)
    assert float(crate.albedo[0]) == 0.1
    assert float(crate.vertices.max()) == pytest.approx(0.2, rel=1e-15)
    wall = scene.quad(
        "wall", [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], dtype=torch.double
    )
    assert float(wall.vertices.max()) == 0.1
    eye = torch.tensor([0.0, 0, 1], dtype=torch.float64)
    assert float(geometry.look_at(eye, [0.0, 0, 0], [0, 1, 0])[2, 3]) == 1.0
    assert float(geometry.look_at([0.1, 0.0, 1.0], 0 * eye)[0, 3]) == 0.1


@pytest.mark.parametrize("value", [torch.nan, torch.inf, -1.0])
def test_ambient_light_is_a_radiance(value: float) -> None:
    with pytest.raises(RadiometryError, match="radiance"):
        shade.AmbientShading(value)


LENGTHS = {
    "form_factors": lambda c: transport.form_factors(Patches(c)),
    "unoccluded_exchange": lambda c: transport.unoccluded_exchange(Patches(c)),
    "polygon_exchange": lambda c: transport.polygon_exchange(c, c.flip(0)),
    "occluded_exchange": lambda c: transport.occluded_exchange(c, c.flip(0), c),
    "exchange_links": lambda c: transport.exchange_links(Patches(c)),
    "subdivide": lambda c: geometry.subdivide(Patches(c), 1.0),
    "rays": transport.BruteForceRays,
}


@pytest.mark.parametrize("power", [-1000, -256, 257, 1000])
@pytest.mark.parametrize("of", LENGTHS)
def test_lengths_without_an_area_are_refused(of: str, power: int) -> None:
    corners = torch.eye(3, dtype=torch.float64).expand(2, 3, 3) * 2.0**power
    with pytest.raises(OutOfRangeError, match="lengths"):
        LENGTHS[of](corners)


@pytest.mark.parametrize("power", [-250, -60, 60, 250])
def test_form_factors_do_not_know_the_unit_of_length(power: int) -> None:
    floor = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)
    pair = torch.stack((floor, floor.flip(0) + torch.tensor([0.0, 0, 1])))
    found = transport.form_factors(Patches(pair * 2.0**power))
    assert torch.equal(found, transport.form_factors(Patches(pair)))


@pytest.mark.parametrize("kind", [transport.BruteForceRays, transport.EmbreeRays])
def test_rays_of_another_shape_are_named(kind: type[transport.AbstractRayCaster]) -> None:
    caster = kind(torch.eye(3).unsqueeze(0))
    ones = torch.ones(2, 3)
    for call in (caster.closest, caster.occluded):
        for other in (torch.ones(3, 3), torch.ones(2, 2), torch.ones(3)):
            with pytest.raises(ShapeError):
                call(ones, other)
        with pytest.raises(DTypeError):
            call(ones, ones.long())
    with pytest.raises(ShapeError, match="broadcast"):
        caster.visible(ones, torch.ones(3, 3))
    with pytest.raises(ShapeError, match="broadcast"):
        caster.lift(ones, torch.ones(3, 3))
    assert caster.visible(ones[:1], ones).shape == (2,)
