"""Shiny surfaces: their lobes against closed forms."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from tests.tolerances import assert_close
from torchradiometry import errors, render, scene
from torchradiometry.geometry.cameras import PinholeCamera, look_at
from torchradiometry.materials import (
    NormalizedPhong,
    directional_hemispherical_reflectance,
    mean_lobe_reflectance,
    normalized_phong_brdf,
)
from torchradiometry.plan import PlannedShader
from torchradiometry.render.points import see
from torchradiometry.scene import STANDARD_SCENES, box, quad
from torchradiometry.sources import AmbientDome, DirectionalSource, PointSource

FLOOR = quad("floor", [[-9, 0, 9], [9, 0, 9], [9, 0, -9], [-9, 0, -9]], albedo=0.0).to(
    torch.float64
)
PLAIN = render.RenderSettings(bounces=0, supersampling=1)


def above(width: int = 16, height: int = 12) -> PinholeCamera:
    view = look_at(torch.tensor([0.0, 2.0, 3.0]).double(), (0.0, 0.0, 0.0))
    return PinholeCamera(yfov=math.radians(40), camera_to_world=view, width=width, height=height)


def shown(surfaces: object, sources: object = (), **options: object) -> Tensor:
    made = scene.Scene(tuple(surfaces), tuple(sources), (above(),))  # type: ignore[arg-type]
    settings = replace(PLAIN, **options)
    return render.render_scene(made, made.cameras[0], settings).radiance


def seen_floor() -> tuple[Tensor, Tensor]:
    """Where the camera's pixels meet the floor, and the directions back to it."""
    world = render.prepare(scene.Scene((FLOOR,)), PLAIN)
    camera = above()
    points = see(world, *camera.rays(camera.pixel_grid().double().reshape(-1, 2)))
    return points.position, points.outgoing


def reflectance(cosine: Tensor, shininess: float) -> Tensor:
    """Share that the lobe of k_s = 1 reflects of even light."""
    lobe = NormalizedPhong(1.0, shininess).double()
    angle = torch.acos(cosine.reshape(-1)).tolist()
    return torch.stack([directional_hemispherical_reflectance(lobe, a)[0] for a in angle])


@pytest.mark.parametrize("shininess", [0.0, 3.5, 80.0, 1e5])
def test_lamps_shine_as_the_brdf_says(shininess: float) -> None:
    lamps = (
        PointSource([[0.3, 1.5, -1.0]], [[2.0, 3.0, 4.0]]),
        DirectionalSource([[0.2, 1.0, -0.7]], [[1.0, 0.5, 0.1]]),
    )
    found = shown([FLOOR.shiny(0.4, shininess)], lamps).reshape(-1, 3)
    position, outgoing = seen_floor()
    up = torch.tensor([0.0, 1.0, 0.0]).double().expand_as(position)
    expected = torch.zeros_like(found)
    for lamp in lamps:
        arrival = lamp.double()(position, up)
        value = normalized_phong_brdf(
            torch.full((1,), 0.4).double(), torch.tensor([shininess]).double(),
            arrival.direction[0], outgoing, up,
        )  # fmt: skip
        cosine = arrival.direction[0][:, 1:2].clamp(min=0)
        expected = expected + value * cosine * arrival.irradiance[0]
    assert_close(found, expected, rtol=1e-6, atol=1e-9)
    assert float(found.max()) > 0


@pytest.mark.parametrize("name", ["crate", "cornell"])
def test_a_lobe_of_exponent_0_is_diffuse(name: str) -> None:
    made = STANDARD_SCENES[name](16, 12)
    gloss = replace(
        made,
        surfaces=tuple(
            replace(s, albedo=0.4 * s.albedo).shiny(0.6 * s.albedo, 0.0) for s in made.surfaces
        ),
    )
    settings = render.RenderSettings(supersampling=1, lobe_samples=256, patch_size=2.0)
    dull = render.render_scene(made, made.cameras[0], settings)
    shiny = render.render_scene(gloss, made.cameras[0], settings).radiance[~dull.emitter]
    light = dull.radiance[~dull.emitter]
    # 256 directions leave a percent in each pixel, and a fifteenth of it in the mean
    assert float((shiny - light).abs().sum() / light.sum()) < 0.02
    assert float(shiny.sum() / light.sum()) == pytest.approx(1, abs=2e-3)


def test_a_sharp_lobe_mirrors_a_lamp() -> None:
    """k_s cos(theta) L: the limit of the normalised lobe."""
    back = quad("lamp", [[-9, 0, -4], [9, 0, -4], [9, 9, -4], [-9, 9, -4]], albedo=0, emission=5)
    found = shown([FLOOR.shiny(0.3, 1e8), back.to(torch.float64)]).reshape(-1, 3)
    position, outgoing = seen_floor()
    mirrored = outgoing * torch.tensor([-1.0, 1, -1]).double()
    travel = (-4 - position[:, 2]) / mirrored[:, 2]
    high = position[:, 1] + travel * mirrored[:, 1]
    inside = (travel > 0) & (high > 0.05) & (high < 8.95)
    assert int(inside.sum()) > 50
    width = 1e-4  # radians: 1 / sqrt(n)
    assert_close(found[inside, 0], 0.3 * 5 * outgoing[inside, 1], rtol=width)


