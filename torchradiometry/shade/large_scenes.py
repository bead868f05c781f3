"""Radiosity of large scenes: patches in, an operator out that no dense matrix stands behind.

    patches, blockers -> links between clusters (transport) -> F as a product (solve)

What `form_factors` does for some thousand patches, for many: unoccluded exchange, visibility,
closing. Measured up to 300,000 patches (`python -m tests.benchmarks.scale --larger`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import require_between
from torchradiometry.geometry.patches import Patches
from torchradiometry.solve.hierarchical_operator import HierarchicalOperator
from torchradiometry.transport.closure import capping_scale, closing_scale
from torchradiometry.transport.exchange_links import exchange_links
from torchradiometry.transport.links import Refinement
from torchradiometry.transport.rays import AbstractRayCaster

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["hierarchical_operator"]

#: relative L1 error of the radiosity that rooms with blockers were measured to keep
TOLERANCE = 0.005


def hierarchical_operator(
    patches: Patches,
    rays: AbstractRayCaster | None = None,
    *,
    closed: bool | Bool[Tensor, "patch"] = False,
    exposure: Float[Tensor, "patch"] | None = None,
    tolerance: float = TOLERANCE,
    budget: int = 2**33,
    seed: int = 0,
) -> HierarchicalOperator:
    """F of one-sided patches as an operator for the solvers, for up to 300,000 patches.

    Args:
        patches: triangles or planar convex quads, m.
        rays: what blocks; None if nothing does.
        closed: the patches enclose a space; rows are scaled to sum to 1. A mask marks the
            patches that see nothing but patches; the others are only kept at most 1.
        exposure: share of each patch that is not buried in another body, 0..1; F refers to
            the exposed area. None: all of it.
        tolerance: relative error of the radiosity to aim at, summed over the scene (L1).
        budget: bytes that may be allocated.
        seed: of the shadow segments.

    Returns:
        F in float64. Rows of degenerate or wholly buried patches are 0.

    Raises:
        ShapeError, InvalidValueError: patches that are none.
        OutOfRangeError: a tolerance that is not positive.
        ResourceLimitError: it would not fit into `budget`.
        NotConvergedError: `closed`, but no scaling closes the patches.

    Differentiable in: nothing (corners are detached; albedo and exitance are the solver's).
    Export: no.

    >>> square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> facing = square.flip(0) + torch.tensor([0.0, 0, 1])
    >>> F = hierarchical_operator(Patches(torch.stack([square, facing])))
    >>> F(torch.tensor([[1.0], [0.0]])).T.round(decimals=3)  # opposite faces of a cube
    tensor([[0.0000, 0.2000]], dtype=torch.float64)
    """
    require_between("tolerance", tolerance, 0, 1, "a share, 0 < tolerance < 1")
    links = exchange_links(patches, rays, _limits(tolerance), budget=budget, seed=seed)
    fields = links._asdict()
    full = fields.pop("area")
    area = full if exposure is None else full * exposure.detach().to(full)
    unscaled = HierarchicalOperator(
        area=area, full_area=full, scale=torch.ones_like(full), **fields
    )

    def product(x: Tensor) -> Tensor:
        return unscaled.exchange(x.unsqueeze(-1)).squeeze(-1)

    row = product(torch.ones_like(area))
    scale = torch.ones_like(area)
    enclosed = closed if isinstance(closed, Tensor) else torch.full_like(row > 0, closed)
    chosen = (row > 0) & enclosed.to(row.device)
    if bool(chosen.any()):
        scale = closing_scale(product, torch.where(chosen, area, 0))
    if not bool(chosen.all()):
        scale = capping_scale(product, area, scale)
    return HierarchicalOperator(area=area, full_area=full, scale=scale, **fields)


def _limits(tolerance: float) -> Refinement:
    """The limits that were measured to keep `tolerance`."""
    part = tolerance / TOLERANCE
    return Refinement(error=1.4e-4 * part, shadow=3e-3 * part, penumbra=3e-4 * part)
