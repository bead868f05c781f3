"""Training data: shaded by the layers, exposed like a camera, the same for the same seed."""

import math

import pytest
import torch

from torchradiometry.errors import IndexRangeError, OutOfRangeError
from torchradiometry.learn import geometry_bank, images
from torchradiometry.learn.data import (
    PhotometricSamples,
    ShadingSamples,
    SurfaceOptions,
    generator_for,
    make_bank,
)
from torchradiometry.learn.losses import angle_degrees
from torchradiometry.learn.networks import least_squares
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.shade.phong import PhongShading
from torchradiometry.sources.directional import DirectionalSource

SMALL = SurfaceOptions(shapes=3, pixels=20, lights=12, size=24)


@pytest.fixture(scope="module")
def bank() -> geometry_bank.SurfaceBank:
    return make_bank(SMALL, seed=7)


def test_bank_is_physical(bank: geometry_bank.SurfaceBank) -> None:
    torch.testing.assert_close(bank.normal.norm(dim=-1), torch.ones(3, 20))
    torch.testing.assert_close(bank.direction.norm(dim=-1), torch.ones(3, 12))
    assert ((bank.visibility == 0) | (bank.visibility == 1)).all()
    assert (bank.indirect >= 0).all()
    # from neighbours that receive at most 1, through the part of the sky they cover
    assert (bank.indirect <= (1 - bank.openness.unsqueeze(-1)) + 0.15).all()
    assert ((bank.openness >= 0) & (bank.openness <= 1)).all()


def test_shape_k_does_not_depend_on_how_many_there_are(bank: geometry_bank.SurfaceBank) -> None:
    fewer = make_bank(SurfaceOptions(shapes=2, pixels=20, lights=12, size=24), seed=7)
    assert torch.equal(fewer.normal, bank.normal[:2])
    assert torch.equal(fewer.indirect, bank.indirect[:2])


def test_half_a_groove_of_90_degrees_lights_the_other_half() -> None:
    """One bounce in a V groove: closed form for an infinite groove, F = (1 - sin 45)."""
    size = 64
    across = (torch.arange(size) - (size - 1) / 2).abs()
    height = across.expand(size, size).unsqueeze(0)
    normal = torch.zeros(size, size, 3)
    normal[..., 0] = -torch.sign(torch.arange(size) - (size - 1) / 2)
    normal[..., 2] = 1
    normal = (normal / math.sqrt(2)).reshape(-1, 3)
    received = torch.ones(1, size * size)
    kept = torch.arange(size) + size * (size // 2)
    found = torch.stack(
        [
            geometry_bank._one_bounce(height, normal, received, kept, generator_for(k))[0]
            for k in range(8)
        ]
    ).mean(0)[:, 0]
    # a point near the fold sees the other wall over its whole upper half: E -> F = 1/2 (1 + 0)
    near_fold = found[size // 2 - 2 : size // 2 + 2]
    torch.testing.assert_close(near_fold.mean(), torch.tensor(0.5), rtol=0, atol=0.06)
    assert found[2] < near_fold.mean() / 2  # and less near the rim


def test_shading_is_that_of_the_layers(bank: geometry_bank.SurfaceBank) -> None:
    """One pixel, one light at a time, against a direct call of PhongShading."""
    generator = generator_for(1)
    materials = images.random_materials(3, 20, generator)
    materials = materials._replace(
        specular=materials.specular * torch.tensor([1.0, 0.0]), surround=0 * materials.surround
    )
    found = images.shade(bank, materials)
    s, p, n = 1, 4, 7
    layer = PhongShading(BlinnPhong, DirectionalSource(bank.direction[s, n], [1.0]))
    one = layer(
        bank.normal[s, p].reshape(1, 3, 1, 1),
        materials.albedo[s, p].reshape(1, 1, 1, 1),
        materials.specular[s, p, 0].reshape(1, 1, 1, 1),
        materials.shininess[s, p, 0].reshape(1, 1, 1, 1),
        visibility=bank.visibility[s, p, n].reshape(1, 1, 1, 1),
    )
    torch.testing.assert_close(found[s, p, n], math.pi * one.squeeze())


def test_indirect_light_is_the_series_of_bounces(bank: geometry_bank.SurfaceBank) -> None:
    materials = images.random_materials(3, 20, generator_for(2))
    materials = materials._replace(specular=torch.zeros(3, 20, 2))
    with_bounce = images.shade(bank, materials)
    without = images.shade(bank._replace(indirect=0 * bank.indirect), materials)
    rho = materials.surround.unsqueeze(-1)
    share = (1 - bank.openness).unsqueeze(-1)
    series = sum(rho * (share * rho) ** k for k in range(200)) * bank.indirect
    torch.testing.assert_close(
        with_bounce - without, materials.albedo.unsqueeze(-1) * series, rtol=1e-4, atol=1e-5
    )


def test_a_camera_keeps_the_mean(generator: torch.Generator) -> None:
    radiance = torch.linspace(0.2, 1.0, 400).reshape(2, 20, 10)
    found = torch.stack([images.expose(radiance, generator) for _ in range(60)]).mean(0)
    grey = found / found.mean() * radiance.mean()
    assert (grey / radiance - 1).abs().mean() < 0.1  # colours differ from pixel to pixel
    assert (images.expose(torch.zeros(1, 3, 4), generator) >= 0).all()


def test_samples_are_the_same_for_the_same_number(bank: geometry_bank.SurfaceBank) -> None:
    samples = PhotometricSamples(bank, SMALL, batches=5, seed=3, shapes=4, pixels=6)
    assert len(samples) == 5
    first, again = samples[2], samples[2]
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(samples[3].normal, first.normal)
    lights = first.direction.shape[1]
    assert 8 <= lights <= 12
    assert first.intensity.shape == (4, 6, lights)
    with pytest.raises(IndexRangeError, match="index"):
        samples[5]


def test_turned_samples_keep_light_and_normal_together(bank: geometry_bank.SurfaceBank) -> None:
    """Matt, unshadowed, unbounced surfaces: least squares finds the turned normals."""
    plain = bank._replace(visibility=torch.ones_like(bank.visibility))
    turned = images._turned(plain, generator_for(5))
    light = torch.einsum("spk,slk->spl", turned.normal, turned.direction)
    torch.testing.assert_close(light, torch.einsum("spk,slk->spl", bank.normal, bank.direction))
    found = least_squares(light, turned.direction)
    assert angle_degrees(found, turned.normal).median() < 0.1


def test_single_images_are_exposed_objects() -> None:
    samples = ShadingSamples(batches=2, seed=1, images=3, size=32)
    batch = samples[1]
    assert all(torch.equal(a, b) for a, b in zip(batch, samples[1], strict=True))
    assert batch.luminance.shape == batch.mask.shape == (3, 1, 32, 32)
    assert ((batch.luminance >= 0) & (batch.luminance <= 1)).all()
    assert (batch.luminance[batch.mask == 0] == 0).all()
    torch.testing.assert_close(batch.normal.norm(dim=1, keepdim=True), batch.mask)


def test_wrong_options_are_named() -> None:
    with pytest.raises(OutOfRangeError, match="lights"):
        SurfaceOptions(lights=0)
