"""A quick look at depth maps: what each effect of global light is worth, image by image.

Every s-th pixel of a map is a map of its own, of a camera with s times larger pixels: it shows
what is far apart. The middle of the map, with all its pixels, shows what is small: rough surfaces
shade and light themselves from one pixel to the next. On both the layers of `shade` are run, what
each effect adds is compared with the whole radiance, and the larger share counts:

    cast shadows        sum of L_d (1 - V), and what of it would have been reflected
    ambient occlusion   the same for light from everywhere
    interreflection     sum of |L_r - L_r(cells, bounces)|, L_r with a cell for each pixel
    specular lobe       sum of L_s

each over the sum of L. These are estimates, times a margin; they are exactly 0 where there is
nothing to do. What finer grids than the pilot's leave is taken from how the error of grids fell on
reliefs that rays were traced on (`docs/shade.md`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.materials.lobes import AbstractLobe
from torchradiometry.numerics import guarded_divide
from torchradiometry.shade.depth_map import DepthSettings, ShadeDepth
from torchradiometry.shade.interreflection import reflected_irradiance
from torchradiometry.sources.base import AbstractSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["DepthLevel", "DepthMaps", "depth_levels"]

#: pixels along the longer edge of a map that is looked at, and a cell for each
PILOT = 32
#: pixels along the edges of the middle that is looked at whole
MIDDLE = 64
#: factor on estimates: the pilot sees a coarser surface
MARGIN = 1.5
#: the same for what cells leave: a cliff is a pixel wide in the map, and a cell in the pilot
COARSE = 2.0
#: cells to choose among, their price in Lambertian shadings, their azimuths, and the share of what
#: 16 x 16 cells leave; 8 x 8 are measured
GRIDS = {8: (12, 8, 1.0), 16: (20, 8, 1.0), 32: (110, 16, 0.75), 64: (600, 16, 0.35)}
#: what azimuths alone leave of reflected light
AZIMUTHS = 0.03
#: bounces and whether a tail follows, and their price
SERIES = ((1, False, 1.0), (1, True, 1.4), (2, True, 1.8), (4, True, 2.5))
#: of all bounces
CONVERGED = (8, True)
#: prices of the others: a shadow for each light, occlusion, a lobe
SHADOW, OCCLUSION, LOBE = 60, 300, 3


class DepthMaps(NamedTuple):
    """What is to be shaded; arguments as of `ShadeDepth`."""

    depth: Float[Tensor, "B 1 H W"]
    albedo: Float[Tensor, "B C H W"]
    sources: Sequence[AbstractSource]
    intrinsics: Float[Tensor, "B 3 3"] | None
    pixel_size: float | None
    specular: Float[Tensor, "B C H W"] | None
    shininess: Float[Tensor, "B 1 H W"] | None
    lobe: type[AbstractLobe]

    def coarse(self) -> DepthMaps:
        """Every s-th pixel, at most `PILOT` along the longer edge."""
        stride = -(-max(self.depth.shape[-2:]) // PILOT)
        first = stride // 2
        return self._cut((slice(first, None, stride), slice(first, None, stride)), stride)

    def middle(self) -> DepthMaps:
        """About `MIDDLE` rows and columns, as far from one edge as from the other."""
        starts = [max(0, (n - MIDDLE) // 2) for n in self.depth.shape[-2:]]
        return self._cut(
            [slice(k, n - k) for k, n in zip(starts, self.depth.shape[-2:], strict=True)]
        )

    def _cut(self, window: Sequence[slice], stride: int = 1) -> DepthMaps:
        """Rows and columns, seen by a camera of its own: pixels of `stride`, the same centre."""
        rows, columns = window

        def part(image: Tensor | None) -> Tensor | None:
            return None if image is None else image[..., rows, columns]

        matrix = self.intrinsics
        if matrix is not None:
            matrix = matrix.clone()
            first = matrix.new_tensor([columns.start, rows.start])
            matrix[..., :2, 2] = (matrix[..., :2, 2] - first - 0.5) / stride + 0.5
            matrix[..., 0, 0], matrix[..., 1, 1] = (
                matrix[..., 0, 0] / stride,
                matrix[..., 1, 1] / stride,
            )
        size = None if self.pixel_size is None else self.pixel_size * stride
        maps = (part(image) for image in (self.depth, self.albedo))
        depth, albedo = (image for image in maps if image is not None)
        specular, shininess = part(self.specular), part(self.shininess)
        return DepthMaps(depth, albedo, self.sources, matrix, size, specular, shininess, self.lobe)

    def shaded(self, **settings: object) -> Float[Tensor, "B C H W"]:
        """Radiance of every image, `B C H W`, with these `DepthSettings`."""
        layer = ShadeDepth(
            DepthSettings(**settings),  # type: ignore[arg-type]
            lobe=self.lobe,
            pixel_size=self.pixel_size,
        )
        return layer(
            self.depth,
            self.albedo,
            self.intrinsics,
            self.specular,
            self.shininess,
            sources=list(self.sources),
        )


class DepthLevel(NamedTuple):
    """One way to treat an effect in one image.

    Attributes:
        name: `left out`, `cast`, `16 cells, 1 bounce`...
        error: relative L1 error of the picture that remains.
        kind: `exact` or `estimate`.
        price: in Lambertian shadings of the same map.
        settings: fields of `DepthSettings`.
    """

    name: str
    error: float
    kind: str
    price: float
    settings: dict[str, object]


@torch.no_grad()
def depth_levels(maps: DepthMaps) -> list[dict[str, tuple[DepthLevel, ...]]]:
    """For every image, each effect's levels from left out to best."""
    worth = _worth(maps.coarse())
    if max(maps.depth.shape[-2:]) > PILOT:
        # also where the middle is all of it: a coarse map has cells as small as its pixels
        worth = [far.or_more(near) for far, near in zip(worth, _worth(maps.middle()), strict=True)]
    lights = sum(s.lights for s in maps.sources if s.has_direction)
    domes = any(not s.has_direction for s in maps.sources)
    glossy = maps.specular is not None and maps.shininess is not None
    return [
        {
            "cast shadows": _hidden("cast_shadows", one.shadows, lights * SHADOW, lights > 0),
            "ambient occlusion": _hidden("ambient_occlusion", one.sky, OCCLUSION, domes),
            "interreflection": _reflections(one, maps.albedo[min(k, len(maps.albedo) - 1)]),
            "specular lobe": _hidden("specular", one.lobe, LOBE, glossy and lights > 0),
        }
        for k, one in enumerate(worth)
    ]


