"""`UnoccludedFormFactors`: the graph of fixed shape against `polygon_exchange`."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from torchradiometry import transport
from torchradiometry.geometry.patches import Patches
from torchradiometry.transport import unoccluded

#: of the contour in float64, of what two patches that face each other would exchange
CANCELLATION = 2e-11
#: of the product rule
PRODUCT = 1e-9


def pairs(apart: float, count: int = 40) -> tuple[Tensor, Tensor]:
    """Random triangles `apart` sizes from each other, each turned both ways."""
    generator = torch.Generator().manual_seed(0)
    first, second = torch.rand(2, count, 3, 3, generator=generator, dtype=torch.float64)
    first, second = (t - t.mean(1, keepdim=True) for t in (first, second))
    size = torch.maximum(*(t.norm(dim=-1).amax(1) for t in (first, second)))
    way = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    way = way / way.norm(dim=-1, keepdim=True)
    second = second + (apart * size)[:, None, None] * way[:, None]
    turned = [(a, b) for a in (first, first.flip(1)) for b in (second, second.flip(1))]
    return torch.cat([a for a, _ in turned]), torch.cat([b for _, b in turned])


def exchange(first: Tensor, second: Tensor) -> Tensor:
    """A_1 F_12 of each pair by the graph, m2."""
    graph = transport.UnoccludedFormFactors()
    found = torch.vmap(lambda corners: graph(corners)[0, 1])(torch.stack((first, second), 1))
    return found * Patches(first).area


@pytest.mark.parametrize("apart", [3.0, 7.0, 12.0, 29.0, 60.0, 1000.0])
def test_pairs_at_any_distance_are_right_to_their_last_sliver(apart: float) -> None:
    first, second = pairs(apart)
    exact, found = transport.polygon_exchange(first, second, rtol=1e-12), exchange(first, second)
    distance = (first.mean(1) - second.mean(1)).square().sum(-1)
    facing = Patches(first).area * Patches(second).area / (torch.pi * distance)
    seen = exact > 0
    assert seen.sum() > 20
    assert (exact[seen] / facing[seen]).min() < 1e-2  # some see little of each other
    off = (found - exact).abs()
    allowed = PRODUCT * exact + (CANCELLATION * facing if apart < 10 else 0)
    assert (off <= allowed)[seen].all()


@pytest.mark.parametrize("apart", [10.0, 29.0, 60.0])
def test_the_tip_of_a_triangle_above_the_other_s_plane(apart: float) -> None:
    corners = [[0.0, 0, 0], [1, 0.1, 0], [0.2, 1, 0]]
    floor = torch.tensor(corners, dtype=torch.float64).expand(3, -1, -1)
    wall = torch.tensor([[0.0, 0.3, 0], [0, 0.8, -1], [0, 0, -1]], dtype=torch.float64)
    rise = torch.tensor([1e-1, 1e-2, 1e-3], dtype=torch.float64)
    tips = wall + torch.stack((torch.full_like(rise, apart), 0 * rise, rise), -1).unsqueeze(1)
    exact = transport.polygon_exchange(floor, tips, rtol=1e-12)
    assert (exact > 0).all()
    assert float((exchange(floor, tips) / exact - 1).abs().max()) < PRODUCT


def test_rows_in_blocks_are_those_of_all_pairs_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    draw = torch.Generator().manual_seed(0)
    corners = torch.rand(21, 3, 3, generator=draw, dtype=torch.float64)
    layer = transport.UnoccludedFormFactors(3)
    found = []
    for most in (1, 100, 10**6):
        monkeypatch.setattr(unoccluded, "PAIRS", most)
        found.append(layer(corners))
    assert float(found[0].sum()) > 0
    for blocks in found[:2]:
        torch.testing.assert_close(blocks, found[2], rtol=0, atol=CANCELLATION)
