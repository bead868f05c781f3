"""The promised figures, on hard inputs, against fifty digits (see `tests.benchmarks.accuracy`)."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from tests.accuracy import truth
from tests.accuracy.inputs import POLYGONS, SPHERES, Draw, plates, receivers, spheres
from tests.solve.rooms import KINDS, room
from torchradiometry import solve, sources, transport
from torchradiometry.geometry import polygon_irradiance, solid_angle_polygon, vector_area
from torchradiometry.sources import PolygonSource, SphereSource
from torchradiometry.sources.sphere_irradiance import sphere_irradiance

#: relative errors that are promised
IRRADIANCE = {torch.float64: 1e-12, torch.float32: 5e-6}
FORM_FACTORS = {torch.float64: 1e-10, torch.float32: 1e-5}
#: of radiosity in roundings times the condition number, and at albedo 0.999 in float32
CONDITIONED, RADIOSITY_32 = 1e-15, 3e-5
GRADIENTS = 1e-11
DTYPE = pytest.mark.parametrize("dtype", IRRADIANCE, ids=str)


@DTYPE
@pytest.mark.parametrize("kind", POLYGONS)
def test_polygons(kind: str, dtype: torch.dtype) -> None:
    for at in receivers(kind, 5, dtype):
        exact = truth.polygon_irradiance(*at)
        source = PolygonSource(at.polygon, torch.ones(1, dtype=dtype), two_sided=True)
        for found in (
            polygon_irradiance(*at, two_sided=True),
            source.irradiance_on(at.position[None], at.normal[None]),
        ):
            assert truth.relative(float(found), exact) < IRRADIANCE[dtype]
        omega = solid_angle_polygon(at.position, at.polygon)
        exact = truth.solid_angle(at.position, at.polygon)
        assert truth.relative(float(omega), exact) < IRRADIANCE[dtype]


@DTYPE
def test_on_the_line_of_an_edge(dtype: torch.dtype) -> None:
    """In the polygon's plane, on an edge prolonged: 0, and 0 sr, but for rounding."""
    draw = Draw(0, dtype)
    for corners in range(3, 9):
        polygon = draw.polygon(corners)
        for share in (-0.5, 1.5, 3.0):
            position = polygon[0] + share * (polygon[1] - polygon[0])
            normal = draw.rounded(draw.unit())
            inside = truth.solid_angle(position, polygon)
            if inside == 0:  # a non-convex outline may come back to the line
                assert abs(float(polygon_irradiance(position, normal, polygon))) < 1e-15
                assert abs(float(solid_angle_polygon(position, polygon))) < 1e-15


@DTYPE
@pytest.mark.parametrize("kind", SPHERES)
def test_spheres(kind: str, dtype: torch.dtype) -> None:
    for at in spheres(kind, 12, dtype):
        exact = truth.sphere_irradiance(*at)
        source = SphereSource(at.offset, at.radius, torch.ones(1, dtype=dtype))
        origin = torch.zeros(1, 3, dtype=dtype)
        for found in (sphere_irradiance(*at), source.irradiance_on(origin, at.normal[None])):
            assert truth.relative(float(found), exact) < IRRADIANCE[dtype]


@DTYPE
def test_harmonics(dtype: torch.dtype) -> None:
    """Relative to the largest term: the series itself cancels where it rings."""
    draw = Draw(1, dtype)
    for _ in range(20):
        held, normal = draw.rounded(draw.uniform(9, 1, low=-1)), draw.rounded(draw.unit())
        held[0] = 4  # bright enough that nothing is clamped
        exact = truth.harmonic_irradiance(held[:, 0], normal)
        found = sources.HarmonicSource(held).irradiance_on(None, normal[None])
        assert truth.relative(float(found), exact) < {torch.float64: 1e-14}.get(dtype, 5e-6)


