"""The only place with an epsilon: guarded elementary operations.

Each function has the exact value wherever that value exists, a documented finite value where
it does not, and a finite gradient everywhere. The *input* of the delicate operation is
guarded and not only its output, because `0 * inf` in the backward pass is NaN even where the
forward branch was not taken.

All functions are elementwise or reduce the last axis, broadcast, keep device and dtype, and
trace under `torch.compile(fullgraph=True)` and the ONNX exporter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = [
    "alike",
    "angle_of",
    "arccot",
    "clamped_cosine",
    "dot",
    "guarded_divide",
    "narrow",
    "power_lobe",
    "safe_acos",
    "safe_norm",
    "safe_normalize",
    "safe_sqrt",
    "single",
    "tiny",
    "wide",
]


def tiny(dtype: torch.dtype) -> float:
    """Smallest positive normal number of `dtype`: what 'zero' is compared with."""
    return torch.finfo(dtype).tiny


def wide(*tensors: Tensor) -> tuple[Tensor, ...]:
    """The tensors in float64: for formulas whose differences cancel in single precision."""
    return tuple(t.to(torch.float64) for t in tensors)


def single(*tensors: Tensor) -> tuple[Tensor, ...]:
    """The tensors in float32 at least: half precision has neither the digits nor the range that
    the middle of a formula needs."""
    half = (torch.float16, torch.bfloat16)
    return tuple(t.to(torch.float32) if t.dtype in half else t for t in tensors)


def alike(*tensors: Tensor) -> tuple[Tensor, ...]:
    """The tensors in the widest of their dtypes, as elementwise operations promote them: matrix
    products do not."""
    dtype = tensors[0].dtype
    for tensor in tensors[1:]:
        dtype = torch.promote_types(dtype, tensor.dtype)
    return tuple(t.to(dtype) for t in tensors)


def narrow(x: Float[Tensor, "..."], dtype: torch.dtype) -> Float[Tensor, "..."]:
    """x in `dtype`; where it is too large for it, the largest number, with gradient 0.

    An infinite value would make NaN with the next factor 0 (a visibility, a cosine).

    >>> narrow(torch.tensor([1e6, 2.0]), torch.float16).tolist()
    [65504.0, 2.0]
    """
    largest = torch.finfo(dtype).max
    if largest < torch.finfo(x.dtype).max:
        x = x.clamp(-largest, largest)
    return x.to(dtype)


def dot(a: Float[Tensor, "*batch n"], b: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch"]:
    """Inner product over the last axis, broadcasting the others.

    >>> dot(torch.tensor([1.0, 2.0, 2.0]), torch.tensor([2.0, 0.0, 1.0]))
    tensor(4.)
    """
    return (a * b).sum(-1)


def safe_sqrt(x: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Square root with value 0 and gradient 0 at x <= 0.

    >>> x = torch.tensor([0.0, 4.0], requires_grad=True)
    >>> safe_sqrt(x).sum().backward(); x.grad
    tensor([0.0000, 0.2500])
    """
    positive = x > 0
    return torch.where(positive, torch.sqrt(torch.where(positive, x, 1)), 0)


