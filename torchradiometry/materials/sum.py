"""Sum of materials: BRDFs add.

    f_r = sum over k of f_k

References: F. E. Nicodemus et al., NBS Monograph 160 (1977): the BRDF is linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, final

from torch import nn

from torchradiometry.errors import DTypeError, ShapeError
from torchradiometry.materials.base import AbstractMaterial

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

__all__ = ["SumMaterial"]


@final
class SumMaterial(AbstractMaterial):
    """Several materials on one surface; channels broadcast.

    Nothing checks that they reflect less than they receive together: `energy_excess` does.

    Args:
        materials: at least one.

    Raises:
        ShapeError: an empty list.
        DTypeError: a member that is no material.
    """

    def __init__(self, materials: Sequence[AbstractMaterial]) -> None:
        super().__init__()
        if not materials:
            raise ShapeError("materials", "an empty list", "pass at least one material")
        for member in materials:
            if not isinstance(member, AbstractMaterial):
                raise DTypeError("materials", type(member).__name__, "pass materials only")
        self.materials = nn.ModuleList(materials)

    def forward(
        self,
        incident_direction: Float[Tensor, "*batch 3"],
        outgoing_direction: Float[Tensor, "*batch 3"],
        normal: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch channel"]:
        found = [m(incident_direction, outgoing_direction, normal) for m in self.materials]
        return sum(found[1:], start=found[0])

    def diffuse_albedo(self) -> Float[Tensor, "*batch channel"] | None:
        members = [m for m in self.materials if isinstance(m, AbstractMaterial)]
        found = [part for m in members if (part := m.diffuse_albedo()) is not None]
        return sum(found[1:], start=found[0]) if found else None
