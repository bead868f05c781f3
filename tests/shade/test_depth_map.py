"""ShadeDepth against the layers that it is made of."""

import math

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from tests.shade.relief_bank import CAMERAS, reliefs_by
from tests.shade.test_depth_truth import unit
from tests.tolerances import assert_close
from torchradiometry.errors import DTypeError, OutOfRangeError, ShapeError
from torchradiometry.geometry import depth_to_normals, depth_to_points
from torchradiometry.materials import BlinnPhong, NormalizedPhong, Phong
from torchradiometry.shade import (
    DepthSettings,
    LambertianShading,
    PhongShading,
    ShadeDepth,
    ambient_occlusion,
    cast_shadows,
    image_irradiance,
    reflected_irradiance,
)
from torchradiometry.sources import AmbientDome, DirectionalSource, PointSource, SphereSource

F64 = torch.float64
BOTH = pytest.mark.parametrize("camera", CAMERAS)
NOTHING = DepthSettings(cast_shadows=False, ambient_occlusion=False, bounces=0)


def suns() -> DirectionalSource:
    """Two colours from two sides."""
    return DirectionalSource(
        torch.stack((unit(0.7, 0.2, 0.6), unit(-0.3, 0.8, 0.4))),
        torch.tensor([[1.0, 2, 3], [3, 1, 2]], dtype=F64),
    )


def lamp() -> PointSource:
    return PointSource(
        torch.tensor([0.6, 0.3, -1.2], dtype=F64), torch.tensor([1.0, 0.5, 2], dtype=F64)
    )


def dome() -> AmbientDome:
    """Half a sky, so that the normal matters."""
    return AmbientDome(torch.tensor([0.3, 0.6, 0.2], dtype=F64), up=unit(0.2, 0.9, 0.3))


def maps(camera: str, name: str = "ripple", size: int = 16) -> tuple[Tensor, Tensor, dict]:
    """Depth, albedo, and what names the camera."""
    depths, options = reliefs_by(camera, size)
    generator = torch.Generator().manual_seed(8)
    albedo = torch.rand(1, 3, size, size, dtype=F64, generator=generator)
    return depths[name], albedo, options


def shaded(settings: DepthSettings, sources: object, camera: str, *more: Tensor) -> Tensor:
    depth, albedo, options = maps(camera)
    layer = ShadeDepth(settings, sources, pixel_size=options.get("pixel_size"))
    return layer(depth, albedo, options.get("intrinsics"), *more)


def surface(camera: str) -> tuple[Tensor, Tensor]:
    depth, _, options = maps(camera)
    return depth_to_normals(depth, **options), depth_to_points(depth, **options)


@BOTH
def test_with_everything_off_it_is_lambertian_to_the_last_bit(camera: str) -> None:
    sources = [suns(), lamp(), dome()]
    normal, points = surface(camera)
    local = LambertianShading(sources)(normal, maps(camera)[1], position=points)
    assert torch.equal(shaded(NOTHING, sources, camera), local)
    distant = LambertianShading(suns())(normal, maps(camera)[1])
    assert torch.equal(shaded(NOTHING, suns(), camera), distant)


@BOTH
@pytest.mark.parametrize("lobe", [Phong, NormalizedPhong, BlinnPhong])
@pytest.mark.parametrize("shadows", [False, True])
def test_with_a_highlight_it_is_phong(camera: str, lobe: type, shadows: bool) -> None:
    depth, albedo, options = maps(camera)
    normal, points = surface(camera)
    specular, shininess = 0.5 * albedo.flip(-1), 5 + 20 * albedo[:, :1]
    sources = [suns(), lamp(), dome()]
    settings = DepthSettings(cast_shadows=shadows, ambient_occlusion=False, bounces=0)
    layer = ShadeDepth(settings, sources, lobe=lobe, pixel_size=options.get("pixel_size"))
    visibility = cast_shadows(depth, sources, **options) if shadows else None
    phong = PhongShading(lobe, sources, perspective=camera == "pinhole")
    local = phong(normal, albedo, specular, shininess, position=points, visibility=visibility)
    found = layer(depth, albedo, options.get("intrinsics"), specular, shininess)
    assert torch.equal(found, local)
    matt = DepthSettings(cast_shadows=shadows, ambient_occlusion=False, bounces=0, specular=False)
    layer = ShadeDepth(matt, sources, lobe=lobe, pixel_size=options.get("pixel_size"))
    without = layer(depth, albedo, options.get("intrinsics"), specular, shininess)
    assert torch.equal(without, shaded(settings, sources, camera))


