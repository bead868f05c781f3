"""Rough stand-ins: counted form factors and thinned lamps are right in the mean."""

from functools import partial

import pytest
import torch
from torch.testing import assert_close

from torchradiometry.geometry.patches import Patches
from torchradiometry.plan.rough import POLYGONS, RAYS, counted_factors, thinned
from torchradiometry.render.direct import emitter_weights
from torchradiometry.render.exposure import exposure_of
from torchradiometry.render.indirect import exchange_between, first_patches, operator_between
from torchradiometry.render.points import Receivers
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import prepare
from torchradiometry.scene.build import box, sphere
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.standard import STANDARD_SCENES, ground

SETTINGS = RenderSettings(patch_size=1.5)


@pytest.mark.parametrize("name", ["white room", "cornell", "crate"])
def test_counted_form_factors_agree_with_exact_ones(name: str) -> None:
    world = prepare(STANDARD_SCENES[name](8, 6), SETTINGS)
    grid = first_patches(world, SETTINGS)
    patches = Patches(grid.corners)
    exposure = exposure_of(world, patches, 0)
    exact, _ = operator_between(world, patches, exposure, SETTINGS)
    counted, _ = counted_factors(grid, world, patches, exposure, SETTINGS)
    light = torch.rand(patches.count, 1, generator=torch.Generator().manual_seed(0)).double()
    seen = exposure.share == 1
    rays = RAYS * exposure.point.shape[1]
    assert float(counted.row_sums().max()) <= 1 + 1e-12
    # a mean of `rays` numbers within 0..1 has a standard deviation of at most 1 / (2 sqrt(rays))
    difference = (counted(light) - exact(light))[seen]
    assert float(difference.abs().max()) < 5 / (2 * rays**0.5)
    assert abs(float(difference.mean())) < 5 / (2 * (rays * int(seen.sum())) ** 0.5)


def test_a_closed_room_keeps_all_of_its_light() -> None:
    shell = box("room", (2.0, 2.0, 2.0), inward=True, albedo=0.5)
    world = prepare(Scene((shell,), ()), SETTINGS)
    grid = first_patches(world, SETTINGS)
    found = exchange_between(world, grid, SETTINGS, partial(counted_factors, grid))
    assert_close(found.operator.row_sums(), torch.ones(len(grid.corners), dtype=torch.float64))


@pytest.mark.parametrize("subdivisions", [0, 1, 2])
def test_a_thinned_lamp_shines_like_the_whole_one(subdivisions: int) -> None:
    lamp = sphere("lamp", 0.3, (0, 2.0, 0), subdivisions=subdivisions, smooth=False, albedo=0.0,
                  emission=5.0)  # fmt: skip
    world = prepare(Scene((ground("ground", 1.0), lamp), ()), SETTINGS)
    few = thinned(world)
    assert len(few.emitters.corners) == POLYGONS
    assert len(few.emitters.triangle) == len(world.emitters.triangle)
    where = torch.rand(64, 3, generator=torch.Generator().manual_seed(0)).double() * 2 - 1
    where[:, 1] = 0
    up = torch.tensor([0.0, 1, 0]).double().expand_as(where)
    whole, part = (
        emitter_weights(w, RenderSettings(shadow_samples=0), Receivers(where, up, up),
                        torch.Generator().manual_seed(0))
        for w in (world, few)
    )  # fmt: skip
    assert_close(part.mean(), whole.mean(), rtol=0.25, atol=0)


def test_a_lamp_of_few_faces_is_left_as_it_is() -> None:
    world = prepare(STANDARD_SCENES["cornell"](8, 6), SETTINGS)
    assert thinned(world) is world
