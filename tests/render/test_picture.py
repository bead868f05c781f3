"""Pictures: furnace, closed forms per pixel, energy balance, shadows without leaks or acne."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from tests.tolerances import assert_close
from torchradiometry import errors, geometry, render, scene, sources, transport
from torchradiometry.geometry.patches import Patches
from torchradiometry.render.direct import direct_irradiance
from torchradiometry.render.lattice import build_lattice, locate
from torchradiometry.render.picture import see
from torchradiometry.render.world import prepare

FAST = render.RenderSettings(bounces=4, patch_size=1.6, supersampling=1)
#: sources given as Python numbers are held in float32
SINGLE = 1e-6
UPRIGHT = ("left", "right", "top", "back", "front")


def cornell(width: int = 24, height: int = 18, lamp: bool = True) -> scene.Scene:
    return scene.cornell_like_room(width=width, height=height, lamp=lamp, dtype=torch.float64)


def camera_above(height: float = 2.0, size: int = 9) -> geometry.OrthographicCamera:
    place = geometry.look_at((0.0, height, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)).double()
    return geometry.OrthographicCamera(width=size, height=size, ymag=0.9, camera_to_world=place)


def floor(albedo: object = 0.5, **options: object) -> scene.Surface:
    corners = [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]]
    return scene.quad("floor", corners, albedo=albedo, dtype=torch.float64, **options)


def test_furnace_room_is_uniform() -> None:
    """Every face of a closed room has albedo 0.4 and emits 0.6/pi: L = 1/pi everywhere."""
    made = cornell(lamp=False)
    glow = torch.full((3,), 0.6 / math.pi, dtype=torch.float64)
    same = tuple(
        replace(s, albedo=torch.full((3,), 0.4).double(), emission=glow) for s in made.surfaces
    )
    picture = render.render_scene(
        scene.Scene(same),
        made.cameras[0],
        replace(FAST, bounces=40, patch_size=1.2, shadow_samples=8),
    )
    # direct light of every quad by 8 to 32 shadow rays, corrected by nothing: 2 % each pixel
    assert_close(picture.radiance, 1 / math.pi, rtol=0.06)
    assert_close(picture.radiance.mean(), 1 / math.pi, rtol=0.01)
    assert picture.emitter.all()
    assert picture.closed


def test_point_light_over_a_floor_is_the_inverse_square_law() -> None:
    lamp = sources.PointSource([[0.0, 1.0, 0.0]], [[3.0, 2.0, 1.0]]).double()
    view = camera_above()
    picture = render.render_scene(scene.Scene((floor(),), (lamp,)), view, FAST)
    pixels = view.pixel_grid().reshape(-1, 2)
    origin, _ = view.rays(pixels)
    squared = origin[:, 0] ** 2 + origin[:, 2] ** 2 + 1
    expected = 0.5 / math.pi * squared**-1.5
    assert_close(picture.radiance.reshape(-1, 3)[:, 0], 3 * expected, rtol=1e-9)
    assert picture.indirect_bound < 1e-12


@pytest.mark.parametrize("rays", [transport.EmbreeRays, transport.BruteForceRays])
def test_panel_over_a_floor_is_exact_and_has_no_noise(rays) -> None:
    panel = scene.quad(
        "panel", [[-0.5, 1, -0.5], [0.5, 1, -0.5], [0.5, 1, 0.5], [-0.5, 1, 0.5]],
        emission=2.0, albedo=0.0, dtype=torch.float64,
    )  # fmt: skip
    made = scene.Scene((floor(), panel))
    world = prepare(made, replace(FAST, rays=rays))
    position = torch.tensor([[0.3, 0, 0.1], [1.5, 0, -1.0]], dtype=torch.float64)
    up = torch.tensor([[0.0, 1, 0]], dtype=torch.float64).expand(2, 3)
    found = direct_irradiance(world, FAST, render.Receivers(position, up, up), torch.Generator())
    exact = 2 * geometry.polygon_irradiance(position, up, panel.vertices)
    assert_close(found[:, 0], exact)
    assert rays.__name__ in world.reason


def test_a_lamp_drawn_onto_the_ceiling_covers_it() -> None:
    ceiling = scene.quad(
        "ceiling", [[-2, 1, -2], [2, 1, -2], [2, 1, 2], [-2, 1, 2]], dtype=torch.float64
    )
    panel = scene.quad(
        "panel", [[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]], emission=1.0,
        dtype=torch.float64,
    )  # fmt: skip
    place = geometry.look_at((0.0, 0.1, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)).double()
    view = geometry.PinholeCamera(width=8, height=8, yfov=1.0, camera_to_world=place)
    picture = render.render_scene(scene.Scene((ceiling, panel, floor())), view, FAST)
    assert picture.emitter.all()
    assert (picture.radiance >= 1).all()


def test_backs_are_black_and_background_is_zero() -> None:
    lamp = sources.PointSource([[0.0, 1.0, 0.0]], [[3.0]]).double()
    below = camera_above(-2.0)
    place = geometry.look_at((0.0, -2.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)).double()
    below = replace(below, camera_to_world=place)
    assert (render.render_scene(scene.Scene((floor(),), (lamp,)), below, FAST).radiance == 0).all()
    wide = replace(camera_above(), ymag=10.0)
    assert (
        render.render_scene(scene.Scene((floor(),), (lamp,)), wide, FAST).radiance[0] == 0
    ).all()
    lit_below = sources.PointSource([[0.0, -1.0, 0.0]], [[3.0]]).double()
    sheet = scene.Scene((floor(two_sided=True),), (lit_below,))
    centre = render.render_scene(sheet, below, FAST).radiance[4, 4, 0]
    assert_close(centre, 0.5 * 3 / math.pi, rtol=1e-9)


def test_textures_stay_sharp() -> None:
    image = torch.tensor([[[0.0], [1.0]]], dtype=torch.float64).expand(1, 2, 3)
    uv = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]], dtype=torch.float64)
    painted = replace(floor(1.0), texture=scene.Texture(image, uv, ("clamp", "clamp")))
    sun = sources.DirectionalSource([[0.0, 1.0, 0.0]], [[math.pi]]).double()
    picture = render.render_scene(
        scene.Scene((painted,), (sun,)), replace(camera_above(), ymag=1.9), FAST
    )
    assert_close(picture.radiance[:, 0, 0], 0.0, atol=1e-9)
    assert_close(picture.radiance[:, -1, 0], 1.0, rtol=SINGLE)


def test_shadow_of_a_box_has_no_leak_and_no_acne() -> None:
    """Under a distant light from above the floor around a box is lit, its top too, nothing else."""
    sun = sources.DirectionalSource([[0.6, 0.8, 0.0]], [[1.0]]).double()
    crate = scene.box("crate", (0.5, 0.5, 0.5), (0, 0.25, 0), sides=UPRIGHT, dtype=torch.float64)
    world = prepare(scene.Scene((floor(), crate), (sun,)), FAST)
    x, z = torch.meshgrid(*(torch.linspace(-0.99, 0.99, 60).double(),) * 2, indexing="ij")
    position = torch.stack((x, torch.zeros_like(x), z), -1).reshape(-1, 3)
    up = torch.tensor([[0.0, 1, 0]]).double().expand_as(position)
    found = direct_irradiance(world, FAST, render.Receivers(position, up, up), torch.Generator())[
        :, 0
    ]
    # the box covers |x| < 0.25 and throws a shadow of 0.5 x 0.6/0.8 m to -x, |z| < 0.25
    dark = (position[:, 2].abs() < 0.25) & (position[:, 0] < 0.25) & (position[:, 0] > -0.625)
    assert (found[dark] == 0).all()
    assert_close(found[~dark], 0.8, rtol=SINGLE)


def energy(made: scene.Scene, settings: render.RenderSettings) -> tuple[Tensor, Tensor]:
    """Flux that is emitted, and flux that surfaces absorb, W per channel, of a closed scene."""
    world = prepare(made, settings)
    light = render.indirect_light(world, settings)
    assert light.exchange.exposure.closed
    patches, exposure = light.exchange.patches, light.exchange.exposure
    area = (patches.area * exposure.share).unsqueeze(-1)
    points = exposure.point.reshape(-1, 3)
    normal = patches.normal.repeat_interleave(exposure.point.shape[1], 0)
    direct = direct_irradiance(
        world, settings, render.Receivers(points, normal, normal), torch.Generator()
    )
    direct = direct.reshape(*exposure.point.shape[:2], -1)
    free = exposure.free.unsqueeze(-1)
    direct = (direct * free).sum(1) / free.sum(1).clamp(min=1)
    absorbed = (area * (1 - light.albedo) * (direct + light.irradiance)).sum(0)
    emitted = (area * light.exitance).sum(0)
    for source in made.sources:
        emitted = emitted + 4 * math.pi * source.intensity.sum(0)
    return emitted, absorbed


def test_energy_balance_of_a_room() -> None:
    """Panel and point light shine into a closed room with two boxes: all of it is absorbed.

    Direct light is that of the picture (exact polygons, shadow rays), not that of the form
    factors; it is averaged over 16 points of each patch, which is where the 1 % comes from.
    """
    emitted, absorbed = energy(cornell(), replace(FAST, bounces=30, patch_size=0.8))
    assert_close(absorbed, emitted, rtol=0.01)


def test_patches_converge() -> None:
    made = cornell()
    pictures = [
        render.render_scene(made, made.cameras[0], replace(FAST, patch_size=size, bounces=12))
        for size in (2.4, 1.2, 0.6)
    ]
    fine = pictures[-1].radiance
    errors_ = [(p.radiance - fine).abs().sum() / fine.sum() for p in pictures[:-1]]
    assert errors_[1] < errors_[0] < 0.05
    assert errors_[1] < 0.015


def test_more_bounces_never_darken_and_bound_the_rest() -> None:
    made = cornell()
    few, many = (
        render.render_scene(made, made.cameras[0], replace(FAST, bounces=b, ambient_tail=False))
        for b in (2, 30)
    )
    assert (many.radiance >= few.radiance - 1e-12).all()
    missing = (many.radiance - few.radiance).max() * math.pi / 0.63
    # interpolation between patches overshoots by at most its corrections
    assert missing <= few.indirect_bound * 1.1


def test_colour_bleeds_from_the_red_wall() -> None:
    made = cornell(lamp=False)
    world = prepare(made, FAST)
    light = render.indirect_light(world, replace(FAST, patch_size=0.8))
    ceiling = light.exchange.patches.normal[:, 1] < -0.9
    left = ceiling & (light.exchange.patches.centroid[:, 0] < -1.5)
    right = ceiling & (light.exchange.patches.centroid[:, 0] > 1.5)
    near_red, near_green = light.irradiance[left].mean(0), light.irradiance[right].mean(0)
    assert near_red[0] / near_red[1] > 1.3 * near_green[0] / near_green[1]


def test_the_same_seed_gives_the_same_picture() -> None:
    made = cornell(8, 6)
    first, second = (render.render_scene(made, made.cameras[0], FAST).radiance for _ in range(2))
    assert (first == second).all()


def test_gradients_reach_albedo_emission_and_lamps() -> None:
    made = cornell(6, 4)
    albedo = made.surfaces[0].albedo.clone().requires_grad_()
    emission = made.surfaces[5].emission.clone().requires_grad_()
    lamp = sources.PointSource([[0.8, 1.6, 0.2]], [[2.0, 2.0, 2.0]], learnable=True).double()

    def mean(rho: Tensor, glow: Tensor) -> Tensor:
        surfaces = (replace(made.surfaces[0], albedo=rho), *made.surfaces[1:5],
                    replace(made.surfaces[5], emission=glow), *made.surfaces[6:])  # fmt: skip
        return render.render_scene(
            scene.Scene(surfaces, (lamp,)), made.cameras[0], FAST
        ).radiance.mean()

    mean(albedo, emission).backward()
    step = 1e-6
    with torch.no_grad():
        for tensor in (albedo, emission):
            shift = torch.zeros_like(tensor)
            shift[0] = step
            ends = [
                mean(albedo + k * shift if tensor is albedo else albedo,
                     emission + k * shift if tensor is emission else emission)
                for k in (1, -1)
            ]  # fmt: skip
            assert_close(tensor.grad[0], (ends[0] - ends[1]) / (2 * step), rtol=1e-5)
    assert (lamp.intensity.grad > 0).all()


def test_dome_is_seen_through_the_open_side_only() -> None:
    sky = sources.AmbientDome([[1.0]]).double()
    world = prepare(scene.Scene((floor(),), (sky,)), replace(FAST, sky_samples=64))
    position = torch.zeros(1, 3, dtype=torch.float64)
    up = torch.tensor([[0.0, 1, 0]], dtype=torch.float64)
    free = direct_irradiance(world, FAST, render.Receivers(position, up, up), torch.Generator())
    assert_close(free, math.pi)
    closed = prepare(replace(cornell(), sources=(sky,)), FAST)
    inside = render.lamp_irradiance(
        closed, FAST, render.Receivers(position + up, up, up), torch.Generator().manual_seed(0)
    )
    assert (inside == 0).all()


def test_smooth_balls_have_no_seams() -> None:
    ball = scene.sphere("ball", 0.5, (0, 0.6, 0), subdivisions=2, dtype=torch.float64)
    sun = sources.DirectionalSource([[0.0, 1.0, 0.2]], [[1.0]]).double()
    made = scene.Scene((floor(), ball), (sun,))
    world = prepare(made, FAST)
    light = render.indirect_light(world, FAST)
    faces = world.triangles.surface[world.faces.triangle[light.exchange.subdivision.face]] == 1
    assert len(light.exchange.welding.corner[faces].unique()) == 162
    view = replace(camera_above(), ymag=0.4)
    points = see(world, *view.rays(view.pixel_grid().reshape(-1, 2)))
    assert (points.normal[:, 1] > 0).all()
    assert_close(points.normal.norm(dim=-1), 1.0)


def test_bad_requests_are_named() -> None:
    made = cornell(4, 3)
    with pytest.raises(errors.EmptySceneError):
        render.render_scene(scene.Scene(), made.cameras[0], FAST)
    with pytest.raises(errors.OutOfRangeError, match="patch_size"):
        render.RenderSettings(patch_size=-1.0)
    with pytest.raises(errors.OutOfRangeError, match="supersampling"):
        render.RenderSettings(supersampling=0)
    with pytest.raises(errors.DTypeError, match="bounces"):
        render.RenderSettings(bounces=1.5)  # type: ignore[arg-type]
    with pytest.raises(errors.ResourceLimitError, match="bytes"):
        render.render_scene(made, made.cameras[0], replace(FAST, budget=10_000))
    wide = replace(made.cameras[0], width=10**6, height=10**6)
    with pytest.raises(errors.ResourceLimitError, match="1000000000000 pixels"):
        render.render_scene(made, wide, FAST)


@pytest.mark.parametrize(
    ("name", "value"),
    [("seed", 1.5), ("extent", "no"), ("importance", None), ("patch_size", True), ("rays", 3)],
)
def test_settings_of_the_wrong_kind_are_named(name: str, value: object) -> None:
    with pytest.raises((errors.DTypeError, errors.OutOfRangeError), match=f"settings.{name}"):
        replace(FAST, **{name: value})


def test_what_is_no_scene_or_no_camera_is_named() -> None:
    made = cornell(4, 3)
    for wrong in (None, made, made.cameras):
        with pytest.raises(errors.DTypeError, match=r"camera: got .*scene.cameras\[0\]"):
            render.render_scene(made, wrong, FAST)
    with pytest.raises(errors.DTypeError, match="scene: got a dict; pass a Scene"):
        render.render_scene({}, made.cameras[0], FAST)


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("name", ["albedo", "emission", "specular"])
def test_colours_that_are_no_numbers_make_no_silent_nan(name: str, value: float) -> None:
    made = cornell(4, 3)
    wall = replace(made.surfaces[0], **{name: torch.full((3,), value)})
    with pytest.raises(errors.InvalidValueError, match=name):
        render.render_scene(
            replace(made, surfaces=(wall, *made.surfaces[1:])), made.cameras[0], FAST
        )


def test_lattice_finds_the_patch_that_holds_a_point(generator: torch.Generator) -> None:
    corners = torch.rand(5, 3, 3, dtype=torch.float64, generator=generator)
    lattice = build_lattice(corners, torch.tensor([1, 2, 3, 7, 7]))
    assert_close(Patches(lattice.corners).area.sum(), Patches(corners).area.sum())
    triangle = torch.randint(5, (500,), generator=generator)
    weight = torch.rand(500, 3, dtype=torch.float64, generator=generator)
    weight = weight / weight.sum(-1, keepdim=True)
    patch, inner = locate(lattice, triangle, weight)
    assert (lattice.triangle[patch] == triangle).all()
    assert (inner > -1e-12).all()
    found = (lattice.corners[patch] * inner.unsqueeze(-1)).sum(1)
    assert_close(found, (corners[triangle] * weight.unsqueeze(-1)).sum(1))
    assert_close(lattice.position[lattice.vertex], lattice.corners)
