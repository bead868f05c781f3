"""The double integral of ln r over two edges, against high-precision quadrature by mpmath."""

from __future__ import annotations

from itertools import pairwise

import mpmath
import pytest
import torch
from torch import Tensor

from tests.tolerances import assert_close
from torchradiometry.reference.closed_forms import parallel_rectangles, perpendicular_rectangles
from torchradiometry.transport.contour import _mean_logarithm, contour_exchange, log_distance

#: names and the two edges, start and end each
EDGES = {
    "one edge, opposite senses": ([[0, 0, 0], [1, 0, 0]], [[1, 0, 0], [0, 0, 0]]),
    "overlapping on a line": ([[0, 0, 0], [1, 0, 0]], [[1.5, 0, 0], [0.25, 0, 0]]),
    "a common corner": ([[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0.3, 0.4, 0.5]]),
    "a corner on an edge": ([[0, 0, 0], [1, 0, 0]], [[0.3, 0, 0], [0.3, 0.1, 0.7]]),
    "crossing": ([[0, 0, 0], [1, 0, 0]], [[0.25, -0.5, 0], [0.5, 1, 0]]),
    "crossing at 1e-6": ([[0, 0, 0], [1, 0, 0]], [[0.25, -0.5, 1e-6], [0.5, 1, 1e-6]]),
    "parallel at 1e-6": ([[0, 0, 0], [1, 0, 0]], [[0.9, 1e-6, 0], [-0.2, 1e-6, 0]]),
    "skew": ([[0, 0, 0], [1, 0, 0]], [[0.3, 0.4, 0.2], [1, 1, 0.5]]),
    "a short one beside a long one": ([[0, 0, 0], [1, 0, 0]], [[0.4, 1e-3, 0], [0.4, 2e-3, 1e-3]]),
}


def inner(x: list, start: list, end: list) -> mpmath.mpf:
    """Mean of ln |x - y| over y on an edge, in high precision."""
    p, q = ([b - a for a, b in zip(x, c, strict=True)] for c in (start, end))
    f = [b - a for a, b in zip(p, q, strict=True)]
    cross = (p[1] * f[2] - p[2] * f[1], p[2] * f[0] - p[0] * f[2], p[0] * f[1] - p[1] * f[0])
    bend = mpmath.norm(cross)
    logs = [mpmath.fdot(c, f) * mpmath.log(mpmath.norm(c)) for c in (p, q) if any(c)]
    signed = logs[-1] - logs[0] if len(logs) == 2 else logs[0] * (1 if any(q) else -1)
    turn = bend * mpmath.atan2(bend, mpmath.fdot(p, q))
    return (signed + turn) / mpmath.fdot(f, f) - 1


def mean_logarithm(first: list, second: list) -> mpmath.mpf:
    """The same averaged over the first edge, cut where it is singular and graded towards there."""
    a, b, c, d = ([mpmath.mpf(v) for v in point] for point in (*first, *second))
    edge = [y - x for x, y in zip(a, b, strict=True)]
    cuts = {mpmath.mpf(0), mpmath.mpf(1)}
    for point in (c, d, [(1 - mpmath.mpf(1) / 3) * x + y / 3 for x, y in zip(c, d, strict=True)]):
        offset = [x - y for x, y in zip(point, a, strict=True)]
        cuts.add(mpmath.fdot(offset, edge) / mpmath.fdot(edge, edge))
    cuts = sorted(s for s in cuts if 0 <= s <= 1)
    graded = set(cuts)
    for low, high in pairwise(cuts):
        for k in range(1, 13):
            step = (high - low) * mpmath.mpf(8) ** -k
            graded |= {low + step, high - step}
    return mpmath.quad(
        lambda s: inner([x + s * e for x, e in zip(a, edge, strict=True)], c, d),
        sorted(graded),
        method="gauss-legendre",
        maxdegree=4,
    )


def square_contour(first: Tensor, second: Tensor, tolerance: float = 1e-15) -> Tensor:
    planes = (t.unsqueeze(0).permute(2, 1, 0) for t in (first, second))
    return contour_exchange(*planes, torch.tensor([tolerance], dtype=torch.float64))[0]


def found_mean(first: list, second: list, tolerance: float) -> Tensor:
    rows = (torch.tensor(edge, dtype=torch.float64) for edge in (first, second))
    outer, other = (torch.stack((t[0], t[1] - t[0])).unsqueeze(-1) for t in rows)
    return _mean_logarithm(outer, other, outer.new_tensor([tolerance]))[0] - 1


@pytest.mark.parametrize("name", EDGES)
def test_edge_pairs(name: str) -> None:
    first, second = EDGES[name]
    with mpmath.workdps(20):
        expected = float(mean_logarithm(first, second))
    for pair in ((first, second), (second, first)):
        assert_close(found_mean(*pair, 1e-16), expected, rtol=0, atol=2e-15)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9, 1e-12])
def test_the_tolerance_is_kept(tolerance: float) -> None:
    for pair in EDGES.values():
        expected = found_mean(*pair, 1e-16)
        assert_close(found_mean(*pair, tolerance), expected, rtol=0, atol=tolerance)


SQUARE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)


@pytest.mark.parametrize("gap", [1e-6, 1e-3, 0.3, 1.0, 4.0])
def test_parallel_squares(gap: float) -> None:
    facing = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, gap])
    assert_close(square_contour(SQUARE, facing), parallel_rectangles(1, 1, gap))


@pytest.mark.parametrize("height", [1e-2, 1.0, 1e2])
def test_perpendicular_rectangles(height: float) -> None:
    wall = SQUARE.new_tensor([[0, 0, 0], [0, 1, 0], [0, 1, height], [0, 0, height]])
    assert_close(square_contour(SQUARE, wall), perpendicular_rectangles(1, height, 1))


def test_the_logarithm_on_its_own_edge_is_finite_with_its_gradient() -> None:
    start = torch.tensor([[-0.25], [0], [0]], dtype=torch.float64, requires_grad=True)
    end = torch.tensor([[0.75], [0], [0]], dtype=torch.float64, requires_grad=True)
    value = log_distance(start, end).sum()
    quarter = torch.tensor(0.25, dtype=torch.float64)
    expected = quarter * quarter.log() + (1 - quarter) * (1 - quarter).log()
    assert_close(value.detach(), expected)
    for gradient in torch.autograd.grad(value, (start, end)):
        assert torch.isfinite(gradient).all()
    corner = log_distance(torch.zeros(3, 1), torch.tensor([[2.0], [0], [0]]))
    assert_close(corner, torch.tensor(2.0).log())


def test_repeated_corners_change_nothing() -> None:
    wall = SQUARE.new_tensor([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    repeated = torch.cat((wall, wall[-1:]))
    assert_close(square_contour(SQUARE, repeated), square_contour(SQUARE, wall))
