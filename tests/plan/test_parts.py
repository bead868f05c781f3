"""The parts of a planned picture at their edge: lights of any size, NaN, no rays."""

from __future__ import annotations

import math

import pytest
import torch

from torchradiometry.plan import (
    AmbientLight,
    DepthPlanner,
    DirectLight,
    LobeLight,
    Measured,
    PlannedDepthShading,
    PlannedLevel,
    PlannedShader,
    PlanRow,
    ReflectedLight,
)
from torchradiometry.render import (
    RenderSettings,
    lobe_light,
    look_along_lobes,
    prepare,
    view_scene,
)
from torchradiometry.scene.standard import STANDARD_SCENES
from torchradiometry.sources import DirectionalSource

PATCHES = RenderSettings(patch_size=3.0, bounces=2, supersampling=1, lobe_samples=4)
EVEN = RenderSettings(bounces=0, ambient=True, supersampling=1, lobe_samples=4)


def shader(settings: RenderSettings) -> PlannedShader:
    scene = STANDARD_SCENES["shiny table"](8, 6)
    return PlannedShader(scene, scene.cameras[0], settings)


@pytest.mark.parametrize("settings", [PATCHES, EVEN])
def test_pictures_are_as_large_as_their_lamps_and_so_are_gradients(
    settings: RenderSettings,
) -> None:
    made = shader(settings)
    assert isinstance(made.direct, DirectLight)
    assert isinstance(made.lobes, LobeLight)
    assert isinstance(made.reflected, ReflectedLight) or isinstance(made.ambient, AmbientLight)
    plain = made()
    for factor in (2.0**40, 2.0**-40):
        emission = (factor * made.emission).requires_grad_()
        picture = made(emission=emission)
        torch.testing.assert_close(picture, factor * plain, rtol=1e-12, atol=0)
        (slope,) = torch.autograd.grad(picture.sum(), emission)
        assert bool(torch.isfinite(slope).all())
    assert float(made(emission=0 * made.emission).abs().max()) == 0


def test_nan_in_one_channel_of_a_lamp_stays_there() -> None:
    made = shader(PATCHES)
    emission = made.emission.clone()
    emission[emission.sum(-1) > 0, 0] = math.nan
    picture = made(emission=emission)
    assert bool(torch.isnan(picture[0]).any())
    torch.testing.assert_close(picture[1:], made()[1:], rtol=1e-12, atol=0)


def test_lobes_of_no_points_are_none_and_light_of_any_size_goes_through() -> None:
    scene = STANDARD_SCENES["shiny table"](8, 6)
    world, view = prepare(scene, EVEN), view_scene(scene, scene.cameras[0], EVEN)
    points = view.samples.points
    nothing = torch.zeros(0, dtype=torch.int64)
    one = torch.ones(0, dtype=torch.float64)
    assert look_along_lobes(world, EVEN, points.take(nothing), nothing, one) is None
    lobes, glow = view.lobes, world.glow(world.triangles)
    assert lobes is not None
    seen = torch.rand(len(lobes.owner), scene.channels).double()
    plain = lobe_light(lobes, glow, seen)
    huge = lobe_light(lobes, 2.0**40 * glow, 2.0**40 * seen)
    torch.testing.assert_close(huge, 2.0**40 * plain, rtol=1e-12, atol=0)


def test_planned_depth_shading_keeps_what_is_no_number_in_its_image() -> None:
    depth = 2 + 0.02 * torch.rand(2, 1, 12, 12, generator=torch.Generator().manual_seed(0))
    albedo, sun = torch.full_like(depth, 0.5), DirectionalSource([0.2, 0.1, 1.0], [2.0])
    layer = DepthPlanner(0.05).plan(depth, albedo, sun, pixel_size=0.1).build(sun, pixel_size=0.1)
    assert isinstance(layer, PlannedDepthShading)
    broken = albedo.clone()
    broken[0, 0, 0, 0] = math.nan
    torch.testing.assert_close(layer(depth, broken)[1], layer(depth, albedo)[1])


def test_rows_that_hold_no_number_are_written_as_they_are() -> None:
    row = Measured("a rung", EVEN, math.nan, 0.0, 0.0, math.inf, 0.0, None, 0, False)
    found = row.to_dict()
    assert math.isnan(found["error"])
    assert found["megabytes"] is None
    level = PlannedLevel("left out", math.inf, "bound", 0.0, {"bounces": 0})
    row_of_plan = PlanRow("light", "", (), True, 0, (level,), "")
    assert row_of_plan.error == math.inf
    assert not row_of_plan.included
