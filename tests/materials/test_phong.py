"""Highlights: closed forms, all digits at any shininess, gradients, extreme values."""

import math
from collections.abc import Callable

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.cases import SMALL, directions, rand, surface_directions
from tests.tolerances import assert_close
from torchradiometry import materials as m
from torchradiometry.errors import InvalidValueError, OutOfRangeError, ShapeError
from torchradiometry.numerics import power_lobe

DOUBLE = torch.float64
LOBES = [m.Phong, m.NormalizedPhong, m.OriginalPhong, m.BlinnPhong]
BRDFS = [m.phong_brdf, m.normalized_phong_brdf, m.original_phong_brdf, m.blinn_phong_brdf]
#: digits of cos^n taken as a power of a float64 dot product at n <= 20: n eps
POWER = 20 * torch.finfo(DOUBLE).eps


def at(polar: float, azimuth: float = 0.0, dtype: torch.dtype = DOUBLE) -> Tensor:
    x = math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar)
    return torch.tensor(x, dtype=dtype)


def height(brdf: Callable, n: float, cosine: float) -> float:
    """What multiplies cos^n."""
    if brdf is m.normalized_phong_brdf:
        return (n + 2) / (2 * math.pi)
    if brdf is m.original_phong_brdf:
        return 1 / cosine
    if brdf is m.blinn_phong_brdf:
        return (n + 2) * (n + 4) / (8 * math.pi * (2 ** (-n / 2) + n))
    return 1.0


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
@pytest.mark.parametrize("n", [0.0, 0.3, 1.0, 20.0])
@pytest.mark.parametrize("brdf", BRDFS)
def test_lobe_against_the_textbook(brdf: Callable, n: float, dtype: torch.dtype) -> None:
    wi, wo = directions(40, dtype=dtype, seed=1), directions(40, dtype=dtype, seed=2)
    normal, k = torch.tensor([0, 0, 1.0], dtype=dtype), torch.tensor([0.3, 0.7], dtype=dtype)
    found = brdf(k, torch.tensor([n], dtype=dtype), wi, wo, normal)
    wi, wo = (w.double() / w.double().norm(dim=-1, keepdim=True) for w in (wi, wo))
    mirror = wi * torch.tensor([-1, -1, 1])
    half = (wi + wo) / (wi + wo).norm(dim=-1, keepdim=True)
    cosine = half[:, 2] if brdf is m.blinn_phong_brdf else (mirror * wo).sum(-1)
    n = torch.tensor(n, dtype=dtype).item()  # 0.3 as float32 holds it
    tall = torch.tensor([height(brdf, n, z.item()) for z in wi[:, 2]], dtype=DOUBLE)
    expected = (tall * cosine**n)[:, None] * k.double()
    assert found.dtype == dtype
    assert_close(found, expected.to(dtype))


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
@pytest.mark.parametrize("n", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("brdf", BRDFS)
def test_all_digits_at_high_shininess(brdf: Callable, n: float, dtype: torch.dtype) -> None:
    """Directions whose angles are known exactly: alpha (or delta) is set, not measured."""
    width = 1 / math.sqrt(n)
    alpha = torch.tensor([0.0, 0.1, 0.5, 1.0, 2.0, 4.0], dtype=DOUBLE) * width
    turned = 2 * alpha if brdf is m.blinn_phong_brdf else alpha
    polar = 0.3
    wo = torch.stack([at(-(polar + t)) for t in turned.tolist()]).to(dtype)
    wi, normal = at(polar).to(dtype), at(0.0).to(dtype)
    # the angles that the rounded directions really have, in extended arithmetic by atan2
    wi2, wo2 = wi.double(), wo.double()
    tilt = torch.atan2(-wo2[:, 0], wo2[:, 2]) - torch.atan2(wi2[0], wi2[2])
    angle = tilt / 2 if brdf is m.blinn_phong_brdf else tilt
    log_cosine = torch.log1p(-2 * torch.sin(angle / 2) ** 2)
    cosine = (wi2[2] / wi2.norm()).item()
    expected = 0.5 * height(brdf, n, cosine) * torch.exp(n * log_cosine)
    found = brdf(
        torch.tensor([0.5], dtype=dtype), torch.tensor([n], dtype=dtype), wi, wo, normal
    ).squeeze(-1)
    digits = {} if dtype == torch.float32 else {"rtol": 2e-12 * max(1, math.sqrt(n) / 100)}
    assert_close(found, expected.to(dtype), **digits)


@given(
    incident=st.floats(0, 1.5),
    outgoing=st.floats(0, 1.5),
    azimuth=st.floats(0, 6.28),
    n=st.floats(0, 200),
)
@settings(deadline=None, max_examples=50)
def test_reciprocity(incident: float, outgoing: float, azimuth: float, n: float) -> None:
    wi, wo, up = at(incident), at(outgoing, azimuth), at(0.0)
    one, shininess = torch.ones(1, dtype=DOUBLE), torch.tensor([n], dtype=DOUBLE)
    for brdf in (m.phong_brdf, m.normalized_phong_brdf, m.blinn_phong_brdf):
        there, back = brdf(one, shininess, wi, wo, up), brdf(one, shininess, wo, wi, up)
        assert_close(there, back, rtol=1e-10, atol=1e-12)


@given(angle=st.floats(0, 1.5), n=st.floats(0, 1e4))
@settings(deadline=None, max_examples=20)
def test_no_lobe_reflects_more_than_at_normal_incidence(angle: float, n: float) -> None:
    for lobe in (m.Phong, m.NormalizedPhong, m.BlinnPhong):
        material = lobe(torch.tensor([0.3], dtype=DOUBLE), torch.tensor([n], dtype=DOUBLE))
        found = m.directional_hemispherical_reflectance(material, angle)
        assert found.item() <= material.normal_reflectance().item() * (1 + 1e-6)


@given(scale=st.floats(0, 100, allow_subnormal=False), n=st.floats(0, 100))
@settings(deadline=None, max_examples=20)
def test_linear_in_specular(scale: float, n: float) -> None:
    wi, wo, up = directions(5, dtype=DOUBLE), directions(5, dtype=DOUBLE, seed=1), at(0.0)
    k, shininess = torch.tensor([0.2, 0.5], dtype=DOUBLE), torch.tensor([n], dtype=DOUBLE)
    for brdf in BRDFS:
        assert_close(brdf(k * scale, shininess, wi, wo, up), brdf(k, shininess, wi, wo, up) * scale)


@pytest.mark.parametrize("lobe", LOBES)
def test_nothing_below_either_horizon(lobe: type) -> None:
    material = lobe(0.5, 0.0)
    up, side, down = at(0.0).float(), torch.tensor([1.0, 0, 0]), at(2.0).float()
    for wi, wo in [(down, up), (up, down), (down, down), (side, up), (up, side), (up * 0, up)]:
        assert (material(wi, wo, up) == 0).all()
    assert (material(up, up, up) > 0).all()


@pytest.mark.parametrize("brdf", BRDFS)
def test_gradients(brdf: Callable) -> None:
    wi, wo = directions(4, dtype=DOUBLE, seed=3), directions(4, dtype=DOUBLE, seed=4)
    normal = directions(4, dtype=DOUBLE, seed=5)
    k = rand(4, 2, dtype=DOUBLE)
    n = torch.tensor([[0.7], [1.0], [8.0], [60.0]], dtype=DOUBLE)
    inputs = tuple(t.requires_grad_() for t in (k, n, wi, wo, normal))
    assert gradcheck(brdf, inputs)


@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("n", [0.0, 1e-30, 0.5, 1.0, 1e6, 1e30])
@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_extreme_values_are_finite(lobe: type, n: float, dtype: torch.dtype) -> None:
    k = torch.tensor([0.5], dtype=dtype)
    material = lobe(k, torch.tensor([n], dtype=dtype), learnable=True)
    up = torch.tensor([0, 0, 1.0], dtype=dtype)
    edge = torch.tensor([1, 0, torch.finfo(dtype).tiny * 8], dtype=dtype)
    grazing = torch.tensor([1, 0, 1e-5], dtype=dtype)
    some = torch.stack([up, edge, grazing, -grazing, -up, up * 0, edge * torch.tensor([-1, 1, 1])])
    wi = some.repeat_interleave(7, 0).requires_grad_()
    wo, normal = some.repeat(7, 1).requires_grad_(), up.expand(49, 3).clone().requires_grad_()
    found = material(wi, wo, normal)
    (found * wi[:, 2:].clamp(min=0)).sum().backward()
    assert torch.isfinite(found).all()
    for t in (wi, wo, normal, material.specular, material.shininess):
        assert torch.isfinite(t.grad).all()


def test_shininess_zero_is_diffuse() -> None:
    wi, wo, normal = surface_directions(DOUBLE, SMALL)
    white = m.Lambertian(torch.tensor([1.0], dtype=DOUBLE))
    for lobe in (m.NormalizedPhong, m.BlinnPhong):
        material = lobe(torch.tensor([1.0], dtype=DOUBLE), torch.tensor([0.0], dtype=DOUBLE))
        assert_close(material(wi, wo, normal), white(wi, wo, normal))


def test_original_phong_times_the_cosine_is_phong_1975() -> None:
    wi, wo, normal = surface_directions(DOUBLE, SMALL)
    k, n = torch.tensor([0.4], dtype=DOUBLE), torch.tensor([12.0], dtype=DOUBLE)
    found = m.original_phong_brdf(k, n, wi, wo, normal) * (wi * normal).sum(-1, keepdim=True)
    mirror = m.mirror_direction(wi, normal)
    expected = 0.4 * power_lobe((mirror * wo).sum(-1, keepdim=True), n)
    assert_close(found, expected, rtol=POWER * 100)


@pytest.mark.parametrize("lobe", LOBES)
def test_parameters_per_image_and_per_pixel(lobe: type) -> None:
    wi, wo, normal = surface_directions(DOUBLE, SMALL)  # light batch point 3
    k, n = rand(2, 1, 3, dtype=DOUBLE), rand(2, 12, 1, dtype=DOUBLE, high=30)
    found = lobe(k, n)(wi, wo, normal)
    assert found.shape == (2, 2, 12, 3)
    one = lobe(k[1, 0], n[1, 7])(wi[0, 1, 7], wo[1, 7], normal[1, 7])
    assert_close(found[0, 1, 7], one)


@pytest.mark.parametrize("lobe", LOBES)
def test_learns_its_shininess_and_height(lobe: type) -> None:
    wi, wo, normal = surface_directions(DOUBLE, SMALL)
    true = lobe(torch.tensor([0.6], dtype=DOUBLE), torch.tensor([8.0], dtype=DOUBLE))
    target = true(wi, wo, normal)
    guess = lobe(
        torch.tensor([0.3], dtype=DOUBLE), torch.tensor([4.0], dtype=DOUBLE), learnable=True
    )
    assert len(list(guess.parameters())) == 2
    optimizer = torch.optim.LBFGS(guess.parameters(), max_iter=100, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        optimizer.zero_grad()
        loss = (guess(wi, wo, normal) - target).square().sum() * 100
        loss.backward()
        return loss

    optimizer.step(closure)
    assert_close(guess.specular, true.specular, rtol=1e-3)
    assert_close(guess.shininess, true.shininess, rtol=1e-3)


@pytest.mark.parametrize("lobe", LOBES)
def test_bad_values_are_named_when_built(lobe: type) -> None:
    for error, k, n in [
        (OutOfRangeError, -0.1, 1.0),
        (OutOfRangeError, 0.1, -1.0),
        (InvalidValueError, math.nan, 1.0),
        (InvalidValueError, 0.1, math.inf),
        (ShapeError, 0.1, [1.0, 2.0]),
    ]:
        with pytest.raises(error):
            lobe(k, n)
    if lobe in (m.NormalizedPhong, m.BlinnPhong):
        with pytest.raises(OutOfRangeError):
            lobe(1.1, 1.0)
    assert "shininess [1]" in repr(lobe(0.1, 2.0))
