"""Cast shadows against rays, closed forms and moved boundaries."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck
from torch.autograd.functional import jvp
from torch.nn import functional

from tests.shade.depth_truth import boundary_band, hard_shadow
from tests.shade.relief_bank import CAMERAS, reliefs_by
from tests.shade.test_depth_truth import grid, unit, wall
from tests.tolerances import assert_close
from torchradiometry.errors import DTypeError, OutOfRangeError, ShapeError
from torchradiometry.geometry import depth_to_normals, depth_to_points
from torchradiometry.shade import CastShadow, cast_shadows
from torchradiometry.sources import (
    AmbientDome,
    DirectionalSource,
    PointSource,
    PolygonSource,
    SphereSource,
)

F64 = torch.float64
BOTH = pytest.mark.parametrize("camera", CAMERAS)
DISTANT = [unit(0.7, 0.2, 0.6), unit(-0.3, 0.8, 0.4), unit(0.1, -0.6, 0.25), unit(-0.9, -0.1, 0.15)]
NEAR = [torch.tensor(p, dtype=F64) for p in ([0.6, 0.3, -1.2], [-0.2, 0.1, -1.6])]


def sun(*directions: Tensor) -> DirectionalSource:
    return DirectionalSource(torch.stack(directions), torch.ones(1, 1, dtype=F64))


def lamp(*positions: Tensor) -> PointSource:
    return PointSource(torch.stack(positions), torch.ones(1, 1, dtype=F64))


# --- hard -----------------------------------------------------------------------------------


@BOTH
def test_hard_shadows_are_those_of_rays(camera: str) -> None:
    """Every pixel of every relief that faces the light, the boundaries included."""
    depths, options = reliefs_by(camera, 32)
    for name, depth in depths.items():
        found = cast_shadows(depth, [sun(*DISTANT), lamp(*NEAR)], **options)[0]
        truth = torch.cat(
            (
                hard_shadow(depth, torch.stack(DISTANT), **options),
                hard_shadow(depth, light_position=torch.stack(NEAR), **options),
            )
        )
        normal, points = depth_to_normals(depth, **options)[0], depth_to_points(depth, **options)[0]
        ways = [d.reshape(3, 1, 1) for d in DISTANT] + [p.reshape(3, 1, 1) - points for p in NEAR]
        facing = torch.stack([(normal * way).sum(0) > 0 for way in ways])
        assert set(found.unique().tolist()) <= {0.0, 1.0}
        assert torch.equal((found > 0) & facing, truth), name


@BOTH
def test_hard_shadows_beside_holes(camera: str, generator: torch.Generator) -> None:
    """Holes in one pixel of twenty: rays see triangles across their corners, edges do not."""
    depths, options = reliefs_by(camera, 32)
    wrong = 0.0
    for name in ("bowl", "ripple", "random_0"):
        hole = torch.rand(1, 1, 32, 32, generator=generator) < 0.05
        depth = depths[name].masked_fill(hole, math.nan)
        truth = hard_shadow(depth, torch.stack(DISTANT), **options)
        normal = depth_to_normals(depth, **options)[0]
        facing = (normal * torch.stack(DISTANT)[..., None, None]).sum(1) > 0
        found = (cast_shadows(depth, [sun(*DISTANT)], **options)[0] > 0) & facing
        away = ~boundary_band(truth, 1)
        assert (found != truth)[away].double().mean() < 0.005, name
        wrong += float((found != truth).double().mean()) / 3
    assert wrong < 0.015  # measured: 0.8 %, nearly all of them beside a boundary


@pytest.mark.parametrize("height", [8.0, 20.0])
def test_a_near_light_throws_a_shadow_by_similar_triangles(height: float) -> None:
    """A light H above the ground, D behind the edge of a wall of height h: D h / (H - h)."""
    depth = wall(8, 40, 29, 5.0)
    edge = float(grid(8, 40)[0][0, 30])
    light = lamp(torch.tensor([edge + 6, 0.0, -15 + height], dtype=F64))
    lit = cast_shadows(depth, [light], pixel_size=1.0)[0, 0]
    away = torch.arange(30, 0, -1)
    length = 6 * 5 / (height - 5)
    apart = (away - length).abs() > 0.01
    assert torch.equal(lit[:, :30][:, apart], (away > length)[apart].to(F64).expand(8, -1))


def test_what_lies_behind_a_light_does_not_hide_it() -> None:
    depth = wall(8, 40, 29, 5.0)
    before, inside = torch.tensor([[5.0, 0, -13], [-12.3, 0.2, -14.5]], dtype=F64)
    lit = cast_shadows(depth, [lamp(before, inside)], pixel_size=1.0, width=None)
    assert (lit[..., :30] == 1).all()
    below = lamp(torch.tensor([0.3, 0.2, -17.0], dtype=F64))
    away = grid(8, 40)[0][:, :30].abs() > 2  # over the light nothing lies between
    assert (cast_shadows(depth, [below], pixel_size=1.0)[0, 0, :, :30][away] == 0).all()


@BOTH
def test_light_from_the_eye_is_never_hidden(camera: str) -> None:
    depths, options = reliefs_by(camera, 32)
    light = lamp(torch.zeros(3, dtype=F64)) if camera == "pinhole" else sun(unit(0, 0, 1))
    for depth in depths.values():
        for width in (None, 1e-3):
            assert (cast_shadows(depth, [light], **options, width=width) == 1).all()
            single = cast_shadows(depth.float(), [light.float()], **only(options), width=width)
            light.double()
            assert (single == 1).all()


def only(options: dict) -> dict:
    """The options in float32."""
    return {k: v.float() if isinstance(v, Tensor) else v for k, v in options.items()}


# --- soft -----------------------------------------------------------------------------------


@BOTH
def test_soft_shadows_of_no_width_are_hard_ones(camera: str) -> None:
    """One crossing a pixel instead of all: boundaries may lie elsewhere within a pixel."""
    depths, options = reliefs_by(camera, 32)
    outside, pixels = 0, 0
    for depth in depths.values():
        lights = [sun(*DISTANT), lamp(*NEAR)]
        hard = cast_shadows(depth, lights, **options)[0]
        soft = cast_shadows(depth, lights, **options, width=1e-6)[0]
        normal = depth_to_normals(depth, **options)[0]
        facing = (normal * torch.stack(DISTANT)[..., None, None]).sum(1) > 0
        apart = (soft[:4] - hard[:4]).abs() > 0.01
        outside += int((apart & facing & ~boundary_band(hard[:4] > 0, 1)).sum())
        pixels += facing.numel()
    assert outside < 1e-4 * pixels  # measured: 1 of 65536


@pytest.mark.parametrize("width", [0.02, 0.1, 0.6])
@pytest.mark.parametrize("elevation", [20, 35, 60])
def test_penumbra_of_a_straight_wall(width: float, elevation: float) -> None:
    """The edge cuts the light's disc at a known angle; its share is that of a circle's segment."""
    angle = math.radians(elevation)
    light = sun(unit(math.cos(angle), 0, math.sin(angle)))
    found = cast_shadows(wall(4, 60, 49, 6.0), [light], pixel_size=1.0, width=width)[0, 0]
    away = torch.arange(50, 0, -1, dtype=F64)
    over = torch.atan2(torch.full_like(away, 6.0), away) - angle
    t = (over / width).clamp(-1, 1)
    hidden = (torch.acos(-t) - -t * (1 - t * t).sqrt()) / math.pi  # chord at -t from the middle
    assert_close(found[:, :50], (1 - hidden).expand(4, 50), rtol=0, atol=1e-9)
    if angle > width:  # else the ground hides a part
        assert (found[:, 51:] == 1).all()


def test_a_soft_shadow_is_the_mean_of_hard_ones_over_the_disc() -> None:
    """A light that stands across the wall: its edge crosses the disc at an angle, `SLANT`."""
    depth, middle, width, parts = wall(40, 40, 30, 8.0), unit(0.75, 0.25, 0.55), 0.25, 100
    side = functional.normalize(torch.linalg.cross(middle, unit(0, 0, 1)), dim=0)
    part = torch.arange(parts, dtype=F64) + 0.5
    angle, turn = width * (part / parts).sqrt(), part * (math.pi * (3 - math.sqrt(5)))
    ring = outer(turn.cos(), side) + outer(turn.sin(), torch.linalg.cross(side, middle))
    cone = outer(angle.cos(), middle) + angle.sin().unsqueeze(-1) * ring
    inner = (0, slice(0, None), slice(22, 32), slice(4, 29))
    many = cast_shadows(depth, [sun(*cone)], pixel_size=1.0)[inner].mean(0)
    soft = cast_shadows(depth, [sun(middle)], pixel_size=1.0, width=width)[inner][0]
    assert ((soft > 0.02) & (soft < 0.98)).double().mean() > 0.2
    assert (soft - many).abs().max() < SLANT


#: measured 0.04: the edge is taken as level in the slice through the light
SLANT = 0.06


def outer(a: Tensor, b: Tensor) -> Tensor:
    return a.unsqueeze(-1) * b


# --- gradients ------------------------------------------------------------------------------


def blurred(image: Tensor, sigma: float) -> Tensor:
    """`1 light H W` under a Gaussian of so many pixels; outside is dark."""
    reach = math.ceil(4 * sigma)
    x = torch.arange(-reach, reach + 1, dtype=image.dtype)
    kernel = functional.softmax(-(x * x) / (2 * sigma * sigma), 0)
    across = functional.conv2d(image, kernel.reshape(1, 1, 1, -1), padding=(0, reach))
    return functional.conv2d(across, kernel.reshape(1, 1, -1, 1), padding=(reach, 0))


def moved(picture: object, at: float, by: float, sigma: float) -> tuple[Tensor, Tensor]:
    """d picture(number, width) of soft shadows, and the difference of hard ones; both blurred."""
    start = torch.tensor(at, dtype=F64)
    slope = jvp(lambda x: picture(x, True), start, torch.ones_like(start))[1]
    change = picture(start + by, False) - picture(start - by, False)
    return blurred(slope, sigma), blurred(change, sigma) / (2 * by)


def test_a_higher_wall_moves_its_shadow_as_far_as_it_should() -> None:
    """Boundary at h / tan e: a blurred picture changes by its slope there, times 1 / tan e."""
    x, _ = grid(16, 64)
    light = sun(unit(0.8, 0, 0.6))

    def picture(height: Tensor, soft: bool) -> Tensor:
        depth = 10 - height * (x >= x[0, 52]).to(F64)[None, None]
        return cast_shadows(depth, [light], pixel_size=1.0, width=0.05 if soft else None)

    slope, change = moved(picture, at=15.3, by=1.5, sigma=4)
    assert (slope - change).abs().sum() < 0.03 * change.abs().sum()  # measured: 1 %
    assert (slope <= 0).all()  # it grows
    # pixels a metre; a penumbra of 4 pixels is summed over their middles
    assert float(slope[0, 0, 8].sum()) == pytest.approx(-4 / 3, rel=0.05)


def test_a_rising_sun_shortens_shadows() -> None:
    """d (h / tan e) / d e = -h / sin^2 e."""
    depth = wall(16, 64, 51, 12.0)

    def picture(angle: Tensor, soft: bool) -> Tensor:
        zero = torch.zeros_like(angle)
        light = sun(unit(1, 0, 0))
        light.direction = torch.stack((angle.cos(), zero, angle.sin())).unsqueeze(0)
        return cast_shadows(depth, [light], pixel_size=1.0, width=0.05 if soft else None)

    slope, change = moved(picture, at=0.5, by=0.05, sigma=4)
    assert (slope - change).abs().sum() < 0.08 * change.abs().sum()  # measured: 5 %
    assert (slope >= 0).all()
    assert float(slope[0, 0, 8].sum()) == pytest.approx(12 / math.sin(0.5) ** 2, rel=0.05)


@BOTH
@pytest.mark.parametrize("name", ["block", "random_0", "ripple"])
def test_higher_reliefs_move_their_shadows_the_right_way(camera: str, name: str) -> None:
    """All boundaries of a relief together, heights over the plane scaled by a number."""
    depth, options = reliefs_by(camera, 48)[0][name], reliefs_by(camera, 48)[1]
    light = lamp(NEAR[0]) if camera == "pinhole" else sun(unit(0.6, 0.48, 0.64))

    def picture(scale: Tensor, soft: bool) -> Tensor:
        higher = 2 - (2 - depth) * scale
        return cast_shadows(higher, [light], **options, width=0.03 if soft else None)

    slope, change = moved(picture, at=1.0, by=0.05, sigma=2)
    assert functional.cosine_similarity(slope.flatten(), change.flatten(), 0) > 0.95
    assert 0.75 < slope.norm() / change.norm() < 1.3


@BOTH
def test_gradients_agree_with_finite_differences(camera: str, generator: torch.Generator) -> None:
    depth = 2 + 0.3 * torch.rand(2, 1, 4, 5, dtype=F64, generator=generator)
    matrix = torch.tensor([[20.0, 0, 2.4], [0, 21, 2.1], [0, 0, 1]], dtype=F64)
    size = torch.tensor(0.1, dtype=F64)
    place = torch.tensor([[0.31, 0.217, -1.2], [-0.53, 0.11, -1.3]], dtype=F64)

    def near(depth: Tensor, eye: Tensor, place: Tensor) -> Tensor:
        light = lamp(*torch.zeros(2, 3, dtype=F64))
        light.position = place
        return cast_shadows(depth, [light], **which(eye), width=0.4)

    def far(depth: Tensor, eye: Tensor, direction: Tensor) -> Tensor:
        light = sun(*torch.ones(2, 3, dtype=F64))
        light.direction = direction
        return cast_shadows(depth, [light], **which(eye), width=0.4)

    def which(eye: Tensor) -> dict:
        return {"intrinsics": eye} if camera == "pinhole" else {"pixel_size": eye}

    eye = matrix if camera == "pinhole" else size
    direction = torch.stack((unit(0.5, 0.3, 0.4), unit(-0.4, 0.6, 0.5)))
    for shade, light in ((near, place), (far, direction)):
        inputs = [t.clone().requires_grad_() for t in (depth, eye, light)]
        shares = shade(*inputs)
        assert ((shares > 0) & (shares < 1)).sum() > 8
        assert gradcheck(shade, inputs)


# --- sources --------------------------------------------------------------------------------


def test_area_lights_of_many_samples_have_a_penumbra() -> None:
    """A panel at height H behind the edge, from D to D': between the shadows of its ends."""
    depth, height = wall(8, 60, 49, 5.0), 14.0
    edge = float(grid(8, 60)[0][0, 50])
    near, far = edge + 4, edge + 16
    z = -15 + height
    corners = [[near, -1, z], [near, 1, z], [far, 1, z], [far, -1, z]]
    panel = PolygonSource(
        torch.tensor([corners], dtype=F64), torch.ones(1, 1, dtype=F64), samples=64
    )
    ball = SphereSource(
        torch.tensor([[edge + 10, 0, z]], dtype=F64),
        torch.tensor([[2.0]], dtype=F64),
        torch.ones(1, 1, dtype=F64),
        samples=64,
    )
    for source, ends in ((panel, (4.0, 16.0)), (ball, (8.0, 12.0))):
        found = cast_shadows(depth, [source], pixel_size=1.0)
        assert found.shape == (1, 64, 8, 60)
        share = found[0].mean(0)[4, :50]
        away = torch.arange(50, 0, -1, dtype=F64)
        high = 0.0 if source is panel else 2.0
        shortest, longest = (
            end * 5 / (height + rise - 5) for end, rise in zip(ends, (high, -high), strict=True)
        )
        assert (share[away < shortest - 0.6] == 0).all()
        assert (share[away > longest + 0.6] == 1).all()
        assert (share.diff() <= 0).all()  # nearer to the wall it is darker
        assert ((share > 0) & (share < 1)).sum() >= 3


