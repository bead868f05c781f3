"""What every material answers: its BRDF, reflected radiance per irradiance, in 1/sr.

    f_r(wi, wo) = dL_o / dE_i          (the cosine is the shader's)

A material's parameters have shape `*batch channel` (per point, per pixel, or one for all)
and broadcast against directions from the right, so the light axis of an `Arrival` or the
sample axis of a quadrature may stand in front.

References: F. E. Nicodemus et al., NBS Monograph 160 (1977), eq. 3-5.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from torchradiometry.arguments import as_numbers
from torchradiometry.errors import (
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
    require_floating,
)

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AbstractMaterial"]


class AbstractMaterial(nn.Module):
    """A reflecting surface. Subclasses are final; they combine by `SumMaterial`."""

    @abstractmethod
    def forward(
        self,
        incident_direction: Float[Tensor, "*batch 3"],
        outgoing_direction: Float[Tensor, "*batch 3"],
        normal: Float[Tensor, "*batch 3"],
    ) -> Float[Tensor, "*batch channel"]:
        """BRDF in 1/sr, without the cosine; 0 where wi or wo is below the surface."""

    def diffuse_albedo(self) -> Float[Tensor, "*batch channel"] | None:
        """Share reflected alike in all directions, which also answers light without direction.

        None where the material has no such part (a lobe alone).
        """
        return None

    def _hold(
        self,
        name: str,
        value: object,
        learnable: bool,
        *,
        last: int | None = None,
        lowest: float = -math.inf,
        highest: float = math.inf,
    ) -> None:
        """Keep `value` as a parameter or buffer of shape `*batch channel`, checked.

        `last` is the size its last axis must have; `lowest` and `highest` its physical range.
        """
        tensor = as_numbers(name, value)
        if tensor.ndim == 0:
            tensor = tensor.reshape(1)
        if last is not None and tensor.shape[-1] != last:
            raise ShapeError(
                name, f"shape {tuple(tensor.shape)}", f"its last axis holds {last} number(s)"
            )
        check_range(name, tensor.detach(), lowest, highest)
        if learnable:
            self.register_parameter(name, nn.Parameter(tensor.detach().clone()))
        else:
            self.register_buffer(name, tensor)


def check_directions(*directions: Tensor) -> None:
    """Raise `DTypeError` unless incident, outgoing and normal direction are real numbers."""
    names = ("incident_direction", "outgoing_direction", "normal")
    for name, direction in zip(names, directions, strict=True):
        require_floating(name, direction)


def check_range(name: str, value: Tensor, lowest: float, highest: float = math.inf) -> None:
    """Named errors for NaN, infinity and numbers outside the physical range."""
    if not torch.isfinite(value).all():
        raise InvalidValueError(name, "NaN or infinity", "pass finite numbers")
    if (value < lowest).any() or (value > highest).any():
        got = f"values from {value.min().item():g} to {value.max().item():g}"
        mend = f"keep them in {lowest:g}..{highest:g}"
        if highest == math.inf:
            mend = f"pass numbers of at least {lowest:g}"
        raise OutOfRangeError(name, got, mend)
