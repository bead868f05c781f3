"""Every effect: levels from left out to best, errors that fall, settings that exist."""

import math
from dataclasses import fields, replace

import pytest
import torch

from tests import cases
from tests.benchmarks.fresh_scenes import cave
from torchradiometry import plan, render
from torchradiometry.plan.costs import counts
from torchradiometry.scene import STANDARD_SCENES

NAMES = ("ball", "crate", "cornell", "lamp and ball")
KNOWN = {field.name for field in fields(render.RenderSettings)}


@pytest.fixture(scope="module")
def pilots() -> dict[str, plan.Pilot]:
    scenes = {name: STANDARD_SCENES[name](32, 24) for name in NAMES}
    return {name: plan.Pilot(made, made.cameras[0]) for name, made in scenes.items()}


@pytest.mark.parametrize("effect", cases.EFFECTS, ids=lambda effect: effect.__name__)
@pytest.mark.parametrize("name", NAMES)
def test_levels(
    effect: type[plan.AbstractEffect], name: str, pilots: dict[str, plan.Pilot]
) -> None:
    made, pilot = effect(), pilots[name]
    levels = made.levels(pilot)
    assert levels
    assert all(0 <= level.error < math.inf for level in levels)
    assert levels[-1].error == min(level.error for level in levels)
    assert {level.kind for level in levels} <= {"exact", "bound", "estimate"}
    assert all(level.error == 0 for level in levels if level.kind == "exact")
    assert all(set(level.settings) <= KNOWN for level in levels)
    for level in levels:
        render.RenderSettings(**level.settings)
        assert made.why(pilot, level)
    if len(levels) == 1:
        assert levels[0].error == 0


def test_every_effect_is_planned() -> None:
    assert {type(effect) for effect in plan.EFFECTS} == set(cases.EFFECTS)
    assert len({effect.name for effect in plan.EFFECTS}) == len(plan.EFFECTS)


def test_shadows_that_are_left_out_brighten_reflected_light_too(
    pilots: dict[str, plan.Pilot],
) -> None:
    """In a white room what is wrongly added directly comes back many times."""
    made = STANDARD_SCENES["white room"](32, 24)
    pilot = plan.Pilot(made, made.cameras[0])
    error = plan.CastShadows().levels(pilot)[0].error
    bare = render.RenderSettings(bounces=64, patch_size=0.8, supersampling=1)
    with_shadows = render.render_scene(made, made.cameras[0], bare)
    without = render.render_scene(
        made, made.cameras[0],
        render.RenderSettings(bounces=64, patch_size=0.8, supersampling=1, shadow_samples=0),
    )  # fmt: skip
    mask = ~with_shadows.emitter
    measured = (without.radiance - with_shadows.radiance)[mask].abs().sum()
    measured = float(measured / with_shadows.radiance[mask].sum())
    assert measured <= error <= 4 * measured


@pytest.mark.parametrize("name", ["ball", "crate", "groove"])
def test_edges_and_bending_light_are_predicted_for_any_number_of_rays(name: str) -> None:
    made = STANDARD_SCENES[name](48, 36)
    levels = plan.Supersampling().levels(plan.Pilot(made, made.cameras[0]))
    settings = render.RenderSettings(bounces=0)

    def radiance(side: int) -> torch.Tensor:
        chosen = replace(settings, supersampling=side)
        return render.render_scene(made, made.cameras[0], chosen).radiance

    fine = radiance(12)
    for level in levels[:3]:
        off = (radiance(level.settings["supersampling"]) - fine).abs().sum() / fine.sum()
        assert off / 1.25 <= level.error <= 3 * off


def test_what_is_left_out_costs_nothing(pilots: dict[str, plan.Pilot]) -> None:
    off = render.RenderSettings(bounces=0, shadow_samples=0, supersampling=1)
    for pilot in pilots.values():
        found = counts(pilot, off)
        assert not any(found["indirect"].values())
        assert found["direct"]["shadow ray"] == found["direct"]["clipped point"] == 0
        more = counts(pilot, replace(off, bounces=2, patch_size=0.5, shadow_samples=2))
        assert more["indirect"]["pair"] > 0
        assert more["direct"]["shadow ray"] + more["direct"]["clipped point"] > 0


def test_uneven_reflected_light_among_many_faces_is_not_taken_for_even() -> None:
    made = cave(24, 18, subdivisions=2)
    view = made.cameras[0]
    (ambient,) = [
        level
        for level in plan.Interreflection().levels(plan.Pilot(made, view))
        if level.name == "ambient"
    ]
    bare = render.RenderSettings(bounces=0, supersampling=1)
    number, full = (
        render.render_scene(made, view, settings)
        for settings in (replace(bare, ambient=True), replace(bare, bounces=24, patch_size=3.0))
    )
    lit = ~full.emitter
    off = (number.radiance - full.radiance)[lit].abs().sum() / full.radiance[lit].sum()
    assert float(off) < ambient.error < 4 * float(off)
