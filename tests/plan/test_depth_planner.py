"""Plans for depth maps: honest, thrifty, monotone, image by image."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from tests.shade.relief_bank import reliefs
from tests.tolerances import assert_close
from torchradiometry import AmbientDome, DirectionalSource, LambertianShading, depth_to_normals
from torchradiometry.errors import (
    FileFormatError,
    IndexRangeError,
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
)
from torchradiometry.plan import DepthPlan, DepthPlanner
from torchradiometry.plan.depth_pilot import DepthLevel
from torchradiometry.plan.depth_planner import _last_within
from torchradiometry.shade import DepthSettings, ShadeDepth

SIZE = 48
PIXEL = 1 / SIZE
SUN = DirectionalSource([0.5, 0.3, 0.8], [3.0])
SKY = AmbientDome([0.5])


def maps() -> tuple[list[str], Tensor]:
    """A plane, a dome and reliefs, one batch."""
    found = reliefs(SIZE, torch.float32)
    axis = torch.linspace(-1, 1, SIZE)
    square = axis**2 + axis.unsqueeze(-1) ** 2
    found |= {"plane": torch.full((1, 1, SIZE, SIZE), 2.0), "dome": (2 + 0.1 * square)[None, None]}
    return list(found), torch.cat(list(found.values()))


@cache
def truth(albedo: float) -> Tensor:
    """Of the maps above, with one cell a pixel."""
    _, depth = maps()
    best = DepthSettings(cells=SIZE, azimuths=16, bounces=8, ambient_tail=True)
    rho = torch.full_like(depth, albedo)
    return ShadeDepth(best, [SUN, SKY], pixel_size=PIXEL)(depth, rho)


@pytest.mark.parametrize("albedo", [0.2, 0.8])
@pytest.mark.parametrize("tolerance", [0.1, 0.03, 0.01])
def test_the_error_is_within_the_tolerance_or_the_plan_says_so(
    tolerance: float, albedo: float
) -> None:
    names, depth = maps()
    rho, true = torch.full_like(depth, albedo), truth(albedo)
    plan = DepthPlanner(tolerance).plan(depth, rho, [SUN, SKY], pixel_size=PIXEL)
    found = plan.build([SUN, SKY], pixel_size=PIXEL)(depth, rho)
    errors = (found - true).abs().sum((1, 2, 3)) / true.sum((1, 2, 3))
    for name, error, predicted in zip(names, errors.tolist(), plan.predicted_error, strict=True):
        assert error <= max(tolerance, predicted), name
        assert predicted <= tolerance or plan.notes, name


@pytest.mark.parametrize("size", [64, 112])
def test_roughness_from_pixel_to_pixel_counts(size: int) -> None:
    """Every s-th pixel alone shows slopes half as steep, and half of the reflected light."""
    grain = torch.rand(2, 1, size, size, generator=torch.Generator().manual_seed(4))
    depth = 2 + grain * torch.tensor([0.3, 1.2]).reshape(2, 1, 1, 1) / size
    rho = torch.full_like(depth, 0.7)
    light = DirectionalSource([0.4, 0.2, 0.9], [3.0])
    best = DepthSettings(cells=min(size, 64), azimuths=16, bounces=8, ambient_tail=True)
    true = ShadeDepth(best, [light], pixel_size=1 / size)(depth, rho)
    for tolerance in (0.1, 0.03):
        plan = DepthPlanner(tolerance).plan(depth, rho, light, pixel_size=1 / size)
        found = plan.build(light, pixel_size=1 / size)(depth, rho)
        errors = (found - true).abs().sum((1, 2, 3)) / true.sum((1, 2, 3))
        for error, predicted in zip(errors.tolist(), plan.predicted_error, strict=True):
            assert error <= predicted
            assert predicted <= tolerance or plan.notes


def test_convex_surfaces_pay_for_nothing_and_deep_ones_for_what_they_need() -> None:
    names, depth = maps()
    rho = torch.full_like(depth, 0.7)
    plan = DepthPlanner(0.02).plan(depth, rho, [SUN, SKY], pixel_size=PIXEL)
    chosen = dict(zip(names, plan.settings, strict=True))
    for name in ("plane", "dome"):
        one = chosen[name]
        assert (one.cast_shadows, one.ambient_occlusion, one.bounces) == (False, False, 0)
    assert chosen["bowl"].bounces >= 1
    assert chosen["bowl"].ambient_occlusion
    layer = plan.build(SUN, pixel_size=PIXEL)
    assert sum(len(group) for group in layer.groups) == len(names)
    alone = (
        DepthPlanner(0.02)
        .plan(depth[-1:], rho[-1:], SUN, pixel_size=PIXEL)
        .build(SUN, pixel_size=PIXEL)
    )
    normal = depth_to_normals(depth[-1:], pixel_size=PIXEL)
    assert_close(alone(depth[-1:], rho[-1:]), LambertianShading(SUN)(normal, rho[-1:]))


def test_what_cannot_be_there_is_exactly_nothing() -> None:
    _, depth = maps()
    black = torch.zeros_like(depth)
    plan = DepthPlanner(0.01).plan(depth, black, SUN, pixel_size=PIXEL)
    for rows in plan.rows:
        kinds = {row.effect: row.level.kind for row in rows}
        assert kinds["interreflection"] == kinds["ambient occlusion"] == "exact"
        assert kinds["specular lobe"] == "exact"


def test_groups_of_images_come_back_in_order_with_gradients() -> None:
    _, depth = maps()
    depth = depth[[0, -2, 3, -1]].requires_grad_()
    rho = torch.full_like(depth, 0.7)
    matrix = torch.tensor([[96.0, 0, 24], [0, 96, 24], [0, 0, 1]])
    plan = DepthPlanner(0.05).plan(depth, rho, SUN, matrix)
    layer = plan.build(SUN)
    assert len(layer.groups) > 1
    found = layer(depth, rho, matrix.expand(4, 3, 3))
    with torch.no_grad():
        for k, one in enumerate(plan.settings):
            alone = ShadeDepth(one, SUN)(depth[k : k + 1], rho[k : k + 1], matrix)
            assert_close(found[k : k + 1], alone)
    found.sum().backward()
    assert torch.isfinite(depth.grad).all()


levels = st.lists(st.tuples(st.floats(0, 0.5), st.floats(0.1, 100)), min_size=0, max_size=4).map(
    lambda steps: (
        DepthLevel("left out", 0.6, "estimate", 0.0, {}),
        *(
            DepthLevel(str(k), error, "estimate", price, {})
            for k, (error, price) in enumerate(
                zip(
                    sorted((e for e, _ in steps), reverse=True),
                    sorted(p for _, p in steps),
                    strict=True,
                )
            )
        ),
    )
)


@settings(max_examples=200, deadline=None)
@given(st.lists(levels, min_size=1, max_size=4), st.floats(0.001, 0.9), st.floats(1, 5))
def test_a_looser_tolerance_never_adds_an_effect(
    effects: list[tuple[DepthLevel, ...]], tolerance: float, looser: float
) -> None:
    tight, loose = (_last_within(effects, t) for t in (tolerance, min(0.99, tolerance * looser)))
    assert all(a >= b for a, b in zip(tight, loose, strict=True))


def test_plans_are_data(tmp_path: Path) -> None:
    names, depth = maps()
    rho = torch.full_like(depth, 0.7)
    plan = DepthPlanner(0.05).plan(depth, rho, [SUN, SKY], pixel_size=PIXEL)
    assert DepthPlan.load(plan.save(tmp_path / "plan.json")) == plan
    bowl = names.index("bowl")
    bare = plan.overridden("interreflection", 0, bowl)
    assert bare.settings[bowl].bounces == 0
    assert bare.predicted_error[bowl] > plan.predicted_error[bowl]
    assert bare.settings[1:] == plan.settings[1:]
    assert "interreflection" in plan.table()
    with pytest.raises(IndexRangeError, match="choose among"):
        plan.overridden("mirages", 0)
    (tmp_path / "bad.json").write_text('{"tolerance": 0.1, "images": [[{"effect": 1}]]}')
    with pytest.raises(FileFormatError, match="no plan of depth maps"):
        DepthPlan.load(tmp_path / "bad.json")


def test_mistakes_are_named() -> None:
    with pytest.raises(OutOfRangeError, match="between 0 and 1"):
        DepthPlanner(5)
    _, depth = maps()
    rho = torch.full_like(depth, 0.5)
    layer = DepthPlanner(0.1).plan(depth, rho, SUN, pixel_size=PIXEL).build(SUN, pixel_size=PIXEL)
    with pytest.raises(ShapeError, match="planned"):
        layer(depth[:2], rho[:2])


@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_no_plan_is_made_of_numbers_that_are_none(value: float) -> None:
    """One such pixel would make every estimate NaN, and NaN is below no tolerance or all."""
    depth = maps()[1][:2]
    rho = torch.full_like(depth, 0.5)
    rho[0, 0, 3, 3] = value
    with pytest.raises(InvalidValueError, match="albedo"):
        DepthPlanner(0.1).plan(depth, rho, SUN, pixel_size=PIXEL)
    grey = torch.full_like(depth, 0.5)
    with pytest.raises(InvalidValueError, match="shininess"):
        DepthPlanner(0.1).plan(
            depth, grey, SUN, pixel_size=PIXEL, specular=0.2 * grey, shininess=20 * rho
        )
    depth[0, 0, 3, 3] = torch.nan  # of a pixel that is not seen it does not matter
    plan = DepthPlanner(0.1).plan(depth, rho, SUN, pixel_size=PIXEL)
    same = DepthPlanner(0.1).plan(depth, grey, SUN, pixel_size=PIXEL)
    assert plan.predicted_error == same.predicted_error


def test_nothing_seen_and_no_light_are_planned_without_a_crash() -> None:
    unseen = torch.full((1, 1, 8, 8), torch.nan)
    rho = torch.full_like(unseen, 0.5)
    plan = DepthPlanner(0.1).plan(unseen, rho, SUN, pixel_size=PIXEL)
    assert plan.predicted_error == (0.0,)
    dark = DirectionalSource([0.0, 0.0, -1.0], [1.0])
    _, depth = maps()
    plan = DepthPlanner(0.1).plan(depth, rho.new_full(depth.shape, 0.5), dark, pixel_size=PIXEL)
    assert max(plan.predicted_error) == 0.0
