"""Exchange of two polygons: closed forms, similar figures, product quadrature, symmetries."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry import transport
from torchradiometry.geometry.patches import Patches, subdivide
from torchradiometry.reference.closed_forms import parallel_rectangles, perpendicular_rectangles

#: the promise of the default `rtol`
EXACT = 1e-10
#: rounding of the contour integral: 1e-16 times both perimeters (6 to 7) over 2 pi
ROUNDING = 1e-15
SQUARE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)


def exchange(first: Tensor, second: Tensor, rtol: float = 1e-10) -> Tensor:
    return transport.polygon_exchange(first.unsqueeze(0), second.unsqueeze(0), rtol)[0]


def product_rule(first: Tensor, second: Tensor, points: int = 24) -> float:
    """The defining integral by Gauss-Legendre points on two parallelograms, in NumPy.

    Independent of the package, and exact to rounding where the two lie apart and wholly in
    front of each other.
    """
    node, weight = np.polynomial.legendre.leggauss(points)
    u, v = (t.reshape(-1, 1) for t in np.meshgrid((node + 1) / 2, (node + 1) / 2))
    w = np.outer(weight, weight).reshape(-1) / 4
    sides = []
    for corners in (first.numpy(), second.numpy()):
        a, b = corners[1] - corners[0], corners[3] - corners[0]
        sides.append((corners[0] + u * a + v * b, np.cross(a, b)))
    (x, m), (y, n) = sides
    offset = y[None] - x[:, None]
    square = (offset**2).sum(-1)
    kernel = (offset @ m) * -(offset @ n) / square**2
    return float(w @ kernel @ w) / math.pi


def quarters(corners: Tensor) -> list[Tensor]:
    """A parallelogram in 2 x 2 parts, in the order (u, v) = 00, 01, 10, 11."""
    parts = subdivide(Patches(corners.unsqueeze(0)), 1e-9 + float(longest(corners)) / 2)[0]
    assert parts.count == 4
    return list(parts.corners)


def longest(corners: Tensor) -> Tensor:
    return (corners.roll(-1, 0) - corners).norm(dim=-1).max()


def with_common_corner(first: Tensor, second: Tensor) -> float:
    """Parallelograms that share corner 0: the parts there are similar to the whole, K/4."""
    parts = [(a, b) for a in quarters(first) for b in quarters(second)]
    return 4 / 3 * sum(product_rule(a, b) for a, b in parts[1:])


def with_common_edge(first: Tensor, second: Tensor) -> float:
    """Parallelograms that share the edge from corner 0 to 3 of `first`, 0 to 1 of `second`.

    Of the 16 pairs of quarters two are similar to the whole, two share a corner, 12 lie apart.
    """
    a, b = quarters(first), quarters(second)
    total = 0.0
    for i, k in ((0, 2), (1, 0)):  # along the edge, beside each other
        others = [product_rule(a[i], q) for m, q in enumerate(b) if m not in (0, 2)]
        total += sum(others) + with_common_corner(*about_common_corner(a[i], b[k]))
    total += sum(product_rule(p, q) for p in a[2:] for q in b)
    return 2 * total


def about_common_corner(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """Both rotated so that the corner they share is the first."""
    distance = torch.cdist(first, second)
    i, j = divmod(int(distance.argmin()), 4)
    assert distance[i, j] < 1e-12
    return first.roll(-i, 0), second.roll(-j, 0)


def wedge(degrees: float) -> Tensor:
    """A unit square on the edge x = 0 of `SQUARE`, at an angle to it, fronts inside."""
    angle = math.radians(degrees)
    rise = SQUARE.new_tensor([math.cos(angle), 0, math.sin(angle)])
    along = SQUARE.new_tensor([0.0, 1, 0])
    return torch.stack((0 * along, along, along + rise, rise))


def random_polygon(generator: torch.Generator, corners: int) -> Tensor:
    """A convex polygon about the origin, of any orientation."""
    step = torch.rand(corners, generator=generator, dtype=torch.float64) + 0.3
    angle = step.cumsum(0) * 2 * math.pi / step.sum()
    flat = torch.stack((angle.cos(), angle.sin(), 0 * angle), -1)
    frame = torch.linalg.qr(torch.randn(3, 3, generator=generator, dtype=torch.float64))[0]
    return flat @ (frame * torch.linalg.det(frame))


@pytest.mark.parametrize("gap", [1e-6, 1e-3, 0.3, 1.0, 3.0, 10.0])
def test_parallel_squares(gap: float) -> None:
    facing = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, gap])
    assert_close(exchange(SQUARE, facing), parallel_rectangles(1, 1, gap), rtol=EXACT)


@pytest.mark.parametrize("height", [1e-3, 0.1, 1.0, 10.0, 1e3])
def test_perpendicular_rectangles(height: float) -> None:
    wall = SQUARE.new_tensor([[0, 0, 0], [0, 1, 0], [0, 1, height], [0, 0, height]])
    assert_close(exchange(SQUARE, wall), perpendicular_rectangles(1, height, 1), rtol=EXACT)


@pytest.mark.parametrize("degrees", [75, 90, 120, 150, 170, 179])
def test_squares_with_a_common_edge(degrees: float) -> None:
    expected = with_common_edge(SQUARE, wedge(degrees))
    assert_close(exchange(SQUARE, wedge(degrees)), expected, rtol=EXACT)


@pytest.mark.parametrize("degrees", [75, 90, 120, 150, 179])
def test_squares_with_a_common_corner(degrees: float) -> None:
    beside = wedge(degrees) - SQUARE.new_tensor([0, 1, 0])
    expected = with_common_corner(SQUARE, beside.roll(-1, 0))
    assert_close(exchange(SQUARE, beside), expected, rtol=EXACT)


@pytest.mark.parametrize("degrees", [1, 5, 20, 45])
def test_narrow_wedges_add_up(degrees: float) -> None:
    """Closed prisms: what leaves one side reaches the others, and nothing else."""
    first, second = SQUARE, wedge(degrees)
    across = torch.stack((SQUARE[1], second[3], second[2], SQUARE[2]))
    ends = [torch.stack((SQUARE[0], second[3], SQUARE[1]))]
    ends.append(torch.stack((SQUARE[3], SQUARE[2], second[2])))
    total = sum(exchange(first, other) for other in (second, across, *ends))
    assert_close(total, 1.0)


@pytest.mark.parametrize("degrees", [20, 90, 160])
def test_a_gap_of_1e_6_hardly_matters(degrees: float) -> None:
    apart = wedge(degrees) - SQUARE.new_tensor([1e-6, 0, 0])
    whole, found = exchange(SQUARE, wedge(degrees)), exchange(SQUARE, apart)
    # the strip of the floor's continuation below the moved wall, cut off by hand
    strip = SQUARE * SQUARE.new_tensor([1e-6, 1, 1]) - SQUARE.new_tensor([1e-6, 0, 0])
    longer = torch.stack((strip[0], SQUARE[1], SQUARE[2], strip[3]))
    assert_close(found, exchange(longer, apart) - exchange(strip, apart), rtol=EXACT)
    assert abs(float(found / whole) - 1) < 1e-4


@pytest.mark.parametrize("distance", [2.0, 5.0, 30.0, 1e3, 1e4, 1e6])
@pytest.mark.parametrize("tilt", [0.3, 1.2])
def test_distant_squares(distance: float, tilt: float) -> None:
    turn = SQUARE.new_tensor(
        [[math.cos(tilt), 0, math.sin(tilt)], [0, 1, 0], [-math.sin(tilt), 0, math.cos(tilt)]]
    )
    far = SQUARE.flip(0) @ turn.mT + distance * SQUARE.new_tensor([0.3, 0.2, 1.0])
    assert_close(exchange(SQUARE, far), product_rule(SQUARE, far.roll(1, 0)), rtol=EXACT)


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6, 1e-8])
def test_rtol_is_kept_whatever_the_pair(rtol: float) -> None:
    generator = torch.Generator().manual_seed(11)
    for corners in (3, 4):
        first, second = (
            torch.stack([random_polygon(generator, corners) for _ in range(400)]) for _ in range(2)
        )
        spread = 10 ** (2 * torch.rand(400, 1, 1, generator=generator, dtype=torch.float64))
        offset = torch.nn.functional.normalize(
            torch.randn(400, 1, 3, generator=generator, dtype=torch.float64), dim=-1
        )
        second = second * spread ** -torch.rand(400, 1, 1, generator=generator).double()
        second = second + offset * spread
        exact = transport.polygon_exchange(first, second, 1e-12)
        found = transport.polygon_exchange(first, second, rtol)
        assert (exact > 0).sum() > 50
        assert_close(found, exact, rtol=rtol, atol=ROUNDING)


def test_only_the_part_in_front_counts() -> None:
    wall = SQUARE.new_tensor([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    through = SQUARE * 2 - SQUARE.new_tensor([1, 0, 0])
    front = through.clamp(min=0)
    for away in (0.0, 0.7, 20.0):
        lifted = wall + SQUARE.new_tensor([0, away, 0])
        assert_close(exchange(through, lifted), exchange(front, lifted), rtol=EXACT)
        assert_close(exchange(through[:3], lifted), exchange(lifted, through[:3]))
    sunk = wall - SQUARE.new_tensor([0, 0, 0.4])
    top = sunk.clamp(min=0)
    assert_close(exchange(SQUARE, sunk), exchange(SQUARE, top), rtol=EXACT)


def test_pairs_that_see_nothing() -> None:
    up = SQUARE.new_tensor([0, 0, 1])
    others = (
        SQUARE,  # itself
        SQUARE.flip(0),  # coincident, the other way
        SQUARE + SQUARE.new_tensor([2, 0, 0]),  # coplanar
        SQUARE + up,  # its back
        SQUARE.flip(0) - up,  # behind
        SQUARE * 0 + 0.5,  # a point
        SQUARE * SQUARE.new_tensor([1, 0, 0]) + up,  # a line
    )
    for other in others:
        for pair in ((SQUARE, other), (other, SQUARE)):
            leaves = [t.clone().requires_grad_() for t in pair]
            value = exchange(*leaves)
            assert float(value.detach()) == 0
            for gradient in torch.autograd.grad(value, leaves):
                assert torch.isfinite(gradient).all()


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from([3, 4]), st.sampled_from([3, 4]))
def test_symmetries(seed: int, corners: int, others: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    first, second = (random_polygon(generator, n) for n in (corners, others))
    second = second * 0.7 + torch.rand(3, generator=generator, dtype=torch.float64) * 2
    value = exchange(first, second)
    assert torch.equal(value, exchange(second, first))
    assert 0 <= float(value) <= float(Patches(torch.stack((first,))).area)
    for power in (-40, 40):
        assert torch.equal(exchange(first * 2.0**power, second * 2.0**power), value * 4.0**power)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=generator, dtype=torch.float64))[0]
    turn = turn * torch.linalg.det(turn)
    moved = (t @ turn + SQUARE.new_tensor([3.0, -2, 5]) for t in (first, second))
    floor = {"atol": ROUNDING, "rtol": EXACT}
    assert_close(exchange(*moved), value, **floor)
    assert_close(exchange(first.roll(1, 0), second.roll(2, 0)), value, **floor)
    reached = transport.polygon_exchange(first.flip(0).unsqueeze(0), second.unsqueeze(0))
    assert torch.isfinite(reached).all()


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from([3, 4]))
def test_parts_add_up_to_the_whole(seed: int, corners: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    first, second = (random_polygon(generator, corners) for _ in range(2))
    second = second + torch.rand(3, generator=generator, dtype=torch.float64)
    parts = subdivide(Patches(first.unsqueeze(0)), float(longest(first)) / 2)[0].corners
    whole = exchange(first, second)
    by_parts = transport.polygon_exchange(parts, second.expand(len(parts), -1, -1)).sum()
    assert_close(by_parts, whole, rtol=EXACT, atol=ROUNDING)


@pytest.mark.parametrize("place", [1e3, 1e6])
def test_far_from_the_origin(place: float) -> None:
    pair = [SQUARE * 0.125, wedge(90) * 0.125]
    moved = [t + place for t in pair]
    assert_close(exchange(*moved), exchange(*pair), rtol=EXACT)


@pytest.mark.parametrize("case", ["apart", "far", "common corner", "common edge", "cut"])
def test_gradients(case: str) -> None:
    generator = torch.Generator().manual_seed(3)
    points = torch.tensor(
        [[0, 0, 0], [1, 0.1, 0], [0.9, 1, 0], [0.1, 0.8, 0.0]], dtype=torch.float64
    )
    raised = random_polygon(generator, 3).abs() * 0.6
    shift = {"apart": 1.1, "far": 30.0, "cut": 0.4}.get(case, 0.0)

    def value(points: Tensor, raised: Tensor) -> Tensor:
        second = raised + points.new_tensor([0.2, 0.1, shift])
        if case == "common corner":
            second = torch.stack((points[0], second[1], second[2] + points.new_tensor([0, 0, 1.0])))
        if case == "common edge":
            second = torch.stack((points[1], points[0], second[2] + points.new_tensor([0, 0, 1.0])))
        if case == "cut":
            second = second - points.new_tensor([0, 0, 0.5])
        for turned in (second, second.flip(0)):
            found = exchange(points[:3], turned, 1e-12)
            if float(found.detach()) > 0:
                return found
        raise AssertionError("the pair sees nothing")

    leaves = (points.requires_grad_(), raised.requires_grad_())
    assert gradcheck(value, leaves, eps=1e-5, atol=1e-7, rtol=1e-5)


@pytest.mark.parametrize("degrees", [30.0, 90.0, 150.0])
def test_the_derivative_by_the_angle_of_a_wedge(degrees: float) -> None:
    def opened(angle: Tensor) -> Tensor:
        zero = torch.zeros_like(angle)
        rise = torch.stack((angle.cos(), zero, angle.sin()))
        along = SQUARE.new_tensor([0.0, 1, 0])
        return exchange(SQUARE, torch.stack((0 * along, along, along + rise, rise)), 1e-12)

    angle = torch.tensor(math.radians(degrees), dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(opened(angle), angle)
    step = 1e-4
    with torch.no_grad():
        ends = [opened(angle + k * step) for k in (-2, -1, 1, 2)]
    difference = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
    assert_close(slope, difference, rtol=1e-6)


def test_gradients_at_kinks_are_finite() -> None:
    wall = SQUARE.new_tensor([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    crossing = SQUARE - SQUARE.new_tensor([0.5, 0, 0])
    facing = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, 1e-6])
    for first, second in ((SQUARE, wall), (crossing, wall), (SQUARE, facing)):
        leaves = [t.clone().requires_grad_() for t in (first, second)]
        for gradient in torch.autograd.grad(exchange(*leaves), leaves):
            assert torch.isfinite(gradient).all()


def test_the_matrix_is_made_of_the_pairs() -> None:
    generator = torch.Generator().manual_seed(4)
    corners = torch.stack([random_polygon(generator, 3) for _ in range(12)])
    corners = corners + 2 * torch.randn(12, 1, 3, generator=generator, dtype=torch.float64)
    matrix = transport.unoccluded_exchange(Patches(corners))
    i, j = torch.meshgrid(torch.arange(12), torch.arange(12), indexing="ij")
    pairs = transport.polygon_exchange(corners[i.flatten()], corners[j.flatten()]).reshape(12, 12)
    assert torch.equal(matrix, matrix.mT)
    assert_close(matrix, pairs, rtol=1e-12)
    assert (matrix > 0).sum() > 10
    assert transport.unoccluded_exchange(Patches(corners[:0])).shape == (0, 0)


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-7])
def test_blocks_keep_rtol_and_symmetry(rtol: float) -> None:
    """Two walls and a ceiling in many patches, some beyond their planes, far from the origin."""
    wall = SQUARE.new_tensor([[0, 0, -0.3], [0, 1, -0.3], [0, 1, 1], [0, 0, 1]])
    faces = torch.stack((SQUARE, wall, SQUARE.flip(0) + SQUARE.new_tensor([0, 0, 1])))
    patches = subdivide(Patches(faces + 40), 0.2)[0]
    found = transport.unoccluded_exchange(patches, rtol)
    i, j = torch.triu_indices(patches.count, patches.count, 1)
    exact = transport.polygon_exchange(patches.corners[i], patches.corners[j], 1e-12)
    assert torch.equal(found, found.mT)
    assert int((exact > 0).sum()) > 1000
    assert_close(found[i, j], exact, rtol=rtol, atol=ROUNDING)


def test_gradients_of_blocks_are_those_of_pairs() -> None:
    faces = torch.stack((SQUARE, SQUARE.flip(0) + SQUARE.new_tensor([0.3, 0.2, 4])))
    corners = subdivide(Patches(faces), 0.34)[0].corners
    i, j = torch.triu_indices(len(corners), len(corners), 1)
    weight = torch.rand(len(i), generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    one, other = (corners.clone().requires_grad_() for _ in range(2))
    # at distances of 12 sizes one degree serves all pairs: the same rule either way
    matrix = transport.unoccluded_exchange(Patches(one), 1e-4)[i, j]
    pairs = transport.polygon_exchange(other[i], other[j], 1e-4)
    found, expected = (
        torch.autograd.grad((value * weight).sum(), leaf)[0]
        for value, leaf in ((matrix, one), (pairs, other))
    )
    assert float(expected.abs().max()) > 0
    assert_close(found, expected, rtol=1e-9, atol=1e-12 * float(expected.abs().max()))
