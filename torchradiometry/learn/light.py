"""Light from one image of a surface that is known: nine spherical harmonics.

A matt surface under light from afar sends, in each channel c of the image,

    I_c(p) = rho_c(p) / pi  sum_k A_k Y_k(n_p) L_kc,      k = 1..9

(Ramamoorthi and Hanrahan 2001): linear in the light L. With normals and paint from a network, or
from anywhere, the light is weighted least squares over the pixels of the mask,

    sum_p w_p (I_c(p) - I*_c(p))^2  +  r t sum_k l_k (l_k + 1) (A_k L_kc)^2  ->  min

The second sum is the mean square slope of the irradiance over the sphere of normals (l = 0, 1, 2 is
the order of a harmonic), and t the mean of the diagonal of the system for the unknowns A_k L_kc, so
that r has no unit: of all lights that explain the image nearly as well, the one whose irradiance
varies least is taken. A flat object is explained by even light.

Shadows, highlights and errors of the normals are no part of the law. Weights are found in rounds,
from the residual d of a pixel, all channels together, and its median m over the object (at least
2^-12 of the image's mean):

    w = 1 / (1 + (d / 3 m)^2)^2        (Geman and McClure)

Where the nine ring below zero a surface is black (`HarmonicSource`): a black pixel of which no less
is predicted says nothing more.

References: R. Ramamoorthi and P. Hanrahan, "An Efficient Representation for Irradiance Environment
Maps", SIGGRAPH 2001, eq. 9; R. Basri and D. Jacobs, "Lambertian Reflectance and Linear Subspaces",
PAMI 25 (2003); S. Geman and D. McClure, "Statistical methods for tomographic image reconstruction",
Bull. Int. Stat. Inst. 52 (1987).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import OutOfRangeError, ShapeError, require_axes
from torchradiometry.numerics import guarded_divide, wide
from torchradiometry.sources.harmonics import cosine_coefficients, harmonic_basis

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["estimate_light"]

#: r: on the half ball that a camera sees, the smallest of the nine eigenvalues is 0.003 of their
#: mean, so this moves what it shows by some parts in a million
RIDGE = 2.0**-26
#: l (l + 1) of each of the nine
SLOPE = (0.0, *(2.0,) * 3, *(6.0,) * 5)
#: the residual that counts a quarter, in medians, and the smallest median, of the image's mean:
#: below the noise of cameras, above what the ridge leaves unexplained
DOUBT, EXACT = 3.0, 2.0**-12


def estimate_light(
    image: Float[Tensor, "B C H W"],
    normal: Float[Tensor, "B 3 H W"],
    albedo: Float[Tensor, "B C H W"],
    mask: Float[Tensor, "B 1 H W"],
    rounds: int = 10,
    ridge: float = RIDGE,
) -> Float[Tensor, "B 9 C"]:
    """The light under which a surface looks like the image, by robust least squares.

    Args:
        image: linear radiance, W/m2/sr, or any unit: the light has the same.
        normal: unit, x right, y up, z to the camera.
        albedo: >= 0, one channel or C; relative to its mean (`ShadingNetwork`) gives the light
            relative to that.
        mask: >= 0, the weight of each pixel; what the others hold does not matter.
        rounds: of weights; 0 is plain least squares. Ten see through shadows on a quarter of the
            object, also where they hang together.
        ridge: r, >= 0, how much evenness is worth; 0.01 for normals and albedo of a network.

    Returns:
        L_kc, W/m2/sqrt(sr): `HarmonicSource(light.unsqueeze(1))` shines it. 0 where the mask is
        empty or image or albedo black.

    Raises:
        ShapeError: wrong axes.
        OutOfRangeError: a negative number of rounds or ridge.

    Differentiable in: image, normal, albedo and mask; the weights of rounds are taken as given.
    Export: compile yes; ONNX no, it has no linear solve.
    References: see the module.

    >>> normal = torch.nn.functional.normalize(torch.randn(1, 3, 16, 16), dim=1)
    >>> white = torch.ones(1, 1, 16, 16)
    >>> light = estimate_light(2 * torch.ones_like(normal), normal, white, white)
    >>> (light[0, 0] / (2 * math.sqrt(math.pi))).round(decimals=3)  # radiance from everywhere
    tensor([2., 2., 2.])
    """
    require_axes("image", image, None, None, None, None)
    require_axes("normal", normal, None, 3, None, None)
    require_axes("albedo", albedo, None, None, None, None)
    require_axes("mask", mask, None, 1, None, None)
    _check(image, normal, albedo, mask, rounds, ridge)
    inside = mask > 0
    clean = (torch.where(inside, part, 0) for part in (image, normal, albedo, mask))
    seen, facing, paint, weight = (part.flatten(2) for part in wide(*clean))
    shading = harmonic_basis(facing.mT) / math.pi
    paint, trust = paint.expand_as(seen), weight.expand_as(seen)
    for _ in range(rounds):
        with torch.no_grad():
            predicted = paint * (shading @ _solved(seen, shading, paint, trust, ridge)).mT
            agreed = _trusted(seen, predicted, weight > 0)
        trust = weight * agreed
    found = _solved(seen, shading, paint, trust, ridge)
    return (found / cosine_coefficients(found).unsqueeze(-1)).to(image.dtype)


def _solved(
    seen: Float[Tensor, "B C pixel"],
    shading: Float[Tensor, "B pixel 9"],
    paint: Float[Tensor, "B C pixel"],
    trust: Float[Tensor, "B C pixel"],
    ridge: float,
) -> Float[Tensor, "B 9 C"]:
    """The nine of the irradiance, A_k L_k, of each channel."""
    held = (trust * paint).unsqueeze(-1) * shading.unsqueeze(1)
    gram = held.mT @ (paint.unsqueeze(-1) * shading.unsqueeze(1))
    right = held.mT @ seen.unsqueeze(-1)
    mean = gram.diagonal(dim1=-2, dim2=-1).mean(-1)[..., None, None]
    slope = torch.tensor(SLOPE, dtype=gram.dtype, device=gram.device).diag()
    # of nothing that shines or is seen, nothing is known: 0
    gram = gram / torch.where(mean > 0, mean, 1) + ridge * slope
    gram = torch.where(mean > 0, gram, torch.eye(9, dtype=gram.dtype, device=gram.device))
    right = guarded_divide(right, mean)
    return torch.linalg.solve_ex(gram, right)[0].squeeze(-1).mT


def _trusted(
    seen: Float[Tensor, "B C pixel"],
    predicted: Float[Tensor, "B C pixel"],
    inside: Bool[Tensor, "B 1 pixel"],
) -> Float[Tensor, "B C pixel"]:
    """w of each pixel; 0 in a channel that is black and predicted to be."""
    missed = (seen - predicted.clamp(min=0)).norm(dim=1, keepdim=True)
    usual = torch.where(inside, missed, torch.nan).nanmedian(-1, keepdim=True).values
    level = torch.where(inside, seen.norm(dim=1, keepdim=True), 0).mean(-1, keepdim=True)
    usual = torch.maximum(usual.nan_to_num(), EXACT * level)
    doubt = guarded_divide(missed, DOUBT * usual)
    black = (predicted <= 0) & (seen <= usual)
    return torch.where(black, 0, (1 + doubt.square()) ** -2)


def _check(
    image: Tensor, normal: Tensor, albedo: Tensor, mask: Tensor, rounds: int, ridge: float
) -> None:
    if image.ndim != 4:
        raise ShapeError("image", f"shape {tuple(image.shape)}", "pass B x C x H x W")
    count, channels, *size = image.shape
    for name, part, wanted in (
        ("normal", normal, (3,)),
        ("albedo", albedo, (1, channels)),
        ("mask", mask, (1,)),
    ):
        fits = part.ndim == 4 and part.shape[0] in (1, count) and part.shape[1] in wanted
        if not fits or list(part.shape[2:]) != size:
            got = f"shape {tuple(part.shape)} beside an image of {tuple(image.shape)}"
            raise ShapeError(name, got, f"pass {count} x {wanted[-1]} x {size[0]} x {size[1]}")
    if rounds < 0 or ridge < 0:
        raise OutOfRangeError("rounds, ridge", f"{rounds}, {ridge}", "pass 0 or more")
