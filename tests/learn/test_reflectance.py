"""Weights and albedos that made photographs are found from them again."""

from __future__ import annotations

import pytest
import torch

from torchradiometry.learn.reflectance import (
    Responses,
    chosen_share,
    fit_object,
    fit_pixels,
    material_responses,
    non_negative,
    predict_pixels,
    recorded,
)
from torchradiometry.materials import Lambertian, Microfacet, OrenNayar

CEILING = torch.full((24,), 0.6)


@pytest.fixture(scope="module")
def known() -> tuple[Responses, torch.Tensor, torch.Tensor]:
    """Responses of a dome under 24 lamps, albedos, and photographs of a satin mixture."""
    turn, tilt = torch.arange(24) * 2.4, torch.linspace(0.1, 1.0, 24)
    lamps = torch.stack((tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos()), 1)
    turn, tilt = torch.arange(60) * 2.4, torch.linspace(0.0, 0.9, 60)
    normal = torch.stack((tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos()), 1)
    rough = material_responses([OrenNayar([1.0], [r]) for r in (0.0, 1.0)], normal, lamps)
    shiny = material_responses([Microfacet([0.04], [a]) for a in (0.1, 0.3)], normal, lamps)
    albedo = 0.3 + 0.1 * torch.sin(torch.arange(60.0))
    seen = albedo.unsqueeze(1) * (0.25 * rough[0] + 0.75 * rough[1]) + 0.8 * shiny[1]
    return Responses(rough, shiny), albedo, seen


def test_a_matt_response_is_the_cosine() -> None:
    lamp = torch.tensor([[0.6, 0.0, 0.8], [0.0, 0.0, -1.0]])
    found = material_responses([Lambertian([1.0])], torch.tensor([[0.0, 0.0, 1.0]]), lamp)
    torch.testing.assert_close(found, torch.tensor([[[0.8, 0.0]]]))


@pytest.mark.parametrize("ceiling", [None, CEILING], ids=["all seen", "clipped"])
def test_weights_and_albedos_are_found(
    known: tuple[Responses, torch.Tensor, torch.Tensor], ceiling: torch.Tensor | None
) -> None:
    responses, albedo, seen = known
    fit = fit_object(responses, recorded(seen, ceiling), ceiling, rounds=60)
    torch.testing.assert_close(fit.predict(responses), seen, rtol=0.02, atol=2e-3)
    torch.testing.assert_close(fit.albedo, albedo, rtol=0.02, atol=0)
    torch.testing.assert_close(fit.diffuse, torch.tensor([0.25, 0.75]), rtol=0, atol=0.05)


def test_pixels_with_weights_of_their_own_choose_a_share(
    known: tuple[Responses, torch.Tensor, torch.Tensor],
) -> None:
    responses, _, seen = known
    ceiling = torch.full((24,), 4.0)
    gain = 1 + 0.5 * torch.sin(torch.arange(60.0) * 1.7)
    mixed = seen + 0.8 * (gain - 1).unsqueeze(1) * responses.specular[1]
    fit = fit_object(responses, mixed)
    share = chosen_share(responses, mixed, ceiling)
    assert share > 0
    same = fit_pixels(responses, mixed, ceiling, fit, 0.0)
    assert torch.equal(same, fit.weights())
    own = fit_pixels(responses, mixed, ceiling, fit, share)
    wrong = [(predict_pixels(responses, w, ceiling) - mixed).norm() for w in (same, own)]
    assert wrong[1] < 0.3 * wrong[0]


def test_what_no_lamp_shows_is_black() -> None:
    dark = Responses(torch.zeros(1, 2, 3), torch.zeros(1, 2, 3))
    fit = fit_object(dark, torch.zeros(2, 3))
    assert torch.equal(fit.predict(dark), torch.zeros(2, 3))
    assert torch.equal(fit.albedo, torch.zeros(2))
    weights = fit_pixels(dark, torch.zeros(2, 3), torch.ones(3), fit, 0.3)
    assert weights.isfinite().all()


def test_least_squares_without_negative_weights() -> None:
    table = torch.tensor([[2.0, 1.0], [1.0, 3.0], [0.0, 1.0]])
    for wanted, answer in (((1.0, 2.0), (1.0, 2.0)), ((2.0, -1.0), (1.0, 0.0))):
        right = table.T @ (table @ torch.tensor(wanted))
        weights = non_negative(table.T @ table, right, torch.zeros(2), 100)
        torch.testing.assert_close(weights, torch.tensor(answer))
