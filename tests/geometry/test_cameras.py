"""Cameras: closed forms, round trips, named errors."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import (
    DegenerateGeometryError,
    DTypeError,
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
)
from torchradiometry.geometry.cameras import (
    AbstractCamera,
    OrthographicCamera,
    PinholeCamera,
    look_at,
    rigid,
)

PLACE = look_at(torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64), [-0.5, 0.3, 0.2])


def pinhole(place: Tensor = PLACE) -> AbstractCamera:
    return PinholeCamera(width=40, height=30, yfov=0.8, camera_to_world=place)


def orthographic(place: Tensor = PLACE) -> AbstractCamera:
    return OrthographicCamera(width=40, height=30, ymag=1.5, camera_to_world=place)


BOTH = pytest.mark.parametrize("make", [pinhole, orthographic])


def test_pinhole_by_hand() -> None:
    """At 90 degrees the picture is as high as twice the distance."""
    camera = PinholeCamera(
        width=4, height=2, yfov=math.pi / 2, camera_to_world=torch.eye(4, dtype=torch.float64)
    )
    points = torch.tensor([[-6.0, 3.0, -3.0], [6.0, -3.0, -3.0]], dtype=torch.float64)
    assert_close(camera.project(points), [[0.0, 0.0], [4.0, 2.0]])
    assert_close(camera.depth(points), [3.0, 3.0])
    assert_close(camera.intrinsics, [[1.0, 0, 2], [0, 1, 1], [0, 0, 1]])
    corner = camera.rays(torch.tensor([0.0, 0.0], dtype=torch.float64)).direction
    assert_close(corner, torch.tensor([-2.0, 1.0, -1.0]).double() / math.sqrt(6))


def test_orthographic_by_hand() -> None:
    camera = OrthographicCamera(
        width=4, height=2, ymag=3.0, camera_to_world=torch.eye(4, dtype=torch.float64)
    )
    assert_close(camera.project(torch.tensor([[-6.0, 3.0, 5.0]]).double()), [[0.0, 0.0]])
    rays = camera.rays(torch.tensor([[4.0, 2.0]], dtype=torch.float64))
    assert_close(rays.origin, [[6.0, -3.0, 0.0]])
    assert_close(rays.direction, [[0.0, 0.0, -1.0]])
    assert camera.scale == pytest.approx(1 / 3)


@BOTH
def test_pixel_grid(make) -> None:
    grid = make().pixel_grid()
    assert grid.shape == (30, 40, 2)
    assert grid[0, 0].tolist() == [0.5, 0.5]
    assert grid[29, 39].tolist() == [39.5, 29.5]
    assert make().rays(grid).direction.shape == (30, 40, 3)


@BOTH
@settings(deadline=None, max_examples=30)
@given(
    u=st.floats(-50, 100), v=st.floats(-50, 100), d=st.floats(0.01, 1e4), seed=st.integers(0, 99)
)
def test_round_trips(make, u: float, v: float, d: float, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    eye, target = torch.randn(2, 3, dtype=torch.float64, generator=generator)
    camera = make(look_at(eye, target))
    pixel, depth = torch.tensor([u, v]).double(), torch.tensor(d).double()
    point = camera.unproject(pixel, depth)
    assert_close(camera.project(point), pixel, rtol=1e-12, atol=1e-10 / min(d, 1.0))
    assert_close(camera.depth(point), depth, rtol=1e-12, atol=1e-14)
    ray = camera.rays(pixel)
    off = torch.linalg.cross(point - ray.origin, ray.direction)
    assert off.norm() < 1e-12 * (1 + (point - ray.origin).norm())
    assert_close(ray.direction.norm(), 1.0)


@BOTH
def test_round_trip_of_a_batch_to_full_precision(make, generator: torch.Generator) -> None:
    camera = make()
    pixels = camera.pixel_grid().expand(2, -1, -1, -1)
    depth = torch.rand(2, 30, 40, dtype=torch.float64, generator=generator) + 1
    points = camera.unproject(pixels, depth)
    assert points.shape == (2, 30, 40, 3)
    assert_close(camera.project(points), pixels, atol=1e-12)
    assert_close(camera.project(points.float()), pixels.float(), rtol=1e-5, atol=1e-4)


@BOTH
def test_gradients(make, generator: torch.Generator) -> None:
    points = torch.randn(4, 3, dtype=torch.float64, generator=generator).requires_grad_()
    pixels = (torch.rand(4, 2, dtype=torch.float64, generator=generator) * 30).requires_grad_()
    depth = torch.ones(4, dtype=torch.float64, requires_grad=True)
    assert gradcheck(make().project, (points,))
    assert gradcheck(lambda p: tuple(make().rays(p)), (pixels,))
    assert gradcheck(make().unproject, (pixels, depth))
    eye = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64, requires_grad=True)
    origin = torch.zeros(3, dtype=torch.float64)
    assert gradcheck(lambda e: make(look_at(e, origin)).project(points.detach()), (eye,))


def test_look_at_looks_there() -> None:
    assert_close(
        pinhole().project(torch.tensor([-0.5, 0.3, 0.2], dtype=torch.float64)), [20.0, 15.0]
    )
    assert_close(pinhole().position, [1.0, 2.0, 3.0])
    above = pinhole().project(torch.tensor([-0.5, 0.4, 0.2], dtype=torch.float64))
    assert above[1] < 15
    assert above[0] == pytest.approx(20, abs=1e-9)


@pytest.mark.parametrize(
    ("eye", "target", "up", "error"),
    [
        ([1.0, 1, 1], [1.0, 1, 1], [0.0, 1, 0], DegenerateGeometryError),
        ([0.0, 5, 0], [0.0, 0, 0], [0.0, 1, 0], DegenerateGeometryError),
        ([0.0, 5, 0], [0.0, 0, 0], [0.0, -3, 0], DegenerateGeometryError),
        ([0.0, 0, 5], [0.0, 0, 0], [0.0, 0, 0], DegenerateGeometryError),
        ([math.nan, 0, 5], [0.0, 0, 0], [0.0, 1, 0], InvalidValueError),
        ([0.0, 5], [0.0, 0, 0], [0.0, 1, 0], ShapeError),
    ],
)
def test_look_at_refuses(eye, target, up, error) -> None:
    with pytest.raises(error, match="look_at"):
        look_at(eye, target, up)


@pytest.mark.parametrize("yfov", [0.0, -1.0, math.pi, 60.0, math.nan])
def test_field_of_view_is_in_radians(yfov: float) -> None:
    with pytest.raises(OutOfRangeError, match="radians"):
        PinholeCamera(width=4, height=4, yfov=yfov, camera_to_world=torch.eye(4))


def test_degrees_are_recognised() -> None:
    with pytest.raises(OutOfRangeError, match=r"if this was in degrees: 1\.047"):
        PinholeCamera(width=4, height=4, yfov=60, camera_to_world=torch.eye(4))


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"width": 0}, OutOfRangeError),
        ({"width": 2.5}, DTypeError),
        ({"camera_to_world": torch.eye(3)}, ShapeError),
        ({"camera_to_world": torch.eye(4) * torch.nan}, InvalidValueError),
        ({"camera_to_world": torch.diag(torch.tensor([2.0, 2, 2, 1]))}, OutOfRangeError),
        ({"camera_to_world": torch.diag(torch.tensor([-1.0, 1, 1, 1]))}, OutOfRangeError),
        ({"camera_to_world": torch.eye(4).long()}, DTypeError),
        ({"ymag": 0.0}, OutOfRangeError),
    ],
)
def test_cameras_refuse(options, error) -> None:
    good = {"width": 4, "height": 4, "ymag": 1.0, "camera_to_world": torch.eye(4)}
    with pytest.raises(error):
        OrthographicCamera(**(good | options))


def test_rigid_drops_scale_and_mirroring() -> None:
    scale = torch.diag(torch.tensor([2.0, 3, 4, 1], dtype=torch.float64))
    assert_close(rigid(PLACE @ scale), PLACE)
    mirrored = rigid(PLACE @ torch.diag(torch.tensor([1.0, -1, 1, 1], dtype=torch.float64)))
    assert_close(mirrored, PLACE)
    with pytest.raises(DegenerateGeometryError):
        rigid(torch.zeros(4, 4))


def test_abstract_camera_cannot_be_made() -> None:
    with pytest.raises(TypeError):
        AbstractCamera(width=1, height=1, camera_to_world=torch.eye(4))


def test_dtype_follows() -> None:
    camera = pinhole().to(torch.float32)
    assert camera.pixel_grid().dtype == torch.float32
    assert camera.rays(camera.pixel_grid()).direction.dtype == torch.float32
