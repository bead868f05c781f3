"""The closed forms themselves: limits, reciprocity, closure, and integrals done by brute force."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchradiometry.reference import closed_forms as cf

LENGTH = st.floats(0.05, 20.0)
ANGLE = st.floats(0.0, math.pi / 2)


def close(a: float, b: float, tolerance: float = 1e-12) -> bool:
    return math.isclose(a, b, rel_tol=tolerance, abs_tol=1e-14)


def integrate(function: Callable, low: float, high: float, nodes: int = 40) -> float:
    """Gauss-Legendre on one interval, of a function of arrays."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    x = low + (high - low) * (x + 1) / 2
    return float((function(x) * w).sum() * (high - low) / 2)


def element_to_area(points: np.ndarray, weights: np.ndarray, outward: tuple, tilt: float) -> float:
    """int cos cos / (pi r^2) dA by points on the area; the element is at 0, tilted from +z."""
    normal = np.array([math.sin(tilt), 0, math.cos(tilt)])
    r2 = (points**2).sum(-1)
    mine, theirs = points @ normal, -(points @ np.asarray(outward))
    return float((np.clip(mine, 0, None) * theirs / (math.pi * r2**2) * weights).sum())


def test_values_of_the_catalogue() -> None:
    assert close(cf.parallel_rectangles(1, 1, 1), 0.199825, 5e-6)
    assert close(cf.perpendicular_rectangles(1, 1, 1), 0.200044, 5e-6)
    assert close(cf.coaxial_discs(1, 1, 1), (3 - math.sqrt(5)) / 2)
    assert close(cf.parallel_strips(1, 1), math.sqrt(2) - 1)


def test_inverse_square_and_its_cosine() -> None:
    assert close(cf.inverse_square_irradiance(10, 5), 0.4)
    assert close(cf.inverse_square_irradiance(10, 5, math.pi / 3), 0.2)
    assert cf.inverse_square_irradiance(10, 5, 2.0) == 0


@given(inner=st.floats(0, 0.7), width=st.floats(0.01, 0.8), share=st.floats(0, 1))
@settings(deadline=None, max_examples=50)
def test_spot_cone(inner: float, width: float, share: float) -> None:
    angle, outer = inner + share * width, inner + width
    expected = (math.cos(angle) - math.cos(outer)) / (math.cos(inner) - math.cos(outer))
    found = cf.spot_attenuation(angle, inner, outer)
    assert math.isclose(found, expected**2, rel_tol=1e-9, abs_tol=1e-12)
    assert cf.spot_attenuation(inner, inner, inner) == 1
    assert cf.spot_attenuation(outer + 0.01, inner, outer) == 0


@given(radius=LENGTH, distance=LENGTH)
@settings(deadline=None, max_examples=50)
def test_disc_is_a_cap_and_the_offset_disc_closes_with_the_ring(
    radius: float, distance: float
) -> None:
    found = cf.element_to_disc(radius, distance)
    assert close(found, cf.cap_irradiance(1, math.atan2(radius, distance)) / math.pi)
    assert close(found, cf.element_to_offset_disc(radius, distance, 0.0), 1e-10)


def test_offset_disc_against_brute_force() -> None:
    radius, distance, offset = 0.8, 1.3, 0.9
    r, w = np.polynomial.legendre.leggauss(24)
    r, w = radius * (r + 1) / 2, w * radius / 2
    phi = np.arange(64) * 2 * math.pi / 64
    x, y = np.outer(r, np.cos(phi)) + offset, np.outer(r, np.sin(phi))
    points = np.stack([x, y, np.full_like(x, distance)], -1).reshape(-1, 3)
    weights = np.outer(w * r, np.full(64, 2 * math.pi / 64)).reshape(-1)
    brute = element_to_area(points, weights, (0, 0, -1), 0.0)
    assert close(cf.element_to_offset_disc(radius, distance, offset), brute, 1e-10)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 1.0, 1.2, 1.5, 1.9, 2.0, 2.5, math.pi])
@pytest.mark.parametrize("distance", [1.05, 2.0, 10.0])
def test_sphere_against_brute_force(tilt: float, distance: float) -> None:
    """E/pi over the cone of the sphere: in its polar coordinates the circle is elementary."""
    cone = math.asin(1 / distance)

    def circle(theta: np.ndarray) -> np.ndarray:
        along = np.cos(theta) * math.cos(tilt)
        across = np.sin(theta) * math.sin(tilt)
        with np.errstate(divide="ignore", invalid="ignore"):
            phi = np.arccos(np.clip(np.where(across > 0, -along / across, 0), -1, 1))
        phi = np.where(along >= across, math.pi, np.where(along <= -across, 0, phi))
        return 2 * (along * phi + across * np.sin(phi)) * np.sin(theta) / math.pi

    kink = abs(math.pi / 2 - tilt)
    ends = sorted({0.0, cone, min(kink, cone)})
    brute = 0.0
    for low, high in pairwise(ends):
        bend = lambda t, a=low, b=high: (  # noqa: E731
            circle(a + (b - a) * np.sin(t) ** 2) * (b - a) * np.sin(2 * t)
        )
        brute += integrate(bend, 0, math.pi / 2, 60)
    found = cf.element_to_sphere(1.0, distance, tilt)
    assert math.isclose(found, brute, rel_tol=1e-9, abs_tol=1e-12)


