"""Networks: order-free, turned with the scene, any size, the same in onnxruntime."""

from pathlib import Path

import pytest
import torch

from torchradiometry.deploy.runtime import open_model, run_model
from torchradiometry.export.onnx_file import export_onnx
from torchradiometry.learn.lambert_fit import least_squares, robust_normals
from torchradiometry.learn.losses import angle_degrees, chord_loss
from torchradiometry.learn.networks import (
    PhotometricNetwork,
    ShadingNetwork,
    observation_map,
)


def lively(network: torch.nn.Module) -> torch.nn.Module:
    """Weights that use every path (the answer of a fresh network starts at 0)."""
    torch.manual_seed(0)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn(parameter.shape))
    return network.eval()


def observed(pixels: int, lights: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    direction = torch.randn(lights, 3, generator=generator) * 0.4
    direction[:, 2] = 1
    direction = direction / direction.norm(dim=-1, keepdim=True)
    return torch.rand(pixels, lights, generator=generator), direction


@pytest.fixture(scope="module")
def photometric() -> torch.nn.Module:
    return lively(PhotometricNetwork(cells=8, features=32, depth=1))


def test_the_order_of_lights_does_not_matter(photometric: torch.nn.Module) -> None:
    intensity, direction = observed(20, 15)
    order = torch.randperm(15, generator=torch.Generator().manual_seed(1))
    first = photometric(intensity, direction)
    again = photometric(intensity[:, order], direction[order])
    torch.testing.assert_close(first, again, rtol=1e-4, atol=1e-5)


def test_scale_does_not_matter(photometric: torch.nn.Module) -> None:
    intensity, direction = observed(20, 15)
    first = photometric(intensity, direction)
    torch.testing.assert_close(photometric(1000 * intensity, direction), first)


def test_normals_turn_with_the_scene(photometric: torch.nn.Module) -> None:
    intensity, direction = observed(20, 15)
    angle = torch.tensor(0.8)
    c, s = angle.cos(), angle.sin()
    turn = torch.tensor([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    torch.testing.assert_close(
        photometric(intensity, direction @ turn),
        photometric(intensity, direction) @ turn,
        rtol=1e-3,
        atol=1e-4,
    )


@pytest.mark.parametrize("lights", [3, 4, 200])
def test_any_number_of_lights_gives_unit_normals(photometric: torch.nn.Module, lights: int) -> None:
    found = photometric(*observed(10, lights))
    torch.testing.assert_close(found.norm(dim=-1), torch.ones(10))


def test_dark_pixels_and_parallel_lights_stay_finite(photometric: torch.nn.Module) -> None:
    _, direction = observed(1, 6)
    assert torch.isfinite(photometric(torch.zeros(3, 6), direction)).all()
    straight = torch.tensor([[0.0, 0.0, 1.0]]).expand(6, 3)
    assert torch.isfinite(photometric(torch.rand(3, 6), straight)).all()


def test_least_squares_is_woodham() -> None:
    intensity, direction = observed(30, 12)
    truth = torch.linalg.lstsq(direction.double(), intensity.T.double()).solution.T
    assert angle_degrees(least_squares(intensity, direction).double(), truth).max() < 0.3


def test_the_robust_fit_ignores_highlights_and_shadows() -> None:
    """A quarter of the lights hidden, one doubled: Lambert's law is found to a degree."""
    _, direction = observed(1, 40)
    normal = torch.nn.functional.normalize(
        torch.randn(30, 3, generator=torch.Generator().manual_seed(4)) * 0.4 + direction[0], dim=-1
    )
    clean = (normal @ direction.T).clamp(min=0)
    spoilt = clean.clone()
    spoilt[:, ::4] = 0
    brightest = clean.argmax(-1, keepdim=True)
    spoilt.scatter_(1, brightest, 2 * clean.gather(1, brightest))
    plain = angle_degrees(least_squares(spoilt, direction), normal)
    robust = angle_degrees(robust_normals(spoilt, direction), normal)
    assert plain.mean() > 5
    assert robust.median() < 0.5
    assert robust.mean() < plain.mean() / 3
    exact = angle_degrees(robust_normals(clean, direction), normal)
    assert exact.max() < 0.5  # but for grazing lights and the ridge


def test_a_network_of_zero_weights_is_the_robust_fit() -> None:
    intensity, direction = observed(20, 15)
    network = PhotometricNetwork(cells=8, features=16, depth=1)
    found = network(intensity, direction)
    expected = torch.nn.functional.normalize(robust_normals(intensity, direction), dim=-1)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_observation_map_is_a_weighted_mean() -> None:
    values, place = torch.full((5, 7, 1), 3.0), torch.rand(5, 7, 2) - 0.5
    drawn = observation_map(values, place, cells=9, width=0.2)
    assert drawn.shape == (5, 2, 9, 9)
    torch.testing.assert_close(drawn[:, 0], 3 * drawn[:, 1])
    assert ((drawn[:, 1] >= 0) & (drawn[:, 1] < 1)).all()
    nothing = torch.empty(5, 0, 1), torch.empty(5, 0, 2)
    assert (observation_map(*nothing, cells=9, width=0.2) == 0).all()


@pytest.mark.parametrize("size", [(16, 16), (33, 18), (7, 50)])
def test_shading_network_takes_any_size(size: tuple[int, int]) -> None:
    network = lively(ShadingNetwork(features=8))
    mask = torch.zeros(2, 1, *size)
    mask[..., 2:-2, 3:-1] = 1
    with torch.no_grad():
        found, paint = network(torch.rand(2, 3, *size), mask)
        white = torch.ones(2, 3, *size)
        for bright, plain in zip(network(10 * white, mask), network(white, mask), strict=True):
            torch.testing.assert_close(bright, plain)
    torch.testing.assert_close(found.norm(dim=1, keepdim=True), mask)
    assert (paint[(mask == 0).expand_as(paint)] == 0).all()
    torch.testing.assert_close(paint.sum((1, 2, 3)) / (3 * mask.sum((1, 2, 3))), torch.ones(2))
    for answer in network(torch.zeros(2, 3, *size), 0 * mask):
        assert torch.isfinite(answer).all()


def test_photometric_network_in_onnxruntime(tmp_path: Path, photometric: torch.nn.Module) -> None:
    path = export_onnx(
        photometric,
        dict(zip(("intensity", "direction"), observed(6, 5), strict=True)),
        tmp_path / "photometric.onnx",
        axes={"intensity": ("pixel", "light"), "direction": ("light", "3")},
        units={"intensity": "1", "direction": "1"},
        outputs={"normal": "1"},
    )
    model = open_model(path)
    for pixels, lights in ((1, 3), (50, 96)):
        intensity, direction = observed(pixels, lights, seed=2)
        (found,) = run_model(
            model, {"intensity": intensity.numpy(), "direction": direction.numpy()}
        )
        with torch.no_grad():
            expected = photometric(intensity, direction)
        assert angle_degrees(torch.from_numpy(found), expected).max() < 0.05


def test_shading_network_in_onnxruntime(tmp_path: Path) -> None:
    network = lively(ShadingNetwork(features=8))
    image, mask = torch.rand(2, 3, 24, 32), torch.ones(2, 1, 24, 32)
    path = export_onnx(
        network,
        {"image": image, "mask": mask},
        tmp_path / "shading.onnx",
        axes={
            "image": ("batch", "3", "height", "width"),
            "mask": ("batch", "1", "height", "width"),
        },
        units={"image": "1", "mask": "1"},
        outputs={"normal": "1", "albedo": "1"},
    )
    model = open_model(path)
    image, mask = torch.rand(1, 3, 37, 21), torch.ones(1, 1, 37, 21)
    found, paint = run_model(model, {"image": image.numpy(), "mask": mask.numpy()})
    with torch.no_grad():
        normal, albedo = network(image, mask)
    found = torch.from_numpy(found).movedim(1, -1)
    assert angle_degrees(found, normal.movedim(1, -1)).max() < 0.05
    torch.testing.assert_close(torch.from_numpy(paint), albedo, rtol=1e-3, atol=1e-3)


def test_losses() -> None:
    up, right = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([1.0, 0.0, 0.0])
    pair, truth = torch.stack([up, right]), torch.stack([up, up])
    assert chord_loss(pair, truth).item() == pytest.approx(2**0.5 / 2)
    assert chord_loss(pair, truth, torch.tensor([1.0, 0.0])).item() == 0
    assert chord_loss(pair, truth, torch.zeros(2)).item() == 0
    torch.testing.assert_close(angle_degrees(pair, truth), torch.tensor([0.0, 90.0]))
    same = up.clone().requires_grad_()
    (chord_loss(same, up) + angle_degrees(same, up)).backward()
    assert torch.isfinite(same.grad).all()