def test_domes_are_left_alone_and_lights_keep_their_order() -> None:
    depth = wall(6, 20, 9, 4.0)
    depth[0, 0, 2, 3] = math.nan
    dome = AmbientDome(torch.ones(2, 3, dtype=F64))
    sources = [dome, sun(*DISTANT[:2]), lamp(NEAR[0]), dome]
    found = cast_shadows(depth, sources, pixel_size=1.0)
    assert found.shape == (1, 7, 6, 20)
    assert torch.equal(found[0, [0, 1, 5, 6]], (~depth[0].isnan()).to(F64).expand(4, 6, 20))
    alone = cast_shadows(depth, [lamp(NEAR[0])], pixel_size=1.0)
    assert torch.equal(found[:, 4:5], alone)
    for k in range(2):
        single = cast_shadows(depth, [sun(DISTANT[k])], pixel_size=1.0)
        assert torch.equal(found[:, 2 + k : 3 + k], single)


@given(st.integers(0, 2**31))
@settings(max_examples=10)
def test_each_image_has_its_own_light(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    depth = 2 + 0.2 * torch.rand(2, 1, 5, 6, dtype=F64, generator=generator)
    direction = torch.randn(2, 3, 3, dtype=F64, generator=generator)
    direction[..., 2] = direction[..., 2].abs()
    direction = functional.normalize(direction, dim=-1)
    together = cast_shadows(
        depth, [DirectionalSource(direction, torch.ones(1, 1, dtype=F64))], pixel_size=0.1
    )
    for k in range(2):
        alone = cast_shadows(depth[k : k + 1], [sun(*direction[k])], pixel_size=0.1)
        assert torch.equal(together[k : k + 1], alone)


# --- the layer ------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("width", [None, 0.2])
def test_the_layer_is_the_function(camera: str, width: float | None) -> None:
    depth, options = reliefs_by(camera, 16)[0]["ripple"], reliefs_by(camera, 16)[1]
    size, matrix = options.get("pixel_size"), options.get("intrinsics")
    expected = cast_shadows(depth, [sun(DISTANT[0])], **options, width=width)
    layer = CastShadow(sun(DISTANT[0]), width=width, pixel_size=size)
    assert torch.equal(layer(depth, matrix), expected)
    bare = CastShadow(width=width, pixel_size=size)
    assert torch.equal(bare(depth, matrix, sun(DISTANT[0])), expected)
    assert ("hard" if width is None else "0.2 [rad]") in repr(layer)


def test_mistakes_are_named() -> None:
    depth, light = torch.ones(1, 1, 4, 4), DirectionalSource([0.0, 0.6, 0.8], [1.0])
    for width in (0.0, -1.0, 2.0, math.nan):
        with pytest.raises(OutOfRangeError, match="width"):
            CastShadow(width=width)
    with pytest.raises(OutOfRangeError, match="pixel_size"):
        CastShadow(pixel_size=0.0)
    layer = CastShadow(light, pixel_size=0.1)
    with pytest.raises(ShapeError, match="both or neither"):
        layer(depth, torch.eye(3))
    with pytest.raises(ShapeError, match="both or neither"):
        CastShadow(light)(depth)
    with pytest.raises(ShapeError, match="depth"):
        layer(depth[0])
    with pytest.raises(DTypeError, match=r"depth.*int32"):
        layer(depth.int())
    with pytest.raises(DTypeError, match=r"DirectionalSource.*float32"):
        layer(depth.double())
    with pytest.raises(DTypeError, match="sources"):
        CastShadow(pixel_size=0.1)(depth)
