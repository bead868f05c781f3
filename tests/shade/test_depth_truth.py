"""The ray-traced truth itself, against closed forms.

Tolerances are of two kinds. Shadows have none: pixels next to a boundary are left out and the
rest must agree. Integrals are means over rays, and `NOISE` bounds what is left of the noise
in one pixel; means over pixels are held to a tenth of it.
"""

import math
from itertools import pairwise

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from tests.shade.depth_truth import (
    bounced,
    boundary_band,
    hard_shadow,
    indirect_irradiance,
    sky_visibility,
    transport_matrix,
)
from tests.shade.relief_bank import BOWL_ANGLE, BOWL_RIM, DISTANCE, perspective_reliefs, reliefs
from torchradiometry.geometry import (
    depth_to_mesh,
    depth_to_normals,
    depth_to_points,
    face_areas,
)

#: rays per pixel in these tests
RAYS = 1024
#: of one pixel's sky or surface share: 4.5 standard deviations, measured over 8 seeds in a
#: sphere as 0.0025 (independent rays would have 0.0115)
NOISE = 0.0115


def grid(rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """x and y of the pixels of side 1."""
    down = torch.arange(rows, dtype=torch.float64) - (rows - 1) / 2
    right = torch.arange(columns, dtype=torch.float64) - (columns - 1) / 2
    y, x = torch.meshgrid(-down, right, indexing="ij")
    return x, y


def unit(*direction: float) -> Tensor:
    return functional.normalize(torch.tensor(direction, dtype=torch.float64), dim=0)


def sphere(size: int) -> tuple[Tensor, float]:
    """A square piece of the inside of a sphere of radius 3/4 size, its centre at depth size."""
    x, y = grid(size, size)
    radius = 0.75 * size
    return (size + (radius**2 - x * x - y * y).sqrt())[None, None], radius


def sphere_by_pinhole(size: int) -> tuple[Tensor, Tensor, float]:
    """The same from a pinhole at twice the radius: depth, intrinsics, radius."""
    x, y = (side / (2 * size) for side in grid(size, size))
    matrix = torch.tensor([[2.0 * size, 0, size / 2], [0, 2 * size, size / 2], [0, 0, 1]]).double()
    length = 1 + x * x + y * y  # |d (x, y, 1) - (0, 0, 2)| = 1, the far root
    depth = (2 + (4 - 3 * length).sqrt()) / length
    return depth[None, None], matrix, 1.0


def wall(rows: int, columns: int, foot: int, height: float) -> Tensor:
    """Ground up to column `foot`, from the next one on higher by `height`."""
    x, _ = grid(rows, columns)
    raised = x >= x[0, foot] + 0.5
    return (10 + height * (1 - raised.double()))[None, None]


def share_of_sphere(radius: float, depth: Tensor, **camera: object) -> float:
    """Form factor of a piece of a sphere from any point of the sphere: its area / 4 pi R^2."""
    return float(face_areas(*depth_to_mesh(depth, **camera)).sum()) / (4 * math.pi * radius**2)


def pieces() -> list[tuple[Tensor, dict, float]]:
    flat, radius = sphere(32)
    seen, matrix, near = sphere_by_pinhole(32)
    return [
        (flat, {"pixel_size": 1.0}, share_of_sphere(radius, flat, pixel_size=1.0)),
        (seen, {"intrinsics": matrix}, share_of_sphere(near, seen, intrinsics=matrix)),
    ]


PIECES = pytest.mark.parametrize("piece", [0, 1], ids=["orthographic", "pinhole"])
INNER = (slice(1, -1), slice(1, -1))  # normals at the border are one-sided


@PIECES
def test_sky_in_a_sphere_is_what_its_surface_leaves(piece: int) -> None:
    depth, camera, share = pieces()[piece]
    assert 0.1 < share < 0.4
    visibility = sky_visibility(depth, **camera, rays=RAYS).visibility[INNER]
    assert (visibility - (1 - share)).abs().max() < NOISE
    assert abs(visibility.mean() - (1 - share)) < NOISE / 10


@PIECES
def test_bounces_in_a_sphere_are_a_geometric_series(piece: int) -> None:
    """E_k = E sum_(j=1)^k (rho s)^j, for every colour."""
    depth, camera, share = pieces()[piece]
    albedo = torch.tensor([0.0, 0.5, 0.9], dtype=torch.float64)
    direct = torch.full((*depth.shape[-2:], 3), 2.0, dtype=torch.float64)
    table, once = transport_matrix(depth, **camera, rays=RAYS), albedo * share
    for bounces, series in ((1, once), (2, once + once**2), (None, once / (1 - once))):
        found = bounced(table, albedo, direct, bounces)[INNER] / 2
        # the noise of a pixel's share, times what the surface sends
        noise = NOISE * albedo * (1 + series)
        assert ((found - series).abs().amax((0, 1)) <= noise).all()
        assert ((found.mean((0, 1)) - series).abs() <= noise / 10).all()
    alone = indirect_irradiance(depth, albedo, direct, **camera, bounces=2, rays=RAYS)
    assert torch.equal(alone, bounced(table, albedo, direct, 2))


@pytest.mark.parametrize("light", [(0.8, 0.0, 0.6), (-0.5, 0.6, 0.5), (0.1, -0.9, 0.3)])
def test_shadow_in_a_sphere(light: tuple[float, float, float]) -> None:
    """A ray leaves the sphere at p - 2 (p . l) l; it is free if that is beyond the piece."""
    depth, _ = sphere(48)
    direction = unit(*light)
    point = torch.stack([*grid(48, 48), 48 - depth[0, 0]])
    along = (point * direction[:, None, None]).sum(0)
    leaves = point - 2 * along * direction[:, None, None]
    outside = (leaves[:2].abs().amax(0) > 23.5) | (leaves[2] > 0)
    lit = (along < 0) & outside
    found = hard_shadow(depth, direction, pixel_size=1.0)
    inner = ~boundary_band(lit, 1)
    inner[0] = inner[-1] = False  # rays in the plane of the border graze its edges
    assert 0.1 < lit.double().mean() < 0.95
    assert torch.equal(found[inner], lit[inner])


def test_sky_and_bent_normal_of_a_long_groove() -> None:
    """A wall at right angles of length L, seen at t from the crease, ends at tan b = t / L.

    s = (1 + sin b)/2;  bent ~ n (b/2 + sin(2 b)/4 + pi/4) + (1 - sin^2 b)/2 away from the crease
    """
    x, _ = grid(128, 16)  # the ends leave open (r/D)^3 of what the wall hides: 1 % of it
    sky = sky_visibility(10 - x.abs()[None, None], pixel_size=1.0, rays=RAYS)
    walls = x[0].abs() > 1  # the mean normal of the two columns at the crease is neither wall's
    middle = (slice(60, 68), walls)
    b = torch.atan(x[0, walls].abs() / 7.5)
    expected = (1 + b.sin()) / 2
    assert (sky.visibility[middle] - expected).abs().max() < NOISE
    assert abs((sky.visibility[middle] - expected).mean()) < NOISE / 10
    zero, side = torch.zeros_like(b), x[0, walls].sign()
    normal = torch.stack([-side, zero, zero + 1]) / math.sqrt(2)
    up = torch.stack([side, zero, zero + 1]) / math.sqrt(2)
    bent = normal * (b / 2 + (2 * b).sin() / 4 + math.pi / 4) + up * b.cos() ** 2 / 2
    bent = functional.normalize(bent, dim=0).unsqueeze(1)
    assert (sky.bent_normal[:, 60:68][..., walls] - bent).abs().max() < NOISE


def test_at_a_crease_the_own_triangles_hide_what_lies_below_them() -> None:
    """At the bottom of a 90 degree groove 45 degrees to both sides are free: s = sin 45."""
    x, _ = grid(128, 15)
    sky = sky_visibility(10 - x.abs()[None, None], pixel_size=1.0, rays=RAYS)
    assert (sky.visibility[60:68, 7] - math.sqrt(0.5)).abs().max() < NOISE
    ridge = sky_visibility(10 + x.abs()[None, None], pixel_size=1.0, rays=256)
    assert (ridge.visibility == 1).all()
    assert (ridge.bent_normal[2, :, 7] - 1).abs().max() < NOISE


def test_sky_on_the_ground_before_a_wall() -> None:
    """A wall of height h at distance a: s = (1 + a / sqrt(a^2 + h^2)) / 2."""
    sky = sky_visibility(wall(128, 20, 9, 5.0), pixel_size=1.0, rays=RAYS).visibility
    away = torch.arange(10, 1, -1, dtype=torch.float64)  # from columns 0 to 8 to the edge
    expected = (1 + away / (away**2 + 25).sqrt()) / 2
    assert (sky[60:68, :9] - expected).abs().max() < NOISE
    assert (sky[:, 11:] == 1).all()


@pytest.mark.parametrize("slope", [0.4, 1.0, 2.3])
def test_length_of_the_shadow_of_a_wall(slope: float) -> None:
    depth = wall(8, 40, 29, 5.0)
    away = torch.arange(30, 0, -1)
    lit = hard_shadow(depth, unit(1.0, 0.0, slope), pixel_size=1.0)[1:-1]  # not along the border
    apart = (away - 5 / slope).abs() > 0.01
    assert torch.equal(lit[:, :30][:, apart], (away > 5 / slope)[apart].expand(6, -1))
    assert lit[:, 31:].all()  # the mean normal at the edge turns away from the light


def test_a_near_light_throws_a_shadow_by_similar_triangles() -> None:
    """A light at height H above the ground, D behind the edge of a wall of height h.

    The shadow is as long as D h / (H - h), at every row: distances across scale alike.
    """
    depth = wall(8, 40, 29, 5.0)
    edge = float(grid(8, 40)[0][0, 30])
    low, high = ((edge + 6, 0.0, -15 + height) for height in (8.0, 20.0))
    lights = torch.tensor([low, high], dtype=torch.float64)
    lit = hard_shadow(depth, light_position=lights, pixel_size=1.0)
    away = torch.arange(30, 0, -1)
    for row, length in zip(lit, (6 * 5 / 3, 6 * 5 / 15), strict=True):
        apart = (away - length).abs() > 0.1
        assert torch.equal(row[:, :30][:, apart], (away > length)[apart].expand(8, -1))


def test_a_light_below_the_surface_or_behind_the_blocker_is_not_seen() -> None:
    flat = torch.full((1, 1, 6, 6), 3.0, dtype=torch.float64)
    lights = torch.tensor([[0.2, 0.1, -4.0], [0.2, 0.1, -2.0]], dtype=torch.float64)
    lit = hard_shadow(flat, light_position=lights, pixel_size=1.0)
    assert lit.shape == (2, 6, 6)
    assert not lit[0].any()
    assert lit[1].all()


def cameras(name: str) -> tuple[Tensor, dict, Tensor]:
    """A relief by both cameras: depth, camera, and a light at the camera."""
    if name == "pinhole":
        depths, matrix = perspective_reliefs(24)
        return depths, {"intrinsics": matrix}, {"light_position": torch.zeros(3).double()}
    return reliefs(24), {"pixel_size": 1 / 24}, {"light_direction": unit(0, 0, 1)}


@pytest.mark.parametrize("camera", ["pinhole", "orthographic"])
def test_rays_start_above_the_surface_even_on_cliffs_and_noise(camera: str, generator) -> None:
    """From where the camera is, everything that it sees is lit."""
    depths, options, light = cameras(camera)
    noise = 2 + 0.3 * torch.rand(1, 1, 24, 24, dtype=torch.float64, generator=generator)
    for depth in (*depths.values(), noise):
        assert hard_shadow(depth, **light, **options).all()


@pytest.mark.parametrize("camera", ["pinhole", "orthographic"])
def test_every_ray_sees_either_sky_or_surface(camera: str) -> None:
    """Without holes the rows of T are what the sky leaves; equal rays, so to rounding."""
    depths, options, _ = cameras(camera)
    for name in ("block", "random_0"):
        sky = sky_visibility(depths[name], **options, rays=64).visibility
        rows = torch.from_numpy(transport_matrix(depths[name], **options, rays=64).sum(1))
        assert (sky.flatten() + rows - 1).abs().max() < 1e-6  # weights are Embree's, float32


def test_a_plane_sees_only_sky() -> None:
    x, y = grid(12, 12)
    tilted = (20 + 0.7 * x - 0.4 * y)[None, None]
    sky = sky_visibility(tilted, pixel_size=1.0, rays=256)
    assert (sky.visibility == 1).all()
    assert (sky.bent_normal - depth_to_normals(tilted, pixel_size=1.0)[0]).abs().max() < NOISE
    lit = torch.ones(12, 12, 1, dtype=torch.float64)
    dark = indirect_irradiance(tilted, torch.tensor(0.9), lit, pixel_size=1.0, rays=256)
    assert (dark == 0).all()


def test_holes_are_empty_and_nothing_becomes_nan() -> None:
    depth, _ = sphere(16)
    depth[0, 0, 5:8, 6:9] = math.nan
    hidden = torch.isnan(depth[0, 0])
    sky = sky_visibility(depth, pixel_size=1.0, rays=64)
    direct = torch.where(hidden, math.nan, 1.0).double().unsqueeze(-1)
    indirect = indirect_irradiance(depth, torch.tensor(0.5), direct, pixel_size=1.0, rays=64)
    lit = hard_shadow(depth, unit(0, 0, 1), pixel_size=1.0)
    assert torch.equal(lit, ~hidden)
    for field in (sky.visibility, indirect[..., 0], sky.bent_normal.abs().sum(0)):
        assert torch.equal(field > 0, ~hidden)
        assert torch.isfinite(field).all()


def test_the_same_seed_gives_the_same_numbers_and_another_one_others() -> None:
    depth, _ = sphere(12)
    first, again, other = (
        sky_visibility(depth, pixel_size=1.0, rays=64, seed=seed).visibility for seed in (3, 3, 4)
    )
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_more_bounces_never_darken() -> None:
    table = transport_matrix(reliefs(16)["bowl"], pixel_size=1 / 16, rays=64)
    direct = torch.ones(16, 16, 1, dtype=torch.float64)
    albedo = torch.tensor(0.8, dtype=torch.float64)
    fields = [bounced(table, albedo, direct, k) for k in (0, 1, 2, 4, None)]
    assert (fields[0] == 0).all()
    for fewer, more in pairwise(fields):
        assert (more >= fewer).all()


def test_the_band_around_a_straight_boundary() -> None:
    x, _ = grid(6, 10)
    visible = x > 0
    for pixels in (1, 2, 3):
        expected = x.abs() < pixels
        assert torch.equal(boundary_band(visible, pixels), expected)
        assert torch.equal(boundary_band(visible.expand(2, 6, 10), pixels)[1], expected)
    assert not boundary_band(torch.ones(5, 5, dtype=torch.bool), 2).any()


def test_reliefs_are_steep_and_the_same_at_every_size() -> None:
    for name, depth in reliefs(64).items():
        assert depth.shape == (1, 1, 64, 64)
        slope = torch.rad2deg(torch.acos(depth_to_normals(depth, pixel_size=1 / 64)[0, 2]))
        assert slope.max() > 44, name
        # a pixel of half the resolution is the middle of four
        coarse = reliefs(32)[name]
        apart = (functional.avg_pool2d(depth, 2) - coarse).abs().flatten()
        assert apart.median() < 1e-3, name


def test_the_pinhole_camera_sees_the_same_surfaces() -> None:
    depths, matrix = perspective_reliefs(32)
    assert depths.keys() == reliefs(4).keys()
    x, y, z = depth_to_points(depths["groove"], matrix)[0]
    assert (z + DISTANCE - x.abs()).abs().max() < 1e-9
    x, y, z = depth_to_points(depths["bowl"], matrix)[0]
    radius = BOWL_RIM / math.sin(BOWL_ANGLE)
    inside = x * x + y * y < BOWL_RIM**2
    from_centre = (x * x + y * y + (z + DISTANCE - radius * math.cos(BOWL_ANGLE)) ** 2).sqrt()
    assert (from_centre[inside] - radius).abs().max() < 1e-9
    assert (z[~inside] + DISTANCE).abs().max() < 1e-9
