"""Albedo textures: bilinear look-up at points, and the mean over triangles.

    texel centres lie at ((i + 1/2) / width, 1 - (j + 1/2) / height), column i, row j from the top

References: glTF 2.0 specification, sections 3.8.3 and 3.8.4 (textures and samplers).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from torchradiometry.scene.surface import Texture

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["sample_texture", "triangle_means"]

#: samples along one edge of a triangle when its mean colour is taken; a finer texture is first
#: averaged down to this many texels per triangle
EDGE_SAMPLES = 32
#: look-ups made at once while means are taken, to bound memory
CHUNK = 2**20


def sample_texture(
    texture: Texture, coordinates: Float[Tensor, "*batch 2"]
) -> Float[Tensor, "*batch channel"]:
    """Bilinear look-up in the linear picture.

    Differentiable in: the image; the coordinates (piecewise, kinks at texel centres).

    >>> image = torch.tensor([[[0.0], [1.0]]])
    >>> picture = Texture(image, torch.zeros(1, 2), wrap=("clamp", "clamp"))
    >>> sample_texture(picture, torch.tensor([[0.25, 0.5], [0.5, 0.5], [1.0, 0.5]]))
    tensor([[0.0000],
            [0.5000],
            [1.0000]])
    """
    height, width, _ = texture.image.shape
    column, row = coordinates[..., 0] * width - 0.5, (1 - coordinates[..., 1]) * height - 0.5
    left, top = column.detach().floor(), row.detach().floor()
    right_share, lower_share = (column - left).unsqueeze(-1), (row - top).unsqueeze(-1)
    columns = [_wrapped(left + k, width, texture.wrap[0]) for k in (0, 1)]
    rows = [_wrapped(top + k, height, texture.wrap[1]) for k in (0, 1)]
    image = texture.image
    upper = torch.lerp(image[rows[0], columns[0]], image[rows[0], columns[1]], right_share)
    lower = torch.lerp(image[rows[1], columns[0]], image[rows[1], columns[1]], right_share)
    return torch.lerp(upper, lower, lower_share)


def _wrapped(index: Tensor, size: int, wrap: str) -> Tensor:
    """Texel indices 0..size-1 of any integer positions (as floats; NaN counts as 0)."""
    index = torch.nan_to_num(index, nan=0.0, posinf=0.0, neginf=0.0)
    if wrap == "clamp":
        return index.clamp(0, size - 1).long()
    if wrap == "repeat":
        return index.remainder(size).clamp(max=size - 1).long()
    folded = index.remainder(2 * size)
    return torch.minimum(folded, 2 * size - 1 - folded).clamp(0, size - 1).long()


def triangle_means(texture: Texture, faces: Int[Tensor, "face 3"]) -> Float[Tensor, "face channel"]:
    """Mean colour of the texture over each face.

    Midpoint rule on a regular barycentric grid with about one sample per texel; a picture with
    more than `EDGE_SAMPLES` texels along a triangle is first averaged down.

    Differentiable in: the image.
    """
    corners = texture.coordinates[faces]
    samples, texture = _resolution(texture, corners)
    weight = _grid(samples, corners)
    means = [
        sample_texture(texture, torch.einsum("kc,fcx->fkx", weight, part)).mean(1)
        for part in corners.split(max(1, CHUNK // len(weight)))
    ]
    return torch.cat(means) if means else corners.new_zeros(0, texture.image.shape[-1])


def _resolution(texture: Texture, corners: Tensor) -> tuple[int, Texture]:
    """Samples per edge for the largest triangle, and the picture reduced to match."""
    height, width, _ = texture.image.shape
    size = torch.tensor([width, height], dtype=corners.dtype, device=corners.device)
    spans = (corners.amax(-2) - corners.amin(-2)) * size
    longest = float(torch.nan_to_num(spans.detach(), posinf=0.0).max()) if len(corners) else 0.0
    shrink = int(min(longest, width, height) // EDGE_SAMPLES)
    if shrink > 1:
        planes = texture.image.permute(2, 0, 1).unsqueeze(0)
        reduced = functional.interpolate(
            planes, (max(1, height // shrink), max(1, width // shrink)), mode="area"
        )
        image = reduced.squeeze(0).permute(1, 2, 0)
        texture = Texture(image, texture.coordinates, texture.wrap)
    return max(1, min(EDGE_SAMPLES, int(longest) + 1)), texture


def _grid(n: int, like: Tensor) -> Tensor:
    """Barycentric centroids of the n^2 parts of a triangle, `n^2 3`."""
    i, j = torch.meshgrid(*(torch.arange(n, device=like.device),) * 2, indexing="ij")
    upright, turned = i + j < n, i + j < n - 1
    first = torch.stack((i[upright], j[upright]), -1).to(like.dtype) + 1 / 3
    second = torch.stack((i[turned], j[turned]), -1).to(like.dtype) + 2 / 3
    st = torch.cat((first, second)) / n
    return torch.cat((1 - st.sum(-1, keepdim=True), st), -1)