@BOTH
@pytest.mark.parametrize("width", [None, 0.1])
def test_cast_shadows_hide_light(camera: str, width: float | None) -> None:
    depth, albedo, options = maps(camera)
    normal, points = surface(camera)
    sources = [suns(), lamp()]
    settings = DepthSettings(shadow_width=width, ambient_occlusion=False, bounces=0)
    visibility = cast_shadows(depth, sources, **options, width=width)
    assert 0.1 < visibility.mean() < 0.95
    expected = LambertianShading(sources)(normal, albedo, position=points, visibility=visibility)
    assert torch.equal(shaded(settings, sources, camera), expected)


@BOTH
@pytest.mark.parametrize("place", [0, 1, 2])
def test_the_sky_is_occluded_and_taken_along_the_bent_normal(camera: str, place: int) -> None:
    """Wherever the dome stands among the sources."""
    depth, albedo, options = maps(camera)
    normal, points = surface(camera)
    share, bent = ambient_occlusion(depth, **options, azimuths=6, reach=9)
    sky = share * image_irradiance(bent, [dome()])
    alone = DepthSettings(cast_shadows=False, bounces=0, azimuths=6, reach=9)
    assert_close(shaded(alone, dome(), camera), albedo * sky / math.pi)
    sources = [suns(), lamp()]
    visibility = cast_shadows(depth, sources, **options)
    received = sky + image_irradiance(normal, sources, points, visibility)
    both = DepthSettings(bounces=0, azimuths=6, reach=9)
    sources.insert(place, dome())
    assert_close(shaded(both, sources, camera), albedo * received / math.pi)


@BOTH
@pytest.mark.parametrize("tail", [False, True])
def test_everything_together_is_the_composition_by_hand(camera: str, tail: bool) -> None:
    depth, albedo, options = maps(camera)
    normal, points = surface(camera)
    sources = [suns(), dome(), lamp()]
    specular, shininess = 0.3 * albedo.flip(-2), 5 + 20 * albedo[:, 1:2]
    settings = DepthSettings(
        shadow_width=0.2, bounces=2, ambient_tail=tail, cells=6, azimuths=5, reach=7
    )
    lights = [suns(), lamp()]
    visibility = cast_shadows(depth, lights, **options, width=0.2)
    share, bent = ambient_occlusion(depth, **options, azimuths=5, reach=7)
    received = share * image_irradiance(bent, [dome()])
    received = received + image_irradiance(normal, lights, points, visibility)
    reflected = reflected_irradiance(
        depth, albedo, received, **options, cells=(6, 6), bounces=2, tail=tail, azimuths=5
    )
    matt = albedo * (received + reflected) / math.pi
    phong = PhongShading(Phong, lights, perspective=camera == "pinhole")
    gloss = phong(normal, 0 * albedo, specular, shininess, position=points, visibility=visibility)
    assert (reflected > 0).double().mean() > 0.5
    assert_close(shaded(settings, sources, camera), matt, rtol=1e-11)
    found = shaded(settings, sources, camera, specular, shininess)
    assert_close(found, matt + gloss, rtol=1e-11)


def test_gradients_agree_with_finite_differences(generator: torch.Generator) -> None:
    """Through everything at once: soft shadows, sky, two bounces with a tail, highlights.

    For a pinhole; `tests/contracts/test_graphs.py` does the same for a parallel camera.
    """
    depth = 2 + 0.2 * torch.rand(1, 1, 3, 3, dtype=F64, generator=generator)
    albedo, specular = torch.rand(2, 1, 1, 3, 3, dtype=F64, generator=generator)
    shininess = 3 + 5 * torch.rand(1, 1, 3, 3, dtype=F64, generator=generator)
    matrix = torch.tensor([[20.0, 0, 1.9], [0, 21, 1.6], [0, 0, 1]], dtype=F64)
    near = PointSource(torch.tensor([0.31, 0.217, -1.2], dtype=F64), torch.ones(1, dtype=F64))
    settings = DepthSettings(shadow_width=0.4, bounces=2, ambient_tail=True, cells=4, azimuths=5)
    layer = ShadeDepth(settings, [suns(), near, dome()])

    def whole(depth: Tensor, albedo: Tensor, specular: Tensor, shininess: Tensor) -> Tensor:
        return layer(depth, albedo, matrix, specular, shininess)

    inputs = [t.clone().requires_grad_() for t in (depth, albedo, specular, shininess)]
    assert gradcheck(whole, inputs)