def test_sphere_is_continuous_where_the_horizon_touches_it() -> None:
    for distance in (1.01, 2.0, 50.0):
        edge = math.acos(1 / distance)
        for tilt in (edge, math.pi - edge):
            before = cf.element_to_sphere(1, distance, tilt - 1e-7)
            after = cf.element_to_sphere(1, distance, tilt + 1e-7)
            assert abs(before - after) < 1e-6


def rectangle(low: tuple, edge_1: tuple, edge_2: tuple) -> tuple[np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(40)
    u, weights = (x + 1) / 2, np.outer(w, w).reshape(-1) / 4
    a, b = np.asarray(edge_1, float), np.asarray(edge_2, float)
    points = np.asarray(low, float) + u[:, None, None] * a + u[None, :, None] * b
    return points.reshape(-1, 3), weights * np.linalg.norm(a) * np.linalg.norm(b)


@pytest.mark.parametrize(("a", "b", "c"), [(1, 1, 1), (0.3, 2, 0.7), (4, 0.5, 1.1)])
def test_element_to_rectangles_against_brute_force(a: float, b: float, c: float) -> None:
    points, weights = rectangle((0, 0, c), (a, 0, 0), (0, b, 0))
    brute = element_to_area(points, weights, (0, 0, -1), 0.0)
    assert close(cf.element_to_parallel_rectangle(a, b, c), brute, 1e-9)
    points, weights = rectangle((c, 0, 0), (0, 0, a), (0, b, 0))
    brute = element_to_area(points, weights, (-1, 0, 0), 0.0)
    assert close(cf.element_to_perpendicular_rectangle(a, b, c), brute, 1e-8)


@given(a=LENGTH, b=LENGTH, c=LENGTH)
@settings(deadline=None, max_examples=50)
def test_box_rows_sum_to_one(a: float, b: float, c: float) -> None:
    """The a x b face of a box a x b x c: the opposite face and four walls take everything."""
    total = cf.parallel_rectangles(a, b, c)
    total += 2 * cf.perpendicular_rectangles(a, c, b) + 2 * cf.perpendicular_rectangles(b, c, a)
    assert close(total, 1.0, 1e-9)


@given(width=LENGTH, height=LENGTH, length=LENGTH)
@settings(deadline=None, max_examples=50)
def test_perpendicular_rectangles_are_reciprocal(
    width: float, height: float, length: float
) -> None:
    there = width * cf.perpendicular_rectangles(width, height, length)
    back = height * cf.perpendicular_rectangles(height, width, length)
    assert close(there, back, 1e-8)


def test_cube() -> None:
    faces = cf.cube_faces()
    for i, row in enumerate(faces):
        assert close(sum(row), 1.0)
        assert row[i] == 0
        assert row == [faces[j][i] for j in range(6)]


def test_rectangles_from_elements() -> None:
    """C-11 and C-14 are the averages of the element's factors over the other rectangle."""
    a, b, c = 1.2, 0.7, 0.9
    x, w = np.polynomial.legendre.leggauss(30)
    total = upright = 0.0
    for p, wp in zip((x + 1) / 2, w / 2, strict=True):
        for q, wq in zip((x + 1) / 2, w / 2, strict=True):
            sides = [(u, v) for u in (p * a, (1 - p) * a) for v in (q * b, (1 - q) * b)]
            total += wp * wq * sum(cf.element_to_parallel_rectangle(u, v, c) for u, v in sides)
            upright += (
                wp
                * wq
                * sum(
                    cf.element_to_perpendicular_rectangle(c, v, p * a) for v in (q * b, (1 - q) * b)
                )
            )
    assert close(cf.parallel_rectangles(a, b, c), total, 1e-10)
    assert close(cf.perpendicular_rectangles(a, c, b), upright, 1e-3)  # a kink at the shared edge


@given(r1=LENGTH, r2=LENGTH, h=LENGTH)
@settings(deadline=None, max_examples=50)
def test_coaxial_discs(r1: float, r2: float, h: float) -> None:
    there, back = cf.coaxial_discs(r1, r2, h), cf.coaxial_discs(r2, r1, h)
    assert 0 < there <= 1
    assert close(r1**2 * there, r2**2 * back)
    s = 1 + (r2**2 + h**2) / r1**2
    assert math.isclose(there, (s - math.sqrt(s * s - 4 * (r2 / r1) ** 2)) / 2, rel_tol=1e-7)


def test_small_disc_is_an_element_and_near_plates_see_only_each_other() -> None:
    assert close(cf.coaxial_discs(1e-6, 2.0, 3.0), cf.element_to_disc(2.0, 3.0), 1e-10)
    assert close(cf.parallel_rectangles(1, 1, 1e-6), 1.0, 1e-5)
    assert close(cf.coaxial_discs(1, 1, 1e-9), 1.0, 1e-8)
    assert close(cf.parallel_strips(1, 1e-9), 1.0, 1e-8)
    # a long pair of rectangles is a pair of strips
    assert close(cf.parallel_rectangles(1, 1e7, 2), cf.parallel_strips(1, 2), 1e-6)
    assert close(cf.perpendicular_rectangles(1, 1, 1e5), cf.wedge(1, 1, math.pi / 2), 1e-4)


def test_sphere_to_disc_is_its_share_of_the_solid_angle() -> None:
    assert close(cf.sphere_to_coaxial_disc(1e-9, 1.0), 0.5, 1e-8)
    small = cf.sphere_to_coaxial_disc(1.0, 1e-3)
    assert close(small, math.pi * 1e-6 / (4 * math.pi), 1e-5)


@given(a=LENGTH, b=LENGTH, opening=st.floats(0.0, math.pi))
@settings(deadline=None, max_examples=50)
def test_wedge(a: float, b: float, opening: float) -> None:
    across = math.sqrt(max(0.0, a * a + b * b - 2 * a * b * math.cos(opening)))
    assert math.isclose(
        cf.wedge(a, b, opening), (a + b - across) / (2 * a), rel_tol=1e-6, abs_tol=1e-7
    )
    assert close(a * cf.wedge(a, b, opening), b * cf.wedge(b, a, opening))
    assert math.isclose(cf.wedge(a, a, opening), 1 - math.sin(opening / 2), abs_tol=1e-12)


@given(m1=LENGTH, m2=LENGTH, rho1=st.floats(0, 0.99), rho2=st.floats(0, 0.99))
@settings(deadline=None, max_examples=50)
def test_parallel_plates_balance(m1: float, m2: float, rho1: float, rho2: float) -> None:
    b1, b2 = cf.parallel_plates_radiosity(m1, rho1, m2, rho2)
    assert close(b1, m1 + rho1 * b2)
    assert close(b2, m2 + rho2 * b1)
    same, _ = cf.parallel_plates_radiosity(m1, rho1, m1, rho1)
    assert close(same, cf.enclosure_radiosity(m1, rho1), 1e-10)


@given(flux=LENGTH, radius=LENGTH, albedo=st.floats(0, 0.99))
@settings(deadline=None, max_examples=50)
def test_integrating_sphere_absorbs_what_the_lamp_gives(
    flux: float, radius: float, albedo: float
) -> None:
    wall = 4 * math.pi * radius**2
    reflected = cf.integrating_sphere_irradiance(flux, radius, albedo)
    assert close((flux + reflected * wall) * (1 - albedo), flux, 1e-10)


def test_dome() -> None:
    assert close(cf.dome_irradiance(2.0), 2 * math.pi)
    assert close(cf.dome_irradiance(2.0, math.pi / 2), math.pi)
    assert close(cf.dome_irradiance(2.0, math.pi), 0.0)


@pytest.mark.parametrize("n", [0.3, 1.0, 2.0, 7.5, 100.0, 1e4, 1e6])
def test_phong_reflectance_has_its_two_closed_ends(n: float) -> None:
    assert close(cf.phong_reflectance(n, 0.0), cf.phong_reflectance_at_normal(n))
    # far below the lobe's width, 90 degrees - rounding counts as 90
    assert close(cf.phong_reflectance(n, math.pi / 2), cf.phong_reflectance_at_grazing(n), 1e-11)


@given(angle=ANGLE)
@settings(deadline=None, max_examples=20)
def test_linear_lobe_has_a_closed_form_at_every_angle(angle: float) -> None:
    """n = 1: int max(0, wr.w) max(0, n.w) dw = (2/3) (sin x + (pi - x) cos x), x the angle."""
    expected = 2 / 3 * (math.sin(angle) + (math.pi - angle) * math.cos(angle))
    assert close(cf.phong_reflectance(1.0, angle), expected)
