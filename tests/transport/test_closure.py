from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from torchradiometry.errors import NotConvergedError
from torchradiometry.transport.closure import (
    cap_rows,
    capping_scale,
    close_enclosure,
    closing_scale,
)


def symmetric(seed: int, count: int = 12) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    half = torch.rand(count, count, generator=generator, dtype=torch.float64)
    area = 0.5 + torch.rand(count, generator=generator, dtype=torch.float64)
    exchange = (half + half.mT).fill_diagonal_(0) / count
    return exchange, area


@given(st.integers(0, 2**31))
def test_rows_close_from_both_sides(seed: int) -> None:
    exchange, area = symmetric(seed)
    closed = close_enclosure(exchange, area)
    torch.testing.assert_close(closed.sum(1), area, rtol=1e-13, atol=0)
    assert torch.equal(closed, closed.mT)


@given(st.integers(0, 2**31))
def test_products_alone_close_as_the_matrix_does(seed: int) -> None:
    exchange, area = symmetric(seed)
    scale = closing_scale(lambda x: exchange @ x, area)
    scaled = scale.unsqueeze(1) * exchange * scale
    torch.testing.assert_close(scaled, close_enclosure(exchange, area), rtol=1e-13, atol=0)


def test_a_target_of_zero_leaves_a_patch_alone() -> None:
    exchange, area = symmetric(1)
    target = area.clone()
    target[3] = 0
    scale = closing_scale(lambda x: exchange @ x, target)
    rows = scale * (exchange @ scale)
    assert scale[3] == 1
    torch.testing.assert_close(rows[target > 0], area[target > 0], rtol=1e-13, atol=0)


@given(st.integers(0, 2**31))
def test_capping_pulls_rows_to_their_area_and_leaves_low_scenes_alone(seed: int) -> None:
    exchange, area = symmetric(seed)
    one = torch.ones_like(area)
    bright = 2 * exchange
    scale = capping_scale(lambda x: bright @ x, area, one)
    rows = scale * (bright @ scale)
    assert (rows <= area * (1 + 1e-14)).all()
    assert (scale <= 1).all()
    assert (cap_rows(bright, area).sum(1) <= area * (1 + 1e-14)).all()
    dim = 1e-3 * exchange
    assert torch.equal(capping_scale(lambda x: dim @ x, area, one), one)


def test_an_open_scene_cannot_be_closed() -> None:
    # a small patch between two large ones that see nothing else
    exchange = torch.tensor([[0.0, 1, 0], [1, 0, 1], [0, 1, 0]]).double()
    with pytest.raises(NotConvergedError, match="this scene is open"):
        closing_scale(lambda x: exchange @ x, torch.tensor([1.0, 1.0, 1.0]).double())
