"""Directions over a depth map, the pixels met along them, and the cells that it is cut into."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tests.tolerances import assert_close
from torchradiometry.transport.depth_maps.azimuths import directions, gathered, neighbours
from torchradiometry.transport.depth_maps.pooling import grid_over

F64 = torch.float64


@pytest.mark.parametrize("count", [4, 5, 8, 12, 16, 40])
def test_directions_are_even_and_take_whole_steps(count: int) -> None:
    found = directions(count)
    angle = torch.tensor([math.atan2(v, u) for u, v in found], dtype=F64) % math.tau
    assert_close(angle, (torch.arange(count, dtype=F64) + 0.5) * (math.tau / count))
    assert {max(abs(across), abs(down)) for across, down in found} == {1}
    diagonal = [abs(across) == abs(down) for across, down in found]
    assert sum(diagonal) == (4 if count % 8 == 4 else 0)


@given(st.integers(1, 6), st.integers(1, 6), st.integers(1, 7), st.integers(4, 16))
def test_steps_end_between_two_pixels(rows: int, columns: int, count: int, azimuths: int) -> None:
    """A linear height is met exactly; outside is the number after the last pixel."""
    v, u = torch.meshgrid(torch.arange(rows) + 0.5, torch.arange(columns) + 0.5, indexing="ij")
    pixel = (u.double().reshape(-1), v.double().reshape(-1))
    step = tuple(
        torch.tensor(s, dtype=F64).unsqueeze(1) for s in zip(*directions(azimuths), strict=True)
    )
    where = neighbours((rows, columns), pixel, step, count)
    outside = rows * columns
    linear = (3 * u.double() - 2 * v.double()).reshape(-1, 1)
    met = gathered(torch.cat((linear, linear[:1])), where).squeeze(-1)
    inside = (where.first < outside) & (where.second < outside)
    expected = 3 * (pixel[0] + count * step[0]) - 2 * (pixel[1] + count * step[1])
    assert_close(met[inside], expected[inside], rtol=0, atol=1e-12)
    assert ((where.share >= 0) & (where.share <= 1)).all()
    away = pixel[0] + count * step[0], pixel[1] + count * step[1]
    beyond = (away[0] < -0.5) | (away[0] > columns + 0.5)
    beyond |= (away[1] < -0.5) | (away[1] > rows + 0.5)
    assert (where.first[beyond] == outside).all()
    assert (where.second[beyond] == outside).all()


@given(
    st.integers(1, 9),
    st.integers(1, 9),
    st.integers(2, 6),
    st.integers(2, 5),
    st.integers(0, 2**31),
)
def test_cells_share_out_the_pixels(h: int, w: int, rows: int, columns: int, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    image = torch.rand(2, 3, h, w, dtype=F64, generator=generator)
    grid_of = grid_over((h, w), (rows, columns), image)
    means = grid_of.means(image)
    assert means.shape == (2, 3, rows, columns)
    assert_close(means.mean((-2, -1)), image.mean((-2, -1)))
    assert_close(grid_of.means(torch.ones_like(image)), torch.ones_like(means))
    assert_close(grid_of.at_pixels(torch.ones_like(means)), torch.ones_like(image))
    assert grid_of.cell_of.shape == (h * w + 1,)
    assert grid_of.cell_of[-1] == rows * columns
    assert ((grid_of.middle >= 0) & (grid_of.middle < h * w)).all()
    if h >= rows and w >= columns:
        assert torch.equal(grid_of.cell_of[grid_of.middle], torch.arange(rows * columns))
    if (h, w) == (rows, columns):
        assert torch.equal(means, image)
        assert torch.equal(grid_of.at_pixels(image), image)
