"""Exact irradiance of a uniform sphere, also where the horizon cuts it.

With s = sin(sigma) = radius / distance, c = n . a the cosine of the direction a to the
centre, and omega its angle:

    above the horizon (c >= s):   Phi = pi s^2 a
    below it (c <= -s):           Phi = 0
    cut by it:                    Phi = E n + F f,   f = (a - c n) / sin(omega)
        E = k s^2 (sin(psi) - psi cos(psi)) - (k sin(psi) - atan(k sin(psi)))
        F = s^2 sin(omega) (psi - sin(psi) cos(psi))
        cos(psi) = -cot(sigma) cot(omega),   k = tan(sigma) sin(omega)

Phi is half the contour integral of w x dw along the visible arc of the sphere's outline
(psi each way from its highest point) and the horizon below it. E is the known closed form,
here ordered so that a sphere that only peeks over the horizon, or a far one, keeps its
digits. Inside the sphere radiance comes from everywhere: Phi = pi n.

References: J. M. Snyder, "Area Light Sources for Real-Time Graphics", Microsoft Research
MSR-TR-96-11 (1996), 3.3; S. Lagarde and C. de Rousiers, "Moving Frostbite to Physically Based
Rendering", SIGGRAPH 2014 course, listing 10.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import require_axes
from torchradiometry.geometry.careful import looked_at_twice
from torchradiometry.numerics import (
    angle_of,
    dot,
    guarded_divide,
    safe_norm,
    safe_normalize,
    safe_sqrt,
    wide,
)
from torchradiometry.sources.careful_sphere import careful_sphere

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["sphere_irradiance", "sphere_vector_irradiance"]

#: Series are used below this argument; 14 terms of the arctangent's leave less than
#: 0.25^28 / 29 < 1e-18.
_SMALL = 0.25
#: Above this k = tan(sigma) sin(omega) the terms of E no longer cancel.
_STEEP = 2.0


def sphere_vector_irradiance(
    offset: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    radius: Float[Tensor, "*batch"],
) -> Float[Tensor, "*batch 3"]:
    """Vector irradiance of a sphere of unit radiance, cut at the receiver's horizon.

    Args:
        offset: from the receiver to the sphere's centre, m.
        normal: of the receiver, unit.
        radius: m, >= 0.

    Returns:
        Phi in sr; n . Phi is W/m2 for 1 W/m2/sr. Inside the sphere pi n.

    Differentiable in: offset, normal, radius (smooth at the horizon; jump on the surface).
    Export: compile yes, ONNX yes.
    References: Snyder (1996), 3.3.

    >>> up = torch.tensor([0.0, 0.0, 1.0])
    >>> sphere_vector_irradiance(2 * up, up, torch.tensor(1.0)) / torch.pi
    tensor([0.0000, 0.0000, 0.2500])
    """
    require_axes("offset", offset, 3)
    require_axes("normal", normal, 3)
    require_axes("radius", radius)
    dtype = torch.promote_types(offset.dtype, radius.dtype)
    seen = _seen(*wide(offset, normal, radius))
    upright, forward = _cut_components(seen)
    level = seen.towards - seen.cosine.unsqueeze(-1) * seen.up
    along = guarded_divide(forward, torch.where(seen.cut, seen.lateral, 1)).unsqueeze(-1) * level
    pi = _pi(seen.s)
    whole = (pi * torch.where(seen.cosine > 0, seen.s * seen.s, 0)).unsqueeze(-1) * seen.towards
    phi = torch.where(seen.cut.unsqueeze(-1), upright.unsqueeze(-1) * seen.up + along, whole)
    return torch.where(seen.inside.unsqueeze(-1), pi * seen.up, phi).to(dtype)


def sphere_irradiance(
    offset: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    radius: Float[Tensor, "*batch"],
) -> Float[Tensor, "*batch"]:
    """Irradiance of a sphere of unit radiance: n . Phi, which would cancel at grazing incidence.

    Args:
        offset, normal, radius: as of `sphere_vector_irradiance`.

    Returns:
        W/m2 for 1 W/m2/sr, 0...pi. Relative error, measured on spheres of 1e-6 rad to ones that are
        touched, cut by the horizon or at grazing incidence: at most 2e-14 in float64, the rounding
        of the result in float32; in a graph 1e-8, and 6e-8 from float32.

    Differentiable in: offset, normal, radius (smooth at the horizon; jump on the surface).
    Export: compile yes, ONNX yes; a graph has no second look.
    References: Snyder (1996), 3.3.

    >>> up = torch.tensor([0.0, 0.0, 1.0])
    >>> sphere_irradiance(2 * up, up, torch.tensor(1.0)) / torch.pi
    tensor(0.2500)
    """
    dtype = torch.promote_types(offset.dtype, radius.dtype)
    offset, normal, radius = wide(offset, normal, radius)
    seen = _seen(offset, normal, radius)
    pi, length = _pi(seen.s), safe_norm(normal)
    whole = pi * seen.s * seen.s * seen.cosine.clamp(min=0)
    found = torch.where(seen.cut, _cut_components(seen)[0], whole)
    found = torch.where(seen.inside, pi, found) * length
    rows = (offset, 1), (normal, 1), (radius, 0)
    return looked_at_twice(found, _loss(seen), torch.finfo(dtype).eps, careful_sphere, *rows).to(
        dtype
    )


class _Seen(NamedTuple):
    """A sphere as it looks from a point; the symbols are those of the file's heading."""

    towards: Float[Tensor, "*batch 3"]
    up: Float[Tensor, "*batch 3"]
    s: Float[Tensor, "*batch"]
    cosine: Float[Tensor, "*batch"]
    lateral: Float[Tensor, "*batch"]
    inside: Bool[Tensor, "*batch"]
    cut: Bool[Tensor, "*batch"]


