"""Polygon irradiance: closed forms, 40-digit references, brute force, distances and scales."""

import math
from collections.abc import Sequence

import mpmath
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import RELATIVE, assert_close
from torchradiometry.geometry import (
    local_frame,
    polygon_irradiance,
    polygon_vector_irradiance,
    solid_angle_polygon,
)

mpmath.mp.dps = 40
Z = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
DTYPES = [torch.float64, torch.float32]


def exact(position: Tensor, normal: Tensor, polygon: Tensor) -> list[mpmath.mpf]:
    """Lambert's sum as in the books, in 40 digits, with its own clipping."""
    n = [mpmath.mpf(float(x)) for x in normal]
    p = [[mpmath.mpf(float(c)) - mpmath.mpf(float(x)) for c, x in zip(q, position, strict=True)]
         for q in polygon]  # fmt: skip
    h = [mpmath.fdot(n, c) for c in p]
    kept: list[list[mpmath.mpf]] = []
    for i in range(len(p)):
        j = (i + 1) % len(p)
        if h[i] >= 0:
            kept.append(p[i])
        if (h[i] >= 0) != (h[j] >= 0):
            t = h[i] / (h[i] - h[j])
            kept.append([a + t * (b - a) for a, b in zip(p[i], p[j], strict=True)])
    total = [mpmath.mpf(0)] * 3
    for i, a in enumerate(kept):
        b = kept[(i + 1) % len(kept)]
        c = [b[1] * a[2] - b[2] * a[1], b[2] * a[0] - b[0] * a[2], b[0] * a[1] - b[1] * a[0]]
        sine = mpmath.sqrt(mpmath.fdot(c, c))
        if sine > 0:
            angle = mpmath.atan2(sine, mpmath.fdot(a, b))
            total = [t + angle * x / sine / 2 for t, x in zip(total, c, strict=True)]
    return total


def relative_error(found: Tensor, truth: Sequence[mpmath.mpf]) -> float:
    wrong = [mpmath.mpf(float(f)) - t for f, t in zip(found, truth, strict=True)]
    return float(mpmath.norm(wrong) / mpmath.norm(truth))


def random_polygon(generator: torch.Generator, corners: int) -> Tensor:
    """A star-shaped, often non-convex polygon of size 1 in the plane z = 0, front to +z."""
    turn = torch.arange(corners) + 0.8 * torch.rand(corners, generator=generator)
    turn = turn * (2 * math.pi / corners)
    reach = 0.3 + 0.7 * torch.rand(corners, generator=generator)
    flat = torch.stack((torch.cos(turn), torch.sin(turn), torch.zeros(corners)), -1)
    return (reach.unsqueeze(-1) * flat).double()


def unit(generator: torch.Generator) -> Tensor:
    v = torch.randn(3, generator=generator).double()
    return v / v.norm()


def plate(width: float, depth: float, height: float) -> Tensor:
    """A rectangle above the origin, one corner on the z axis, its front looking down."""
    x, y = width, depth
    return torch.tensor(
        [[0, 0, height], [0, y, height], [x, y, height], [x, 0, height]], dtype=torch.float64
    )


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("a", "b", "c"), [(1.0, 1.0, 1.0), (3.0, 0.2, 0.5), (0.01, 7.0, 2.0)])
def test_parallel_rectangle(dtype: torch.dtype, a: float, b: float, c: float) -> None:
    """Howell's configuration factor B-4: a corner of the rectangle above the element."""
    x, y = a / c, b / c
    s, t = math.sqrt(1 + x * x), math.sqrt(1 + y * y)
    factor = (x / s * math.atan(y / s) + y / t * math.atan(x / t)) / (2 * math.pi)
    e = polygon_irradiance(torch.zeros(3, dtype=dtype), Z.to(dtype), plate(a, b, c).to(dtype))
    # the plate itself is rounded to the dtype: two roundings more than the formula
    assert_close(e, math.pi * factor)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("a", "b", "c"), [(1.0, 1.0, 1.0), (3.0, 0.2, 0.5), (0.5, 7.0, 2.0)])
def test_perpendicular_rectangle(dtype: torch.dtype, a: float, b: float, c: float) -> None:
    """Howell's configuration factor B-5: a wall of height a and width b at distance c."""
    x, y = a / b, c / b
    r = math.hypot(x, y)
    factor = (math.atan(1 / y) - y / r * math.atan(1 / r)) / (2 * math.pi)
    wall = torch.tensor([[c, 0, 0], [c, 0, a], [c, b, a], [c, b, 0]], dtype=dtype)
    e = polygon_irradiance(torch.zeros(3, dtype=dtype), Z.to(dtype), wall)
    assert_close(e, math.pi * factor)


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_source_that_covers_the_hemisphere_gives_pi(dtype: torch.dtype) -> None:
    huge = plate(2e8, 2e8, 1.0) - torch.tensor([1e8, 1e8, 0.0], dtype=torch.float64)
    e = polygon_irradiance(torch.zeros(3, dtype=dtype), Z.to(dtype), huge.to(dtype))
    assert_close(e, math.pi, rtol=1e-8 if dtype == torch.float64 else 1e-6)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("distance", [0.1, 1.0, 5.0, 100.0, 1e4])
