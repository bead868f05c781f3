"""Solid angles: closed forms, 40-digit references, distances, needles, points in the plane."""

import math

import mpmath
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import RELATIVE, assert_close
from torchradiometry.geometry import (
    clip_polygon,
    solid_angle_cone,
    solid_angle_patch,
    solid_angle_polygon,
    solid_angle_sphere,
    solid_angle_triangle,
)

mpmath.mp.dps = 40
DTYPES = [torch.float64, torch.float32]
ORIGIN = torch.zeros(3, dtype=torch.float64)


def spherical_excess(position: Tensor, triangle: Tensor) -> mpmath.mpf:
    """Solid angle by l'Huilier's theorem from the three sides, in 60 digits: another formula."""
    with mpmath.workdps(60):
        corner = [
            [mpmath.mpf(float(c)) - mpmath.mpf(float(p)) for c, p in zip(q, position, strict=True)]
            for q in triangle
        ]
        side = []
        for i in range(3):
            a, b = corner[i], corner[(i + 1) % 3]
            c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
            side.append(mpmath.atan2(mpmath.norm(c), mpmath.fdot(a, b)))
        s = sum(side) / 2
        product = mpmath.tan(s / 2)
        for a in side:
            product *= mpmath.tan((s - a) / 2)
        return 4 * mpmath.atan(mpmath.sqrt(abs(product)))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("distance", [1e-3, 0.3, 1.0, 10.0, 1e4, 1e8])
def test_triangles_at_every_distance(
    dtype: torch.dtype, distance: float, generator: torch.Generator
) -> None:
    for _ in range(10):
        flat = torch.randn(3, 3, dtype=torch.float64, generator=generator)
        flat[:, 2] = 0
        away = torch.randn(3, dtype=torch.float64, generator=generator)
        away[2] = away[2].abs() + 0.3
        position, triangle = (away * distance).to(dtype), flat.to(dtype)
        truth = spherical_excess(position, triangle)
        found = mpmath.mpf(float(solid_angle_triangle(position, triangle).abs()))
        assert abs(found - truth) < RELATIVE[dtype] * truth


@pytest.mark.parametrize("dtype", DTYPES)
def test_needles(dtype: torch.dtype) -> None:
    for width in (1e-3, 1e-6, 1e-12):
        triangle = torch.tensor([[-1, 0, 0], [1, 0, 0], [0.3, width, 0]], dtype=dtype)
        position = torch.tensor([0.1, 0.2, 0.7], dtype=dtype)
        truth = spherical_excess(position, triangle)
        found = mpmath.mpf(float(solid_angle_triangle(position, triangle)))
        assert abs(found - truth) < RELATIVE[dtype] * truth


@pytest.mark.parametrize("dtype", DTYPES)
@settings(deadline=None, max_examples=25)
@given(a=st.floats(0.01, 100), b=st.floats(0.01, 100), h=st.floats(0.01, 100))
def test_rectangle_pyramid(dtype: torch.dtype, a: float, b: float, h: float) -> None:
    """omega = 4 atan(a b / (2 h sqrt(4 h^2 + a^2 + b^2))) over the middle of an a x b plate."""
    a, b, h = (float(torch.tensor(x, dtype=dtype)) for x in (a, b, h))
    x, y = a / 2, b / 2
    plate = torch.tensor([[x, y, 0], [-x, y, 0], [-x, -y, 0], [x, -y, 0]], dtype=dtype)
    position = torch.tensor([0, 0, h], dtype=dtype)
    truth = 4 * math.atan(a * b / (2 * h * math.sqrt(4 * h * h + a * a + b * b)))
    assert_close(solid_angle_polygon(position, plate), truth)
    assert_close(solid_angle_polygon(-position, plate), -truth)


def test_a_closed_surface_is_four_pi_inside_and_nothing_outside() -> None:
    eye = torch.eye(3, dtype=torch.float64)
    faces = [
        torch.stack([s * eye[i], t * eye[j], u * eye[k]])
        for s in (1, -1)
        for t in (1, -1)
        for u in (1, -1)
        for i, j, k in ([(0, 1, 2)] if s * t * u > 0 else [(0, 2, 1)])
    ]
    octahedron = torch.stack(faces)
    inside = torch.tensor([0.1, 0.2, 0.05], dtype=torch.float64)
    outside = torch.tensor([1.0, 2.0, 0.5], dtype=torch.float64)
    assert_close(solid_angle_triangle(inside, octahedron).sum().abs(), 4 * math.pi)
    assert_close(solid_angle_triangle(outside, octahedron).sum(), 0.0, atol=1e-14)


