"""Lambertian: rho/pi above the surface, nothing below."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from tests.cases import SMALL, directions, rand, surface_directions
from tests.tolerances import assert_close
from torchradiometry import materials as m
from torchradiometry.errors import DTypeError, InvalidValueError, OutOfRangeError

DOUBLE = torch.float64


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
def test_value(dtype: torch.dtype) -> None:
    albedo = rand(3, dtype=dtype)
    found = m.Lambertian(albedo)(*surface_directions(dtype, SMALL))
    assert found.dtype == dtype
    assert_close(found, (albedo.double() / math.pi).to(dtype))


def test_gradient_and_horizon() -> None:
    wi, wo = directions(5, dtype=DOUBLE), directions(5, dtype=DOUBLE, seed=1)
    normal = torch.tensor([0, 0, 1.0], dtype=DOUBLE)
    albedo = rand(5, 3, dtype=DOUBLE).requires_grad_()
    assert gradcheck(m.lambertian_brdf, (albedo, wi, wo, normal))
    for pair in ((-wi, wo), (wi, -wo), (wi * 0, wo)):
        assert (m.lambertian_brdf(albedo, *pair, normal) == 0).all()


def test_furnace() -> None:
    """Under a uniform sky of radiance 1 a white surface shines with radiance 1."""
    rule = m.mirror_quadrature(0.0)
    up = torch.tensor([0, 0, 1.0], dtype=DOUBLE)
    brdf = m.Lambertian(torch.ones(1, dtype=DOUBLE))(rule.direction, up, up)
    radiance = (brdf[:, 0] * rule.direction[:, 2] * rule.weight).sum()
    assert_close(radiance, 1.0)


def test_bad_values_are_named_when_built() -> None:
    for error, albedo in [
        (OutOfRangeError, 1.2),
        (OutOfRangeError, -0.1),
        (InvalidValueError, math.nan),
        (DTypeError, 1j),
    ]:
        with pytest.raises(error, match="albedo"):
            m.Lambertian(albedo)
    assert m.Lambertian(1).albedo.dtype == torch.get_default_dtype()
    assert len(list(m.Lambertian(0.5, learnable=True).parameters())) == 1
