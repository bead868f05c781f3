"""Normals to heights: closed forms, pieces, edges, gradients."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import OutOfRangeError, ShapeError
from torchradiometry.geometry.depth import depth_to_normals
from torchradiometry.geometry.heights import Heights, normals_to_heights

#: the solver leaves 2^-34 of the energy; steps add up along the image
SOLVED = 2e-9


def grid(rows: int, columns: int, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    """x (right) and y (up) of pixel centres."""
    x = torch.arange(columns, dtype=dtype) - (columns - 1) / 2
    y = (rows - 1) / 2 - torch.arange(rows, dtype=dtype)
    return x.expand(rows, columns), y.unsqueeze(1).expand(rows, columns)


def normals_of(x_slope: Tensor, y_slope: Tensor) -> Tensor:
    """`1 3 H W` of dz/dx and dz/dy."""
    normal = torch.stack((-x_slope, -y_slope, torch.ones_like(x_slope)))
    return (normal / normal.norm(dim=0))[None]


def ball(size: int, radius: float, dtype: torch.dtype = torch.float64) -> tuple[Tensor, ...]:
    """Normals, heights and mask of a half ball in the middle of a picture."""
    x, y = grid(size, size, dtype)
    room = radius**2 - x * x - y * y
    z = room.clamp(min=0).sqrt()
    return torch.stack((x, y, z))[None] / radius, z[None, None], (room > 0)[None, None]


def centred(height: Tensor, mask: Tensor) -> Tensor:
    return torch.where(mask, height - height[mask].mean(), torch.nan)


def close(found: Tensor, truth: Tensor, error: float = SOLVED) -> None:
    """Equal, NaN in the same places, to an error relative to the whole."""
    scale = float(truth[~truth.isnan()].abs().max()) or 1.0
    torch.testing.assert_close(found, truth, rtol=0, atol=error * scale, equal_nan=True)


@pytest.mark.parametrize("shape", [(1, 7), (7, 1), (5, 8), (33, 20)])
def test_a_plane_is_exact(shape: tuple[int, int]) -> None:
    x, y = grid(*shape)
    normal = normals_of(torch.full_like(x, 0.7), torch.full_like(x, -1.9))
    found = normals_to_heights(normal, pixel_size=0.25)
    height = (0.7 * x - 1.9 * y)[None, None] * 0.25
    close(found.height, height - height.mean())
    assert float(found.residual) < SOLVED


@pytest.mark.parametrize("radius", [9.3, 21.0, 60.0])
def test_a_sphere_is_exact_up_to_its_outline(radius: float) -> None:
    normal, z, mask = ball(44, radius)
    found = normals_to_heights(normal, mask)
    close(found.height, centred(z, mask))
    assert found.steps < 15


def test_a_paraboloid_converges_with_the_square_of_the_pixel() -> None:
    errors = []
    for size in (16, 32, 64):
        x, y = (axis / size for axis in grid(size, size))
        normal = normals_of(2.4 * x + y, x - 1.6 * y)
        found = normals_to_heights(normal, pixel_size=1 / size).height[0, 0]
        z = 1.2 * x * x + x * y - 0.8 * y * y
        errors.append(float((found - (z - z.mean())).abs().max()))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.25)


def test_the_inverse_of_depth_to_normals_on_a_plane_with_a_hole() -> None:
    x, y = grid(12, 15)
    depth = (3.0 + 0.3 * x - 0.2 * y)[None, None]
    depth[..., 4:7, 5:9] = torch.nan
    found = normals_to_heights(depth_to_normals(depth, pixel_size=1.0), ~depth.isnan()).height
    close(found, -centred(depth, ~depth.isnan()))


def test_two_pieces_have_a_mean_of_0_each() -> None:
    normal, z, mask = ball(30, 14.0)
    mask[..., 14:16] = False  # two half balls
    found = normals_to_heights(normal, mask).height
    left, right = mask.clone(), mask.clone()
    left[..., 15:], right[..., :15] = False, False
    close(torch.where(left, found, torch.nan), centred(z, left))
    close(torch.where(right, found, torch.nan), centred(z, right))


def test_pieces_that_wind_about_each_other_are_told_apart() -> None:
    """A spiral, one pixel wide, and the ground between its arms."""
    size, place, step = 41, [0, 0], (0, 1)
    wall = torch.zeros(size, size, dtype=torch.bool)
    for length in (n for k in range(size - 1, 0, -4) for n in (k, k, k - 2, k - 2) if n > 0):
        for _ in range(length):
            wall[place[0], place[1]] = True
            place = [place[0] + step[0], place[1] + step[1]]
        step = (step[1], -step[0])
    x, y = grid(size, size)
    normal = normals_of(torch.full_like(x, 0.5), torch.full_like(x, 0.25))
    plane = (0.5 * x + 0.25 * y)[None, None]
    for mask in (wall[None, None], ~wall[None, None]):
        found = normals_to_heights(normal, mask).height
        apart = (plane - found)[mask]
        for axis in (-1, -2):  # the same constant for all pixels that touch
            pair = mask.narrow(axis, 1, size - 1) & mask.narrow(axis, 0, size - 1)
            difference = (plane - found).diff(dim=axis)[pair]
            assert difference.abs().max() < 1e-6
        assert abs(float(found[mask].mean())) < 1e-9
        assert torch.isfinite(apart).all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_hard_cases_are_finite(dtype: torch.dtype) -> None:
    normal, _, mask = ball(12, 5.0, dtype)
    nothing = normals_to_heights(normal, torch.zeros_like(mask))
    assert nothing.height.isnan().all()
    assert nothing.steps == 0
    assert float(nothing.residual) == 0
    single = torch.zeros_like(mask)
    single[..., 4, 5] = True
    found = normals_to_heights(normal, single).height
    assert float(found[single]) == 0
    assert int(found.isnan().sum()) == mask.numel() - 1
    for vector in ([1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0], [0, 0, 0], [0.6, 0, -0.8]):
        wall = torch.tensor(vector, dtype=dtype).reshape(1, 3, 1, 1).expand(1, 3, 12, 12)
        for rounds in (0, 3):
            flat = normals_to_heights(wall, mask, rounds=rounds).height[mask]
            assert torch.isfinite(flat).all()
            assert flat.abs().max() <= 128 * 12
    assert normals_to_heights(normal, mask).height.dtype == dtype


def test_edge_on_pixels_follow_their_neighbours() -> None:
    """One normal of a plane is unknown (zero): the plane is found all the same."""
    x, _ = grid(9, 9)
    normal = normals_of(torch.full_like(x, 0.4), torch.zeros_like(x))
    normal[..., 4, 4] = 0
    height = (0.4 * x)[None, None]
    close(normals_to_heights(normal).height, height - height.mean())


def test_pixels_without_a_number_are_masked() -> None:
    normal, z, mask = ball(20, 30.0)
    normal[0, 1, 3, 4] = math.nan
    normal[0, 0, 9, 9] = math.inf
    mask[..., 3, 4] = mask[..., 9, 9] = False
    close(normals_to_heights(normal).height, centred(z, mask))


def test_a_batch_is_solved_image_by_image() -> None:
    normal, _, mask = ball(18, 8.0)
    tilted = normals_of(*(torch.full((18, 18), s, dtype=torch.float64) for s in (0.1, 0.9)))
    both = normals_to_heights(torch.cat((normal, tilted)), torch.cat((mask, torch.ones_like(mask))))
    close(both.height[:1], normals_to_heights(normal, mask).height)
    close(both.height[1:], normals_to_heights(tilted).height)
    shared = normals_to_heights(torch.cat((normal, normal)), mask).height
    assert torch.equal(shared[0].isnan(), shared[1].isnan())


def test_noise_of_normals_is_averaged(generator: torch.Generator) -> None:
    """Least squares: a plane under noisy normals is found far better than by adding steps up."""
    size, noise = 48, 0.1
    x, _ = grid(size, size)
    normal = normals_of(torch.full_like(x, 0.3), torch.zeros_like(x))
    normal = normal + noise * torch.randn(normal.shape, generator=generator, dtype=torch.float64)
    found = normals_to_heights(normal / normal.norm(dim=1, keepdim=True)).height[0, 0]
    error = (found - 0.3 * x).std()
    summed = noise * math.sqrt(size / 2)  # of a random walk from the middle to the edge
    assert error < summed / 2


def test_breaks_bend_less_with_weights() -> None:
    """A ramp that leaves a plate: the step between them grows along their border."""
    x, y = grid(40, 40)
    ramp = x > 0
    normal = normals_of(torch.zeros_like(x), torch.where(ramp, 2.0, 0.0))
    plates, ramps = [], []
    for rounds in (0, 10):
        found = normals_to_heights(normal, rounds=rounds).height[0, 0]
        plates.append(float(found[~ramp].std()))
        ramps.append(float((found - 2 * y)[ramp].std()))
    assert plates[1] < plates[0] / 5  # what should be flat
    assert ramps[1] < ramps[0] / 2  # near the middle the step is small and stays bridged


@pytest.mark.parametrize("rounds", [0, 2])
def test_gradients(rounds: int, generator: torch.Generator) -> None:
    """Of the least squares; with breaks, of the solution with its weights held."""
    mask = torch.ones(2, 1, 4, 3, dtype=torch.bool)
    mask[0, 0, 2] = False
    mask[1, 0, 0, 2] = False
    normal = torch.randn(2, 3, 4, 3, generator=generator, dtype=torch.float64) * 0.2
    normal[:, 2] += 1
    size = torch.tensor(1.5, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(2, 1, 4, 3, generator=generator, dtype=torch.float64)

    def total(normal: Tensor, size: Tensor) -> Tensor:
        found = normals_to_heights(normal, mask, size, rounds).height
        return (torch.where(mask, found, 0) * weight).sum()

    normal.requires_grad_()
    if rounds == 0:
        assert gradcheck(total, (normal, size), atol=1e-7)
        return
    gradient, by_size = torch.autograd.grad(total(normal, size), (normal, size))
    assert torch.isfinite(gradient).all()
    assert_close(by_size, total(normal, size).detach() / 1.5, rtol=1e-8)


def test_gradients_are_finite_where_things_are_hard() -> None:
    normal = torch.zeros(1, 3, 6, 6, dtype=torch.float64)
    normal[0, 0, :2] = 1
    normal[0, 2, 3:] = 1
    normal[0, 1, 5, 5] = math.nan
    normal.requires_grad_()
    mask = torch.ones(1, 1, 6, 6, dtype=torch.bool)
    mask[..., 3] = False
    found = normals_to_heights(normal, mask)
    found.height.nansum().backward()
    assert torch.isfinite(normal.grad).all()
    assert (normal.grad[..., 3] == 0).all()


def test_wrong_requests_are_named() -> None:
    normal = torch.zeros(1, 3, 4, 4)
    with pytest.raises(ShapeError, match="B x 3 x H x W"):
        normals_to_heights(normal[:, :2])
    with pytest.raises(ShapeError, match="mask"):
        normals_to_heights(normal, torch.ones(1, 1, 4, 5))
    with pytest.raises(OutOfRangeError, match="rounds"):
        normals_to_heights(normal, rounds=-1)
    assert isinstance(normals_to_heights(normal), Heights)
