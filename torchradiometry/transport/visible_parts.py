"""What a point sees of a polygon behind convex planar blockers, exactly, by clipping.

    shadow on the polygon  =  { p :  m_k . (p - x) >= 0  for all k },
    m_k = +- (b_k - x) x (b_k+1 - x)          planes through the point x and the blocker's edges
    visible part           =  polygon - shadow_1 - shadow_2 - ...

Only the part of a blocker between the point and the polygon's plane can hide anything. It is cut
out first: the slab 0 <= n . (q - x) <= n . (p - x) with the polygon's normal n. Seen along a
ray from x, n . (q - x) is the share of the way to the polygon, so the cone over the cut
blocker meets the polygon's plane in exactly the shadow, also where the blocker reaches beside
or behind the point.

A convex polygon minus a convex cone is at most one convex piece for each edge of the blocker.
Blockers are subtracted one after the other from a ragged list of pieces: in each round every
point subtracts the next of its own blockers, the ones that cover most first. The irradiance of
the visible part is the sum of Lambert's contour integral over the pieces: no noise, and shadow
boundaries that move with their gradients.

Nothing is closer than `margin`: a blocker whose plane holds the point, or that lies on the
polygon's plane, hides nothing.

References: P. Atherton, K. Weiler and D. Greenberg, "Polygon Shadow Generation", SIGGRAPH 1978;
J. Arvo, "The Irradiance Jacobian for Partially Occluded Polyhedral Sources", SIGGRAPH 1994.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.arguments import broadcast_shape
from torchradiometry.errors import ShapeError, require_axes
from torchradiometry.geometry.patches import vector_area
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.numerics import (
    dot,
    guarded_divide,
    safe_norm,
    safe_normalize,
    wide,
)
from torchradiometry.transport.blockers import possible_blockers
from torchradiometry.transport.convex_pieces import joined, split, subtract

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["VisibleParts", "blockers_between", "visible_irradiance", "visible_polygon"]

#: views that are taken at a time, and numbers that the search for their blockers may hold
VIEWS, BLOCK = 2**13, 2**21
#: default margin, in roundings of the largest coordinate
ROUNDINGS = 2**8


class VisibleParts(NamedTuple):
    """Convex pieces of polygons.

    Attributes:
        corners: `piece corner 3`, m, in the sense of the polygon; the last one may repeat.
        view: the point and polygon that a piece belongs to.
    """

    corners: Float[Tensor, "piece corner 3"]
    view: Int[Tensor, "piece"]


class _Views(NamedTuple):
    """Points that look at polygons; lengths in m, float64."""

    position: Float[Tensor, "view 3"]
    normal: Float[Tensor, "view 3"]  #: of the receiver; 0 if both its sides look
    polygon: Float[Tensor, "view corner 3"]
    facing: Float[Tensor, "view 3"]  #: of the polygon's plane, pointing away from the point
    depth: Float[Tensor, "view"]  #: distance of that plane

    def chosen(self, index: Int[Tensor, "chosen"]) -> _Views:
        """Some of the views."""
        return _Views(*(tensor[index] for tensor in self))


def visible_irradiance(
    position: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    polygon: Float[Tensor, "*batch corner 3"],
    blockers: Float[Tensor, "blocker side 3"],
    *,
    two_sided: bool = False,
    margin: float | None = None,
    rounding: float | None = None,
) -> Float[Tensor, "*batch"]:
    """Irradiance by a polygon of unit radiance behind convex blockers, exact, per point.

    E = int over the visible part of cos cos / r^2 dA = sum over its pieces of `polygon_irradiance`

    Args:
        position: the receivers, m.
        normal: of the receivers, unit.
        polygon: planar, convex, m, counter-clockwise seen from the emitting side. Batch axes
            broadcast: `point 1 3` with `emitter corner 3` gives `point emitter`.
        blockers: planar, convex, in either sense, m; corners may repeat (triangles among
            quads, see `convex_blockers`). The emitters and the receiver's own surface may be
            among them. Both sides block.
        two_sided: both sides of the polygon shine.
        margin: what is closer to a blocker's plane does not see it, m. None: 256 roundings of the
            largest coordinate.
        rounding: as of `polygon_irradiance`.

    Returns:
        W/m2 for 1 W/m2/sr.

    Raises:
        ShapeError: not polygons.

    Differentiable in: all four (kinks where a shadow's edge meets an edge of the polygon or of
        another shadow).
    Export: no, the number of pieces depends on the data.
    References: Atherton, Weiler and Greenberg (1978); Arvo (1994).

    >>> panel = torch.tensor([[1.0, -1, 2], [-1, -1, 2], [-1, 1, 2], [1, 1, 2]])
    >>> screen = torch.tensor([[[0.0, -9, 1], [9, -9, 1], [9, 9, 1], [0, 9, 1]]])
    >>> x, up = torch.zeros(3), torch.tensor([0.0, 0, 1])
    >>> visible_irradiance(x, up, panel, screen) / polygon_irradiance(x, up, panel)
    tensor(0.5000)
    """
    require_axes("position", position, 3)
    require_axes("normal", normal, 3)
    require_axes("polygon", polygon, None, 3)
    require_axes("blockers", blockers, None, None, 3)
    dtype = torch.promote_types(position.dtype, polygon.dtype)
    # the margin is a length: heights over the horizon are lengths for unit normals only
    (given,) = wide(normal)
    unit = safe_normalize(given)
    views, screens, margin = _prepared(position, unit, polygon, blockers, margin)
    shape = _shape(position, normal, polygon)
    found = [
        _irradiance(views.chosen(block), screens, margin, two_sided, rounding)
        for block in _blocks(views, screens)
    ]
    return (torch.cat(found).reshape(shape) * dot(given, unit)).to(dtype)


def _irradiance(
    views: _Views, blockers: Tensor, margin: float, two_sided: bool, rounding: float | None
) -> Float[Tensor, "view"]:
    """`visible_irradiance` of a block of views."""
    whole = polygon_irradiance(views.position, views.normal, views.polygon, two_sided, rounding)
    lit = torch.nonzero(whole.detach() > 0).squeeze(-1)
    if len(blockers) == 0 or len(lit) == 0:
        return whole
    pieces, view, affected = _pieces(views.chosen(lit), blockers, margin)
    centre = torch.zeros_like(pieces[:, 0]).mT
    normal, corners = views.normal[lit[view]], pieces.permute(2, 1, 0)
    part = polygon_irradiance(centre, normal, corners, two_sided, rounding)
    seen = torch.zeros_like(whole[lit]).index_add(0, view, part)
    return whole.index_put((lit[affected],), seen[affected])


def visible_polygon(
    position: Float[Tensor, "*batch 3"],
    polygon: Float[Tensor, "*batch corner 3"],
    blockers: Float[Tensor, "blocker side 3"],
    *,
    margin: float | None = None,
) -> VisibleParts:
    """The part of a planar convex polygon that a point sees behind convex blockers.

    Args:
        position: m.
        polygon: planar, convex, m; batch axes broadcast.
        blockers, margin: as of `visible_irradiance`.

    Returns:
        Convex pieces without overlap; `view` counts the (broadcast, flattened) batch. A polygon
        seen edge-on is returned whole. Nothing is cut at a horizon.

    Differentiable in: all (the pieces' number is constant between kinks).
    Export: no, the number of pieces depends on the data.
    References: Atherton, Weiler and Greenberg (1978).

    >>> panel = torch.tensor([[1.0, -1, 2], [-1, -1, 2], [-1, 1, 2], [1, 1, 2]])
    >>> screen = torch.tensor([[[0.0, -9, 1], [9, -9, 1], [9, 9, 1], [0, 9, 1]]])
    >>> visible_polygon(torch.zeros(3), panel, screen).corners.unique(dim=1)
    tensor([[[-1., -1.,  2.],
             [-1.,  1.,  2.],
             [ 0., -1.,  2.],
             [ 0.,  1.,  2.]]])
    """
    require_axes("position", position, 3)
    require_axes("polygon", polygon, None, 3)
    require_axes("blockers", blockers, None, None, 3)
    dtype = torch.promote_types(position.dtype, polygon.dtype)
    anywhere = torch.zeros_like(position)
    views, screens, margin = _prepared(position, anywhere, polygon, blockers, margin)
    found, owner = [], []
    for block in _blocks(views, screens):
        pieces, view, affected = _pieces(views.chosen(block), screens, margin)
        free = block[~affected]
        seen = pieces + views.position[block[view]].mT.unsqueeze(1)
        found += [views.polygon[free].permute(2, 1, 0), seen]
        owner += [free, block[view]]
    corners, view = joined(found), torch.cat(owner)
    order = view.argsort(stable=True)
    return VisibleParts(corners[..., order].permute(2, 1, 0).to(dtype), view[order])


@torch.no_grad()
def blockers_between(
    position: Float[Tensor, "*batch 3"],
    normal: Float[Tensor, "*batch 3"],
    polygon: Float[Tensor, "*batch corner 3"],
    blockers: Float[Tensor, "blocker side 3"],
) -> Int[Tensor, "*batch"]:
    """How many blockers may come between a point and a polygon that lights it; 0 if it does not.

    Arguments as of `visible_irradiance`.
    """
    views, screens, margin = _prepared(position, normal, polygon, blockers, None)
    lit = polygon_irradiance(views.position, views.normal, views.polygon) > 0
    found = [_between(views.chosen(b), screens, margin).sum(-1) for b in _blocks(views, screens)]
    shape = _shape(position, normal, polygon)
    return (torch.cat(found) * lit).reshape(shape)


def _shape(position: Tensor, normal: Tensor, polygon: Tensor) -> torch.Size:
    """The axes of points and polygons together."""
    leading = position.shape[:-1], normal.shape[:-1], polygon.shape[:-2]
    return broadcast_shape("position, normal, polygon", *leading)


def _prepared(
    position: Tensor,
    normal: Tensor,
    polygon: Tensor,
    blockers: Tensor,
    margin: float | None,
) -> tuple[_Views, Tensor, float]:
    """Flat float64 views, the blockers with an area, and the margin in m."""
    for name, tensor in (("polygon", polygon), ("blockers", blockers)):
        if tensor.ndim < 2 or tensor.shape[-2] < 3 or tensor.shape[-1] != 3:
            raise ShapeError(name, f"shape {tuple(tensor.shape)}", "pass `... corner 3`, 3 or more")
    if blockers.ndim != 3:
        raise ShapeError("blockers", f"shape {tuple(blockers.shape)}", "pass `blocker side 3`")
    if margin is None:
        # half precision is storage: its roundings would be larger than what is between the faces
        dtype = torch.promote_types(
            torch.promote_types(position.dtype, polygon.dtype), torch.float32
        )
        largest = [
            float(t.detach().abs().max()) for t in (position, polygon, blockers) if t.numel()
        ]
        margin = ROUNDINGS * torch.finfo(dtype).eps * max([*largest, 0.0])
    shape = _shape(position, normal, polygon)
    x, up = (t.expand(*shape, 3).reshape(-1, 3) for t in wide(position, normal))
    corners = wide(polygon)[0].expand(*shape, -1, -1).reshape(-1, polygon.shape[-2], 3)
    facing = safe_normalize(vector_area(corners))
    depth = dot(facing, corners[:, 0] - x)
    side = torch.where(depth.detach() < 0, -1.0, 1.0)
    facing, depth = facing * side.unsqueeze(-1), depth * side
    screens = wide(blockers)[0]
    around = torch.cat([t.detach().reshape(-1, 3) for t in wide(position, polygon)])
    screens = screens[possible_blockers(screens, around, margin)]
    return _Views(x, up, corners, facing, depth), screens, margin


def _blocks(views: _Views, blockers: Tensor) -> tuple[Int[Tensor, "block"], ...]:
    """Indices of the views, at least one block of them."""
    numbers = (views.polygon.shape[1] + 2) * max(1, blockers.shape[0] * blockers.shape[1])
    every = torch.arange(len(views.position), device=blockers.device)
    return every.split(max(1, min(VIEWS, BLOCK // numbers)))


def _pieces(
    views: _Views, blockers: Tensor, margin: float
) -> tuple[Float[Tensor, "3 corner piece"], Int[Tensor, "piece"], Bool[Tensor, "view"]]:
    """Visible pieces seen from each point, whose they are, and which views lost something.

    Views without blockers have no pieces here.
    """
    view, blocker = torch.nonzero(_between(views, blockers, margin), as_tuple=True)
    view, planes = _cones(views, view, blockers[blocker], margin)
    affected = torch.zeros(len(views.position), dtype=torch.bool, device=view.device)
    affected[view] = True
    owner = torch.nonzero(affected).squeeze(-1)
    seen = views.polygon[owner] - views.position[owner].unsqueeze(1)
    pieces = seen.permute(2, 1, 0)
    for turn, own in _turns(view, len(affected)):
        chosen = turn[owner] >= 0
        rest, busy = (torch.nonzero(c).squeeze(-1) for c in (~chosen, chosen))
        cone = planes[..., own][..., turn[owner[busy]]]
        left, whose = subtract(pieces[..., busy], cone, margin)
        pieces = joined([pieces[..., rest], left])
        owner = torch.cat((owner[rest], owner[busy[whose]]))
    return pieces, owner, affected


def _turns(view: Int[Tensor, "pair"], views: int) -> list[tuple[Tensor, Tensor]]:
    """For each round r the view's r-th pairs, and every view's place among them (-1: none)."""
    if len(view) == 0:
        return []
    order = view.argsort(stable=True)
    count = torch.bincount(view, minlength=views)
    rank = torch.arange(len(view), device=view.device) - (count.cumsum(0) - count)[view[order]]
    rounds = []
    for number in range(int(count.max())):
        own = order[rank == number]
        place = torch.full((views,), -1, device=view.device)
        place[view[own]] = torch.arange(len(own), device=view.device)
        rounds.append((place, own))
    return rounds


@torch.no_grad()
def _between(views: _Views, blockers: Tensor, margin: float) -> Bool[Tensor, "view blocker"]:
    """False where a blocker is surely not between a point and its polygon."""
    middle = blockers.reshape(-1, 3).mean(0)
    flat = (blockers - middle).transpose(0, 1).reshape(-1, 3).mT
    x = views.position - middle
    face = safe_normalize(vector_area(blockers))
    offset = dot(face, blockers[:, 0] - middle)
    possible = (x @ face.mT - offset).abs() > margin
    sides = _cone(views.polygon - views.position.unsqueeze(1))
    normals = torch.cat((views.facing.unsqueeze(1), views.normal.unsqueeze(1), sides), 1)
    height = normals @ flat - dot(normals, x.unsqueeze(1)).unsqueeze(-1)
    height = height.unflatten(-1, (blockers.shape[1], -1))
    some = (height.amax(-2) > margin) | (normals == 0).all(-1).unsqueeze(-1)
    before = height[:, 0].amin(-2) < (views.depth - margin).unsqueeze(-1)
    return possible & some.all(1) & before & (views.depth > margin).unsqueeze(-1)


def _cone(seen: Float[Tensor, "view corner 3"]) -> Float[Tensor, "view corner 3"]:
    """Inward normals of the planes through the point and the polygon's edges."""
    area = vector_area(seen)
    side = torch.where(dot(area, seen[:, 0]) < 0, -1.0, 1.0)
    return safe_normalize(torch.linalg.cross(seen, seen.roll(-1, 1))) * side[:, None, None]


def _cones(
    views: _Views, view: Int[Tensor, "pair"], blockers: Float[Tensor, "pair side 3"], margin: float
) -> tuple[Int[Tensor, "hit"], Float[Tensor, "3 plane hit"]]:
    """Views whose polygon a blocker's cone meets, and the cone's planes.

    Ordered so that blockers that cover more come first.
    """
    seen = (blockers - views.position[view].unsqueeze(1)).permute(2, 1, 0)
    area = vector_area(blockers)
    side = dot(area, seen[:, 0].mT).detach().sign()
    every = torch.arange(len(view), device=view.device)
    for near in (True, False):
        share = (views.facing[view[every]].mT.unsqueeze(1) * seen).sum(0)
        height = share if near else views.depth[view[every]] - share
        _, _, seen, above = split(seen, height, 0.0)
        every = every[above]
    planes = _edge_planes(seen) * side[every]
    own = view[every]
    polygon = (views.polygon[own] - views.position[own].unsqueeze(1)).detach().permute(2, 1, 0)
    height = torch.einsum("xkp,xcp->kcp", planes.detach(), polygon)
    bounds = (planes.detach() != 0).any(0)
    meets = ((height.amax(1) > margin) | ~bounds).all(0) & (bounds.sum(0) > 1)
    covered = (height >= -margin).double().mean(1).mean(0)
    hit = torch.nonzero(meets).squeeze(-1)
    hit = hit[covered[hit].argsort(descending=True, stable=True)]
    return own[hit], planes[..., hit]


def _edge_planes(seen: Float[Tensor, "3 corner pair"]) -> Float[Tensor, "3 corner pair"]:
    """Unit normals of the planes through the origin and each edge; 0 where the edge is a point."""
    following = seen.roll(-1, 1)
    cross = torch.linalg.cross(seen, following, dim=0)
    length = safe_norm(cross.movedim(0, -1))
    reach = (seen * seen).sum(0).sqrt() * (following * following).sum(0).sqrt()
    small = length <= ROUNDINGS * torch.finfo(seen.dtype).eps * reach
    return guarded_divide(cross, torch.where(small, 0, length).expand_as(cross))
