"""Sphere source: closed forms, 40-digit references, brute force, every position of the horizon."""

import math

import mpmath
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import RELATIVE, assert_close
from torchradiometry.errors import InvalidValueError, OutOfRangeError, ShapeError
from torchradiometry.geometry import hemisphere_quadrature
from torchradiometry.sources import SphereSource, irradiance, sphere_vector_irradiance
from torchradiometry.sources.sphere_irradiance import sphere_irradiance

mpmath.mp.dps = 40
DTYPES = [torch.float64, torch.float32]
Z = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


def exact(offset: Tensor, normal: Tensor, radius: Tensor) -> mpmath.mpf:
    """n . Phi in 40 digits, by the textbook's order of terms (Lagarde and de Rousiers 2014)."""
    o, n = ([mpmath.mpf(float(x)) for x in v] for v in (offset, normal))
    size = mpmath.sqrt(mpmath.fdot(o, o))
    h = size / mpmath.mpf(float(radius))
    cosine = mpmath.fdot(n, o) / size
    if abs(cosine) * h >= 1:
        return mpmath.pi / h**2 * max(cosine, 0)
    sine = mpmath.sqrt(1 - cosine**2)
    x = mpmath.sqrt(h**2 - 1)
    y = -x * cosine / sine
    root = sine * mpmath.sqrt(1 - y**2)
    return (cosine * mpmath.acos(y) - x * root) / h**2 + mpmath.atan(root / x)


def direction(polar: float) -> Tensor:
    return torch.tensor([math.sin(polar), 0.0, math.cos(polar)], dtype=torch.float64)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("distance", [1.001, 1.2, 2.0, 10.0, 1e4])
@pytest.mark.parametrize("share", [-0.99, -0.9, -0.5, -0.1, 0.0, 0.3, 0.7, 0.99, 1.01, 2.0])
def test_every_height_over_the_horizon(dtype: torch.dtype, distance: float, share: float) -> None:
    """`share` of the angular radius: -1 just below the horizon, 1 just wholly above.

    The height over the horizon in units of the radius is one rounding of the input uncertain,
    eps * distance / radius, and E falls with its power 5/2 when the sphere sinks.
    """
    sigma = math.asin(1 / distance)
    polar = min(max(math.pi / 2 - share * sigma, 0.0), math.pi)
    offset = (distance * direction(polar)).to(dtype)
    one, normal = torch.ones((), dtype=dtype), Z.to(dtype)
    phi = sphere_vector_irradiance(offset, normal, one)
    truth = exact(offset, normal, one)
    conditioning = 10 * torch.finfo(torch.float64).eps * distance / (1 + share)
    assert abs(mpmath.mpf(float(phi[2])) - truth) <= (RELATIVE[dtype] + conditioning) * truth
    lamp = SphereSource(offset[None], one[None, None], one[None, None])
    arrival = lamp(torch.zeros(1, 3, dtype=dtype), normal[None])
    assert_close(arrival.direction.norm(dim=-1), torch.ones(1, 1))
    e = irradiance(arrival, normal[None])[0, 0]
    assert abs(mpmath.mpf(float(e)) - truth) <= (RELATIVE[dtype] * 2 + conditioning * 10) * truth


@settings(deadline=None, max_examples=20)
@given(st.floats(0, math.pi), st.floats(1.05, 5))
def test_brute_force_over_the_cap(polar: float, distance: float) -> None:
    """The vector, summed over a cap of directions, cut at the horizon."""
    axis = direction(polar)
    rule = hemisphere_quadrature(400, 800, dtype=torch.float64)
    top = 1 - math.sqrt(1 - distance**-2)
    height = 1 - (1 - rule.direction[:, 2]) * top
    ring = ((1 - height) * (1 + height)).sqrt()
    flat = torch.nn.functional.normalize(rule.direction[:, :2], dim=-1) * ring[:, None]
    across = torch.tensor([axis[2], 0.0, -axis[0]], dtype=torch.float64)
    third = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    w = flat[:, :1] * across + flat[:, 1:] * third + height[:, None] * axis
    brute = (w * (rule.weight * top * (w[:, 2] > 0))[:, None]).sum(0)
    phi = sphere_vector_irradiance(distance * axis, Z, torch.ones((), dtype=torch.float64))
    # a jump on the horizon: the sum is right to the share of nodes next to it, squared for E
    assert_close(phi, brute, atol=5e-3 * top, rtol=1e-3)
    assert_close(phi[2], brute[2], atol=2e-5 * top, rtol=1e-4)


