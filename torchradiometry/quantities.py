"""Vocabulary: the quantities of radiometry, their symbols and units, and how they convert.

| name | symbol | unit | meaning |
|---|---|---|---|
| radiant flux | Phi | W | power |
| radiant intensity | I | W/sr | flux per solid angle: a near point source |
| irradiance | E | W/m2 | arriving flux per area |
| exitance | M | W/m2 | leaving because the surface emits |
| radiosity | B | W/m2 | leaving for every cause |
| radiance | L | W/m2/sr | flux per area that faces it and solid angle |
| albedo | rho | 1 | share of the irradiance that a diffuse surface reflects |
| brdf | f_r | 1/sr | reflected radiance per irradiance, without the cosine |

Directions are unit vectors that point **away** from the surface: `incident_direction` (wi)
to the source, `outgoing_direction` (wo) to the eye. Colour is a trailing channel axis of any
length; vectors are last (`*batch point 3`); image layers speak `B C H W`.

References: F. E. Nicodemus et al., "Geometrical Considerations and Nomenclature for
Reflectance", NBS Monograph 160 (1977); ISO 80000-7.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

__all__ = [
    "QUANTITIES",
    "Quantity",
    "flux_from_intensity",
    "intensity_from_flux",
    "radiance_from_radiosity",
    "radiosity_from_radiance",
]


class Quantity(NamedTuple):
    """One quantity: how it is written and what it is measured in."""

    symbol: str
    unit: str
    meaning: str


QUANTITIES: dict[str, Quantity] = {
    "radiant_flux": Quantity("Phi", "W", "power"),
    "radiant_intensity": Quantity("I", "W/sr", "flux per solid angle of a near point source"),
    "irradiance": Quantity("E", "W/m2", "arriving flux per area"),
    "exitance": Quantity("M", "W/m2", "leaving because the surface emits"),
    "radiosity": Quantity("B", "W/m2", "leaving for every cause"),
    "radiance": Quantity("L", "W/m2/sr", "flux per facing area and solid angle"),
    "albedo": Quantity("rho", "1", "diffuse reflectance, 0..1; the BRDF is albedo/pi"),
    "brdf": Quantity("f_r", "1/sr", "reflected radiance per irradiance, without the cosine"),
    "form_factors": Quantity("F", "1", "F[receiver, emitter], A_i F_ij = A_j F_ji"),
    "visibility": Quantity("V", "1", "1 = seen, 0 = hidden"),
    "shininess": Quantity("n", "1", "Phong exponent, >= 0"),
    "solid_angle": Quantity("omega", "sr", "area on the unit sphere"),
    "distance": Quantity("r", "m", "length"),
    "direction": Quantity("w", "1", "unit vector, away from the surface"),
    "normal": Quantity("n", "1", "unit vector, out of the surface"),
    "position": Quantity("x", "m", "point in space"),
}


def radiance_from_radiosity(radiosity: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """L = B / pi of a diffuse surface, W/m2/sr from W/m2 (the same from exitance or E rho)."""
    return radiosity / math.pi


def radiosity_from_radiance(radiance: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """B = pi L of a diffuse surface, W/m2 from W/m2/sr."""
    return radiance * math.pi


def intensity_from_flux(radiant_flux: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """I = Phi / (4 pi) of a source that shines equally in all directions, W/sr from W."""
    return radiant_flux / (4 * math.pi)


def flux_from_intensity(radiant_intensity: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Phi = 4 pi I of a source that shines equally in all directions, W from W/sr."""
    return radiant_intensity * (4 * math.pi)
