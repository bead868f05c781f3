"""Polygonal source: any planar polygon of uniform radiance, exact on Lambertian surfaces.

    wi = Phi / |Phi|,   E_facing = L |Phi|,   Phi = Lambert's contour integral

(`geometry.polygon_irradiance`), cut at the receiver's horizon, so that E_facing (n . wi) is
the exact irradiance. With `samples` > 1 the polygon is split into that many emitters of equal
area A / samples instead, each with E = L cos(source) A / (samples r^2): a sum over them
converges for every BRDF, and each can carry a shadow ray of its own.

References: D. R. Baum, H. E. Rushmeier and J. M. Winget, SIGGRAPH 1989, eq. 8; J. Arvo, SIGGRAPH
1994, section 2; G. Turk, "Generating Random Points in Triangles", Graphics Gems (1990), for
the map of the unit square to a triangle.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, final

import torch
from torch import Tensor

from torchradiometry.arguments import as_numbers
from torchradiometry.errors import (
    DegenerateGeometryError,
    ShapeError,
    require_floating,
    require_whole,
)
from torchradiometry.geometry.patches import vector_area
from torchradiometry.geometry.polygon_irradiance import (
    polygon_irradiance,
    polygon_vector_irradiance,
)
from torchradiometry.geometry.triangulation import triangulate_polygon
from torchradiometry.numerics import (
    dot,
    guarded_divide,
    narrow,
    safe_norm,
    safe_normalize,
    safe_sqrt,
    single,
)
from torchradiometry.sources.base import AbstractSource, Arrival, light_first
from torchradiometry.sources.extended import (
    direction_and_length,
    sample_rows,
    summed,
)

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = [
    "PolygonSource",
    "SamplePlaces",
    "place_samples",
    "polygon_arrival",
    "polygon_samples",
    "require_planar_polygons",
]

#: Corners may leave their plane by this share of the polygon's size: room for corners that
#: were rounded by a file format or a float32 transform, far below what is seen.
_FLATNESS = 1e-4
#: Fraction of the golden ratio: steps of a lattice that spreads evenly for every count.
_GOLDEN = (math.sqrt(5) - 1) / 2


def polygon_arrival(
    corners: Float[Tensor, "*batch light corner 3"],
    radiance: Float[Tensor, "*batch light channel"],
    position: Float[Tensor, "*batch point 3"],
    normal: Float[Tensor, "*batch point 3"],
    two_sided: bool = False,
) -> Arrival:
    """Light of polygons at points: irradiance * (n . direction) is exact.

    Args:
        corners: planar, m, counter-clockwise seen from the emitting side.
        radiance: W/m2/sr, >= 0.
        position: m.
        normal: unit.
        two_sided: both sides shine.

    Returns:
        The arrival. `distance` is where the direction meets the polygon's plane.

    Differentiable in: all (kinks in the polygon's plane).
    Export: compile yes, ONNX yes.
    References: Baum et al. (1989), eq. 8.
    """
    require_floating("normal", normal)
    dtype = position.dtype
    outline, wide_normal = _corners_first(corners, position).double(), normal.double()
    phi = polygon_vector_irradiance(position.double(), wide_normal, outline)
    side = dot(wide_normal, phi).unsqueeze(-1)
    phi = torch.where(side < 0, -phi if two_sided else torch.zeros_like(phi), phi)
    offset = outline.mean(-2) - position.double()
    direction, length = direction_and_length(phi, wide_normal, safe_normalize(offset), dtype)
    distance = narrow(_plane_distance(offset, direction.double(), outline), dtype)
    return Arrival(direction, length.unsqueeze(-1) * light_first(radiance, position), distance)


def _corners_first(corners: Tensor, like: Tensor) -> Tensor:
    """Corners as `light *batch 1 corner 3`."""
    return light_first(corners.flatten(-2), like).unflatten(-1, (corners.shape[-2], 3))


def _plane_distance(offset: Tensor, direction: Tensor, outline: Tensor) -> Tensor:
    """Where a ray meets the polygon's plane; the distance of its middle where it does not."""
    axis = safe_normalize(vector_area(outline))
    hit = guarded_divide(dot(axis, offset), dot(axis, direction))
    reach = safe_norm(outline - outline.mean(-2, keepdim=True)).amax(-1)
    middle = safe_norm(offset)
    return torch.where((hit > 0) & (hit <= middle + reach), hit, middle)


class SamplePlaces(NamedTuple):
    """Where the samples of polygons lie, as numbers that stay while the corners move.

    Attributes:
        weight: of each corner in each sample point; they sum to 1.
        tile: corner numbers of the triangle that holds the sample.
        portion: of that triangle's area, the sample's share (of all of it 1 / samples at
            the corners the places were made for).
    """

    weight: Float[Tensor, "*batch light sample corner"]
    tile: Int[Tensor, "*batch light sample 3"]
    portion: Float[Tensor, "*batch light sample"]


def polygon_samples(
    corners: Float[Tensor, "*batch light corner 3"],
    places: SamplePlaces,
    radiance: Float[Tensor, "*batch light channel"],
    position: Float[Tensor, "*batch point 3"],
    normal: Float[Tensor, "*batch point 3"],
    two_sided: bool = False,
) -> Arrival:
    """Polygons as small emitters, one for each sample place.

    E = L cos(source) dA / r^2, dA the sample's share of the area of its triangle.

    Args:
        corners: planar, m, counter-clockwise seen from the emitting side.
        places: from `place_samples`.
        radiance: W/m2/sr.
        position: m.
        normal: only its shape is used.
        two_sided: both sides shine.

    Returns:
        The arrival with `light * samples` rows, the samples of one light together.

    Differentiable in: corners, radiance, position.
    Export: compile yes, ONNX yes.
    """
    require_floating("position", position)
    dtype = position.dtype
    # float64: far from the origin, or near the polygon, the terms of a path cancel
    exact = corners.double()
    path = _corners_first(places.weight.double() @ exact, position)
    path = path - position.double().unsqueeze(-2)
    corners, inner = single(corners, position)
    path = path.to(inner.dtype)
    index = places.tile.flatten(-2).unsqueeze(-1).expand(*places.tile.shape[:-2], -1, 3)
    tiles = corners.gather(-2, index).unflatten(-2, (-1, 3))
    area = light_first(places.portion * safe_norm(vector_area(tiles)), position)
    axis = safe_normalize(vector_area(_corners_first(corners, position))).unsqueeze(-2)
    distance = safe_norm(path)
    direction = safe_normalize(path)
    facing = -dot(axis, direction)
    facing = facing.abs() if two_sided else facing.clamp(min=0)
    strength = guarded_divide(guarded_divide(area * facing, distance), distance)
    rows = sample_rows(direction, strength, distance, light_first(radiance, position))
    return Arrival(*(narrow(t, dtype) for t in rows))


def place_samples(corners: Float[Tensor, "*batch light corner 3"], samples: int) -> SamplePlaces:
    """Places that stand for equal areas of each polygon.

    Place k lies (k + 1/2) / samples along the area of the triangles laid end to end, and
    across them on a golden-ratio lattice.

    Args:
        corners: planar and simple, m.
        samples: places per polygon, >= 1.

    Returns:
        The places.

    Raises:
        DegenerateGeometryError: an outline crosses itself.

    References: Turk (1990).
    """
    found = [_place(polygon.detach(), samples) for polygon in corners.flatten(0, -3)]
    leading = corners.shape[:-2]
    return SamplePlaces(
        *(torch.stack(part).unflatten(0, leading) for part in zip(*found, strict=True))
    )


def _place(polygon: Tensor, samples: int) -> tuple[Tensor, Tensor, Tensor]:
    """The same for one polygon."""
    triangles = triangulate_polygon(polygon)
    area = safe_norm(vector_area(polygon.double()[triangles]))
    end = area.cumsum(-1)
    step = torch.arange(samples, dtype=torch.float64, device=polygon.device)
    along = end[-1] * (step + 0.5) / samples
    tile = torch.searchsorted(end[:-1], along, right=True)
    reach = safe_sqrt(guarded_divide(along - (end - area)[tile], area[tile]).clamp(0, 1))
    across = torch.remainder(step * _GOLDEN + 0.5, 1)
    inside = torch.stack((1 - reach, reach * (1 - across), reach * across), -1)
    weight = torch.zeros(samples, polygon.shape[0], dtype=torch.float64, device=polygon.device)
    weight.scatter_(-1, triangles[tile], inside)
    portion = end[-1] / samples / area[tile]
    return weight.to(polygon.dtype), triangles[tile], portion.to(polygon.dtype)


def require_planar_polygons(corners: Float[Tensor, "*batch corner 3"]) -> None:
    """Raise the named error unless every polygon has three corners, an area and one plane.

    Args:
        corners: m.

    Raises:
        ShapeError: not `... corner 3` with at least 3 corners.
        DegenerateGeometryError: zero area, or corners outside the polygon's plane.
    """
    if corners.ndim < 2 or corners.shape[-1] != 3 or corners.shape[-2] < 3:
        raise ShapeError(
            "corners",
            f"a tensor of shape {tuple(corners.shape)}",
            "pass `light corner 3` or `batch light corner 3` with at least 3 corners",
        )
    exact = corners.detach().double()
    area = vector_area(exact)
    offset = exact - exact.mean(-2, keepdim=True)
    size = safe_norm(offset).amax(-1)
    noise = torch.finfo(corners.dtype).eps * exact.abs().amax((-2, -1))
    if bool((safe_norm(area) <= 4 * noise * size).any()):
        raise DegenerateGeometryError(
            "corners", "a polygon without area", "remove it, or move a corner off the line"
        )
    height = dot(offset, safe_normalize(area).unsqueeze(-2)).abs().amax(-1)
    if bool((height > _FLATNESS * size + 4 * noise).any()):
        raise DegenerateGeometryError(
            "corners",
            f"a polygon that leaves its plane by {float((height / size).max()):.2g} of its size",
            "split it into triangles",
        )


@final
class PolygonSource(AbstractSource):
    """Planar polygons of uniform radiance, with the same number of corners each.

    Args:
        corners: `light corner 3` or `batch light corner 3` (or one bare `corner 3`), m,
            counter-clockwise seen from the emitting side, convex or not.
        radiance: `light channel` or `batch light channel`, W/m2/sr, >= 0.
        two_sided: both sides shine.
        samples: 1 = one row a light, exact for Lambertian surfaces; more = that many small
            emitters a light, each a row of its own, which converge for every BRDF.
        learnable: keep corners and radiance as `nn.Parameter`s.

    Raises:
        ShapeError: fewer than three corners.
        DegenerateGeometryError: no area, not planar, or an outline that crosses itself.
        OutOfRangeError: a negative radiance, or fewer than one sample.

    >>> panel = PolygonSource([[[1.0, -1, 1], [-1, -1, 1], [-1, 1, 1], [1, 1, 1]]], [1.0])
    >>> panel(torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]])).irradiance
    tensor([[[1.7408]]])
    """

    radiance: Tensor
    corners: Tensor
    weight: Tensor
    tile: Tensor
    portion: Tensor

    def __init__(
        self,
        corners: object,
        radiance: object,
        *,
        two_sided: bool = False,
        samples: int = 1,
        learnable: bool = False,
    ) -> None:
        super().__init__()
        require_whole("samples", samples, 1, 2**24)
        self.two_sided, self.samples = two_sided, samples
        outline = as_numbers("corners", corners)
        outline = outline.unsqueeze(0) if outline.ndim == 2 else outline
        self._hold("corners", outline, learnable, light_axis=-3)
        require_planar_polygons(self.corners)
        self._hold("radiance", radiance, learnable, least=0)
        if samples > 1:
            for name, part in place_samples(self.corners, samples)._asdict().items():
                self.register_buffer(name, part)

    @property
    def lights(self) -> int:
        return self.corners.shape[-3] * self.samples

    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
    ) -> Arrival:
        position = self._near(position)
        if self.samples > 1:
            places = SamplePlaces(self.weight, self.tile, self.portion)
            held = (self.radiance, position, normal, self.two_sided)
            return polygon_samples(self.corners, places, *held)
        return polygon_arrival(self.corners, self.radiance, position, normal, self.two_sided)

    def irradiance_on(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
        visibility: Float[Tensor, "light *batch point"] | None = None,
    ) -> Float[Tensor, "*batch point channel"]:
        if self.samples > 1:
            return super().irradiance_on(position, normal, visibility)
        position = self._near(position)
        outline = _corners_first(self.corners, position)
        received = polygon_irradiance(position, normal, outline, self.two_sided)
        return summed(received, light_first(self.radiance, position), visibility)

    def extra_repr(self) -> str:
        return (
            f"lights={self.corners.shape[-3]}, corners={self.corners.shape[-2]} [m], "
            f"radiance [W/m2/sr], two_sided={self.two_sided}, samples={self.samples}"
        )