def test_inverse_square_while_wholly_above() -> None:
    """E = pi L (r / d)^2 cos, Forsyth and Ponce's sphere far and near alike."""
    d = torch.tensor([1.5, 3.0, 10.0, 1e6], dtype=torch.float64)
    lamp = SphereSource([[0.0, 0.0, 0.0]], [[1.0]], [[2.0, 3.0]]).double()
    e = irradiance(lamp(d[:, None] * Z, -Z.expand(4, 3)), -Z.expand(4, 3))
    assert_close(e, 2 * math.pi / d[:, None] ** 2 * torch.tensor([1.0, 1.5]))


def test_inside_and_on_the_surface() -> None:
    lamp = SphereSource([[0.0, 0.0, 0.0]], [[2.0]], [[1.0]]).double()
    normal = torch.nn.functional.normalize(torch.tensor([[1.0, 2, 3]] * 4).double(), dim=-1)
    inside = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 0, 1.999], [-1, -1, 1]]).double()
    arrival = lamp(inside, normal)
    assert_close(irradiance(arrival, normal), math.pi)
    hit = inside + arrival.distance[0, :, None] * arrival.direction[0]
    assert_close(hit.norm(dim=-1), 2.0)
    surface = torch.tensor([[0.0, 0, 2]]).double()
    for cosine in (1.0, 0.5, 0.0, -0.5):
        tilted = torch.tensor([[math.sqrt(1 - cosine**2), 0, -cosine]]).double()
        e = irradiance(lamp(surface, tilted), tilted)
        assert_close(e, math.pi / 2 * (1 + cosine), atol=1e-7)


def test_distance_is_where_the_direction_meets_the_sphere() -> None:
    lamp = SphereSource([[0.5, 0.0, 1.0]], [[0.8]], [[1.0]]).double()
    position = torch.tensor([[0.0, 0, 0], [1.5, 0, 0.9], [-3, 1, 1.5]]).double()
    normal = Z.expand(3, 3)
    arrival = lamp(position, normal)
    hit = position + arrival.distance[0, :, None] * arrival.direction[0]
    assert_close((hit - lamp.center).norm(dim=-1), lamp.radius[0, 0])


@pytest.mark.parametrize("dtype", DTYPES)
def test_samples_converge_to_the_exact_irradiance(dtype: torch.dtype) -> None:
    position = torch.tensor([[0.0, 0, 0], [1.1, 0, 0.9], [-3, 1, 1.1]], dtype=dtype)
    normal = Z.to(dtype).expand(3, 3)
    center, radius, radiance = [[0.5, 0.0, 1.0], [0.0, 2.0, 0.1]], [[0.4], [0.5]], [[1.0], [2.0]]
    truth = irradiance(SphereSource(center, radius, radiance).to(dtype)(position, normal), normal)
    errors = []
    for samples in (100, 10000):
        lamp = SphereSource(center, radius, radiance, samples=samples).to(dtype)
        arrival = lamp(position, normal)
        assert arrival.direction.shape == (2 * samples, 3, 3)
        assert lamp.lights == 2 * samples
        assert bool((arrival.irradiance >= 0).all())
        errors.append(float((irradiance(arrival, normal) / truth - 1).abs().max()))
    assert errors[1] < 2e-3
    assert errors[1] < errors[0] / 10


