"""quantities: conversions are inverse to each other and agree with their definitions."""

import math

import torch

from tests.tolerances import assert_close
from torchradiometry import quantities as q

X = torch.tensor([0.0, 1e-12, 1.0, 1e12], dtype=torch.float64)


def test_radiance_and_radiosity_are_inverse_and_differ_by_pi() -> None:
    assert_close(q.radiosity_from_radiance(torch.ones(1, dtype=torch.float64)), math.pi)
    assert_close(q.radiance_from_radiosity(q.radiosity_from_radiance(X)), X)


def test_flux_and_intensity_are_inverse_and_differ_by_the_whole_sphere() -> None:
    assert_close(q.flux_from_intensity(torch.ones(1, dtype=torch.float64)), 4 * math.pi)
    assert_close(q.intensity_from_flux(q.flux_from_intensity(X)), X)


def test_every_quantity_has_symbol_unit_and_meaning() -> None:
    assert all(all(part for part in quantity) for quantity in q.QUANTITIES.values())