class _Worth(NamedTuple):
    """Shares of an image's radiance.

    Attributes:
        shadows, sky, lobe, reflected: what leaving them out loses.
        coarse: what 8 x 8 and 16 x 16 cells lose.
        series: what each of `SERIES` loses.
    """

    shadows: float
    sky: float
    lobe: float
    reflected: float
    coarse: tuple[float, ...]
    series: tuple[float, ...]

    def or_more(self, other: _Worth) -> _Worth:
        """The larger of each share."""
        one = (*self[:4], *self.coarse, *self.series)
        two = (*other[:4], *other.coarse, *other.series)
        most = [max(pair) for pair in zip(one, two, strict=True)]
        return _Worth(most[0], most[1], most[2], most[3], tuple(most[4:6]), tuple(most[6:]))


def _worth(small: DepthMaps) -> list[_Worth]:
    """What each effect is worth in each image."""
    local: dict[str, object] = {"bounces": 0, "specular": False}
    direct = small.shaded(**local)
    received = _irradiance(small, direct)

    def reflected(cells: int, bounces: int, tail: bool) -> Tensor:
        return (small.albedo / math.pi) * reflected_irradiance(
            small.depth,
            small.albedo,
            received,
            small.intrinsics,
            small.pixel_size,
            cells=(cells, cells),
            bounces=bounces,
            tail=tail,
        )

    every = reflected(max(2, min(PILOT, max(small.depth.shape[-2:]))), *CONVERGED)
    glossy = small.specular is not None and small.shininess is not None
    lobe = small.shaded(bounces=0) - direct if glossy else torch.zeros_like(direct)
    whole = _total(direct + every + lobe)

    def share(image: Tensor) -> list[float]:
        return guarded_divide(_total(image.abs()), whole).tolist()

    open_to_light = small.shaded(bounces=0, cast_shadows=False)
    open_to_sky = small.shaded(**local, ambient_occlusion=False)
    # what is hidden would also have been reflected
    spread = guarded_divide(_total(direct + every), _total(direct), 1.0)[:, None, None, None]
    rough = reflected(8, *CONVERGED)
    return [
        _Worth(one[0], one[1], one[2], one[3], one[4:6], one[6:])
        for one in zip(
            share((open_to_light - direct - lobe) * spread),
            share((open_to_sky - direct) * spread),
            share(lobe),
            share(every),
            share(every - rough),
            share(every - reflected(16, *CONVERGED)),
            *(share(rough - reflected(8, bounces, tail)) for bounces, tail, _ in SERIES),
            strict=True,
        )
    ]


def _irradiance(maps: DepthMaps, radiance: Tensor) -> Tensor:
    """E of a diffuse picture: pi L / albedo, 0 where nothing is reflected."""
    return math.pi * guarded_divide(torch.nan_to_num(radiance), torch.nan_to_num(maps.albedo))


def _total(image: Tensor) -> Tensor:
    return torch.nan_to_num(image).sum((1, 2, 3))


def _hidden(field: str, error: float, price: float, called_for: bool) -> tuple[DepthLevel, ...]:
    """An effect that is there or not."""
    if not called_for:
        return (DepthLevel("left out", 0.0, "exact", 0.0, {field: False}),)
    return (
        DepthLevel("left out", MARGIN * error, "estimate", 0.0, {field: False}),
        DepthLevel("computed", 0.0, "estimate", price, {field: True}),
    )


def _reflections(worth: _Worth, albedo: Tensor) -> tuple[DepthLevel, ...]:
    """Interreflection by cells and bounces, cheapest first, each better than the one before."""
    none: dict[str, object] = {"bounces": 0}
    if not bool((torch.nan_to_num(albedo) > 0).any()):
        return (DepthLevel("left out", 0.0, "exact", 0.0, none),)
    levels = [DepthLevel("left out", MARGIN * worth.reflected, "estimate", 0.0, none)]
    choices = [(grid, series) for grid in GRIDS for series in range(len(SERIES))]
    for cells, series in sorted(choices, key=_price):
        azimuths, share = GRIDS[cells][1:]
        bounces, tail, _ = SERIES[series]
        coarse = worth.coarse[0] if cells == 8 else share * worth.coarse[1]
        left = COARSE * coarse + MARGIN * worth.series[series] + AZIMUTHS * worth.reflected
        if left < levels[-1].error:
            more = " + tail" if tail else ""
            name = f"{cells} x {cells} cells, {bounces} bounce{'s' if bounces > 1 else ''}{more}"
            settings: dict[str, object] = {
                "cells": cells,
                "bounces": bounces,
                "ambient_tail": tail,
                "azimuths": azimuths,
            }
            levels.append(DepthLevel(name, left, "estimate", _price((cells, series)), settings))
    return tuple(levels)


def _price(choice: tuple[int, int]) -> float:
    return GRIDS[choice[0]][0] * SERIES[choice[1]][2]
