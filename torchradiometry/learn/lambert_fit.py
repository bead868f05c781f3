"""Lambert's law fitted to the intensities of a pixel under known distant lights.

    I_i = l_i . b,    b = albedo times normal:    least squares, plainly or robustly

References: R. J. Woodham, "Photometric method for determining surface orientation from multiple
images" (1980); P. W. Holland and R. E. Welsch, "Robust regression using iteratively reweighted
least-squares" (1977).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch._higher_order_ops.while_loop import while_loop

from torchradiometry.arguments import broadcast_shape
from torchradiometry.errors import ShapeError, require_axes, require_whole
from torchradiometry.numerics import (
    alike,
    guarded_divide,
    narrow,
    safe_norm,
    single,
    wide,
)

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["least_squares", "robust_normals"]

#: ridge added to L^T L, as a share of the number of lights: 1e-4 of a light turns a normal by
#: less than 0.01 degrees and keeps lights that lie in one plane from dividing by zero
RIDGE = 1e-4
#: c: how far off Lambert's law a light may be before it counts half, as a share of |b|
OUTLIER = 0.05
#: cosine of incidence below which a light does not count in the robust fit, and how sharply
GRAZING, STEEP = 0.1, 30.0


def least_squares(
    intensity: Float[Tensor, "*batch pixel light"], direction: Float[Tensor, "*batch light 3"]
) -> Float[Tensor, "*batch pixel 3"]:
    """Woodham's b = (L^T L + r)^-1 L^T I, with a slight ridge r and the inverse written out.

    Raises:
        ShapeError: other axes, or another number of lights.
        DTypeError: no floating-point numbers.

    Differentiable in: both.
    Export: compile yes, ONNX yes (ONNX has no linear solve).
    """
    _check(intensity, direction)
    dtype = intensity.dtype
    intensity, direction = alike(*single(intensity, direction))
    # in units of the longest light: sixth powers of lengths are no numbers of float32
    unit = nn.functional.pad(direction.detach().abs().flatten(-2), (0, 1), value=1.0)
    unit = unit.amax(-1)[..., None, None]
    direction = direction / unit
    gram = direction.mT @ direction + RIDGE * direction.shape[-2] / unit**2 * torch.eye(3).to(unit)
    return narrow(intensity @ direction @ _inverse(gram) / unit, dtype)


def robust_normals(
    intensity: Float[Tensor, "*batch pixel light"],
    direction: Float[Tensor, "*batch light 3"],
    rounds: int = 8,
) -> Float[Tensor, "*batch pixel 3"]:
    """Lambert's law fitted to the lights that obey it: b, reweighted least squares.

    Each round solves b = argmin sum w_i (I_i - l_i . b)^2 with

        w_i = 1 / (1 + (I_i - l_i . b)^2 / (c |b|)^2)     (Cauchy),   0 where l_i . b < |b| / 10

    so that highlights, cast shadows and light that grazes the surface count less and less.

    Args:
        intensity: any positive scale.
        direction: unit, to the lights.
        rounds: after the plain fit, 0...65536.

    Returns:
        b: albedo (in the scale of the intensities) times the normal. Found in float64: where
        lights contradict each other the rounds multiply rounding a thousandfold.

    Raises:
        ShapeError, DTypeError: as of `least_squares`.

    Differentiable in: both.
    Export: compile yes, ONNX yes, as a `Loop`.
    References: Holland and Welsch (1977).
    """
    _check(intensity, direction)
    require_whole("rounds", rounds, 0, 2**16)
    values, light = wide(intensity, direction)
    products, across = _products(light), light.mT.clone()

    def refined(found: Tensor) -> Tensor:
        level = safe_norm(found).unsqueeze(-1)
        expected = found @ across
        missed = guarded_divide(values - expected, level) / OUTLIER
        lit = torch.sigmoid((guarded_divide(expected, level) - GRAZING) * STEEP)
        weight = lit / (1 + missed * missed) + RIDGE
        gram = (weight @ products).unflatten(-1, (3, 3))
        ridge = RIDGE * weight.sum(-1)[..., None, None]
        gram = gram + ridge * torch.eye(3, dtype=gram.dtype, device=gram.device)
        aim = (weight * values) @ light
        return (_inverse(gram) @ aim.unsqueeze(-1)).squeeze(-1)

    found = least_squares(values, light)
    if torch.compiler.is_exporting():  # one round in the graph instead of all of them
        count = torch.zeros((), dtype=torch.int64, device=found.device)
        state = (count, found.contiguous())
        _, found = while_loop(lambda k, _: k < rounds, lambda k, b: (k + 1, refined(b)), state)
    else:
        for _ in range(rounds):
            found = refined(found)
    return found.to(intensity.dtype)


def _check(intensity: Tensor, direction: Tensor) -> None:
    require_axes("intensity", intensity, None, None)
    require_axes("direction", direction, None, 3)
    if intensity.shape[-1] != direction.shape[-2]:
        got = f"intensities of {intensity.shape[-1]} lights, directions of {direction.shape[-2]}"
        raise ShapeError("intensity, direction", got, "pass one direction for each light")
    broadcast_shape("intensity, direction", intensity.shape[:-2], direction.shape[:-2])


def _products(direction: Tensor) -> Tensor:
    """The nine products of each direction's components, `*batch light 9`."""
    return (direction.unsqueeze(-1) * direction.unsqueeze(-2)).flatten(-2)


def _inverse(m: Tensor) -> Tensor:
    """Inverse of symmetric positive definite `*batch 3 3` by cross products of its rows."""
    adjoint = _cross(_rolled(m.mT, 1).mT, _rolled(m.mT, 2).mT)
    determinant = (m[..., :1, :] * adjoint[..., :1, :]).sum(-1, keepdim=True)
    return adjoint.mT / determinant


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return _rolled(a, 1) * _rolled(b, 2) - _rolled(a, 2) * _rolled(b, 1)


def _rolled(v: Tensor, by: int) -> Tensor:
    """Components (x, y, z) of the last axis as (y, z, x) for 1, (z, x, y) for 2."""
    return torch.cat([v[..., by:], v[..., :by]], -1)
