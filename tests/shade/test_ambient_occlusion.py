"""Ambient occlusion against rays, a wall's closed form, and finite differences."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck
from torch.autograd.functional import jvp

from tests.shade.depth_truth import sky_visibility
from tests.shade.relief_bank import CAMERAS, reliefs_by
from tests.shade.test_depth_truth import grid
from tests.tolerances import assert_close
from torchradiometry.errors import DTypeError, OutOfRangeError, ShapeError
from torchradiometry.geometry import depth_to_normals
from torchradiometry.shade import AmbientOcclusion, ambient_occlusion

F64 = torch.float64
BOTH = pytest.mark.parametrize("camera", CAMERAS)


@BOTH
def test_sky_and_bent_normal_are_those_of_rays(camera: str) -> None:
    """Every relief at 32 x 32: a sum of 16 azimuths, where rays go everywhere.

    Measured, relative L1: 0.2 % (bowl) to 0.7 % (groove); bent normals 0.5 degrees in the mean.
    """
    depths, options = reliefs_by(camera, 32)
    for name, depth in depths.items():
        share, bent = ambient_occlusion(depth, **options, azimuths=16)
        truth = sky_visibility(depth, **options, rays=512)
        apart = (share[0, 0] - truth.visibility).abs()
        assert apart.sum() < 0.01 * truth.visibility.sum(), name
        assert apart.max() < 0.05, name  # measured: 0.04, at the edges of the block
        angle = torch.acos((bent[0] * truth.bent_normal).sum(0).clamp(max=1))
        assert angle.rad2deg().mean() < 0.7, name
        coarse = ambient_occlusion(depth, **options)[0][0, 0]
        # 8 azimuths, the default: 0.2 to 2.1 %
        assert (coarse - truth.visibility).abs().sum() < 0.025 * truth.visibility.sum(), name


def test_a_higher_wall_darkens_the_ground_before_it() -> None:
    """s = (1 + a / sqrt(a^2 + h^2)) / 2 and its derivative by h."""
    x, _ = grid(64, 20)
    away = torch.arange(10, 1, -1, dtype=F64)  # from columns 0 to 8 to the edge

    def ground(height: Tensor) -> Tensor:
        depth = 10 - height * (x >= x[0, 10]).to(F64)[None, None]
        return ambient_occlusion(depth, pixel_size=1.0, azimuths=64)[0][0, 0, 32, :9]

    height = torch.tensor(5.0, dtype=F64)
    share, slope = jvp(ground, height, torch.ones_like(height))
    long = (away**2 + height**2).sqrt()
    assert ((share - (1 + away / long) / 2).abs() < 0.015 * share).all()  # measured: 1 %
    expected = -away * height / (2 * long**3)
    assert ((slope - expected).abs() < 0.06 * expected.abs()).all()


@given(seed=st.integers(0, 2**31), camera=st.sampled_from(CAMERAS))
@settings(max_examples=15)
def test_looking_further_never_opens_the_sky(seed: int, camera: str) -> None:
    generator = torch.Generator().manual_seed(seed)
    depth = 2 + 0.2 * torch.rand(1, 1, 6, 7, dtype=F64, generator=generator)
    options = eye(camera)
    before = torch.ones_like(depth)
    for reach in (1, 2, 3, 6, None):
        share, bent = ambient_occlusion(depth, **options, reach=reach, azimuths=16)
        assert (share <= before + 1e-12).all()
        assert (share >= 0).all()
        length = bent.norm(dim=1)
        assert_close(length, torch.ones_like(length))
        before = share
    furthest = ambient_occlusion(depth, **options, azimuths=16)[0]
    assert torch.equal(before, furthest)


def eye(camera: str) -> dict:
    matrix = torch.tensor([[20.0, 0, 2.4], [0, 21, 2.1], [0, 0, 1]], dtype=F64)
    return {"intrinsics": matrix} if camera == "pinhole" else {"pixel_size": 0.1}


@BOTH
def test_gradients_agree_with_finite_differences(camera: str, generator: torch.Generator) -> None:
    depth = 2 + 0.2 * torch.rand(2, 1, 4, 5, dtype=F64, generator=generator)
    ((name, value),) = eye(camera).items()
    view = torch.as_tensor(value, dtype=F64)
    normal = 0.9 * depth_to_normals(depth, **eye(camera))  # no share is clamped at 1

    def whole(depth: Tensor, view: Tensor) -> tuple[Tensor, Tensor]:
        return ambient_occlusion(depth, **{name: view}, azimuths=6)

    def with_normals(depth: Tensor, view: Tensor, normal: Tensor) -> tuple[Tensor, Tensor]:
        return ambient_occlusion(depth, **{name: view}, normal=normal, azimuths=6)

    inputs = [t.clone().requires_grad_() for t in (depth, view, normal)]
    assert (whole(*inputs[:2])[0] < 0.99).any()
    assert gradcheck(whole, inputs[:2])
    assert gradcheck(with_normals, inputs)


@BOTH
def test_the_layer_is_the_function(camera: str) -> None:
    depth, options = reliefs_by(camera, 16)[0]["ripple"], reliefs_by(camera, 16)[1]
    layer = AmbientOcclusion(6, 9, pixel_size=options.get("pixel_size"))
    normal = depth_to_normals(depth, **options)
    expected = ambient_occlusion(depth, **options, azimuths=6, reach=9)
    for found in (
        layer(depth, options.get("intrinsics")),
        layer(depth, options.get("intrinsics"), normal),
    ):
        for one, other in zip(found, expected, strict=True):
            assert torch.equal(one, other)
    assert "reach=9 [px]" in repr(layer)


def test_normals_that_are_passed_are_the_ones_used() -> None:
    """Over a plane whose normal leans, the sky is cut by the plane and by the leaning one."""
    flat, lean = torch.ones(1, 1, 5, 5, dtype=F64), 0.4
    normal = torch.tensor([math.sin(lean), 0, math.cos(lean)], dtype=F64).reshape(1, 3, 1, 1)
    normal = normal.expand(1, 3, 5, 5)
    share, _ = ambient_occlusion(flat, pixel_size=1.0, normal=normal, azimuths=64)
    expected = (1 + math.cos(lean)) / 2
    assert share[0, 0, 2, 2] == pytest.approx(expected, rel=2e-3)


def test_mistakes_are_named() -> None:
    depth = torch.ones(1, 1, 4, 4)
    for wrong in ({"azimuths": 3}, {"reach": 0}):
        with pytest.raises(OutOfRangeError, match=next(iter(wrong))):
            AmbientOcclusion(**wrong)
    layer = AmbientOcclusion(pixel_size=0.1)
    with pytest.raises(ShapeError, match="both or neither"):
        layer(depth, torch.eye(3))
    with pytest.raises(ShapeError, match="both or neither"):
        AmbientOcclusion()(depth)
    with pytest.raises(DTypeError, match=r"depth.*int32"):
        layer(depth.int())
    with pytest.raises(ShapeError, match="depth"):
        layer(depth[0])
    with pytest.raises(ShapeError, match="normal"):
        layer(depth, None, torch.ones(1, 3, 4, 5))
    with pytest.raises(ShapeError, match="normal"):
        layer(depth, None, torch.ones(1, 2, 4, 4))
