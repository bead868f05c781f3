"""Powers of a cosine: agreement with the plain power, and digits where that has none."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.cases import directions
from tests.tolerances import assert_close
from torchradiometry.materials.lobes import cosine_power, half_vector_lobe, mirror_lobe
from torchradiometry.numerics import power_lobe

DOUBLE = torch.float64


@given(n=st.floats(0, 30), seed=st.integers(0, 100))
@settings(deadline=None, max_examples=30)
def test_is_the_power_lobe(n: float, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    a, b = torch.nn.functional.normalize(
        torch.randn(2, 20, 3, dtype=DOUBLE, generator=generator), dim=-1
    )
    exponent = torch.full((20, 1), n, dtype=DOUBLE)
    plain = power_lobe((a * b).sum(-1, keepdim=True), exponent)
    # both have the rounding of the cosine, times n / cosine
    assert_close(cosine_power(a, b, exponent), plain, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("n", [1e2, 1e6, 1e10])
def test_gaussian_limit(n: float) -> None:
    """cos^n(x / sqrt(n)) = exp(-x^2/2) (1 - x^4 / (12 n) + ...)."""
    x = torch.tensor([0.0, 0.1, 1.0, 2.0], dtype=DOUBLE)
    alpha = x / math.sqrt(n)
    a = torch.stack([torch.sin(alpha), torch.zeros_like(alpha), torch.cos(alpha)], -1)
    up = torch.tensor([0, 0, 1.0], dtype=DOUBLE)
    found = cosine_power(a, up, torch.tensor([n], dtype=DOUBLE)).squeeze(-1)
    series = torch.exp(-(x**2) / 2) * (1 - x**4 / (12 * n))
    assert_close(found, series, rtol=1e-12 + 10 / n**2)


def test_opposite_and_square_directions_have_no_lobe() -> None:
    a = directions(5, dtype=DOUBLE).requires_grad_()
    side = torch.linalg.cross(a, torch.tensor([0, 1.0, 0], dtype=DOUBLE).expand(5, 3))
    n = torch.tensor([3.0], dtype=DOUBLE)
    for b in (-a, torch.nn.functional.normalize(side, dim=-1)):
        value = cosine_power(a, b, n)
        assert (value < 1e-40).all()
        value.sum().backward(retain_graph=True)
        assert torch.isfinite(a.grad).all()


@pytest.mark.parametrize("lobe", [mirror_lobe, half_vector_lobe])
@pytest.mark.parametrize("n", [0.0, 1.0, 30.0, 1e4, 1e6])
def test_single_precision_takes_the_short_way_to_the_same_lobe(lobe, n: float) -> None:
    generator = torch.Generator().manual_seed(3)
    normal, towards = torch.randn(2, 400, 3, generator=generator)
    normal = torch.nn.functional.normalize(normal, dim=-1)
    wi = torch.nn.functional.normalize(normal + 0.5 * towards, dim=-1)
    tilt = torch.randn(400, 3, generator=generator) / (1 + n) ** 0.5
    wo = torch.nn.functional.normalize(2 * (wi * normal).sum(-1, keepdim=True) * normal - wi + tilt)
    exponent = torch.full((400, 1), n)
    results = []
    for dtype in (torch.float32, torch.float64):
        leaves = [t.to(dtype).requires_grad_() for t in (wi, wo, normal, exponent)]
        value = lobe(*leaves)
        results.append((value.detach(), torch.autograd.grad(value.sum(), leaves)))
    (short, short_gradients), (long, long_gradients) = results
    # a fraction of float32's rounding, 6e-8, which the result is stored with
    torch.testing.assert_close(short, long, rtol=2e-8, atol=1e-12)
    for a, b in zip(short_gradients, long_gradients, strict=True):
        torch.testing.assert_close(a.double(), b, rtol=1e-5, atol=1e-5 * float(b.abs().max() + 1))


@pytest.mark.parametrize("lobe", [mirror_lobe, half_vector_lobe])
@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_expanded_directions_are_those_directions(lobe, dtype: torch.dtype) -> None:
    """Also where the normals repeat or have fewer axes, which must not change the shape."""
    wi, wo = directions(2, dtype=dtype, seed=1), directions(1, dtype=dtype, seed=2)
    wi, wo = wi.reshape(2, 1, 1, 3).expand(2, 4, 5, 3), wo.expand(4, 5, 3)
    many, one = directions(4, 5, dtype=dtype, seed=3), directions(1, dtype=dtype, seed=4)
    exponent = torch.tensor([7.0], dtype=dtype)
    for normal in (many, one.expand(4, 5, 3), one[0]):
        found = lobe(wi, wo, normal, exponent)
        assert found.shape == (2, 4, 5, 1)
        assert_close(found, lobe(wi.clone(), wo.clone(), normal.clone(), exponent))