def safe_norm(v: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch"]:
    """Euclidean length of the last axis; no overflow or underflow, gradient 0 at v = 0.

    The vector is scaled by its largest component before squaring, so every length that the
    dtype can hold is returned.
    """
    scale = v.detach().abs().amax(-1, keepdim=True)
    usable = (scale > 0) & torch.isfinite(scale)
    scale = torch.where(usable, scale, 1)
    return safe_sqrt(((v / scale) ** 2).sum(-1)) * scale.squeeze(-1)


def safe_normalize(v: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch n"]:
    """Unit vector v/|v|; the zero vector stays zero, with gradient 0.

    Right for lengths from the smallest normal to the largest number of the dtype, because
    the components are scaled before they are squared.

    >>> safe_normalize(torch.tensor([[3e-30, 0.0, 4e-30], [0.0, 0.0, 0.0]]))
    tensor([[0.6000, 0.0000, 0.8000],
            [0.0000, 0.0000, 0.0000]])
    """
    scale = v.detach().abs().amax(-1, keepdim=True)
    usable = (scale > 0) & torch.isfinite(scale)
    scaled = v / torch.where(usable, scale, 1)
    squared = (scaled * scaled).sum(-1, keepdim=True)
    return scaled * torch.where(usable, torch.where(usable, squared, 1).rsqrt(), 0)


def clamped_cosine(
    a: Float[Tensor, "*batch 3"], b: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch"]:
    """max(0, a . b) of unit vectors: the cosine law with nothing below the horizon.

    Differentiable with respect to both; the kink at the horizon has gradient 0.
    """
    return dot(a, b).relu()


def guarded_divide(
    numerator: Float[Tensor, "..."], denominator: Float[Tensor, "..."], otherwise: float = 0.0
) -> Float[Tensor, "..."]:
    """numerator / denominator, and `otherwise` (gradient 0) where the denominator is 0.

    >>> guarded_divide(torch.tensor([1.0, 1.0]), torch.tensor([0.0, 4.0]))
    tensor([0.0000, 0.2500])
    """
    usable = denominator != 0
    return torch.where(usable, numerator / torch.where(usable, denominator, 1), otherwise)


def safe_acos(x: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Arc cosine in radians, exact at +-1 and beyond (clamped), with a finite gradient there.

    The angle is taken as atan2(sqrt((1-x)(1+x)), x), whose digits do not cancel near +-1;
    where the true gradient is infinite the gradient is 0.

    >>> safe_acos(torch.tensor([1.0, 0.0, -1.0000001]))
    tensor([0.0000, 1.5708, 3.1416])
    """
    x = x.clamp(-1, 1)
    return angle_of(safe_sqrt((1 - x) * (1 + x)), x)


def angle_of(sine: Float[Tensor, "..."], cosine: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """atan2(sine, cosine) in radians, with value and gradient 0 at (0, 0).

    onnxruntime has no arc functions in float64. While a graph is exported the angle is
    therefore found in float32 and corrected by one step of the tangent's addition theorem
    (`_angle_by_refinement`), which restores all digits of float64.
    """
    defined = (sine != 0) | (cosine != 0)
    cosine = torch.where(defined, cosine, 1)
    if torch.compiler.is_exporting() and sine.dtype == torch.float64:
        return _angle_by_refinement(sine, cosine)
    return torch.atan2(sine, cosine)


def arccot(x: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """The angle in 0..pi, radians, whose cotangent is x; decreasing and smooth everywhere.

    >>> arccot(torch.tensor([0.0, 1.0, -1.0])) / torch.pi
    tensor([0.5000, 0.2500, 0.7500])
    """
    one = torch.ones((), dtype=x.dtype, device=x.device)
    if torch.compiler.is_exporting() and x.dtype == torch.float64:
        return _angle_by_refinement(one, x)
    return torch.atan2(one, x)


def _angle_by_refinement(sine: Tensor, cosine: Tensor) -> Tensor:
    """float64 atan2 from a float32 one: theta = theta0 + t - t^3/3, t = tan(theta - theta0)."""
    scale = torch.maximum(sine.abs(), cosine.abs())
    sine, cosine = sine / scale, cosine / scale
    guess = torch.atan2(sine.float(), cosine.float()).double().detach()
    s, c = torch.sin(guess), torch.cos(guess)
    t = (sine * c - cosine * s) / (cosine * c + sine * s)
    return guess + t - t**3 / 3


def power_lobe(base: Float[Tensor, "..."], exponent: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """max(0, base) ** exponent for 0 <= base, exponent >= 0, with finite gradients.

    `0 ** n` is 0 for n > 0 and 1 for n = 0 (a lobe of exponent 0 is constant over the
    *open* hemisphere and its limit is kept at the horizon). Gradients at base <= 0 are 0.

    >>> power_lobe(torch.tensor([0.0, 0.5, 0.0]), torch.tensor([2.0, 2.0, 0.0]))
    tensor([0.0000, 0.2500, 1.0000])
    """
    positive = base > 0
    safe = torch.where(positive, base, 1)
    outside = torch.where(exponent > 0, 0.0, 1.0).to(safe.dtype)
    return torch.where(positive, torch.exp(exponent * torch.log(safe)), outside)
