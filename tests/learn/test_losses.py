"""Losses: zero where they should be, right gradients, nothing infinite at outlines."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from torchradiometry.learn import integrability_loss, rendering_loss
from torchradiometry.learn.samples.shapes import height_to_normals, random_shapes
from torchradiometry.shade.lambertian import LambertianShading
from torchradiometry.sources.directional import DirectionalSource

DOUBLE = torch.float64


def test_a_rendering_explains_its_own_photograph(generator: torch.Generator) -> None:
    shapes = random_shapes(2, 32, generator, ("ellipsoids",))
    mask = shapes.mask.unsqueeze(1).float()
    layer = LambertianShading(DirectionalSource([0.3, 0.2, 0.9], [3.0]))
    image = layer(shapes.normal, mask * 0.5)
    assert rendering_loss(image, 4 * image, mask).item() < 1e-6
    assert rendering_loss(image, 4 * image, mask, exposed=False).item() == pytest.approx(0.75)
    assert rendering_loss(0 * image, image, mask).item() == pytest.approx(1)
    assert rendering_loss(image, image, 0 * mask).item() == 0
    turned = layer(-shapes.normal * torch.tensor([1.0, 1, -1]).reshape(1, 3, 1, 1), mask * 0.5)
    assert rendering_loss(turned, image, mask).item() > 0.1


def test_normals_are_found_from_a_photograph_alone() -> None:
    """Gradient descent on depth through the layer: the loss falls by a factor of ten."""
    y, x = torch.meshgrid(*[torch.linspace(-1, 1, 16, dtype=DOUBLE)] * 2, indexing="ij")
    true = 4 * torch.exp(-2 * (x * x + y * y)).unsqueeze(0)
    layer = LambertianShading(DirectionalSource(torch.tensor([0.4, 0.3, 0.87]).double(), [3.0]))
    one = torch.ones(1, 1, 16, 16, dtype=DOUBLE)
    image = layer.double()(height_to_normals(true), one)
    height = torch.zeros_like(true).requires_grad_()
    optimizer = torch.optim.Adam([height], lr=0.05)
    losses = []
    for _ in range(150):
        loss = rendering_loss(layer(height_to_normals(height), one), image, one, exposed=False)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < losses[0] / 10


def test_surfaces_are_integrable_and_whirls_are_not() -> None:
    y, x = torch.meshgrid(*[torch.linspace(-1, 1, 64, dtype=DOUBLE)] * 2, indexing="ij")
    bump = (10 * torch.exp(-4 * (x * x + y * y))).unsqueeze(0)
    one = torch.ones(1, 1, 64, 64, dtype=DOUBLE)
    surface = height_to_normals(bump)
    # curl of the finite differences: second order in the pixel, which is 1/32 here
    assert integrability_loss(surface, one).item() < 1e-4
    whirl = torch.stack([y, x, torch.full_like(x, 2)])[None]
    whirl = whirl / whirl.norm(dim=1, keepdim=True)
    # p = -y_up... : slopes (y_down/2, x/2) have dp/dy - dq/dx = -1/2 - 1/2 over 31.5 pixels a unit
    nz = whirl[:, 2]
    expected = (nz * nz).mean().item() / 31.5
    assert integrability_loss(whirl, one).item() == pytest.approx(expected, rel=0.01)


def test_gradients_and_outlines() -> None:
    generator = torch.Generator().manual_seed(0)
    shapes = random_shapes(1, 16, generator, ("ellipsoids",))
    normal = (shapes.normal.double() + 0.1 * torch.rand(1, 3, 16, 16).double()).requires_grad_()
    mask = shapes.mask.unsqueeze(1).double()
    assert gradcheck(lambda n: integrability_loss(n, mask), (normal,))
    flat = torch.tensor([1.0, 0, 0]).reshape(1, 3, 1, 1).expand(1, 3, 4, 4).clone().requires_grad_()
    loss = integrability_loss(flat, torch.ones(1, 1, 4, 4))
    loss.backward()
    assert loss.item() == 0
    assert torch.isfinite(flat.grad).all()
    assert math.isfinite(integrability_loss(flat, torch.zeros(1, 1, 4, 4)).item())
