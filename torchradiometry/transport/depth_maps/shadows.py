"""Cast shadows on a depth map: rays from pixels to lights, over the heights between.

In image space (`geometry.image_space`) the ray from the pixel P = (u, v, h) to a light is
straight, and with m = max(|D_u|, |D_v|) it rises by D_h / m for every pixel along its longer
axis. So

    V(x) = 1  iff  (h(P + k e) - h) / k <= D_h / m   for all k on the way to the light,   e = D / m.

`hard_shadows` looks at every crossing of the ray with an edge of the triangles that
neighbouring pixels make (rows, columns, and diagonals from the upper left to the lower right):
exact on that surface.

`soft_shadows` looks at one crossing a pixel, takes the highest as a straight edge and shades it
like a disc of angular radius w around the light: with beta the angle by which the edge rises
over the light,

    V = 1/2 - (asin(t) + t sqrt(1 - t^2)) / pi,    t = beta / w within -1..1.

It moves continuously with heights and lights, and its gradients move the boundary of the shadow.

References: L. Williams, "Casting curved shadows on curved surfaces", SIGGRAPH 1978; N. L. Max,
"Horizon mapping: shadows for bump-mapped surfaces", The Visual Computer 4 (1988).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor
from torch._higher_order_ops.while_loop import while_loop

from torchradiometry.geometry.image_space import HeightField, View, pixel_axis, ray_slope, slices
from torchradiometry.numerics import angle_of, guarded_divide, safe_sqrt
from torchradiometry.transport.depth_maps.horizons import below

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["hard_shadows", "soft_shadows"]

#: a blocker must rise above the ray by this share of a pixel: ten times the rounding of
#: float32 heights of a few hundred pixels, far below what an image can show
CLEARANCE = 1e-3


class LightRays(NamedTuple):
    """Rays from pixels to lights in image space, `light B H W`.

    Attributes:
        across, down: e, pixels for each step along the longer axis, itself +-1.
        rise: of h in such a step.
        reach: steps to the light; infinite for distant ones.
        straight: the light stands on the pixel's own ray to the eye; nothing can hide it.
    """

    across: Float[Tensor, "light B H W"]
    down: Float[Tensor, "light B H W"]
    rise: Float[Tensor, "light B H W"]
    reach: Float[Tensor, "light B H W"]
    straight: Tensor


def hard_shadows(
    field: HeightField,
    view: View,
    direction: tuple[Tensor, Tensor, Tensor],
    distance: Float[Tensor, "light B H W"],
) -> Float[Tensor, "light B H W"]:
    """1 where a light is seen over the map, 0 where it is hidden and where no surface is seen.

    Nothing outside the map casts a shadow.

    Args:
        field, view: the map.
        direction: to the lights, unit, camera frame: x, y and z, each `light B H W`.
        distance: to the lights, m; infinite for distant ones.

    Differentiable in: nothing (a hard shadow is a step).
    Export: compile yes, ONNX yes, as a `Loop`.
    """
    rays = _rays(field, view, direction, distance, detached=True)
    clearance = CLEARANCE / torch.sqrt(view.fx * view.fy)
    free = field.seen
    last = _needed(field, rays)
    for edges in (_columns(rays), _rows(rays), _diagonals(rays)):
        free = free & _free(field, rays, edges, last * edges.most, clearance)
    return (free & field.seen).to(field.height.dtype)


def _free(
    field: HeightField, rays: LightRays, edges: _Edges, last: Tensor, clearance: Tensor
) -> Bool[Tensor, "light B H W"]:
    """Where no crossing with a family of edges lies over the ray."""

    def look(count: Tensor, free: Tensor) -> tuple[Tensor, Tensor]:
        way = count * edges.spacing
        over = _met(field, rays, edges, count) - field.height.detach() - way * rays.rise > clearance
        return count + 1, free & ~(over & (way < rays.reach))

    return _until(last, look, torch.ones_like(rays.rise, dtype=torch.bool))[0]


def soft_shadows(
    field: HeightField,
    view: View,
    direction: tuple[Tensor, Tensor, Tensor],
    distance: Float[Tensor, "light B H W"],
    width: float,
) -> Float[Tensor, "light B H W"]:
    """Share of a disc of angular radius `width` (radians) around each light that is seen.

    Other arguments as of `hard_shadows`.

    Differentiable in: heights, directions, distances, the view.
    Export: compile yes, ONNX yes, as a `Loop`.
    """
    still = _rays(field, view, direction, distance, detached=True)
    edges = _longer(still)

    def look(count: Tensor, steepest: Tensor, nearest: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        slope = (_met(field, still, edges, count) - field.height.detach()) / count
        steeper = (slope > steepest) & (count < still.reach)
        return (
            count + 1,
            torch.where(steeper, slope, steepest),
            torch.where(steeper, count.to(nearest), nearest),
        )

    lowest = torch.full_like(still.rise, below(still.rise))
    nearest = _until(_needed(field, still, width), look, lowest, torch.ones_like(lowest))[1]
    rays = _rays(field, view, direction, distance)
    met = _met(field, rays, _longer(rays), nearest)
    slope = torch.where(nearest < rays.reach, (met - field.height) / nearest, below(met))
    u = pixel_axis(field.height.shape[-1], met)
    v = pixel_axis(field.height.shape[-2], met).unsqueeze(-1)
    cut = slices(view, field.height, (u, v), (rays.across, rays.down))
    edge, light = (cut.alpha * s + cut.beta for s in (slope, rays.rise))
    share = _disc_over_edge(angle_of(edge - light, 1 + edge * light) / width)
    return torch.where(rays.straight, 1, share) * field.seen


def _disc_over_edge(t: Tensor) -> Tensor:
    """Share of a unit disc above a straight edge at height t."""
    t = t.clamp(-1, 1)
    root = safe_sqrt((1 - t) * (1 + t))
    return 0.5 - (angle_of(t, root) + t * root) / math.pi


def _rays(
    field: HeightField,
    view: View,
    direction: tuple[Tensor, Tensor, Tensor],
    distance: Tensor,
    *,
    detached: bool = False,
) -> LightRays:
    """`ray_slope` by steps of the longer axis, and as far as the lights."""
    height, (lx, ly, lz) = field.height, direction
    if detached:
        height, lx, ly, lz, distance = (t.detach() for t in (height, lx, ly, lz, distance))
        view = view.map(torch.Tensor.detach)
    u = pixel_axis(height.shape[-1], height)
    v = pixel_axis(height.shape[-2], height).unsqueeze(-1)
    across, down, rise = ray_slope(view, height, (u, v), (lx, ly, lz))
    end = distance
    if view.perspective:
        depth = field.level / (1 + height)
        far = torch.isinf(distance)
        # s = r / (d - r l_z), and 1 / -l_z for r -> infinity
        ahead = torch.where(far, -lz, depth / torch.where(far, 1, distance) - lz)
        end = torch.where(ahead > 0, 1 / torch.where(ahead > 0, ahead, 1), torch.inf)
    longer = torch.maximum(across.abs(), down.abs())
    straight = longer <= torch.finfo(longer.dtype).eps * torch.sqrt(view.fx * view.fy)
    longer = torch.where(straight, 1, longer)
    return LightRays(
        torch.where(straight, 1, across / longer),
        torch.where(straight, 0, down / longer),
        rise / longer,
        torch.where(straight, 0, end * longer),
        straight,
    )


class _Edges(NamedTuple):
    """Crossings of rays with one family of edges.

    Attributes:
        across, down: pixels from one crossing to the next.
        spacing: steps of the longer axis from one crossing to the next.
        kind: where the edge runs down, where across; both on diagonals.
        most: crossings in a step of the longer axis, at most.
    """

    across: Tensor
    down: Tensor
    spacing: Tensor
    kind: tuple[Tensor, Tensor]
    most: int


def _edges(rays: LightRays, rate: Tensor, kind: tuple[Tensor, Tensor], most: int) -> _Edges:
    none = rate == 0
    spacing = torch.where(none, torch.inf, 1 / torch.where(none, 1, rate.abs()))
    step = torch.where(none, 0, spacing)
    return _Edges(rays.across * step, rays.down * step, spacing, kind, most)


def _columns(rays: LightRays) -> _Edges:
    yes = torch.ones_like(rays.straight)
    return _edges(rays, rays.across, (yes, ~yes), 1)


def _rows(rays: LightRays) -> _Edges:
    yes = torch.ones_like(rays.straight)
    return _edges(rays, rays.down, (~yes, yes), 1)


def _diagonals(rays: LightRays) -> _Edges:
    yes = torch.ones_like(rays.straight)
    return _edges(rays, rays.across - rays.down, (yes, yes), 2)


def _longer(rays: LightRays) -> _Edges:
    wide = rays.across.abs() >= rays.down.abs()
    rate = torch.where(wide, rays.across, rays.down).sign()
    return _edges(rays, rate, (wide, ~wide), 1)


def _met(field: HeightField, rays: LightRays, edges: _Edges, count: Tensor) -> Tensor:
    """Heights of the surface at the `count`-th crossing."""
    rows, columns = field.height.shape[-2:]
    u = torch.arange(columns, dtype=rays.rise.dtype, device=rays.rise.device)
    v = torch.arange(rows, dtype=rays.rise.dtype, device=rays.rise.device).unsqueeze(-1)
    column, row = u + count * edges.across, v + count * edges.down
    runs_down, runs_across = edges.kind
    # across an edge coordinates are whole, on a diagonal a whole number apart, up to rounding
    left = torch.where(runs_across, column.detach(), column.detach().round()).floor()
    top = torch.where(runs_down, row.detach(), row.detach().round()).floor()
    left = torch.where(runs_down & runs_across, top + (column - row).detach().round(), left)
    share = torch.where(runs_down, row - top, column - left)
    low, right = top + runs_down.to(top), left + runs_across.to(left)
    first, second = (_looked_up(field, r, c) for r, c in ((top, left), (low, right)))
    return torch.lerp(first, second, share)


def _looked_up(field: HeightField, row: Tensor, column: Tensor) -> Tensor:
    """Heights of pixels, far below outside the map."""
    images, rows, columns = field.height.shape
    held = torch.where(field.seen, field.height, below(field.height)).flatten()
    held = torch.cat((held, torch.full_like(held[:1], below(held))))
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    image = torch.arange(images, device=row.device).reshape(-1, 1, 1) * (rows * columns)
    place = torch.where(inside, row * columns + column, 0).to(torch.int64) + image
    place = torch.where(inside, place, images * rows * columns)
    return held.index_select(0, place.flatten()).reshape(place.shape)


def _needed(field: HeightField, rays: LightRays, width: float = 0.0) -> Tensor:
    """Steps after which no height is left that could reach a ray (or its disc)."""
    size = max(field.height.shape[-2:])
    if width:
        return torch.full((), size - 1, device=rays.rise.device)
    highest = torch.where(field.seen, field.height, below(field.height)).max().detach()
    climb = guarded_divide(highest - field.height.detach(), rays.rise.clamp(min=0), torch.inf)
    way = torch.minimum(torch.minimum(climb, rays.reach), torch.full_like(climb, size))
    way = torch.where(field.seen & ~rays.straight, way, 0)
    return way.max().ceil().to(torch.int64)


def _until(
    last: Tensor, look: Callable[..., tuple[Tensor, ...]], *state: Tensor
) -> tuple[Tensor, ...]:
    """`look` for the counts 1..last; in a traced graph an ONNX `Loop`."""
    count = torch.ones((), dtype=torch.int64, device=last.device)
    if torch.compiler.is_compiling():
        return while_loop(lambda count, *_: count <= last, look, (count, *state))[1:]
    found: tuple[Tensor, ...] = (count, *state)
    for _ in range(int(last)):
        found = look(*found)
    return found[1:]
