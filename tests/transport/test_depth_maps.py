"""Horizons, sky, exchange and shadows of depth maps against closed forms.

What a slice sees of a height field is exact (`horizons`); what is left is the sum over azimuths.
For smooth horizons it converges like any periodic trapezoid rule, with kinks (a crease, the end
of a wall) like 1/count: `AZIMUTHS` are so many that the closed forms are met to 1 %.
"""

import math
from typing import NamedTuple

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from tests.shade.test_depth_truth import grid, pieces, wall
from tests.tolerances import assert_close
from torchradiometry.geometry.image_space import HeightField, height_field, image_normals, view_of
from torchradiometry.numerics import arccot
from torchradiometry.transport.depth_maps.exchange import SliceExchange, slice_exchange
from torchradiometry.transport.depth_maps.horizons import (
    SlicedPixels,
    cosine_moments,
    lit_share,
    sliced_pixels,
)
from torchradiometry.transport.depth_maps.shadows import hard_shadows, soft_shadows
from torchradiometry.transport.depth_maps.sky import horizon, open_sky

F64 = torch.float64
AZIMUTHS = 64
#: 1e-4 rad over the tangent plane do not count; light from there has a share of 1e-8
CLEARANCE = 1e-8


class Cut(NamedTuple):
    """All pixels of a map, cut by slices."""

    field: HeightField
    pixels: SlicedPixels
    size: tuple[int, int]

    def image(self, rows: Tensor) -> Tensor:
        """`pixel B` as `B H W`."""
        return rows.mT.unflatten(1, self.size)


def cut(depth: Tensor, azimuths: int = 8, **camera: object) -> Cut:
    view = view_of(depth, **camera)
    field = height_field(depth, view.perspective)
    pixels = sliced_pixels(field, view, image_normals(field, view), azimuths)
    return Cut(field, pixels, tuple(depth.shape[-2:]))


def sky(depth: Tensor, azimuths: int = 8, **camera: object) -> tuple[Tensor, Tensor]:
    """Visibility `B H W` and bent normal `3 B H W`."""
    whole = cut(depth, azimuths, **camera)
    share, bent = open_sky(whole.pixels, horizon(whole.field, whole.pixels, far(depth)))
    return whole.image(share), torch.stack([whole.image(axis) for axis in bent])


def far(depth: Tensor) -> int:
    return max(max(depth.shape[-2:]) - 1, 1)


def every_pixel(depth: Tensor, azimuths: int = 8, **camera: object) -> SliceExchange:
    """One cell a pixel."""
    steps = torch.arange(1, far(depth) + 1, dtype=depth.dtype).unsqueeze(1)
    cells = torch.arange(depth[0].numel() + 1)
    return slice_exchange(cut(depth, azimuths, **camera).pixels, steps, cells, cells[:-1])


def rows_of(exchange: SliceExchange) -> Tensor:
    """What of each probe's hemisphere is surface, `probe B`."""
    return exchange.weight.sum((0, 1))


def lights(*directions: tuple[float, float, float]) -> tuple[Tensor, Tensor, Tensor]:
    found = torch.tensor(directions, dtype=F64)
    return (found / found.norm(dim=-1, keepdim=True)).T[..., None, None, None].unbind(0)


def seen_by(shade: object, depth: Tensor, light: tuple, *width: float, **camera: object) -> Tensor:
    """Shadows of distant lights, `light B H W`."""
    view = view_of(depth, **camera)
    shape = (len(light[0]), *depth[:, 0].shape)
    direction = tuple(t.to(depth.dtype).expand(shape) for t in light)
    forever = torch.full(shape, math.inf, dtype=depth.dtype)
    return shade(height_field(depth, view.perspective), view, direction, forever, *width)


