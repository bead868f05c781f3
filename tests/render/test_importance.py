"""Importance: what a picture owes to each place, and patches that follow it."""

from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from tests.benchmarks.blind_scenes import alcove, three_rooms
from torchradiometry import Planner, RenderSettings, render_scene
from torchradiometry.geometry import PinholeCamera
from torchradiometry.render import Visits, backwards, prepare, relative_sizes
from torchradiometry.render.importance import BOUNCED, MOST, STEPS
from torchradiometry.render.points import see
from torchradiometry.render.world import World
from torchradiometry.scene import Scene, box, quad, sphere
from torchradiometry.scene.standard import ball, camera

SETTINGS = RenderSettings(bounces=8, supersampling=1)


def seen(scene: Scene, world: World, view: PinholeCamera | None = None) -> Visits:
    """What the middles of all pixels see."""
    view = view or scene.cameras[0]
    y, x = torch.meshgrid(torch.arange(view.height), torch.arange(view.width), indexing="ij")
    place = torch.stack((x, y), -1).reshape(-1, 2).double() + 0.5
    points = see(world, *view.rays(place))
    return Visits(points, torch.ones(len(place), dtype=torch.float64))


def by_surface(scene: Scene, value: torch.Tensor, world: World) -> dict[str, torch.Tensor]:
    """The values of the faces of each surface."""
    surface = world.triangles.surface[world.faces.triangle]
    return {s.name: value[surface == k] for k, s in enumerate(scene.surfaces)}


@pytest.mark.parametrize("albedo", [0.0, 0.3, 0.8, 1.0])
def test_in_a_closed_room_of_one_albedo_every_step_keeps_that_share(albedo: float) -> None:
    room = box("room", (3, 2, 2.5), (0, 0, 0), inward=True, albedo=albedo)
    scene = Scene((room,), (), camera(8, 6, (-0.7, 0.3, 0.2), (1, 0, 0.1), 60))
    world = prepare(scene, SETTINGS)
    total = backwards(world, seen(scene, world)).weight.sum()
    assert_close(float(total), 1 + BOUNCED * sum(albedo**k for k in range(1, STEPS + 1)))


def test_what_is_met_on_the_way_is_spread_as_form_factors_say() -> None:
    """Two parallel unit squares at the distance 1: F = 0.19982 (Howell's catalogue, C-11)."""
    low = quad("low", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], albedo=1.0)
    high = quad("high", [[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]], albedo=0.0)
    scene = Scene((low, high), ())
    world = prepare(scene, SETTINGS)
    side = (torch.arange(64, dtype=torch.float64) + 0.5) / 64
    above = torch.cartesian_prod(side, side, side[31:32])
    down = torch.tensor([0.0, 0, -1], dtype=torch.float64).expand_as(above)
    found = backwards(world, Visits(see(world, above, down), torch.ones_like(above[:, 0])))
    on_high = world.triangles.surface[found.points.triangle] == 1
    assert_close(float(found.weight[on_high].sum()) / BOUNCED, 0.19982, rtol=0.05, atol=0)


def test_a_room_that_the_camera_hardly_sees_has_larger_patches() -> None:
    scene = three_rooms(48, 36)
    world = prepare(scene, SETTINGS)
    sizes = by_surface(scene, relative_sizes(world, seen(scene, world)), world)
    assert float(sizes["blue room"].min()) > 1.5 * float(sizes["green room"].max())
    assert float(sizes["lamp"].min()) == pytest.approx(MOST, rel=0.1)


def test_faces_of_one_plane_have_one_size_and_of_a_smooth_body_too() -> None:
    scene = ball(16, 12)
    room = box("room", (3, 2, 2.5), (0, 0, 0), inward=True, albedo=0.5)
    for parts, made in ((1, scene), (6, Scene((room,), (), scene.cameras))):
        world = prepare(made, SETTINGS)
        assert int(world.parts.max()) + 1 == parts
        sizes = relative_sizes(world, seen(made, world))
        for part in range(parts):
            assert len(torch.unique(sizes[world.parts == part])) == 1
    sheet = quad("sheet", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], two_sided=True)
    assert int(prepare(Scene((sheet,), ()), SETTINGS).parts.max()) == 1


@pytest.mark.parametrize("albedo", [0.0, 0.5])
def test_where_nothing_counts_all_sizes_are_one(albedo: float) -> None:
    scene = Scene((sphere("ball", 1.0, albedo=albedo),), (), camera(8, 6, (0, 0, 5), (0, 0, 9), 40))
    world = prepare(scene, SETTINGS)
    assert_close(
        relative_sizes(world, seen(scene, world)), torch.ones(len(world.faces.corners)).double()
    )


def test_the_same_patches_give_a_better_picture_where_they_follow_importance() -> None:
    scene = alcove(48, 36)
    view = scene.cameras[0]

    def picture(size: float, importance: bool) -> tuple[torch.Tensor, int]:
        found = render_scene(scene, view, replace(SETTINGS, patch_size=size, importance=importance))
        return found.radiance, found.patches

    truth, _ = picture(0.2, False)
    (even, many), (important, few) = picture(0.6, False), picture(0.6, True)
    assert few < many
    errors = [float((p - truth).abs().sum() / truth.sum()) for p in (even, important)]
    assert errors[1] < errors[0]


@pytest.mark.parametrize("goal", [0.04, 0.02])
def test_patches_that_are_split_meet_their_error_where_two_patches_a_wall_show_nothing(
    goal: float,
) -> None:
    scene = alcove(32, 24)
    view = scene.cameras[0]
    truth = render_scene(scene, view, replace(SETTINGS, patch_size=0.2)).radiance
    split = replace(SETTINGS, patch_size=2.0, patch_error=goal)
    found = render_scene(scene, view, split).radiance
    assert float((found - truth).abs().sum() / truth.sum()) < goal


def test_plans_with_a_camera_follow_importance_and_those_without_do_not() -> None:
    scene = three_rooms(24, 18)
    plan = Planner(0.05).plan(scene, scene.cameras[0])
    assert plan.settings.importance
    assert not Planner(0.05).plan(scene).settings.importance
    even = replace(plan.settings, importance=False)
    counts = [render_scene(scene, scene.cameras[0], s).patches for s in (plan.settings, even)]
    assert counts[0] < counts[1]
