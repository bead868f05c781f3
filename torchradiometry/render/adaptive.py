"""Patches as small as reflected light asks for.

    e_i = A_i rho_i ( |E_i - mean of the vertices around| + spread_i ) / pi
    error of the picture  ~  sum_i e_i / sum_i A_i rho_i E_total,i / pi

Light that varies linearly is interpolated without error; what a patch's value differs from the
mean of its three vertices, each the mean of the patches around it, measures how much it bends
(shadow edges, contacts, creases). `spread_i` is what direct light varies inside a patch, times
the share that a neighbour sees of it: constant radiosity misses it. The patches with
the largest e are split in four, those that hold `MARKED` of the sum, and all is solved again,
until the sum meets the target or there are as many patches as a matrix in the budget can hold.

References: D. Lischinski, F. Tampieri and D. Greenberg, "Combining Hierarchical Radiosity and
Discontinuity Meshing", SIGGRAPH 1993; W. Doerfler, "A Convergent Adaptive Algorithm for
Poisson's Equation", SIAM J. Numer. Anal. 33 (1996) (marking by a share of the sum).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide
from torchradiometry.render.importance import EVERYWHERE, Visits, backwards
from torchradiometry.render.indirect import (
    Exchange,
    Indirect,
    exchange_between,
    first_patches,
    solve_exchange,
)
from torchradiometry.render.lattice import spread
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.subdivision import Subdivision, find, refine
from torchradiometry.render.world import World
from torchradiometry.transport.form_factors import MATRICES

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["adaptive_exchange", "patch_errors"]

#: share of the estimated error whose patches are split in one round
MARKED = 0.7
#: rounds at most
ROUNDS = 8
#: patches of a flat or smooth part of a surface that show how light bends there
FEWEST = 8
#: share of its own variation of direct light that a patch passes on to what is near it
PASSED = 0.1


def adaptive_exchange(
    world: World, settings: RenderSettings, seen: Visits | None = None
) -> Exchange:
    """Patches of one size, or split until `settings.patch_error` is met.

    Args:
        world: a prepared scene.
        settings: size, error and budget of the patches.
        seen: what a camera looks at; patches are then split where it shows. None: everything
            counts by its area.

    Raises:
        ResourceLimitError: already the first patches exceed the budget.
    """
    patches = first_patches(world, settings, seen)
    if settings.patch_error is None:
        return exchange_between(world, patches, settings)
    for _ in range(ROUNDS):
        few = _too_few(world, patches)
        if not bool(few.any()):
            break
        patches = refine(patches, few)
    exchange = exchange_between(world, patches, settings)
    for _ in range(ROUNDS):
        error = _estimate(world, exchange, settings, seen)
        if float(error.sum()) <= settings.patch_error:
            break
        chosen = _marked(error, settings)
        if not bool(chosen.any()):
            break
        exchange = exchange_between(world, refine(exchange.subdivision, chosen), settings)
    return exchange


def _too_few(world: World, patches: Subdivision) -> Bool[Tensor, "patch"]:
    """Patches of parts of surfaces that have too few of them to show how light bends."""
    part = world.parts[patches.face]
    reflects = (world.triangles.reflectance > 0).any(-1)[world.faces.triangle[patches.face]]
    return (torch.bincount(part)[part] < FEWEST) & reflects


@torch.no_grad()
def _estimate(
    world: World, exchange: Exchange, settings: RenderSettings, seen: Visits | None
) -> Float[Tensor, "patch"]:
    triangles = type(world.triangles)(*(t.detach() for t in world.triangles))
    return patch_errors(world, solve_exchange(world, exchange, triangles, settings), seen)


@torch.no_grad()
def patch_errors(
    world: World, indirect: Indirect, seen: Visits | None = None
) -> Float[Tensor, "patch"]:
    """What each patch adds to the relative L1 error of the picture, estimated.

    Arguments as of `adaptive_exchange`.
    """
    exchange = indirect.exchange
    area = exchange.patches.area * exchange.exposure.share
    value = indirect.irradiance
    slope = _slopes(exchange, indirect.values)
    around = spread(slope.flatten(1), area, exchange.welding)
    jump = (slope - around[exchange.welding.corner].mean(1).reshape(slope.shape)).norm(dim=1)
    bend = exchange.patches.area.sqrt().unsqueeze(-1) * jump
    glow = world.glow(world.triangles)
    direct = exchange.lamps + exchange.weights @ glow
    free = exchange.exposure.free.to(value).unsqueeze(-1)
    inside = (exchange.points @ glow - (exchange.weights @ glow).unsqueeze(1)).abs()
    varies = (inside * free).sum(1) / free.sum(1).clamp(min=1)
    weight = _importance(world, exchange, area, seen).unsqueeze(-1) * indirect.albedo
    total = (weight * (direct + value)).sum()
    found = weight * (bend + PASSED * indirect.albedo * varies)
    return found.sum(-1) / torch.where(total > 0, total, 1)


def _importance(
    world: World,
    exchange: Exchange,
    area: Float[Tensor, "patch"],
    seen: Visits | None,
) -> Float[Tensor, "patch"]:
    """How much a patch counts: by its area, and by how much of the picture comes from it."""
    share = area / area.sum()
    if seen is None or len(seen.weight) == 0:
        return share
    points, weight = backwards(world, seen)
    patch, _ = find(exchange.subdivision, points.face, points.on_face(world))
    found = torch.zeros_like(area).index_add(0, patch, weight.to(area))
    return guarded_divide(found, found.sum().expand_as(found)) + EVERYWHERE * share


def _slopes(
    exchange: Exchange, values: Float[Tensor, "vertex channel"]
) -> Float[Tensor, "patch 3 channel"]:
    """Gradient of the interpolated field on each patch, W/m2 per m."""
    a, b, c = exchange.patches.corners.unbind(1)
    normal = torch.linalg.cross(b - a, c - a)
    square = (normal * normal).sum(-1, keepdim=True)
    across = torch.stack([torch.linalg.cross(normal, edge) for edge in (c - b, a - c, b - a)], 1)
    slopes = guarded_divide(across, square.unsqueeze(-1))
    return torch.einsum("pkx,pkc->pxc", slopes, values[exchange.welding.corner])


def _marked(error: Float[Tensor, "patch"], settings: RenderSettings) -> Bool[Tensor, "patch"]:
    """The fewest patches that hold `MARKED` of the error; their matrix would fit the budget."""
    order = error.argsort(descending=True)
    before = error[order].cumsum(0) - error[order]
    most = int((settings.budget / (8 * MATRICES)) ** 0.5)
    count = min(int((before < MARKED * error.sum()).sum()), (most - len(error)) // 3)
    chosen = torch.zeros_like(error, dtype=torch.bool)
    chosen[order[: max(count, 0)]] = True
    return chosen & (error > 0)
