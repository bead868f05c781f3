"""Effects that are left out: what stands in their place is what it says."""

from dataclasses import replace

import pytest
import torch

from tests.tolerances import assert_close
from torchradiometry import errors, render, scene, sources
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.render.ambient import balanced_irradiance, on_surfaces
from torchradiometry.render.direct import small_source_irradiance
from torchradiometry.render.world import prepare
from torchradiometry.scene import STANDARD_SCENES

PLAIN = render.RenderSettings(bounces=0, supersampling=1)


def shown(made: scene.Scene, **options: object) -> torch.Tensor:
    settings = replace(PLAIN, **options)
    return render.render_scene(made, made.cameras[0], settings).radiance


def test_a_small_source_is_what_a_polygon_tends_to() -> None:
    square = torch.tensor([[1.0, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]]).double()
    triangle = torch.cat((square[:3], square[2:3]))
    up = torch.tensor([0.0, 0.6, 0.8]).double()
    for polygon in (square, triangle):
        off = []
        for distance in (10.0, 100.0):
            x = torch.tensor([0.2, 0.1, -1.0]).double() * distance
            exact = polygon_irradiance(x, up, polygon)
            found = small_source_irradiance(x, up, polygon)
            off.append(abs(float(found / exact) - 1))
        assert off[0] < 0.02
        assert off[1] < off[0] / 50  # falls as 1 / r^2
    behind = torch.tensor([0.0, 0, 3.0]).double()
    assert small_source_irradiance(behind, -up, square) == 0


def test_lamps_taken_as_distant_shine_evenly() -> None:
    made = STANDARD_SCENES["lamp and ball"](24, 18)
    table = replace(made, surfaces=made.surfaces[:1])
    near, distant = (shown(table, near=n, shadow_samples=0) for n in (True, False))
    lit = distant.sum(-1) > 0
    assert_close(distant[lit], distant[lit][:1].expand_as(distant[lit]))
    assert near[lit].std() > 0.1 * near[lit].mean()
    far = sources.PointSource([[3e3, 6e3, 2e3]], [[1e8] * 3])
    gone = replace(table, sources=(far,))
    assert_close(shown(gone, near=False), shown(gone), rtol=2e-3, atol=1e-6)


def test_without_penumbra_a_source_is_seen_wholly_or_not_at_all() -> None:
    made = STANDARD_SCENES["cornell"](32, 24)
    full, hard = shown(made), shown(made, penumbra=False)
    bare = shown(made, shadow_samples=0)
    lit = bare.sum(-1) > 1e-3
    share = (hard.sum(-1) / bare.sum(-1))[lit]
    assert ((share < 1e-6) | ((share - 1).abs() < 1e-6)).all()
    soft = (full.sum(-1) / bare.sum(-1))[lit]
    assert ((soft > 0.05) & (soft < 0.95)).any()


def test_grey_reflections_have_the_colour_of_the_source() -> None:
    made = STANDARD_SCENES["cornell"](24, 18)
    options = {"bounces": 6, "patch_size": 2.0}

    def reflected(which: scene.Scene, **more: object) -> torch.Tensor:
        settings = replace(PLAIN, **options, **more)
        picture = render.render_scene(which, which.cameras[0], settings)
        assert picture.indirect is not None
        return picture.indirect.irradiance

    grey = reflected(made, colour_bleeding=False)
    assert_close(grey, grey[:, :1].expand_as(grey))
    coloured = reflected(made)
    assert (coloured[:, 0] - coloured[:, 1]).abs().max() > 0.1 * coloured.mean()
    plain = STANDARD_SCENES["white room"](24, 18)
    assert_close(reflected(plain, colour_bleeding=False), reflected(plain), rtol=1e-9, atol=1e-12)


def test_ambient_light_balances_what_surfaces_send_and_keep() -> None:
    albedo = torch.full((5, 3), 0.6, dtype=torch.float64, requires_grad=True)
    direct = torch.rand(5, 3, dtype=torch.float64)
    view, weight = torch.ones(5).double(), torch.tensor([1.0, 1, 1, 1, 0]).double()
    found = balanced_irradiance(albedo, direct, view, weight)
    assert_close(found, 0.6 * direct[:4].mean(0) / 0.4)
    (slope,) = torch.autograd.grad(found.sum(), albedo)
    assert_close(slope.sum(), (direct[:4].mean(0) / 0.4**2).sum())
    with pytest.raises(errors.SingularSystemError, match="ambient"):
        balanced_irradiance(torch.ones(5, 3).double(), direct, view, weight)


def test_ambient_light_in_rooms_is_near_the_mean_of_what_is_solved() -> None:
    for name, tolerance in (("white room", 0.03), ("cornell", 0.08)):
        made = STANDARD_SCENES[name](24, 18)
        ambient = shown(made, ambient=True) - shown(made)
        solved = shown(made, bounces=48) - shown(made)
        assert abs(float(ambient.mean() / solved.mean()) - 1) < tolerance
    ball = STANDARD_SCENES["ball"](24, 18)
    assert_close(shown(ball, ambient=True), shown(ball))


def test_points_on_surfaces_know_what_they_see() -> None:
    room = prepare(STANDARD_SCENES["white room"](8, 6), PLAIN)
    sample = on_surfaces(room, 256)
    assert sample.mutual_view > 0.999
    assert 0 < int((sample.weight == 0).sum()) < 16  # the floor under the box
    assert on_surfaces(prepare(STANDARD_SCENES["ball"](8, 6), PLAIN), 64).mutual_view == 0
