"""What training minimises, and what it reports.

    chord    |n - n*| = 2 sin(angle / 2)      minimised: like the angle, but with a smooth end
    angle    acos(n . n*) in degrees          reported, as in the benchmarks

The chord grows with the angle itself and not with its square, so a few hopeless pixels (deep
shadow) do not outweigh the rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.numerics import angle_of, dot, guarded_divide, safe_norm

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["angle_degrees", "chord_loss"]


def chord_loss(
    normal: Float[Tensor, "*batch 3"],
    truth: Float[Tensor, "*batch 3"],
    weight: Float[Tensor, "*batch"] | None = None,
) -> Float[Tensor, ""]:
    """Weighted mean of |n - n*| of unit normals.

    Args:
        normal: unit.
        truth: unit.
        weight: >= 0, for example the mask; None counts every pixel.

    Returns:
        0 (equal) to 2 (opposite); 0 where no pixel counts.

    Differentiable in: normal, truth, weight; gradient 0 where they are equal.
    Export: compile yes, ONNX yes.

    >>> up, right = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([1.0, 0.0, 0.0])
    >>> chord_loss(up, right)
    tensor(1.4142)
    """
    chord = safe_norm(normal - truth)
    if weight is None:
        return chord.mean()
    return guarded_divide((chord * weight).sum(), weight.sum())


def angle_degrees(
    normal: Float[Tensor, "*batch 3"], truth: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch"]:
    """Angle between two directions in degrees, from the cross product: exact at 0 and 180.

    Differentiable in: both; gradient 0 where they are parallel.
    Export: compile yes, ONNX yes.

    >>> angle_degrees(torch.tensor([0.0, 0.0, 2.0]), torch.tensor([0.0, 3.0, 3.0]))
    tensor(45.)
    """
    sine = safe_norm(torch.linalg.cross(normal, truth))
    return torch.rad2deg(angle_of(sine, dot(normal, truth)))
