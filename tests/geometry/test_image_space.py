"""Image space against the points of the world that it stands for."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from tests.tolerances import assert_close
from torchradiometry.errors import DTypeError, ShapeError
from torchradiometry.geometry import depth_to_normals, depth_to_points
from torchradiometry.geometry.image_space import (
    HeightField,
    View,
    height_field,
    image_normals,
    is_seen,
    ray_slope,
    slices,
    view_of,
)
from torchradiometry.numerics import arccot

F64 = torch.float64
CAMERAS = pytest.mark.parametrize("perspective", [True, False], ids=["pinhole", "parallel"])
#: of the views and points below: some tens of roundings of float64
ROUNDING = 1e-12


def view(perspective: bool) -> View:
    """Pixels that are not square, an axis beside the middle."""
    scales = (70.0, 90.0) if perspective else (14.0, 18.0)
    numbers = (torch.tensor(n, dtype=F64) for n in (*scales, 8.3, 5.9))
    return View(*numbers, perspective)


def image_point(camera: View, level: float, point: Tensor) -> Tensor:
    """(u, v, h) of points in the camera frame, word by word as the module says it."""
    x, y, d = point[..., 0], point[..., 1], -point[..., 2]
    if camera.perspective:
        u, v, h = camera.cx + camera.fx * x / d, camera.cy - camera.fy * y / d, level / d - 1
    else:
        u, v, h = camera.cx + camera.fx * x, camera.cy - camera.fy * y, level - d
    return torch.stack((u, v, h), -1)


def world_point(camera: View, level: float, place: Tensor) -> Tensor:
    """The inverse of `image_point`."""
    u, v, h = place.unbind(-1)
    if camera.perspective:
        d = level / (1 + h)
        x, y = (u - camera.cx) / camera.fx * d, (camera.cy - v) / camera.fy * d
    else:
        d = level - h
        x, y = (u - camera.cx) / camera.fx, (camera.cy - v) / camera.fy
    return torch.stack((x, y, -d), -1)


def slope(camera: View, start: Tensor, direction: Tensor) -> Tensor:
    u, v, h = start.unbind(-1)
    return torch.stack(ray_slope(camera, h, (u, v), direction.unbind(-1)), -1)


def unit(*size: int, generator: torch.Generator) -> Tensor:
    draw = torch.randn(*size, 3, dtype=F64, generator=generator)
    return draw / draw.norm(dim=-1, keepdim=True)


def places(camera: View, count: int, generator: torch.Generator) -> Tensor:
    """Image points around the middle of the picture, heights to either side of the level."""
    draw = torch.rand(count, 3, dtype=F64, generator=generator)
    return draw * torch.tensor([16.0, 12, 0.8]) - torch.tensor([0.0, 0, 0.4])


@CAMERAS
def test_lines_stay_lines(perspective: bool, generator: torch.Generator) -> None:
    """r metres along l lie at P + s D, and s does not depend on where along the picture it is."""
    camera, level = view(perspective), 3.0
    start = places(camera, 200, generator)
    direction = unit(200, generator=generator)
    point, along = world_point(camera, level, start), slope(camera, start, direction)
    for metres in (0.01, 0.3, 1.1):
        end = image_point(camera, level, point + metres * direction)
        s = torch.full((200,), metres, dtype=F64)
        if perspective:
            s = metres / (-point[:, 2] - metres * direction[:, 2])
        assert (s > 0).all()  # nothing here passes the pinhole
        assert_close(end, start + s.unsqueeze(-1) * along, rtol=ROUNDING, atol=ROUNDING)


def test_a_distant_light_ends_where_its_rays_vanish(generator: torch.Generator) -> None:
    """Away from a pinhole every ray of one direction ends in one pixel, at infinity, h = -1."""
    camera = view(perspective=True)
    start = places(camera, 50, generator)
    direction = torch.tensor([0.3, -0.2, -0.6], dtype=F64)
    end = start + slope(camera, start, direction.expand(50, 3)) / 0.6
    u, v = camera.cx + camera.fx * 0.3 / 0.6, camera.cy - camera.fy * -0.2 / 0.6
    vanishing = torch.stack((u, v, torch.tensor(-1.0, dtype=F64)))
    assert_close(end, vanishing.expand(50, 3), rtol=0, atol=1e-11)


@CAMERAS
def test_the_ray_of_a_pixel_hides_the_lower_behind_the_higher(perspective: bool) -> None:
    camera = view(perspective)
    depth = torch.tensor([1.0, 2.0, 5.0], dtype=F64)
    pixel = torch.tensor([[3.2, 9.1, 0.0]], dtype=F64).expand(3, 3).clone()
    pixel[:, 2] = 2.0 / depth - 1 if perspective else 2.0 - depth
    point = world_point(camera, 2.0, pixel)
    assert_close(-point[:, 2], depth)
    apart = point[1:] - point[:1]
    eye = slices(camera, pixel[0, 2], (pixel[0, 0], pixel[0, 1]), as_step(1.0, 0.0)).eye
    assert_close(apart / apart.norm(dim=-1, keepdim=True), -torch.stack(eye).expand(2, 3))


def as_step(across: float, down: float) -> tuple[Tensor, Tensor]:
    return torch.tensor(across, dtype=F64), torch.tensor(down, dtype=F64)


def drawn(generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Image directions of any length."""
    across, down = torch.randn(2, 300, dtype=F64, generator=generator)
    return across, down


