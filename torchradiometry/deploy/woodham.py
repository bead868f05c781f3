"""Least-squares photometric stereo: the baseline every learned method is measured against.

For a matt surface without shadows the photographs of a pixel under lights L (`N x 3`) are

    I = L b,   b = albedo * n      =>      b = (L^T L)^-1 L^T I,   n = b / |b|.

References: R. J. Woodham, "Photometric method for determining surface orientation from
multiple images", Optical Engineering 19 (1980), eq. 13.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchradiometry.deploy.photographs import Photographs
from torchradiometry.errors import (
    DegenerateGeometryError,
    ShapeError,
)

__all__ = ["least_squares_normals", "solve_least_squares"]


def solve_least_squares(
    intensity: NDArray[np.floating], direction: NDArray[np.floating]
) -> NDArray[np.float64]:
    """b = albedo * normal of each pixel, by least squares over all lights.

    Args:
        intensity: `pixel N`, grey, divided by the light's intensity.
        direction: `N 3`, unit.

    Returns:
        `pixel 3`.

    Raises:
        ShapeError: not one intensity for each light.
        DegenerateGeometryError: the lights lie in a plane with the camera's origin, so that
            one direction of the normal stays unknown.

    >>> light = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [0, 0.6, 0.8]])
    >>> seen = light @ [0.3, 0.0, 0.4]
    >>> solve_least_squares(seen[None], light).round(6)
    array([[0.3, 0. , 0.4]])
    """
    lights, seen = np.asarray(direction, dtype=np.float64), np.asarray(intensity, dtype=np.float64)
    if seen.ndim != 2 or lights.shape != (seen.shape[-1], 3):
        got = f"{seen.shape} and {lights.shape}"
        raise ShapeError("intensity, direction", got, "pass `pixel N` and `N 3`")
    if np.linalg.matrix_rank(lights, tol=1e-3) < 3:
        raise DegenerateGeometryError(
            "light directions", "lights that lie in one plane", "add a light outside that plane"
        )
    return seen @ np.linalg.pinv(lights).T


def least_squares_normals(photographs: Photographs) -> NDArray[np.float32]:
    """Unit normals `H W 3` by Woodham's least squares; 0 outside the mask.

    References: Woodham (1980).
    """
    b = solve_least_squares(photographs.grey(), photographs.light_directions)
    length = np.linalg.norm(b, axis=1, keepdims=True)
    unit = np.where(length > 0, b / np.where(length > 0, length, 1), [0, 0, 1])
    normals = np.zeros((*photographs.mask.shape, 3), dtype=np.float32)
    normals[photographs.mask] = unit
    return normals
