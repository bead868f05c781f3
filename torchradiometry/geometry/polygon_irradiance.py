"""Exact irradiance of a uniform planar polygon: Lambert's contour integral.

    Phi = 1/2 sum_i gamma_i g_i,   gamma_i = angle(p_i, p_{i+1}),   g_i = p_{i+1} x p_i / |...|
    E = L n . Phi

p_i are the corners seen from the receiver, counter-clockwise seen from the emitting side, cut
at the receiver's horizon; Phi is the *vector irradiance* of unit radiance: the integral of
the direction over the solid angle, in sr. A source that fills the hemisphere gives E = pi L.

With e_i = p_{i+1} - p_i and w_i = gamma_i / |p_i x e_i| the sum is -1/2 sum w_i (p_i x e_i).
Far away its terms are r/size larger than their sum. They are therefore referred to the
middle c of the polygon (p_i = c + q_i, sum e_i = 0):

    sum w_i (p_i x e_i) = sum (w_i - 1/|c|^2) (p_i x e_i) + 1/|c|^2 sum q_i x e_i,

and the difference of weights is formed from |p_i| - |c| = (2 c.q_i + q_i^2) / (|p_i| + |c|)
and gamma/sin(gamma) - 1 without cancelling. This keeps all digits of Phi at any distance.

n . Phi still cancels where a far polygon is seen at grazing incidence, a near one edge-on, or a
sliver of one over the horizon. The terms tell; where they are much larger than their sum, the few
rows concerned are computed again with 32 digits (`careful`).

References: J. H. Lambert, *Photometria* (1760); D. R. Baum, H. E. Rushmeier and J. M. Winget,
"Improving Radiosity Solutions Through the Use of Analytically Determined Form-Factors",
SIGGRAPH 1989, eq. 8; J. Arvo, "The Irradiance Jacobian for Partially Occluded Polyhedral
Sources", SIGGRAPH 1994, eq. 2 and 3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import require_axes
from torchradiometry.geometry.careful import careful_irradiance, looked_at_twice
from torchradiometry.geometry.clipping import clip_slots
from torchradiometry.numerics import angle_of, guarded_divide, safe_sqrt, tiny, wide

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["polygon_irradiance", "polygon_vector_irradiance"]

#: The contour is referred to the polygon's middle beyond this multiple of its largest
#: half-size. Nearer, the plain sum loses at most this factor of the last digit.
_FAR = 4.0
#: Below this sin(gamma)^2 the series of gamma/sin(gamma) is used; with the terms below it is
#: cut at 0.01^9 / 20 < 1e-19.
_SMALL = 0.01
#: asin(s)/s - 1 = sum_k a_k s^(2k), a_k = (2k)! / (4^k k!^2 (2k + 1)), k = 1...9
_ARC_SERIES = (
    1 / 6, 3 / 40, 5 / 112, 35 / 1152, 63 / 2816, 231 / 13312, 143 / 10240, 6435 / 557056,
    12155 / 1245184,
)  # fmt: skip


def polygon_vector_irradiance(
    position: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    polygon: Float[Tensor, "*batch corner 3"],
) -> Float[Tensor, "*batch 3"]:
    """Vector irradiance of a polygon of unit radiance, cut at the receiver's horizon.

    The integral of the direction over the polygon's solid angle above the horizon. It points
    to the polygon in front of it and **away** from it behind its back, so that n . Phi is the
    irradiance with the sign of the side. In the polygon's plane an edge through the point
    counts nothing: inside the face the length is pi (the limit from the front), on an edge
    pi/2, on a corner half its interior angle, outside 0.

    Args:
        position: the receiver, m.
        normal: of the receiver, unit.
        polygon: planar corners in m, counter-clockwise seen from the emitting side; convex or
            not, any size from 1e-12 to 1e12. Batch axes broadcast.

    Returns:
        Phi in sr, so n . Phi is W/m2 for a radiance of 1 W/m2/sr.

    Differentiable in: position, normal, polygon (kinks: in the polygon's plane, and where a
        corner crosses the horizon).
    Export: compile yes, ONNX yes.
    References: Lambert (1760); Baum et al. (1989), eq. 8; Arvo (1994), eq. 2.

    >>> wall = 1e6 * torch.tensor([[1.0, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]])
    >>> up = torch.tensor([0.0, 0, 1])
    >>> polygon_vector_irradiance(-up, up, wall)[2]  # the whole hemisphere: pi
    tensor(3.1416)
    """
    require_axes("position", position, 3)
    require_axes("normal", normal, 3)
    require_axes("polygon", polygon, None, 3)
    dtype = torch.promote_types(position.dtype, polygon.dtype)
    return _vector_irradiance(*wide(position, normal, polygon)).to(dtype)


def polygon_irradiance(
    position: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    polygon: Float[Tensor, "*batch corner 3"],
    two_sided: bool = False,
    rounding: float | None = None,
) -> Float[Tensor, "*batch"]:
    """Irradiance of a polygon of unit radiance at a point, exact, cut at the horizon.

    E = max(0, n . Phi); with `two_sided` |n . Phi|. Divided by pi it is the form factor from
    a point to a polygon.

    Args:
        position: the receiver, m.
        normal: of the receiver, unit.
        polygon: planar corners in m, counter-clockwise seen from the emitting side.
        two_sided: both sides shine; otherwise 0 behind the polygon's plane.
        rounding: relative error that the result may have, to save the second look that hard
            inputs take; None: the rounding of its dtype.

    Returns:
        W/m2 for 1 W/m2/sr, 0...pi. Relative error, measured on hard inputs (1e6 sizes away,
        grazing, cut by the horizon, edge-on at 1e-6 rad, 1e-6 sizes above an edge): at most
        3e-14 in float64, the rounding of the result in float32; in a graph 2e-6 and 2e-5.

    Differentiable in: position, normal, polygon (kinks as in `polygon_vector_irradiance`).
    Export: compile yes, ONNX yes; a graph has no second look, see above.
    References: Baum et al. (1989), eq. 8.

    >>> panel = torch.tensor([[1.0, -1, 1], [-1, -1, 1], [-1, 1, 1], [1, 1, 1]])
    >>> polygon_irradiance(torch.zeros(3), torch.tensor([0.0, 0, 1]), panel)
    tensor(1.7408)
    """
    require_axes("position", position, 3)
    require_axes("normal", normal, 3)
    require_axes("polygon", polygon, None, 3)
    dtype = torch.promote_types(position.dtype, polygon.dtype)
    position, normal, polygon = wide(position, normal, polygon)
    if rounding is None:
        rounding = torch.finfo(dtype).eps
    signed = _signed_irradiance(position, normal, polygon, rounding, two_sided)
    return (signed.abs() if two_sided else signed.clamp(min=0)).to(dtype)


def _signed_irradiance(
    position: Tensor, normal: Tensor, polygon: Tensor, rounding: float, two_sided: bool
) -> Float[Tensor, "*batch"]:
    """n . Phi in float64, < 0 behind the polygon; there only the sign counts of one-sided ones."""
    prepared = _prepared(position, normal, polygon)
    phi, size = _contour_integral(prepared.towards, prepared.slots)
    plain = _dot(prepared.normal.squeeze(1), phi)
    with torch.no_grad():
        loss = _loss(prepared, plain, size)
        if not two_sided:
            loss = torch.where(plain < 0, 0, loss)
    rows = (position, 1), (normal, 1), (polygon, 2)
    return looked_at_twice(plain, loss, rounding, careful_irradiance, *rows)


class _Prepared(NamedTuple):
    """Components first, lengths in units of the largest, the polygon cut at the horizon."""

    normal: Float[Tensor, "3 1 *batch"]
    towards: Float[Tensor, "3 1 *batch"]
    slots: Float[Tensor, "3 two_corners *batch"]
    height: Float[Tensor, "corner *batch"]


def _vector_irradiance(position: Tensor, normal: Tensor, polygon: Tensor) -> Tensor:
    """The vector irradiance in float64."""
    prepared = _prepared(position, normal, polygon)
    return _contour_integral(prepared.towards, prepared.slots)[0].movedim(0, -1)


def _prepared(position: Tensor, normal: Tensor, polygon: Tensor) -> _Prepared:
    """Whole planes of numbers are combined inside: several times faster than triples."""
    rank = max(position.ndim, normal.ndim, polygon.ndim - 1)
    position, normal, polygon = (
        t[(None,) * (rank - t.ndim + 1)].movedim((-1, -2), (0, 1)).contiguous()
        for t in (position.unsqueeze(-2), normal.unsqueeze(-2), polygon)
    )
    middle = polygon.mean(1, keepdim=True)
    offset, towards = polygon - middle, middle - position
    reach, size = towards.detach().abs().amax((0, 1)), offset.detach().abs().amax((0, 1))
    unit = torch.maximum(reach, size)
    unit = torch.where(unit > 0, unit, 1)
    towards, offset = towards / unit, offset / unit
    height = _dot(normal, towards) + _dot(normal, offset)
    return _Prepared(normal, towards, clip_slots(offset, height), height)


def _loss(prepared: _Prepared, value: Tensor, size: Tensor) -> Float[Tensor, "*batch"]:
    """How many roundings of itself the sum, or a height over the horizon, may be off by."""
    normal, towards, _, height = prepared
    reach = _dot(normal, towards.copysign(normal)).squeeze(0)
    heights = guarded_divide(reach, height.amax(0).clamp(min=0))
    return torch.maximum(guarded_divide(size, value.abs()), heights).expand(value.shape)


def _dot(a: Float[Tensor, "3 *batch"], b: Float[Tensor, "3 *batch"]) -> Float[Tensor, "*batch"]:
    """Inner product over the first axis."""
    return (a * b).sum(0)


def _cross(a: Float[Tensor, "3 *batch"], b: Float[Tensor, "3 *batch"]) -> Float[Tensor, "3 *batch"]:
    """Vector product over the first axis."""
    (ax, ay, az), (bx, by, bz) = a.unbind(), b.unbind()
    return torch.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


def _contour_integral(
    towards: Float[Tensor, "3 1 *batch"], offset: Float[Tensor, "3 corner *batch"]
) -> tuple[Float[Tensor, "3 *batch"], Float[Tensor, "*batch"]]:
    """-1/2 sum w_i (p_i x e_i) of the polygon with corners p_i = towards + offset_i.

    And, in roundings, what its terms may be off by: p_i x e_i is made of numbers as large as |e_i|,
    also where the point lies near the line of e_i and it is small.
    """
    corner = towards + offset
    edge = offset.roll(-1, 1) - offset
    cross = _cross(corner, edge)
    length = safe_sqrt(_dot(corner, corner))
    both = length * length.roll(-1, 0)
    square = both * both
    excess = _arc_excess(
        guarded_divide(_dot(cross, cross), square),
        guarded_divide(_dot(corner, corner.roll(-1, 1)), both),
    )
    reference, difference = _weights(towards, offset, length, both, excess)
    area = _cross(offset, edge).sum(1)
    terms = difference * cross
    with torch.no_grad():
        size = (difference.abs() * _dot(edge, edge).sqrt()).sum(0) + (reference * area).abs().sum(0)
    return -0.5 * (terms.sum(1) + reference * area), size


def _weights(
    towards: Tensor, offset: Tensor, length: Tensor, both: Tensor, excess: Tensor
) -> tuple[Tensor, Tensor]:
    """The reference 1/|c|^2 (0 nearby) and w_i minus it, without cancelling."""
    square = _dot(towards, towards)
    far = square > _FAR**2 * _dot(offset, offset).detach().amax(0, keepdim=True)
    square = torch.where(far, square, 1)
    root = square.sqrt()
    longer = _dot(2 * towards + offset, offset) / (length + root)
    next_longer = longer.roll(-1, 0)
    shrink = root * (longer + next_longer) + longer * next_longer
    numerator = torch.where(far, excess - shrink / square, 1 + excess)
    reference = torch.where(far, 1 / square, 0).squeeze(0)
    return reference, guarded_divide(numerator, both)


def _arc_excess(sine_squared: Tensor, cosine: Tensor) -> Tensor:
    """gamma/sin(gamma) - 1 from sin(gamma)^2 and cos(gamma), exact to the last digits.

    At gamma = pi (the point lies on the edge) it is a finite number of no meaning; the
    caller multiplies it with the zero vector.
    """
    small = (sine_squared < _SMALL) & (cosine > 0)
    s = torch.where(small, sine_squared, 0)
    series = torch.zeros_like(s)
    # a tensor and no Python numbers: the ONNX exporter would round those to float32
    held = torch.tensor(_ARC_SERIES, dtype=s.dtype, device=s.device)
    for coefficient in reversed(held.unbind()):
        series = (series + coefficient) * s
    usable = ~small & (sine_squared > tiny(sine_squared.dtype))
    sine = torch.where(usable, sine_squared, 1).sqrt()
    return torch.where(small, series, angle_of(sine, cosine) / sine - 1)