@CAMERAS
def test_cotangents_are_those_of_points_in_space(
    perspective: bool, generator: torch.Generator
) -> None:
    """Two points k steps apart: the angle at one of them from the eye to the other."""
    camera, level = view(perspective), 3.0
    start, step = places(camera, 300, generator), drawn(generator)
    cut = slices(camera, start[:, 2], (start[:, 0], start[:, 1]), step)
    eye, side = torch.stack(cut.eye, -1).expand(300, 3), torch.stack(cut.side, -1)
    for size in (eye, side):
        assert_close(size.norm(dim=-1), torch.ones(300, dtype=F64))
    assert_close((eye * side).sum(-1), torch.zeros(300), rtol=0, atol=ROUNDING)
    for count in (0.5, 1.0, 4.0):
        rise = 0.2 * torch.randn(300, dtype=F64, generator=generator)
        end = start + torch.stack((count * step[0], count * step[1], rise), -1)
        way = world_point(camera, level, end) - world_point(camera, level, start)
        way = way / way.norm(dim=-1, keepdim=True)
        theta = arccot(cut.alpha * rise / count + cut.beta)
        found = eye * theta.cos().unsqueeze(-1) + side * theta.sin().unsqueeze(-1)
        assert_close(found, way, rtol=0, atol=1e-11)


@CAMERAS
def test_density_is_the_pace_of_the_azimuth(perspective: bool, generator: torch.Generator) -> None:
    """|d t^ / d a|, for t^ turns about v^ by d phi; and whole turns agree."""
    camera = view(perspective)
    start = places(camera, 300, generator)
    angle = math.tau * torch.rand(300, dtype=F64, generator=generator)
    little = 1e-5

    def cut(a: Tensor) -> tuple[Tensor, Tensor]:
        pixel = (start[:, 0], start[:, 1])
        found = slices(camera, start[:, 2], pixel, (2 * a.cos(), 2 * a.sin()))
        return torch.stack(found.side, -1), found.density

    turn = (cut(angle + little)[0] - cut(angle - little)[0]).norm(dim=-1) / (2 * little)
    assert_close(cut(angle)[1], turn, rtol=1e-8)
    around = torch.arange(64, dtype=F64) * (math.tau / 64)
    total = torch.stack([cut(a.expand(300))[1] for a in around]).mean(0)
    assert_close(total, torch.ones(300, dtype=F64), rtol=1e-11)


def plane(perspective: bool, away: float, pixels: float, dtype: torch.dtype) -> tuple:
    """A plane seen under 60 degrees, about 6 x 7 pixels: its depth, camera and normal."""
    normal = torch.tensor([0.6, -0.61, 0.517], dtype=F64)
    normal = normal / normal.norm()
    v, u = torch.meshgrid(torch.arange(6) + 0.5 - 3, torch.arange(7) + 0.5 - 3.5, indexing="ij")
    x, y = u.double() / pixels, -v.double() / pixels
    if perspective:
        matrix = torch.tensor([[pixels, 0, 3.5], [0, pixels, 3], [0, 0, 1]], dtype=dtype)
        depth = away * normal[2] / (normal[2] - normal[0] * x - normal[1] * y)
        return depth[None, None].to(dtype), {"intrinsics": matrix}, normal
    depth = away + (normal[0] * x + normal[1] * y) / normal[2]
    return depth[None, None].to(dtype), {"pixel_size": 1 / pixels}, normal


