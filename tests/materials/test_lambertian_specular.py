"""A diffuse base with a highlight, and its energy check."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.autograd import gradcheck

from tests.cases import SMALL, directions, rand, surface_directions
from tests.tolerances import assert_close
from torchradiometry import materials as m
from torchradiometry.errors import OutOfRangeError

DOUBLE = torch.float64
LOBES = [m.Phong, m.NormalizedPhong, m.OriginalPhong, m.BlinnPhong]


@pytest.mark.parametrize("lobe", LOBES)
def test_is_the_sum_of_its_parts(lobe: type) -> None:
    inputs = surface_directions(DOUBLE, SMALL)
    albedo, k = rand(3, dtype=DOUBLE, high=0.4), rand(3, dtype=DOUBLE, high=0.4)
    n = torch.tensor([7.0], dtype=DOUBLE)
    found = m.LambertianSpecular(albedo, k, n, lobe=lobe)(*inputs)
    parts = m.SumMaterial([m.Lambertian(albedo), lobe(k, n)])
    assert_close(found, parts(*inputs))


@given(albedo=st.floats(0, 1), specular=st.floats(0, 1), n=st.floats(0, 1e3))
@settings(deadline=None, max_examples=50)
def test_energy_check_is_albedo_plus_specular(albedo: float, specular: float, n: float) -> None:
    a, k, e = (torch.tensor([x], dtype=DOUBLE) for x in (albedo, specular, n))
    for lobe in (m.NormalizedPhong, m.BlinnPhong):
        if albedo + specular > 1 + 2e-6:
            with pytest.raises(OutOfRangeError, match="albedo, specular"):
                m.LambertianSpecular(a, k, e, lobe=lobe)
        elif albedo + specular <= 1:
            material = m.LambertianSpecular(a, k, e, lobe=lobe)
            assert_close(material.normal_reflectance(), albedo + specular)


def test_plain_lobe_is_checked_by_what_it_reflects() -> None:
    assert m.LambertianSpecular(0.9, 1.0, 100.0, lobe=m.Phong).normal_reflectance() < 1
    with pytest.raises(OutOfRangeError):
        m.LambertianSpecular(0.9, 1.0, 1.0, lobe=m.Phong)
    m.LambertianSpecular([0.7, 0.3], [0.3, 0.7], 5.0)  # exactly 1, in float32


def test_reflectance_at_normal_incidence_is_the_sum() -> None:
    material = m.LambertianSpecular(
        rand(3, dtype=DOUBLE, high=0.4), rand(3, dtype=DOUBLE, high=0.4), 9.0
    ).double()
    found = m.directional_hemispherical_reflectance(material, 0.0)
    assert_close(found, material.normal_reflectance())


def test_gradients() -> None:
    wi, wo = directions(3, dtype=DOUBLE), directions(3, dtype=DOUBLE, seed=1)
    normal = directions(3, dtype=DOUBLE, seed=2)
    material = m.LambertianSpecular(0.3, 0.2, 5.0, learnable=True).double()
    assert len(list(material.parameters())) == 3
    assert gradcheck(material, tuple(t.requires_grad_() for t in (wi, wo, normal)))
    material(wi, wo, normal).sum().backward()
    assert_close(material.albedo.grad, torch.tensor([3 / math.pi], dtype=DOUBLE))
    assert (material.lobe.shininess.grad != 0).all()