def tilted(degrees: float, dtype: torch.dtype = F64, *, perspective: bool = False) -> Tensor:
    """A plane: pixels of 1 m, or a pinhole 60 pixels behind them (`LENS`)."""
    x, y = grid(9, 10)
    slope = math.tan(math.radians(degrees)) * (0.8 * x + 0.6 * y)
    depth = 40 / (1 - slope / 60) if perspective else 40 + slope
    return depth[None, None].to(dtype)


LENS = torch.tensor([[60.0, 0, 5], [0, 60, 4.5], [0, 0, 1]], dtype=F64)


# --- closed forms in theta ------------------------------------------------------------------


def test_shares_and_moments_are_integrals_over_theta() -> None:
    """Midpoints of theta from the eye's ray to the horizon."""
    cot = torch.tensor([-30.0, -2.0, -0.1, 0.0, 0.7, 3.0, 40.0], dtype=F64)
    normal = torch.tensor(0.8, dtype=F64), torch.tensor(-0.6, dtype=F64)
    parts = 20000
    theta = (torch.arange(parts, dtype=F64) + 0.5) / parts * arccot(cot).unsqueeze(-1)
    lit = (normal[0] * theta.cos() + normal[1] * theta.sin()) * theta.sin()
    width = arccot(cot) / parts
    assert_close(lit_share(cot, normal), lit.sum(-1) * width, rtol=1e-7, atol=1e-10)
    vertical, sideways = cosine_moments(cot, normal)
    assert_close(vertical, (lit * theta.cos()).sum(-1) * width, rtol=1e-7, atol=1e-10)
    assert_close(sideways, (lit * theta.sin()).sum(-1) * width, rtol=1e-7, atol=1e-10)


# --- planes ---------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [0, 20, 45, 60, 75])
@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_a_plane_sees_the_whole_sky_and_nothing_of_itself(
    degrees: float, dtype: torch.dtype
) -> None:
    for camera in ({"pixel_size": 1.0}, {"intrinsics": LENS.to(dtype)}):
        depth = tilted(degrees, dtype, perspective="intrinsics" in camera)
        share, bent = sky(depth, AZIMUTHS, **camera)
        assert_close(share, torch.ones_like(share), rtol=0, atol=2e-6)
        view = view_of(depth, **camera)
        normal = image_normals(height_field(depth, view.perspective), view)[0]
        assert (bent[:, 0] - normal).norm(dim=0).max() < 2e-5
        assert (every_pixel(depth, **camera).weight == 0).all()


@pytest.mark.parametrize(
    ("degrees", "azimuths", "error"),
    [(45, 8, 2e-4), (80, 8, 2e-2), (80, 32, 2e-5), (80, 64, 3e-7)],
)
def test_the_sum_over_azimuths_converges(degrees: float, azimuths: int, error: float) -> None:
    """Measured on tilted planes: 8e-5, 9e-3, 8e-6 and 8e-8."""
    pixels = cut(tilted(degrees), azimuths, pixel_size=1.0).pixels
    whole = (lit_share(pixels.tangent, pixels.normal) * pixels.weight).sum(0) / math.pi
    assert (whole - 1).abs().max() < error


# --- sky and exchange -----------------------------------------------------------------------


def test_sky_and_bent_normal_of_a_long_groove() -> None:
    """A wall at right angles of length L, seen at t from the crease, ends at tan b = t / L.

    s = (1 + sin b)/2;  bent ~ n (b/2 + sin(2 b)/4 + pi/4) + (1 - sin^2 b)/2 away from the crease
    """
    x, _ = grid(96, 16)
    share, bent = sky(10 - x.abs()[None, None], AZIMUTHS, pixel_size=1.0)
    walls = x[0].abs() > 1  # the mean normal of the two columns at the crease is neither wall's
    b = torch.atan(x[0, walls].abs() / 7.5)
    expected = (1 + b.sin()) / 2
    found = share[0, 44:52][:, walls]
    assert ((found - expected).abs() < 0.005 * expected).all()  # measured: 0.26 %
    zero, side = torch.zeros_like(b), x[0, walls].sign()
    normal = torch.stack([-side, zero, zero + 1]) / math.sqrt(2)
    up = torch.stack([side, zero, zero + 1]) / math.sqrt(2)
    mean = normal * (b / 2 + (2 * b).sin() / 4 + math.pi / 4) + up * b.cos() ** 2 / 2
    mean = (mean / mean.norm(dim=0)).unsqueeze(1)
    assert (bent[:, 0, 44:52][..., walls] - mean).norm(dim=0).max() < 0.01