def test_every_digit_at_every_distance_and_scale(
    dtype: torch.dtype, scale: float, distance: float, generator: torch.Generator
) -> None:
    """The whole polygon above the horizon: relative error of the vector and of n . Phi."""
    for corners in range(3, 9):
        polygon = (scale * random_polygon(generator, corners)).to(dtype)
        away = unit(generator)
        away[2] = away[2].abs() + 0.2
        position = (scale * distance * away).to(dtype)
        normal = -away / away.norm() if distance > 1 else -Z
        normal = normal.to(dtype)
        truth = exact(position, normal, polygon)
        found = polygon_vector_irradiance(position, normal, polygon)
        assert relative_error(found, truth) < RELATIVE[dtype]
        e = mpmath.fdot(truth, [mpmath.mpf(float(x)) for x in normal])
        found_e = polygon_irradiance(position, normal, polygon)
        assert relative_error(found_e[None], [e]) < RELATIVE[dtype]


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("distance", [0.1, 1.0, 5.0, 100.0, 1e4])
def test_cut_by_the_horizon(
    dtype: torch.dtype, distance: float, generator: torch.Generator
) -> None:
    """Grazing receivers whose horizon cuts the polygon.

    The height of a corner over the horizon, size wide, is a difference of numbers as large as
    the distance: one rounding of the *input* changes the answer by eps * distance / size.
    """
    for corners in range(3, 9):
        polygon, away = random_polygon(generator, corners), unit(generator)
        away[2] = away[2].abs() + 0.2
        away = away / away.norm()
        side = torch.linalg.cross(away, unit(generator))
        normal = side / side.norm() - away * 0.2 / distance
        normal = (normal / normal.norm()).to(dtype)
        polygon, position = polygon.to(dtype), (distance * away).to(dtype)
        truth = exact(position, normal, polygon)
        found = polygon_vector_irradiance(position, normal, polygon)
        conditioning = torch.finfo(torch.float64).eps * distance * 100
        assert relative_error(found, truth) < RELATIVE[dtype] + conditioning
        found_e = polygon_irradiance(position, normal, polygon)
        e = mpmath.fdot(truth, [mpmath.mpf(float(x)) for x in normal])
        slack = 100 * conditioning + RELATIVE[dtype]
        assert relative_error(found_e[None], [e]) < slack


def test_brute_force_with_a_cut(generator: torch.Generator) -> None:
    """A fine midpoint sum over a rectangle that the horizon cuts."""
    n = 1500
    u, v = torch.meshgrid(*(2 * [(torch.arange(n).double() + 0.5) / n]), indexing="ij")
    for _ in range(4):
        low = torch.tensor([-0.7, -1.1, 0.0], dtype=torch.float64)
        corners = low + torch.tensor([[0, 0, 0], [2, 0, 0], [2, 1.5, 0], [0, 1.5, 0]])
        position = torch.tensor([0.4, -0.3, 0.8], dtype=torch.float64)
        normal = unit(generator)
        point = low + torch.stack((2 * u, 1.5 * v, 0 * u), -1)
        path = point - position
        r = path.norm(dim=-1)
        cosines = ((path @ normal) / r).clamp(min=0) * (-path[..., 2] / r)
        brute = (cosines / r**2).sum() * 3 / n**2
        # midpoint rule across the cut: the error is below the share of cells on the cut squared
        assert_close(polygon_irradiance(position, normal, corners), brute, rtol=3e-5, atol=1e-6)


@settings(deadline=None, max_examples=50)
@given(st.integers(3, 8), st.integers(0, 10**6), st.floats(-3, 3), st.floats(-3, 3))
def test_laws(corners: int, seed: int, log_scale: float, turn: float) -> None:
    """Scale, rotation, order of the corners, additivity, both sides, and E <= solid angle."""
    generator = torch.Generator().manual_seed(seed)
    polygon = random_polygon(generator, corners)
    position = unit(generator) * 1.5
    normal = unit(generator)
    e = polygon_irradiance(position, normal, polygon, two_sided=True)
    scale = 10**log_scale
    scaled = polygon_irradiance(scale * position, normal, scale * polygon, two_sided=True)
    assert_close(scaled, e, atol=1e-13)
    c, s = math.cos(turn), math.sin(turn)
    rotation = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    rotated = polygon_irradiance(
        position @ rotation, normal @ rotation, polygon @ rotation, two_sided=True
    )
    assert_close(rotated, e, atol=1e-12)
    assert_close(
        polygon_irradiance(position, normal, polygon.roll(1, 0), two_sided=True), e, atol=1e-13
    )
    front = polygon_irradiance(position, normal, polygon)
    back = polygon_irradiance(position, normal, polygon.flip(0))
    assert_close(front + back, e, atol=1e-13)
    assert bool(front == 0) or bool(back == 0)
    parts = sum(
        polygon_vector_irradiance(position, normal, polygon[[0, i, i + 1]])
        for i in range(1, corners - 1)
    )
    whole = polygon_vector_irradiance(position, normal, polygon)
    assert_close(torch.as_tensor(parts), whole, atol=1e-12)
    assert float(e) <= float(solid_angle_polygon(position, polygon).abs()) + 1e-12


