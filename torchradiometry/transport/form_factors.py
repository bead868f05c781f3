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

from torchradiometry.errors import (
    DegenerateGeometryError,
    DTypeError,
    InvalidValueError,
    OutOfRangeError,
    ResourceLimitError,
    ShapeError,
    require_between,
    require_kind,
    require_whole,
)
from torchradiometry.geometry.patches import Patches, check_patches
from torchradiometry.numerics import guarded_divide, safe_norm, wide
from torchradiometry.transport.closure import cap_rows, close_enclosure
from torchradiometry.transport.exchange import RTOL, unoccluded_exchange
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import pair_index
from torchradiometry.transport.visibility import pair_visibility, possible_blockers

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["exchange_areas", "form_factors"]

#: dense `patch patch` float64 matrices that exist at the same time
MATRICES = 6
#: how far corners of a quad may lie from a plane, in sizes, besides their rounding
PLANAR = 2.0**-17


def form_factors(
    patches: Patches,
    rays: AbstractRayCaster | None = None,
    *,
    closed: bool | Bool[Tensor, "patch"] = False,
    exposure: Float[Tensor, "patch"] | None = None,
    samples: int = 4,
    rtol: float = RTOL,
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
        rtol: relative error of every unoccluded pair, 1e-12...0.1.
        budget: bytes that may be allocated.
        seed: of the shadow segments.

    Returns:
        0..1, `receiver emitter`; rows of degenerate or wholly buried patches are 0.

    Raises:
        ShapeError: not triangles or quads; a mask or exposure that has not one value a patch.
        DTypeError: no `Patches`, no ray caster, samples or a seed that are no whole numbers.
        InvalidValueError: NaN corners.
        DegenerateGeometryError: quads that are not planar, or crossed, or not convex.
        OutOfRangeError: `rtol` not between 0 and 1, no samples, exposure outside 0..1, lengths
            above 2^255 m or patches below 2^-255 m, whose areas would be no numbers.
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
        rtol=rtol,
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
    rtol: float = RTOL,
    budget: int = 2**32,
    seed: int = 0,
) -> tuple[Float[Tensor, "patch patch"], Float[Tensor, "patch"]]:
    """H = A F (symmetric, m2) and the exposed areas A (m2), both float64.

    Arguments and errors as of `form_factors`.
    """
    _check(patches, rtol, budget)
    _check_options(patches, rays, closed, exposure, samples, seed)
    area = Patches(patches.corners.to(torch.float64)).area
    if exposure is not None:
        area = area * exposure.to(area)
    exchange = unoccluded_exchange(patches, rtol)
    if rays is not None:
        exchange = exchange * _visibility(patches, rays, exchange, samples, seed)
    if isinstance(closed, Tensor):
        exchange = cap_rows(close_enclosure(exchange, area, closed), area)
    else:
        exchange = close_enclosure(exchange, area) if closed else cap_rows(exchange, area)
    return exchange, area


def _check_options(
    patches: Patches,
    rays: AbstractRayCaster | None,
    closed: bool | Tensor,
    exposure: Tensor | None,
    samples: int,
    seed: int,
) -> None:
    """What is not the patches themselves."""
    if rays is not None:
        require_kind("rays", rays, AbstractRayCaster, "ray caster, such as EmbreeRays(triangles)")
    require_whole("samples", samples, 1, 2**16)
    require_kind("seed", seed, int, "whole number")
    if not isinstance(closed, bool):
        _require_one_each("closed", closed, patches.count)
    if exposure is None:
        return
    _require_one_each("exposure", exposure, patches.count)
    if not bool(torch.isfinite(exposure.detach()).all()):
        raise InvalidValueError("exposure", "NaN or infinity", "pass shares, 0...1")
    if not bool(((exposure >= 0) & (exposure <= 1)).all()):
        raise OutOfRangeError("exposure", "values outside 0..1", "pass the share that lies free")


def _require_one_each(name: str, values: object, count: int) -> None:
    if not isinstance(values, Tensor):
        raise DTypeError(name, f"{values!r}", f"pass a tensor of {count} values")
    if values.shape != (count,):
        got = f"shape {tuple(values.shape)} for {count} patches"
        raise ShapeError(name, got, "pass one value for each patch")


def _check(patches: Patches, rtol: float, budget: int) -> None:
    check_patches(patches)
    require_between("rtol", rtol, 0, 1, "a relative error such as 1e-10 or 1e-3")
    needed = MATRICES * 8 * patches.count**2
    if needed > budget:
        raise ResourceLimitError(
            "form_factors",
            f"{patches.count} patches, which need {needed} bytes of {budget}",
            "use larger patches or `hierarchical_operator`, or raise `budget`",
        )
    if patches.corners.shape[1] == 4:
        _check_quads(patches.corners.detach())


@torch.no_grad()
def _check_quads(corners: Float[Tensor, "patch 4 3"]) -> None:
    """Refuse quads that are bent, or whose corners do not all turn the same way."""
    exact = wide(corners)[0]
    offset = exact - exact[:, :1]
    size = offset.abs().amax((1, 2))
    allowed = size * PLANAR + exact.abs().amax((1, 2)) * torch.finfo(corners.dtype).eps * 8
    edge = offset.roll(-1, 1) - offset
    turn = torch.linalg.cross(edge.roll(1, 1), edge)
    # twice the volume of the corners' tetrahedron over their area: how far they leave a plane
    normal = torch.linalg.cross(offset[:, 2], offset[:, 3] - offset[:, 1])
    volume = (offset[:, 1:] * normal.unsqueeze(1)).sum(-1).abs().amax(1)
    height = guarded_divide(volume, safe_norm(normal))
    agree = torch.einsum("pkx,plx->pkl", turn, turn).amin((1, 2))
    crossed, bent = agree < -((allowed * size) ** 2), height > allowed
    for bad, what in ((crossed, "crossed or not convex"), (bent, "not planar")):
        if bool(bad.any()):
            first = int(bad.int().argmax())
            got = f"{int(bad.sum())} quads that are {what}, the first of them patch {first}"
            raise DegenerateGeometryError("patches", got, "split quads into triangles")


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
    weight = exchange.detach()[i, j]
    value = pair_visibility(Patches(corners), rays, i, j, samples, seed, weight).visibility
    visibility[i, j] = visibility[j, i] = value.to(exchange)
    return visibility
