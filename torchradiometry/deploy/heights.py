"""Normals -> heights without torch: what `geometry.normals_to_heights` solves, for one image.

The step between two neighbouring pixels of side p is at right angles to the mean m of their
normals; over all pairs

    sum (m_x p + m_z (h_right - h))^2 + (-m_y p + m_z (h_below - h))^2  ->  min

Springs of stiffness k = m_z^2 hold the pixels together. Conjugate gradients, preconditioned by one
cycle of multigrid: 2 x 2 pixels are one of the next grid, whose springs are half the sum of those
that run side by side (D. Braess, "Towards algebraic multigrid for elliptic problems of second
order", Computing 55, 1995). References for the equation: see `geometry.heights`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchradiometry.errors import ShapeError

__all__ = ["integrate_normals"]

Array = NDArray[np.float64]
#: stiffness to the right neighbour and to the one below, `H W` each; 0 in the last column and row
Springs = tuple[Array, Array]

#: m_z below which a pair is taken as edge-on
EDGE_ON = 2.0**-7
#: the relative error that is left, in the norm of the energy, and steps at most
ENOUGH, MOST = 2.0**-34, 500
#: damping of a Jacobi step, and how many there are before and after the coarser grids
DAMPING, SWEEPS = 0.8, 2


def integrate_normals(
    normal: NDArray[np.floating], mask: NDArray[np.bool_], pixel_size: float = 1.0
) -> NDArray[np.float64]:
    """Heights whose normals are, in the sense of least squares, those given.

    Args:
        normal: `H W 3`, unit, x right, y up, z to the camera; edge-on pairs (m_z < 1/128) are
            slopes of at most 128.
        mask: `H W`, True on the object.
        pixel_size: p, in the unit that heights shall have.

    Returns:
        `H W`, towards the camera, of mean 0 on every piece of the mask (pixels that touch along
        an edge); NaN outside.

    Raises:
        ShapeError: sizes that do not fit.

    >>> slope = np.broadcast_to([-0.6, 0.0, 0.8], (1, 3, 3))
    >>> integrate_normals(slope, np.ones((1, 3), bool)).round(3)[..., [0, 2]]
    array([[-0.75,  0.75]])
    """
    if normal.ndim != 3 or normal.shape != (*mask.shape, 3) or 0 in mask.shape:
        got = f"shape {normal.shape} beside a mask of {mask.shape}"
        raise ShapeError("normal", got, "pass H x W x 3 and H x W")
    inside = mask & np.isfinite(normal).all(-1)
    x, y, z = np.moveaxis(np.where(inside[..., None], normal, 0).astype(np.float64), -1, 0)
    pairs = _pairs(inside)
    slope = tuple(_mean(c, axis) for c, axis in ((-x, 1), (y, 0)))
    facing = tuple(_mean(z, axis).clip(min=EDGE_ON) for axis in (1, 0))
    stiffness = (pairs[0] * facing[0] ** 2, pairs[1] * facing[1] ** 2)
    force = (pairs[0] * facing[0] * slope[0], pairs[1] * facing[1] * slope[1])
    height = _relaxed(stiffness, _pulls(force))
    return np.where(inside, _without_mean(height, pairs) * pixel_size, np.nan)


def _pairs(inside: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether a pixel and its right, its lower neighbour are both inside."""
    right, down = np.zeros_like(inside), np.zeros_like(inside)
    right[:, :-1] = inside[:, :-1] & inside[:, 1:]
    down[:-1] = inside[:-1] & inside[1:]
    return right, down


def _mean(values: Array, axis: int) -> Array:
    """Of each pair, at its first pixel."""
    return (values + np.roll(values, -1, axis)) / 2


def _steps(height: Array) -> Springs:
    right, down = np.zeros_like(height), np.zeros_like(height)
    np.subtract(height[:, 1:], height[:, :-1], out=right[:, :-1])
    np.subtract(height[1:], height[:-1], out=down[:-1])
    return right, down


def _pulls(force: Springs) -> Array:
    right, down = force
    pull = -right - down
    pull[:, 1:] += right[:, :-1]
    pull[1:] += down[:-1]
    return pull


def _applied(stiffness: Springs, height: Array) -> Array:
    right, down = _steps(height)
    return _pulls((stiffness[0] * right, stiffness[1] * down))


def _relaxed(stiffness: Springs, wanted: Array) -> Array:
    """Conjugate gradients from height 0."""
    levels = _levels(stiffness)
    height, rest = np.zeros_like(wanted), wanted.copy()
    ahead = ready = _cycle(levels, rest)
    power = float((rest * ready).sum())
    enough = ENOUGH**2 * power
    for _ in range(MOST):
        if power <= enough:
            break
        pushed = _applied(stiffness, ahead)
        length = power / float((ahead * pushed).sum())
        height += length * ahead
        rest -= length * pushed
        ready = _cycle(levels, rest)
        power, before = float((rest * ready).sum()), power
        ahead = ready + power / before * ahead
    return height


def _levels(stiffness: Springs) -> list[tuple[Springs, Array]]:
    """Stiffness and damped inverse diagonal, from the finest grid to a single pixel."""
    levels = []
    while True:
        right, down = stiffness
        total = right + down
        total[:, 1:] += right[:, :-1]
        total[1:] += down[:-1]
        inverse = np.divide(DAMPING, total, out=np.zeros_like(total), where=total > 0)
        levels.append((stiffness, inverse))
        if right.size == 1:
            return levels
        stiffness = (
            _halved(right)[..., 1].sum(1) / 2,
            _halved(down)[:, 1].sum(-1) / 2,
        )


def _halved(image: Array) -> Array:
    """`H W` as `H/2 2 W/2 2`, padded to even sizes."""
    rows, columns = image.shape
    image = np.pad(image, ((0, rows % 2), (0, columns % 2)))
    return image.reshape(image.shape[0] // 2, 2, -1, 2)


def _cycle(levels: list[tuple[Springs, Array]], rest: Array) -> Array:
    """One V-cycle from height 0."""
    (stiffness, inverse), *coarser = levels
    height = inverse * rest
    for _ in range(SWEEPS - 1):
        height += inverse * (rest - _applied(stiffness, height))
    if not coarser:
        return height
    left = _halved(rest - _applied(stiffness, height)).sum((1, 3))
    moved = _cycle(coarser, left).repeat(2, 0).repeat(2, 1)
    height += moved[: rest.shape[0], : rest.shape[1]]
    for _ in range(SWEEPS):
        height += inverse * (rest - _applied(stiffness, height))
    return height


def _without_mean(height: Array, pairs: tuple[NDArray[np.bool_], NDArray[np.bool_]]) -> Array:
    """Heights less the mean of their piece."""
    columns = height.shape[1]
    right, down = (np.flatnonzero(pair) for pair in pairs)
    first, second = np.concatenate((right, down)), np.concatenate((right + 1, down + columns))
    label = np.arange(height.size)
    while not np.array_equal(label[first], label[second]):
        lower = np.minimum(label[first], label[second])
        for ends in (label[first], label[second]):
            np.minimum.at(label, ends, lower)
        while not np.array_equal(label[label], label):
            label = label[label]
    count = np.bincount(label, minlength=height.size)
    total = np.bincount(label, height.ravel(), minlength=height.size)
    return height - (total / np.maximum(count, 1))[label].reshape(height.shape)
