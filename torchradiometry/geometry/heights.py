"""Normals -> heights: the surface whose normals they are, as nearly as there is one.

A camera that looks along -z from afar sees pixels of side p. The step between two neighbours is
at right angles to the mean m of their normals,

    m_x p + m_z (h_right - h) = 0,      -m_y p + m_z (h_below - h) = 0,      m = (n + n_next) / 2

which is exact for planes and for spheres, of whatever size, and otherwise up to the third power of
p. Normals that were estimated are those of no surface; the heights are least squares,

    sum over pairs of w (m_x p + m_z (h_right - h))^2 + ...,        w = 1

Poisson's equation with natural borders: nothing is said about heights at the mask's edge. A pair is
heard as m_z^2, so the steep rim of an object, where slopes are large and doubtful, says little.

*Breaks.* Where one part hides another the surface jumps, and no normal tells by how much. A pixel
holds to the side on which the steps are smaller, and the more so the more they differ:

    w = t + t'_next,     t = sigmoid(2 (b^2 - a^2)),     t' = 1 - t

with a and b = n_z |step| / p ahead of and behind the pixel (Cao et al. 2022). These weights follow
from the heights, which follow from the weights, in rounds.

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

from torchradiometry.errors import OutOfRangeError, ShapeError
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
SHARP, DROPPED = 2.0, 2.0**-12


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
    References: Horn and Brooks (1986); Cao et al. (2022), eq. 14 to 18.

    >>> slope = torch.tensor([-0.6, 0.0, 0.8]).reshape(1, 3, 1, 1).expand(1, 3, 1, 3)
    >>> normals_to_heights(slope, pixel_size=4.0).height.round(decimals=3)[..., [0, 2]]
    tensor([[[[-3.,  3.]]]])
    """
    seen = _checked(normal, mask, rounds)
    (clean,) = wide(torch.where(seen.unsqueeze(1), normal, 0))
    mean = _mean_of_pairs(clean[:, 0], seen), _mean_of_pairs(clean[:, 1], seen)
    facing = _mean_of_pairs(clean[:, 2], seen)
    facing = Springs(*(f.clamp(min=EDGE_ON) for f in facing))
    joined = _joined(seen)
    stiff = facing.times(facing).times(Springs(*(j.double() for j in joined)))
    force = facing.times(Springs(-mean[0].right, mean[1].down))
    found, residual, steps = relaxed(stiff, force, 0 * clean[:, 0], ROUGHLY if rounds else ENOUGH)
    for left in reversed(range(rounds)):
        found = found.detach()
        weight = _trusted(found, clean[:, 2].detach(), joined)
        enough = ROUGHLY if left else ENOUGH
        pulled = stiff.times(weight), force.times(weight)
        found, residual, more = relaxed(*pulled, found, enough)
        steps += more
    height = (without_mean(found, pieces(joined)) * pixel_size).to(normal.dtype)
    height = torch.where(seen, height, torch.nan).unsqueeze(1)
    return Heights(height, residual.to(normal.dtype), steps)


def _joined(
    seen: Bool[Tensor, "B H W"],
) -> tuple[Bool[Tensor, "B H W"], Bool[Tensor, "B H W"]]:
    """Whether a pixel and its right, its lower neighbour are both seen."""
    right = functional.pad(seen[..., 1:], (0, 1)) & seen
    return right, functional.pad(seen[..., 1:, :], (0, 0, 0, 1)) & seen


def _mean_of_pairs(values: Float[Tensor, "B H W"], seen: Bool[Tensor, "B H W"]) -> Springs:
    """Mean of each pair; 0 where there is none."""
    right, down = _joined(seen)
    to_right = functional.pad(values[..., 1:] + values[..., :-1], (0, 1))
    below = functional.pad(values[..., 1:, :] + values[..., :-1, :], (0, 0, 0, 1))
    return Springs(torch.where(right, to_right / 2, 0), torch.where(down, below / 2, 0))


def _trusted(height: Tensor, facing: Tensor, joined: tuple[Tensor, Tensor]) -> Springs:
    """w of every pair; 1 where the pixels at its ends do not prefer a side."""
    step, weights = steps_of(height), []
    for axis, jump, pair in zip((-1, -2), step, joined, strict=True):
        before = (1, 0) if axis == -1 else (0, 0, 1, 0)
        after = (0, 1) if axis == -1 else (0, 0, 0, 1)
        size = jump.shape[axis] - 1
        held = functional.pad(jump.narrow(axis, 0, size), before)
        both = pair & functional.pad(pair.narrow(axis, 0, size), before)
        ahead, behind = (facing * jump).square(), (facing * held).square()
        # a pixel with one neighbour only, at the mask's edge, has no choice
        choice = torch.where(both, torch.sigmoid(SHARP * (behind - ahead)), 0.5)
        there = functional.pad((1 - choice).narrow(axis, 1, size), after)
        weights.append((choice + there).clamp(min=DROPPED))
    return Springs(*weights)


def _checked(normal: Tensor, mask: Tensor | None, rounds: int) -> Bool[Tensor, "B H W"]:
    """Where the surface is."""
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
