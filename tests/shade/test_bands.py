"""Bands of rows give what whole images give."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from tests.cases import Sizes, images
from torchradiometry import DirectionalSource, LambertianShading, PhongShading, PointSource
from torchradiometry.shade import bands

TALL = Sizes(2, 37, 5, 2)


def lights() -> list:
    return [
        DirectionalSource([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]], [[1.0, 2.0, 3.0], [2.0, 1.0, 1.0]]),
        PointSource([[0.2, 0.1, 2.0]], [[3.0, 2.0, 1.0]]),
    ]


@pytest.mark.parametrize("pixels", [1, 10, 60, 370])
def test_every_row_is_that_of_the_whole_image(pixels: int, monkeypatch) -> None:
    names = ("normal", "albedo", "specular", "shininess", "position", "visibility")
    maps = dict(zip(names, images(*names, light=3)(torch.float32, TALL), strict=True))
    maps["albedo"] = maps["albedo"][:1]  # one for both images
    matt = {name: maps[name] for name in ("normal", "albedo", "position", "visibility")}
    layers = [(LambertianShading(lights()), matt), (PhongShading(sources=lights()), maps)]
    for layer, passed in layers:
        leaves = {name: t.clone().requires_grad_() for name, t in passed.items()}
        whole = layer(**leaves)
        with torch.no_grad(), monkeypatch.context() as patch:
            patch.setattr(bands, "PIXELS", pixels)
            found = layer(**passed)
        assert_close(found, whole.detach(), rtol=1e-6, atol=0)
        assert found.is_contiguous()
        assert torch.autograd.grad(whole.sum(), leaves["normal"])[0].abs().sum() > 0


def test_a_formula_sees_bands_of_rows_and_none_of_what_was_not_passed(monkeypatch) -> None:
    monkeypatch.setattr(bands, "PIXELS", 24)
    image, seen = torch.arange(2 * 3 * 7 * 4.0).reshape(2, 3, 7, 4), []

    def formula(first: torch.Tensor, second: torch.Tensor | None) -> torch.Tensor:
        seen.append((tuple(first.shape), second))
        return first[:, :1]

    with torch.no_grad():
        assert torch.equal(bands.in_bands(formula, image, None), image[:, :1])
    assert seen == [((2, 3, 3, 4), None), ((2, 3, 3, 4), None), ((2, 3, 1, 4), None)]
    seen.clear()
    bands.in_bands(formula, image.requires_grad_(), None)
    assert seen == [((2, 3, 7, 4), None)]