@pytest.mark.parametrize("shininess", [1.0, 12.0, 300.0])
def test_even_light_is_reflected_as_the_quadrature_says(shininess: float) -> None:
    """Under a dome, and in a closed box that shines everywhere."""
    position, outgoing = seen_floor()
    share = reflectance(outgoing[:, 1], shininess).unsqueeze(-1)
    sky = shown([FLOOR.shiny(0.5, shininess)], [AmbientDome([2.0])], lobe_samples=1024)
    noise = 0.01  # of 1024 directions below a horizon that cuts the lobe
    assert_close(sky.reshape(-1, 3), (0.5 * 2.0 * share).expand(-1, 3), rtol=noise)
    shell = box("box", (8, 8, 8), (0, 4, 0), inward=True, albedo=0.0, emission=2.0)
    shell = shell.to(torch.float64).shiny(0.5, shininess)
    found = shown([shell], lobe_samples=1024).reshape(-1, 3)
    lobe = 0.5 * float(mean_lobe_reflectance(torch.tensor([shininess]).double()))
    # emitted, and in the lobe what others emit and, evenly, reflect
    expected = (2.0 + 0.5 * share * (2.0 + lobe * 2.0)).expand(-1, 3)
    floor = (position[:, (0, 2)].abs() < 4).all(-1)
    assert int(floor.sum()) > 100
    assert_close(found[floor], expected[floor], rtol=noise)


def test_more_rays_leave_less_noise() -> None:
    made = STANDARD_SCENES["shiny table"](16, 12)
    settings = render.RenderSettings(bounces=0, supersampling=1)
    truth, *found = (
        render.render_scene(made, made.cameras[0], replace(settings, lobe_samples=n)).radiance
        for n in (1024, 4, 64)
    )
    few, many = (float((f - truth).abs().sum() / truth.sum()) for f in found)
    assert many < few / 3
    assert many < 0.05


def test_the_shader_of_a_plan_makes_the_same_picture() -> None:
    made = STANDARD_SCENES["shiny table"](16, 12)
    for settings in (
        render.RenderSettings(bounces=2, patch_size=1.0, lobe_samples=8),
        render.RenderSettings(bounces=0, ambient=True, lobe_samples=8),
        render.RenderSettings(bounces=0, lobe_samples=0),
    ):
        picture = render.render_scene(made, made.cameras[0], settings).radiance
        shader = PlannedShader(made, made.cameras[0], settings)
        assert_close(shader().permute(1, 2, 0).float(), picture, rtol=1e-4, atol=1e-5)
        assert (shader.lobes is None) == (settings.lobe_samples == 0)


def test_gradients_reach_the_specular_share() -> None:
    made = STANDARD_SCENES["shiny table"](8, 6).to(torch.float64)
    view = render.view_scene(made, made.cameras[0], replace(PLAIN, bounces=2, patch_size=1.5))

    def mean(specular: Tensor) -> Tensor:
        table = replace(made.surfaces[0], specular=specular)
        changed = replace(made, surfaces=(table, *made.surfaces[1:]))
        return render.develop(view, changed).radiance.mean()

    start = torch.full((3,), 0.3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(mean, (start,))


@pytest.mark.parametrize("shininess", [0.0, 1e-3, 0.5, 1e8])
@pytest.mark.parametrize("specular", [1e-12, 1.0])
def test_odd_lobes_stay_finite(shininess: float, specular: float) -> None:
    made = STANDARD_SCENES["shiny table"](8, 6)
    table = replace(made.surfaces[0], albedo=torch.zeros(3)).shiny(specular, shininess)
    made = replace(made, surfaces=(table, *made.surfaces[1:]))
    made.require_valid()
    picture = render.render_scene(made, made.cameras[0], replace(PLAIN, lobe_samples=4)).radiance
    assert bool(torch.isfinite(picture).all())
    assert float(picture.min()) >= 0


def test_the_same_seed_gives_the_same_bits() -> None:
    made = STANDARD_SCENES["shiny table"](12, 9)
    settings = render.RenderSettings(bounces=1, patch_size=1.5)
    first, second = (
        render.render_scene(made, made.cameras[0], settings).radiance for _ in range(2)
    )
    assert bool((first == second).all())


@pytest.mark.parametrize(
    ("specular", "shininess", "what"),
    [(1.2, 3.0, "specular"), (0.7, 3.0, "albedo \\+ specular"), (0.1, -1.0, "shininess")],
)
def test_lobes_that_make_light_are_named(specular: float, shininess: float, what: str) -> None:
    wall = quad("wall", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], albedo=0.5)
    made = scene.Scene((wall.shiny(specular, shininess),), (), (above(),))
    with pytest.raises(errors.OutOfRangeError, match=what):
        made.require_renderable()


def test_the_mean_reflectance_is_that_of_the_lobe() -> None:
    for shininess in (0.3, 2.0, 40.0):
        cosine = (torch.arange(40, dtype=torch.float64) + 0.5) / 40
        # mean over outgoing directions, weighted by their cosine
        mean = (2 * cosine * reflectance(cosine, shininess)).mean()
        found = mean_lobe_reflectance(torch.tensor([shininess]).double())
        assert float(found) == pytest.approx(float(mean), rel=1e-3)
