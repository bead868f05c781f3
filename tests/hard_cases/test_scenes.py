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
from torchradiometry import errors, plan, render, scene, sources
from torchradiometry.geometry import OrthographicCamera

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


@pytest.mark.parametrize("name", ["one triangle", "a face of one point", "below the camera's view"])
@pytest.mark.parametrize("lit", [True, False])
def test_every_effect_has_an_answer_for_scenes_with_next_to_nothing(name: str, lit: bool) -> None:
    made = scene.Scene((HARD[name](),), (SUN,) if lit else (), (camera(pixels=8),))
    found = plan.Planner(0.1, costs=plan.Costs()).plan(made, made.cameras[0])
    assert {type(effect) for effect in plan.EFFECTS} == set(EFFECTS)
    assert 0 <= found.predicted_error < float("inf")
    assert found.predicted_seconds >= 0


def test_an_empty_scene_has_no_plan() -> None:
    with pytest.raises(errors.EmptySceneError):
        plan.Planner(0.1, costs=plan.Costs()).plan(scene.Scene((), (SUN,)), camera())
