"""Plans: only what the scene calls for, data that can be kept, and an error that keeps its word."""

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.testing import assert_close

from torchradiometry import errors, export, plan, render, scene, sources
from torchradiometry.plan.planner import Planner
from torchradiometry.scene.standard import STANDARD_SCENES

COSTS = plan.Costs()
SMALL = (40, 30)


def planned(made: scene.Scene, tolerance: float) -> plan.Plan:
    return Planner(tolerance, costs=COSTS).plan(made, made.cameras[0])


def relative_error(picture: render.Picture, reference: render.Picture) -> float:
    mask = ~reference.emitter
    difference = (picture.radiance - reference.radiance)[mask].abs().sum()
    return float(difference / reference.radiance[mask].sum())


@pytest.mark.parametrize("name", ["ball", "crate", "groove", "cornell", "white room", "black room"])
def test_the_measured_error_is_at_most_the_predicted_one(name: str) -> None:
    made = STANDARD_SCENES[name](*SMALL)
    plans = [planned(made, t) for t in (0.2, 0.05)]
    size = plans[-1].settings.patch_size
    bounces = 0 if name == "ball" else 64  # a convex body sends itself nothing
    finest = render.RenderSettings(
        bounces=bounces, patch_size=size and size / 2, shadow_samples=8, supersampling=8, seed=7
    )
    reference = render.render_scene(made, made.cameras[0], finest)
    for each in plans:
        picture = render.render_scene(made, made.cameras[0], each.settings)
        assert relative_error(picture, reference) <= each.predicted_error <= each.tolerance


def test_a_convex_body_under_a_distant_lamp_is_one_dot_product() -> None:
    made = STANDARD_SCENES["ball"](*SMALL)
    found = planned(made, 0.05)
    assert not any(row.included for row in found.rows)
    shader = found.build()
    assert shader.ambient is None
    assert shader.reflected is None
    assert shader.direct.weights.shape[-1] == 0
    view = render.view_scene(made, made.cameras[0], found.settings)
    lamp = made.sources[0]
    points = view.samples.points
    arrival = lamp(None, points.normal)
    cosine = (points.normal * arrival.direction[0]).sum(-1, keepdim=True).clamp(min=0)
    expected = made.surfaces[0].albedo * cosine * arrival.irradiance[0] / math.pi
    found_radiance = shader().reshape(3, -1)[:, view.samples.pixel].mT
    assert_close(found_radiance, expected.double(), rtol=1e-6, atol=1e-7)


def test_rooms_that_are_lit_through_a_door_keep_many_bounces() -> None:
    found = planned(STANDARD_SCENES["two rooms"](*SMALL), 0.03)
    assert found.settings.bounces >= 8
    assert found.row("interreflection").left_out.error > 0.5


def test_a_black_room_needs_no_bounces_where_a_white_one_does() -> None:
    black, white = (
        planned(STANDARD_SCENES[f"{name} room"](*SMALL), 0.1) for name in ("black", "white")
    )
    assert black.settings.bounces == 0
    assert black.row("interreflection").left_out.error < 0.1
    assert white.row("interreflection").left_out.error > 0.5
    assert white.row("interreflection").included
    assert not white.row("colour bleeding").included


@pytest.fixture(scope="module")
def ladder() -> list[plan.Plan]:
    made = STANDARD_SCENES["cornell"](*SMALL)
    return [planned(made, t) for t in (0.9, 0.4, 0.2, 0.1, 0.05, 0.02)]


def test_a_looser_tolerance_never_adds_an_effect(ladder: list[plan.Plan]) -> None:
    for loose, tight in pairwise(ladder):
        assert all(a.chosen <= b.chosen for a, b in zip(loose.rows, tight.rows, strict=True))
        assert loose.predicted_seconds <= tight.predicted_seconds + 1e-9
    assert ladder[0].settings.bounces == 0
    assert not ladder[0].row("cast shadows").included


@settings(max_examples=8, deadline=None)
@given(st.floats(1e-3, 0.9), st.floats(1e-3, 0.9))
def test_any_two_tolerances_are_ordered(first: float, second: float) -> None:
    made = STANDARD_SCENES["crate"](16, 12)
    loose, tight = (planned(made, t) for t in (max(first, second), min(first, second)))
    assert all(a.chosen <= b.chosen for a, b in zip(loose.rows, tight.rows, strict=True))


def test_rows_say_why(ladder: list[plan.Plan]) -> None:
    found = ladder[-1]
    assert found.row("near fall-off").why == "the scene has no lamps"
    assert "albedos up to 0.7" in found.row("interreflection").why
    assert found.row("penumbra").level.name == "clipped"
    assert found.predicted_error == pytest.approx(sum(row.error for row in found.rows))
    text = found.table()
    assert all(row.effect in text for row in found.rows)
    assert "tolerance 2.00%" in text
    assert all(row.level.kind in ("exact", "bound", "estimate") for row in found.rows)


