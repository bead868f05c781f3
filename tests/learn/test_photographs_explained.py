"""Photographs are explained by the effects that made them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.benchmarks import photographs_explained
from tests.benchmarks.photographs_explained import View
from torchradiometry.geometry import depth_to_normals
from torchradiometry.learn.reflectance import recorded
from torchradiometry.materials import Microfacet, OrenNayar
from torchradiometry.shade import CastShadow
from torchradiometry.sources import DirectionalSource


def test_photographs_explained(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        photographs_explained.main(out=tmp_path / "ladder.png", source=tmp_path / "nowhere") == {}
    )
    assert "no photographs there" in capsys.readouterr().out
    with torch.no_grad():
        view, albedo = dented()
        ladder, found = photographs_explained.explain(view)
    errors = ladder.errors
    assert errors["Lambertian"] > 0.1
    assert errors["+ Blinn-Phong"] < errors["Lambertian"]
    assert errors["+ cast shadows"] < errors["+ Blinn-Phong"]
    assert errors["+ rough diffuse"] < 0.7 * errors["+ cast shadows"]
    assert errors["+ the camera's range"] < 0.8 * errors["+ rough diffuse"]
    assert errors["+ indirect light"] < 0.8 * errors["microfacets for Blinn-Phong"]
    assert errors["+ indirect light"] < 0.02
    assert errors["+ weights of each pixel"] < 0.02
    assert found["mean albedo"] == pytest.approx(float(albedo.mean()), rel=0.1)
    photographs_explained.draw_ladder({"dent": ladder}, tmp_path / "ladder.png")
    assert (tmp_path / "ladder.png").stat().st_size > 500


def dented(size: int = 24) -> tuple[View, torch.Tensor]:
    """Photographs of a dented plate that the benchmark's own model makes, and its albedos."""
    axis = torch.linspace(-1, 1, size)
    square = axis.square() + axis.square().unsqueeze(1)
    height = size * (0.3 * torch.exp(-12 * square) - 0.25 * torch.exp(-3 * square))
    depth = -height[None, None]
    normals = depth_to_normals(depth, pixel_size=1.0)[0].flatten(1).T
    turn, tilt = torch.arange(24) * 2.4, torch.linspace(0.2, 1.1, 24)
    sideways = tilt.sin().unsqueeze(1) * torch.stack((turn.cos(), turn.sin()), 1)
    lamps = torch.cat((sideways, tilt.cos().unsqueeze(1)), 1)
    mask = torch.ones(size, size, dtype=torch.bool)
    view = View(torch.ones(size * size, 24), torch.full((24,), 0.9), lamps, normals, mask)
    albedo = (0.6 + 0.2 * torch.sin(9 * axis) * torch.cos(7 * axis).unsqueeze(1)).flatten()
    light = DirectionalSource(lamps, torch.ones(24, 1))
    shadow = CastShadow(light, width=photographs_explained.PENUMBRA, pixel_size=1.0)
    visible = shadow(depth)[0].flatten(1).T
    matt = view.responses([OrenNayar([1.0], [0.5])])[0] * visible
    shine = view.responses([Microfacet([0.04], [0.17])])[0] * visible
    between = photographs_explained.bounced(view, depth, visible, albedo, float(albedo.mean()))
    seen = recorded(albedo.unsqueeze(1) * (matt + between) + shine, view.ceiling)
    return replace(view, grey=seen), albedo


@pytest.mark.data
def test_photographs_explained_on_photographs(tmp_path: Path, benchmark_data: Path) -> None:
    source = benchmark_data / "diligent"
    shown = tmp_path / "panels.png"
    errors = photographs_explained.main(True, tmp_path / "ladder.png", source, shown)
    for ladder in errors.values():
        assert ladder["+ weights of each pixel"] < 0.8 * ladder["Lambertian"]
    assert shown.stat().st_size > 500
