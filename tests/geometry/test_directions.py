"""Directions: frames are orthonormal everywhere, mirrors keep angles."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.geometry import local_frame, reflect, spherical_direction


@settings(deadline=None, max_examples=50)
@given(st.floats(0, 3.1415926), st.floats(-7, 7))
def test_frames_are_right_handed_and_orthonormal(polar: float, azimuth: float) -> None:
    n = spherical_direction(torch.tensor(polar).double(), torch.tensor(azimuth).double())
    t, b = local_frame(n)
    frame = torch.stack((t, b, n))
    assert_close(frame @ frame.T, torch.eye(3))
    assert_close(torch.linalg.cross(t, b), n)


def test_frame_at_the_poles_has_finite_gradients() -> None:
    for z in (1.0, -1.0):
        n = torch.tensor([0.0, 0.0, z], dtype=torch.float64, requires_grad=True)
        t, b = local_frame(n)
        (t.sum() + b.sum()).backward()
        assert torch.isfinite(n.grad).all()
        assert_close(torch.linalg.cross(t, b), n.detach())


@settings(deadline=None, max_examples=50)
@given(st.floats(0, 1.5), st.floats(-7, 7))
def test_mirror_keeps_the_angle_and_is_its_own_inverse(polar: float, azimuth: float) -> None:
    n = torch.tensor([0.0, 0.6, 0.8], dtype=torch.float64)
    d = spherical_direction(torch.tensor(polar).double(), torch.tensor(azimuth).double())
    mirrored = reflect(d, n)
    assert_close(mirrored @ n, d @ n, atol=1e-15)
    assert_close(mirrored.norm(), 1.0)
    assert_close(reflect(mirrored, n), d, atol=1e-15)


def test_gradients(generator: torch.Generator) -> None:
    d = torch.randn(4, 3, dtype=torch.float64, generator=generator).requires_grad_()
    n = torch.randn(4, 3, dtype=torch.float64, generator=generator)
    n = (n / n.norm(dim=-1, keepdim=True)).requires_grad_()
    assert gradcheck(reflect, (d, n))
    assert gradcheck(local_frame, (n,))
    assert gradcheck(spherical_direction, (d[:, 0], d[:, 1]))
