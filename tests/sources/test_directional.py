"""Directional source: the same everywhere, the cosine law, both routes to the irradiance."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.autograd import gradcheck

from tests.cases import directions, rand
from tests.tolerances import assert_close
from torchradiometry.errors import InvalidValueError, ShapeError
from torchradiometry.sources import (
    DirectionalSource,
    directional_arrival,
    directional_irradiance,
    irradiance,
)

DOUBLE = torch.float64


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2, 1.57, 2.0, math.pi])
def test_cosine_law(angle: float, dtype: torch.dtype) -> None:
    sun = torch.tensor([[math.sin(angle), 0.0, math.cos(angle)]], dtype=dtype)
    normal = torch.tensor([[0.0, 0.0, 1.0]], dtype=dtype)
    source = DirectionalSource(sun * 5, torch.tensor([[3.0, 4.0]], dtype=dtype))
    unit = sun.double() / sun.double().norm()
    expected = unit[..., 2].clamp(min=0) * torch.tensor([3.0, 4.0], dtype=DOUBLE)
    assert_close(irradiance(source(None, normal), normal), expected[None].to(dtype)[0])
    assert_close(source.irradiance_on(None, normal), expected[None].to(dtype)[0])


def test_same_everywhere_from_infinity() -> None:
    normal = directions(4, 5, dtype=DOUBLE)
    source = DirectionalSource(directions(2, dtype=DOUBLE), rand(2, 3, dtype=DOUBLE))
    reach = source(None, normal)
    assert reach.direction.shape == (2, 4, 5, 3)
    assert torch.isinf(reach.distance).all()
    assert (reach.irradiance == reach.irradiance[:, :1, :1]).all()
    assert not source.needs_position


def test_both_routes_agree_with_visibility_and_batches() -> None:
    normal = directions(3, 7, dtype=DOUBLE)
    visibility = rand(2, 3, 7, dtype=DOUBLE)
    for shape in ((2,), (3, 2)):
        sun, power = directions(*shape, dtype=DOUBLE, seed=1), rand(*shape, 4, dtype=DOUBLE)
        slow = irradiance(directional_arrival(sun, power, normal), normal, visibility)
        assert_close(directional_irradiance(sun, power, normal, visibility), slow)
    for image in range(3):
        one = directional_irradiance(sun[image], power[image], normal[image], visibility[:, image])
        assert_close(slow[image], one)


@given(scale=st.floats(1e-6, 1e6), stretch=st.floats(1e-6, 1e6))
@settings(deadline=None, max_examples=30)
def test_linear_in_irradiance_and_blind_to_the_length_of_the_direction(
    scale: float, stretch: float
) -> None:
    sun, power = directions(2, dtype=DOUBLE), rand(2, 3, dtype=DOUBLE)
    normal = directions(5, dtype=DOUBLE, seed=1)
    one = directional_irradiance(sun, power, normal)
    assert_close(directional_irradiance(sun * stretch, power * scale, normal), one * scale)


def test_gradients() -> None:
    sun, power = directions(2, dtype=DOUBLE), rand(2, 3, dtype=DOUBLE)
    normal, visibility = directions(4, dtype=DOUBLE, seed=1), rand(2, 4, dtype=DOUBLE)
    inputs = tuple(t.requires_grad_() for t in (sun, power, normal, visibility))
    assert gradcheck(directional_irradiance, inputs)
    assert gradcheck(lambda s, p, n, v: irradiance(directional_arrival(s, p, n), n, v), inputs)


def test_a_direction_of_length_zero_gives_no_light() -> None:
    sun = torch.zeros(1, 3, requires_grad=True)
    normal = torch.tensor([[0.0, 0.0, 1.0]])
    found = directional_irradiance(sun, torch.ones(1, 1), normal)
    found.sum().backward()
    assert (found == 0).all()
    assert (sun.grad == 0).all()


def test_learns_its_direction() -> None:
    normal = directions(30, dtype=DOUBLE)
    true = DirectionalSource(torch.tensor([0.3, 0.4, 0.5]).double(), torch.tensor([2.0]).double())
    target = true.irradiance_on(None, normal)
    guess = DirectionalSource([0.0, 0.0, 1.0], [1.0], learnable=True).double()
    optimizer = torch.optim.LBFGS(guess.parameters(), max_iter=60, line_search_fn="strong_wolfe")

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        loss = (guess.irradiance_on(None, normal) - target).square().sum()
        loss.backward()
        return loss

    optimizer.step(closure)
    unit = torch.nn.functional.normalize(guess.direction.detach(), dim=-1)
    assert_close(unit, torch.nn.functional.normalize(true.direction, dim=-1), rtol=1e-4)
    assert_close(guess.irradiance, true.irradiance, rtol=1e-4)


def test_mistakes_are_named() -> None:
    with pytest.raises(ShapeError, match="direction"):
        DirectionalSource([0.0, 1.0], [1.0])
    with pytest.raises(InvalidValueError, match="irradiance"):
        DirectionalSource([0.0, 0.0, 1.0], [math.inf])
    assert "W/m2" in repr(DirectionalSource([0.0, 0.0, 1.0], [1.0]))
