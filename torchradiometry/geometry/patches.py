"""Flat patches: triangles or quads, their area, normal and centroid, and their subdivision.

    vector area  S = 1/2 sum_k (c_k - c_0) x (c_k+1 - c_0)      area |S|,  normal S / |S|
    centroid     sum_k a_k g_k / sum_k a_k     over the triangles (c_0, c_k, c_k+1) of the fan,
                                               a_k signed area, g_k mean of the three corners

Corners run counter-clockwise seen from the front. Quads are planar and convex.

References: M. Cohen and J. Wallace, *Radiosity and Realistic Image Synthesis* (1993), ch. 3
(patches and elements).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import (
    InvalidValueError,
    OutOfRangeError,
    ResourceLimitError,
    ShapeError,
    require_axes,
    require_between,
    require_floating,
    require_kind,
)
from torchradiometry.numerics import (
    dot,
    guarded_divide,
    narrow,
    safe_norm,
    safe_normalize,
    single,
)

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["MAX_PATCHES", "Patches", "subdivide", "vector_area"]

#: above this a subdivision is refused: 3 x 4 corners x 8 bytes each is already 1 GB
MAX_PATCHES = 10_000_000
#: m: the fourth power of lengths up to this, and of one over it, is a number of float64
LONGEST = 2.0**255
#: an edge that is a whole multiple of `max_edge` up to this many roundings is not split again
ROUNDINGS = 8


class Patches(NamedTuple):
    """Flat patches that all have the same number of corners.

    Attributes:
        corners: `patch corner 3`, m, counter-clockwise seen from the front.

    >>> square = Patches(torch.tensor([[[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]]))
    >>> square.area, square.centroid
    (tensor([4.]), tensor([[1., 1., 0.]]))
    """

    corners: Float[Tensor, "patch corner 3"]

    # NamedTuple already has a method `count`; patches use it for their number instead.
    @property
    def count(self) -> int:  # type: ignore[override]
        """Number of patches."""
        return self.corners.shape[0]

    @property
    def area(self) -> Float[Tensor, "patch"]:
        """m2; 0 for a degenerate patch."""
        return narrow(safe_norm(_vector_area(self.corners)), self.corners.dtype)

    @property
    def normal(self) -> Float[Tensor, "patch 3"]:
        """Unit normals; zero for a degenerate patch."""
        return safe_normalize(_vector_area(self.corners)).to(self.corners.dtype)

    @property
    def centroid(self) -> Float[Tensor, "patch 3"]:
        """Centres of mass, m; the mean of the corners where the area is 0."""
        require_axes("corners", self.corners, None, 3)
        (corners,) = single(self.corners)
        parts = _fan(corners)
        weight = dot(parts, safe_normalize(parts.sum(-2)).unsqueeze(-2))
        total = weight.sum(-1, keepdim=True)
        mean = torch.ones_like(weight) / weight.shape[-1]
        share = torch.where(total != 0, guarded_divide(weight, total), mean)
        first, second, third = _fan_corners(corners)
        # offsets from the first corner: no digits are lost far from the origin
        offset = ((second - first) + (third - first)) / 3
        middle = corners[..., 0, :] + (share.unsqueeze(-1) * offset).sum(-2)
        return narrow(middle, self.corners.dtype)


def vector_area(corners: Float[Tensor, "*batch corner 3"]) -> Float[Tensor, "*batch 3"]:
    """Area times unit normal of planar polygons, m2.

    Differentiable in: corners.
    Export: compile yes, ONNX yes.

    >>> vector_area(torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    tensor([0.0000, 0.0000, 0.5000])
    """
    return narrow(_vector_area(corners), corners.dtype)


def _vector_area(corners: Tensor) -> Tensor:
    """In float32 at least: products of lengths are beyond half precision."""
    require_axes("corners", corners, None, 3)
    return _fan(*single(corners)).sum(-2)


def _fan_corners(corners: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    return corners[..., :1, :], corners[..., 1:-1, :], corners[..., 2:, :]


def _fan(corners: Tensor) -> Tensor:
    """Vector areas of the triangles (c_0, c_k, c_k+1)."""
    first, second, third = _fan_corners(corners)
    return torch.linalg.cross(second - first, third - first) / 2


def check_patches(patches: Patches, where: str = "patches") -> None:
    """Raise a named error unless patches are triangles or quads of lengths that have an area.

    Raises:
        DTypeError: no `Patches`, or no floating-point numbers.
        ShapeError: other than 3 or 4 corners.
        InvalidValueError: NaN or infinite corners.
        OutOfRangeError: lengths above 2^255 m, or patches below 2^-255 m.
    """
    require_kind(where, patches, Patches, "Patches(corners)")
    corners = patches.corners
    require_floating(where, corners)
    if corners.ndim != 3 or corners.shape[-1] != 3 or corners.shape[-2] not in (3, 4):
        got = f"corners of shape {tuple(corners.shape)}"
        raise ShapeError(where, got, "pass `patch 3 3` triangles or `patch 4 3` quads")
    check_corners(where, corners)


@torch.no_grad()
def check_corners(where: str, corners: Float[Tensor, "patch corner 3"]) -> None:
    """What `check_patches` says of numbers, for polygons of three corners or more."""
    require_axes(where, corners, None, None, 3)
    if corners.shape[-2] < 3:
        raise ShapeError(where, f"polygons of {corners.shape[-2]} corners", "pass 3 or more")
    if not bool(torch.isfinite(corners).all()):
        raise InvalidValueError(where, "NaN or infinite corners", "pass finite corners")
    exact = corners.double()
    far = exact.abs().amax((-1, -2))
    size = (exact - exact[..., :1, :]).abs().amax((-1, -2))
    for length, wrong in ((far, far > LONGEST), (size, (size > 0) & (size < 1 / LONGEST))):
        if bool(wrong.any()):
            got = f"lengths of {float(length[wrong][0]):.3g} m"
            mend = f"pass lengths from {1 / LONGEST:.1g} to {LONGEST:.1g} m"
            raise OutOfRangeError(where, got, mend)


def subdivide(patches: Patches, max_edge: float) -> tuple[Patches, Int[Tensor, "patch"]]:
    """Split patches regularly until no edge is longer than `max_edge`.

    A quad becomes n x m quads (bilinear in its corners), a triangle n^2 similar triangles. The
    parts of a patch follow each other, in the order of their parents, and keep its normal;
    their areas add up to its area.

    Args:
        patches: triangles or planar convex quads.
        max_edge: longest edge allowed, m, > 0.

    Returns:
        The parts, and for each the index of the patch it came from.

    Raises:
        ShapeError: patches with other than 3 or 4 corners.
        InvalidValueError: NaN or infinite corners.
        OutOfRangeError: `max_edge` not a positive finite number, or lengths as of `form_factors`.
        ResourceLimitError: more than `MAX_PATCHES` parts.

    Differentiable in: corners (the number of parts is a constant).
    Export: no; it runs once when a scene is prepared.

    >>> square = Patches(torch.tensor([[[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]]]))
    >>> parts, parent = subdivide(square, 1.0)
    >>> parts.area, parent
    (tensor([1., 1.]), tensor([0, 0]))
    """
    check_patches(patches)
    corners = patches.corners
    require_between("max_edge", max_edge, 0, math.inf, "a length in m, > 0")
    splits = _splits(corners.detach().double(), float(max_edge))
    _require_affordable(splits)
    parts, parents = [], []
    for n, m in torch.unique(splits, dim=0).tolist():
        members = torch.nonzero((splits == splits.new_tensor([n, m])).all(-1)).squeeze(-1)
        split = _split_triangles if corners.shape[-2] == 3 else _split_quads
        pieces = split(corners[members], n, m)
        parts.append(pieces.flatten(0, 1))
        parents.append(members.repeat_interleave(pieces.shape[1]))
    if not parts:
        return patches, torch.zeros(0, dtype=torch.int64, device=corners.device)
    parent, order = torch.sort(torch.cat(parents), stable=True)
    return Patches(torch.cat(parts)[order]), parent


def _splits(corners: Tensor, max_edge: float) -> Tensor:
    """Number of parts along the two directions of each patch (equal for triangles)."""
    edges = safe_norm(corners.roll(-1, -2) - corners)
    if corners.shape[-2] == 3:
        longest = edges.amax(-1, keepdim=True).expand(-1, 2)
    else:
        longest = torch.stack((edges[:, 0::2].amax(-1), edges[:, 1::2].amax(-1)), -1)
    slack = 1 - ROUNDINGS * torch.finfo(torch.float32).eps
    number = torch.ceil(longest / max_edge * slack)
    return torch.nan_to_num(number, nan=1.0, posinf=float(MAX_PATCHES)).clamp(1, MAX_PATCHES).long()


def _require_affordable(splits: Tensor) -> None:
    total = float(splits.double().prod(-1).sum())
    if total > MAX_PATCHES:
        mend = f"raise max_edge; at most {MAX_PATCHES} are made"
        raise ResourceLimitError("subdivide", f"{total:.3g} patches", mend)


def _split_quads(corners: Tensor, n: int, m: int) -> Tensor:
    """`patch (n m) 4 3`: cells of the bilinear grid."""
    u = torch.arange(n + 1, dtype=corners.dtype, device=corners.device) / n
    v = torch.arange(m + 1, dtype=corners.dtype, device=corners.device) / m
    u, v = torch.meshgrid(u, v, indexing="ij")
    weight = torch.stack(((1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v), -1)
    grid = torch.einsum("uvc,pcx->puvx", weight, corners)
    cell = (grid[:, :-1, :-1], grid[:, 1:, :-1], grid[:, 1:, 1:], grid[:, :-1, 1:])
    return torch.stack(cell, -2).flatten(1, 2)


def _split_triangles(corners: Tensor, n: int, _: int) -> Tensor:
    """`patch n^2 3 3`: the upright and the upside-down triangles of the barycentric grid."""
    i, j = torch.meshgrid(*(torch.arange(n, device=corners.device),) * 2, indexing="ij")
    upright, turned = i + j < n, i + j < n - 1
    a, b = i[upright], j[upright]
    c, d = i[turned], j[turned]
    first = torch.stack((a, b, a + 1, b, a, b + 1), -1)
    second = torch.stack((c + 1, d, c + 1, d + 1, c, d + 1), -1)
    st = torch.cat((first, second)).reshape(-1, 3, 2).to(corners.dtype) / n
    weight = torch.cat((1 - st.sum(-1, keepdim=True), st), -1)
    return torch.einsum("kvc,pcx->pkvx", weight, corners)
