"""Flat convex pieces in a ragged list: cutting them at planes, subtracting cones from them.

    rest_0 = piece,    out_m = rest_(m-1) with h_m < 0,    rest_m = rest_(m-1) with h_m >= 0

h_m is the height over plane m. The planes of a convex cone cut a piece into what lies inside all
of them, rest_k, and at most k convex parts outside, out_1 ... out_k: piece minus cone.

Components and corners come first, `3 corner piece`, which computes fast. A piece with fewer
corners than the list is wide repeats its last one. Sides are told apart with a `margin`: what
is thinner than it is no part of its own; but cuts are computed from the true heights, so that
they move with their gradients.

References: I. E. Sutherland and G. W. Hodgman, "Reentrant Polygon Clipping", CACM 17 (1974);
K. Weiler and P. Atherton, SIGGRAPH 1977 (what is left of one polygon behind another).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["joined", "split", "subtract"]


def split(
    piece: Float[Tensor, "3 corner piece"], height: Float[Tensor, "corner piece"], margin: float
) -> tuple[
    Float[Tensor, "3 corner_below below"],
    Int[Tensor, "below"],
    Float[Tensor, "3 corner_above above"],
    Int[Tensor, "above"],
]:
    """The parts below and above a plane, and which piece each belongs to.

    Args:
        piece: convex, m.
        height: of its corners over a plane, m.
        margin: a part that does not reach farther from the plane is left out, and the other is
            the whole piece, m.

    Differentiable in: piece, height.
    """
    value = height.detach()
    below, above = value.amin(0) < -margin, value.amax(0) > margin
    above = above | ~below
    both = torch.nonzero(below & above).squeeze(-1)
    down, up = (torch.nonzero(w).squeeze(-1) for w in (below & ~above, above & ~below))
    if len(both) == 0:
        return piece[..., down], down, piece[..., up], up
    cut_piece, cut_height = piece[..., both], height[:, both]
    inside = cut_height.detach() >= -margin
    crossing = inside != inside.roll(-1, 0)
    following = cut_piece.roll(-1, 1)
    fall = torch.where(crossing, cut_height - cut_height.roll(-1, 0), 0)
    cut = cut_piece + guarded_divide(cut_height, fall) * (following - cut_piece)
    slots = torch.stack((cut_piece, cut), 2).flatten(1, 2)
    lower, upper = (_kept(slots, torch.stack((s, crossing), 1)) for s in (~inside, inside))
    return (
        joined([piece[..., down], lower]),
        torch.cat((down, both)),
        joined([piece[..., up], upper]),
        torch.cat((up, both)),
    )


def _kept(
    slots: Float[Tensor, "3 slot piece"], kept: Bool[Tensor, "corner 2 piece"]
) -> Float[Tensor, "3 corner piece"]:
    """The kept slots moved together, the last one repeated."""
    kept = kept.flatten(0, 1)
    count = kept.sum(0)
    width = int(count.max())
    place = torch.where(kept, kept.cumsum(0) - 1, width)
    number = torch.arange(len(kept), device=kept.device).unsqueeze(1).expand_as(place)
    source = number.new_zeros(width + 1, place.shape[1]).scatter_(0, place, number)
    column = torch.arange(width, device=kept.device).unsqueeze(1)
    source = source.gather(0, torch.minimum(column, count - 1))
    return slots.gather(1, source.expand(3, -1, -1))


def joined(lists: list[Float[Tensor, "3 _ _"]]) -> Float[Tensor, "3 corner piece"]:
    """Lists of pieces as one list, as wide as the widest of them."""
    filled = [pieces for pieces in lists if pieces.shape[2]]
    if len(filled) < 2:
        return filled[0] if filled else lists[0]
    width = max(pieces.shape[1] for pieces in filled)
    padded = [
        torch.cat((p, p[:, -1:].expand(-1, width - p.shape[1], -1)), 1) if p.shape[1] < width else p
        for p in filled
    ]
    return torch.cat(padded, 2)


def subtract(
    piece: Float[Tensor, "3 corner piece"], planes: Float[Tensor, "3 plane piece"], margin: float
) -> tuple[Float[Tensor, "3 corner part"], Int[Tensor, "part"]]:
    """What of each piece lies outside the convex cone of its planes, and whose part it is.

    Args:
        piece: convex, seen from the origin, m.
        planes: unit normals of planes through the origin, that point into the cone. A zero
            normal bounds nothing.
        margin: as of `split`.

    Returns:
        Parts, m; a piece that the cone misses stays in one piece.

    Differentiable in: piece, planes.
    """
    rest, owner = piece, torch.arange(piece.shape[2], device=piece.device)
    outside, owners = [], []
    for plane in planes.unbind(1):
        height = (plane[:, owner].unsqueeze(1) * rest).sum(0)
        out, below, rest, above = split(rest, height, margin)
        outside.append(out)
        owners.append(owner[below])
        owner = owner[above]
    hit = torch.zeros(piece.shape[2], dtype=torch.bool, device=piece.device)
    hit[owner] = True
    whole = torch.nonzero(~hit).squeeze(-1)
    kept = [torch.nonzero(hit[o]).squeeze(-1) for o in owners]
    parts = [piece[..., whole], *(p[..., k] for p, k in zip(outside, kept, strict=True))]
    return joined(parts), torch.cat((whole, *(o[k] for o, k in zip(owners, kept, strict=True))))
