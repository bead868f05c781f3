"""Scenes at the edge of what has a meaning: rendered, differentiated, planned, or refused by name.

Every effect of the planner takes part: `Planner` chooses among all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from tests.cases import EFFECTS
from torchradiometry import errors, plan, render, scene, solve, sources, transport
from torchradiometry.geometry import OrthographicCamera, Patches

SUN = sources.DirectionalSource([0.3, -0.4, 1.0], [2.0, 2.0, 2.0]).double()
FAST = render.RenderSettings(bounces=2, supersampling=1)


def faces(*corners: list) -> scene.Surface:
    """Separate triangles."""
    points = torch.tensor(corners, dtype=torch.float64).reshape(-1, 3)
    index = torch.arange(len(points)).reshape(-1, 3)
    return scene.Surface("hard", points, index, torch.tensor([0.2, 0.5, 0.9]).double())


def camera(scale: float = 1.0, pixels: int = 4, shift: float = 0.0) -> OrthographicCamera:
    """Looks down on the unit square from above."""
    place = torch.eye(4, dtype=torch.float64)
    place[:3, 3] = torch.tensor([0.5, 0.5, 3.0]) * scale + shift
    return OrthographicCamera(width=pixels, height=pixels, ymag=0.75 * scale, camera_to_world=place)


def seen(made: scene.Surface, pixels: int = 4) -> tuple[render.Picture, Tensor]:
    """The picture, and the gradient of its sum for the albedo."""
    albedo = made.albedo.clone().requires_grad_()
    lit = scene.Scene((replace(made, albedo=albedo),), (SUN,))
    picture = render.render_scene(lit, camera(pixels=pixels), FAST)
    (gradient,) = torch.autograd.grad(picture.radiance.sum(), albedo)
    return picture, gradient


FLOOR = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
BESIDE = [[1, 0, 0], [1, 1, 0], [0, 1, 0]]
WALL = [[0, 0, 0], [0, 1, 0], [0, 0, 1]]
HARD: dict[str, Callable[[], scene.Surface]] = {
    "one triangle": lambda: faces(FLOOR),
    "a face without area": lambda: faces(FLOOR, [[0, 0, 1], [1, 1, 1], [2, 2, 1]]),
    "a face of one point": lambda: faces(FLOOR, [[0.5, 0.5, 0.5]] * 3),
    "a needle": lambda: faces(FLOOR, [[0, 0, 1], [1, 0, 1], [0.5, 1e-6, 1]]),
    "a repeated vertex": lambda: faces(FLOOR, [[0, 0, 1], [0, 0, 1], [0, 1, 1]]),
    "coincident faces": lambda: faces(FLOOR, FLOOR),
    "faces back to back": lambda: faces(FLOOR, FLOOR[::-1]),
    "coplanar touching faces": lambda: faces(FLOOR, BESIDE),
    "faces that meet in an edge": lambda: faces(FLOOR, WALL),
    "a gap of 1e-6": lambda: faces(FLOOR, [[x, y, 1e-6] for x, y, _ in FLOOR]),
    "turned faces": lambda: faces(FLOOR[::-1], BESIDE),
    "disconnected faces": lambda: faces(FLOOR, [[x + 5, y, z] for x, y, z in FLOOR]),
    "seen edge-on": lambda: faces(WALL),
    "below the camera's view": lambda: faces([[x + 50, y, z] for x, y, z in FLOOR]),
}


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("pixels", [1, 4])
def test_pictures_and_gradients_are_finite(name: str, pixels: int) -> None:
    picture, gradient = seen(HARD[name](), pixels)
    assert torch.isfinite(picture.radiance).all()
    assert (picture.radiance >= 0).all()
    assert torch.isfinite(gradient).all()


def test_pictures_in_fewer_digits_are_those_of_float64() -> None:
    """Of all of them: every number of these scenes but two (1e-6) is held by each dtype."""
    sun = sources.DirectionalSource([0.25, -0.5, 1.0], [2.0, 2.0, 2.0]).double()
    paint = torch.tensor([0.25, 0.5, 0.875], dtype=torch.float64)
    for name, make in HARD.items():
        lit = scene.Scene((replace(make(), albedo=paint),), (sun,), (camera(),))
        exact = render.render_scene(lit, lit.cameras[0], FAST).radiance
        for dtype in (torch.float32, torch.bfloat16, torch.float16):
            few = lit.to(dtype)
            found = render.render_scene(few, few.cameras[0], FAST).radiance
            assert found.dtype == dtype, name
            allowed = 4 * torch.finfo(dtype).eps * float(exact.max())
            assert float((found.double() - exact).abs().max()) <= allowed, name


@pytest.mark.parametrize("name", ["a face without area", "a face of one point", "coincident faces"])
def test_what_adds_nothing_changes_nothing(name: str) -> None:
    alone, _ = seen(HARD["one triangle"]())
    found, _ = seen(HARD[name]())
    torch.testing.assert_close(found.radiance, alone.radiance, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("scale", [2.0**-40, 2.0**40])
def test_the_size_of_a_scene_does_not_matter(scale: float) -> None:
    made = HARD["faces that meet in an edge"]()
    plain = render.render_scene(scene.Scene((made,), (SUN,)), camera(), FAST)
    sized = replace(made, vertices=made.vertices * scale)
    found = render.render_scene(scene.Scene((sized,), (SUN,)), camera(scale), FAST)
    assert plain.radiance.max() > 0
    torch.testing.assert_close(found.radiance, plain.radiance, rtol=1e-9, atol=1e-12)


def test_a_scene_may_lie_1e6_away() -> None:
    made = HARD["faces that meet in an edge"]()
    plain = render.render_scene(scene.Scene((made,), (SUN,)), camera(), FAST)
    moved = replace(made, vertices=made.vertices + 2.0**20)
    found = render.render_scene(scene.Scene((moved,), (SUN,)), camera(shift=2.0**20), FAST)
    torch.testing.assert_close(found.radiance, plain.radiance, rtol=1e-6, atol=1e-9)


def test_no_light_is_black_and_no_surface_is_refused() -> None:
    dark = scene.Scene((HARD["one triangle"](),))
    assert (render.render_scene(dark, camera(), FAST).radiance == 0).all()
    with pytest.raises(errors.EmptySceneError):
        render.render_scene(scene.Scene((), (SUN,)), camera(), FAST)


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("lit", [True, False])
def test_every_effect_has_an_answer_for_scenes_with_next_to_nothing(name: str, lit: bool) -> None:
    made = scene.Scene((HARD[name](),), (SUN,) if lit else (), (camera(pixels=8),))
    found = plan.Planner(0.1, costs=plan.Costs()).plan(made, made.cameras[0])
    assert {type(effect) for effect in plan.EFFECTS} == set(EFFECTS)
    assert 0 <= found.predicted_error < float("inf")
    assert found.predicted_seconds >= 0


@pytest.mark.parametrize(("scale", "shift"), [(2.0**-40, 0.0), (2.0**40, 0.0), (1.0, 2.0**20)])
def test_plans_do_not_depend_on_size_and_place(scale: float, shift: float) -> None:
    made = HARD["faces that meet in an edge"]()
    moved = replace(made, vertices=made.vertices * scale + shift)
    errors_of = []
    for surface, view in ((made, camera(pixels=8)), (moved, camera(scale, 8, shift))):
        lit = scene.Scene((surface,), (SUN,), (view,))
        errors_of.append(plan.Planner(0.1, costs=plan.Costs()).plan(lit, view).predicted_error)
    assert errors_of[1] == pytest.approx(errors_of[0], rel=1e-6)


def triangles(made: scene.Surface) -> Tensor:
    return made.vertices[made.faces]


def inside(*turned: int) -> Tensor:
    """The triangles of a cube seen from inside; some the other way round."""
    corners = triangles(scene.box("walls", (1, 1, 1), inward=True, dtype=torch.float64))
    for face in turned:
        corners[face] = corners[face].flip(0)
    return corners


def apart() -> Tensor:
    crates = [scene.box("crate", (1, 1, 1), (x, 0, 0), dtype=torch.float64) for x in (0, 3)]
    return torch.cat([triangles(crate) for crate in crates])


#: name -> triangles, and the faces whose light all arrives at others
MESHES: dict[str, tuple[Tensor, list[int]]] = {
    "closed": (inside(), list(range(12))),
    "not watertight": (inside()[1:], []),
    "one face turned": (inside(0), []),
    "every face turned": (inside(*range(12)), []),
    "two pieces": (apart(), []),
    "a face twice": (torch.cat((inside(), inside()[:1])), []),
}


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("name", MESHES)
def test_meshes_that_are_no_solids_keep_their_light(name: str, dtype: torch.dtype) -> None:
    """No energy is made, gradients are finite; a turned face sees nothing of the inside."""
    corners, whole = MESHES[name]
    leaf = corners.to(dtype).requires_grad_()
    room = Patches(leaf)
    factors = transport.form_factors(room)
    rows, slack = factors.detach().sum(-1), 64 * torch.finfo(dtype).eps
    if name == "a face twice":  # both copies are lit as if the other were not there
        rows = rows[:12] - factors.detach()[:12, 12]
    assert float(rows.max()) <= 1 + slack
    torch.testing.assert_close(rows[whole], torch.ones_like(rows[whole]), rtol=0, atol=slack)
    if name == "one face turned":
        assert not factors[0].any()
        assert not factors[:, 0].any()
    if name == "every face turned":
        assert not factors.any()
    exchange = room.area.detach().unsqueeze(-1) * factors.detach()
    torch.testing.assert_close(exchange, exchange.mT, rtol=slack, atol=slack)
    if name == "a face twice":
        return  # what leaves the lit faces counts both copies: no energy balance
    held = solve.DenseOperator(factors, room.area)
    light = torch.ones(len(corners), 1, dtype=dtype)
    radiosity = solve.solve_radiosity(held, light / 2, light).radiosity
    least, most = (float(x) for x in radiosity.detach().aminmax())
    assert most <= 2 + slack  # exitance over 1 - albedo: that of a closed room
    assert least >= 1 - slack
    (gradient,) = torch.autograd.grad(radiosity.sum(), leaf)
    assert torch.isfinite(gradient).all()


def test_an_empty_scene_has_no_plan() -> None:
    with pytest.raises(errors.EmptySceneError):
        plan.Planner(0.1, costs=plan.Costs()).plan(scene.Scene((), (SUN,)), camera())
