"""Specular lobes: powers of the cosine between two directions, with all their digits.

    lobe = max(0, cos angle(a, b))^n = exp(n log1p(-v)),   v = 1 - cos = |a - b|^2 / 2

cos^n multiplies the relative error of the cosine by n, so a float32 dot product leaves two
digits at n = 1e5 and none at 1e7. Near the peak, where the lobe lives, the versine v of float64
vectors comes from their difference without cancellation; for single precision vectors the
cosine itself in float64 is enough, and cheaper. The
relative error of the lobe is then about eps sqrt(75 n) at worst over the part of it that is
above eps of the peak: 2 10^-14 at n = 100, 2 10^-12 at n = 1e6; in float32 it is the rounding of
the result.

A direction that is the same for many points (a distant light, an orthographic eye) may come as
an expanded view; what depends on it alone is then computed once.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.directions import reflect
from torchradiometry.materials.base import AbstractMaterial, check_directions
from torchradiometry.numerics import safe_normalize, tiny, wide

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AbstractLobe", "Brdf", "cosine_power", "half_vector_lobe", "mirror_lobe", "product"]

#: below the square of every vector of float32, far above the least number of float64
LEAST_SQUARE = tiny(torch.float64) ** (1 / 3)
#: k_s, n, wi, wo, normal -> f_r in 1/sr
Brdf = Callable[[Tensor, Tensor, Tensor, Tensor, Tensor], Tensor]


class AbstractLobe(AbstractMaterial):
    """A highlight of one height k_s and one exponent n; a final class names its formula.

    Args:
        specular: k_s, `*batch channel`, in the unit and range that the class says.
        shininess: n, `*batch 1`, >= 0.
        learnable: keep both as `nn.Parameter`s.

    Attributes:
        specular_unit: of k_s.
        most_specular: largest k_s.
    """

    specular_unit: ClassVar[str]
    most_specular: ClassVar[float] = math.inf
    specular: Tensor
    shininess: Tensor

    def __init__(self, specular: object, shininess: object, *, learnable: bool = False) -> None:
        super().__init__()
        self._hold("specular", specular, learnable, lowest=0, highest=self.most_specular)
        self._hold("shininess", shininess, learnable, lowest=0, last=1)

    @staticmethod
    @abstractmethod
    def brdf(
        specular: Float[Tensor, "*batch channel"],
        shininess: Float[Tensor, "*batch 1"],
        incident_direction: Float[Tensor, "*batch 3"],
        outgoing_direction: Float[Tensor, "*batch 3"],
        normal: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch channel"]:
        """The pure function of the lobe, in 1/sr."""

    def forward(
        self,
        incident_direction: Float[Tensor, "*batch 3"],
        outgoing_direction: Float[Tensor, "*batch 3"],
        normal: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch channel"]:
        return self.brdf(
            self.specular, self.shininess, incident_direction, outgoing_direction, normal
        )

    @abstractmethod
    def normal_reflectance(self) -> Float[Tensor, "*batch channel"]:
        """Reflectance (DHR) at normal incidence."""

    def extra_repr(self) -> str:
        return f"specular [{self.specular_unit}], shininess [1]"


def cosine_power(
    a: Float[Tensor, "*batch 3"],
    b: Float[Tensor, "*batch 3"],
    exponent: Float[Tensor, "*batch 1"],
) -> Float[Tensor, "*batch 1"]:
    """max(0, cos angle(a, b))^n of unit vectors, stable for every n >= 0.

    As `numerics.power_lobe`: n = 0 gives 1 everywhere, the horizon has gradient 0.

    Args:
        a: unit, float64.
        b: unit, float64.
        exponent: n >= 0, float64.

    Returns:
        0..1.

    Differentiable in: all arguments.
    Export: compile yes, ONNX yes.

    >>> up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    >>> cosine_power(up, up, torch.tensor([1e6], dtype=torch.float64)).item()
    1.0
    """
    versine = (a - b).square().sum(-1, keepdim=True) / 2
    front = versine < 1
    outside = torch.where(exponent > 0, 0.0, 1.0).to(versine.dtype)
    log_cosine = torch.log1p(-torch.where(front, versine, 0))
    return torch.where(front, torch.exp(exponent * log_cosine), outside)


def mirror_lobe(
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    shininess: Float[Tensor, "*batch 1"],
) -> Float[Tensor, "*batch 1"]:
    """cos^n of the angle between the outgoing and the mirror direction, in float64 (Phong).

    0 where source or eye is not above the surface: every BRDF is 0 there.
    """
    check_directions(incident_direction, outgoing_direction, normal)
    wi, wo, n = _once(incident_direction, normal), _once(outgoing_direction, normal), normal
    if wi.dtype == wo.dtype == n.dtype == torch.float64:
        # unit vectors are unit to rounding only, which the exponent would multiply
        mirrored = reflect(safe_normalize(wi), safe_normalize(n))
        lobe = cosine_power(mirrored, safe_normalize(wo), shininess.double())
        return _above(product(wi, n), product(wo, n), lobe)
    d = _Dots.of(wi, wo, n)
    cosine = torch.addcdiv(-d.io, d.in_ * d.on, d.nn, value=2)
    return _lit_power(d, cosine, shininess)


def half_vector_lobe(
    incident_direction: Float[Tensor, "*batch 3"],
    outgoing_direction: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    shininess: Float[Tensor, "*batch 1"],
) -> Float[Tensor, "*batch 1"]:
    """cos^n of the angle between normal and half vector, in float64 (Blinn).

    0 where source or eye is not above the surface.
    """
    check_directions(incident_direction, outgoing_direction, normal)
    wi, wo, n = _once(incident_direction, normal), _once(outgoing_direction, normal), normal
    if wi.dtype == wo.dtype == n.dtype == torch.float64:
        half = safe_normalize(safe_normalize(wi) + safe_normalize(wo))
        lobe = cosine_power(half, safe_normalize(n), shininess.double())
        return _above(product(wi, n), product(wo, n), lobe)
    d = _Dots.of(wi, wo, n)
    # opposite directions have no half vector; one of them is below the horizon
    square = 2 + 2 * d.io
    square = _where_or_one(_step(square), square)
    return _lit_power(d, (d.in_ + d.on) * (square.rsqrt() * d.nn.rsqrt()), shininess)


def product(
    direction: Float[Tensor, "*batch 3"], other: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 1"]:
    """Inner product component by component, faster than a sum over a strided axis.

    An expanded view of `direction` is multiplied once for all points, where `other` has them.
    """
    return _inner(components(_once(direction, other)), components(other))


def components(v: Float[Tensor, "*batch 3"]) -> tuple[Float[Tensor, "*batch"], ...]:
    """x, y, z, whose gradients come back plane by plane, as images are stored."""
    return v.unbind(-1) if v.ndim < 2 else v.mT.unbind(-2)


def _inner(a: Sequence[Tensor], b: Sequence[Tensor]) -> Float[Tensor, "*batch 1"]:
    """Inner product of vectors given by their three components."""
    return (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).unsqueeze(-1)


def _once(direction: Tensor, normal: Tensor) -> Float[Tensor, "*batch 3"]:
    """`direction` with one entry along each axis that only repeats it (an expanded view).

    Only axes of the normals are cut, which broadcasting restores.
    """
    parts, missing = [slice(None)] * direction.ndim, direction.ndim - normal.ndim
    for axis, step in enumerate(direction.stride()[:-1]):
        if step == 0 and axis >= missing:
            same = direction.shape[axis] == normal.shape[axis - missing]
            parts[axis] = slice(1) if same else slice(None)
    return direction[tuple(parts)]


def _above(light: Tensor, eye: Tensor, lobe: Tensor) -> Float[Tensor, "*batch 1"]:
    """The lobe where the cosines of source and eye are above 0; 0 elsewhere."""
    return torch.where((light > 0) & (eye > 0), lobe, 0)


def _lit_power(d: _Dots, cosine: Tensor, exponent: Tensor) -> Float[Tensor, "*batch 1"]:
    """`power_lobe`, and 0 unless source and eye are above the surface.

    Steps of 0 and 1 are multiplied: compiled, `torch.where` takes a quarter longer.
    """
    front, (shrinks, power) = _step(cosine), wide(1 - _step(exponent), exponent)
    lobe = torch.exp(power * torch.log(_where_or_one(front, cosine)))
    kept = torch.maximum(front, shrinks)  # n = 0 is constant over the hemisphere
    return lobe * (kept * _step(torch.minimum(d.in_.detach(), d.on.detach())))


def _step(x: Tensor) -> Tensor:
    """1 where x > 0, else 0, in the dtype of x; no gradient."""
    return x.detach().sign().relu()


def _where_or_one(step: Tensor, x: Tensor) -> Tensor:
    """x where the step is 1, else 1."""
    return x * step + (1 - step)


class _Dots(NamedTuple):
    """Dot products in float64 of n with itself and with unit wi and wo, and of these.

    From single precision vectors they are exact to 10^-16, which n = 1e6 turns into 10^-10 of
    the lobe: far below the rounding of the result, and a third of the cost of vectors in
    double precision. Products with a zero vector are 0.
    """

    nn: Tensor
    in_: Tensor
    on: Tensor
    io: Tensor

    @classmethod
    def of(cls, wi: Tensor, wo: Tensor, n: Tensor) -> _Dots:
        # taken apart and widened once, so that gradients are summed in float64 as well
        i, o, m = (wide(*components(v)) for v in (wi, wo, n))
        i, o = _unit(i), _unit(o)
        return cls(_square(m), _inner(i, m), _inner(o, m), _inner(i, o))


def _square(v: Sequence[Tensor]) -> Float[Tensor, "*batch 1"]:
    """|v|^2 of float32 vectors, above 0 for every one, so that it can be divided by."""
    return _inner(v, v).clamp(min=LEAST_SQUARE)


def _unit(v: Sequence[Tensor]) -> tuple[Tensor, ...]:
    """v/|v| by its components; the zero vector stays zero."""
    scale = _square(v).squeeze(-1).rsqrt()
    return tuple(part * scale for part in v)