@BOTH
def test_lights_of_the_call_are_those_of_the_constructor(camera: str) -> None:
    depth, albedo, options = maps(camera)
    settings, sources = DepthSettings(cells=4), [lamp(), dome()]
    bare = ShadeDepth(settings, pixel_size=options.get("pixel_size"))
    found = bare(depth, albedo, options.get("intrinsics"), sources=sources)
    assert torch.equal(found, shaded(settings, sources, camera))
    assert "cells=4" in repr(bare)


@BOTH
def test_each_image_is_shaded_alone(camera: str) -> None:
    depths, options = reliefs_by(camera, 16)
    depth = torch.cat([depths[name] for name in ("bowl", "block", "random_0")])
    generator = torch.Generator().manual_seed(2)
    albedo = torch.rand(3, 3, 16, 16, dtype=F64, generator=generator)
    ball = SphereSource(
        torch.tensor([0.3, 0.2, -1.0], dtype=F64),
        torch.tensor([0.2], dtype=F64),
        torch.ones(3, dtype=F64),
    )
    settings = DepthSettings(bounces=2, ambient_tail=True, cells=8)
    layer = ShadeDepth(settings, [suns(), ball, dome()], pixel_size=options.get("pixel_size"))
    eye = options.get("intrinsics")
    together = layer(depth, albedo, eye)
    for k in range(3):
        assert_close(together[k : k + 1], layer(depth[k : k + 1], albedo[k : k + 1], eye))


def test_mistakes_are_named() -> None:
    depth, albedo = torch.ones(2, 1, 4, 4), torch.ones(2, 3, 4, 4)
    sun = DirectionalSource([0.0, 0.6, 0.8], [1.0])
    for wrong in ({"bounces": -1}, {"cells": 1}, {"azimuths": 3}):
        with pytest.raises(OutOfRangeError, match=next(iter(wrong))):
            DepthSettings(**wrong)
    for width in (0.0, 1.6, math.nan):
        with pytest.raises(OutOfRangeError, match="shadow_width"):
            DepthSettings(shadow_width=width)
    layer = ShadeDepth(sources=sun, pixel_size=0.1)
    with pytest.raises(ShapeError, match="both or neither"):
        layer(depth, albedo, torch.eye(3))
    with pytest.raises(ShapeError, match="both or neither"):
        ShadeDepth(sources=sun)(depth, albedo)
    with pytest.raises(ShapeError, match="albedo"):
        layer(depth, torch.ones(2, 3, 4, 5))
    with pytest.raises(ShapeError, match="albedo"):
        layer(depth, torch.ones(3, 3, 4, 4))
    with pytest.raises(ShapeError, match="depth"):
        layer(depth[0], albedo)
    with pytest.raises(DTypeError, match=r"depth.*int32"):
        layer(depth.int(), albedo)
    with pytest.raises(DTypeError, match=r"albedo.*uint8"):
        layer(depth, albedo.byte())
    with pytest.raises(DTypeError, match=r"DirectionalSource.*float32"):
        layer(depth.double(), albedo.double())
    with pytest.raises(ShapeError, match="specular, shininess"):
        layer(depth, albedo, None, albedo)
    with pytest.raises(ShapeError, match="shininess"):
        layer(depth, albedo, None, albedo, albedo)
    with pytest.raises(ShapeError, match="3 matrices for 2"):
        ShadeDepth(sources=sun)(depth, albedo, torch.eye(3).expand(3, 3, 3))
    with pytest.raises(DTypeError, match="sources"):
        ShadeDepth(pixel_size=0.1)(depth, albedo)
