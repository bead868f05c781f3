"""The truth in fifty digits: textbook formulas in mpmath, which know nothing of the package.

Numbers go in as the machine holds them (every float is a rational number), so an error that is
found is the package's and not that of the input. Fifty digits cancel as far as any case here
does and leave thirty.

mpmath also comes with torch (through sympy).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import mpmath
from torch import Tensor

#: a context of its own: other tests set the precision of mpmath's common one
mp = mpmath.MPContext()
mp.dps = 50
mpf = mp.mpf

Vector = list[mpf]


def exact(tensor: Tensor) -> list:
    """Nested lists of the exact values."""
    values = tensor.detach().double().tolist()

    def convert(value: object) -> object:
        return [convert(v) for v in value] if isinstance(value, list) else mpf(value)

    return convert(values)


def dot(a: Sequence[mpf], b: Sequence[mpf]) -> mpf:
    return mp.fdot(a, b)


def cross(a: Vector, b: Vector) -> Vector:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def minus(a: Vector, b: Vector) -> Vector:
    return [x - y for x, y in zip(a, b, strict=True)]


def norm(a: Vector) -> mpf:
    return mp.sqrt(dot(a, a))


def clipped(corners: list[Vector], height: list[mpf]) -> list[Vector]:
    """The part of an outline where a linear function is not negative."""
    kept: list[Vector] = []
    for i, p in enumerate(corners):
        j = (i + 1) % len(corners)
        if height[i] >= 0:
            kept.append(p)
        if (height[i] >= 0) != (height[j] >= 0):
            t = height[i] / (height[i] - height[j])
            kept.append([a + t * (b - a) for a, b in zip(p, corners[j], strict=True)])
    return kept


def vector_irradiance(position: Tensor, normal: Tensor, polygon: Tensor) -> Vector:
    """Lambert's sum of the part above the horizon."""
    x, n = exact(position), exact(normal)
    corners = [minus(p, x) for p in exact(polygon)]
    kept = clipped(corners, [dot(n, p) for p in corners])
    total = [mpf(0)] * 3
    for i, a in enumerate(kept):
        b = kept[(i + 1) % len(kept)]
        axis = cross(b, a)
        sine = norm(axis)
        if sine > 0:
            angle = mp.atan2(sine, dot(a, b))
            total = [t + angle * c / sine / 2 for t, c in zip(total, axis, strict=True)]
    return total


def polygon_irradiance(position: Tensor, normal: Tensor, polygon: Tensor) -> mpf:
    """Both sides of the polygon shine."""
    return abs(dot(exact(normal), vector_irradiance(position, normal, polygon)))


def solid_angle(position: Tensor, polygon: Tensor) -> mpf:
    """Signed triangles of a fan, by Van Oosterom and Strackee."""
    x = exact(position)
    corners = [minus(p, x) for p in exact(polygon)]
    a, total = corners[0], mpf(0)
    for b, c in pairwise(corners[1:]):
        la, lb, lc = norm(a), norm(b), norm(c)
        below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        total -= 2 * mp.atan2(dot(a, cross(b, c)), below)
    return total


def sphere_irradiance(offset: Tensor, normal: Tensor, radius: Tensor) -> mpf:
    """The projected spherical cap, cut by the horizon, as Snyder has it."""
    a, n, r = exact(offset), exact(normal), exact(radius)
    distance, length = norm(a), norm(n)
    s = r / distance
    cosine = dot(a, n) / distance / length
    if cosine >= s:
        return mp.pi * s**2 * cosine * length
    if cosine <= -s:
        return mpf(0)
    omega, slant = mp.acos(cosine), mp.sqrt(1 - s**2)
    turn = mp.acos(-slant * cosine / s / mp.sin(omega))
    lever = s * mp.sin(omega) * mp.sin(turn)
    found = s**2 * turn * cosine - slant * lever + mp.atan2(lever, slant)
    return found * length


def harmonic_irradiance(coefficients: Tensor, normal: Tensor) -> mpf:
    """Nine harmonics of one channel, cosine-weighted, Ramamoorthi and Hanrahan (2001), eq. 9."""
    held, (x, y, z), pi = exact(coefficients), exact(normal), mp.pi
    flat = [mp.sqrt(1 / (4 * pi))] + [mp.sqrt(3 / (4 * pi)) * v for v in (y, z, x)]
    bent = [x * y, y * z, (3 * z * z - 1) / mp.sqrt(12), x * z, (x * x - y * y) / 2]
    flat += [mp.sqrt(15 / (4 * pi)) * v for v in bent]
    weight = [pi] + [2 * pi / 3] * 3 + [pi / 4] * 5
    return mp.fsum(a * y * c for a, y, c in zip(weight, flat, held, strict=True))


#: enough for pairs that are not far apart, and several times as fast as fifty
DIGITS_OF_EXCHANGE = 30


def exchange(first: Tensor, second: Tensor) -> mpf:
    """A_1 F_12 of two convex polygons: the double contour integral of the clipped parts.

    The inner integral of ln r is elementary, the outer one tanh-sinh quadrature between the
    places where the integrand is least smooth.
    """
    a, b = (exact(t) for t in (first, second))
    one, other = (clipped(p, _heights(p, q)) for p, q in ((a, b), (b, a)))
    total = mpf(0)
    with mp.workdps(DIGITS_OF_EXCHANGE):
        for start, end in _edges(one):
            for corner, next_corner in _edges(other):
                weight = dot(minus(end, start), minus(next_corner, corner))
                if weight != 0:
                    total += weight * _mean_logarithm(start, end, corner, next_corner)
    return max(total / (2 * mp.pi), mpf(0))


