"""Views, coverage of pixels, patches of different sizes, gathered light."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from tests.render.test_picture import FAST, camera_above, cornell, floor
from tests.tolerances import assert_close
from torchradiometry import errors, geometry, render, scene, solve, sources
from torchradiometry.geometry.patches import Patches
from torchradiometry.render import indirect
from torchradiometry.render.direct import unblocked_irradiance
from torchradiometry.render.exposure import exposure_of
from torchradiometry.render.gather import gather_weights
from torchradiometry.render.indirect import first_patches
from torchradiometry.render.lattice import build_lattice, spread, vertex_values, weld_patches
from torchradiometry.render.subdivision import find, refine, unrefined


def repainted(made: scene.Scene, share: float) -> scene.Scene:
    surfaces = tuple(
        replace(s, albedo=s.albedo * share, emission=s.emission / share) for s in made.surfaces
    )
    return replace(made, surfaces=surfaces)


def test_a_view_develops_other_colours_as_a_new_picture_would() -> None:
    made = cornell(12, 9)
    other = repainted(made, 0.8)
    view = render.view_scene(made, made.cameras[0], FAST)
    found = render.develop(view, other)
    expected = render.render_scene(other, made.cameras[0], FAST)
    assert_close(found.radiance, expected.radiance)
    assert found.indirect is not None
    assert (found.indirect.radiosity >= found.indirect.exitance).all()


def test_gradients_of_a_developed_view_can_be_taken_again_and_again() -> None:
    made = cornell(6, 4, lamp=False)
    view = render.view_scene(made, made.cameras[0], FAST)
    wall = made.surfaces[0]

    def mean(albedo: Tensor) -> Tensor:
        painted = replace(made, surfaces=(replace(wall, albedo=albedo), *made.surfaces[1:]))
        return render.develop(view, painted).radiance.mean()

    albedo = wall.albedo.clone().requires_grad_()
    first, second = (torch.autograd.grad(mean(albedo), albedo)[0] for _ in range(2))
    assert (first == second).all()
    assert torch.autograd.gradcheck(mean, (albedo,), rtol=1e-6, atol=1e-9)


def test_a_view_refuses_another_scene() -> None:
    made = cornell(4, 3)
    view = render.view_scene(made, made.cameras[0], replace(FAST, bounces=0))
    with pytest.raises(errors.ShapeError, match="triangles"):
        render.develop(view, scene.Scene((floor(),)))


def test_pixels_at_an_edge_show_what_each_side_covers() -> None:
    """A white floor half covered by a black, higher one, with its edge at x = 0.03."""
    sky = sources.DirectionalSource([[0.0, 1.0, 0.0]], [[math.pi]]).double()
    black = scene.quad(
        "black", [[0.03, 1e-3, 2], [2, 1e-3, 2], [2, 1e-3, -2], [0.03, 1e-3, -2]], albedo=0.0,
        dtype=torch.float64,
    )  # fmt: skip
    made = scene.Scene((floor(1.0), black), (sky,))
    picture = render.render_scene(
        made, camera_above(), replace(FAST, supersampling=4, bounces=0)
    ).radiance[..., 0]
    # pixels are 0.2 m wide: the middle one is white up to 0.13 / 0.2
    assert_close(picture[:, :4], 1.0, rtol=1e-6)
    assert (picture[:, 5:] == 0).all()
    assert_close(picture[:, 4], 0.65, atol=1 / 8)
    assert_close(picture[:, 4].mean(), 0.65, atol=0.03)


@pytest.mark.parametrize("samples", [1, 8])
def test_penumbras_behind_few_blockers_have_no_noise(samples: int) -> None:
    made = cornell(lamp=False)
    world = render.prepare(made, FAST)
    x = torch.linspace(-1.5, 1.5, 40, dtype=torch.float64)
    position = torch.stack((x, torch.zeros_like(x), torch.full_like(x, -1.9)), -1)
    up = torch.tensor([0.0, 1, 0], dtype=torch.float64).expand_as(position)
    points = render.Receivers(position, up, up)
    settings = replace(FAST, shadow_samples=samples)
    assert world.blockers is not None
    exact = render.emitter_weights(world, settings, points, torch.Generator())
    sampled = render.emitter_weights(
        world._replace(blockers=None), replace(FAST, shadow_samples=256), points, torch.Generator()
    )
    # 1024 rays in penumbras: standard error of a share at most 1.6 %
    assert_close(exact, sampled, atol=0.05 * float(exact.max()))
    assert (exact < sampled.max()).any()


@pytest.mark.parametrize("extent", [True, False])
def test_light_that_is_known_to_arrive_unblocked_is_not_found_again(extent: bool) -> None:
    made = cornell(lamp=False)
    world = render.prepare(made, FAST)._replace(blockers=None)
    x = torch.linspace(-1.5, 1.5, 40, dtype=torch.float64)
    position = torch.stack((x, torch.zeros_like(x), torch.full_like(x, -1.9)), -1)
    up = torch.tensor([0.0, 1, 0], dtype=torch.float64).expand_as(position)
    points, settings = render.Receivers(position, up, up), replace(FAST, extent=extent)
    polygons = world.emitters.corners
    free = unblocked_irradiance(position.unsqueeze(1), up.unsqueeze(1), polygons, extent)
    both = [
        render.emitter_weights(world, settings, points, torch.Generator().manual_seed(0), known)
        for known in (None, free, 2 * free)
    ]
    assert_close(both[1], both[0], rtol=0, atol=0)
    assert_close(both[2], 2 * both[0])


def test_refined_patches_cover_the_same_and_are_found(generator: torch.Generator) -> None:
    corners = torch.rand(3, 3, 3, dtype=torch.float64, generator=generator)
    patches = unrefined(build_lattice(corners, torch.tensor([1, 2, 3])))
    for _ in range(3):
        chosen = torch.rand(len(patches.corners), generator=generator) < 0.4
        patches = refine(patches, chosen)
    assert_close(Patches(patches.corners).area.sum(), Patches(corners).area.sum())
    face = torch.randint(3, (400,), generator=generator)
    weight = torch.rand(400, 3, dtype=torch.float64, generator=generator)
    weight = weight / weight.sum(-1, keepdim=True)
    patch, inner = find(patches, face, weight)
    assert (patches.face[patch] == face).all()
    assert (inner > -1e-12).all()
    found = (patches.corners[patch] * inner.unsqueeze(-1)).sum(1)
    assert_close(found, (corners[face] * weight.unsqueeze(-1)).sum(1))


def test_a_hanging_vertex_takes_the_mean_of_its_edge() -> None:
    corners = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 1, 0], [0, 1, 0], [1, 0, 0]]])
    patches = refine(
        unrefined(build_lattice(corners.double(), torch.tensor([1, 1]))),
        torch.tensor([True, False]),
    )
    kind = torch.zeros(5, dtype=torch.int64)
    welding = weld_patches(patches.corners, kind, 1.0, patches.levels)
    assert welding.vertices == 7
    assert len(welding.hanging) == 1
    value = patches.corners.mean(1)[:, :1]
    values = vertex_values(value, Patches(patches.corners).area, welding)
    assert_close(values[welding.hanging], values[welding.ends].mean(1))
    constant = spread(torch.ones_like(value), Patches(patches.corners).area, welding)
    assert_close(constant, 1.0)


def hall() -> scene.Scene:
    """A large floor and a small crate under a low sun: light bends near the crate only."""
    ground = scene.quad(
        "ground", [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]], dtype=torch.float64
    )
    sides = ("left", "right", "top", "back", "front")
    crate = scene.box("crate", (0.8, 0.8, 0.8), (0, 0.4, 0), sides=sides, dtype=torch.float64)
    sun = sources.DirectionalSource([[0.8, 0.6, 0.0]], [[3.0]]).double()
    return scene.Scene((ground, crate), (sun,))


def test_adaptive_patches_beat_a_uniform_grid() -> None:
    made = hall()
    place = geometry.look_at((3.0, 2.0, 2.0), (0.6, 0.0, 0.0)).double()
    view = geometry.PinholeCamera(width=24, height=24, yfov=0.9, camera_to_world=place)
    base = replace(FAST, bounces=2, pair_samples=4)

    def picture(**options: float) -> render.Picture:
        return render.render_scene(made, view, replace(base, **options))

    truth = picture(patch_size=0.4)
    uniform = picture(patch_size=1.0)
    adaptive = picture(patch_size=2.0, patch_error=0.01)

    def error(found: render.Picture) -> float:
        return float((found.radiance - truth.radiance).abs().sum() / truth.radiance.sum())

    assert adaptive.patches < uniform.patches
    assert error(adaptive) < error(uniform)


def test_gathered_light_of_a_closed_room_is_the_even_light_of_its_patches() -> None:
    world = render.prepare(cornell(lamp=False), FAST)
    light = render.indirect_light(world, FAST)
    exchange = light.exchange
    point = exchange.exposure.point[:, 0][exchange.exposure.free[:, 0]]
    normal = exchange.patches.normal[exchange.exposure.free[:, 0]]
    points = render.Receivers(point, normal, normal)
    weights = gather_weights(world, exchange.patches, exchange.exposure, points)
    assert_close(weights.sum(-1), 1.0)
    # interpolated and gathered light differ by the size of the patches
    gathered, found = weights @ light.solution.radiosity, light.irradiance
    found = found[exchange.exposure.free[:, 0]]
    assert (gathered - found).abs().sum() / found.sum() < 0.06


def test_budget_stops_the_subdivision() -> None:
    made = cornell(4, 3)
    world = render.prepare(made, FAST)
    first = len(first_patches(world, FAST).corners)
    settings = replace(FAST, patch_error=1e-4, budget=48 * (first + 60) ** 2)
    found = render.render_scene(made, made.cameras[0], settings)
    assert first < found.patches <= first + 60
    with pytest.raises(errors.OutOfRangeError, match="patch_error"):
        render.RenderSettings(patch_error=2.0)


COARSE = replace(FAST, patch_size=3.0)


def clustered(monkeypatch: pytest.MonkeyPatch, made: scene.Scene) -> render.View:
    monkeypatch.setattr(indirect, "MOST_DENSE", 0)
    return render.view_scene(made, made.cameras[0], COARSE)


def test_pictures_through_clusters_are_those_through_a_matrix(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = cornell(8, 6)
    dense = render.view_scene(made, made.cameras[0], COARSE)
    view = clustered(monkeypatch, made)
    assert dense.exchange is not None
    assert view.exchange is not None
    assert isinstance(dense.exchange.operator, solve.DenseOperator)
    assert isinstance(view.exchange.operator, solve.HierarchicalOperator)
    assert dense.exchange.reason.startswith("a matrix")
    assert view.exchange.reason.startswith("a tree of clusters")
    found, expected = render.develop(view, made).radiance, render.develop(dense, made).radiance
    difference = float((found - expected).abs().sum() / expected.sum())
    # each keeps the radiosity to this share of it
    assert 0 < difference < indirect.CLUSTER_ERROR + indirect.PAIR_ERROR
    rows, same = view.exchange.operator.row_sums(), dense.exchange.operator.row_sums()
    assert rows.max() < 1 + 1e-12
    assert (rows - same).abs().mean() < indirect.CLUSTER_ERROR


def test_gradients_reach_colours_through_clusters(monkeypatch: pytest.MonkeyPatch) -> None:
    made = cornell(4, 3)
    view = clustered(monkeypatch, made)

    def mean(share: Tensor) -> Tensor:
        painted = tuple(replace(s, albedo=s.albedo * share) for s in made.surfaces)
        return render.develop(view, replace(made, surfaces=painted)).radiance.mean()

    share = torch.tensor(0.8, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(mean, (share,))


def test_gradients_of_corners_ask_for_a_matrix(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(indirect, "MOST_DENSE", 0)
    world = render.prepare(cornell(4, 3), FAST)
    corners = first_patches(world, COARSE).corners.detach().requires_grad_()
    patches = Patches(corners)
    exposure = exposure_of(world, patches, 0)
    operator, reason = indirect.operator_between(world, patches, exposure, FAST)
    assert isinstance(operator, solve.DenseOperator)
    assert "gradients" in reason
    operator.row_sums().square().sum().backward()
    assert corners.grad is not None
    assert corners.grad.abs().sum() > 0


def test_gathered_pictures_are_near_interpolated_ones() -> None:
    made = cornell(8, 6, lamp=False)
    gathering = replace(FAST, gather=True)
    gathered = render.render_scene(made, made.cameras[0], gathering).radiance
    found = render.render_scene(made, made.cameras[0], FAST).radiance
    assert 0 < (gathered - found).abs().sum() / found.sum() < 0.03
    view, small = replace(made.cameras[0], width=200, height=160), 48 * 350**2
    with pytest.raises(errors.ResourceLimitError, match="gather"):
        render.view_scene(made, view, replace(gathering, budget=small))


def test_a_clipped_shadow_moves_with_the_blocker() -> None:
    """Direct light of a panel behind a card that the camera, below it, does not see."""
    panel = scene.quad(
        "panel",
        [[-0.5, -0.4, 2.0], [-0.5, 0.6, 2.0], [0.5, 0.6, 2.0], [0.5, -0.4, 2.0]],
        emission=5.0,
        dtype=torch.float64,
    )
    card = scene.quad(
        "card",
        [[-0.3, -0.2, 1.5], [0.2, -0.3, 1.5], [0.3, 0.3, 1.6], [-0.2, 0.4, 1.6]],
        dtype=torch.float64,
    )
    camera = camera_above(1.2)
    settings = replace(FAST, bounces=0, supersampling=1)

    def mean(shift: Tensor) -> Tensor:
        moved = replace(card, vertices=card.vertices + shift)
        made = scene.Scene((floor(), panel, moved))
        return render.render_scene(made, camera, settings).radiance[::3, ::3].mean()

    shift = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    (found,) = torch.autograd.grad(mean(shift), shift)
    step = 1e-5 * torch.eye(3, dtype=torch.float64)
    expected = torch.stack([(mean(s) - mean(-s)) / 2e-5 for s in step]).detach()
    assert expected.abs().max() > 1e-3
    assert_close(found, expected, rtol=1e-5, atol=1e-7)
