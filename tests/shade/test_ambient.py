"""AmbientShading: the product, domes in its place, occlusion, errors."""

from __future__ import annotations

import math

import pytest
import torch

from tests.cases import SMALL, images, source
from tests.tolerances import assert_close
from torchradiometry.errors import DTypeError, ShapeError
from torchradiometry.shade import AmbientShading, LambertianShading, ambient_shading
from torchradiometry.sources import AmbientDome

DTYPES = [torch.float32, torch.float64]


@pytest.mark.parametrize("dtype", DTYPES)
def test_product_of_albedo_radiance_and_occlusion(dtype: torch.dtype) -> None:
    albedo, radiance, occlusion = images("albedo", "radiance", "occlusion")(dtype, SMALL)
    expected = torch.einsum("bchw,bc,buhw->bchw", albedo, radiance, occlusion)
    assert_close(AmbientShading()(albedo, radiance=radiance, visibility=occlusion), expected)


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_uniform_dome_is_the_same_as_its_radiance(dtype: torch.dtype) -> None:
    normal, albedo = images("normal", "albedo")(dtype, SMALL)
    radiance = torch.tensor([0.2, 0.5, 3.0], dtype=dtype)
    dome = AmbientDome(radiance)
    expected = AmbientShading(radiance)(albedo)
    assert_close(AmbientShading(sources=dome)(albedo, normal), expected)
    assert_close(LambertianShading(dome)(normal, albedo), expected)


def test_harmonic_light_depends_on_the_normal() -> None:
    normal, albedo, occlusion = images("normal", "albedo", "occlusion")(torch.float64, SMALL)
    sky = source("harmonics", torch.float64)
    found = AmbientShading()(albedo, normal, occlusion, sources=sky)
    expected = occlusion * LambertianShading(sky)(normal, albedo)
    assert_close(found, expected)


@pytest.mark.parametrize("shape", [(3,), (1,), (2, 3), (2, 1), (2, 3, 3, 4)])
def test_radiance_for_all_per_image_or_as_a_map(shape: tuple[int, ...]) -> None:
    albedo = torch.ones(2, 3, 3, 4)
    radiance = torch.rand(shape)
    full = (
        radiance if len(shape) == 4 else radiance.reshape((1,) * (2 - len(shape)) + shape + (1, 1))
    )
    assert_close(ambient_shading(albedo, radiance), full.expand(2, 3, 3, 4))


def test_learnable_radiance_is_a_parameter_and_its_gradient_the_albedo() -> None:
    layer = AmbientShading([1.0, 2.0, 3.0], learnable=True)
    albedo = torch.rand(2, 3, 3, 4)
    layer(albedo).sum().backward()
    assert_close(layer.radiance.grad, albedo.sum((0, 2, 3)))
    assert not list(AmbientShading([1.0]).parameters())
    assert "radiance" in AmbientShading([1.0]).state_dict()


def test_furnace() -> None:
    albedo = torch.ones(1, 3, 2, 2, dtype=torch.float64)
    assert_close(AmbientShading(albedo.new_tensor(1 / math.pi))(albedo) * math.pi, albedo)


@pytest.mark.parametrize(
    ("layer", "arguments", "error"),
    [
        (AmbientShading(), {}, DTypeError),
        (AmbientShading([1.0]), {"radiance": torch.ones(3)}, DTypeError),
        (AmbientShading([1.0]), {"sources": AmbientDome([1.0])}, DTypeError),
        (AmbientShading(sources=AmbientDome([1.0])), {}, ShapeError),
        (AmbientShading([1.0]), {"visibility": torch.ones(2, 3, 3, 4)}, ShapeError),
        (AmbientShading([1.0, 2.0]), {}, ShapeError),
        (AmbientShading(), {"radiance": torch.ones(2, 3, 3)}, ShapeError),
    ],
)
def test_mistakes_are_named(layer: AmbientShading, arguments: dict, error: type) -> None:
    with pytest.raises(error):
        layer(torch.ones(2, 3, 3, 4), **arguments)


def test_two_ambient_lights_are_one_too_many() -> None:
    with pytest.raises(DTypeError, match="one of the two"):
        AmbientShading([1.0], sources=AmbientDome([1.0]))
