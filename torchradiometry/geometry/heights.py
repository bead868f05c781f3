"""Normals -> heights: the surface whose normals they are, as nearly as there is one.

A camera that looks along -z from afar sees pixels of side p. The step between two neighbours is
at right angles to the mean m of their normals,

    m_x p + m_z (h_right - h) = 0,      -m_y p + m_z (h_below - h) = 0,      m = (n + n_next) / 2

which is exact for planes and for spheres, of whatever size, and otherwise up to the third power of
p. Normals that were estimated are those of no surface; the heights are least squares,

    sum over pairs of (m_x p + m_z (h_right - h))^2 + (-m_y p + m_z (h_below - h))^2  ->  min

Poisson's equation with natural borders: nothing is said about heights at the mask's edge. A pair is
heard as m_z^2, so the steep rim of an object, where slopes are large and doubtful, says little.

*Breaks.* Where one part hides another the surface jumps, and no normal tells by how much; the mean
of the two normals is that of neither. There each pixel speaks for itself, ahead and behind, and
holds to the side on which the steps are smaller (Cao et al. 2022):

    sum over pixels of  t (n_x p + n_z (h_next - h))^2 + (1 - t) (n_x p + n_z (h - h_last))^2,

    t = sigmoid(2 (b^2 - a^2)),     a = n_z (h_next - h) / p,     b = n_z (h - h_last) / p

and the same for columns; beyond the mask's edge steps are 0. t follows from the heights, and the
heights from t, in rounds. Steps well below a pixel hardly move t: they are bridged as before.

References: B. K. P. Horn and M. J. Brooks, "The variational approach to shape from shading", CVGIP
33 (1986) (least squares); X. Cao, H. Santo, B. Shi, F. Okura and Y. Matsushita, "Bilateral Normal
Integration", ECCV 2022 (breaks); Y. Queau, J.-D. Durou and J.-F. Aujol, "Normal Integration: A
Survey", J. Math. Imaging Vis. 60 (2018) (natural borders).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from torchradiometry.errors import (
    OutOfRangeError,
    ShapeError,
    require_floating,
)
from torchradiometry.geometry.grid_springs import (
    ENOUGH,
    ROUGHLY,
    Springs,
    pieces,
    relaxed,
    steps_of,
    without_mean,
)
from torchradiometry.numerics import wide

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["Heights", "normals_to_heights"]

#: m_z below which a pair is taken as edge-on: slopes of up to 2^7 are told apart
EDGE_ON = 2.0**-7
#: how sharply a pixel chooses its side, and what is left of the side that it drops, so that the
#: parts of a piece keep a height over each other
SHARP, DROPPED = 2.0, 2.0**-20


class Heights(NamedTuple):
    """Heights, and how well the equations were solved.

    Attributes:
        height: towards the camera, m; mean 0 on every piece of the mask, NaN outside.
        residual: what is left of the error of each image, relative; about 1e-10.
        steps: of conjugate gradients, all rounds together.
    """

    height: Float[Tensor, "B 1 H W"]
    residual: Float[Tensor, "B"]
    steps: int


def normals_to_heights(
    normal: Float[Tensor, "B 3 H W"],
    mask: Bool[Tensor, "B 1 H W"] | None = None,
    pixel_size: float | Tensor = 1.0,
    rounds: int = 0,
) -> Heights:
    """The surface with these normals, by least squares over pairs of neighbouring pixels.

    Args:
        normal: unit, x right, y up, z to the camera. Pairs that are edge-on or turn away
            (m_z < 1/128) are taken as slopes of at most 128; a zero normal follows its
            neighbours.
        mask: where the surface is (True, or > 0); None: everywhere. A pixel whose normal is NaN or
            infinite is masked. Pieces that do not touch along an edge of a pixel have nothing to
            do with each other, and a single pixel has height 0.
        pixel_size: p, side of a pixel of the orthographic camera, m.
        rounds: of weights for breaks (see the module); 10 are usual, 0 is for smooth surfaces.

    Returns:
        Heights, float64 inside. `depth = level - height` for the functions that take depth.

    Raises:
        ShapeError: wrong axes.
        OutOfRangeError: fewer than 0 rounds.

    Differentiable in: normal and pixel_size, once, by one more solve; the weights of breaks are
        taken as given.
    Export: no, it stops when it is good enough.
    References: Horn and Brooks (1986); Cao et al. (2022).

    >>> slope = torch.tensor([-0.6, 0.0, 0.8]).reshape(1, 3, 1, 1).expand(1, 3, 1, 3)
    >>> normals_to_heights(slope, pixel_size=4.0).height.round(decimals=3)[..., [0, 2]]
    tensor([[[[-3.,  3.]]]])
    """
    seen = _checked(normal, mask, rounds)
    x, y, z = wide(*torch.where(seen.unsqueeze(1), normal, 0).unbind(1))
    joined = _joined(seen)
    found, residual, steps = relaxed(
        *_between(x, y, z, joined), torch.zeros_like(z), ROUGHLY if rounds else ENOUGH
    )
    for left in reversed(range(rounds)):
        found = found.detach()
        springs = _one_sided(x, y, z, found, joined)
        found, residual, more = relaxed(*springs, found, ROUGHLY if left else ENOUGH)
        steps += more
    height = (without_mean(found, pieces(joined)) * pixel_size).to(normal.dtype)
    height = torch.where(seen, height, torch.nan).unsqueeze(1)
    return Heights(height, residual.to(normal.dtype), steps)


def _joined(seen: Bool[Tensor, "B H W"]) -> tuple[Bool[Tensor, "B H W"], Bool[Tensor, "B H W"]]:
    """Whether a pixel and its right, its lower neighbour are both seen."""
    return seen & _next(seen, -1), seen & _next(seen, -2)


def _next(values: Tensor, axis: int) -> Tensor:
    """The value of the pixel to the right (-1) or below (-2); 0 beyond the image."""
    size = values.shape[axis] - 1
    return functional.pad(values.narrow(axis, 1, size), (0, 1) if axis == -1 else (0, 0, 0, 1))


def _previous(values: Tensor, axis: int) -> Tensor:
    """The value of the pixel to the left (-1) or above (-2); 0 beyond the image."""
    size = values.shape[axis] - 1
    return functional.pad(values.narrow(axis, 0, size), (1, 0) if axis == -1 else (0, 0, 1, 0))


def _between(
    x: Tensor, y: Tensor, z: Tensor, joined: tuple[Tensor, Tensor]
) -> tuple[Springs, Springs]:
    """Stiffness m_z^2 and force of the mean normal of every pair."""
    stiff, force = [], []
    for axis, aside, pair in zip((-1, -2), (-x, y), joined, strict=True):
        facing = ((z + _next(z, axis)) / 2).clamp(min=EDGE_ON)
        stiff.append(torch.where(pair, facing.square(), 0))
        force.append(torch.where(pair, facing * (aside + _next(aside, axis)) / 2, 0))
    return Springs(*stiff), Springs(*force)


def _one_sided(
    x: Tensor, y: Tensor, z: Tensor, height: Tensor, joined: tuple[Tensor, Tensor]
) -> tuple[Springs, Springs]:
    """Stiffness and force of every pair, each pixel speaking for itself on the side it trusts."""
    z = z.clamp(min=EDGE_ON)
    step, stiff, force = steps_of(height), [], []
    for axis, aside, jump, pair in zip((-1, -2), (-x, y), step, joined, strict=True):
        ahead = (z.detach() * jump).square()
        behind = (z.detach() * _previous(jump, axis)).square()
        trust = torch.sigmoid(SHARP * (behind - ahead)).clamp(DROPPED, 1 - DROPPED)
        here, there = trust * z, (1 - trust) * z
        stiff.append(torch.where(pair, here * z + _next(there * z, axis), 0))
        force.append(torch.where(pair, here * aside + _next(there * aside, axis), 0))
    return Springs(*stiff), Springs(*force)


def _checked(normal: Tensor, mask: Tensor | None, rounds: int) -> Bool[Tensor, "B H W"]:
    """Where the surface is."""
    require_floating("normal", normal)
    if normal.ndim != 4 or normal.shape[1] != 3 or 0 in normal.shape[2:]:
        raise ShapeError("normal", f"shape {tuple(normal.shape)}", "pass B x 3 x H x W")
    if rounds < 0:
        raise OutOfRangeError("rounds", str(rounds), "pass 0 or more")
    seen = (normal.abs() < torch.inf).all(1)
    if mask is None:
        return seen
    wanted = (len(normal), 1, *normal.shape[2:])
    if tuple(mask.shape) not in (wanted, (1, *wanted[1:])):
        raise ShapeError("mask", f"shape {tuple(mask.shape)}", f"pass {wanted} as the normals")
    return seen & (mask > 0).squeeze(1)