@CAMERAS
@pytest.mark.parametrize(("away", "pixels"), [(3.0, 50.0), (1000.0, 5000.0)])
def test_normals_of_planes(perspective: bool, away: float, pixels: float) -> None:
    depth, camera, normal = plane(perspective, away, pixels, F64)
    expected = normal.reshape(1, 3, 1, 1).expand(1, 3, 6, 7)
    # a depth is rounded to away * eps, a pixel is away / pixels (or 1 / pixels) wide
    rounding = 10 * torch.finfo(F64).eps * pixels * (1 if perspective else away)
    assert_close(depth_to_normals(depth, **camera), expected, rtol=0, atol=rounding)


@CAMERAS
@pytest.mark.parametrize(("away", "pixels"), [(3.0, 50.0), (1000.0, 5000.0)])
def test_float32_normals_lose_no_digit_of_float32_depths(
    perspective: bool, away: float, pixels: float
) -> None:
    """The same depths, float32 numbers, in both precisions: normals differ by rounding only."""
    depth, camera, _ = plane(perspective, away, pixels, torch.float32)
    wide_camera = {k: v.double() if isinstance(v, Tensor) else v for k, v in camera.items()}
    expected = depth_to_normals(depth.double(), **wide_camera)
    found = depth_to_normals(depth, **camera)
    assert found.dtype == torch.float32
    assert_close(found, expected.float(), rtol=0, atol=5e-7)


@CAMERAS
@pytest.mark.parametrize("far", [1e3, 1e6, 1e10, -1e6, 0.01])
def test_one_far_pixel_takes_no_digit_from_the_others(perspective: bool, far: float) -> None:
    """A number for the background, or a speck on the lens, that nobody masked."""
    depth, camera, _ = plane(perspective, 3.0, 50.0, torch.float32)
    depth[0, 0, 0, 0] = far
    wide_camera = {k: v.double() if isinstance(v, Tensor) else v for k, v in camera.items()}
    expected = depth_to_normals(depth.double(), **wide_camera)
    found = depth_to_normals(depth, **camera)
    assert_close(found, expected.float(), rtol=0, atol=5e-6)


def test_normals_of_planes_that_float32_can_hold_are_exact() -> None:
    """Depths of few binary digits, 1000 m away: slopes 1/4 and -1/2 for each pixel of 1/4 m."""
    v, u = torch.meshgrid(torch.arange(6.0), torch.arange(7.0), indexing="ij")
    depth = (1000 + u / 16 - v / 8)[None, None]
    expected = torch.tensor([0.25, 0.5, 1.0])
    expected = (expected / expected.norm()).reshape(1, 3, 1, 1).expand(1, 3, 6, 7)
    assert_close(depth_to_normals(depth, pixel_size=0.25), expected, rtol=2e-7, atol=0)
    flat = torch.full((1, 1, 6, 7), 1000.3)
    matrix = torch.tensor([[5000.0, 0, 3.5], [0, 5000.0, 3], [0, 0, 1]])
    for camera in ({"intrinsics": matrix}, {"pixel_size": 0.013}):
        found = depth_to_normals(flat, **camera)
        assert (found[:, :2] == 0).all()
        assert (found[:, 2] == 1).all()


