"""Depth maps: planes exactly, masks, gradients, graphs."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import OutOfRangeError, ShapeError
from torchradiometry.geometry.cameras import OrthographicCamera, PinholeCamera
from torchradiometry.geometry.depth import (
    DepthToNormals,
    DepthToPoints,
    depth_to_normals,
    depth_to_points,
    points_to_normals,
)

EYE = torch.eye(4, dtype=torch.float64)
PINHOLE = PinholeCamera(width=9, height=7, yfov=0.9, camera_to_world=EYE)
ORTHOGRAPHIC = OrthographicCamera(width=9, height=7, ymag=1.2, camera_to_world=EYE)
PERSPECTIVE = {"intrinsics": PINHOLE.intrinsics}
PARALLEL = {"pixel_size": 1 / ORTHOGRAPHIC.scale}
KINDS = pytest.mark.parametrize("camera", [PINHOLE, ORTHOGRAPHIC], ids=["pinhole", "orthographic"])


def options(camera: object) -> dict:
    return PERSPECTIVE if camera is PINHOLE else PARALLEL


def plane_depth(camera, normal: Tensor, distance: float) -> Tensor:
    """Depth map `1 1 H W` of the plane n . x = -distance."""
    rays = camera.rays(camera.pixel_grid())
    along = (-distance - rays.origin @ normal) / (rays.direction @ normal)
    points = rays.origin + along.unsqueeze(-1) * rays.direction
    return camera.depth(points)[None, None]


@KINDS
@settings(deadline=None, max_examples=30)
@given(polar=st.floats(0, 0.9), azimuth=st.floats(0, 6.2), distance=st.floats(0.5, 100))
def test_normals_of_planes_are_exact(camera, polar, azimuth, distance) -> None:
    sine = math.sin(polar)
    normal = torch.tensor(
        [sine * math.cos(azimuth), sine * math.sin(azimuth), math.cos(polar)], dtype=torch.float64
    )
    depth = plane_depth(camera, normal, distance)
    found = depth_to_normals(depth, **options(camera))
    assert_close(found, normal.reshape(1, 3, 1, 1).expand_as(found), rtol=0, atol=1e-12 * distance)


@KINDS
def test_points_are_those_of_the_camera(camera, generator: torch.Generator) -> None:
    depth = torch.rand(1, 1, 7, 9, dtype=torch.float64, generator=generator) + 1
    expected = camera.unproject(camera.pixel_grid(), depth[0, 0]).permute(2, 0, 1)
    assert_close(depth_to_points(depth, **options(camera))[0], expected)


@KINDS
def test_masked_pixels_stay_alone(camera) -> None:
    normal = torch.tensor([0.3, -0.2, 0.9], dtype=torch.float64)
    normal = normal / normal.norm()
    depth = plane_depth(camera, normal, 3.0)
    masked = depth.clone()
    masked[0, 0, 3, 4], masked[0, 0, 0, 0], masked[0, 0, 6, 8] = math.nan, math.inf, -math.inf
    masked.requires_grad_()
    found = depth_to_normals(masked, **options(camera))
    hidden = ~torch.isfinite(masked[0, 0])
    assert (found[0][:, hidden] == 0).all()
    seen = found[0][:, ~hidden]
    assert_close(seen, normal.unsqueeze(1).expand_as(seen), rtol=0, atol=1e-12)
    (found * torch.arange(found.numel()).reshape(found.shape)).sum().backward()
    assert torch.isfinite(masked.grad).all()
    assert (masked.grad[0, 0][hidden] == 0).all()
    points = depth_to_points(masked.detach(), **options(camera))
    assert torch.isnan(points[0][:, hidden]).all()
    assert torch.isfinite(points[0][:, ~hidden]).all()
    assert_close(points_to_normals(points), found.detach(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (6, 1)])
def test_no_plane_through_a_row(shape: tuple[int, int]) -> None:
    normals = depth_to_normals(torch.ones(2, 1, *shape), pixel_size=0.1)
    assert normals.shape == (2, 3, *shape)
    assert (normals == 0).all()


def test_everything_masked() -> None:
    assert (depth_to_normals(torch.full((1, 1, 3, 3), math.nan), pixel_size=0.1) == 0).all()


def test_isolated_pixel_has_no_normal() -> None:
    depth = torch.full((1, 1, 3, 3), math.nan)
    depth[0, 0, 1, 1] = 1.0
    assert (depth_to_normals(depth, pixel_size=0.1) == 0).all()


@KINDS
def test_normals_of_a_ball_face_the_camera_and_out(camera) -> None:
    """Central differences are second order: halving the pixels quarters the error."""
    errors = []
    for fine in (40, 80):
        lens = {"width": fine, "height": fine, "camera_to_world": EYE}
        if camera is PINHOLE:
            seen = PinholeCamera(yfov=0.3, **lens)
            kind = {"intrinsics": seen.intrinsics}
        else:
            seen = OrthographicCamera(ymag=1.0, **lens)
            kind = {"pixel_size": 1 / seen.scale}
        rays = seen.rays(seen.pixel_grid())
        middle = torch.tensor([0.0, 0.0, -8.0], dtype=torch.float64)
        offset = rays.origin - middle
        half = (offset * rays.direction).sum(-1)
        inside = half**2 - (offset**2).sum(-1) + 1
        along = -half - inside.clamp(min=0).sqrt()
        points = rays.origin + along.unsqueeze(-1) * rays.direction
        depth = torch.where(inside > 0, seen.depth(points), math.nan)[None, None]
        found = depth_to_normals(depth, **kind)[0].permute(1, 2, 0)
        core = inside > 0.5
        errors.append(float((found - (points - middle))[core].norm(dim=-1).max()))
        facing = -(found * rays.direction).sum(-1)[inside > 0]
        assert (facing >= 0).all()
    assert errors[0] < 0.01
    assert errors[1] < errors[0] / 3


@KINDS
def test_gradients(camera, generator: torch.Generator) -> None:
    depth = torch.rand(2, 1, 3, 4, dtype=torch.float64, generator=generator) + 1
    depth[0, 0, 1, 1] = math.nan
    seen = torch.isfinite(depth)
    free = depth[seen].clone().requires_grad_()
    where = seen.flatten().nonzero().squeeze(-1)

    def laid(values: Tensor) -> Tensor:
        base = torch.full((depth.numel(),), math.nan, dtype=torch.float64)
        return base.index_put((where,), values).reshape(depth.shape)

    kind = options(camera)
    assert gradcheck(lambda v: depth_to_normals(laid(v), **kind), (free,))
    assert gradcheck(lambda v: torch.nan_to_num(depth_to_points(laid(v), **kind)), (free,))
    matrix = PINHOLE.intrinsics.expand(2, 3, 3).clone().requires_grad_()
    assert gradcheck(lambda k: depth_to_normals(laid(free.detach()), k), (matrix,))


def test_float32_loses_nothing_that_the_depth_has(generator: torch.Generator) -> None:
    depth = 100 + torch.rand(1, 1, 20, 20, generator=generator) * 0.01
    fine = depth_to_normals(depth.double(), pixel_size=0.01)
    assert_close(depth_to_normals(depth, pixel_size=0.01), fine.float())


def test_per_image_intrinsics() -> None:
    depth = torch.rand(2, 1, 3, 4, dtype=torch.float64) + 1
    both = torch.stack((PINHOLE.intrinsics, PINHOLE.intrinsics * torch.tensor([[2.0], [2], [1]])))
    found = depth_to_points(depth, both)
    assert_close(found[1:], depth_to_points(depth[1:], both[1]))


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"depth": torch.ones(1, 3, 4, 4), "pixel_size": 1.0}, ShapeError),
        ({"depth": torch.ones(4, 4), "pixel_size": 1.0}, ShapeError),
        ({"depth": torch.ones(1, 1, 0, 4), "pixel_size": 1.0}, ShapeError),
        ({"depth": torch.ones(1, 1, 4, 4)}, ShapeError),
        ({"depth": torch.ones(1, 1, 4, 4), "pixel_size": 1.0, "intrinsics": EYE}, ShapeError),
        ({"depth": torch.ones(1, 1, 4, 4), "intrinsics": EYE}, ShapeError),
    ],
)  # fmt: skip
def test_refuses(arguments, error) -> None:
    with pytest.raises(error):
        depth_to_points(**arguments)


def test_layers() -> None:
    depth = torch.rand(2, 1, 3, 4) + 1
    matrix = PINHOLE.intrinsics.float()
    assert_close(DepthToNormals()(depth, matrix), depth_to_normals(depth, matrix))
    assert_close(DepthToPoints(0.5)(depth), depth_to_points(depth, pixel_size=0.5))
    assert "0.5 [m]" in repr(DepthToPoints(0.5))
    with pytest.raises(OutOfRangeError):
        DepthToNormals(pixel_size=0.0)


@KINDS
def test_one_graph(camera) -> None:
    compiled = torch.compile(depth_to_normals, fullgraph=True, backend="eager")
    for size in ((2, 1, 3, 4), (1, 1, 5, 6)):
        depth = torch.rand(*size, dtype=torch.float64) + 1
        expected = depth_to_normals(depth, **options(camera))
        assert_close(compiled(depth, **options(camera)), expected)
