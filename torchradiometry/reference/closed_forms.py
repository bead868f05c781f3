"""Closed forms: the answers that the layers and solvers are held against.

Plain `math` on plain numbers, written from the literature and by other routes than the
package's own formulas, so that a mistake cannot be in both. Lengths in any one unit (only
ratios count unless a unit is given), angles in radians, powers in W.

A configuration (or form) factor F of an element to an area is the irradiance on the element
over pi times the area's uniform radiance; F of area 1 to area 2 is the share of what leaves 1
that reaches 2, so A1 F12 = A2 F21. "Howell" is J. R. Howell, *A Catalog of Radiation Heat
Transfer Configuration Factors* (thermalradiation.net), section B for elements and C for
areas; "Modest" is M. F. Modest, *Radiative Heat Transfer*, 3rd ed. (2013), appendix D.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

__all__ = [
    "cap_irradiance",
    "coaxial_discs",
    "cube_faces",
    "dome_irradiance",
    "element_to_disc",
    "element_to_offset_disc",
    "element_to_parallel_rectangle",
    "element_to_perpendicular_rectangle",
    "element_to_sphere",
    "enclosure_radiosity",
    "integrating_sphere_irradiance",
    "inverse_square_irradiance",
    "parallel_plates_radiosity",
    "parallel_rectangles",
    "parallel_strips",
    "perpendicular_rectangles",
    "phong_reflectance",
    "phong_reflectance_at_grazing",
    "phong_reflectance_at_normal",
    "sphere_to_coaxial_disc",
    "spot_attenuation",
    "wedge",
]


def inverse_square_irradiance(intensity: float, distance: float, angle: float = 0.0) -> float:
    """W/m2 at `distance` (m) from a lamp of `intensity` (W/sr), tilted by `angle`.

    E = I cos(angle) / r^2 (Lambert, *Photometria*, 1760); 0 from behind.

    >>> inverse_square_irradiance(8.0, 2.0)
    2.0
    """
    return intensity * max(0.0, math.cos(angle)) / distance**2


def spot_attenuation(angle: float, inner: float, outer: float) -> float:
    """glTF's cone: ((cos a - cos outer) / (cos inner - cos outer))^2, 1 inside, 0 outside.

    Differences of cosines are taken as products of sines.

    >>> round(spot_attenuation(math.acos(0.8), 0.0, math.acos(0.6)), 12)
    0.25
    """
    if angle <= inner:
        return 1.0
    if angle > outer:
        return 0.0
    rise = math.sin((outer - angle) / 2) * math.sin((outer + angle) / 2)
    return (rise / (math.sin((outer - inner) / 2) * math.sin((outer + inner) / 2))) ** 2


def dome_irradiance(radiance: float, tilt: float = 0.0) -> float:
    """W/m2 from a sky of uniform `radiance` (W/m2/sr) above a black ground.

    E = pi L (1 + cos tilt) / 2: the sky that a surface tilted by `tilt` still sees (Moon and
    Spencer 1942, the uniform case).

    >>> dome_irradiance(1.0) == math.pi
    True
    """
    return math.pi * radiance * math.cos(tilt / 2) ** 2


def cap_irradiance(radiance: float, half_angle: float) -> float:
    """W/m2 from a cap of uniform `radiance` (W/m2/sr) about the normal.

    E = pi L sin^2(half_angle): a round window in a dark sky, or a disc of that angular radius.

    >>> cap_irradiance(1.0, math.pi / 2) == dome_irradiance(1.0)
    True
    """
    return math.pi * radiance * math.sin(half_angle) ** 2


def element_to_disc(radius: float, distance: float) -> float:
    """F of an element to a disc that faces it, the element on the disc's axis.

    F = r^2 / (r^2 + h^2) (Howell, section B; Modest).

    >>> element_to_disc(1.0, 1.0)
    0.5
    """
    return radius**2 / (radius**2 + distance**2)


def element_to_offset_disc(radius: float, distance: float, offset: float) -> float:
    """F of an element to a disc in a parallel plane, `offset` beside the disc's axis.

    F = (1 - (a^2 + h^2 - r^2) / sqrt((a^2 + h^2 + r^2)^2 - 4 a^2 r^2)) / 2 (Howell, section B).

    >>> element_to_offset_disc(1.0, 1.0, 0.0)
    0.5
    """
    square = offset**2 + distance**2
    root = math.sqrt((square + radius**2) ** 2 - (2 * offset * radius) ** 2)
    return (1 - (square - radius**2) / root) / 2


def element_to_sphere(radius: float, distance: float, tilt: float = 0.0) -> float:
    """F of an element to a sphere whose centre is `distance` away, `tilt` from its normal.

    All above the horizon (tilt <= acos(r/d)): F = (r/d)^2 cos(tilt). Cut by the horizon, with
    H = d/r: F = 1/2 - asin(sqrt(H^2-1) / (H sin t)) / pi
    + (cos t acos(-sqrt(H^2-1) cot t) - sqrt(H^2-1) sqrt(1 - H^2 cos^2 t)) / (pi H^2)
    (Howell, section B, "element to sphere, tilted"; Juul 1979). Below: 0.

    >>> element_to_sphere(1.0, 2.0)
    0.25
    """
    h, cosine, sine = distance / radius, math.cos(tilt), math.sin(tilt)
    if h * cosine >= 1:
        return cosine / h**2
    if h * cosine <= -1:
        return 0.0
    root = math.sqrt(h**2 - 1)
    inside = math.acos(_unit(-root * cosine / sine))
    lens = cosine * inside - root * math.sqrt(max(0.0, 1 - (h * cosine) ** 2))
    return 0.5 - math.asin(_unit(root / (h * sine))) / math.pi + lens / (math.pi * h**2)


def element_to_parallel_rectangle(a: float, b: float, c: float) -> float:
    """F of an element to a parallel rectangle a x b, one corner straight above it at c.

    F = (A/sqrt(1+A^2) atan(B/sqrt(1+A^2)) + B/sqrt(1+B^2) atan(A/sqrt(1+B^2))) / (2 pi),
    A = a/c, B = b/c (Howell, section B; Modest). A quarter of the hemisphere at most:

    >>> round(element_to_parallel_rectangle(1e9, 1e9, 1.0), 6)
    0.25
    """
    big_a, big_b = a / c, b / c
    root_a, root_b = math.sqrt(1 + big_a**2), math.sqrt(1 + big_b**2)
    first = big_a / root_a * math.atan(big_b / root_a)
    return (first + big_b / root_b * math.atan(big_a / root_b)) / (2 * math.pi)


def element_to_perpendicular_rectangle(height: float, width: float, distance: float) -> float:
    """F of an element to an upright rectangle whose lower corner is straight before it.

    The element lies in the plane that the rectangle stands on, `distance` from its foot; the
    rectangle reaches `width` to one side and `height` up.
    F = (atan(1/Y) - Y/sqrt(X^2+Y^2) atan(1/sqrt(X^2+Y^2))) / (2 pi), X = height/width,
    Y = distance/width (Howell, section B; Modest).

    >>> round(element_to_perpendicular_rectangle(1e9, 1e9, 1.0), 6)
    0.25
    """
    x, y = height / width, distance / width
    root = math.sqrt(x**2 + y**2)
    return (math.atan(1 / y) - y / root * math.atan(1 / root)) / (2 * math.pi)


def parallel_rectangles(a: float, b: float, c: float) -> float:
    """F between two equal, directly opposed rectangles a x b at distance c (Howell C-11).

    >>> round(parallel_rectangles(1.0, 1.0, 1.0), 6)
    0.199825
    """
    x, y = a / c, b / c
    root_x, root_y = math.sqrt(1 + x**2), math.sqrt(1 + y**2)
    total = (
        math.log((1 + x**2) * (1 + y**2) / (1 + x**2 + y**2)) / 2
        + x * root_y * math.atan(x / root_y)
        + y * root_x * math.atan(y / root_x)
        - x * math.atan(x)
        - y * math.atan(y)
    )
    return 2 * total / (math.pi * x * y)


def perpendicular_rectangles(width: float, height: float, length: float) -> float:
    """F from a rectangle width x length to one of height x length at right angles to it.

    They share the edge `length` (Howell C-14, H = height/length, W = width/length).

    >>> round(perpendicular_rectangles(1.0, 1.0, 1.0), 6)
    0.200044
    """
    h, w = height / length, width / length
    hh, ww, root = h * h, w * w, math.sqrt(h * h + w * w)
    logs = (
        math.log((1 + ww) * (1 + hh) / (1 + ww + hh))
        + ww * math.log(ww * (1 + ww + hh) / ((1 + ww) * (ww + hh)))
        + hh * math.log(hh * (1 + hh + ww) / ((1 + hh) * (hh + ww)))
    )
    angles = w * math.atan(1 / w) + h * math.atan(1 / h) - root * math.atan(1 / root)
    return (angles + logs / 4) / (math.pi * w)


def cube_faces() -> list[list[float]]:
    """The 6 x 6 form factors of a cube's faces, in the order -x, +x, -y, +y, -z, +z.

    Opposite faces by C-11, neighbours by C-14; each row sums to 1.

    >>> [round(f, 4) for f in cube_faces()[0]]
    [0.0, 0.1998, 0.2, 0.2, 0.2, 0.2]
    """
    opposite, beside = parallel_rectangles(1, 1, 1), perpendicular_rectangles(1, 1, 1)
    faces = range(6)
    return [
        [0.0 if i == j else opposite if i // 2 == j // 2 else beside for j in faces] for i in faces
    ]


def coaxial_discs(radius_1: float, radius_2: float, distance: float) -> float:
    """F from disc 1 to a parallel disc 2 on the same axis.

    F12 = (S - sqrt(S^2 - 4 (r2/r1)^2)) / 2, S = 1 + (r2^2 + h^2) / r1^2 (Howell, section C;
    Modest). The difference is taken as 2 (r2/r1)^2 / (S + sqrt(...)), which does not cancel.

    >>> round(coaxial_discs(1.0, 1.0, 1.0), 6)
    0.381966
    """
    s = 1 + (radius_2**2 + distance**2) / radius_1**2
    ratio = (radius_2 / radius_1) ** 2
    return 2 * ratio / (s + math.sqrt(s * s - 4 * ratio))


def sphere_to_coaxial_disc(distance: float, radius: float) -> float:
    """F from a sphere to a disc whose axis passes through the sphere's centre.

    F = (1 - h / sqrt(h^2 + r^2)) / 2, for h larger than the sphere's radius (Howell, section
    C): the share of the solid angle, whatever the size of the sphere.

    >>> sphere_to_coaxial_disc(3.0, 4.0)
    0.2
    """
    return (1 - distance / math.hypot(distance, radius)) / 2


def parallel_strips(width: float, distance: float) -> float:
    """F between two equal, opposed, infinitely long strips: sqrt(1 + (h/w)^2) - h/w.

    Hottel's crossed strings (H. C. Hottel, in W. H. McAdams, *Heat Transmission*, 1954).

    >>> round(parallel_strips(1.0, 1.0), 6)
    0.414214
    """
    ratio = distance / width
    return 1 / (math.hypot(1, ratio) + ratio)


def wedge(side_1: float, side_2: float, opening: float) -> float:
    """F from side 1 to side 2 of an infinitely long groove with the given opening angle.

    F12 = (a + b - c) / (2 a), c^2 = a^2 + b^2 - 2 a b cos(opening) (Hottel's crossed strings);
    for equal sides 1 - sin(opening / 2).

    >>> round(wedge(1.0, 1.0, math.pi / 3), 6)
    0.5
    """
    # a + b - c = 2 a b (1 + cos) / (a + b + c), without cancellation
    half = math.cos(opening / 2)
    across = math.sqrt((side_1 - side_2) ** 2 + 4 * side_1 * side_2 * math.sin(opening / 2) ** 2)
    return 2 * side_2 * half**2 / (side_1 + side_2 + across)


def parallel_plates_radiosity(
    exitance_1: float, albedo_1: float, exitance_2: float, albedo_2: float
) -> tuple[float, float]:
    """B of two infinite parallel plates, W/m2: B1 = M1 + rho1 B2, B2 = M2 + rho2 B1.

    B1 = (M1 + rho1 M2) / (1 - rho1 rho2): the sum of all reflections (Modest, chapter 5).

    >>> parallel_plates_radiosity(1.0, 0.5, 0.0, 1.0)
    (2.0, 2.0)
    """
    share = 1 - albedo_1 * albedo_2
    first = (exitance_1 + albedo_1 * exitance_2) / share
    return first, (exitance_2 + albedo_2 * exitance_1) / share


def enclosure_radiosity(exitance: float, albedo: float) -> float:
    """B of any closed enclosure with the same exitance and albedo all over: M / (1 - rho).

    The "furnace": every form factor's row sums to 1, whatever the shape.

    >>> enclosure_radiosity(1.0, 0.75)
    4.0
    """
    return exitance / (1 - albedo)


def integrating_sphere_irradiance(flux: float, radius: float, albedo: float) -> float:
    """W/m2 on the wall of a closed sphere from reflected light alone: flux in W, radius in m.

    E = Phi / (4 pi R^2) * rho / (1 - rho), the same everywhere, wherever the lamp shines
    first (R. Ulbricht 1900; F = A / (4 pi R^2) between any two parts of a sphere).

    >>> round(integrating_sphere_irradiance(4 * math.pi, 1.0, 0.5), 12)
    1.0
    """
    return flux / (4 * math.pi * radius**2) * albedo / (1 - albedo)


def phong_reflectance_at_normal(shininess: float) -> float:
    """DHR of the lobe cos^n(alpha) at normal incidence: 2 pi / (n + 2).

    Lafortune and Willems (1994).

    >>> phong_reflectance_at_normal(0.0) == math.pi
    True
    """
    return 2 * math.pi / (shininess + 2)


def phong_reflectance_at_grazing(shininess: float) -> float:
    """DHR of the lobe cos^n(alpha), n > 0, at 90 degrees: half a lobe is above the horizon.

    2 int_0^{pi/2} sin^2(a) cos^n(a) da = (sqrt(pi)/2) Gamma((n+1)/2) / Gamma(n/2 + 2).

    >>> round(phong_reflectance_at_grazing(1.0), 12) == round(2 / 3, 12)
    True
    """
    n = shininess
    return math.sqrt(math.pi) / 2 * math.exp(math.lgamma((n + 1) / 2) - math.lgamma(n / 2 + 2))


def phong_reflectance(shininess: float, angle: float) -> float:
    """DHR of the lobe max(0, cos alpha)^n at any angle of incidence.

    Polar coordinates about the mirror direction; the integral over the circle is elementary,
    int cos(theta_o) dphi = 2 (cos a cos t phi0 + sin a sin t sin phi0) with phi0 the azimuth
    of the horizon, and one integral over alpha remains, done by the double exponential rule
    (Takahasi and Mori 1974). n = 0 is the constant 1, with DHR pi.

    >>> round(phong_reflectance(6.0, 0.0) - 2 * math.pi / 8, 12)
    0.0
    """
    n = shininess
    if n == 0:
        return math.pi

    def circle(alpha: float) -> float:
        along = math.cos(alpha) * math.cos(angle)
        across = math.sin(alpha) * math.sin(angle)
        phi = math.pi if along >= across else math.acos(_unit(-along / across))
        ring = 2 * (along * phi + across * math.sin(phi)) * math.sin(alpha)
        versine = 2 * math.sin(alpha / 2) ** 2
        return ring * math.exp(n * math.log1p(-versine)) if versine < 1 else 0.0

    width = 1 / math.sqrt(1 + n)
    ends = {0.0, math.pi / 2, max(0.0, math.pi / 2 - angle)}
    ends |= {w * width for w in (0.5, 1, 2, 4, 8, 16) if w * width < math.pi / 2}
    return sum(_double_exponential(circle, a, b) for a, b in pairwise(sorted(ends)))


def _double_exponential(function: Callable[[float], float], low: float, high: float) -> float:
    """Integral over low..high by x = tanh(pi/2 sinh t): ends may be singular."""
    step, half, total = 0.05, (high - low) / 2, 0.0
    for k in range(-66, 67):
        s = math.pi / 2 * math.sinh(k * step)
        slope = math.pi / 2 * math.cosh(k * step) / math.cosh(s) ** 2
        # distance to the nearer end without cancellation
        gap = half * 2 / (1 + math.exp(2 * abs(s)))
        x = high - gap if s > 0 else low + gap
        total += slope * function(x)
    return total * step * half


def _unit(x: float) -> float:
    """x clamped to -1..1 against rounding."""
    return max(-1.0, min(1.0, x))