@CAMERAS
@given(factor=st.floats(0.2, 5.0))
def test_the_level_changes_nothing(perspective: bool, factor: float) -> None:
    """Heights over another level have the same normals, and see the same."""
    generator = torch.Generator().manual_seed(5)
    depth = 2 + 0.3 * torch.rand(1, 1, 5, 6, dtype=F64, generator=generator)
    camera = View(*(t.reshape(1, 1, 1) for t in view(perspective)[:4]), perspective)
    field = height_field(depth, perspective)
    height = (1 + field.height) * factor - 1 if perspective else field.height + (factor - 1)
    level = field.level * factor if perspective else field.level + (factor - 1)
    other = HeightField(height, field.seen, level)
    assert_close(image_normals(other, camera), image_normals(field, camera), rtol=0, atol=1e-11)
    pixel, step = as_step(2.5, 1.5), as_step(1.0, 0.4)
    first, second = (
        cut.alpha * (h[:, 1:] - h[:, :-1]) + cut.beta
        for h in (field.height, height)
        for cut in [slices(camera, h[:, :-1], pixel, step)]
    )
    assert_close(second, first, rtol=0, atol=1e-11)


@CAMERAS
def test_heights_are_those_of_the_points(perspective: bool, generator: torch.Generator) -> None:
    """`height_field`, `view_of` and `depth_to_points` speak of one camera."""
    depth = 2 + torch.rand(2, 1, 4, 6, dtype=F64, generator=generator)
    matrix = torch.tensor([[30.0, 0, 2.2], [0, 33, 2.6], [0, 0, 1]], dtype=F64)
    options = {"intrinsics": matrix} if perspective else {"pixel_size": 0.1}
    camera, field = view_of(depth, **options), height_field(depth, perspective)
    points = depth_to_points(depth, **options).permute(0, 2, 3, 1)
    level = field.level
    found = image_point(camera, level, points)
    assert_close(found[..., 2], field.height, rtol=0, atol=ROUNDING)
    v, u = torch.meshgrid(torch.arange(4) + 0.5, torch.arange(6) + 0.5, indexing="ij")
    assert_close(found[..., 0], u.double().expand(2, 4, 6))
    assert_close(found[..., 1], v.double().expand(2, 4, 6))


def test_what_is_seen() -> None:
    depth = torch.tensor([[[[1.0, 0.0, -2.0], [math.nan, math.inf, -math.inf]]]])
    assert is_seen(depth, perspective=True).flatten().tolist() == [True] + 5 * [False]
    assert is_seen(depth, perspective=False).flatten().tolist() == 3 * [True] + 3 * [False]
    field = height_field(depth, perspective=True)
    assert torch.equal(field.height, torch.zeros(1, 2, 3))
    assert field.level.item() == 1


def test_each_image_has_its_own_camera(generator: torch.Generator) -> None:
    depth = 2 + torch.rand(2, 1, 4, 6, generator=generator)
    sizes = torch.tensor([0.1, 0.2])
    both = depth_to_normals(depth, pixel_size=sizes)
    matrix = torch.tensor([[30.0, 0, 3], [0, 33, 2], [0, 0, 1]])
    matrices = torch.stack((matrix, matrix * torch.tensor([2.0, 2, 1])))
    also = depth_to_normals(depth, matrices)
    for k in range(2):
        one = depth[k : k + 1]
        assert torch.equal(both[k : k + 1], depth_to_normals(one, pixel_size=float(sizes[k])))
        assert torch.equal(also[k : k + 1], depth_to_normals(one, matrices[k]))


def test_mistakes_are_named() -> None:
    depth, matrix = torch.ones(2, 1, 4, 4), torch.eye(3)
    with pytest.raises(DTypeError, match=r"depth.*int64.*floating"):
        view_of(depth.long(), pixel_size=1.0)
    with pytest.raises(DTypeError, match=r"depth.*list"):
        view_of([[1.0]], pixel_size=1.0)  # type: ignore[arg-type]
    for wrong in (depth[:, 0], depth.expand(2, 3, 4, 4), depth[..., :0]):
        with pytest.raises(ShapeError, match=r"depth.*B x 1 x H x W"):
            view_of(wrong, pixel_size=1.0)
    for both in ({}, {"intrinsics": matrix, "pixel_size": 1.0}):
        with pytest.raises(ShapeError, match=r"both or neither"):
            view_of(depth, **both)
    with pytest.raises(ShapeError, match=r"intrinsics.*3 3"):
        view_of(depth, matrix[:2])
    with pytest.raises(ShapeError, match=r"3 matrices for 2"):
        view_of(depth, matrix.expand(3, 3, 3))
