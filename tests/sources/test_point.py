"""Point source: the inverse square, over the whole range of the dtype, with its gradients."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.cases import directions, rand
from tests.tolerances import assert_close
from torchradiometry.errors import InvalidValueError, ShapeError
from torchradiometry.reference import closed_forms
from torchradiometry.sources import (
    DirectionalSource,
    PointSource,
    irradiance,
    lamp_radius,
    point_arrival,
)

DOUBLE = torch.float64
UP = [0.0, 0.0, 1.0]


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_against_the_closed_form(dtype: torch.dtype) -> None:
    distance, tilt = [0.01, 0.7, 1.0, 30.0], 0.6
    direction = torch.tensor([0.48, 0.64, 0.6], dtype=dtype)
    direction = direction / direction.norm()
    position = -torch.tensor(distance, dtype=dtype)[:, None] * direction
    reach = point_arrival(
        torch.zeros(1, 3, dtype=dtype), torch.tensor([[3.0, 5.0]], dtype=dtype), position
    )
    true = position.double().norm(dim=-1).tolist()
    for channel, intensity in enumerate((3.0, 5.0)):
        expected = [closed_forms.inverse_square_irradiance(intensity, r) for r in true]
        assert_close(reach.irradiance[0, :, channel], torch.tensor(expected, dtype=DOUBLE), atol=0)
    assert_close(reach.distance[0], torch.tensor(true, dtype=DOUBLE), atol=0)
    assert_close(reach.direction[0], direction.expand(4, 3))
    # tilted by `tilt`: the cosine comes with the surface
    side = torch.nn.functional.normalize(torch.linalg.cross(direction, direction.roll(1)), dim=0)
    normal = (math.cos(tilt) * direction + math.sin(tilt) * side).expand(4, 3)
    on_surface = irradiance(reach, normal)[:, 0]
    expected = [closed_forms.inverse_square_irradiance(3.0, r, tilt) for r in true]
    assert_close(on_surface, torch.tensor(expected, dtype=DOUBLE))


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
@pytest.mark.parametrize("intensity", [1e-6, 1.0, 1e3])
def test_whole_range_of_distances(dtype: torch.dtype, intensity: float) -> None:
    r = torch.logspace(-12, 12, 25, dtype=DOUBLE).to(dtype)
    position = (r[:, None] * torch.tensor([0.6, 0.0, -0.8], dtype=dtype)).requires_grad_()
    power = torch.tensor([[intensity]], dtype=dtype, requires_grad=True)
    reach = point_arrival(torch.zeros(1, 3, dtype=dtype), power, position)
    true = position.detach().double().norm(dim=-1)
    expected = power.item() / true**2
    assert_close(reach.irradiance[0, :, 0], expected, atol=torch.finfo(dtype).smallest_normal)
    assert_close(reach.distance[0], true, atol=0)
    reach.irradiance.sum().backward()
    slope = (position.grad.double() * position.detach().double()).sum(-1) / true
    held = 8 * expected / true < torch.finfo(dtype).max
    assert torch.isfinite(position.grad).all()
    assert_close(slope[held].to(dtype), (-2 * expected / true)[held], rtol=1e-5, atol=1e-37)
    assert torch.isfinite(power.grad).all()


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
@pytest.mark.parametrize("fraction", [0.0, 1e-3, 0.5, 0.999])
def test_on_the_lamp_there_is_no_light_and_no_gradient(dtype: torch.dtype, fraction: float) -> None:
    lamp = torch.zeros(1, 3, dtype=dtype, requires_grad=True)
    position = torch.tensor([[0.0, 0.0, -fraction * lamp_radius(dtype)]], dtype=dtype)
    position.requires_grad_()
    power = torch.tensor([[5.0]], dtype=dtype, requires_grad=True)
    reach = point_arrival(lamp, power, position)
    assert (reach.irradiance == 0).all()
    assert (reach.direction == 0).all()
    assert (reach.distance == 0).all()
    sum(t.sum() for t in reach).backward()
    for t in (lamp, power, position):
        assert (t.grad == 0).all()


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_gradient_is_finite_through_a_shader_at_any_distance(dtype: torch.dtype) -> None:
    r = torch.logspace(-45, 30, 76, dtype=DOUBLE).to(dtype)
    position = (r[:, None] * torch.tensor([0.6, 0.0, -0.8], dtype=dtype)).requires_grad_()
    power = torch.tensor([[1e4]], dtype=dtype, requires_grad=True)
    normal = torch.tensor(UP, dtype=dtype).expand(76, 3).clone().requires_grad_()
    on_surface = irradiance(point_arrival(torch.zeros(1, 3, dtype=dtype), power, position), normal)
    assert torch.isfinite(on_surface).all()
    on_surface.clamp(max=1e30).sum().backward()
    assert torch.isfinite(position.grad).all()
    assert torch.isfinite(normal.grad).all()
    assert torch.isfinite(power.grad).all()


def test_gradients() -> None:
    lamp = directions(2, dtype=DOUBLE) * 2
    position, normal = rand(4, 3, dtype=DOUBLE), directions(4, dtype=DOUBLE, seed=1)
    inputs = tuple(
        t.requires_grad_() for t in (lamp, rand(2, 3, dtype=DOUBLE, seed=1), position, normal)
    )

    def on_surface(lamp: Tensor, power: Tensor, position: Tensor, normal: Tensor) -> Tensor:
        return irradiance(point_arrival(lamp, power, position), normal)

    assert gradcheck(on_surface, inputs)
    assert gradcheck(lambda *a: tuple(point_arrival(*a)), inputs[:3])


@given(scale=st.floats(1e-3, 1e3), seed=st.integers(0, 50))
@settings(deadline=None, max_examples=30)
def test_scale_laws(scale: float, seed: int) -> None:
    """Twice as large a scene: a quarter of the light; twice the power: twice the light."""
    lamp, power = directions(2, dtype=DOUBLE, seed=seed), rand(2, 3, dtype=DOUBLE, seed=seed)
    position = rand(5, 3, dtype=DOUBLE, seed=seed + 1) - 2
    one = point_arrival(lamp, power, position)
    large = point_arrival(lamp * scale, power, position * scale)
    assert_close(large.irradiance, one.irradiance / scale**2, atol=0)
    assert_close(large.distance, one.distance * scale, atol=0)
    assert_close(large.direction, one.direction)
    bright = point_arrival(lamp, power * scale, position)
    assert_close(bright.irradiance, one.irradiance * scale, atol=0)


@given(seed=st.integers(0, 50))
@settings(deadline=None, max_examples=20)
def test_flux_through_a_sphere_is_four_pi_intensity(seed: int) -> None:
    """Gauss: the irradiance on a closed surface around the lamp adds up to its flux."""
    lamp = 0.3 * directions(1, dtype=DOUBLE, seed=seed)
    z, w = (torch.from_numpy(a) for a in np.polynomial.legendre.leggauss(40))
    phi = torch.arange(80, dtype=DOUBLE) * 2 * math.pi / 80
    ring = (1 - z**2).sqrt()
    x = torch.stack(
        [ring[:, None] * phi.cos(), ring[:, None] * phi.sin(), z[:, None].expand(40, 80)], -1
    ).reshape(-1, 3)
    area = (w * 2 * math.pi / 80)[:, None].expand(40, 80).reshape(-1)
    inside = irradiance(point_arrival(lamp, torch.tensor([[2.0]], dtype=DOUBLE), x), -x)[:, 0]
    assert_close((inside * area).sum(), 8 * math.pi, rtol=1e-10)


def test_far_away_it_is_a_directional_source() -> None:
    position, normal = rand(6, 3, dtype=DOUBLE), directions(6, dtype=DOUBLE)
    far = PointSource(torch.tensor([3e6, 0, 4e6]).double(), torch.tensor([25e12]).double())
    sun = DirectionalSource(torch.tensor([0.6, 0, 0.8]).double(), torch.tensor([1.0]).double())
    near, distant = (irradiance(s(position, normal), normal) for s in (far, sun))
    assert_close(near, distant, rtol=1e-5)


def test_parameters_per_image_match_single_images() -> None:
    lamp, power = directions(2, 3, dtype=DOUBLE) * 2, rand(2, 3, 1, dtype=DOUBLE)
    position, normal = rand(2, 7, 3, dtype=DOUBLE), directions(2, 7, dtype=DOUBLE)
    reach = PointSource(lamp, power)(position, normal)
    assert reach.irradiance.shape == (3, 2, 7, 1)
    for image in range(2):
        one = PointSource(lamp[image], power[image])(position[image], normal[image])
        for whole, part in zip(reach, one, strict=True):
            assert_close(whole[:, image], part)


def test_learns_where_the_lamp_is() -> None:
    position = rand(20, 3, dtype=DOUBLE, low=-1) * torch.tensor([1, 1, 0.1])
    normal = torch.tensor(UP, dtype=DOUBLE).expand(20, 3)
    true = PointSource(torch.tensor([0.2, -0.1, 1.5]).double(), torch.tensor([4.0]).double())
    target = irradiance(true(position, normal), normal)
    guess = PointSource(
        torch.tensor([0.0, 0, 2]).double(), torch.tensor([2.0]).double(), learnable=True
    )
    optimizer = torch.optim.LBFGS(guess.parameters(), max_iter=100, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        optimizer.zero_grad()
        loss = (irradiance(guess(position, normal), normal) - target).square().sum()
        loss.backward()
        return loss

    optimizer.step(closure)
    assert_close(guess.position, true.position, rtol=1e-3, atol=1e-3)
    assert_close(guess.intensity, true.intensity, rtol=1e-3)


def test_mistakes_are_named() -> None:
    with pytest.raises(ShapeError, match="position"):
        PointSource([0.0, 1.0], [1.0])
    with pytest.raises(InvalidValueError, match="intensity"):
        PointSource(UP, [math.nan])
    with pytest.raises(ShapeError, match="PointSource is near"):
        PointSource(UP, [1.0])(None, torch.tensor([UP]))
    assert "W/sr" in repr(PointSource(UP, [1.0]))
