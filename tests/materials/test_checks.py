"""Checks of materials: reflectance against closed forms, reciprocity, energy."""

import math

import pytest
import torch

from tests.tolerances import assert_close
from torchradiometry import materials as m
from torchradiometry.errors import OutOfRangeError
from torchradiometry.geometry.quadrature import hemisphere_quadrature
from torchradiometry.reference import closed_forms

ANGLES = [0.0, 0.4, 1.0, 1.4]
#: the rule of `mirror_quadrature` against itself with twice the nodes, up to 85 degrees
BLINN_RULE = 1e-9


def number(x: float) -> torch.Tensor:
    return torch.tensor([x], dtype=torch.float64)


@pytest.mark.parametrize("angle", ANGLES)
def test_lambertian_reflects_its_albedo(angle: float) -> None:
    found = m.directional_hemispherical_reflectance(m.Lambertian(number(0.6)), angle)
    assert_close(found, number(0.6))


@pytest.mark.parametrize("n", [0.0, 1.0, 2.5, 10.0, 1e2, 1e4, 1e6])
@pytest.mark.parametrize("angle", ANGLES)
def test_phong_reflects_what_the_one_dimensional_integral_gives(n: float, angle: float) -> None:
    found = m.directional_hemispherical_reflectance(m.Phong(number(0.7), number(n)), angle)
    assert_close(found, number(0.7 * closed_forms.phong_reflectance(n, angle)))


@pytest.mark.parametrize("n", [0.0, 1.0, 10.0, 1e4, 1e6])
@pytest.mark.parametrize("lobe", [m.Phong, m.NormalizedPhong, m.BlinnPhong, m.OriginalPhong])
def test_reflectance_at_normal_incidence(lobe: type, n: float) -> None:
    material = lobe(number(0.3), number(n))
    found = m.directional_hemispherical_reflectance(material, 0.0)
    share = 0.3 if lobe in (m.NormalizedPhong, m.BlinnPhong) else 0.6 * math.pi / (n + 2)
    assert_close(found, number(share))
    assert_close(found, material.normal_reflectance())


@pytest.mark.parametrize("angle", ANGLES)
def test_normalized_phong_tends_to_a_mirror_times_the_cosine(angle: float) -> None:
    gaps = []
    for n in (1e2, 1e4, 1e6):
        material = m.NormalizedPhong(number(1.0), number(n))
        found = m.directional_hemispherical_reflectance(material, angle).item()
        gaps.append(abs(found - math.cos(angle)))
    if angle == 0:
        assert max(gaps) < 1e-12
    else:  # the lobe's normalisation is for normal incidence: (n+2)/(n+1) - 1 and the horizon
        assert gaps[1] < gaps[0]
        assert gaps[2] < 2e-6


@pytest.mark.parametrize(
    "material",
    [
        m.Lambertian(number(1.0)),
        m.Phong(number(1 / math.pi), number(0.0)),
        m.NormalizedPhong(number(1.0), number(0.5)),
        m.NormalizedPhong(number(1.0), number(30.0)),
        m.BlinnPhong(number(1.0), number(0.5)),
        m.BlinnPhong(number(1.0), number(300.0)),
        m.LambertianSpecular(number(0.4), number(0.6), number(20.0)),
        m.LambertianSpecular(number(0.4), number(0.6), number(20.0), lobe=m.BlinnPhong),
    ],
)
def test_physical_materials_are_reciprocal_and_lose_no_energy(material: torch.nn.Module) -> None:
    assert abs(m.energy_excess(material).item()) < BLINN_RULE
    assert m.reciprocity_error(material).item() < 1e-10


def test_faults_are_found() -> None:
    original = m.OriginalPhong(number(0.5), number(10.0))
    assert m.reciprocity_error(original).item() > 0.1
    assert m.energy_excess(original).item() > 0.1
    bright = m.SumMaterial([m.Lambertian(number(0.8)), m.NormalizedPhong(number(0.8), number(9))])
    assert_close(m.energy_excess(bright, (0.0,)), 0.6)


def test_per_pixel_materials_have_a_reflectance_per_pixel() -> None:
    albedo = torch.linspace(0, 0.5, 60, dtype=torch.float64).reshape(4, 5, 3)
    specular = torch.linspace(0.1, 0.4, 20, dtype=torch.float64).reshape(4, 5, 1)
    shininess = torch.linspace(0, 50, 20, dtype=torch.float64).reshape(4, 5, 1)
    material = m.LambertianSpecular(albedo, specular, shininess)
    found = m.directional_hemispherical_reflectance(material, 0.0)
    assert found.shape == (4, 5, 3)
    assert_close(found, albedo + specular)
    assert m.reciprocity_error(material).item() < 1e-10


def test_reflectance_is_differentiable_in_the_material() -> None:
    material = m.Phong(number(0.5), number(8.0), learnable=True)
    m.directional_hemispherical_reflectance(material, 0.0).sum().backward()
    assert_close(material.specular.grad, number(2 * math.pi / 10))
    assert_close(material.shininess.grad, number(-0.5 * 2 * math.pi / 100))


def test_another_quadrature_may_be_given() -> None:
    rule = hemisphere_quadrature(16, 32, dtype=torch.float64)
    material = m.Phong(number(1.0), number(6.0))
    found = m.directional_hemispherical_reflectance(material, 0.0, rule)
    assert_close(found, number(2 * math.pi / 8))


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.5, math.pi / 2])
def test_mirror_quadrature_covers_the_hemisphere(angle: float) -> None:
    rule = m.mirror_quadrature(angle)
    assert (rule.weight >= 0).all()
    assert rule.direction[:, 2].min() > -1e-12
    assert_close(rule.direction.norm(dim=-1), 1.0)
    assert_close(rule.weight.sum(), 2 * math.pi, rtol=1e-7)
    assert_close((rule.weight * rule.direction[:, 2]).sum(), math.pi, rtol=1e-7)


def test_bad_input_is_named() -> None:
    gray = m.Lambertian(0.5)
    for call in (
        lambda: m.directional_hemispherical_reflectance(gray, 45.0),
        lambda: m.directional_hemispherical_reflectance(gray, math.nan),
        lambda: m.mirror_quadrature(-0.1),
        lambda: m.mirror_quadrature(0.1, azimuth=3),
        lambda: m.reciprocity_error(gray, samples=1),
    ):
        with pytest.raises(OutOfRangeError):
            call()
