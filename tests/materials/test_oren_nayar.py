"""Rough matt surfaces: nothing lost, Lambert's law as the limit, the published mean."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from tests.cases import directions, rand
from tests.tolerances import assert_close
from torchradiometry import materials as m

DOUBLE = torch.float64
UP = torch.tensor([0.0, 0.0, 1.0], dtype=DOUBLE)
#: of the quadrature over the hemisphere, whose integrand has a kink at s = 0
KINK = 2e-3


def one(value: float) -> torch.Tensor:
    return torch.tensor([value], dtype=DOUBLE)


@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.6, 1.0])
@pytest.mark.parametrize("angle", [0.0, 0.4, 1.0, 1.4])
def test_a_white_surface_reflects_everything(angle: float, roughness: float) -> None:
    white = m.OrenNayar(one(1), one(roughness))
    found = m.directional_hemispherical_reflectance(white, angle)
    assert found.item() == pytest.approx(1, abs=KINK if roughness else 1e-9)


def test_the_mean_over_the_hemisphere_is_the_diffuse_albedo() -> None:
    """DHR averaged over the cosine of incidence (Gauss-Legendre in mu^2), against a closed form."""
    grey = m.OrenNayar(one(0.5), one(0.8))
    # 8 nodes of Gauss-Legendre on 0..1 in mu^2: the mean over a cosine-weighted hemisphere
    nodes, weights = torch.linalg.eigh(
        torch.diag(torch.tensor([k / math.sqrt(4 * k * k - 1) for k in range(1, 8)]), 1).double()
        + torch.diag(torch.tensor([k / math.sqrt(4 * k * k - 1) for k in range(1, 8)]), -1).double()
    )
    squares, shares = (nodes + 1) / 2, weights[0] ** 2
    angles = torch.acos(squares.sqrt())
    found = sum(
        share * m.directional_hemispherical_reflectance(grey, angle.item())
        for angle, share in zip(angles, shares, strict=True)
    )
    assert found.item() == pytest.approx(grey.diffuse_albedo().item(), abs=KINK)


def test_smooth_is_lambertian_and_rough_is_flatter() -> None:
    wi, wo = directions(30, dtype=DOUBLE, seed=1), directions(30, dtype=DOUBLE, seed=2)
    rho = rand(3, dtype=DOUBLE)
    smooth = m.oren_nayar_brdf(rho, one(0), wi, wo, UP)
    assert_close(smooth, m.lambertian_brdf(rho, wi, wo, UP))
    # lit and seen from the same side at 60 degrees: brighter than from above
    side = torch.tensor([math.sin(1.047), 0, math.cos(1.047)], dtype=DOUBLE)
    rough = m.OrenNayar(one(0.7), one(0.8))
    assert rough(side, side, UP).item() > 1.3 * rough(UP, UP, UP).item()


def test_the_classical_term_for_single_bounces() -> None:
    """At small albedo, s/t is Oren and Nayar's max(0, cos phi) sin(alpha) tan(beta) where s > 0."""
    wi, wo = directions(40, dtype=DOUBLE, seed=3), directions(40, dtype=DOUBLE, seed=4)
    theta_i, theta_o = torch.acos(wi[:, 2]), torch.acos(wo[:, 2])
    phi = torch.atan2(wi[:, 1], wi[:, 0]) - torch.atan2(wo[:, 1], wo[:, 0])
    alpha, beta = torch.maximum(theta_i, theta_o), torch.minimum(theta_i, theta_o)
    classical = torch.cos(phi) * torch.sin(alpha) * torch.tan(beta)
    near = torch.cos(phi) > 0
    r, tiny = 0.5, 1e-12
    found = m.oren_nayar_brdf(one(tiny), one(r), wi, wo, UP)[:, 0] * math.pi / tiny
    scale = 1 / (1 + (1 / 2 - 2 / (3 * math.pi)) * r)
    assert near.sum() > 10
    assert_close(found[near], scale * (1 + r * classical[near]), rtol=1e-9)


def test_reciprocity_energy_and_gradients() -> None:
    material = m.OrenNayar(rand(3, dtype=DOUBLE), one(0.7))
    assert m.reciprocity_error(material).item() < 1e-15
    assert m.energy_excess(material).item() <= 0
    wi, wo = directions(5, dtype=DOUBLE, seed=5), directions(5, dtype=DOUBLE, seed=6)
    normal = directions(5, dtype=DOUBLE, seed=7)
    inputs = (rand(5, 2, dtype=DOUBLE), rand(5, 1, dtype=DOUBLE, seed=1), wi, wo, normal)
    assert gradcheck(m.oren_nayar_brdf, tuple(t.requires_grad_() for t in inputs))


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_grazing_and_below_are_finite(dtype: torch.dtype) -> None:
    tiny = torch.finfo(dtype).tiny
    some = torch.tensor([[0, 0, 1], [1, 0, 1e-6], [1, 0, tiny], [-1, 0, 1e-6], [0, 0, -1]])
    wi = some.to(dtype).repeat_interleave(5, 0).requires_grad_()
    wo = some.to(dtype).repeat(5, 1)
    material = m.OrenNayar(torch.ones(1, dtype=dtype), torch.ones(1, dtype=dtype), learnable=True)
    found = material(wi, wo, UP.to(dtype))
    (found * wi[:, 2:].clamp(min=0)).sum().backward()
    gradients = (wi.grad, material.albedo.grad, material.roughness.grad)
    assert all(torch.isfinite(t).all() for t in (found, *gradients))
    assert (found[-5:] == 0).all()
    assert found.dtype == dtype
