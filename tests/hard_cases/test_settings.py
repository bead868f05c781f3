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
from torchradiometry.errors import (
    DTypeError,
    IndexRangeError,
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
)

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


BLOCKED = torch.cat((PLATES, FLOOR + torch.tensor([0, 0, 0.5])))


@pytest.mark.parametrize("samples", [0, -1, 1.5, 2**40, "3"])
def test_samples_of_shadows_are_counts(samples: object) -> None:
    patches, rays = geometry.Patches(BLOCKED), transport.BruteForceRays(BLOCKED)
    pair = torch.tensor([0]), torch.tensor([1])
    with pytest.raises((DTypeError, OutOfRangeError), match="samples"):
        transport.form_factors(patches, rays, samples=samples)
    with pytest.raises((DTypeError, OutOfRangeError), match="samples"):
        transport.pair_visibility(patches, rays, *pair, samples=samples)


@pytest.mark.parametrize(
    ("receiver", "emitter", "error"),
    [
        ([9], [0], IndexRangeError),
        ([0], [-1], IndexRangeError),
        ([0.0], [1.0], DTypeError),
        ([0, 1], [1], ShapeError),
    ],
)
def test_pairs_of_no_patches_are_refused(receiver: list, emitter: list, error: type) -> None:
    rays = transport.BruteForceRays(BLOCKED)
    pair = torch.tensor(receiver), torch.tensor(emitter)
    with pytest.raises(error, match=r"receiver|emitter"):
        transport.pair_visibility(geometry.Patches(BLOCKED), rays, *pair)


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"exposure": torch.ones(5)}, ShapeError),
        ({"closed": torch.ones(5, dtype=torch.bool)}, ShapeError),
        ({"exposure": torch.tensor([math.nan, 1])}, InvalidValueError),
    ],
)
def test_options_of_form_factors_fit_the_patches(
    given: dict[str, torch.Tensor], error: type
) -> None:
    with pytest.raises(error, match=next(iter(given))):
        transport.form_factors(geometry.Patches(PLATES), **given)


def test_rays_over_a_map_end_with_it_and_start_in_it() -> None:
    wall, sun = torch.tensor([[[0.0, 0.0, 0.0, 5.0]]]), torch.tensor([[0.8, 0.0, 0.6]])
    hits = transport.height_field_hits(wall, sun)
    assert torch.equal(transport.height_field_hits(wall, sun, steps=2**60), hits)
    for start in (-1, 4):
        with pytest.raises(IndexRangeError, match="start"):
            transport.height_field_hits(wall, sun, start=torch.tensor([start]))
    with pytest.raises((DTypeError, OutOfRangeError), match="steps"):
        transport.height_field_hits(wall, sun, steps=-1)


def test_shadows_of_no_source_are_refused() -> None:
    with pytest.raises(ShapeError, match="sources"):
        shade.cast_shadows(torch.ones(1, 1, 2, 2), [], pixel_size=1.0)


@pytest.mark.parametrize(
    "solver",
    [
        solve.Direct(),
        solve.ConjugateGradient(),
        solve.GaussSeidel(),
        solve.Southwell(),
        solve.Neumann(60),
    ],
    ids=lambda solver: type(solver).__name__,
)
def test_rooms_in_a_batch_may_share_paint_and_light(solver: solve.AbstractSolver) -> None:
    factors = torch.tensor([[0, 0.5], [0.5, 0]], dtype=torch.float64)
    room = torch.stack((factors, factors / 2))
    operator = solve.DenseOperator(room, torch.ones(2, 2, dtype=torch.float64))
    paint, light = torch.full((2, 1), 0.5).double(), torch.ones(2, 1).double()
    found = solve.solve_radiosity(operator, paint, light, solver).radiosity
    # B = 1 + F B / 2 for both patches alike
    expected = 1 / (1 - torch.tensor([0.25, 0.125], dtype=torch.float64))
    torch.testing.assert_close(found, expected.reshape(2, 1, 1).expand(2, 2, 1))


@pytest.mark.parametrize("seed", [math.nan, "3", 2**70])
def test_seeds_are_whole_and_of_64_bits(seed: object) -> None:
    with pytest.raises((DTypeError, OutOfRangeError), match="seed"):
        materials.reciprocity_error(GREY, 2, seed)


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_a_geometric_mean_is_of_finite_numbers_from_0(value: float) -> None:
    assert learn.geometric_mean([1.0, 4.0]) == pytest.approx(2)
    with pytest.raises(OutOfRangeError, match="values"):
        learn.geometric_mean([1.0, value])