@pytest.mark.parametrize("samples", [1, 3])
def test_gradients(samples: int, generator: torch.Generator) -> None:
    position = torch.tensor(
        [[0.0, 0, 0], [0.1, 0.0, 0.9], [-3, 1, 1.1], [0.6, 0.1, 1.1], [1.0, 0, 1.6]]
    ).double()
    normal = torch.nn.functional.normalize(
        Z + 0.3 * torch.randn(5, 3, dtype=torch.float64, generator=generator), dim=-1
    )
    lamp = SphereSource([[0.5, 0, 1], [1, 2, 0.1]], [[0.4], [0.5]], [[1.0, 2], [3, 4]],
                        samples=samples, learnable=True).double()  # fmt: skip
    names = [name for name, _ in lamp.named_parameters()]
    assert names == ["center", "radius", "radiance"]

    def run(x: Tensor, n: Tensor, *held: Tensor) -> tuple[Tensor, ...]:
        parameters = dict(zip(names, held, strict=True))
        return tuple(torch.func.functional_call(lamp, parameters, (x, n)))

    held = [p.detach().clone().requires_grad_() for p in lamp.parameters()]
    assert gradcheck(run, (position.requires_grad_(), normal.requires_grad_(), *held))


@pytest.mark.parametrize("samples", [1, 4])
def test_one_lamp_per_image(samples: int) -> None:
    center = torch.tensor([[[0.0, 0, 2]], [[1, 0, 2]]]).double()
    radius, radiance = torch.full((2, 1, 1), 0.5).double(), torch.ones(2, 1, 3).double()
    position, normal = torch.zeros(2, 5, 3).double(), Z.expand(2, 5, 3)
    together = SphereSource(center, radius, radiance, samples=samples)(position, normal)
    assert together.irradiance.shape == (samples, 2, 5, 3)
    for i in range(2):
        one = SphereSource(center[i], radius[i], radiance[i], samples=samples)
        alone = one(position[i], normal[i])
        for a, b in zip(together, alone, strict=True):
            assert_close(a[:, i], b)


def test_finite_on_the_center_and_at_radius_zero() -> None:
    for radius in (0.0, 1.0):
        for samples in (1, 4):
            lamp = SphereSource([[0.0, 0, 0]], [[radius]], [[1.0]], samples=samples, learnable=True)
            position = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]], requires_grad=True)
            e = irradiance(lamp(position, Z.float().expand(3, 3)), Z.float())
            e.sum().backward()
            assert torch.isfinite(e).all()
            for tensor in (position, *lamp.parameters()):
                assert torch.isfinite(tensor.grad).all()


def test_named_errors() -> None:
    with pytest.raises(OutOfRangeError, match="radius"):
        SphereSource([0.0, 0, 1], [-1.0], [1.0])
    with pytest.raises(OutOfRangeError, match="radiance"):
        SphereSource([0.0, 0, 1], [1.0], [-1.0])
    with pytest.raises(OutOfRangeError, match="samples"):
        SphereSource([0.0, 0, 1], [1.0], [1.0], samples=0)
    with pytest.raises(ShapeError, match="center"):
        SphereSource([0.0, 0], [1.0], [1.0])
    with pytest.raises(InvalidValueError, match="radiance"):
        SphereSource([0.0, 0, 1], [1.0], [math.nan])
    with pytest.raises(ShapeError, match="position"):
        SphereSource([0.0, 0, 1], [1.0], [1.0])(None, torch.ones(1, 3))


@pytest.mark.parametrize("distance", [1.0, 1e6, 1e12])
def test_a_point_without_a_normal_receives_nothing_however_far(distance: float) -> None:
    offset = torch.tensor([[0.3, 0.1, 0.9]], dtype=torch.float64) * distance
    none = torch.zeros(1, 3, dtype=torch.float64, requires_grad=True)
    found = sphere_irradiance(offset, none, torch.tensor([0.2], dtype=torch.float64))
    assert found.item() == 0
    found.sum().backward()
    assert none.grad is not None
    assert none.grad.isfinite().all()
