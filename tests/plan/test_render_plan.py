"""Plans: only what the scene calls for, JSON-able, and an error that is not above the promise."""

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from torchradiometry import errors, files, plan, render, scene, sources
from torchradiometry.plan import render_plan
from torchradiometry.render.indirect import CLUSTER_ERROR, MOST_DENSE

UPRIGHT = ("left", "right", "top", "back", "front")


def floor() -> scene.Surface:
    return scene.quad("floor", [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]], albedo=0.6)


def sun() -> sources.DirectionalSource:
    return sources.DirectionalSource([[0.5, 1.0, 0.4]], [[3.0]])


def ball() -> scene.Scene:
    return scene.with_default_view(
        scene.Scene((scene.sphere("ball", 1.0, subdivisions=2),), (sun(),)), width=40, height=30
    )


def floor_and_crate() -> tuple[scene.Surface, ...]:
    body = scene.box("crate", (0.8, 0.8, 0.8), (0, 0.4, 0), turn=0.3, sides=UPRIGHT, albedo=0.7)
    return floor(), body


def crate() -> scene.Scene:
    made = scene.Scene(floor_and_crate(), (sun(),))
    return scene.with_default_view(made, width=40, height=30)


def room(**options: object) -> scene.Scene:
    camera = scene.cornell_like_room(width=40, height=30).cameras
    return scene.Scene(scene.room(**options), (), camera)


SCENES = {
    "ball": ball,
    "crate": crate,
    "empty room": room,
    "cornell": lambda: scene.cornell_like_room(width=40, height=30, lamp=True),
}


def relative_error(picture: render.Picture, reference: render.Picture) -> float:
    mask = ~reference.emitter
    difference = (picture.radiance - reference.radiance)[mask].abs().sum()
    return float(difference / reference.radiance[mask].sum())


@pytest.mark.parametrize("name", SCENES)
def test_the_measured_error_is_at_most_the_predicted_one(name: str) -> None:
    made = SCENES[name]()
    camera = made.cameras[0]
    planned = [plan.plan_render(made, camera, t) for t in (0.3, 0.1)]
    size = planned[-1].patch_size
    finer = replace(
        planned[-1].settings,
        bounces=planned[-1].bounces * 2,
        patch_size=size and size / 2,
        shadow_samples=8 if planned[-1].shadow_samples else 0,
        supersampling=6,
        seed=7,
    )
    reference = render.render_scene(made, camera, finer)
    for each in planned:
        measured = relative_error(render.render_scene(made, camera, each.settings), reference)
        assert measured <= each.predicted_error <= each.tolerance


def test_a_convex_body_under_a_distant_lamp_has_no_global_effect() -> None:
    made = ball()
    found = plan.plan_render(made, made.cameras[0], 0.05)
    assert found.bounces == 0
    assert found.shadow_samples == 0
    assert found.patch_size is None
    assert "convex" in found.reasons["interreflection"]
    assert found.settings.bounces == 0


def test_what_is_left_out_has_its_reason() -> None:
    made = crate()
    black = replace(made, surfaces=tuple(replace(s, albedo=s.albedo * 0) for s in made.surfaces))
    assert (
        "nothing reflects"
        in plan.plan_render(black, made.cameras[0], 0.1).reasons["interreflection"]
    )
    dark = replace(made, sources=())
    assert plan.plan_render(dark, made.cameras[0], 0.1).bounces == 0
    lamps = plan.plan_render(made, made.cameras[0], 0.1)
    assert lamps.shadow_samples == 1
    assert "no area" in lamps.reasons["shadows"]
    empty = room()
    assert plan.plan_render(empty, empty.cameras[0], 0.1).shadow_samples == 0


def many_blockers() -> scene.Scene:
    """A room with a ball of more faces than are clipped."""
    made = room()
    ball = scene.sphere("ball", 0.4, (0, 1, 0), subdivisions=2)
    return replace(made, surfaces=(*made.surfaces, ball))