def test_a_time_gets_the_best_picture_that_fits(ladder: list[plan.Plan]) -> None:
    made = STANDARD_SCENES["cornell"](*SMALL)
    wanted = ladder[-2]
    found = Planner(seconds=wanted.predicted_seconds * 1.01, costs=COSTS).plan(
        made, made.cameras[0]
    )
    assert found.predicted_seconds <= wanted.predicted_seconds * 1.01
    assert found.predicted_error <= wanted.predicted_error
    hurried = Planner(seconds=1e-9, costs=COSTS).plan(made, made.cameras[0])
    assert "cheapest plan takes" in hurried.notes[0]


def test_a_plan_comes_back_from_its_file(ladder: list[plan.Plan], tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    ladder[-1].save(path)
    found = plan.Plan.load(path)
    assert found == ladder[-1]
    assert found.settings.bounces == ladder[-1].settings.bounces
    with pytest.raises(errors.EmptySceneError, match="build"):
        found.build()
    for text in ("", "[]", "{}", '{"rows": [1]}', '{"rows": [{"effect": 1}]}'):
        path.write_text(text)
        with pytest.raises(errors.FileFormatError, match="plan"):
            plan.Plan.load(path)


def test_an_effect_can_be_overruled(ladder: list[plan.Plan]) -> None:
    before = ladder[-1]
    after = before.overridden("penumbra", "left out")
    assert not after.settings.penumbra
    assert after.predicted_error > before.predicted_error
    assert after.row("penumbra").why == "as asked"
    assert before.settings.penumbra
    local = before.overridden("interreflection", "left out")
    assert not local.row("patches").applies
    assert local.row("patches").error == 0
    again = local.overridden("interreflection", before.row("interreflection").level.name)
    assert again.row("patches").error == before.row("patches").error
    assert again.predicted_error == pytest.approx(before.predicted_error)
    with pytest.raises(errors.IndexRangeError, match="penumbra"):
        before.overridden("fog", 0)
    with pytest.raises(errors.OutOfRangeError, match="left out"):
        before.overridden("penumbra", "thick")


def test_a_new_effect_is_one_class() -> None:
    class Fog(plan.AbstractEffect):
        name, adds = "fog", "grey"

        def levels(self, pilot: plan.Pilot) -> tuple[plan.Level, ...]:
            return (
                plan.Level("left out", 0.3, "estimate", {"sky_samples": 1}),
                plan.Level("in full", 0.0, "exact", {"sky_samples": 64}),
            )

        def why(self, pilot: plan.Pilot, level: plan.Level) -> str:
            return "because"

    made = STANDARD_SCENES["crate"](16, 12)
    found = Planner(0.1, effects=(*plan.EFFECTS, Fog()), costs=COSTS).plan(made, made.cameras[0])
    assert found.row("fog").level.name == "in full"
    assert found.settings.sky_samples == 64


@pytest.mark.parametrize("tolerance", [0.3, 0.05])
def test_the_shader_is_the_picture_and_has_its_gradients(tolerance: float) -> None:
    made = STANDARD_SCENES["cornell"](24, 18)
    found = planned(made, tolerance)
    shader = found.build()
    picture = render.render_scene(made, made.cameras[0], found.settings)
    assert_close(shader().movedim(0, -1).float(), picture.radiance, rtol=1e-5, atol=1e-6)
    albedo = shader.albedo.clone().requires_grad_()
    emission = shader.emission.clone().requires_grad_()

    def total(a: torch.Tensor, e: torch.Tensor) -> torch.Tensor:
        return shader(a, e).square().mean()

    slopes = torch.autograd.grad(total(albedo, emission), (albedo, emission))
    generator = torch.Generator().manual_seed(0)
    ways = [torch.randn(t.shape, generator=generator).double() for t in (albedo, emission)]
    ways[1] = ways[1] * (shader.emission > 0)
    step = 1e-6
    with torch.no_grad():
        ahead, behind = (total(albedo + s * ways[0], emission + s * ways[1]) for s in (step, -step))
    expected = (ahead - behind) / (2 * step)
    assert_close(sum((s * w).sum() for s, w in zip(slopes, ways, strict=True)), expected,
                 rtol=1e-6, atol=1e-9)  # fmt: skip


def test_nothing_to_plan_is_said(tmp_path: Path) -> None:
    made = STANDARD_SCENES["crate"](*SMALL)
    best = planned(made, 1e-6)
    assert "not reached" in best.notes[-1]
    dark = replace(made, sources=())
    found = planned(dark, 0.1)
    assert "picture is black" in found.notes[0]
    assert found.settings.bounces == 0
    away = replace(
        made, cameras=STANDARD_SCENES["ball"](*SMALL).cameras, surfaces=made.surfaces[:1]
    )
    up = replace(away.cameras[0], camera_to_world=torch.eye(4))
    turned = torch.tensor([[1.0, 0, 0, 0], [0, 0, 1, 9], [0, -1, 0, 0], [0, 0, 0, 1]])
    nothing = Planner(0.1, costs=COSTS).plan(away, replace(up, camera_to_world=turned.inverse()))
    assert isinstance(nothing.table(), str)
    with pytest.raises(errors.EmptySceneError):
        Planner(0.1, costs=COSTS).plan(scene.Scene(), made.cameras[0])
    for bad in (0.0, 1.0, -1.0, math.nan):
        with pytest.raises(errors.OutOfRangeError, match="tolerance"):
            Planner(bad)
    with pytest.raises(errors.OutOfRangeError, match="one of the two"):
        Planner()
    with pytest.raises(errors.OutOfRangeError, match="above 0"):
        Planner(seconds=0)


def test_a_plan_without_a_camera_counts_surfaces_by_area() -> None:
    made = STANDARD_SCENES["two rooms"](*SMALL)
    everywhere = Planner(0.1, costs=COSTS).plan(made)
    seen = planned(made, 0.1)
    # the camera stands in the dim room: there, reflected light is nearly all
    assert (
        seen.row("interreflection").left_out.error
        > everywhere.row("interreflection").left_out.error
    )
    assert not everywhere.row("supersampling").included


def test_lamps_are_distant_only_where_they_are() -> None:
    made = STANDARD_SCENES["lamp and ball"](*SMALL)
    assert planned(made, 0.1).row("near fall-off").included
    far = sources.PointSource([[300.0, 600.0, 200.0]], [[1e6] * 3])
    assert not planned(replace(made, sources=(far,)), 0.1).row("near fall-off").included


def test_lamps_with_hard_shadows_are_told_of() -> None:
    made = STANDARD_SCENES["crate"](*SMALL)
    ball = sources.SphereSource([[1.0, 3.0, 1.0]], [0.4], [[5.0] * 3])
    assert any("hard shadows" in n for n in planned(replace(made, sources=(ball,)), 0.05).notes)
    assert not any("hard shadows" in n for n in planned(made, 0.05).notes)


def test_prices_are_kept_and_hostile_ones_refused(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "prices.json"
    COSTS.save(path)
    assert plan.Costs.load(path).prices == COSTS.prices
    assert plan.Costs.load(path).calibrated
    for text in ("", "[]", '{"prices": {"ray": 1}}', '{"prices": []}', '{"prices": {"ray": NaN}}'):
        path.write_text(text)
        with pytest.raises(errors.FileFormatError, match="calibrate"):
            plan.Costs.load(path)
    path.write_text(json.dumps({"prices": dict(list(COSTS.prices.items())[1:])}))
    with pytest.raises(errors.FileFormatError, match=f"without '{next(iter(COSTS.prices))}'"):
        plan.Costs.load(path)
    path.write_text(json.dumps({"prices": dict.fromkeys(COSTS.prices, math.nan)}))
    with pytest.raises(errors.FileFormatError, match=r"= nan.*calibrate"):
        plan.Costs.load(path)


@pytest.mark.parametrize(
    ("name", "tolerance"), [("ball", 0.05), ("cornell", 0.3), ("groove", 0.05)]
)
def test_the_shader_runs_in_onnxruntime(name: str, tolerance: float, tmp_path: Path) -> None:
    made = STANDARD_SCENES[name](16, 12)
    shader = planned(made, tolerance).build()
    inputs = {"albedo": shader.albedo, "emission": shader.emission}
    path = tmp_path / "shader.onnx"
    axes = {name: [str(size) for size in t.shape] for name, t in inputs.items()}
    export.export_onnx(shader, inputs, path, axes=axes)
    found = export.check_onnx(path, shader, inputs=inputs)
    assert found.passed


def test_what_is_no_scene_no_camera_no_seed_is_named() -> None:
    made = STANDARD_SCENES["ball"](8, 6)
    with pytest.raises(errors.DTypeError, match=r"camera: got a tuple; .*scene.cameras\[0\]"):
        Planner(0.1).plan(made, made.cameras)
    with pytest.raises(errors.DTypeError, match="scene: got a int"):
        Planner(0.1).plan(3)
    with pytest.raises(errors.DTypeError, match="seed"):
        Planner(0.1, seed=1.5)


def test_colours_of_another_shape_or_kind_are_named() -> None:
    made = STANDARD_SCENES["ball"](8, 6)
    shader = Planner(0.1).plan(made, made.cameras[0]).build()
    for wrong in (torch.zeros(7, 3), torch.zeros(3), torch.zeros(1, 7)):
        with pytest.raises(errors.ShapeError, match="albedo"):
            shader(albedo=wrong)
    for dtype in (torch.int64, torch.complex64):
        with pytest.raises(errors.DTypeError, match="emission"):
            shader(emission=torch.zeros(1, 3, dtype=dtype))
