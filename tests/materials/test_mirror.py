"""Mirror direction: angles, its own inverse, gradients."""

import torch
from torch.autograd import gradcheck

from tests.cases import directions
from tests.tolerances import assert_close
from torchradiometry.materials import mirror_direction

DOUBLE = torch.float64


def test_mirror_direction() -> None:
    wi, normal = directions(50, dtype=DOUBLE), directions(50, dtype=DOUBLE, seed=1)
    wr = mirror_direction(wi, normal)
    assert_close((wr * normal).sum(-1), (wi * normal).sum(-1))
    assert_close(wr.norm(dim=-1), 1.0)
    # in the plane of incidence: wi + wr is along the normal
    assert_close(torch.linalg.cross(wi + wr, normal), torch.zeros(3), atol=1e-15)
    assert_close(mirror_direction(wr, normal), wi)
    assert_close(mirror_direction(normal, normal), normal)


def test_gradients() -> None:
    inputs = (directions(3, dtype=DOUBLE), directions(3, dtype=DOUBLE, seed=1))
    assert gradcheck(mirror_direction, tuple(t.requires_grad_() for t in inputs))