@DTYPE
@pytest.mark.parametrize("kind", ["parallel", "perpendicular"])
def test_plates(kind: str, dtype: torch.dtype) -> None:
    closed = getattr(truth, f"{kind}_rectangles")
    for patches, sizes in plates(kind, 20, dtype):
        factors = transport.form_factors(patches)
        assert truth.relative(float(factors[0, 1]), closed(*sizes)) < FORM_FACTORS[dtype]


@pytest.mark.parametrize("shared", range(3))
def test_triangles(shared: int) -> None:
    """Random pairs that share no corner, one, or an edge, either way round."""
    draw, seen = Draw(2 + shared, torch.float64), 0
    while seen < 1:
        first, second = draw.uniform(2, 3, 3)
        second[:shared] = first[:shared].flip(0)
        for turned in (second, second.flip(0)):
            found = transport.polygon_exchange(first[None], turned[None])
            if float(found) > 1e-6:
                exact = truth.exchange(first, turned)
                assert truth.relative(float(found), exact) < FORM_FACTORS[torch.float64]
                seen += 1


def strip(length: float) -> Tensor:
    return torch.tensor([[0, 0, 0], [1, 0, 0], [1, length, 0], [0, length, 0]], dtype=torch.float64)


@pytest.mark.parametrize("length", [1e3, 1e4, 1e6])
def test_strips(length: float) -> None:
    """Far longer than wide and a width to a length apart: their contour integrals cancel."""
    for gap in (1.0, 32.0, 1e3, length):
        floor = strip(length)
        other = floor.flip(0) + torch.tensor([0, 0, gap], dtype=torch.float64)
        found = transport.polygon_exchange(floor[None], other[None]) / length
        exact = truth.parallel_rectangles(1.0, length, gap)
        assert truth.relative(float(found), exact) < FORM_FACTORS[torch.float64]


@pytest.mark.parametrize("size", [2.0**-10, 2.0**-20])
def test_small_plates_above_large_ones(size: float) -> None:
    """At any height from their own size on."""
    floor = strip(1.0)
    for height in (size, 2.0**-2):
        first = floor.flip(0) * size + torch.tensor([0.25, 0.5, height], dtype=torch.float64)
        found = transport.polygon_exchange(floor[None], first[None])
        exact = truth.exchange(floor, first)
        assert truth.relative(float(found), exact) < FORM_FACTORS[torch.float64]


@pytest.mark.parametrize("corners", [3, 4])
def test_strips_that_pass_askew(corners: int) -> None:
    """Strips, and needles in any direction; either way round gives the same bits."""
    turn = torch.eye(3, dtype=torch.float64)
    if corners == 3:  # three corners stay in a plane when they are rounded
        turn = torch.linalg.qr(Draw(7, torch.float64).uniform(3, 3, low=-1)).Q
        turn = turn * torch.linalg.det(turn)
    askew = torch.tensor([[0.875, -0.375, 0], [0.375, 0.875, 0], [0, 0, 1]], dtype=torch.float64)
    for length, gap in ((4096.0, 1024.0), (2.0**15, 128.0)):
        lift = torch.tensor([0, -length / 8, gap], dtype=torch.float64)
        pair = [strip(length)[:corners] @ turn, (strip(length).flip(0) @ askew + lift) @ turn]
        first, second = (t[:corners].unsqueeze(0) for t in pair)
        found = transport.polygon_exchange(first, second)
        exact = truth.exchange(first[0], second[0])
        assert truth.relative(float(found), exact) < FORM_FACTORS[torch.float64]
        assert torch.equal(found, transport.polygon_exchange(second, first))


@pytest.mark.parametrize("ratio", [2.0**10, 2.0**20])
def test_strips_that_meet_in_an_edge(ratio: float) -> None:
    """At a right angle and in any direction, which rounds them: normals keep to the edge."""
    turn = torch.linalg.qr(Draw(7, torch.float64).uniform(3, 3, low=-1)).Q
    floor = strip(ratio) @ turn
    wall = strip(ratio)[[0, 3, 2, 1]][:, [2, 1, 0]] @ turn
    found = transport.polygon_exchange(floor[None], wall[None]) / ratio
    exact = truth.perpendicular_rectangles(1.0, 1.0, ratio)
    assert truth.relative(float(found), exact) < FORM_FACTORS[torch.float64]