def test_sky_on_the_ground_before_a_wall() -> None:
    """A wall of height h at distance a: s = (1 + a / sqrt(a^2 + h^2)) / 2.

    Slices that run along the wall meet its edge up to a pixel late: 1 % was measured.
    """
    share, _ = sky(wall(96, 20, 9, 5.0), AZIMUTHS, pixel_size=1.0)
    away = torch.arange(10, 1, -1, dtype=F64)  # from columns 0 to 8 to the edge
    expected = (1 + away / (away**2 + 25).sqrt()) / 2
    assert ((share[0, 44:52, :9] - expected).abs() < 0.015 * expected).all()
    assert (share[0, :, 11:] > 1 - 2 * CLEARANCE).all()


@pytest.mark.parametrize("piece", [0, 1], ids=["parallel", "pinhole"])
def test_a_piece_of_a_sphere_sees_the_same_of_itself_from_everywhere(piece: int) -> None:
    """Form factor from any point of a sphere to a piece of it: its share of the sphere's area."""
    depth, camera, share = pieces()[piece]
    inner = (..., slice(1, -1), slice(1, -1))  # normals at the border are one-sided
    visible, _ = sky(depth, AZIMUTHS, **camera)
    assert ((visible[inner] - (1 - share)).abs() < 0.01 * (1 - share)).all()  # measured: 0.5 %
    rows = rows_of(every_pixel(depth, AZIMUTHS, **camera)).mT.unflatten(1, (32, 32))[inner]
    assert abs(rows.mean() - share) < 0.02 * share  # measured: 1.1 %, the outermost half pixels
    assert ((rows - share).abs() < 0.03 * share).all()


def rough(seed: int, *size: int, dtype: torch.dtype = F64) -> Tensor:
    """Slopes to either side of 45 degrees for pixels of 0.1 m."""
    generator = torch.Generator().manual_seed(seed)
    return 2 + 0.2 * torch.rand(*size, dtype=dtype, generator=generator)


CAMERA = {"pinhole": {"intrinsics": torch.tensor([[20.0, 0, 3.5], [0, 20, 3], [0, 0, 1]]).double()}}
CAMERA["parallel"] = {"pixel_size": 0.1}
CAMERAS = pytest.mark.parametrize("camera", CAMERA.values(), ids=CAMERA.keys())
SEEDS = st.integers(0, 2**31)


@CAMERAS
@given(seed=SEEDS)
@settings(max_examples=20)
def test_a_row_of_the_exchange_is_what_the_sky_leaves(camera: dict, seed: int) -> None:
    """Both are sums over the same horizons; together they are the hemisphere."""
    depth = rough(seed, 2, 1, 6, 7)
    whole = cut(depth, 16, **camera)
    found = horizon(whole.field, whole.pixels, 6)
    share = (lit_share(found, whole.pixels.normal) * whole.pixels.weight).sum(0) / math.pi
    exchange = every_pixel(depth, 16, **camera)
    assert (exchange.weight >= 0).all()
    tangent = lit_share(whole.pixels.tangent, whole.pixels.normal) * whole.pixels.weight
    assert_close(rows_of(exchange) + share, tangent.sum(0) / math.pi, rtol=1e-12)
    # 16 azimuths, slopes of up to 77 degrees
    assert_close(rows_of(exchange) + share, torch.ones_like(share), rtol=0, atol=2e-3)


