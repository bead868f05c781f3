"""Sums of materials: superposition, nesting, named mistakes."""

import pytest
import torch
from torch.autograd import gradcheck

from tests.cases import SMALL, directions, rand, surface_directions
from tests.tolerances import assert_close
from torchradiometry import materials as m
from torchradiometry.errors import DTypeError, ShapeError

DOUBLE = torch.float64


def members() -> list[m.AbstractMaterial]:
    return [
        m.Lambertian(rand(3, dtype=DOUBLE)),
        m.Phong(rand(1, dtype=DOUBLE, seed=1), rand(1, dtype=DOUBLE, high=20)),
        m.BlinnPhong(rand(3, dtype=DOUBLE, seed=2), rand(1, dtype=DOUBLE, high=20)),
    ]


def test_superposition_in_any_order_and_nested() -> None:
    inputs = surface_directions(DOUBLE, SMALL)
    parts = members()
    expected = parts[0](*inputs) + parts[1](*inputs) + parts[2](*inputs)
    assert_close(m.SumMaterial(parts)(*inputs), expected)
    assert_close(m.SumMaterial(parts[::-1])(*inputs), expected)
    nested = m.SumMaterial([m.SumMaterial(parts[:2]), parts[2]])
    assert_close(nested(*inputs), expected)


def test_gradients_reach_every_member() -> None:
    wi, wo = directions(3, dtype=DOUBLE), directions(3, dtype=DOUBLE, seed=1)
    normal = directions(3, dtype=DOUBLE, seed=2)
    material = m.SumMaterial(members())
    inputs = tuple(t.requires_grad_() for t in (wi, wo, normal))
    assert gradcheck(material, inputs)
    held = [m.Lambertian(0.3, learnable=True), m.Phong(0.2, 3.0, learnable=True)]
    total = m.SumMaterial(held)
    total(*(t.float() for t in inputs)).sum().backward()
    assert all(p.grad is not None and (p.grad != 0).all() for p in total.parameters())
    assert len(list(total.parameters())) == 3


def test_mistakes_are_named() -> None:
    with pytest.raises(ShapeError, match="materials"):
        m.SumMaterial([])
    with pytest.raises(DTypeError, match="Linear"):
        m.SumMaterial([torch.nn.Linear(1, 1)])


def test_diffuse_part_is_the_sum_of_the_diffuse_parts() -> None:
    gray, shiny = m.Lambertian(0.25), m.Phong(0.2, 3.0)
    plastic = m.LambertianSpecular(0.5, 0.1, 9.0)
    assert_close(m.SumMaterial([gray, shiny, plastic]).diffuse_albedo(), 0.75)
    assert m.SumMaterial([shiny, shiny]).diffuse_albedo() is None
