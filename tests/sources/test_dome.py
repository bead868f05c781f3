"""Ambient dome: pi L for every normal; the half sky against quadrature."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import OutOfRangeError, ShapeError
from torchradiometry.geometry import hemisphere_quadrature, integrate_hemisphere
from torchradiometry.sources import AmbientDome, dome_arrival, irradiance


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_from_everywhere_every_surface_gets_pi_times_the_radiance(
    dtype: torch.dtype, generator: torch.Generator
) -> None:
    normal = torch.randn(50, 3, dtype=dtype, generator=generator)
    normal = normal / normal.norm(dim=-1, keepdim=True)
    dome = AmbientDome([0.5, 2.0]).to(dtype)
    arrival = dome(None, normal)
    expected = torch.tensor([0.5, 2.0], dtype=torch.float64) * math.pi
    assert_close(
        irradiance(arrival, normal), expected, rtol=3e-7 if dtype == torch.float32 else 1e-12
    )
    assert torch.isinf(arrival.distance).all()
    assert not dome.has_direction
    assert not dome.needs_position


@pytest.mark.parametrize("tilt", [0.0, 0.7, math.pi / 2, 2.5, math.pi])
def test_half_sky_against_the_integral(tilt: float) -> None:
    n = torch.tensor([math.sin(tilt), 0.0, math.cos(tilt)], dtype=torch.float64)
    e = dome_arrival(torch.ones(1, 1).double(), n[None], 5 * torch.eye(3).double()[2:])
    assert_close(e.irradiance[0, 0, 0], math.pi * (1 + math.cos(tilt)) / 2, atol=1e-15)
    rule = hemisphere_quadrature(200, 400, dtype=torch.float64)
    sky = integrate_hemisphere(lambda w: (w @ n).clamp(min=0), rule)
    # the kink on the receiver's horizon: second order in the node distance
    assert_close(e.irradiance[0, 0, 0], sky, rtol=1e-4, atol=1e-4)


def test_gradients_and_batches(generator: torch.Generator) -> None:
    normal = torch.randn(2, 4, 3, dtype=torch.float64, generator=generator)
    normal = (normal / normal.norm(dim=-1, keepdim=True)).requires_grad_()
    radiance = torch.rand(2, 3, 2, dtype=torch.float64, generator=generator).requires_grad_()
    up = torch.randn(2, 3, 3, dtype=torch.float64, generator=generator).requires_grad_()
    assert gradcheck(lambda r, n, u: dome_arrival(r, n, u)[:2], (radiance, normal, up))
    assert gradcheck(lambda r, n: dome_arrival(r, n)[:2], (radiance, normal))
    together = dome_arrival(radiance, normal, up)
    assert together.irradiance.shape == (3, 2, 4, 2)
    alone = dome_arrival(radiance[1], normal[1], up[1])
    assert torch.equal(together.irradiance[:, 1], alone.irradiance)
    assert len(list(AmbientDome([1.0], up=[0.0, 1, 0], learnable=True).parameters())) == 2


def test_named_errors() -> None:
    with pytest.raises(OutOfRangeError, match="radiance"):
        AmbientDome([-1.0])
    with pytest.raises(ShapeError, match="up"):
        AmbientDome([1.0], up=[0.0, 1.0])
