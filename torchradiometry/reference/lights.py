"""From the package's sources and glowing surfaces to the lights of the rasteriser.

An extended source becomes N small cosine emitters, each of radiance times area

    dE = L dA cos(theta_e) cos(theta) / r^2,

placed by the midpoint rule; the sum converges to the exact irradiance as N grows.

A light with a shadow map has one camera (distant, narrow spot) or six that share the
directions between them (the faces of a cube around a near light). pyrender itself knows maps
for distant and spot lights only.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from torchradiometry.errors import DTypeError, OutOfRangeError, ShapeError
from torchradiometry.geometry.triangulation import triangulate_polygon
from torchradiometry.reference.rasterizer import Array, LightRecord, ShadowMap
from torchradiometry.scene.surface import Surface
from torchradiometry.sources.base import AbstractSource
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.point import PointSource
from torchradiometry.sources.polygon import PolygonSource
from torchradiometry.sources.sphere import SphereSource
from torchradiometry.sources.spot import SpotSource

__all__ = ["light_records", "with_shadows"]

DISTANT, POINT, SPOT, EMITTER = range(4)
#: texels along each side of a shadow map, and of the maps of one of many emitters, whose
#: uncertain edges average out
SHADOW_SIZE, EMITTER_SHADOW_SIZE = 2048, 512
#: how much wider than needed a shadow camera looks, so that rounding leaves nothing outside
MARGIN = 1.01
#: widest half angle of a spot that one shadow map covers well; beyond it a cube does
WIDEST = math.radians(60)


def light_records(
    sources: Sequence[AbstractSource],
    surfaces: Sequence[Surface],
    origin: Array,
    area_samples: int,
) -> list[LightRecord]:
    """All lights of a scene, positions relative to `origin`.

    Args:
        sources: directional, point, spot, and with `area_samples` polygons and spheres.
        surfaces: those that emit become emitters when `area_samples` > 0.
        origin: of the pass, world, m.
        area_samples: about how many emitters stand for one extended source.
    """
    records = [r for source in sources for r in _records(source, origin, area_samples)]
    for surface in surfaces if area_samples > 0 else ():
        if bool((surface.emission > 0).any()):
            corners = array(surface.vertices[surface.faces]) - origin
            radiance = colours(surface.emission[None])[0]
            records += _emitters(corners, radiance, surface.two_sided, area_samples)
    return records


def _records(source: AbstractSource, origin: Array, area_samples: int) -> Iterator[LightRecord]:
    zero, cone = np.zeros(3), np.zeros(2)
    if isinstance(source, DirectionalSource):
        towards, power = rows(source.direction, 3), colours(source.irradiance)
        for k in range(len(towards)):
            yield LightRecord(DISTANT, power[k], zero, unit(towards[k]), cone)
    elif isinstance(source, PointSource):
        position, power = rows(source.position, 3), colours(source.intensity)
        for k in range(len(position)):
            yield LightRecord(POINT, power[k], position[k] - origin, zero, cone)
    elif isinstance(source, SpotSource):
        position, power = rows(source.position, 3), colours(source.intensity)
        axis = rows(source.axis, 3)
        cones = np.hstack([rows(source.inner_cone, 1), rows(source.outer_cone, 1)])
        for k in range(len(position)):
            versine = 2 * np.sin(cones[k] / 2) ** 2
            yield LightRecord(SPOT, power[k], position[k] - origin, unit(axis[k]), versine)
    else:
        yield from _extended(source, origin, area_samples)


def _extended(source: AbstractSource, origin: Array, area_samples: int) -> Iterator[LightRecord]:
    """Polygons and spheres as many emitters; the named error for anything else."""
    if not isinstance(source, (PolygonSource, SphereSource)):
        raise DTypeError(
            "scene.sources",
            f"a {type(source).__name__}",
            "the rasteriser draws directional, point, spot, polygonal and spherical sources",
        )
    if area_samples == 0:
        raise OutOfRangeError("area_samples", f"0 with a {type(source).__name__}", "use at least 1")
    radiance = colours(source.radiance)
    if isinstance(source, PolygonSource):
        if source.corners.ndim != 3:
            raise ShapeError("scene.sources", "a batched polygon", "pass `light corner 3`")
        for polygon, glow in zip(source.corners.detach(), radiance, strict=True):
            corners = array(polygon[triangulate_polygon(polygon)]) - origin
            yield from _emitters(corners, glow, source.two_sided, area_samples)
        return
    centre, radius = rows(source.center, 3), rows(source.radius, 1)
    for k in range(len(centre)):
        power = radiance[k] * 4 * math.pi * radius[k] ** 2 / area_samples
        for normal in _even_directions(area_samples):
            position = centre[k] + radius[k] * normal - origin
            yield LightRecord(EMITTER, power, position, normal, np.zeros(2))


def _even_directions(count: int) -> Array:
    """Unit vectors that stand for equal solid angles: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    height, turn = 1 - 2 * k / count, math.pi * (3 - math.sqrt(5)) * k
    ring = np.sqrt(1 - height**2)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), height], -1)


