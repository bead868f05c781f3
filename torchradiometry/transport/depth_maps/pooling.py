"""Maps to a grid of cells and back: means over cells, and values between cell centres.

    mean_i = sum_j o_ij x_j / sum_j o_ij,    o_ij = overlap of pixel j with cell i

row by row and column by column, so that any number of cells fits any size. Back at the pixels,
values are linear between the centres of cells and constant beyond the outermost. Masked pixels
have no weight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.image_space import pixel_axis

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["Grid", "grid_over"]


class Grid(NamedTuple):
    """Cells over a picture, and the pixel at the middle of each.

    Attributes:
        down, across: overlap of each cell with each pixel, as a share of the cell.
        back_down, back_across: share of each cell at each pixel.
        middle: row * width + column of the pixel in the middle of each cell.
        cell_of: the cell of each pixel, and one more number for everything outside.
        spacing: pixels from one cell to the next along the axis where that is most.
    """

    down: Float[Tensor, "row H"]
    across: Float[Tensor, "column W"]
    back_down: Float[Tensor, "H row"]
    back_across: Float[Tensor, "W column"]
    middle: Int[Tensor, "cell"]
    cell_of: Int[Tensor, "one_more"]
    spacing: Float[Tensor, ""]

    def means(self, image: Float[Tensor, "*batch H W"]) -> Float[Tensor, "*batch row column"]:
        """Means over the cells, masked pixels being 0."""
        return self.down @ image @ self.across.mT

    def at_pixels(self, cells: Float[Tensor, "*batch row column"]) -> Float[Tensor, "*batch H W"]:
        """Values between the centres of cells."""
        return self.back_down @ (cells @ self.back_across.mT)


def grid_over(size: tuple[int, int], cells: tuple[int, int], like: Tensor) -> Grid:
    """A grid of `cells` (rows, columns) over a picture of height and width `size`.

    Export: compile yes, ONNX yes; the size may stay dynamic.
    """
    down, across = (_along(pixel_axis(n, like), m) for n, m in zip(size, cells, strict=True))
    middle = down.middle.unsqueeze(-1) * size[1] + across.middle
    cell_of = down.cell_of.unsqueeze(-1) * cells[1] + across.cell_of
    outside = torch.full_like(cell_of.flatten()[:1], cells[0] * cells[1])
    return Grid(
        down.overlap,
        across.overlap,
        down.back,
        across.back,
        middle.flatten(),
        torch.cat((cell_of.flatten(), outside)),
        torch.maximum(down.spacing, across.spacing),
    )


class _Axis(NamedTuple):
    overlap: Float[Tensor, "cell pixel"]
    back: Float[Tensor, "pixel cell"]
    middle: Int[Tensor, "cell"]
    cell_of: Int[Tensor, "pixel"]
    spacing: Float[Tensor, ""]


def _along(centre: Float[Tensor, "pixel"], cells: int) -> _Axis:
    """The grid along one axis with pixels at `centre`."""
    length = (centre[-1] + 0.5) / cells
    cell = torch.arange(cells, dtype=centre.dtype, device=centre.device)
    first = cell.unsqueeze(-1) * length
    end = torch.minimum(centre + 0.5, first + length)
    overlap = (end - torch.maximum(centre - 0.5, first)).clamp(min=0) / length
    place = (centre / length - 0.5).clamp(0, cells - 1).unsqueeze(-1)
    middle = ((cell + 0.5) * length).floor().to(torch.int64)
    cell_of = (centre / length).floor().to(torch.int64)
    return _Axis(overlap, (1 - (place - cell).abs()).clamp(min=0), middle, cell_of, length)
