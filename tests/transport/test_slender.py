"""Slender polygons: the same exchange as the contour integral where that is exact; gradients."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from torchradiometry.transport import slender
from torchradiometry.transport.contour import contour_exchange
from torchradiometry.transport.exchange import RTOL
from torchradiometry.transport.slender import cancels, slender_exchange

#: components first, one pair; planar, one in front of the other
STRIP = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 40, 0], [0, 40, 0]], dtype=torch.float64) / 40
OTHER = STRIP.flip(0) + torch.tensor([0.2, -0.1, 0.1], dtype=torch.float64)


def pair(corners: int, others: int) -> tuple[Tensor, Tensor]:
    return STRIP[:corners].mT.unsqueeze(-1).contiguous(), OTHER[:others].mT.unsqueeze(
        -1
    ).contiguous()


@pytest.mark.parametrize("corners", [3, 4])
@pytest.mark.parametrize("others", [3, 4])
def test_both_integrals_agree(corners: int, others: int) -> None:
    first, second = pair(corners, others)
    exact = contour_exchange(first, second, torch.tensor([1e-15], dtype=torch.float64))
    torch.testing.assert_close(slender_exchange(first, second, RTOL), exact, rtol=1e-12, atol=0)
    torch.testing.assert_close(slender_exchange(second, first, RTOL), exact, rtol=1e-12, atol=0)


@pytest.mark.parametrize("corners", [3, 4])
@pytest.mark.parametrize("others", [3, 4])
def test_both_gradients_agree(corners: int, others: int) -> None:
    """Also where corners leave their plane, whichever of the two is cut into triangles."""
    pair_of = [t.requires_grad_() for t in pair(corners, others)]
    accuracy = torch.tensor([1e-15], dtype=torch.float64)
    exact = torch.autograd.grad(contour_exchange(*pair_of, accuracy).sum(), pair_of)
    for one, other in (pair_of, pair_of[::-1]):
        found = torch.autograd.grad(slender_exchange(one, other, RTOL).sum(), pair_of)
        for ours, theirs in zip(found, exact, strict=True):
            torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-12 * float(theirs.abs().max()))


def test_repeated_corners_and_points_add_nothing() -> None:
    first, second = pair(4, 4)
    longer = torch.cat((first, first[:, -1:], first[:, -1:]), 1)
    exact = slender_exchange(first, second, RTOL)
    found = slender_exchange(longer, second, RTOL)
    torch.testing.assert_close(found, exact, rtol=1e-13, atol=0)
    point = first[:, :1].expand(-1, 4, -1).clone().requires_grad_()
    none = slender_exchange(point, second, RTOL)
    assert none.item() == 0
    assert torch.isfinite(torch.autograd.grad(none.sum(), point)[0]).all()


@pytest.mark.parametrize("corners", [3, 4])
def test_gradients(corners: int) -> None:
    first, second = (t.requires_grad_() for t in pair(corners, 4))
    assert gradcheck(slender_exchange, (first, second, RTOL), atol=1e-8, rtol=1e-5, fast_mode=True)


def test_only_where_digits_are_lost_and_the_rule_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Long enough, a width away, and little exchange for the perimeters."""
    first, second = pair(4, 4)
    little, much = (torch.tensor([k], dtype=torch.float64) for k in (1e-9, 1.0))
    assert not cancels(first, second, little, RTOL)  # 40 widths long
    monkeypatch.setattr(slender, "LONG", 30.0)
    assert cancels(first, second, little, RTOL)
    assert not cancels(first, second, much, RTOL)
    near = second - torch.tensor([0.2, -0.1, 0.09], dtype=torch.float64).reshape(3, 1, 1)
    assert not cancels(first, near, little, RTOL)
