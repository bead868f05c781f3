"""Form factors: which share of what leaves a patch reaches another.

    F_ij = 1/(pi A_i) int_i int_j V cos_i cos_j / r^2 dA dA        F[receiver i, emitter j]
    A_i F_ij = A_j F_ji                                             (reciprocity)
    sum_j F_ij = 1 in a closed scene, <= 1 in any                   (closure)

`form_factors` computes the symmetric exchange areas H = A F first (unoccluded: `exchange`;
times visibility: `visibility`; closed or capped: `closure`) and divides by A last, so that
reciprocity holds to rounding whatever was approximated.

Patches are one-sided: their backs are black and block. A two-sided sheet is two patches.

References: M. Cohen and J. Wallace, *Radiosity and Realistic Image Synthesis* (1993), ch. 4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import InvalidValueError, ResourceLimitError, ShapeError
from torchradiometry.geometry.patches import Patches
from torchradiometry.numerics import guarded_divide
from torchradiometry.transport.closure import cap_rows, close_enclosure
from torchradiometry.transport.exchange import NEAR, unoccluded_exchange
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import pair_index
from torchradiometry.transport.visibility import pair_visibility, possible_blockers

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["exchange_areas", "form_factors"]

#: dense `patch patch` float64 matrices that exist at the same time
MATRICES = 6


def form_factors(
    patches: Patches,
    rays: AbstractRayCaster | None = None,
    *,
    closed: bool | Bool[Tensor, "patch"] = False,
    exposure: Float[Tensor, "patch"] | None = None,
    samples: int = 4,
    near: float = NEAR,
    budget: int = 2**32,
    seed: int = 0,
) -> Float[Tensor, "patch patch"]:
    """F[receiver, emitter] of one-sided patches, reciprocal by construction.

    Args:
        patches: triangles or planar convex quads, m.
        rays: what blocks; None if nothing does (one convex room, or separate facing plates).
        closed: the patches enclose a space; rows are scaled to sum to 1. A mask marks the
            patches that see nothing but patches; the other rows are only kept at most 1 (where
            that pulls one down, its neighbours' rows end just below 1).
        exposure: share of each patch that is not buried in another body, 0..1; F refers to
            the exposed area. None: all of it.
        samples: shadow segments per pair; four times as many in penumbras.
        near: pairs nearer than this many sums of radii use the contour integral.
        budget: bytes that may be allocated.
        seed: of the shadow segments.

    Returns:
        0..1, `receiver emitter`; rows of degenerate or wholly buried patches are 0.

    Raises:
        ShapeError: not triangles or quads.
        InvalidValueError: NaN corners.
        ResourceLimitError: the matrices would not fit into `budget`.
        NotConvergedError: `closed`, but no scaling closes the patches.

    Differentiable in: corners (visibility is detached: shadow boundaries do not move).
    Export: no (the count of near pairs depends on the data); the solvers take F as an input.
    References: Cohen and Wallace (1993), ch. 4.

    >>> floor = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]).double()
    >>> ceiling = floor.flip(0) + torch.tensor([0, 0, 1.0])
    >>> F = form_factors(Patches(torch.stack([floor, ceiling])))
    >>> round(float(F[0, 1]), 3)  # opposite faces of a cube
    0.2
    """
    exchange, area = exchange_areas(
        patches,
        rays,
        closed=closed,
        exposure=exposure,
        samples=samples,
        near=near,
        budget=budget,
        seed=seed,
    )
    return guarded_divide(exchange, area.unsqueeze(1)).to(patches.corners.dtype)


def exchange_areas(
    patches: Patches,
    rays: AbstractRayCaster | None = None,
    *,
    closed: bool | Bool[Tensor, "patch"] = False,
    exposure: Float[Tensor, "patch"] | None = None,
    samples: int = 4,
    near: float = NEAR,
    budget: int = 2**32,
    seed: int = 0,
) -> tuple[Float[Tensor, "patch patch"], Float[Tensor, "patch"]]:
    """H = A F (symmetric, m2) and the exposed areas A (m2), both float64.

    Arguments and errors as of `form_factors`.
    """
    _check(patches, budget)
    area = patches.area.to(torch.float64)
    if exposure is not None:
        area = area * exposure.to(area)
    exchange = unoccluded_exchange(patches, near)
    if rays is not None:
        exchange = exchange * _visibility(patches, rays, exchange, samples, seed)
    if isinstance(closed, Tensor):
        exchange = cap_rows(close_enclosure(exchange, area, closed), area)
    else:
        exchange = close_enclosure(exchange, area) if closed else cap_rows(exchange, area)
    return exchange, area


def _check(patches: Patches, budget: int) -> None:
    corners = patches.corners
    if corners.ndim != 3 or corners.shape[1] not in (3, 4) or corners.shape[2] != 3:
        raise ShapeError(
            "patches", f"corners of shape {tuple(corners.shape)}", "pass triangles or quads"
        )
    if not bool(torch.isfinite(corners.detach()).all()):
        raise InvalidValueError("patches", "NaN or infinite corners", "pass finite corners")
    needed = MATRICES * 8 * patches.count**2
    if needed > budget:
        raise ResourceLimitError(
            "form_factors",
            f"{patches.count} patches, which need {needed} bytes of {budget}",
            "use larger patches, or raise `budget`",
        )


@torch.no_grad()
def _visibility(
    patches: Patches, rays: AbstractRayCaster, exchange: Tensor, samples: int, seed: int
) -> Float[Tensor, "patch patch"]:
    corners = patches.corners.detach().to(torch.float64)
    points = corners.reshape(-1, 3)
    visibility = torch.ones_like(exchange)
    blockers = possible_blockers(rays.corners.to(points.device), points, rays.tolerance)
    if not bool(blockers.any()):
        return visibility
    i, j = pair_index(patches.count, exchange.detach() > 0)
    value = pair_visibility(Patches(corners), rays, i, j, samples, seed)
    visibility[i, j] = visibility[j, i] = value.to(exchange)
    return visibility
