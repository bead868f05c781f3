"""Spherical source: a sphere of uniform radiance, exact also where the horizon cuts it.

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
Rendering", SIGGRAPH 2014 course, listing 10; A. Gonzalez, "Measurement of Areas on a Sphere
Using Fibonacci and Latitude-Longitude Lattices", Math. Geosci. 42 (2010), for the samples.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, final

import torch
from torch import Tensor

from torchradiometry.errors import OutOfRangeError, require_floating
from torchradiometry.geometry.careful import looked_at_twice
from torchradiometry.numerics import (
    angle_of,
    dot,
    guarded_divide,
    narrow,
    safe_norm,
    safe_normalize,
    safe_sqrt,
    single,
    wide,
)
from torchradiometry.sources.base import AbstractSource, Arrival, light_first
from torchradiometry.sources.careful_sphere import careful_sphere
from torchradiometry.sources.extended import (
    direction_and_length,
    sample_rows,
    summed,
)

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = [
    "SphereSource",
    "fibonacci_directions",
    "sphere_arrival",
    "sphere_irradiance",
    "sphere_samples",
    "sphere_vector_irradiance",
]

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
        hidden = seen.inside | (seen.cosine <= -s)
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


def sphere_arrival(
    center: Float[Tensor, "*batch light 3"],
    radius: Float[Tensor, "*batch light 1"],
    radiance: Float[Tensor, "*batch light channel"],
    position: Float[Tensor, "*batch point 3"],
    normal: Float[Tensor, "*batch point 3"],
) -> Arrival:
    """Light of spheres at points: irradiance * (n . direction) is exact.

    Args:
        center: m.
        radius: m, >= 0.
        radiance: W/m2/sr, >= 0.
        position: m.
        normal: unit.

    Returns:
        The arrival. `distance` is where the direction meets the sphere.

    Differentiable in: all.
    Export: compile yes, ONNX yes.
    References: Snyder (1996), 3.3.
    """
    require_floating("normal", normal)
    dtype = position.dtype
    offset = light_first(center, position).double() - position.double()
    size = light_first(radius, position).squeeze(-1).double()
    wide_normal = normal.double()
    phi = sphere_vector_irradiance(offset, wide_normal, size)
    towards = safe_normalize(offset)
    direction, length = direction_and_length(phi, wide_normal, towards, dtype)
    dark = (phi == 0).all(-1, keepdim=True)
    # not the rounded direction: from afar, float32's misses the sphere
    along = torch.where(dark, towards, safe_normalize(phi))
    distance = narrow(_surface_distance(offset, along, size), dtype)
    return Arrival(direction, length.unsqueeze(-1) * light_first(radiance, position), distance)


def _surface_distance(offset: Tensor, direction: Tensor, radius: Tensor) -> Tensor:
    """Where the ray meets the sphere: first hit from outside, the only one from inside."""
    distance = safe_norm(offset)
    along = dot(offset, direction)
    power = (distance - radius) * (distance + radius)
    across = safe_norm(torch.linalg.cross(offset, direction.expand_as(offset), dim=-1))
    far = along + safe_sqrt((radius - across) * (radius + across))
    return torch.where(power < 0, far, guarded_divide(power, far))


def sphere_samples(
    center: Float[Tensor, "*batch light 3"],
    radius: Float[Tensor, "*batch light 1"],
    radiance: Float[Tensor, "*batch light channel"],
    position: Float[Tensor, "*batch point 3"],
    normal: Float[Tensor, "*batch point 3"],
    outward: Float[Tensor, "sample 3"],
) -> Arrival:
    """Spheres as small emitters of equal area, one for each direction from the centre.

    E = L cos(source) (4 pi radius^2 / samples) / r^2; those that face away give 0.

    Args:
        center: m.
        radius: m, >= 0.
        radiance: W/m2/sr.
        position: m.
        normal: only its shape is used.
        outward: unit, evenly spread (`fibonacci_directions`).

    Returns:
        The arrival with `light * samples` rows, the samples of one light together.

    Differentiable in: center, radius, radiance, position.
    Export: compile yes, ONNX yes.
    """
    require_floating("position", position)
    size, inner = single(light_first(radius, position), position)
    offset = light_first(center, position).double() - position.double()
    # float64: near the sphere, the terms of a path cancel
    path = offset.unsqueeze(-2) + size.double().unsqueeze(-1) * outward.double()
    offset, path, outward = (t.to(inner.dtype) for t in (offset, path, outward))
    distance = safe_norm(path)
    direction = safe_normalize(path)
    facing = -dot(outward, direction)
    inside = dot(offset, offset).unsqueeze(-1) < size * size
    facing = torch.where(inside, facing.abs(), facing.clamp(min=0))
    share = guarded_divide(size, distance)
    strength = 4 * _pi(facing) / outward.shape[-2] * facing * share * share
    rows = sample_rows(direction, strength, distance, light_first(radiance, position))
    return Arrival(*(narrow(t, position.dtype) for t in rows))


def fibonacci_directions(samples: int, dtype: torch.dtype) -> Float[Tensor, "sample 3"]:
    """Directions that stand for equal areas of the unit sphere.

    z_k = 1 - (2 k + 1) / samples, each a golden angle, pi (3 - sqrt 5), further round.

    Args:
        samples: how many, >= 1.
        dtype: of the answer.

    Returns:
        Unit vectors.

    References: Gonzalez (2010), eq. 1.

    >>> fibonacci_directions(2, torch.float32)[:, 2]
    tensor([ 0.5000, -0.5000])
    """
    step = torch.arange(samples, dtype=torch.float64)
    height = 1 - (2 * step + 1) / samples
    turn = math.pi * (3 - math.sqrt(5)) * step
    ring = safe_sqrt((1 - height) * (1 + height))
    return torch.stack((ring * torch.cos(turn), ring * torch.sin(turn), height), -1).to(dtype)


@final
class SphereSource(AbstractSource):
    """Spheres of uniform radiance.

    Args:
        center: `light 3` or `batch light 3`, m.
        radius: `light 1` or `batch light 1`, m, >= 0.
        radiance: `light channel` or `batch light channel`, W/m2/sr, >= 0.
        samples: 1 = one row a light, exact for Lambertian surfaces; more = that many small
            emitters a light, each a row of its own, which converge for every BRDF.
        learnable: keep the three as `nn.Parameter`s.

    Raises:
        OutOfRangeError: a negative radius or radiance, or fewer than one sample.
        InvalidValueError: NaN or infinite values.

    >>> lamp = SphereSource([0.0, 0.0, 2.0], [1.0], [4.0])
    >>> lamp(torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]])).irradiance / torch.pi
    tensor([[[1.]]])
    """

    center: Tensor
    radius: Tensor
    radiance: Tensor
    outward: Tensor

    def __init__(
        self,
        center: object,
        radius: object,
        radiance: object,
        *,
        samples: int = 1,
        learnable: bool = False,
    ) -> None:
        super().__init__()
        if samples < 1:
            raise OutOfRangeError("samples", f"{samples}", "pass at least 1")
        self.samples = samples
        self._hold("center", center, learnable, last=3)
        self._hold("radius", radius, learnable, last=1, least=0)
        self._hold("radiance", radiance, learnable, least=0)
        if samples > 1:
            outward = fibonacci_directions(samples, self.center.dtype).to(self.center.device)
            self.register_buffer("outward", outward)

    @property
    def lights(self) -> int:
        return self.center.shape[-2] * self.samples

    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
    ) -> Arrival:
        position = self._near(position)
        held = (self.center, self.radius, self.radiance, position, normal)
        if self.samples > 1:
            return sphere_samples(*held, self.outward)
        return sphere_arrival(*held)

    def irradiance_on(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
        visibility: Float[Tensor, "light *batch point"] | None = None,
    ) -> Float[Tensor, "*batch point channel"]:
        if self.samples > 1:
            return super().irradiance_on(position, normal, visibility)
        position = self._near(position)
        offset = light_first(self.center, position).double() - position.double()
        size = light_first(self.radius, position).squeeze(-1)
        received = sphere_irradiance(offset, normal.double(), size).to(normal.dtype)
        return summed(received, light_first(self.radiance, position), visibility)

    def extra_repr(self) -> str:
        return (
            f"lights={self.center.shape[-2]}, center [m], radius [m], radiance [W/m2/sr], "
            f"samples={self.samples}"
        )
