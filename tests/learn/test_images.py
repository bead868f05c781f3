"""Training data: shaded by the layers, exposed like a camera, the same for the same seed."""

import math
from dataclasses import replace

import pytest
import torch

from torchradiometry.errors import IndexRangeError, OutOfRangeError
from torchradiometry.learn.lambert_fit import least_squares
from torchradiometry.learn.losses import angle_degrees
from torchradiometry.learn.samples import geometry_bank, images
from torchradiometry.learn.samples.data import (
    PhotometricSamples,
    ShadingSamples,
    SurfaceOptions,
    generator_for,
    make_bank,
    make_shapes,
)
from torchradiometry.materials.microfacet import Microfacet
from torchradiometry.materials.oren_nayar import OrenNayar
from torchradiometry.materials.sum import SumMaterial
from torchradiometry.shade.points import PointShading
from torchradiometry.sources.directional import DirectionalSource

SMALL = SurfaceOptions(shapes=3, pixels=20, lights=12, size=24)


@pytest.fixture(scope="module")
def bank() -> geometry_bank.SurfaceBank:
    return make_bank(SMALL, seed=7)


def test_bank_is_physical(bank: geometry_bank.SurfaceBank) -> None:
    torch.testing.assert_close(bank.normal.norm(dim=-1), torch.ones(3, 20))
    torch.testing.assert_close(bank.direction.norm(dim=-1), torch.ones(3, 12))
    quarters = 4 * bank.visibility  # four directions in each lamp
    assert ((quarters == quarters.round()) & (quarters >= 0) & (quarters <= 4)).all()
    points = make_bank(replace(SMALL, area=False), seed=7)
    assert ((points.visibility == 0) | (points.visibility == 1)).all()
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
    """One pixel, one light at a time, against the layer for any material."""
    drawn = images.random_materials(3, 20, generator_for(1))
    drawn = drawn._replace(surround=0 * drawn.surround, veil=0 * drawn.veil)
    found = images.shade(bank, drawn)
    s, p, n = 1, 4, 7
    material = SumMaterial(
        [
            OrenNayar(drawn.albedo[s, p], drawn.roughness[s, p]),
            *(Microfacet(drawn.specular[s, p, k], drawn.gloss[s, p, k]) for k in range(2)),
        ]
    )
    layer = PointShading(material, DirectionalSource(bank.direction[s, n], [1.0]))
    seen = bank.visibility[s, p, n].reshape(1, 1)
    one = layer(None, bank.normal[s, p].reshape(1, 3), torch.tensor([[0.0, 0.0, 1.0]]), seen)
    torch.testing.assert_close(found[s, p, n], math.pi * one.squeeze())


def test_materials_are_physical_and_of_three_kinds() -> None:
    drawn = images.random_materials(200, 8, generator_for(3))
    reflected = drawn.albedo + drawn.specular.sum(-1)
    assert (reflected <= 1.3).all()
    assert ((drawn.surround > 0) & (drawn.surround < 1)).all()
    matt = (drawn.specular == 0).all(-1).all(-1).float().mean()
    metal = (drawn.specular[..., 0] > 0.15).any(-1).float().mean()
    assert 0.15 < matt < 0.35
    assert 0.08 < metal < 0.25


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
    samples = ShadingSamples(make_shapes(5, 32, seed=1), batches=2, seed=1, images=3)
    batch = samples[1]
    assert all(torch.equal(a, b) for a, b in zip(batch, samples[1], strict=True))
    assert batch.image.shape == batch.normal.shape == batch.albedo.shape == (3, 3, 32, 32)
    assert ((batch.image >= 0) & (batch.image <= 1)).all()
    assert (batch.image[(batch.mask == 0).expand_as(batch.image)] == 0).all()
    torch.testing.assert_close(batch.normal.norm(dim=1, keepdim=True), batch.mask)
    assert batch.image.amax((1, 2, 3)).min() > 0.1


def test_shadows_change_the_image_and_nothing_else() -> None:
    samples = ShadingSamples(make_shapes(4, 32, seed=2), batches=1, seed=5, images=4)
    plain = ShadingSamples(samples.bank, 1, 5, 4, shadows=False)
    first, second = samples[0], plain[0]
    assert torch.equal(first.albedo, second.albedo)
    assert torch.equal(first.normal, second.normal)
    assert not torch.equal(first.image, second.image)


def test_the_control_sees_outlines_alone() -> None:
    bank = make_shapes(4, 32, seed=2)
    seen, control = (ShadingSamples(bank, 1, 5, 4, outline=o)[0] for o in (False, True))
    assert torch.equal(control.image, control.mask.expand(-1, 3, -1, -1))
    assert torch.equal(control.normal, seen.normal)


def test_wrong_options_are_named() -> None:
    with pytest.raises(OutOfRangeError, match="lights"):
        SurfaceOptions(lights=0)
