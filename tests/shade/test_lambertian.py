"""LambertianShading: closed forms, symmetries, extremes, errors."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from tests.cases import SMALL, images, source
from tests.tolerances import assert_close
from torchradiometry.errors import DTypeError, ShapeError
from torchradiometry.numerics import safe_normalize
from torchradiometry.shade import LambertianShading, image_irradiance, lambertian_shading
from torchradiometry.sources import AmbientDome, DirectionalSource, PointSource, arrive, irradiance

DTYPES = [torch.float32, torch.float64]
seeds = st.integers(0, 2**31)


def unit_image(seed: int, batch: int = 2, dtype: torch.dtype = torch.float64) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    v = torch.randn(batch, 3, 3, 4, dtype=dtype, generator=generator)
    return v / v.norm(dim=1, keepdim=True)


def random_sun(seed: int, lights: int = 3) -> DirectionalSource:
    generator = torch.Generator().manual_seed(seed)
    direction = torch.randn(lights, 3, dtype=torch.float64, generator=generator)
    power = torch.rand(lights, 3, dtype=torch.float64, generator=generator)
    return DirectionalSource(direction, power)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 89.9, 90.1, 180.0])
def test_cosine_law(dtype: torch.dtype, degrees: float) -> None:
    # the cosine is that of the direction in this dtype: near 90 degrees its rounding shows
    angle = torch.tensor(math.radians(degrees), dtype=torch.float64)
    direction = torch.stack([angle.sin(), angle * 0, angle.cos()]).to(dtype)
    layer = LambertianShading(DirectionalSource(direction, torch.tensor([10.0], dtype=dtype)))
    normal = torch.tensor([0.0, 0.0, 1.0], dtype=dtype).reshape(1, 3, 1, 1)
    albedo = torch.full((1, 3, 1, 1), 0.3, dtype=dtype)
    cosine = (direction[2].double() / direction.double().norm()).clamp(min=0)
    assert_close(layer(normal, albedo), (albedo.double() / math.pi * 10 * cosine).to(dtype))


@pytest.mark.parametrize("dtype", DTYPES)
def test_inverse_square_law(dtype: torch.dtype) -> None:
    height = 2.0
    layer = LambertianShading(PointSource([0.0, 0.0, height], [5.0]).to(dtype))
    x = torch.linspace(0, 3, 4, dtype=dtype)
    position = torch.stack([x, x * 0, x * 0]).reshape(1, 3, 1, 4)
    normal = torch.tensor([0.0, 0.0, 1.0], dtype=dtype).reshape(1, 3, 1, 1).expand(1, 3, 1, 4)
    albedo = torch.full((1, 1, 1, 4), 0.6, dtype=dtype)
    expected = 0.6 / math.pi * 5 * height / (x.double() ** 2 + height**2) ** 1.5
    assert_close(layer(normal, albedo, position=position).flatten(), expected.to(dtype))


@pytest.mark.parametrize("dtype", DTYPES)
def test_furnace_white_surface_in_a_white_dome_vanishes(dtype: torch.dtype) -> None:
    layer = LambertianShading(AmbientDome([1.0]).to(dtype))
    normal, albedo = images("normal", "albedo")(dtype, SMALL)
    assert_close(layer(normal, torch.ones_like(albedo)), torch.ones_like(albedo))


def test_lean_sum_of_directional_lights_equals_the_sum_of_arrivals() -> None:
    sun, points = random_sun(1), unit_image(2).permute(0, 2, 3, 1).flatten(1, 2)
    visibility = torch.rand(3, 2, 12, dtype=torch.float64)
    assert_close(
        sun.irradiance_on(None, points, visibility),
        irradiance(arrive(sun, None, points), points, visibility),
    )


def test_mixed_sources_equal_the_sum_of_arrivals_light_by_light() -> None:
    members = [source(name, torch.float64) for name in ("directional", "sphere", "point", "dome")]
    members += [source("sphere_samples", torch.float64), source("polygon_samples", torch.float64)]
    lights = sum(member.lights for member in members)
    inputs = images("normal", "position", "visibility", light=lights)(torch.float64, SMALL)
    normal, position, visibility = inputs
    points, where = (t.permute(0, 2, 3, 1).flatten(1, 2) for t in (normal, position))
    expected = irradiance(
        arrive(members, where, points), points, visibility.flatten(2).transpose(0, 1)
    )
    found = image_irradiance(normal, members, position, visibility)
    assert_close(found.flatten(2).mT, expected)


def test_each_image_of_a_batch_may_have_its_own_lights() -> None:
    normal, albedo = unit_image(3), torch.rand(2, 3, 3, 4, dtype=torch.float64)
    directions = torch.randn(2, 4, 3, dtype=torch.float64)
    power = torch.rand(2, 4, 3, dtype=torch.float64)
    together = LambertianShading()(normal, albedo, DirectionalSource(directions, power))
    for i in range(2):
        alone = DirectionalSource(directions[i], power[i])
        assert_close(
            together[i : i + 1], LambertianShading(alone)(normal[i : i + 1], albedo[i : i + 1])
        )


def test_pixels_do_not_change_places() -> None:
    normal = unit_image(4)
    sun = random_sun(5)
    image = LambertianShading(sun)(normal, torch.ones(2, 3, 3, 4, dtype=torch.float64))
    for b, y, x in ((0, 0, 0), (1, 2, 1), (0, 1, 3)):
        pixel = normal[b : b + 1, :, y : y + 1, x : x + 1]
        alone = LambertianShading(sun)(pixel, torch.ones(1, 3, 1, 1, dtype=torch.float64))
        assert_close(image[b, :, y, x], alone.flatten())


@settings(deadline=None, max_examples=30)
@given(seeds, st.floats(0.001, 1), st.floats(0.001, 1))
def test_linear_in_albedo(seed: int, a: float, b: float) -> None:
    normal, sun = unit_image(seed), [random_sun(seed)]
    first, second = torch.rand(2, 2, 3, 3, 4, dtype=torch.float64)
    left = lambertian_shading(normal, a * first + b * second, sun)
    right = a * lambertian_shading(normal, first, sun) + b * lambertian_shading(normal, second, sun)
    assert_close(left, right)


@settings(deadline=None, max_examples=30)
@given(seeds)
def test_lights_superpose_and_light_is_never_negative(seed: int) -> None:
    normal, albedo = unit_image(seed), torch.rand(2, 3, 3, 4, dtype=torch.float64)
    one, two = random_sun(seed, 2), random_sun(seed + 1, 1)
    together = lambertian_shading(normal, albedo, [one, two])
    apart = lambertian_shading(normal, albedo, [one]) + lambertian_shading(normal, albedo, [two])
    assert_close(together, apart)
    assert (together >= 0).all()


@settings(deadline=None, max_examples=30)
@given(seeds)
def test_turning_surface_and_light_together_changes_nothing(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    turn, _ = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64, generator=generator))
    normal, sun, albedo = unit_image(seed), random_sun(seed), torch.full((2, 1, 3, 4), 0.5).double()
    turned = DirectionalSource(sun.direction @ turn.mT, sun.irradiance)
    assert_close(
        lambertian_shading(torch.einsum("ij,bjhw->bihw", turn, normal), albedo, [turned]),
        lambertian_shading(normal, albedo, [sun]),
    )


def test_hidden_lights_leave_black() -> None:
    normal, albedo = unit_image(6), torch.ones(2, 3, 3, 4, dtype=torch.float64)
    visibility = torch.zeros(2, 3, 3, 4, dtype=torch.float64)
    layer = LambertianShading(random_sun(6))
    assert (layer(normal, albedo, visibility=visibility) == 0).all()


def test_gradient_of_a_black_albedo_is_the_irradiance() -> None:
    normal, albedo = unit_image(7), torch.zeros(2, 3, 3, 4, dtype=torch.float64, requires_grad=True)
    sun = random_sun(7)
    LambertianShading(sun)(normal, albedo).sum().backward()
    assert_close(albedo.grad, image_irradiance(normal, [sun]) / math.pi)
    assert (albedo.grad > 0).any()


@pytest.mark.parametrize("kind", ["zero", "behind", "grazing"])
@pytest.mark.parametrize("light", ["directional", "point", "sphere", "polygon", "dome"])
def test_extremes_are_finite_in_value_and_gradient(kind: str, light: str) -> None:
    vector = {"zero": [0.0, 0, 0], "behind": [0.0, 0, -1], "grazing": [1.0, 0, 0]}[kind]
    normal = torch.tensor(vector, dtype=torch.float64).reshape(1, 3, 1, 1).repeat(1, 1, 2, 2)
    albedo = torch.rand(1, 3, 2, 2, dtype=torch.float64)
    position = torch.zeros(1, 3, 2, 2, dtype=torch.float64)
    leaves = [t.requires_grad_() for t in (normal, albedo, position)]
    out = lambertian_shading(normal, albedo, [source(light, torch.float64)], position)
    out.sum().backward()
    assert torch.isfinite(out).all()
    assert all(t.grad is None or torch.isfinite(t.grad).all() for t in leaves)


def test_learnable_sources_are_parameters_of_the_layer() -> None:
    layer = LambertianShading([DirectionalSource([0, 0, 1.0], [1.0], learnable=True)])
    assert set(dict(layer.named_parameters())) == {"sources.0.direction", "sources.0.irradiance"}
    assert not list(LambertianShading(DirectionalSource([0, 0, 1.0], [1.0])).parameters())


SUN = DirectionalSource([0.0, 0.0, 1.0], [1.0, 1.0, 1.0])
LAMP = PointSource([0.0, 0.0, 1.0], [1.0])
N, A = torch.zeros(2, 3, 4, 5), torch.zeros(2, 3, 4, 5)


@pytest.mark.parametrize(
    ("arguments", "where", "mend"),
    [
        ({"normal": N.permute(0, 2, 3, 1)}, "normal", "permute it to B x 3 x H x W"),
        ({"normal": N[0]}, "normal", "pass B x 3 x H x W"),
        ({"normal": N[:, :2]}, "normal", "3 channels"),
        ({"albedo": torch.zeros(2, 3, 5, 4)}, "albedo", "height 4 and width 5"),
        ({"albedo": torch.zeros(3, 3, 4, 5)}, "albedo", "batch 2"),
        ({"albedo": torch.zeros(2, 2, 4, 5)}, "albedo", "pass 1 or 3 channels"),
        ({"visibility": torch.zeros(2, 2, 4, 5)}, "visibility", "1 lights"),
        ({"visibility": torch.zeros(2, 4, 5)}, "visibility", "pass B x C x H x W"),
        ({"sources": LAMP}, "position", "PointSource is a near source"),
        ({"sources": LAMP, "position": N[:, :1]}, "position", "3 channels"),
    ],
)
def test_wrong_shapes_are_named(arguments: dict, where: str, mend: str) -> None:
    call = {"normal": N, "albedo": A, "sources": SUN, **arguments}
    with pytest.raises(ShapeError, match=mend) as caught:
        LambertianShading()(**call)
    assert caught.value.where == where


@pytest.mark.parametrize(
    ("held", "arguments", "where"),
    [
        (None, {}, "sources"),
        (None, {"sources": []}, "sources"),
        (SUN, {"sources": LAMP}, "sources"),
        (None, {"sources": ["sun"]}, "sources"),
        (SUN, {"albedo": A.byte()}, "albedo"),
        (SUN, {"normal": [0, 0, 1]}, "normal"),
    ],
)
def test_wrong_types_are_named(held: object, arguments: dict, where: str) -> None:
    with pytest.raises(DTypeError) as caught:
        LambertianShading(held)(**{"normal": N, "albedo": A, **arguments})
    assert caught.value.where == where


def test_repr_shows_units() -> None:
    assert "W/m2/sr" in repr(LambertianShading(SUN))


def test_zero_direction_gives_no_light() -> None:
    out = LambertianShading(DirectionalSource([0.0, 0, 0], [1.0]))(N + 1, A + 1)
    assert (out == 0).all()
    assert (safe_normalize(torch.zeros(3)) == 0).all()


@pytest.mark.parametrize("dtype", [torch.float16, *DTYPES])
@pytest.mark.parametrize("channels", [(1, 1), (1, 3), (3, 1), (3, 3)])
def test_without_gradients_the_same_bits_from_less_memory(
    channels: tuple[int, int], dtype: torch.dtype
) -> None:
    torch.manual_seed(0)
    normal = torch.nn.functional.normalize(torch.randn(2, 3, 4, 5), dim=1).to(dtype)
    albedo = torch.rand(2, channels[0], 4, 5).to(dtype)
    sun = DirectionalSource([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]], torch.rand(2, channels[1])).to(
        dtype
    )
    given = [tensor.clone() for tensor in (normal, albedo, sun.direction, sun.irradiance)]
    recorded = lambertian_shading(normal, albedo, [sun])
    with torch.no_grad():
        found = lambertian_shading(normal, albedo, [sun])
    assert found.dtype == recorded.dtype
    assert torch.equal(found, recorded)
    for tensor, before in zip((normal, albedo, sun.direction, sun.irradiance), given, strict=True):
        assert torch.equal(tensor, before)


@pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated:DeprecationWarning")
@torch.no_grad()
def test_without_gradients_albedos_alone_may_be_mapped_over_or_have_tangents() -> None:
    normal, albedo = torch.rand(1, 3, 2, 2), torch.rand(4, 1, 3, 2, 2)
    sun = DirectionalSource([0.0, 0.6, 0.8], [3.0, 2.0, 1.0])

    def shade(paint: torch.Tensor) -> torch.Tensor:
        return lambertian_shading(normal, paint, [sun])

    one_by_one = torch.stack([shade(paint) for paint in albedo])
    assert torch.equal(torch.vmap(shade)(albedo), one_by_one)
    value, tangent = torch.func.jvp(shade, (albedo[0],), (torch.ones_like(albedo[0]),))
    assert torch.equal(value, one_by_one[0])
    torch.testing.assert_close(tangent, image_irradiance(normal, [sun]) / math.pi)
