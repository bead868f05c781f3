"""The integrals of the lecture over the hemisphere, and what the rule promises."""

import math

import pytest
import torch

from tests.tolerances import assert_close
from torchradiometry.errors import OutOfRangeError
from torchradiometry.geometry import hemisphere_quadrature, integrate_hemisphere

DTYPES = [torch.float64, torch.float32]


@pytest.mark.parametrize("dtype", DTYPES)
def test_solid_angle_and_cosine(dtype: torch.dtype) -> None:
    rule = hemisphere_quadrature(4, 8, dtype=dtype)
    assert_close(rule.weight.sum(), 2 * math.pi)
    assert_close(integrate_hemisphere(lambda w: w[..., 2], rule), math.pi)
    assert_close(rule.direction.norm(dim=-1), torch.ones(32))


@pytest.mark.parametrize("exponent", [0, 1, 2, 7, 15])
def test_cosine_lobes(exponent: int) -> None:
    """Integral of cos^n is 2 pi / (n + 1), of cos^n times the cosine 2 pi / (n + 2)."""
    rule = hemisphere_quadrature(9, 4, dtype=torch.float64)
    for extra in (0, 1):
        value = integrate_hemisphere(lambda w, k=exponent + extra: w[..., 2] ** k, rule)
        assert_close(value, 2 * math.pi / (exponent + extra + 1))


def test_all_polynomials_up_to_the_promised_degree() -> None:
    """Moments of the half sphere: Gamma functions; odd powers of x or y vanish."""
    rule = hemisphere_quadrature(4, 8, dtype=torch.float64)
    for a in range(8):
        for b in range(8 - a):
            for c in range(8 - a - b):
                value = integrate_hemisphere(
                    lambda w, p=(a, b, c): (w ** torch.tensor(p, dtype=w.dtype)).prod(-1), rule
                )
                halves = [(k + 1) / 2 for k in (a, b, c)]
                truth = math.prod(math.gamma(h) for h in halves) / math.gamma(sum(halves))
                truth = 0.0 if a % 2 or b % 2 else truth
                assert_close(value, truth, atol=1e-13)


def test_a_tilted_element_under_a_uniform_sky() -> None:
    """max(0, n . w) over the half sky: pi (1 + cos(tilt)) / 2; a kink, so only converging."""
    n = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    rule = hemisphere_quadrature(200, 400, dtype=torch.float64)
    value = integrate_hemisphere(lambda w: (w @ n).clamp(min=0), rule)
    assert_close(value, math.pi * 0.9, rtol=1e-5)


def test_no_nodes_is_an_error() -> None:
    with pytest.raises(OutOfRangeError, match="1 or more"):
        hemisphere_quadrature(0, 8)
