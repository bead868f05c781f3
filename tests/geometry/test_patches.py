"""Patches: area, centroid, subdivision."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import OutOfRangeError, ResourceLimitError, ShapeError
from torchradiometry.geometry.patches import Patches, subdivide


def random_triangles(count: int, seed: int) -> Patches:
    generator = torch.Generator().manual_seed(seed)
    return Patches(torch.randn(count, 3, 3, dtype=torch.float64, generator=generator))


def random_quads(count: int, seed: int) -> Patches:
    """Planar convex quads: corners on a circle, turned into space."""
    generator = torch.Generator().manual_seed(seed)
    steps = torch.rand(count, 4, dtype=torch.float64, generator=generator) + 0.3
    angle = 2 * math.pi * steps.cumsum(-1) / steps.sum(-1, keepdim=True)
    flat = torch.stack((angle.cos(), angle.sin(), torch.zeros_like(angle)), -1)
    turn = torch.linalg.qr(torch.randn(count, 3, 3, dtype=torch.float64, generator=generator))[0]
    return Patches(flat @ turn + torch.randn(count, 1, 3, dtype=torch.float64, generator=generator))


KINDS = pytest.mark.parametrize("make", [random_triangles, random_quads])


def test_trapezoid() -> None:
    """Area (a + b) h / 2; the centroid lies h (a + 2 b) / 3 (a + b) above the long side a."""
    corners = torch.tensor([[[0.0, 0, 7], [4, 0, 7], [3, 2, 7], [1, 2, 7]]], dtype=torch.float64)
    patch = Patches(corners)
    assert patch.count == 1
    assert_close(patch.area, [6.0])
    assert_close(patch.normal, [[0.0, 0, 1]])
    assert_close(patch.centroid, [[2.0, 2 * (4 + 2 * 2) / (3 * 6), 7]])


def test_degenerate() -> None:
    corners = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]], requires_grad=True)
    patch = Patches(corners)
    assert patch.area.tolist() == [0.0]
    assert patch.normal.tolist() == [[0.0, 0, 0]]
    assert_close(patch.centroid.detach(), [[1.0, 0, 0]])
    (patch.centroid.sum() + patch.area.sum() + patch.normal.sum()).backward()
    assert torch.isfinite(corners.grad).all()


@KINDS
@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 1000), max_edge=st.floats(0.1, 5))
def test_subdivision_keeps_the_surface(make, seed: int, max_edge: float) -> None:
    patches = make(5, seed)
    parts, parent = subdivide(patches, max_edge)
    assert (parent.diff() >= 0).all()
    area = torch.zeros(5, dtype=torch.float64).index_add(0, parent, parts.area)
    assert_close(area, patches.area, rtol=1e-12)
    assert_close(parts.normal, patches.normal[parent], rtol=1e-9, atol=1e-9)
    moment = parts.area.unsqueeze(-1) * parts.centroid
    centroid = torch.zeros(5, 3, dtype=torch.float64).index_add(0, parent, moment)
    assert_close(centroid / area.unsqueeze(-1), patches.centroid, rtol=1e-11, atol=1e-12)
    edges = (parts.corners.roll(-1, 1) - parts.corners).norm(dim=-1)
    assert edges.max() <= max_edge * (1 + 1e-5)


def test_counts() -> None:
    corners = torch.tensor([[0.0, 0, 0], [3, 0, 0], [3, 1, 0], [0, 1, 0]], dtype=torch.float64)
    parts, _ = subdivide(Patches(corners[None]), 1.0)
    assert parts.count == 3
    assert_close(parts.area, [1.0, 1.0, 1.0])
    three, _ = subdivide(Patches(corners[None, :3]), 1.0)
    assert three.count == 16  # the diagonal is 3.16 long


def test_whole_multiples_are_not_split_again() -> None:
    side = 0.1 * torch.tensor([[0.0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0]])
    assert subdivide(Patches(side[None]), 0.1)[0].count == 9


@KINDS
def test_gradients(make) -> None:
    corners = make(3, 1).corners.requires_grad_()

    def parts(c: Tensor) -> tuple[Tensor, ...]:
        fine = subdivide(Patches(c), 0.9)[0]
        return fine.corners, fine.area, fine.centroid, fine.normal

    assert gradcheck(parts, (corners,))


@KINDS
def test_none(make) -> None:
    parts, parent = subdivide(make(0, 0), 1.0)
    assert parts.count == 0
    assert parent.tolist() == []


@pytest.mark.parametrize("max_edge", [0.0, -1.0, math.nan, math.inf])
def test_bad_edges(max_edge: float) -> None:
    with pytest.raises(OutOfRangeError):
        subdivide(random_quads(1, 0), max_edge)


def test_too_many() -> None:
    with pytest.raises(ResourceLimitError, match="raise max_edge"):
        subdivide(random_quads(1, 0), 1e-5)


def test_pentagons() -> None:
    with pytest.raises(ShapeError):
        subdivide(Patches(torch.zeros(1, 5, 3)), 1.0)
