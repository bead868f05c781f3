"""Powers of a cosine: agreement with the plain power, and digits where that has none."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.cases import directions
from tests.tolerances import assert_close
from torchradiometry.materials.lobes import cosine_power
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