def _emitters(
    corners: Array, radiance: Array, two_sided: bool, area_samples: int
) -> list[LightRecord]:
    """Midpoint samples of glowing triangles (`triangle 3 3`), about `area_samples` in all."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=-1) / 2
    records = []
    for k in np.flatnonzero(area > 0):
        cuts = max(1, math.ceil(round(math.sqrt(area_samples * area[k] / area.sum()), 6)))
        power, direction = radiance * area[k] / cuts**2, normal[k] / (2 * area[k])
        for centre in _centroids(cuts) @ corners[k]:
            records.append(LightRecord(EMITTER, power, centre, direction, np.zeros(2), two_sided))
    return records


def _centroids(cuts: int) -> Array:
    """Barycentric centroids of the cuts^2 equal parts of a triangle."""
    i, j = np.meshgrid(np.arange(cuts), np.arange(cuts), indexing="ij")
    upright = np.stack([i, j], -1)[i + j < cuts] + 1 / 3
    turned = np.stack([i, j], -1)[i + j < cuts - 1] + 2 / 3
    uv = np.concatenate([upright, turned]) / cuts
    return np.column_stack([1 - uv.sum(-1), uv])


def with_shadows(record: LightRecord, vertices: Array) -> list[LightRecord]:
    """The record with its shadow map, or six of them that share its directions.

    Args:
        record: one light.
        vertices: all vertices of the scene in the frame of the pass, `vertex 3`.
    """
    if record.kind == DISTANT:
        return [record._replace(shadow=_distant_map(record.direction, vertices))]
    far = float(np.linalg.norm(vertices - record.position, axis=-1).max()) * MARGIN
    outer = 2 * math.asin(math.sqrt(min(1.0, record.cone[1] / 2)))
    if record.kind == SPOT and outer < WIDEST:
        shadow = _near_map(
            record.position, record.direction, outer * MARGIN, far, SHADOW_SIZE, np.zeros(3)
        )
        return [record._replace(shadow=shadow)]
    size = EMITTER_SHADOW_SIZE if record.kind == EMITTER else SHADOW_SIZE
    return [
        record._replace(
            shadow=_near_map(record.position, axis, math.pi / 4 * MARGIN, far, size, axis)
        )
        for axis in np.concatenate([np.eye(3), -np.eye(3)])
        if _lights_something(record, axis, vertices - record.position, far)
    ]


def _lights_something(record: LightRecord, axis: Array, offset: Array, far: float) -> bool:
    """Whether a face of the cube around a light can hold light and surfaces at once."""
    others = np.eye(3)[axis == 0]
    if record.kind == EMITTER and not record.two_sided:
        brightest = axis @ record.direction + np.abs(others @ record.direction).sum()
        if brightest <= 0:
            return False
    sides = np.concatenate([axis + others, axis - others])
    return bool(((offset @ sides.T).max(0) > -far * 1e-4).all())


def _distant_map(towards: Array, vertices: Array) -> ShadowMap:
    """A camera that looks along the light and just holds all vertices."""
    axes = frame(towards)
    seen = vertices @ axes.T
    low, high = seen.min(0), seen.max(0)
    half = np.maximum((high - low) / 2, np.ptp(seen) * 1e-3) * MARGIN
    centre = (low + high) / 2
    view = np.eye(4)
    view[:3, :3] = axes
    view[:3, 3] = -np.array([centre[0], centre[1], centre[2] + half[2]])
    projection = np.diag([1 / half[0], 1 / half[1], -1 / half[2], 1.0])
    projection[2, 3] = -1.0
    texel = float(half[:2].max()) * 2 / SHADOW_SIZE
    return ShadowMap(view, projection, float(2 * half[2]), texel, np.zeros(3), SHADOW_SIZE)


def _near_map(
    position: Array, axis: Array, half_angle: float, far: float, size: int, face: Array
) -> ShadowMap:
    """A camera at the light that looks along `axis`, with an infinite projection."""
    view = np.eye(4)
    view[:3, :3] = frame(-axis)
    view[:3, 3] = -view[:3, :3] @ position
    tangent, near = math.tan(half_angle), far * 1e-5
    projection = np.zeros((4, 4))
    projection[0, 0] = projection[1, 1] = 1 / tangent
    projection[2] = [0, 0, -1, -2 * near]
    projection[3, 2] = -1
    return ShadowMap(view, projection, far, 2 * tangent / size, face, size)


def frame(z: Array) -> Array:
    """Right-handed unit axes as rows, the last one along `z`."""
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def array(tensor: Tensor) -> Array:
    """A detached tensor as float64 on the CPU."""
    return tensor.detach().to("cpu", torch.float64).numpy()


def rows(parameter: Tensor, width: int) -> Array:
    """An unbatched source parameter, `light k`."""
    if parameter.ndim != 2:
        raise ShapeError(
            "scene.sources",
            f"a parameter of shape {tuple(parameter.shape)}",
            "the rasteriser draws one picture; pass sources without a batch axis",
        )
    return array(parameter)[:, :width]


def colours(parameter: Tensor) -> Array:
    """`light channel` with three channels; one channel shines white."""
    values = rows(parameter, parameter.shape[-1])
    if values.shape[1] not in (1, 3):
        raise ShapeError(
            "colour", f"{values.shape[1]} channels", "the rasteriser draws 1 or 3 channels"
        )
    return np.broadcast_to(values, (len(values), 3)).copy()


def unit(vector: Array) -> Array:
    """v / |v|, and zero for the zero vector."""
    length = np.linalg.norm(vector)
    return vector / length if length > 0 else vector


def require_count(area_samples: int) -> None:
    """Raise unless `area_samples` counts something."""
    if area_samples < 0:
        raise OutOfRangeError("area_samples", f"{area_samples}", "use 0 or more")
