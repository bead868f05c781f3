"""Where rays over a depth map cross its rows, columns and diagonals, crossing by crossing.

The k-th line of a family is crossed at a whole coordinate q = q_0 +- k, between two pixels of it:

    family       q              between                          number of the pixel
    columns      column         row f, f + 1                     q + f W
    rows         row            column f, f + 1                  q W + f
    diagonals    column - row   (row, column) f, f + 1           q + f (W + 1)

f is the whole part of the other coordinate, p = p_0 + k slope. Rays that still have a way to go are
kept together (`march`), so that a step costs what is left of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor
from torch._higher_order_ops.while_loop import while_loop

from torchradiometry.geometry.image_space import HeightField
from torchradiometry.transport.depth_maps.horizons import below

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = [
    "Crossings",
    "columns_met",
    "diagonals_met",
    "height_table",
    "longer_met",
    "march",
    "rows_met",
]

#: steps after which rays that have ended are dropped
SWEEP = 4


class Crossings(NamedTuple):
    """Lines of a family that rays cross, `light B H W` each, or one axis of rays.

    Attributes:
        image: number of the first pixel of the ray's image.
        whole, sign: q_0 and the direction it runs in.
        part, slope: p_0 and its change from one crossing to the next.
        spacing: steps of the longer axis from one crossing to the next; infinite for rays
            along the family.
        strides: of q and of f in the number of a pixel.
        sizes: of the coordinate along q (its column on diagonals) and of f.
        turned: 1 on diagonals, where a column is q + f, else 0.
    """

    image: Tensor
    whole: Tensor
    sign: Tensor
    part: Tensor
    slope: Tensor
    spacing: Tensor
    strides: tuple[Tensor | int, Tensor | int]
    sizes: tuple[Tensor | int, Tensor | int]
    turned: int

    def heights(self, table: Float[Tensor, "one_more"], count: Tensor) -> Tensor:
        """Heights of the surface at the `count`-th crossing; far below outside the map.

        Differentiable in: the table, the slopes.
        """
        whole = self.whole + count * self.sign
        part = self.part + count * self.slope
        before = part.detach().floor()
        number = (whole * self.strides[0] + before * self.strides[1]).to(torch.int64) + self.image
        column = whole + self.turned * before
        first = torch.where(self._inside(column, before), number, len(table) - 1)
        after = self._inside(column + self.turned, before + 1)
        # in integers: a stride may be a tensor of them
        second = torch.where(after, number + self.strides[1], len(table) - 1).to(torch.int64)
        low, high = (table.index_select(0, n.flatten()).reshape(n.shape) for n in (first, second))
        return torch.lerp(low, high, part - before)

    def _inside(self, whole: Tensor, before: Tensor) -> Tensor:
        inside = (whole >= 0) & (whole < self.sizes[0])
        return inside & (before >= 0) & (before < self.sizes[1])

    def map(self, change: Callable[[Tensor], Tensor]) -> Crossings:
        """Every tensor changed."""

        def of(value: Tensor | int) -> Tensor | int:
            return change(value) if isinstance(value, Tensor) else value

        return Crossings(
            change(self.image),
            change(self.whole),
            change(self.sign),
            change(self.part),
            change(self.slope),
            change(self.spacing),
            (of(self.strides[0]), of(self.strides[1])),
            (of(self.sizes[0]), of(self.sizes[1])),
            self.turned,
        )


def height_table(field: HeightField) -> Float[Tensor, "one_more"]:
    """Heights of all pixels of all images, and a last one far below for everything outside.

    Differentiable in: heights.
    """
    held = torch.where(field.seen, field.height, below(field.height)).flatten()
    return torch.cat((held, torch.full_like(held[:1], below(held))))


def columns_met(field: HeightField, across: Tensor, down: Tensor) -> Crossings:
    """Columns; `across` and `down` are pixels for each step of the longer axis."""
    rows, columns = field.height.shape[-2:]
    image, row, column = _places(field)
    return _crossings(image, column, row, across, down, ((1, columns), (columns, rows), 0))


def rows_met(field: HeightField, across: Tensor, down: Tensor) -> Crossings:
    """Rows."""
    rows, columns = field.height.shape[-2:]
    image, row, column = _places(field)
    return _crossings(image, row, column, down, across, ((columns, 1), (rows, columns), 0))


def diagonals_met(field: HeightField, across: Tensor, down: Tensor) -> Crossings:
    """Diagonals from the upper left to the lower right."""
    rows, columns = field.height.shape[-2:]
    image, row, column = _places(field)
    kind = ((1, columns + 1), (columns, rows), 1)
    return _crossings(image, column - row, row, across - down, down, kind)


def longer_met(field: HeightField, across: Tensor, down: Tensor) -> Crossings:
    """Columns or rows, whichever a ray crosses more of."""
    rows, columns = field.height.shape[-2:]
    image, row, column = _places(field)
    wide = across.abs() >= down.abs()

    def either(a: Tensor | int, b: Tensor | int) -> Tensor:
        return torch.where(wide, a, b)

    step = torch.where(wide, across, down).detach().sign()
    kind = (
        (either(1, columns), either(columns, 1)),
        (either(columns, rows), either(rows, columns)),
        0,
    )
    return _crossings(
        image, either(column, row), either(row, column), step, either(down, across), kind
    )


Kind = tuple[tuple[Tensor | int, Tensor | int], tuple[Tensor | int, Tensor | int], int]


def _crossings(
    image: Tensor, whole: Tensor, part: Tensor, rate: Tensor, other: Tensor, kind: Kind
) -> Crossings:
    along = rate == 0
    spacing = torch.where(along, torch.inf, 1 / torch.where(along, 1, rate.abs()))
    slope = torch.where(along, 0, other / torch.where(along, 1, rate.abs()))
    whole, part = whole.expand(rate.shape), part.expand(rate.shape)
    return Crossings(image.expand(rate.shape), whole, rate.sign(), part, slope, spacing, *kind)


def _places(field: HeightField) -> tuple[Tensor, Tensor, Tensor]:
    """First pixel of each image `B 1 1`, row `H 1` and column `W` of each pixel."""
    images, rows, columns = field.height.shape
    device, dtype = field.height.device, field.height.dtype
    image = torch.arange(images, device=device).reshape(-1, 1, 1) * (rows * columns)
    row = torch.arange(rows, device=device, dtype=dtype).unsqueeze(-1)
    return image, row, torch.arange(columns, device=device, dtype=dtype)


def march(
    look: Callable[..., tuple[Tensor, ...]],
    state: tuple[Tensor, ...],
    last: Float[Tensor, "*rays"],
    steps: Crossings,
    held: tuple[Tensor, ...],
    stop: int | None = None,
) -> tuple[Tensor, ...]:
    """`state = look(count, *state, steps, *held)` for the counts 1, 2... of every ray.

    Args:
        look: one step; elementwise in rays.
        state: of every ray.
        last: the last count of every ray that matters.
        steps: crossings of the rays.
        held: what else a step needs, for every ray.
        stop: the state, a truth value, without which a ray has ended.

    Export: compile yes, ONNX yes, as a `Loop` over all rays together.
    """
    last = last.ceil()
    count = torch.ones((), dtype=torch.int64, device=last.device)
    if torch.compiler.is_compiling():
        end = last.max()
        found = while_loop(
            lambda count, *_: count <= end,
            lambda count, *state: (count + 1, *look(count, *state, steps, *held)),
            (count, *(value.contiguous() for value in state)),  # a loop keeps strides
        )
        return tuple(found[1:])
    shape, way = state[0].shape, last.flatten()
    whole = [value.expand(shape).flatten().clone() for value in state]
    rays = (way >= 1).nonzero().squeeze(-1)
    rest, parts = (
        steps.map(lambda v: v.expand(shape).flatten()),
        [v.expand(shape).flatten() for v in held],
    )
    some = [value[rays] for value in whole]
    rest, parts, way = rest.map(_chosen(rays)), [v[rays] for v in parts], way[rays]
    number = 1
    while len(rays):
        for _ in range(SWEEP):
            some = list(look(count * number, *some, rest, *parts))
            number += 1
        going = way >= number
        if stop is not None:
            going = going & some[stop]
        for value, found in zip(whole, some, strict=True):
            value[rays] = found
        kept = going.nonzero().squeeze(-1)
        rays, way, rest = rays[kept], way[kept], rest.map(_chosen(kept))
        some, parts = [v[kept] for v in some], [v[kept] for v in parts]
    return tuple(value.reshape(shape) for value in whole)


def _chosen(rays: Tensor) -> Callable[[Tensor], Tensor]:
    return lambda value: value[rays]
