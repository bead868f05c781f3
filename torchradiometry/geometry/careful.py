"""A second look, with 32 digits, at the few values whose formula cancels.

    E     = 1/2 sum_i gamma_i n . (p_{i+1} x p_i) / |p_{i+1} x p_i|
    omega = 2 sum_triangles atan2(-a.((b-a) x (c-a)), |a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|)

The sums are those of `polygon_irradiance` and `solid_angle`. What they are made of is larger than
the result by

* 1/theta where the polygon is seen edge-on, at an angle theta to its plane,
* r/size where a far polygon is seen at grazing incidence,
* size/height where only a sliver of a polygon looks over the horizon,
* size/gap near an edge,

and by their product where several meet; a height over the horizon, n . p, loses digits in the same
cases. With 32 digits every such loss up to 10^14 leaves more than float64 holds.

References: as of `polygon_irradiance`, `solid_angle` and `double_double`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.geometry.double_double import (
    Double,
    angle,
    cross,
    difference,
    inner,
    power_of_two,
)

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["careful_irradiance", "careful_solid_angle", "looked_at_twice"]

#: rows that are held at a time
BLOCK = 2**14
#: roundings of float64, and of the dtype that is asked for, that a value may be off by
ALLOWED, ALLOWED_OF_RESULT = 2.0**8, 4.0
#: beyond this loss the point lies in the polygon's plane, or the polygon on the horizon: the
#: value is 0 but for rounding
IN_PLANE = 2.0**46


def looked_at_twice(
    plain: Float[Tensor, "*batch"],
    loss: Float[Tensor, "*batch"],
    rounding: float,
    careful: Callable[..., Tensor],
    *operands: tuple[Tensor, int],
) -> Float[Tensor, "*batch"]:
    """`plain`, with the values that lost too many digits replaced by those of `careful`.

    Args:
        plain: float64.
        loss: what each value may be off by, in roundings of itself.
        rounding: of the dtype that the result will have.
        careful: from rows of the operands to values.
        operands: tensors that broadcast to `plain`, and how many axes of their own they have.

    Differentiable in: plain, operands.
    Export: compile yes, ONNX yes, without a second look: it would depend on the data.
    """
    if torch.compiler.is_compiling():
        return plain
    allowed = max(ALLOWED, ALLOWED_OF_RESULT * rounding / torch.finfo(plain.dtype).eps)
    batch = plain.shape or (1,)
    doubtful = (loss > allowed) & (loss < IN_PLANE)
    index = doubtful.reshape(batch).nonzero(as_tuple=True)
    if len(index[0]) == 0:
        return plain
    rows = [t.expand(*batch, *t.shape[t.ndim - own :])[index] for t, own in operands]
    blocks = zip(*(t.split(BLOCK) for t in rows), strict=True)
    found = torch.cat([careful(*block) for block in blocks])
    return plain.reshape(batch).index_put(index, found).reshape(plain.shape)


def careful_irradiance(
    position: Float[Tensor, "row 3"],
    normal: Float[Tensor, "row 3"],
    polygon: Float[Tensor, "row corner 3"],
) -> Float[Tensor, "row"]:
    """n . Phi of polygons of unit radiance, W/m2, signed, float64.

    Args:
        position, normal, polygon: as of `polygon_irradiance`, float64.

    Returns:
        Within 1e-15 of the exact value of the numbers given, as long as that is above 1e-14 of
        what the polygon would give face to face.

    Differentiable in: all (kinks as of `polygon_irradiance`).
    Export: no; it is taken for the few rows that need it.
    """
    corner, facing = _seen_from(position, polygon), Double.of(normal.mT.unsqueeze(1))
    start, end = _cut(corner, inner(corner, facing))
    axis = cross(end.minus(start), start)
    sine = inner(axis, axis).root()
    turns = sine.high > 0
    gamma = angle(sine, inner(start, end))
    one = Double.of(torch.ones_like(sine.high))
    share = gamma.over(sine.where(turns, one)).times(inner(axis, facing))
    return 0.5 * share.where(turns, Double.of(torch.zeros_like(sine.high))).total(0).value


def careful_solid_angle(
    position: Float[Tensor, "row 3"], polygon: Float[Tensor, "row corner 3"]
) -> Float[Tensor, "row"]:
    """Signed solid angle of polygons, sr, float64; outside of their planes.

    Args:
        position, polygon: as of `solid_angle_polygon`, float64.

    Returns:
        Accurate as `careful_irradiance`.

    Differentiable in: both.
    Export: no; it is taken for the few rows that need it.
    """
    corner = _seen_from(position, polygon)
    count = polygon.shape[1]
    a = corner.apply(lambda t: t[:, :1].expand(-1, count - 2, -1))
    b, c = corner.apply(lambda t: t[:, 1:-1]), corner.apply(lambda t: t[:, 2:])
    volume = inner(a, cross(c.minus(a), b.minus(a)))
    la, lb, lc = (inner(p, p).root() for p in (a, b, c))
    below = la.times(lb).times(lc).plus(inner(a, b).times(lc))
    below = below.plus(inner(b, c).times(la)).plus(inner(c, a).times(lb))
    sign = torch.where(volume.high < 0, -1.0, 1.0).to(volume.high)
    turn = angle(Double(volume.high * sign, volume.low * sign), below)
    return 2 * Double(turn.high * sign, turn.low * sign).total(0).value


def _seen_from(position: Tensor, polygon: Tensor) -> Double:
    """Corners relative to the point, exactly, in a power of two of m, `3 corner row`."""
    place, corners = position.mT.unsqueeze(1), polygon.permute(2, 1, 0)
    unit = power_of_two((corners - place).abs().amax((0, 1)))
    return difference(corners / unit, place / unit)


def _cut(corner: Double, height: Double) -> tuple[Double, Double]:
    """Starts and ends of the edges above the horizon, and of the walk along it, `2 corner` each.

    An edge that leaves gives a second piece: from the cut to the place where the outline
    returns. Pieces without a length are points.
    """
    following, beyond = (t.apply(lambda x: x.roll(-1, -2)) for t in (corner, height))
    inside, stays = height.high >= 0, beyond.high >= 0
    crossing = inside != stays
    drop = height.minus(beyond)
    one = Double.of(torch.ones_like(drop.high))
    share = height.over(drop.where(crossing, one))
    step = following.minus(corner)
    wide = Double(*(t.unsqueeze(0).expand_as(corner.high) for t in share))
    cut = corner.plus(wide.times(step))
    start, end = corner.where(inside, cut), following.where(stays, cut)
    none = ~inside & ~stays
    return _along_the_cut(start.where(~none, corner), end.where(~none, corner), inside, stays)


def _along_the_cut(
    start: Double, end: Double, inside: Tensor, stays: Tensor
) -> tuple[Double, Double]:
    """Joins the kept pieces: each that leaves is followed by the walk to the next that returns."""
    leaves, returns = inside & ~stays, ~inside & stays
    count = leaves.shape[0]
    place = torch.arange(count, device=leaves.device)
    ahead = (place.unsqueeze(0) - place.unsqueeze(1)) % count  # [leaving, returning]
    ahead = torch.where(returns.unsqueeze(0), ahead.unsqueeze(-1), count)
    nearest = ahead.argmin(1).unsqueeze(0).expand_as(start.high)
    landing = start.apply(lambda t: t.gather(1, nearest))
    walk = landing.where(leaves, end)
    return (
        Double(*(torch.cat(pair, 1) for pair in zip(start, end, strict=True))),
        Double(*(torch.cat(pair, 1) for pair in zip(end, walk, strict=True))),
    )
