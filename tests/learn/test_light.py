"""Light from one image: what the layers shone is found again; hard cases are finite."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from torchradiometry.errors import OutOfRangeError, ShapeError
from torchradiometry.learn.light import estimate_light
from torchradiometry.learn.samples.shapes import random_shapes
from torchradiometry.shade.lambertian import LambertianShading
from torchradiometry.sources.harmonics import HarmonicSource

#: the ridge and the weights move the least visible of the nine by 1e-5 to 3e-5 of their size
FOUND = 1e-4


def ball(size: int = 40) -> tuple[Tensor, Tensor]:
    """Normals `1 3 H W` and mask `1 1 H W` of a half ball."""
    axis = torch.arange(size, dtype=torch.float64) - (size - 1) / 2
    x, y = axis.expand(size, size) / size * 2.1, -axis.unsqueeze(1).expand(size, size) / size * 2.1
    room = 1 - x * x - y * y
    return torch.stack((x, y, room.clamp(min=0).sqrt()))[None], (room > 0)[None, None].double()


def random_light(images: int, generator: torch.Generator) -> Tensor:
    """Nine harmonics a channel, `B 9 3`; here and there they ring below zero."""
    light = torch.randn(images, 9, 3, generator=generator, dtype=torch.float64)
    light[:, 0] = 2 + light[:, 0].abs()
    return light


def shone(light: Tensor, normal: Tensor, albedo: Tensor) -> Tensor:
    return LambertianShading(HarmonicSource(light.unsqueeze(1)))(normal, albedo)


def uniform(*shape: int, generator: torch.Generator) -> Tensor:
    return 0.1 + 0.8 * torch.rand(*shape, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_random_light_on_a_ball_is_found(dtype: torch.dtype, generator: torch.Generator) -> None:
    normal, mask = (part.expand(6, -1, -1, -1).to(dtype) for part in ball())
    albedo = uniform(6, 3, 40, 40, generator=generator).to(dtype)
    light = random_light(6, generator).to(dtype)
    image = shone(light, normal, albedo)
    assert ((image == 0) & (mask > 0)).any()  # what rings below zero is black
    found = estimate_light(image, normal, albedo, mask)
    assert found.dtype == dtype
    assert (found - light).abs().max() < FOUND * light.abs().max()


def test_random_light_on_random_shapes_is_found(generator: torch.Generator) -> None:
    families = ("blobs", "ellipsoids", "limbs", "lathe")
    shapes = random_shapes(8, 48, torch.Generator().manual_seed(4), families)
    normal, mask = shapes.normal.double(), shapes.mask.double().unsqueeze(1)
    albedo = uniform(8, 1, 48, 48, generator=generator)
    light = random_light(8, generator)
    light[:, 0] += 4  # bright enough to ring nowhere
    found = estimate_light(shone(light, normal, albedo), normal, albedo, mask)
    irradiance = [shone(each, normal, torch.ones_like(albedo)) * mask for each in (light, found)]
    assert (irradiance[1] - irradiance[0]).abs().max() < FOUND * irradiance[0].max()


def test_a_shadow_on_a_quarter_of_the_object_is_found_out(generator: torch.Generator) -> None:
    normal, mask = ball()
    albedo, light = uniform(1, 3, 40, 40, generator=generator), random_light(1, generator)
    light[:, 0] += 2
    image = shone(light, normal, albedo)
    dark = torch.zeros_like(mask)
    dark[..., 8:18, 4:34] = 1
    assert float((dark * mask).sum()) > 0.25 * float(mask.sum())
    shadowed = image * (1 - dark * uniform(1, 1, 40, 40, generator=generator))
    plain = estimate_light(shadowed, normal, albedo, mask, rounds=0)
    robust = estimate_light(shadowed, normal, albedo, mask)
    assert (plain - light).abs().max() > 0.5
    assert (robust - light).abs().max() < FOUND * light.abs().max()


def test_light_scales_with_the_image(generator: torch.Generator) -> None:
    """In any unit, and inversely with the albedo."""
    normal, mask = ball(24)
    image = uniform(1, 3, 24, 24, generator=generator)
    albedo = uniform(1, 3, 24, 24, generator=generator)
    light = estimate_light(image, normal, albedo, mask)
    for scale in (1e-12, 1e12):
        found = estimate_light(scale * image, normal, albedo, mask)
        torch.testing.assert_close(found, scale * light, rtol=1e-9, atol=0)
        found = estimate_light(image, normal, scale * albedo, mask)
        torch.testing.assert_close(found, light / scale, rtol=1e-9, atol=0)


def test_a_flat_object_is_explained_by_even_light() -> None:
    """One normal shows one number: of all lights that give it, the one without a slope."""
    normal = torch.zeros(1, 3, 8, 8, dtype=torch.float64)
    normal[:, 0], normal[:, 2] = 0.6, 0.8
    ones = torch.ones(1, 1, 8, 8, dtype=torch.float64)
    light = estimate_light(0.3 * ones, normal, 0.5 * ones, ones)
    even = torch.zeros(9, dtype=torch.float64)
    even[0] = 0.6 * 2 * math.sqrt(math.pi)
    torch.testing.assert_close(light[0, :, 0], even, rtol=1e-6, atol=1e-6)


def test_nothing_to_see_is_no_light(generator: torch.Generator) -> None:
    normal, mask = ball(16)
    image = uniform(1, 3, 16, 16, generator=generator)
    grey = torch.full_like(mask, 0.5)
    zero = torch.zeros_like(mask)
    for args in (
        (image, normal, grey, zero),
        (0 * image, normal, grey, mask),
        (image, normal, zero, mask),
    ):
        args = tuple(part.clone().requires_grad_() for part in args)
        light = estimate_light(*args)
        assert (light == 0).all()
        light.sum().backward()
        assert all(torch.isfinite(part.grad).all() for part in args)
    single = zero.clone()
    single[..., 8, 8] = 1
    assert torch.isfinite(estimate_light(image, normal, grey, single)).all()
    assert torch.isfinite(estimate_light(image, 0 * normal, grey, mask)).all()


def test_what_lies_outside_the_mask_does_not_matter(generator: torch.Generator) -> None:
    normal, mask = ball(16)
    image, albedo = (uniform(1, 3, 16, 16, generator=generator) for _ in range(2))
    light = estimate_light(image, normal, albedo, mask)
    outside = (mask == 0).expand_as(image)
    spoilt = (torch.where(outside, math.nan, part) for part in (image, normal, albedo))
    assert torch.equal(estimate_light(*spoilt, mask), light)


def test_gradients(generator: torch.Generator) -> None:
    image, normal, albedo = (uniform(2, 3, 4, 4, generator=generator) for _ in range(3))
    normal = normal / normal.norm(dim=1, keepdim=True)
    mask = uniform(2, 1, 4, 4, generator=generator)
    inputs = tuple(part.requires_grad_() for part in (image, normal, albedo, mask))

    def fitted(*parts: Tensor) -> Tensor:
        return estimate_light(*parts, rounds=0, ridge=0.01)

    assert gradcheck(fitted, inputs, atol=1e-6)
    gradients = torch.autograd.grad(estimate_light(*inputs).sum(), inputs)
    assert all(torch.isfinite(gradient).all() for gradient in gradients)


def test_wrong_requests_are_named() -> None:
    image, mask = torch.ones(2, 3, 4, 4), torch.ones(2, 1, 4, 4)
    with pytest.raises(ShapeError, match="image"):
        estimate_light(image[0], image, image, mask)
    with pytest.raises(ShapeError, match="normal"):
        estimate_light(image, image[:, :2], image, mask)
    with pytest.raises(ShapeError, match="albedo"):
        estimate_light(image, image, image[..., :2], mask)
    with pytest.raises(ShapeError, match="mask"):
        estimate_light(image, image, image, image)
    with pytest.raises(OutOfRangeError, match="rounds, ridge"):
        estimate_light(image, image, image, mask, rounds=-1)