@pytest.mark.parametrize("ratio", [1e4, 1e5])
def test_needles_that_the_plane_of_the_other_cuts(ratio: float) -> None:
    """Which exchange little for their perimeters."""
    draw, seen = Draw(int(ratio), torch.float64), 0
    while seen < 2:
        pair = draw.uniform(2, 3, 3, low=-1)
        pair[:, 2] = pair[:, 1] + draw.uniform(2, 3, low=-1) / ratio
        normal = vector_area(pair)
        height = ((pair - pair.flip(0)[:, :1]) * normal.flip(0).unsqueeze(1)).sum(-1) * ratio
        if height.amax() < 0.25 or height.amax(1).min() < 0.25 or height.amin() > -0.25:
            continue
        exact = truth.exchange(*pair)
        found = transport.polygon_exchange(*pair.unsqueeze(1))
        assert truth.relative(float(found), exact) < FORM_FACTORS[torch.float64]
        seen += 1


def largest_error(found: Tensor, exact: list) -> float:
    """Of a vector, relative to its largest value."""
    largest = max(abs(x) for x in exact)
    values = found.detach().flatten().tolist()
    return float(max(abs(truth.mpf(f) - x) for f, x in zip(values, exact, strict=True)) / largest)


SOLVERS = (solve.ConjugateGradient(), solve.Direct(), solve.GaussSeidel())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("albedo", [0.5, 0.999])
def test_radiosity_and_its_gradients(kind: str, albedo: float) -> None:
    """Of solvers that say they converged; sweeps that did not are within their bound."""
    for dtype in (torch.float64, torch.float32):
        operator, draw = room(kind, 8, dtype, 1), Draw(3, dtype)
        rho = torch.full((8, 1), albedo, dtype=dtype)
        light, wanted = (draw.rounded(draw.uniform(8, 1)) for _ in range(2))
        system = (operator.form_factors, rho[:, 0], light[:, 0])
        exact, slopes = truth.radiosity(*system), truth.radiosity_gradients(*system, wanted[:, 0])
        condition = truth.condition(*system[:2])
        expected = [*slopes[:2], [x for row in slopes[2] for x in row]]
        for solver in SOLVERS:
            leaves = [t.clone().requires_grad_() for t in (rho, light, operator.form_factors)]
            held = solve.DenseOperator(leaves[2], operator.area)
            found = solve.Implicit().solve(solver, held, *leaves[:2])
            error = largest_error(found.radiosity, exact)
            if found.status.any():
                largest = float(max(abs(x) for x in exact))
                assert isinstance(solver, solve.GaussSeidel)
                assert error * largest <= float(found.bound.max())
                continue
            if dtype == torch.float32:
                assert error < RADIOSITY_32
                continue
            assert error < max(CONDITIONED * condition, 4 * torch.finfo(dtype).eps)
            gradients = torch.autograd.grad((found.radiosity * wanted).sum(), leaves)
            for gradient, slope in zip(gradients, expected, strict=True):
                assert largest_error(gradient, slope) < GRADIENTS


def test_mpmath_agrees_with_itself() -> None:
    """The contour integral gives the closed forms of both plates."""
    square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)
    wall = square[:, [2, 1, 0]]
    facing = square.flip(0) + square.new_tensor([0, 0, 1.0])
    assert (
        truth.relative(float(truth.parallel_rectangles(1, 1, 1)), truth.exchange(square, facing))
        < 1e-15
    )
    assert math.isclose(
        max(float(truth.exchange(square, w)) for w in (wall, wall.flip(0))),
        float(truth.perpendicular_rectangles(1, 1, 1)),
        rel_tol=1e-15,
    )
