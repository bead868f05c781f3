"""Plain numbers that are no setting (no number, NaN, too small, too large) are refused by name.

They are looked at where they come in, before memory is asked for: an error of torch or numpy from
within, a NaN in the answer or a loop without end would be no answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import pytest
import torch

from torchradiometry import geometry, learn, materials, scene, shade, solve, sources, transport
from torchradiometry.errors import DTypeError, OutOfRangeError, ShapeError

FLOOR = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
PLATES = torch.cat((FLOOR, FLOOR.flip(1) + torch.tensor([0, 0, 1.0])))
WHITE, GREY = torch.ones(1, 3), materials.Lambertian(0.5)
LIGHTS = torch.eye(3)
DRAW = torch.Generator()


class Setting(NamedTuple):
    """A call with one setting, and settings that are good."""

    call: Callable[[object], object]
    good: tuple[object, ...]


WHOLE = {
    "hemisphere_quadrature polar": Setting(lambda n: geometry.hemisphere_quadrature(n, 8), (1, 8)),
    "hemisphere_quadrature azimuth": Setting(lambda n: geometry.hemisphere_quadrature(2, n), (1,)),
    "mirror_quadrature polar": Setting(lambda n: materials.mirror_quadrature(0.3, n), (1,)),
    "mirror_quadrature azimuth": Setting(lambda n: materials.mirror_quadrature(0.3, 2, n), (2,)),
    "reciprocity_error samples": Setting(lambda n: materials.reciprocity_error(GREY, n), (2,)),
    "fibonacci_directions": Setting(
        lambda n: sources.fibonacci_directions(n, torch.float32), (1, 9)
    ),
    "PolygonSource samples": Setting(
        lambda n: sources.PolygonSource(FLOOR, WHITE, samples=n), (1, 4)
    ),
    "SphereSource samples": Setting(
        lambda n: sources.SphereSource(WHITE, WHITE[:, :1], WHITE, samples=n), (1, 4)
    ),
    "UnoccludedFormFactors": Setting(transport.UnoccludedFormFactors, (1, 24)),
    "patch_points degree": Setting(lambda n: transport.patch_points(FLOOR, n), (1, 5)),
    "patch_points split": Setting(lambda n: transport.patch_points(FLOOR, 2, n), (1, 3)),
    "observation_map cells": Setting(
        lambda n: learn.observation_map(LIGHTS, LIGHTS[:, :2], n, 0.1), (1, 8)
    ),
    "robust_normals": Setting(lambda n: learn.robust_normals(LIGHTS, LIGHTS, n), (0, 2)),
    "random_lights": Setting(lambda n: learn.random_lights(n, DRAW), (0, 3)),
    "random_materials shapes": Setting(lambda n: learn.random_materials(n, 4, DRAW), (0, 2)),
    "random_materials pixels": Setting(lambda n: learn.random_materials(2, n, DRAW), (0, 4)),
    "drawn_lights available": Setting(lambda n: learn.drawn_lights(n, 2, 0), (0, 8)),
}
#: those that cost nothing before they are used may be as large as one likes
COUNTS = {
    "drawn_lights lights": Setting(lambda n: learn.drawn_lights(8, n, 0), (0, 4)),
    "AmbientOcclusion azimuths": Setting(shade.AmbientOcclusion, (4, 8)),
    "AmbientOcclusion reach": Setting(lambda n: shade.AmbientOcclusion(8, n), (1, None)),
    "DepthSettings bounces": Setting(lambda n: shade.DepthSettings(bounces=n), (0, 2)),
    "DepthSettings cells": Setting(lambda n: shade.DepthSettings(cells=n), (2, 16)),
    "InterreflectionShading cells": Setting(shade.InterreflectionShading, (2, (2, 3), [4, 4])),
    "InterreflectionShading fine": Setting(lambda n: shade.InterreflectionShading(fine=n), (1, 4)),
    "Neumann": Setting(solve.Neumann, (0, 3)),
}
NUMBERS = {
    "polygon_exchange": Setting(
        lambda x: transport.polygon_exchange(PLATES[:1], PLATES[1:], x), (1e-12, 0.1)
    ),
    "unoccluded_exchange": Setting(
        lambda x: transport.unoccluded_exchange(geometry.Patches(PLATES), x), (1e-3,)
    ),
    "form_factors": Setting(
        lambda x: transport.form_factors(geometry.Patches(PLATES), rtol=x), (1e-3,)
    ),
    "subdivide": Setting(lambda x: geometry.subdivide(geometry.Patches(PLATES), x), (1, 0.5)),
    "hierarchical_operator": Setting(
        lambda x: shade.hierarchical_operator(geometry.Patches(PLATES), tolerance=x), (0.1,)
    ),
    "CastShadow width": Setting(lambda x: shade.CastShadow(width=x), (0.1, None)),
    "observation_map width": Setting(
        lambda x: learn.observation_map(LIGHTS, LIGHTS[:, :2], 4, x), (0.1, 1)
    ),
}
EVERY = WHOLE | COUNTS | NUMBERS


@pytest.mark.parametrize("name", EVERY)
def test_good_settings_are_taken(name: str) -> None:
    for value in EVERY[name].good:
        assert EVERY[name].call(value) is not None


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("value", [-1, math.nan, -math.inf, "3", True, 1j], ids=repr)
def test_what_is_no_setting_is_refused(name: str, value: object) -> None:
    with pytest.raises((DTypeError, OutOfRangeError), match="pass "):
        EVERY[name].call(value)


@pytest.mark.parametrize("name", WHOLE | COUNTS)
def test_counts_are_whole(name: str) -> None:
    with pytest.raises(DTypeError, match="whole number"):
        EVERY[name].call(4.0)


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("value", [2**40, 10**5000], ids=["2^40", "10^5000"])
def test_counts_beyond_any_memory_are_refused_before_it_is_asked_for(name: str, value: int) -> None:
    with pytest.raises(OutOfRangeError, match="at most"):
        EVERY[name].call(value)


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [0, 0.0, math.inf, 10**5000], ids=["0", "0.0", "inf", "10^5000"])
def test_numbers_outside_their_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(OutOfRangeError, match="pass "):
        NUMBERS[name].call(value)


@pytest.mark.parametrize("value", [math.nan, math.inf, "3", None])
def test_a_box_is_turned_by_a_finite_angle(value: object) -> None:
    with pytest.raises((DTypeError, OutOfRangeError), match="turn"):
        scene.box("crate", (1, 1, 1), turn=value)


@pytest.mark.parametrize("cells", [(), (2,), (2, 2, 2)])
def test_cells_are_rows_and_columns(cells: tuple[int, ...]) -> None:
    with pytest.raises(ShapeError, match="rows and columns"):
        shade.InterreflectionShading(cells)


@pytest.mark.parametrize("seed", [math.nan, "3", 2**70])
def test_seeds_are_whole_and_of_64_bits(seed: object) -> None:
    with pytest.raises((DTypeError, OutOfRangeError), match="seed"):
        materials.reciprocity_error(GREY, 2, seed)


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_a_geometric_mean_is_of_finite_numbers_from_0(value: float) -> None:
    assert learn.geometric_mean([1.0, 4.0]) == pytest.approx(2)
    with pytest.raises(OutOfRangeError, match="values"):
        learn.geometric_mean([1.0, value])
