"""Small mirrors: Trowbridge and Reitz' distribution, Smith's shadowing, closed forms."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from tests.cases import directions, rand
from tests.tolerances import assert_close
from torchradiometry import materials as m
from torchradiometry.errors import OutOfRangeError

DOUBLE = torch.float64
UP = torch.tensor([0.0, 0.0, 1.0], dtype=DOUBLE)


def one(value: float) -> torch.Tensor:
    return torch.tensor([value], dtype=DOUBLE)


@pytest.mark.parametrize("a", [0.05, 0.3, 0.8])
def test_against_the_published_factors(a: float) -> None:
    """D of Walter et al. eq. 33 by tan(delta); G by Smith's Lambda, Heitz eq. 72 and 99."""
    wi, wo = directions(50, dtype=DOUBLE, seed=1), directions(50, dtype=DOUBLE, seed=2)
    half = (wi + wo) / (wi + wo).norm(dim=-1, keepdim=True)
    delta = torch.acos(half[:, 2])
    spread = a**2 / (math.pi * torch.cos(delta) ** 4 * (a**2 + torch.tan(delta) ** 2) ** 2)

    def shadow(w: torch.Tensor) -> torch.Tensor:
        slope = (1 - w[:, 2] ** 2) / w[:, 2] ** 2
        return (torch.sqrt(1 + a**2 * slope) - 1) / 2

    seen = 1 / (1 + shadow(wi) + shadow(wo))
    k = 0.3
    fresnel = k + (1 - k) * (1 - (wi * half).sum(-1)) ** 5
    expected = spread * seen * fresnel / (4 * wi[:, 2] * wo[:, 2])
    found = m.microfacet_brdf(one(k), one(a), wi, wo, UP)[:, 0]
    assert_close(found, expected, rtol=1e-9)
    single = m.microfacet_brdf(one(k).float(), one(a).float(), wi.float(), wo.float(), UP.float())
    assert single.dtype == torch.float32
    # the directions themselves are rounded, which a narrow lobe multiplies by 1/a^2
    assert_close(single[:, 0].double(), expected, rtol=1e-6 / a**2)


def test_the_share_of_light_from_above_is_known_at_full_roughness() -> None:
    white = m.Microfacet(one(1), one(1))
    found = m.directional_hemispherical_reflectance(white, 0.0).item()
    assert found == pytest.approx(1 - math.log(2), abs=1e-9)


def test_a_white_surface_keeps_what_the_file_says() -> None:
    found = m.directional_hemispherical_reflectance(m.Microfacet(one(1), one(0.1)), 0.0)
    assert found.item() == pytest.approx(0.988, abs=5e-4)


@pytest.mark.parametrize("a", [0.02, 0.1])
def test_a_smooth_white_surface_is_nearly_a_mirror(a: float) -> None:
    white = m.Microfacet(one(1), one(a))
    found = m.directional_hemispherical_reflectance(white, 0.5).item()
    assert 0.985 < found < 1 + 1e-4
    grey = m.directional_hemispherical_reflectance(m.Microfacet(one(0.04), one(a)), 0.0).item()
    assert grey == pytest.approx(0.04, rel=0.02)


def test_reciprocity_energy_and_gradients() -> None:
    material = m.Microfacet(rand(3, dtype=DOUBLE), one(0.4))
    # relative to a lobe of height 1 / (4 pi a^2) and of any height at grazing angles
    assert m.reciprocity_error(material).item() < 1e-9
    assert m.energy_excess(material).item() <= 0
    wi, wo = directions(5, dtype=DOUBLE, seed=5), directions(5, dtype=DOUBLE, seed=6)
    normal = directions(5, dtype=DOUBLE, seed=7)
    inputs = (rand(5, 2, dtype=DOUBLE), rand(5, 1, dtype=DOUBLE, low=0.2), wi, wo, normal)
    assert gradcheck(m.microfacet_brdf, tuple(t.requires_grad_() for t in inputs))


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
@pytest.mark.parametrize("a", [1e-4, 0.1, 1.0])
def test_grazing_and_below_are_finite(a: float, dtype: torch.dtype) -> None:
    some = torch.tensor([[0, 0, 1], [1, 0, 1e-6], [1, 0, 1e-30], [-1, 0, 1e-6], [0, 0, -1]])
    wi = some.to(dtype).repeat_interleave(5, 0).requires_grad_()
    wo = some.to(dtype).repeat(5, 1)
    material = m.Microfacet(one(0.5).to(dtype), one(a).to(dtype), learnable=True)
    found = material(wi, wo, UP.to(dtype))
    (found * wi[:, 2:].clamp(min=0)).sum().backward()
    gradients = (wi.grad, material.specular.grad, material.roughness.grad)
    assert all(torch.isfinite(t).all() for t in (found, *gradients))
    assert (found[-5:] == 0).all()


def test_roughness_out_of_range() -> None:
    with pytest.raises(OutOfRangeError, match="roughness"):
        m.Microfacet(0.04, 0.0)