def test_non_convex_is_the_sum_of_its_parts(generator: torch.Generator) -> None:
    el = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]]
    shape = torch.tensor(el, dtype=torch.float64)
    pieces = ([0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5])
    for start in range(6):
        for _ in range(5):
            position = torch.randn(3, dtype=torch.float64, generator=generator)
            whole = solid_angle_polygon(position, shape.roll(start, 0))
            parts = sum(solid_angle_triangle(position, shape[p]) for p in pieces)
            assert_close(whole, parts, atol=1e-13)
            cut = clip_polygon(shape, shape[:, 0] - 0.5), clip_polygon(shape, 0.5 - shape[:, 0])
            assert_close(sum(solid_angle_polygon(position, c) for c in cut), whole, atol=1e-13)


@pytest.mark.parametrize(
    ("position", "angle"),
    [
        ((0.0, 0.0), 2 * math.pi),
        ((0.5, -0.5), 2 * math.pi),
        ((1.0, 0.0), math.pi),
        ((1.0, 1.0), math.pi / 2),
        ((2.0, 0.0), 0.0),
        ((2.0, 1.0), 0.0),
    ],
)
def test_documented_values_in_the_plane(position: tuple[float, float], angle: float) -> None:
    square = torch.tensor([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=torch.float64)
    square.requires_grad_()
    at = torch.tensor([*position, 0.0], dtype=torch.float64, requires_grad=True)
    omega = solid_angle_polygon(at, square)
    assert_close(omega, angle, atol=1e-14)
    omega.backward()
    assert torch.isfinite(at.grad).all()
    assert torch.isfinite(square.grad).all()


@pytest.mark.parametrize("dtype", DTYPES)
def test_cone_patch_and_sphere(dtype: torch.dtype) -> None:
    narrow = torch.tensor([1e-8, 1e-3, 1.0, math.pi / 2, math.pi], dtype=dtype)
    truth = [4 * math.pi * math.sin(float(a) / 2) ** 2 for a in narrow]
    assert_close(solid_angle_cone(narrow), torch.tensor(truth, dtype=torch.float64))
    distance = torch.tensor([1.0, 1.5, 10.0, 1e6], dtype=dtype)
    cone = solid_angle_cone(torch.asin(1 / distance.double()))
    assert_close(solid_angle_sphere(distance, torch.ones((), dtype=dtype)), cone)
    assert_close(solid_angle_sphere(distance / 2, distance), 4 * math.pi)
    far = distance * 1e4
    patch = solid_angle_patch(torch.pi * torch.ones((), dtype=dtype), torch.ones_like(far), far)
    disc = torch.tensor([math.pi / float(r) ** 2 for r in far], dtype=torch.float64)
    assert_close(patch, disc)
    assert float(solid_angle_patch(far, far, far * 0).max()) == 0


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10**6))
def test_small_patches_agree_with_the_exact_polygon(seed: int) -> None:
    """The error of A cos / r^2 is of the order of A / r^2."""
    generator = torch.Generator().manual_seed(seed)
    position = torch.randn(3, dtype=torch.float64, generator=generator)
    position[2] = position[2].abs() + 0.5
    square = 1e-4 * torch.tensor([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0.0]]).double()
    r = position.norm()
    patch = solid_angle_patch(torch.tensor(4e-8).double(), position[2] / r, r)
    assert_close(solid_angle_polygon(position, square), patch, rtol=2e-7)


def test_gradients(generator: torch.Generator) -> None:
    triangle = torch.randn(3, 3, dtype=torch.float64, generator=generator).requires_grad_()
    position = torch.randn(4, 3, dtype=torch.float64, generator=generator).requires_grad_()
    polygon = torch.randn(6, 3, dtype=torch.float64, generator=generator)
    polygon[:, 2] = 0
    assert gradcheck(solid_angle_triangle, (position, triangle))
    assert gradcheck(solid_angle_polygon, (position, polygon.requires_grad_()))
    one, two = (torch.rand(2, 4, dtype=torch.float64, generator=generator) + 0.1).unbind()
    one, two, far = (t.clone().requires_grad_() for t in (one, two, two + 2))
    assert gradcheck(solid_angle_patch, (one, two, far))
    assert gradcheck(solid_angle_cone, (one,))
    assert gradcheck(solid_angle_sphere, (far, one))
    assert gradcheck(solid_angle_sphere, (one, far))
