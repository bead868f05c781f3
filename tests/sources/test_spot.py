"""Spot source: glTF's cone, its edges, narrow and hard cones."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.cases import directions, rand
from tests.tolerances import assert_close
from torchradiometry.errors import DegenerateGeometryError, OutOfRangeError, ShapeError
from torchradiometry.reference import closed_forms
from torchradiometry.sources import (
    PointSource,
    SpotSource,
    cone_attenuation,
    irradiance,
    spot_arrival,
)

DOUBLE = torch.float64
DOWN = [0.0, 0.0, -1.0]


def ray(angle: Tensor) -> Tensor:
    """Directions at an angle from -z."""
    return torch.stack([torch.sin(angle), torch.zeros_like(angle), -torch.cos(angle)], -1)


@pytest.mark.parametrize(
    ("inner", "outer"), [(0.0, 0.5), (0.3, 1.2), (0.0, math.pi / 2), (1e-3, 2e-3)]
)
@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_against_the_closed_form(inner: float, outer: float, dtype: torch.dtype) -> None:
    share = torch.tensor([0.0, 0.3, 0.5, 0.7, 0.9], dtype=DOUBLE)
    axis = torch.tensor(DOWN, dtype=dtype)
    direction = ray(inner + share * (outer - inner)).to(dtype)
    cones = torch.tensor([inner, outer], dtype=dtype)
    found = cone_attenuation(direction, axis, *cones)
    exact = torch.atan2(direction[:, 0].double(), -direction[:, 2].double())
    inner, outer = cones.tolist()
    expected = [closed_forms.spot_attenuation(a, inner, outer) for a in exact.tolist()]
    narrow = {"rtol": 1e-11} if outer < 0.01 and dtype == DOUBLE else {}
    assert_close(found, torch.tensor(expected, dtype=DOUBLE), **narrow)


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_whole_lamp_in_space(dtype: torch.dtype) -> None:
    lamp, axis = torch.tensor([[1.0, 2.0, 3.0]], dtype=dtype), torch.tensor([[1.0, 2, -2]])
    position = rand(30, 3, dtype=dtype, low=-1) + torch.tensor([1.5, 3.0, 1.5], dtype=dtype)
    power, inner, outer = (torch.tensor([[x]], dtype=dtype) for x in (7.0, 0.2, 0.6))
    found = spot_arrival(lamp, axis.to(dtype), power, inner, outer, position)
    offset = position.double() - lamp.double()
    r = offset.norm(dim=-1)
    unit = axis[0].double() / 3
    angle = torch.atan2(torch.linalg.cross(offset, unit.expand(30, 3)).norm(dim=-1), offset @ unit)
    expected = [
        closed_forms.spot_attenuation(a, inner.item(), outer.item())
        * closed_forms.inverse_square_irradiance(7.0, d)
        for a, d in zip(angle.tolist(), r.tolist(), strict=True)
    ]
    assert 0 < sum(e > 0 for e in expected) < 30
    assert_close(found.irradiance[0, :, 0], torch.tensor(expected, dtype=DOUBLE))


@given(inner=st.floats(0, 1.5), width=st.floats(0, 0.5), a=st.floats(0, 3.14), b=st.floats(0, 3.14))
@settings(deadline=None, max_examples=50)
def test_attenuation_falls_from_one_to_zero(inner: float, width: float, a: float, b: float) -> None:
    outer = min(inner + width, math.pi / 2)
    low, high = sorted((a, b))
    angle = torch.tensor([low, high, 0.0, outer + 1e-6], dtype=DOUBLE)
    cones = torch.tensor([inner, outer], dtype=DOUBLE)
    found = cone_attenuation(ray(angle), torch.tensor(DOWN, dtype=DOUBLE), *cones)
    assert ((found >= 0) & (found <= 1)).all()
    assert found[0] >= found[1] - 1e-12
    assert found[2] == 1
    assert found[3] == 0


@pytest.mark.parametrize("angle", [0.0, 0.4, math.pi / 2])
def test_hard_cone(angle: float) -> None:
    cone = torch.tensor(angle, dtype=DOUBLE, requires_grad=True)
    direction = ray(torch.tensor([0.0, angle - 1e-9, angle + 1e-7, 3.0], dtype=DOUBLE))
    direction.requires_grad_()
    found = cone_attenuation(direction, torch.tensor(DOWN, dtype=DOUBLE), cone, cone)
    assert found.tolist() == [1, 1 if angle else 0, 0, 0]
    found.sum().backward()
    assert (direction.grad == 0).all()
    assert (cone.grad == 0).all()


def test_soft_cone_tends_to_the_hard_one() -> None:
    direction, axis = ray(torch.tensor([0.3, 0.5]).double()), torch.tensor(DOWN).double()
    outer = torch.tensor(0.4, dtype=DOUBLE)
    hard = cone_attenuation(direction, axis, outer, outer)
    for gap in (1e-3, 1e-9, 1e-15, -0.1):
        assert_close(cone_attenuation(direction, axis, outer - gap, outer), hard)


def test_within_the_inner_cone_it_is_a_point_source() -> None:
    position, normal = rand(9, 3, dtype=DOUBLE), directions(9, dtype=DOUBLE)
    place, power = torch.tensor([0.5, 0.5, 9]).double(), torch.tensor([3.0, 4.0]).double()
    spot = SpotSource(place, torch.tensor(DOWN).double(), power, 1.0, 1.2)
    for a, b in zip(spot(position, normal), PointSource(place, power)(position, normal)):  # noqa: B905
        assert_close(a, b)
    away = SpotSource(place, -torch.tensor(DOWN).double(), power, 1.0, 1.2)
    assert (away(position, normal).irradiance == 0).all()


def test_gradients() -> None:
    lamp = directions(2, dtype=DOUBLE) * 2
    axis = -lamp.detach() + 0.3
    cones = torch.tensor([[0.05], [0.1]]), torch.tensor([[0.9], [1.2]])
    position, normal = rand(4, 3, dtype=DOUBLE), directions(4, dtype=DOUBLE, seed=1)
    tensors = (lamp, axis, rand(2, 3, dtype=DOUBLE), *cones, position, normal)
    inputs = tuple(t.double().requires_grad_() for t in tensors)

    def on_surface(*args: Tensor) -> Tensor:
        return irradiance(spot_arrival(*args[:-1]), args[-1])

    assert (on_surface(*inputs) > 0).any()
    assert gradcheck(on_surface, inputs)


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_finite_everywhere(dtype: torch.dtype) -> None:
    r = torch.logspace(-45, 30, 76, dtype=DOUBLE).to(dtype)
    down = torch.tensor([[0.0, 0.0, -1.0], [0.3, 0, -0.9], [1.0, 0.0, 0.0], [0, 0, 1]]).to(dtype)
    position = (r[:, None, None] * down).reshape(-1, 3).requires_grad_()
    lamp = SpotSource(
        torch.zeros(3, dtype=dtype),
        torch.tensor(DOWN, dtype=dtype),
        torch.tensor([100.0], dtype=dtype),
        torch.tensor(0.0, dtype=dtype),
        torch.tensor(0.5, dtype=dtype),
        learnable=True,
    )
    normal = -torch.tensor(DOWN, dtype=dtype).expand_as(position)
    found = irradiance(lamp(position, normal), normal)
    assert torch.isfinite(found).all()
    found.clamp(max=1e25).sum().backward()
    for t in (position, *lamp.parameters()):
        assert torch.isfinite(t.grad).all()


@given(scale=st.floats(1e-3, 1e3))
@settings(deadline=None, max_examples=20)
def test_scale_laws(scale: float) -> None:
    lamp, axis = directions(2, dtype=DOUBLE), -directions(2, dtype=DOUBLE)
    power, position = rand(2, 1, dtype=DOUBLE), rand(5, 3, dtype=DOUBLE) - 0.5
    cones = torch.tensor([[0.1], [0.2]]).double(), torch.tensor([[1.0], [0.9]]).double()
    one = spot_arrival(lamp, axis, power, *cones, position)
    large = spot_arrival(lamp * scale, axis * 7, power * scale**2, *cones, position * scale)
    assert_close(large.irradiance, one.irradiance, rtol=1e-11)


def test_parameters_per_image_match_single_images() -> None:
    lamp, power = directions(2, 3, dtype=DOUBLE) * 2, rand(2, 3, 1, dtype=DOUBLE)
    inner, outer = rand(2, 3, 1, dtype=DOUBLE, high=0.2), rand(2, 3, 1, dtype=DOUBLE, low=0.4)
    position, normal = rand(2, 7, 3, dtype=DOUBLE), directions(2, 7, dtype=DOUBLE)
    reach = SpotSource(lamp, -lamp, power, inner, outer)(position, normal)
    assert reach.irradiance.shape == (3, 2, 7, 1)
    for i in range(2):
        one = SpotSource(lamp[i], -lamp[i], power[i], inner[i], outer[i])
        assert_close(reach.irradiance[:, i], one(position[i], normal[i]).irradiance)


def test_learns_its_cone() -> None:
    position = torch.cartesian_prod(*[torch.linspace(-1, 1, 9, dtype=DOUBLE)] * 2)
    position = torch.nn.functional.pad(position, (0, 1))
    normal = -torch.tensor(DOWN, dtype=DOUBLE).expand_as(position)

    def build(inner: float, outer: float, learnable: bool) -> SpotSource:
        lamp = SpotSource([0, 0, 2.0], DOWN, [5.0], inner, outer, learnable=learnable)
        return lamp.double()

    target = irradiance(build(0.2, 0.5, False)(position, normal), normal)
    guess = build(0.1, 0.7, True)
    optimizer = torch.optim.Adam([guess.inner_cone, guess.outer_cone], lr=0.02)
    for _ in range(300):
        optimizer.zero_grad()
        loss = (irradiance(guess(position, normal), normal) - target).square().sum()
        loss.backward()
        optimizer.step()
    assert abs(abs(guess.inner_cone.item()) - 0.2) < 0.01  # the formula is even in it
    assert abs(guess.outer_cone.item() - 0.5) < 0.01


def test_mistakes_are_named() -> None:
    build = lambda *cones: SpotSource([0, 0, 2.0], DOWN, [5.0], *cones)  # noqa: E731
    with pytest.raises(OutOfRangeError, match=r"outer_cone.*radians.*degrees"):
        build(10.0 / 57.3, 30.0)
    with pytest.raises(OutOfRangeError, match=r"inner_cone.*radians"):
        build(-0.1, 0.3)
    with pytest.raises(OutOfRangeError, match="at most outer_cone"):
        build(0.4, 0.3)
    with pytest.raises(DegenerateGeometryError, match="axis"):
        SpotSource([0, 0, 2.0], [0, 0, 0], [5.0])
    with pytest.raises(ShapeError, match="inner_cone"):
        build([0.1, 0.2], 0.3)
    with pytest.raises(ShapeError, match="SpotSource is near"):
        build(0.1, 0.2)(None, torch.zeros(1, 3))
    assert build(math.pi / 2, math.pi / 2).outer_cone.dtype == torch.get_default_dtype()
    assert "rad" in repr(build(0.1, 0.2))
