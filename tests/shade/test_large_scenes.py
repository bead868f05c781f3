from __future__ import annotations

import pytest
import torch

from torchradiometry import (
    BruteForceRays,
    DenseOperator,
    EmbreeRays,
    Patches,
    exchange_areas,
    hierarchical_operator,
    solve_radiosity,
    subdivide,
)
from torchradiometry.errors import OutOfRangeError, ResourceLimitError
from torchradiometry.scene.build import box

WALLS, CRATE = (
    torch.cat([s.vertices[s.faces]]).double()
    for s in (
        box("room", (2, 1, 1.5), inward=True),
        box("crate", (0.5, 0.4, 0.5), (0.2, 0.05, 0.1), turn=0.4),
    )
)
SOLID = torch.cat((WALLS, CRATE))
SHAPE = subdivide(Patches(SOLID), 0.33)[0]


def light(patches: Patches) -> tuple[torch.Tensor, torch.Tensor]:
    albedo = torch.full((patches.count, 2), 0.5, dtype=torch.float64)
    albedo[:, 1] = 0.8
    middle = patches.centroid
    lamp = (middle[:, 1] > 0.499) & (middle[:, 0].abs() < 0.5) & (middle[:, 2].abs() < 0.5)
    return albedo, lamp.to(albedo).unsqueeze(-1).expand(-1, 2).contiguous()


def test_radiosity_is_that_of_the_dense_matrix() -> None:
    rays = EmbreeRays(SOLID)
    operator = hierarchical_operator(SHAPE, rays, closed=True)
    torch.testing.assert_close(
        operator.row_sums(), torch.ones(SHAPE.count).double(), rtol=0, atol=1e-12
    )
    exchange, area = exchange_areas(SHAPE, rays, closed=True, rtol=1e-3, samples=8)
    dense = DenseOperator(exchange / area.unsqueeze(1), area)
    found, expected = (solve_radiosity(f, *light(SHAPE)).radiosity for f in (operator, dense))
    area = area.unsqueeze(1)
    error = (area * (found - expected).abs()).sum() / (area * expected).sum()
    assert float(error) < 0.005


def test_without_blockers_any_caster_gives_the_same() -> None:
    room = subdivide(Patches(WALLS), 0.5)[0]
    plain = hierarchical_operator(room, closed=True)
    x = light(room)[1]
    for rays in (BruteForceRays(WALLS), EmbreeRays(WALLS)):
        found = hierarchical_operator(room, rays, closed=True)
        torch.testing.assert_close(found(x), plain(x), rtol=1e-12, atol=1e-14)


def test_masks_close_some_and_cap_the_others() -> None:
    room = subdivide(Patches(WALLS), 0.5)[0]
    mask = room.centroid[:, 0] < 0
    rows = hierarchical_operator(room, closed=mask).row_sums()
    assert float(rows.max()) <= 1 + 1e-12
    assert float((1 - rows[mask]).abs().max()) < 1e-3
    half = torch.full((room.count,), 0.5).double()
    exposed = hierarchical_operator(room, exposure=half)
    torch.testing.assert_close(exposed.area, room.area / 2)
    assert float(exposed.row_sums().max()) <= 1 + 1e-12


def test_limits_are_named() -> None:
    with pytest.raises(OutOfRangeError, match="tolerance"):
        hierarchical_operator(SHAPE, tolerance=0.0)
    with pytest.raises(ResourceLimitError, match="bytes of 100000"):
        hierarchical_operator(SHAPE, budget=100_000)
