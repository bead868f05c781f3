"""What training minimises, and what it reports.

    chord           |n - n*| = 2 sin(angle / 2)      like the angle, but with a smooth end
    albedo          mean |log(a / a*)|               both relative to their mean on the object
    rendering       mean |s L - I| / mean I          the photograph I explained by a layer's L
    integrability   n_z^2 |dp/dy - dq/dx|            slopes p = -n_x / n_z, q = -n_y / n_z
    angle           acos(n . n*) in degrees          reported, as in the benchmarks

The chord grows with the angle itself and not with its square, so a few hopeless pixels (deep
shadow) do not outweigh the rest. The rendering loss needs no true normals: L comes from any layer
of `shade`, local or global, for each image the cheapest that its plan allows (`DepthPlanner`).
The slopes of a surface have no curl; n_z^2 takes its pole at the outline away.

References: B. K. P. Horn and M. J. Brooks, "The variational approach to shape from shading", CVGIP
33 (1986) (integrability); R. T. Frankot and R. Chellappa, TPAMI 10 (1988).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import require_axes
from torchradiometry.numerics import (
    alike,
    angle_of,
    dot,
    guarded_divide,
    narrow,
    safe_norm,
    safe_normalize,
    single,
)

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["albedo_loss", "angle_degrees", "chord_loss", "integrability_loss", "rendering_loss"]

#: albedo, relative to its mean, below which differences count less
DARK = 0.02


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
    require_axes("normal", normal, 3)
    require_axes("truth", truth, 3)
    dtype = torch.promote_types(normal.dtype, truth.dtype)
    normal, truth = single(normal, truth)
    chord = safe_norm(normal - truth)
    if weight is None:
        return guarded_divide(chord.sum(), torch.ones_like(chord).sum()).to(dtype)
    require_axes("weight", weight)
    (weight,) = single(weight)
    return narrow(guarded_divide((chord * weight).sum(), weight.sum()), dtype)


def albedo_loss(
    albedo: Float[Tensor, "B C H W"],
    truth: Float[Tensor, "B C H W"],
    mask: Float[Tensor, "B 1 H W"],
) -> Float[Tensor, ""]:
    """Mean |log(a + d) - log(a* + d)| over the mask, d = `DARK`.

    Args:
        albedo: >= 0 (below, it counts as 0); where its scale is unknown, relative to its mean on
            the object.
        truth: the same.
        mask: >= 0, weight of each pixel.

    Returns:
        0 where they are equal or no pixel counts.

    Differentiable in: all; the kink at equality has gradient 0.
    Export: compile yes, ONNX yes.

    >>> paint = torch.full((1, 3, 2, 2), 0.5)
    >>> albedo_loss(paint, paint, torch.ones(1, 1, 2, 2))
    tensor(0.)
    """
    require_axes("albedo", albedo, None, None, None, None)
    require_axes("truth", truth, None, None, None, None)
    require_axes("mask", mask, None, 1, None, None)
    low, high = torch.minimum(albedo, truth).relu(), torch.maximum(albedo, truth).relu()
    # |log| of a quotient, without the difference of two logarithms
    missed = torch.log1p((high - low) / (low + DARK)).mean(1, keepdim=True)
    return guarded_divide((missed * mask).sum(), mask.sum())


def rendering_loss(
    radiance: Float[Tensor, "B C H W"],
    image: Float[Tensor, "B C H W"],
    mask: Float[Tensor, "B 1 H W"],
    *,
    exposed: bool = True,
) -> Float[Tensor, ""]:
    """How far a rendered image is from a photograph: mean |s L - I| / mean I over the mask.

    Args:
        radiance: L, what a layer shades.
        image: I, linear.
        mask: >= 0, weight of each pixel.
        exposed: the photograph's exposure is unknown: s is the least-squares scale of each
            image; otherwise s = 1.

    Returns:
        0 where the photograph is explained; 1 for a black rendering; 0 where no pixel counts.

    Differentiable in: all; the kink at equality has gradient 0.
    Export: compile yes, ONNX yes.

    >>> photograph = torch.rand(1, 3, 4, 4)
    >>> rendering_loss(2 * photograph, photograph, torch.ones(1, 1, 4, 4)) < 1e-6
    tensor(True)
    """
    require_axes("radiance", radiance, None, None, None)
    require_axes("image", image, None, None, None)
    require_axes("mask", mask, 1, None, None)
    axes, dtype = (-3, -2, -1), torch.promote_types(radiance.dtype, image.dtype)
    radiance, image, mask = single(radiance, image, mask)
    if exposed:
        common = (mask * radiance * image).sum(axes, keepdim=True)
        scale = guarded_divide(common, (mask * radiance * radiance).sum(axes, keepdim=True))
        radiance = radiance * scale
    missed = (mask * (radiance - image).abs()).sum(axes)
    missed = guarded_divide(missed, (mask * image.abs()).sum(axes))
    return narrow(guarded_divide(missed.sum(), torch.ones_like(missed).sum()), dtype)


def integrability_loss(
    normal: Float[Tensor, "B 3 H W"], mask: Float[Tensor, "B 1 H W"]
) -> Float[Tensor, ""]:
    """Mean of n_z^2 |curl of the slopes| over 2 x 2 pixels that lie on the object, per pixel.

    Args:
        normal: unit, x right, y up, z to the camera.
        mask: 1 on the object.

    Returns:
        0 for normals of a surface, up to the finite differences; 0 where no 2 x 2 pixels count.

    Differentiable in: normal; the kink at 0 has gradient 0.
    Export: compile yes, ONNX yes.

    >>> slanted = torch.tensor([0.6, 0.0, 0.8]).reshape(1, 3, 1, 1).expand(1, 3, 5, 5)
    >>> integrability_loss(slanted, torch.ones(1, 1, 5, 5))
    tensor(0.)
    """
    require_axes("normal", normal, None, 3, None, None)
    require_axes("mask", mask, None, 1, None, None)
    dtype = normal.dtype
    normal, mask = single(normal, mask)
    right, upwards = normal.diff(dim=-1), -normal.diff(dim=-2)
    across = (right[..., 1:, :] + right[..., :-1, :]) / 2
    up = (upwards[..., 1:] + upwards[..., :-1]) / 2
    pairs = normal[..., 1:, :] + normal[..., :-1, :]
    middle = (pairs[..., 1:] + pairs[..., :-1]) / 4
    inside = torch.minimum(mask[:, 0, 1:, :], mask[:, 0, :-1, :])
    inside = torch.minimum(inside[..., 1:], inside[..., :-1])
    x, y, z = middle.unbind(1)
    # n_z^2 dp/dy = n_x dn_z/dy - n_z dn_x/dy, and the same for dq/dx
    curl = (x * up[:, 2] - z * up[:, 0]) - (y * across[:, 2] - z * across[:, 1])
    return narrow(guarded_divide((curl.abs() * inside).sum(), inside.sum()), dtype)


def angle_degrees(
    normal: Float[Tensor, "*batch 3"], truth: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch"]:
    """Angle between two directions in degrees, from the cross product: exact at 0 and 180.

    Differentiable in: both; gradient 0 where they are parallel.
    Export: compile yes, ONNX yes.

    >>> angle_degrees(torch.tensor([0.0, 0.0, 2.0]), torch.tensor([0.0, 3.0, 3.0]))
    tensor(45.)
    """
    require_axes("normal", normal, 3)
    require_axes("truth", truth, 3)
    dtype = torch.promote_types(normal.dtype, truth.dtype)
    normal, truth = (safe_normalize(t) for t in alike(*single(normal, truth)))
    sine = safe_norm(torch.linalg.cross(normal, truth))
    return torch.rad2deg(angle_of(sine, dot(normal, truth))).to(dtype)
