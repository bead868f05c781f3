"""Clipping: the area that is left, whatever the shape; differentiable; nothing data-dependent."""

import math

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.geometry import clip_polygon, vector_area

SQUARE = torch.tensor([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], dtype=torch.float64)


def area(polygon: Tensor) -> Tensor:
    return vector_area(polygon)[..., 2]


@settings(deadline=None, max_examples=50)
@given(st.floats(0, 2 * math.pi), st.floats(-3, 3))
def test_both_sides_together_are_the_whole(turn: float, shift: float) -> None:
    star = torch.tensor(
        [[2, 0, 0], [0.3, 0.4, 0], [0, 2, 0], [-0.5, 0.2, 0], [-2, -1, 0], [0.2, -0.6, 0]],
        dtype=torch.float64,
    )
    height = star[:, 0] * math.cos(turn) + star[:, 1] * math.sin(turn) - shift
    above, below = clip_polygon(star, height), clip_polygon(star, -height)
    assert above.shape == (12, 3)
    assert_close(area(above) + area(below), area(star))
    kept = above[:, 0] * math.cos(turn) + above[:, 1] * math.sin(turn) - shift
    if bool((height > 0).any()):
        assert bool((kept > -1e-12).all())


def test_known_areas() -> None:
    for shift, left in ((-1.0, 4.0), (0.0, 4.0), (0.5, 3.0), (2.0, 0.0), (5.0, 0.0)):
        assert_close(area(clip_polygon(SQUARE, SQUARE[:, 0] - shift)), left, atol=1e-14)


def test_a_corner_on_the_plane_is_kept() -> None:
    diagonal = clip_polygon(SQUARE, SQUARE[:, 0] - SQUARE[:, 1])
    assert_close(area(diagonal), 2.0)
    assert torch.isfinite(diagonal).all()


def test_gradient(generator: torch.Generator) -> None:
    polygon = torch.randn(5, 3, dtype=torch.float64, generator=generator).requires_grad_()
    height = torch.randn(5, dtype=torch.float64, generator=generator).requires_grad_()
    assert gradcheck(clip_polygon, (polygon, height))
