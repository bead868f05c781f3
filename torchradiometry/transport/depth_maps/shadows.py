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
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.image_space import HeightField, View, pixel_axis, ray_slope, slices
from torchradiometry.numerics import angle_of, guarded_divide, safe_sqrt
from torchradiometry.transport.depth_maps.crossings import (
    Crossings,
    columns_met,
    diagonals_met,
    height_table,
    longer_met,
    march,
    rows_met,
)
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
    straight: Bool[Tensor, "light B H W"]


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
    table, height = height_table(field), field.height.detach()
    clearance = CLEARANCE / torch.sqrt(view.fx * view.fy)
    least = height + clearance
    needed = _needed(field, rays, rays.rise)
    free = field.seen.expand(rays.rise.shape)
    for lines in (columns_met, rows_met, diagonals_met):
        steps = lines(field, rays.across, rays.down)

        def look(
            count: Tensor,
            free: Tensor,
            steps: Crossings,
            least: Tensor,
            rise: Tensor,
            reach: Tensor,
        ) -> tuple[Tensor]:
            way = count * steps.spacing
            over = steps.heights(table, count) > least + way * rise
            return (free & ~(over & (way < reach)),)

        last = needed / steps.spacing
        free = march(look, (free,), last, steps, (least, rays.rise, rays.reach), stop=0)[0]
    return free.to(height.dtype)


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
    table, height = height_table(field), field.height.detach()
    u = pixel_axis(height.shape[-1], height)
    v = pixel_axis(height.shape[-2], height).unsqueeze(-1)

    def look(
        count: Tensor,
        steepest: Tensor,
        nearest: Tensor,
        steps: Crossings,
        height: Tensor,
        reach: Tensor,
    ) -> tuple[Tensor, Tensor]:
        slope = (steps.heights(table.detach(), count) - height) / count
        steeper = (slope > steepest) & (count < reach)
        return (
            torch.where(steeper, slope, steepest),
            torch.where(steeper, count.to(nearest.dtype), nearest),
        )

    cut = slices(view.map(torch.Tensor.detach), height, (u, v), (still.across, still.down))
    light = cut.alpha * still.rise + cut.beta
    lowest = (_turned(light, width) - cut.beta) / cut.alpha  # of edges that touch the disc
    state = (torch.full_like(still.rise, below(height)), torch.ones_like(still.rise))
    steps = longer_met(field, still.across, still.down)
    held = (height.expand_as(still.rise), still.reach)
    nearest = march(look, state, _needed(field, still, lowest), steps, held)[1]

    rays = _rays(field, view, direction, distance)
    met = longer_met(field, rays.across, rays.down).heights(table, nearest)
    slope = torch.where(nearest < rays.reach, (met - field.height) / nearest, below(met))
    cut = slices(view, field.height, (u, v), (rays.across, rays.down))
    edge, light = (cut.alpha * s + cut.beta for s in (slope, rays.rise))
    share = _disc_over_edge(angle_of(edge - light, 1 + edge * light) / width)
    return torch.where(rays.straight, 1, share) * field.seen


def _disc_over_edge(t: Tensor) -> Tensor:
    """Share of a unit disc above a straight edge at height t."""
    t = t.clamp(-1, 1)
    root = safe_sqrt((1 - t) * (1 + t))
    return 0.5 - (angle_of(t, root) + t * root) / math.pi


def _turned(cot: Tensor, angle: float) -> Tensor:
    """Cotangent of an angle that is larger by `angle`; below everything beyond pi."""
    turn = 1 / math.tan(angle)
    short = cot + turn > 0
    return torch.where(short, (cot * turn - 1) / torch.where(short, cot + turn, 1), below(cot))


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


def _needed(field: HeightField, rays: LightRays, slope: Tensor) -> Float[Tensor, "light B H W"]:
    """Steps after which no height is left that could reach a line of that slope."""
    height, size = field.height.detach(), max(field.height.shape[-2:])
    if not torch.compiler.is_compiling() and not height.numel():
        return torch.zeros_like(slope)
    highest = torch.where(field.seen, height, below(height)).max()
    climb = guarded_divide(highest - height, slope.clamp(min=0), torch.inf)
    way = torch.minimum(torch.minimum(climb, rays.reach), torch.full_like(climb, size))
    return torch.where(field.seen & ~rays.straight, way, 0)
