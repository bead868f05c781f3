"""Spherical harmonics: an orthonormal basis, exact projection, irradiance against quadrature."""

import math

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import ShapeError
from torchradiometry.geometry import hemisphere_quadrature, local_frame
from torchradiometry.sources import (
    HarmonicSource,
    harmonic_arrival,
    harmonic_basis,
    irradiance,
    project_harmonics,
)


def whole_sphere(polar: int, azimuth: int) -> tuple[Tensor, Tensor]:
    rule = hemisphere_quadrature(polar, azimuth, dtype=torch.float64)
    return torch.cat((rule.direction, -rule.direction)), rule.weight.repeat(2)


def quadratic_sky(w: Tensor) -> Tensor:
    """A known environment of degree 2, two channels, positive everywhere."""
    x, y, z = w.unbind(-1)
    return torch.stack((2 + x + 0.5 * y * z + x * x, 3 + z * z - 0.7 * x * y + 0.2 * y), -1)


def test_the_basis_is_orthonormal() -> None:
    w, weight = whole_sphere(8, 16)
    basis = harmonic_basis(w)
    assert_close((basis * weight[:, None]).T @ basis, torch.eye(9))


def test_projection_gives_back_a_known_environment(generator: torch.Generator) -> None:
    w, weight = whole_sphere(8, 16)
    coefficients = project_harmonics(w, quadratic_sky(w), weight)
    anywhere = torch.randn(20, 3, dtype=torch.float64, generator=generator)
    anywhere = anywhere / anywhere.norm(dim=-1, keepdim=True)
    assert_close(harmonic_basis(anywhere) @ coefficients, quadratic_sky(anywhere))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_irradiance_of_a_known_environment(dtype: torch.dtype, generator: torch.Generator) -> None:
    """Against the cosine-weighted hemisphere integral about each normal, exact to rounding."""
    w, weight = whole_sphere(8, 16)
    source = HarmonicSource(project_harmonics(w, quadratic_sky(w), weight)).to(dtype)
    normal = torch.randn(20, 3, dtype=torch.float64, generator=generator)
    normal = (normal / normal.norm(dim=-1, keepdim=True)).to(dtype)
    rule = hemisphere_quadrature(8, 16, dtype=torch.float64)
    t, b = local_frame(normal.double())
    frame = torch.stack((t, b, normal.double()), -2)
    sky = quadratic_sky(rule.direction @ frame)
    truth = (sky * (rule.weight * rule.direction[:, 2])[:, None]).sum(-2)
    assert_close(irradiance(source(None, normal), normal), truth)


def test_what_nine_numbers_forget_of_a_single_distant_source() -> None:
    """max(0, cos) minus its nine harmonics: the figures of this file's heading."""
    cosine = torch.linspace(-1, 1, 100001, dtype=torch.float64)
    series = 0.25 + cosine / 2 + 5 / 32 * (3 * cosine**2 - 1)
    rest = cosine.clamp(min=0) - series
    assert_close(
        (rest**2).mean().sqrt() / (cosine.clamp(min=0) ** 2).mean().sqrt(), 0.0884, rtol=1e-3
    )
    assert float((rest**2).mean() / (cosine.clamp(min=0) ** 2).mean()) < 0.008
    sun = torch.eye(3, dtype=torch.float64)[2:]
    coefficients = harmonic_basis(sun).unsqueeze(-1)  # a distant source of 1 W/m2
    around = torch.stack((1 - cosine**2, 0 * cosine, cosine), -1)
    around[:, 0] = around[:, 0].sqrt()
    found = harmonic_arrival(coefficients, around).irradiance[0, :, 0]
    assert_close(found, series.clamp(min=0), atol=1e-14)
    assert bool((found >= 0).all())
    assert float(series.min()) < 0


def test_constant_environment_is_a_dome() -> None:
    constant = torch.zeros(9, 1).double()
    constant[0] = math.sqrt(4 * math.pi)
    normal = torch.eye(3).double()
    source = HarmonicSource(constant)
    assert_close(irradiance(source(None, normal), normal), math.pi)
    assert not source.has_direction
    assert source.lights == 1


def test_gradients_and_batches(generator: torch.Generator) -> None:
    normal = torch.randn(2, 4, 3, dtype=torch.float64, generator=generator)
    normal = (normal / normal.norm(dim=-1, keepdim=True)).requires_grad_()
    coefficients = 0.2 * torch.randn(2, 3, 9, 2, dtype=torch.float64, generator=generator)
    coefficients[..., 0, :] += 2
    coefficients.requires_grad_()
    assert gradcheck(lambda c, n: harmonic_arrival(c, n)[:2], (coefficients, normal))
    together = harmonic_arrival(coefficients, normal)
    assert together.irradiance.shape == (3, 2, 4, 2)
    alone = harmonic_arrival(coefficients[1], normal[1])
    assert torch.equal(together.irradiance[:, 1], alone.irradiance)
    assert isinstance(HarmonicSource(coefficients, learnable=True).coefficients, torch.nn.Parameter)


def test_named_error() -> None:
    with pytest.raises(ShapeError, match="coefficients"):
        HarmonicSource(torch.zeros(1, 4, 3))