def _heights(corners: list[Vector], plane: list[Vector]) -> list[mpf]:
    normal = area_vector(plane)
    return [dot(minus(p, plane[0]), normal) for p in corners]


def area_vector(corners: list[Vector]) -> Vector:
    """Area times normal of a planar polygon."""
    total = [mpf(0)] * 3
    for b, c in pairwise(corners[1:]):
        part = cross(minus(b, corners[0]), minus(c, corners[0]))
        total = [t + p / 2 for t, p in zip(total, part, strict=True)]
    return total


def _edges(corners: list[Vector]) -> list[tuple[Vector, Vector]]:
    return [(p, corners[(i + 1) % len(corners)]) for i, p in enumerate(corners)]


def _mean_logarithm(start: Vector, end: Vector, corner: Vector, following: Vector) -> mpf:
    edge, other = minus(end, start), minus(following, corner)
    square, length = dot(edge, edge), dot(other, other)

    def inner(s: mpf) -> mpf:
        p = [c - a - s * e for c, a, e in zip(corner, start, edge, strict=True)]
        q = [x + f for x, f in zip(p, other, strict=True)]
        bend = norm(cross(p, other))
        turn = bend * mp.atan2(bend, dot(p, q)) if bend else 0
        near, far = dot(p, p), dot(q, q)
        logs = (dot(q, other) * mp.log(far) if far else 0) - (
            dot(p, other) * mp.log(near) if near else 0
        )
        return (logs / 2 + turn) / length

    cuts = {mpf(0), mpf(1)}
    for point in (corner, following):
        cuts.add(dot(minus(point, start), edge) / square)
    axis = cross(edge, other)
    if dot(axis, axis) > 0:
        cuts.add(dot(cross(minus(corner, start), other), axis) / dot(axis, axis))
    inside = sorted(c for c in cuts if 0 <= c <= 1)
    return mp.quad(inner, inside)


def parallel_rectangles(a: float, b: float, c: float) -> mpf:
    """F of two aligned a x b rectangles at distance c, Howell's C-11."""
    x, y = mpf(a) / mpf(c), mpf(b) / mpf(c)
    u, v = mp.sqrt(1 + x * x), mp.sqrt(1 + y * y)
    logs = mp.log(u * u * v * v / (1 + x * x + y * y)) / 2
    angles = x * v * mp.atan(x / v) + y * u * mp.atan(y / u)
    angles -= x * mp.atan(x) + y * mp.atan(y)
    return 2 / (mp.pi * x * y) * (logs + angles)


def perpendicular_rectangles(width: float, height: float, edge: float) -> mpf:
    """F from width x edge to height x edge rectangles at 90 degrees on that edge, C-14."""
    w, h = mpf(width) / mpf(edge), mpf(height) / mpf(edge)
    r2 = w * w + h * h
    r = mp.sqrt(r2)
    angles = w * mp.atan(1 / w) + h * mp.atan(1 / h) - r * mp.atan(1 / r)
    one = (1 + w * w) * (1 + h * h) / (1 + r2)
    two = w * w * (1 + r2) / ((1 + w * w) * r2)
    three = h * h * (1 + r2) / ((1 + h * h) * r2)
    logs = mp.log(one) + w * w * mp.log(two) + h * h * mp.log(three)
    return (angles + logs / 4) / (mp.pi * w)


def radiosity(factors: Tensor, albedo: Tensor, exitance: Tensor) -> list[mpf]:
    """B of (I - rho F) B = M, one channel."""
    return _solved(_system(factors, albedo), exact(exitance))


def radiosity_gradients(
    factors: Tensor, albedo: Tensor, exitance: Tensor, wanted: Tensor
) -> tuple[list[mpf], list[mpf], list[list[mpf]]]:
    """Of wanted . B by albedo, exitance and form factors."""
    found = radiosity(factors, albedo, exitance)
    adjoint = _solved(_system(factors, albedo).T, exact(wanted))
    rho, matrix = exact(albedo), exact(factors)
    arriving = [dot(row, found) for row in matrix]
    by_albedo = [a * e for a, e in zip(adjoint, arriving, strict=True)]
    by_factors = [[a * r * b for b in found] for a, r in zip(adjoint, rho, strict=True)]
    return by_albedo, adjoint, by_factors


def condition(factors: Tensor, albedo: Tensor) -> float:
    """Of I - rho F, in the norm of the largest row sum."""
    system = _system(factors, albedo)
    return float(mp.mnorm(system, mp.inf) * mp.mnorm(system**-1, mp.inf))


def _system(factors: Tensor, albedo: Tensor) -> mp.matrix:
    rho, rows = exact(albedo), exact(factors)
    scaled = [[r * f for f in row] for r, row in zip(rho, rows, strict=True)]
    return mp.eye(len(rho)) - mp.matrix(scaled)


def _solved(system: mp.matrix, right: Sequence[mpf]) -> list[mpf]:
    return list(mp.lu_solve(system, mp.matrix(list(right))))


def relative(found: float, truth: mpf) -> float:
    """|found - truth| / |truth|; 0 where both are 0."""
    off = abs(mpf(found) - truth)
    return float(off / abs(truth)) if truth != 0 else (0.0 if off == 0 else mp.inf)


def worst(found: Tensor, truth: Callable[[int], mpf]) -> list[float]:
    """Relative errors of a batch of scalars."""
    return [relative(float(value), truth(i)) for i, value in enumerate(found.detach().double())]
