"""Hard shadow of distant lights over a height field, without a loop over pixels.

A pixel x sees the light in direction l = (l_xy, l_z) when no surface on the way is higher
than the ray:

    V(x) = 1  iff  max over t > 0 of  z(x + t u) - t tan(alpha)  <=  z(x),
    u = l_xy/|l_xy|,   tan(alpha) = l_z/|l_xy|.

The maximum is built by doubling. With d the step along u that moves one pixel along the
longer axis, and M_k the maximum over the first 2^k steps,

    M_0(x) = z(x + d) - tau,     M_{k+1}(x) = max(M_k(x), M_k(x + 2^k d) - 2^k tau),

so an image of S pixels needs log2(S) steps instead of S. Between pixels heights are linear
along the shorter axis, so a plane never shadows itself.

The first surface that a ray meets (`height_field_hits`) is what one bounce of light needs.

References: N. L. Max, "Horizon mapping: shadows for bump-mapped surfaces", The Visual
Computer 4 (1988); W. D. Hillis and G. L. Steele, "Data parallel algorithms", CACM 29 (1986),
for the doubling.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import IndexRangeError, ShapeError, require_axes, require_whole
from torchradiometry.geometry.image_space import checked_size
from torchradiometry.numerics import (
    alike,
    safe_norm,
    single,
)

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["height_field_hits", "height_field_visibility"]

#: a blocker must rise above the ray by this share of a pixel: ten times the rounding of
#: float32 heights of a few hundred pixels, far below what an image can show
CLEARANCE = 1e-3


def height_field_visibility(
    height: Float[Tensor, "batch height width"],
    direction: Float[Tensor, "*batch light 3"],
    pixel_size: float = 1.0,
) -> Float[Tensor, "light batch height width"]:
    """1 where a distant light is seen over the height field, 0 in its cast shadow.

    Attached shadows (n . l < 0) are the cosine's matter and may be reported either way.
    Nothing outside the image casts a shadow; give holes a height far below the rest.

    Args:
        height: m, towards the camera; row 0 is the top of the image.
        direction: unit, to the light: x right, y up, z to the camera; `light 3`, or
            `batch light 3` for other lights in each image. A light at or below the
            horizon (z <= 0) is not seen from anywhere.
        pixel_size: m between neighbouring pixels.

    Returns:
        Visibility, 0 or 1.

    Raises:
        ShapeError: another rank.
        DTypeError, OutOfRangeError: a pixel size that is no length.

    Differentiable in: nothing (a hard shadow is a step).
    Export: compile yes; ONNX no, the number of steps follows the size of the map.

    References: see the module.

    >>> wall = torch.tensor([[[0.0, 0.0, 0.0, 3.0]]])
    >>> from_the_right = torch.tensor([[0.6, 0.0, 0.8]])
    >>> height_field_visibility(wall, from_the_right)[0, 0, 0]
    tensor([1., 0., 0., 1.])
    """
    require_axes("height", height, None, None, None)
    checked_size(pixel_size)
    require_axes("direction", direction, None, 3)
    dtype = height.dtype
    height, direction = alike(*single(height, direction))
    directions = _per_image(height, direction)
    field = (height / pixel_size).unsqueeze(0)
    step, rise = _steps(directions)
    lowest = field.amin() - 4 * (field.amax() - field.amin()) - 4 * max(height.shape[-2:])
    horizon = _shifted(field, step, lowest) - rise
    for doubling in range(math.ceil(math.log2(max(max(height.shape[-2:]), 2)))):
        reach = 2**doubling
        horizon = torch.maximum(horizon, _shifted(horizon, step * reach, lowest) - rise * reach)
    seen = (horizon <= field + CLEARANCE) & (directions[..., 2] > 0)[..., None, None]
    return seen.to(dtype)


def height_field_hits(
    height: Float[Tensor, "batch height width"],
    direction: Float[Tensor, "ray 3"],
    start: Int[Tensor, "point"] | None = None,
    pixel_size: float = 1.0,
    steps: int | None = None,
) -> Int[Tensor, "ray batch point"]:
    """The pixel that a ray from each start meets first, as row * width + column; -1 for none.

    Rays march pixel by pixel along the longer axis to the nearest pixel of the other, so a
    hit is right to about one pixel.

    Args:
        height: m, towards the camera.
        direction: unit, the same rays for every pixel; z may be negative.
        start: pixels that rays leave from, row * width + column; None is every pixel.
        pixel_size: m between neighbouring pixels.
        steps: how many pixels far a ray is followed; by default across the image.

    Returns:
        Index of the pixel met.

    Raises:
        IndexRangeError: a start outside the image (a compiled graph does not look).
        DTypeError, OutOfRangeError: steps that are no whole number from 0, or a pixel size that
            is no length.

    Differentiable in: nothing.
    Export: compile yes; ONNX no, the number of steps follows the size of the map.

    >>> wall = torch.tensor([[[0.0, 0.0, 0.0, 5.0]]])
    >>> height_field_hits(wall, torch.tensor([[0.8, 0.0, 0.6]]))[0, 0]
    tensor([ 3,  3,  3, -1])
    """
    require_axes("height", height, None, None, None)
    checked_size(pixel_size)
    require_axes("direction", direction, None, 3)
    rows, columns = height.shape[-2:]
    across = max(rows, columns) - 1  # further on there is no pixel
    if steps is not None:
        require_whole("steps", steps, 0)
        across = min(across, steps)
    field = (height / pixel_size).flatten(1)
    if start is not None and not torch.compiler.is_compiling():
        wrong = start[(start < 0) | (start >= rows * columns)]
        if len(wrong):
            mend = f"pass pixels of the image, 0 to {rows * columns - 1}"
            raise IndexRangeError("start", f"{int(wrong[0])}", mend)
    if start is None:
        start = torch.arange(rows * columns, device=height.device)
    row, column = start // columns, start % columns
    step, rise = _steps(direction)
    shape = (len(direction), len(height), len(start))
    met = torch.full(shape, -1, dtype=torch.int64, device=height.device)
    for reach in range(1, 1 + across):
        moved = torch.round(step * reach).to(torch.int64)
        there_row, there_column = row + moved[:, :1], column + moved[:, 1:]
        inside = (there_row >= 0) & (there_row < rows)
        inside = inside & (there_column >= 0) & (there_column < columns)
        target = there_row.clamp(0, rows - 1) * columns + there_column.clamp(0, columns - 1)
        ray = field[:, start] + rise.reshape(-1, 1, 1) * reach
        hit = (field[:, target].movedim(0, 1) > ray + CLEARANCE) & inside.unsqueeze(1)
        met = torch.where(hit & (met < 0), target.unsqueeze(1), met)
    return met


def _per_image(height: Tensor, direction: Tensor) -> Tensor:
    """Directions as `light batch|1 3`."""
    if height.ndim != 3 or 0 in height.shape:
        raise ShapeError("height", f"shape {tuple(height.shape)}", "pass batch x height x width")
    if direction.ndim not in (2, 3) or direction.shape[-1] != 3:
        raise ShapeError(
            "direction", f"shape {tuple(direction.shape)}", "pass `light 3` or `batch light 3`"
        )
    return direction.unsqueeze(1) if direction.ndim == 2 else direction.transpose(0, 1)


def _steps(direction: Tensor) -> tuple[Tensor, Tensor]:
    """(row, column) step of one pixel along the longer axis, and how far the ray rises in it."""
    sideways = torch.stack([-direction[..., 1], direction[..., 0]], -1)
    longer = sideways.abs().amax(-1, keepdim=True)
    usable = longer > 0
    step = torch.where(usable, sideways / torch.where(usable, longer, 1), 0)
    level = safe_norm(sideways)
    level = torch.where(usable.squeeze(-1), level, 1)
    rise = safe_norm(step) * direction[..., 2] / level
    overhead = torch.full_like(rise, torch.finfo(rise.dtype).max ** 0.5)
    return step, torch.where(usable.squeeze(-1), rise, overhead)[..., None, None]


def _shifted(field: Tensor, shift: Tensor, outside: Tensor) -> Tensor:
    """`field[..., i + shift_row, j + shift_column]`, linear between pixels, `outside` beyond."""
    field = _shifted_along(field, shift[..., 0], -2, outside)
    return _shifted_along(field, shift[..., 1], -1, outside)


def _shifted_along(field: Tensor, shift: Tensor, axis: int, outside: Tensor) -> Tensor:
    size = field.shape[axis]
    whole = torch.floor(shift)
    # one row (column) of `outside` at either end, where every index beyond the image lands
    edge = outside.expand_as(field.narrow(axis, 0, 1))
    framed = torch.cat([edge, field, edge], axis)
    first = torch.arange(1, size + 1, device=field.device) + whole.to(torch.int64).unsqueeze(-1)
    lower = _gathered(framed, first.clamp(0, size + 1), axis)
    upper = _gathered(framed, (first + 1).clamp(0, size + 1), axis)
    return torch.lerp(lower, upper, (shift - whole)[..., None, None])


def _gathered(field: Tensor, index: Tensor, axis: int) -> Tensor:
    """`field` with its rows (columns) picked by the `index` of each light and image."""
    index = index.unsqueeze(-1 if axis == -2 else -2)
    lead = torch.broadcast_shapes(field.shape[:2], index.shape[:2])
    size = list(field.shape[-2:])
    source = field.expand(*lead, *size)
    size[axis] = index.shape[axis]
    return torch.gather(source, axis, index.expand(*lead, *size))