def test_the_reason_for_shadows_is_what_the_renderer_does() -> None:
    clipped, sampled = SCENES["cornell"](), many_blockers()
    found = plan.plan_render(clipped, clipped.cameras[0], 0.1)
    assert "one ray to each lamp" in found.reasons["shadows"]
    assert "clipped" in found.reasons["shadows"]
    assert "shadows" not in found.parts
    settings = [found.settings, replace(found.settings, shadow_samples=8)]
    one, eight = (render.render_scene(clipped, clipped.cameras[0], s) for s in settings)
    assert torch.equal(one.radiance, eight.radiance)
    assert render.prepare(sampled, settings[0]).blockers is None
    found = plan.plan_render(sampled, sampled.cameras[0], 0.1)
    rays = f"{found.shadow_samples} rays to each shining polygon, {4 * found.shadow_samples} in"
    assert rays in found.reasons["shadows"]
    assert "lamp" not in found.reasons["shadows"]
    assert found.parts["shadows"] > 0
    sky = scene.Scene(floor_and_crate(), (sources.AmbientDome([1.0]),))
    found = plan.plan_render(sky, clipped.cameras[0], 0.1)
    assert f"{found.settings.sky_samples} rays to the sky" in found.reasons["shadows"]


def test_the_reason_for_supersampling_is_what_the_renderer_does() -> None:
    made, lit = crate(), SCENES["cornell"]()
    told = plan.plan_render(made, made.cameras[0], 0.1)
    side = told.supersampling
    assert f"{side} x {side} where light bends" in told.reasons["supersampling"]
    assert f"{2 * side} x {2 * side} at edges" in told.reasons["supersampling"]
    assert "shining" not in told.reasons["supersampling"]
    told = plan.plan_render(lit, lit.cameras[0], 0.1)
    side = told.supersampling
    assert f"{4 * side} x {4 * side} at edges of shining faces" in told.reasons["supersampling"]
    large = replace(made.cameras[0], width=4096, height=4096)
    told = plan.plan_render(made, large, 0.3)
    assert told.supersampling == 1
    assert told.reasons["supersampling"] == "one ray a pixel"


def test_a_looser_tolerance_never_asks_for_more() -> None:
    made = SCENES["cornell"]()
    plans = [plan.plan_render(made, made.cameras[0], t) for t in (0.02, 0.05, 0.1, 0.3)]
    for tight, loose in pairwise(plans):
        assert loose.bounces <= tight.bounces
        assert loose.shadow_samples <= tight.shadow_samples
        assert loose.supersampling <= tight.supersampling
        assert loose.patch_size >= tight.patch_size
        assert loose.predicted_error >= tight.predicted_error


def test_an_unreachable_tolerance_is_said() -> None:
    made = SCENES["cornell"]()
    found = plan.plan_render(made, made.cameras[0], 1e-4)
    assert found.predicted_error > 1e-4
    assert "not met" in found.reasons["tolerance"]


def test_a_plan_is_json() -> None:
    made = SCENES["cornell"]()
    found = plan.plan_render(made, made.cameras[0], 0.1)
    told = json.loads(json.dumps(found.to_dict()))
    assert told["predicted_error"] == found.predicted_error
    assert math.isclose(sum(told["parts"].values()), found.predicted_error)
    assert set(told["reasons"]) >= {"interreflection", "patches", "shadows", "supersampling"}


def test_bad_tolerances_and_empty_scenes_are_named() -> None:
    made = crate()
    for tolerance in (0.0, 1.0, -1.0, float("nan")):
        with pytest.raises(errors.OutOfRangeError, match="tolerance"):
            plan.plan_render(made, made.cameras[0], tolerance)
    with pytest.raises(errors.EmptySceneError):
        plan.plan_render(scene.Scene(), made.cameras[0], 0.1)


@pytest.mark.parametrize("ending", [".npy", ".png"])
def test_render_file(tmp_path: Path, ending: str) -> None:
    scene.save_scene(crate(), tmp_path / "crate.glb")
    out = tmp_path / f"picture{ending}"
    report = plan.render_file(tmp_path / "crate.glb", out, width=16, height=12, tolerance=0.3)
    assert {"out", "seconds", "plan", "predicted_error"} <= set(json.loads(json.dumps(report)))
    assert report["operator"] == f"a matrix: {report['patches']} patches, at most {MOST_DENSE}"
    pixels = files.read_picture(out)
    assert pixels.shape == (12, 16, 3)
    assert np.isfinite(pixels).all()
    assert pixels.max() > 0