@given(SEEDS)
@settings(max_examples=10)
def test_light_is_carried_from_cell_to_probe(seed: int) -> None:
    """Channels and images are apart, and light is linear in what the cells send."""
    depth = rough(seed, 2, 1, 4, 5)
    exchange = every_pixel(depth, **CAMERA["parallel"])
    radiosity = torch.rand(3, 20, 2, dtype=F64, generator=torch.Generator().manual_seed(seed))
    table = exchange.irradiance(torch.eye(20, dtype=F64).unsqueeze(-1).expand(20, 20, 2))
    expected = torch.einsum("epb,ceb->cpb", table, radiosity)
    assert_close(exchange.irradiance(radiosity), expected)
    assert_close(exchange.irradiance(torch.ones(1, 20, 2, dtype=F64))[0], inside(exchange))


def inside(exchange: SliceExchange) -> Tensor:
    """Row sums over cells of the map; at its border half a step counts outside, which is dark."""
    return (exchange.weight * (exchange.cell < 20).unsqueeze(-1)).sum((0, 1))


# --- shadows --------------------------------------------------------------------------------


@pytest.mark.parametrize("azimuth", range(0, 360, 40))
def test_shadow_of_a_half_ball_on_a_plane(azimuth: int) -> None:
    """A point of the plane is dark where its ray to the light meets the ball."""
    radius, angle = 12.0, math.radians(azimuth)
    light = lights((math.cos(angle), math.sin(angle), 0.8))
    x, y = grid(61, 61)
    height = (radius**2 - x * x - y * y).clamp(min=0).sqrt()
    towards = torch.stack(light).flatten()
    along = x * towards[0] + y * towards[1]
    apart = (x * x + y * y - along**2).sqrt() - radius  # from the ray to the ball
    dark = (along < 0) & (apart < 0)
    plane = (x * x + y * y > (radius + 1.5) ** 2) & (apart.abs() > 1)
    found = seen_by(hard_shadows, 50 - height[None, None], light, pixel_size=1.0)[0, 0]
    assert dark[plane].any()
    assert torch.equal(found[plane], (~dark[plane]).to(F64))