def test_a_non_convex_source_that_falls_into_two_pieces() -> None:
    """A U whose bridge is below the horizon: the sum of its two arms."""
    u = [[-2, -1, 1], [2, -1, 1], [2, 1, 1], [1, 1, 1], [1, -0.5, 1], [-1, -0.5, 1],
         [-1, 1, 1], [-2, 1, 1]]  # fmt: skip
    shape = torch.tensor(u, dtype=torch.float64).flip(0)
    arms = [
        torch.tensor([[a, 0, 1], [a, 1, 1], [a + 1, 1, 1], [a + 1, 0, 1.0]], dtype=torch.float64)
        for a in (-2, 1)
    ]
    origin, normal = torch.zeros(3, dtype=torch.float64), torch.tensor([0.0, 1.0, 0.0]).double()
    expected = sum(polygon_irradiance(origin, normal, arm) for arm in arms)
    assert float(expected) > 0.05
    assert_close(polygon_irradiance(origin, normal, shape), expected)


SQUARE = torch.tensor([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=torch.float64)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(
    ("position", "length"),
    [
        ((0.0, 0.0, 0.0), math.pi),
        ((0.3, -0.4, 0.0), math.pi),
        ((1.0, 0.0, 0.0), math.pi / 2),
        ((1.0, 1.0, 0.0), math.pi / 4),
        ((3.0, 0.0, 0.0), 0.0),
        ((3.0, 1.0, 0.0), 0.0),
    ],
)
def test_documented_values_in_the_plane(
    dtype: torch.dtype, position: tuple[float, ...], length: float
) -> None:
    at = torch.tensor(position, dtype=dtype, requires_grad=True)
    polygon = SQUARE.to(dtype).clone().requires_grad_()
    normal = (-Z.to(dtype)).requires_grad_()
    phi = polygon_vector_irradiance(at, normal, polygon)
    expected = torch.tensor([0, 0, -length], dtype=torch.float64)
    assert_close(phi, expected, atol=RELATIVE[dtype])
    for gradient in torch.autograd.grad(phi.sum(), (at, polygon, normal), allow_unused=True):
        assert gradient is None or torch.isfinite(gradient).all()


@pytest.mark.parametrize(
    "polygon",
    [torch.zeros(3, 3), SQUARE.float() * 0 + 1, SQUARE.float() * 1e-30, SQUARE.float() * 1e30],
)
def test_nothing_is_ever_nan(polygon: Tensor) -> None:
    polygon = polygon.clone().requires_grad_()
    for position in (torch.zeros(3), torch.ones(3), torch.full((3,), 1e30)):
        phi = polygon_vector_irradiance(position, Z.float(), polygon)
        (gradient,) = torch.autograd.grad(phi.sum(), polygon)
        assert torch.isfinite(phi).all()
        assert torch.isfinite(gradient.clamp(-1e38, 1e38)).all()
        assert not torch.isnan(gradient).any()


def test_gradients(generator: torch.Generator) -> None:
    for corners in (3, 4, 7):
        polygon = random_polygon(generator, corners)
        for distance in (0.7, 3.0, 30.0):
            away = unit(generator)
            away[2] = away[2].abs() + 0.3
            position = (away * distance).requires_grad_()
            tangent, _ = local_frame(away / away.norm())
            for normal in (-away, tangent - 0.1 * away / distance):
                inputs = (
                    position,
                    normal.clone().requires_grad_(),
                    polygon.clone().requires_grad_(),
                )
                assert gradcheck(polygon_vector_irradiance, inputs)


def test_batches_broadcast(generator: torch.Generator) -> None:
    polygons = torch.stack([random_polygon(generator, 5) for _ in range(3)])
    points = torch.randn(4, 1, 3, dtype=torch.float64, generator=generator)
    normals = torch.nn.functional.normalize(points + 0.1, dim=-1)
    together = polygon_irradiance(points, normals, polygons, two_sided=True)
    assert together.shape == (4, 3)
    for i in range(4):
        for j in range(3):
            one = polygon_irradiance(points[i, 0], normals[i, 0], polygons[j], two_sided=True)
            assert_close(together[i, j], one)
