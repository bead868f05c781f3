"""Light from one image of a known surface without torch: `learn.estimate_light` for one image.

    I_c(p) = rho_c(p) / pi  sum_k A_k Y_k(n_p) L_kc,      k = 1..9

by least squares, reweighted against shadows and highlights; of lights that explain the image nearly
as well, the one whose irradiance varies least. The basis Y, in the
order and normalisation of `HarmonicSource`, and A are those of R. Ramamoorthi and P. Hanrahan, "An
Efficient Representation for Irradiance Environment Maps", SIGGRAPH 2001, eq. 3 and 8.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchradiometry.errors import ShapeError

__all__ = ["fit_light", "shine"]

#: A of each of the nine, sr
COSINE = np.pi * np.array([1.0, *(2 / 3,) * 3, *(1 / 4,) * 5])
#: l (l + 1) of each of the nine
SLOPE = np.array([0.0, *(2.0,) * 3, *(6.0,) * 5])
#: what evenness is worth where normals and albedo are true; rounds of weights
RIDGE, ROUNDS = 2.0**-26, 10
#: the residual that counts a quarter, in medians; the smallest median, of the image's mean
DOUBT, EXACT = 3.0, 2.0**-12
#: pixels that are looked at, at most; of more, every so manieth
PIXELS = 2**18


def shine(normal: NDArray[np.floating], light: NDArray[np.floating]) -> NDArray[np.float64]:
    """Irradiance `*batch C` on surfaces of unit normals `*batch 3` under light `9 C`.

    >>> grey = np.zeros((9, 1)); grey[0] = 2 * np.sqrt(np.pi)  # radiance 1 from everywhere
    >>> shine(np.array([0.0, 0.6, 0.8]), grey).round(6)
    array([3.141593])
    """
    return np.maximum(_basis(normal) @ (COSINE[:, None] * light), 0)


def fit_light(
    image: NDArray[np.floating],
    normal: NDArray[np.floating],
    albedo: NDArray[np.floating],
    ridge: float = RIDGE,
) -> NDArray[np.float64]:
    """The nine harmonics `9 C` of the light under which the pixels look like the image.

    Args:
        image: `pixel C`, linear.
        normal: `pixel 3`, unit.
        albedo: `pixel C`, >= 0; the light is relative to it.
        ridge: how much evenness is worth; 0.01 for what a network guessed.

    Returns:
        L_kc, in the unit of the image per sqrt(sr); 0 where nothing is seen.

    Raises:
        ShapeError: sizes that do not fit.
    """
    if image.ndim != 2 or albedo.shape != image.shape or normal.shape != (len(image), 3):
        got = f"{image.shape}, {normal.shape}, {albedo.shape}"
        raise ShapeError("image, normal, albedo", got, "pass pixel x C, x 3 and x C")
    some = slice(None, None, 1 + len(image) // PIXELS)
    seen, paint = (part[some].astype(np.float64).T for part in (image, albedo))
    basis, trust = _basis(normal[some]) / np.pi, np.ones_like(seen)
    found = np.zeros((9, len(seen)))
    for last in (*(False,) * ROUNDS, True):
        found = _solved(seen, basis, paint, trust, ridge)
        if not last and seen.size:
            trust = _trusted(seen, paint * (basis @ found).T)
    return found / COSINE[:, None]


def _basis(normal: NDArray[np.floating]) -> NDArray[np.float64]:
    """Y at unit directions, `*batch 9`."""
    x, y, z = np.moveaxis(np.asarray(normal, dtype=np.float64), -1, 0)
    shape = (np.ones_like(x), y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y)
    norm = [1, *(3**0.5,) * 3, *(15**0.5,) * 2, 5**0.5 / 2, 15**0.5, 15**0.5 / 2]
    return np.stack(shape, -1) * (np.array(norm) / (2 * np.sqrt(np.pi)))


def _solved(
    seen: NDArray[np.float64],
    basis: NDArray[np.float64],
    paint: NDArray[np.float64],
    trust: NDArray[np.float64],
    ridge: float,
) -> NDArray[np.float64]:
    """The nine of the irradiance of each channel."""
    found = np.zeros((9, len(seen)))
    for c, (values, weight, colour) in enumerate(zip(seen, trust, paint, strict=True)):
        held = (weight * colour)[:, None] * basis
        gram = held.T @ (colour[:, None] * basis)
        mean = gram.diagonal().mean()
        if mean > 0:
            gram = gram / mean + ridge * np.diag(SLOPE)
            found[:, c] = np.linalg.solve(gram, held.T @ values / mean)
    return found


def _trusted(seen: NDArray[np.float64], predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weight of each pixel; 0 in a channel that is black and predicted to be."""
    missed = np.linalg.norm(seen - predicted.clip(min=0), axis=0)
    level = np.linalg.norm(seen, axis=0).mean()
    usual = max(float(np.median(missed)), EXACT * float(level))
    doubt = missed / (DOUBT * usual) if usual > 0 else np.zeros_like(missed)
    return np.where((predicted <= 0) & (seen <= usual), 0, (1 + doubt**2) ** -2.0)