@given(seed=SEEDS, turns=st.integers(0, 3), mirrored=st.booleans())
@settings(max_examples=30)
def test_turning_and_mirroring_the_map_turns_the_results(
    seed: int, turns: int, mirrored: bool
) -> None:
    depth, light = rough(seed, 1, 1, 5, 7), lights((0.7, 0.2, 0.5), (-0.3, 0.6, 0.2))

    def moved(image: Tensor) -> Tensor:
        return torch.rot90(image.flip(-1) if mirrored else image, turns, (-2, -1))

    def moved_vector(x: Tensor, y: Tensor, z: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        x = -x if mirrored else x
        for _ in range(turns):
            x, y = -y, x
        return x, y, z

    camera = {"pixel_size": 0.1}
    (share, bent), (again, also) = sky(depth, **camera), sky(moved(depth), **camera)
    assert_close(again, moved(share), rtol=0, atol=1e-12)
    assert_close(also, torch.stack(moved_vector(*moved(bent))), rtol=0, atol=1e-11)
    soft = seen_by(soft_shadows, depth, light, 0.2, **camera)
    turned = seen_by(soft_shadows, moved(depth), moved_vector(*light), 0.2, **camera)
    assert_close(turned, moved(soft), rtol=0, atol=1e-11)
    sent = rough(seed + 1, 1, 5, 7)
    arrived = every_pixel(depth, **camera).irradiance(sent.flatten(1).unsqueeze(-1))
    later = every_pixel(moved(depth), **camera).irradiance(moved(sent).flatten(1).unsqueeze(-1))
    expected = moved(arrived.unflatten(1, (5, 7)).squeeze(-1))
    assert_close(later.squeeze(-1), expected.flatten(1), rtol=0, atol=1e-12)


@given(seed=SEEDS)
@settings(max_examples=20)
def test_hard_shadows_turn_with_the_triangles(seed: int) -> None:
    """Half a turn, and the mirror along the diagonals, keep the triangles of the map."""
    depth = rough(seed, 1, 1, 6, 8)
    x, y, z = light = lights((0.7, 0.2, 0.5), (-0.3, 0.6, 0.2))
    found = seen_by(hard_shadows, depth, light, pixel_size=0.1)
    assert 0.1 < found.mean() < 0.95
    turned = seen_by(hard_shadows, depth.flip((-2, -1)), (-x, -y, z), pixel_size=0.1)
    assert torch.equal(turned, found.flip((-2, -1)))
    mirrored = seen_by(hard_shadows, depth.mT, (-y, -x, z), pixel_size=0.1)
    assert torch.equal(mirrored, found.mT)


@pytest.mark.parametrize("dtype", [torch.float32, F64])
@pytest.mark.parametrize("power", [-40, -3, 5, 40])
def test_the_unit_of_length_changes_nothing(power: int, dtype: torch.dtype) -> None:
    """Not one bit, for powers of two; a pinhole needs no pixel size."""
    depth, light = rough(3, 2, 1, 6, 7, dtype=dtype), lights((0.7, 0.2, 0.5))
    unit = 2.0**power
    lens = {"intrinsics": CAMERA["pinhole"]["intrinsics"].to(dtype)}
    for camera, scaled in (({"pixel_size": 0.1}, {"pixel_size": 0.1 * unit}), (lens, lens)):
        for first, second in zip(
            results(depth, light, camera), results(depth * unit, light, scaled), strict=True
        ):
            assert torch.equal(first, second)


def results(depth: Tensor, light: tuple, camera: dict) -> tuple[Tensor, ...]:
    """Sky, bent normal, rows of the exchange, shadows: `* B H W`."""
    share, bent = sky(depth, **camera)
    rows = rows_of(every_pixel(depth, **camera)).mT.unflatten(1, depth.shape[-2:])
    hard = seen_by(hard_shadows, depth, light, **camera)
    return share, bent, rows, hard, seen_by(soft_shadows, depth, light, 0.2, **camera)


@CAMERAS
def test_a_batch_is_one_image_after_the_other(camera: dict) -> None:
    depth, light = rough(4, 3, 1, 6, 7), lights((0.7, 0.2, 0.5), (0.1, -0.6, 0.3))
    depth[1, 0, 2:4, 3:5] = math.nan
    together = results(depth, light, camera)
    for k in range(3):
        for whole, alone in zip(together, results(depth[k : k + 1], light, camera), strict=True):
            assert_close(whole[..., k : k + 1, :, :], alone, rtol=0, atol=1e-12)


@CAMERAS
@pytest.mark.parametrize("mask", ["right", "left", "below"])
def test_a_masked_border_is_the_end_of_the_map(camera: dict, mask: str) -> None:
    """What is masked is as good as outside; the lens looks at the same place."""
    depth, light = rough(5, 2, 1, 7, 8), lights((0.7, 0.2, 0.5), (-0.5, -0.3, 0.4))
    window = {"right": (slice(0, 7), slice(0, 5)), "left": (slice(0, 7), slice(3, 8))}
    rows, columns = window.get(mask, (slice(0, 4), slice(0, 8)))
    smaller, masked = depth[..., rows, columns], torch.full_like(depth, math.nan)
    masked[..., rows, columns] = smaller
    moved = dict(camera)
    if "intrinsics" in camera:
        moved["intrinsics"] = camera["intrinsics"].clone()
        moved["intrinsics"][0, 2] -= columns.start
    for whole, part in zip(
        results(masked, light, camera), results(smaller, light, moved), strict=True
    ):
        assert_close(whole[..., rows, columns], part, rtol=0, atol=1e-12)
        assert whole.sum() == pytest.approx(whole[..., rows, columns].sum())  # 0 where masked
