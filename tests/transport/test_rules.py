"""Quadrature rules: exact for polynomials up to their degree; samples are even."""

import pytest
import torch

from tests.tolerances import assert_close
from torchradiometry import errors, transport
from torchradiometry.transport.rules import line_rule, sequence

TRIANGLE = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=torch.float64)
SQUARE = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=torch.float64)


def factorial(n: int) -> float:
    return float(torch.lgamma(torch.tensor(n + 1.0, dtype=torch.float64)).exp())


@pytest.mark.parametrize("split", [1, 2, 3])
@pytest.mark.parametrize("degree", [1, 2, 5, 7, 13])
def test_monomials(degree: int, split: int) -> None:
    for corners in (TRIANGLE, SQUARE):
        points = transport.patch_points(corners, degree, split)
        assert_close(points.weight.sum(-1), 1.0)
        x, y = points.position[0, :, 0], points.position[0, :, 1]
        for i in range(degree + 1):
            for j in range(degree + 1 - i):
                mean = (points.weight[0] * x**i * y**j).sum()
                if corners is SQUARE:
                    expected = 1 / ((i + 1) * (j + 1))
                else:
                    expected = 2 * factorial(i) * factorial(j) / factorial(i + j + 2)
                assert_close(mean, expected)


def test_a_trapezium_is_weighted_by_its_area() -> None:
    corners = torch.tensor([[[0.0, 0, 0], [3, 0, 0], [2, 1, 0], [1, 1, 0]]], dtype=torch.float64)
    points = transport.patch_points(corners, 5)
    assert_close((points.weight[0] * points.position[0, :, 1]).sum(), 5 / 12)


def test_a_degree_below_1_is_named() -> None:
    with pytest.raises(errors.OutOfRangeError, match="degree"):
        transport.patch_points(TRIANGLE, 0)


@pytest.mark.parametrize("order", [1, 2, 3, 8, 24, 48])
def test_the_line_rule_is_right_to_the_last_digit(order: int) -> None:
    node, weight = line_rule(order, SQUARE)
    assert (node > 0).all()
    assert (node < 1).all()
    for power in range(0, 2 * order, max(1, order // 4)):
        # seven roundings: numpy's own 48 points are off by 3e-14 here
        assert_close((weight * node**power).sum(), 1 / (power + 1), rtol=1.6e-15, atol=0)


@pytest.mark.parametrize("corners", [TRIANGLE, SQUARE], ids=["triangle", "quad"])
def test_samples_are_even(corners: torch.Tensor) -> None:
    points = transport.sample_patches(corners, sequence(4096, 2, corners))
    centre = corners.mean(1)
    assert_close(points.mean(0), centre[0], atol=2e-3)
    below = (points[:, 0] < 0.25).double().mean()
    assert_close(below, 0.25 if corners is SQUARE else 1 - 0.75**2, atol=5e-3)
