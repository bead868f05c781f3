"""Spherical source: a sphere of uniform radiance, exact also where the horizon cuts it.

    Phi = integral of the direction over the visible part,   E = L n . Phi

(`sphere_irradiance`). With `samples` > 1 the sphere is that many emitters of equal area instead,
each with E = L cos(source) A / (samples r^2): a sum over them converges for every BRDF.

References: J. M. Snyder, "Area Light Sources for Real-Time Graphics", Microsoft Research
MSR-TR-96-11 (1996), 3.3; S. Lagarde and C. de Rousiers, "Moving Frostbite to Physically Based
Rendering", SIGGRAPH 2014 course, listing 10; A. Gonzalez, "Measurement of Areas on a Sphere
Using Fibonacci and Latitude-Longitude Lattices", Math. Geosci. 42 (2010), for the samples.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import require_floating, require_whole
from torchradiometry.numerics import (
    dot,
    guarded_divide,
    narrow,
    safe_norm,
    safe_normalize,
    safe_sqrt,
    single,
)
from torchradiometry.sources.base import AbstractSource, Arrival, light_first
from torchradiometry.sources.extended import (
    direction_and_length,
    sample_rows,
    summed,
)
from torchradiometry.sources.sphere_irradiance import (
    sphere_irradiance,
    sphere_vector_irradiance,
)

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = [
    "SphereSource",
    "fibonacci_directions",
    "sphere_arrival",
    "sphere_samples",
]


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
    # a tensor: the ONNX exporter would round a Python number to float32
    pi = torch.tensor(math.pi, dtype=facing.dtype, device=facing.device)
    strength = 4 * pi / outward.shape[-2] * facing * share * share
    rows = sample_rows(direction, strength, distance, light_first(radiance, position))
    return Arrival(*(narrow(t, position.dtype) for t in rows))


def fibonacci_directions(samples: int, dtype: torch.dtype) -> Float[Tensor, "sample 3"]:
    """Directions that stand for equal areas of the unit sphere.

    z_k = 1 - (2 k + 1) / samples, each a golden angle, pi (3 - sqrt 5), further round.

    Args:
        samples: how many, 1...2^24.
        dtype: of the answer.

    Returns:
        Unit vectors.

    Raises:
        DTypeError: no whole number.
        OutOfRangeError: none, or too many.

    References: Gonzalez (2010), eq. 1.

    >>> fibonacci_directions(2, torch.float32)[:, 2]
    tensor([ 0.5000, -0.5000])
    """
    require_whole("samples", samples, 1, 2**24)
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
        require_whole("samples", samples, 1, 2**24)
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