def test_render_file_leaves_nothing_behind_on_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "crate.glb"
    scene.save_scene(crate(), path)
    with pytest.raises(errors.FileFormatError, match="ending"):
        plan.render_file(path, tmp_path / "picture.jpeg")
    with pytest.raises(errors.InputFileError, match="folder"):
        plan.render_file(path, tmp_path / "nowhere" / "picture.png")
    with pytest.raises(errors.InputFileError):
        plan.render_file(tmp_path / "missing.glb", tmp_path / "picture.png")
    with pytest.raises(errors.OutOfRangeError):
        plan.render_file(path, tmp_path / "picture.png", tolerance=2.0)
    with pytest.raises(errors.OutOfRangeError):
        plan.render_file(path, tmp_path / "picture.png", width=0)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["crate.glb"]
    assert torch.is_grad_enabled()


def dented_ball(subdivisions: int) -> scene.Scene:
    """A body that is not convex, of 20 * 4^subdivisions faces."""
    ball = scene.sphere("ball", 1.0, subdivisions=subdivisions, smooth=False)
    dent = 1 - 0.6 * torch.exp(-8 * (1 - ball.vertices[:, 2:]))
    body = replace(ball, vertices=ball.vertices * dent)
    return scene.with_default_view(scene.Scene((body,), (sun(),)), width=20, height=15)


def test_a_mesh_of_too_many_faces_is_rendered_without_interreflection_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(render_plan, "MOST_SECONDS", 10.0)
    made = dented_ball(4)
    found = plan.plan_render(made, made.cameras[0], 0.01)
    assert found.bounces == 0
    assert "5120 faces would take" in found.reasons["interreflection"]
    assert found.parts["interreflection"] > 0
    assert "not met" in found.reasons["tolerance"]
    picture = render.render_scene(made, made.cameras[0], found.settings)
    assert torch.isfinite(picture.radiance).all()
    assert picture.radiance.max() > 0


def test_a_large_mesh_keeps_interreflection_through_clusters() -> None:
    large, small = dented_ball(5), dented_ball(4)
    found = plan.plan_render(large, large.cameras[0], 0.01)
    assert found.bounces > 0
    assert "20480 patches" in found.reasons["clusters"]
    assert found.parts["clusters"] == CLUSTER_ERROR
    assert found.predicted_error == pytest.approx(sum(found.parts.values()))
    few = plan.plan_render(small, small.cameras[0], 0.01)
    assert few.bounces > 0
    assert "clusters" not in few.reasons
    assert "clusters" not in few.parts


def test_mutual_view_of_a_closed_room_is_one_and_of_a_ball_zero() -> None:
    assert plan.mutual_view(room()) == pytest.approx(1.0, abs=0.01)
    assert plan.mutual_view(ball()) == pytest.approx(0.0, abs=0.01)


def test_reflected_share_never_exceeds_the_albedo_and_grows_with_view() -> None:
    shares = [plan.reflected_share(0.5, view) for view in (0.0, 0.1, 0.5, 1.0)]
    assert shares[0] == 0
    assert all(a < b <= 0.5 for a, b in pairwise(shares[:3]))
    assert shares[-1] == 0.5


CARELESS = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
vn 0 0 -1
f 1/1/1 2/2/1 3/3/1
f 1/1/2 3/3/2 4/4/2
f 1/1/1 2/2/1 2/2/1
"""


def test_a_careless_mesh_is_rendered_with_a_warning(tmp_path: Path) -> None:
    (tmp_path / "careless.obj").write_text(CARELESS)
    loaded = scene.load_scene(tmp_path / "careless.obj")
    with pytest.raises(errors.RadiometryError):
        loaded.require_valid()
    report = plan.render_file(
        tmp_path / "careless.obj", tmp_path / "out.npy", width=16, height=12, tolerance=0.2
    )
    assert report["warnings"]
    pixels = np.load(tmp_path / "out.npy")
    assert np.isfinite(pixels).all()
    assert pixels.max() > 0


def test_a_textured_scene_in_single_precision_shows_its_texture() -> None:
    board = torch.tensor([[[0.1], [0.9]], [[0.9], [0.1]]])
    surface = scene.quad("board", [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], albedo=1.0)
    corners = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    painted = replace(surface, texture=scene.Texture(board, corners, wrap=("clamp", "clamp")))
    made = scene.with_default_view(scene.Scene((painted,), (sun(),)), width=24, height=18)
    picture = render.render_scene(made, made.cameras[0], render.RenderSettings(bounces=0))
    seen = picture.radiance[picture.radiance > 0]
    assert seen.max() > 5 * seen.min()