def _seen(offset: Tensor, normal: Tensor, radius: Tensor) -> _Seen:
    distance, towards = safe_norm(offset), safe_normalize(offset)
    inside = (distance < radius) | (distance == 0)
    # a normal that was rounded to float32 is 6e-8 too long, which the horizon would feel
    up = safe_normalize(normal)
    cosine = dot(up, towards)
    lateral = safe_norm(towards - cosine.unsqueeze(-1) * up)
    s = guarded_divide(radius, torch.where(inside, 0, distance))
    return _Seen(towards, up, s, cosine, lateral, inside, (cosine.abs() < s) & (lateral > 0))


def _loss(seen: _Seen) -> Float[Tensor, "*batch"]:
    """How many roundings of itself the irradiance may be off by."""
    with torch.no_grad():
        s, height = seen.s, seen.cosine.abs()
        depth = guarded_divide(torch.ones_like(s), (s - height).abs())
        peeking = torch.where(seen.cosine < 0, 4 * s * depth * depth, 2 * depth)
        near = guarded_divide(torch.ones_like(s), 1 - s)
        grazing = guarded_divide(torch.ones_like(s), seen.cosine.clamp(min=0))
        loss = torch.where(height < 2 * s, torch.maximum(peeking, near), grazing)
        no_normal = (seen.up == 0).all(-1)
        hidden = seen.inside | (seen.cosine <= -s) | no_normal
        return torch.where(hidden, 0, loss)


def _pi(like: Tensor) -> Tensor:
    """Pi in the dtype; the ONNX exporter rounds a Python number to float32."""
    return torch.tensor(math.pi, dtype=like.dtype, device=like.device)


def _cut_components(seen: _Seen) -> tuple[Tensor, Tensor]:
    """Components E along the normal and F along the horizon of a sphere cut by it."""
    s = torch.where(seen.cut, seen.s, 0.5)
    cosine, lateral = torch.where(seen.cut, seen.cosine, 0), torch.where(seen.cut, seen.lateral, 1)
    slant = safe_sqrt((1 - s) * (1 + s))
    outline = s * lateral
    sine = safe_sqrt((s - cosine) * (s + cosine)) / outline
    cosine_psi = -slant * cosine / outline
    psi = angle_of(sine, cosine_psi)
    steep = outline > _STEEP * slant
    k = outline / torch.where(steep, 1, slant)
    gentle = k * s * s * _sine_minus(psi, sine, cosine_psi) - _minus_arctangent(k * sine)
    plain = s * s * psi * cosine - slant * sine * outline + angle_of(outline * sine, slant)
    forward = s * s * lateral * _minus_sine(psi, sine, cosine_psi)
    return torch.where(steep, plain, gentle), forward


#: x - atan(x), sin(x) - x cos(x) and x - sin(x) as x (a_1 t - a_2 t^2 + ...), t = x^2.
_ARCTANGENT = tuple(1 / (2 * k + 1) for k in range(1, 15))
_SINE_MINUS = tuple(2 * k / math.factorial(2 * k + 1) for k in range(1, 8))
_MINUS_SINE = tuple(1 / math.factorial(2 * k + 1) for k in range(1, 8))


def _alternating(coefficients: tuple[float, ...], x: Tensor) -> Tensor:
    """x (a_1 x^2 - a_2 x^4 + ...); a tensor, for ONNX rounds Python numbers to float32."""
    series = torch.zeros_like(x)
    held = torch.tensor(coefficients, dtype=x.dtype, device=x.device)
    for coefficient in reversed(held.unbind()):
        series = x * x * (coefficient - series)
    return x * series


def _minus_arctangent(x: Tensor) -> Tensor:
    """x - atan(x) for x >= 0, exact for small x."""
    small = x < _SMALL
    series = _alternating(_ARCTANGENT, torch.where(small, x, 0))
    return torch.where(small, series, x - angle_of(x, torch.ones_like(x)))


def _sine_minus(psi: Tensor, sine: Tensor, cosine: Tensor) -> Tensor:
    """sin(psi) - psi cos(psi) for psi >= 0, exact for small psi."""
    small = psi < _SMALL
    series = _alternating(_SINE_MINUS, torch.where(small, psi, 0))
    return torch.where(small, series, sine - psi * cosine)


def _minus_sine(psi: Tensor, sine: Tensor, cosine: Tensor) -> Tensor:
    """psi - sin(psi) cos(psi) for psi >= 0, exact for small psi: half of 2 psi - sin(2 psi)."""
    small = psi < _SMALL
    series = _alternating(_MINUS_SINE, 2 * torch.where(small, psi, 0)) / 2
    return torch.where(small, series, psi - sine * cosine)
