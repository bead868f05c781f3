"""numerics: exact where defined, finite everywhere."""

import pytest
import torch
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry import numerics


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_normalize_keeps_every_representable_length(dtype: torch.dtype) -> None:
    finfo = torch.finfo(dtype)
    lengths = torch.tensor([finfo.tiny * 4, 1e-20, 1.0, 1e20, finfo.max / 8], dtype=dtype)
    v = lengths[:, None] * torch.tensor([3.0, 0.0, 4.0], dtype=dtype)[None] / 5
    unit = torch.tensor([0.6, 0.0, 0.8], dtype=dtype)
    assert_close(numerics.safe_normalize(v), unit.expand(5, 3))
    assert_close(numerics.safe_norm(v), lengths)


def test_zero_vector_has_zero_value_and_gradient() -> None:
    for function in (numerics.safe_normalize, numerics.safe_norm):
        v = torch.zeros(2, 3, dtype=torch.float64, requires_grad=True)
        out = function(v)
        out.sum().backward()
        assert (out == 0).all()
        assert (v.grad == 0).all()


@pytest.mark.parametrize(
    "function",
    [
        numerics.safe_normalize,
        numerics.safe_norm,
        lambda v: numerics.safe_acos(v / 10),
        lambda v: numerics.angle_of(v[..., :1], v[..., 1:]),
        lambda v: numerics.power_lobe(v.abs(), v.abs() + 0.5),
        lambda v: numerics.guarded_divide(v[..., :1], v[..., 1:]),
        lambda v: numerics.safe_sqrt(v.abs()),
    ],
)
def test_gradients_agree_with_finite_differences(function, generator: torch.Generator) -> None:
    v = torch.randn(5, 3, dtype=torch.float64, generator=generator).requires_grad_()
    assert gradcheck(function, (v,))


@pytest.mark.parametrize("x", [-1.5, -1.0, 0.0, 1.0, 1.5])
def test_acos_is_exact_and_finite_at_its_ends(x: float) -> None:
    t = torch.tensor(x, dtype=torch.float64, requires_grad=True)
    angle = numerics.safe_acos(t)
    angle.backward()
    assert_close(angle, torch.acos(t.detach().clamp(-1, 1)))
    assert torch.isfinite(t.grad)


def test_refined_angle_has_all_digits_of_float64(generator: torch.Generator) -> None:
    sine, cosine = torch.randn(2, 1000, dtype=torch.float64, generator=generator)
    refined = numerics._angle_by_refinement(sine, cosine)
    assert_close(refined, torch.atan2(sine, cosine), rtol=4e-16, atol=4e-16)


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0, 1e6])
def test_power_lobe_at_zero_base(exponent: float) -> None:
    base = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    n = torch.full((3,), exponent, dtype=torch.float64, requires_grad=True)
    out = numerics.power_lobe(base, n)
    out.sum().backward()
    assert (out == (1.0 if exponent == 0 else 0.0)).all()
    assert torch.isfinite(base.grad).all()
    assert torch.isfinite(n.grad).all()
