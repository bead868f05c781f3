"""Images in bands of rows that fit the cache of a processor.

A layer that works pixel by pixel writes a number per pixel in every step of its formula, and
reads it in the next. For a whole image these numbers travel to main memory and back; for a band
of rows they stay in the cache, and their memory serves the next band.

    image -> bands of rows -> formula -> rows of the result

Only where it pays: large images on a processor, without gradients (which keep the numbers of
every step anyway). Graphs are fused by their compiler, and a graphics processor wants few large
launches.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["in_bands"]

#: pixels of a band: a megabyte of float64 for each number of a pixel, shared by all cores
PIXELS = 131_072


def in_bands(
    shade: Callable[..., Float[Tensor, "B C h W"]], *maps: Float[Tensor, "B _ H W"] | None
) -> Float[Tensor, "B C H W"]:
    """shade(*maps), where a pixel of the result depends on that pixel of the maps alone.

    Args:
        shade: the formula, for any number of rows.
        maps: images of one height and width, the first of them for every image of the batch;
            None is passed on.

    Returns:
        The numbers of `shade(*maps)`.

    Differentiable in: maps, and whatever the formula holds.
    Export: compile yes, ONNX yes; a graph holds the formula of whole images.
    """
    first = maps[0]
    assert first is not None
    batch, _, height, width = first.shape
    rows = max(1, PIXELS // max(1, batch * width))
    if height < 2 * rows or torch.is_grad_enabled() or not _plain(maps):
        return shade(*maps)
    whole: Tensor | None = None
    for start in range(0, height, rows):
        band = slice(start, start + rows)
        part = shade(*(None if image is None else image[:, :, band] for image in maps))
        if whole is None:
            whole = part.new_empty(*part.shape[:2], height, width)
        whole[:, :, band] = part
    assert whole is not None
    return whole


def _plain(maps: Sequence[Tensor | None]) -> bool:
    """Ordinary tensors of a processor, outside of a graph that is being made."""
    if torch.compiler.is_compiling():
        return False
    return all(t is None or (type(t) is Tensor and t.device.type == "cpu") for t in maps)
