"""Horizons: how far up the surface reaches, seen from each pixel in each direction.

    c(x, a) = max over k of cot theta of the surface k steps away, and of the tangent plane

theta counts from the ray to the eye (`image_space`), so what is lit from theta = 0 to the horizon
arccot c. The irradiance by a radiance of 1 from theta = 0 to arccot c within the azimuth d phi is

    g(c) d phi,   g = n_v sin^2(theta) / 2 + n_t (theta - sin(theta) cos(theta)) / 2,

n_v, n_t the components of the normal along the eye and along the slice; its first moments are those
of `cosine_moments`. Nothing is sampled in theta: along each azimuth the integrals are exact.

References: J. Jimenez, X. Wu, A. Pesce and A. Jarabo, "Practical Real-Time Strategies for
Accurate Indirect Occlusion", SIGGRAPH 2016 courses (slices through the eye's ray); L. Bavoil,
M. Sainz and R. Dimitrov, "Image-space horizon-based ambient occlusion", SIGGRAPH 2008 talks.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.image_space import (
    HeightField,
    Slices,
    View,
    pixel_axis,
    slices,
)
from torchradiometry.numerics import arccot
from torchradiometry.transport.depth_maps.azimuths import azimuth_steps

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["SlicedPixels", "below", "cosine_moments", "lit_share", "sliced_pixels"]

#: what rises less than this over the tangent plane, in radians, does not count: ten times the
#: rounding of float32 slopes; light from there has a cosine of 1e-4 and a share of 1e-8
CLEARANCE = 1e-4
#: smallest cosine between a normal and the ray to the eye; below it the surface is seen edge-on
EDGE_ON = 1e-3


class SlicedPixels(NamedTuple):
    """Some pixels of a map, cut by slices; pixels come before images, as rows of memory.

    Attributes:
        heights: of all pixels of the map, and a last row far below for everything outside,
            `one_more B`.
        own: heights of the pixels cut, `pixel B`.
        pixel: their u and v, `pixel`.
        step: du and dv, `azimuth 1`.
        slices: of each pixel, `azimuth pixel B`.
        normal: n_v `pixel B` and n_t `azimuth pixel B`; 0 where no surface faces the camera.
        tangent: cot theta of the tangent plane, `azimuth pixel B`.
        weight: d phi of each slice, `azimuth pixel B|1`.
        size: height and width of the map.
    """

    heights: Float[Tensor, "one_more B"]
    own: Float[Tensor, "pixel B"]
    pixel: tuple[Float[Tensor, "pixel"], Float[Tensor, "pixel"]]
    step: tuple[Float[Tensor, "azimuth 1"], Float[Tensor, "azimuth 1"]]
    slices: Slices
    normal: tuple[Float[Tensor, "pixel B"], Float[Tensor, "azimuth pixel B"]]
    tangent: Float[Tensor, "azimuth pixel B"]
    weight: Float[Tensor, "azimuth pixel B"]
    size: tuple[int, int]


def sliced_pixels(
    field: HeightField,
    view: View,
    normal: Float[Tensor, "B 3 H W"],
    azimuths: int,
    chosen: Int[Tensor, "pixel"] | None = None,
) -> SlicedPixels:
    """Cut pixels by `azimuths` half-slices, evenly spread over the picture.

    Args:
        field, view, normal: the map.
        azimuths: how many.
        chosen: row * width + column of the pixels to cut; None is all.

    Differentiable in: heights, normal, the view.
    Export: compile yes, ONNX yes.
    """
    rows, columns = field.height.shape[-2:]
    u = pixel_axis(columns, normal).unsqueeze(0).expand(rows, columns).reshape(-1)
    v = pixel_axis(rows, normal).unsqueeze(1).expand(rows, columns).reshape(-1)
    step = azimuth_steps(azimuths, normal)
    heights, n = field.height.flatten(1).mT, normal.flatten(2).permute(2, 1, 0)
    own = heights
    if chosen is not None:
        u, v = u[chosen], v[chosen]
        own, n = heights.index_select(0, chosen), n.index_select(0, chosen)
    images = view.map(lambda t: t.reshape(-1))
    ends = tuple(t.unsqueeze(-1) for t in step)
    cut = slices(images, own, (u.unsqueeze(-1), v.unsqueeze(-1)), ends)  # type: ignore[arg-type]
    along, beside = (n[:, 0] * x + n[:, 1] * y + n[:, 2] * z for x, y, z in (cut.eye, cut.side))
    facing = along > EDGE_ON
    along, beside = torch.where(facing, along, 0), torch.where(facing, beside, 0)
    level = -beside / torch.where(facing, along, 1)
    held = torch.where(field.seen.flatten(1).mT, heights, below(heights))
    return SlicedPixels(
        torch.cat((held, torch.full_like(held[:1], below(held)))),
        own,
        (u, v),
        step,
        cut,
        (along, beside),
        level + CLEARANCE * (1 + level * level),
        cut.density * (math.tau / azimuths),
        (rows, columns),
    )


def below(height: Tensor) -> float:
    """A height far below every surface: nothing is there."""
    # of float32 also in float64: exported graphs hold such numbers in float32
    return -(
        torch.finfo(torch.float32 if height.dtype == torch.float64 else height.dtype).max ** 0.5
    )


def lit_share(cot: Tensor, normal: tuple[Tensor, Tensor]) -> Tensor:
    """g(c): irradiance by a radiance of 1 from the eye's ray to the horizon, per radian of azimuth.

    Args:
        cot: c, of the horizon's angle.
        normal: (n_v, n_t).

    Differentiable in: all.
    Export: compile yes, ONNX yes.
    """
    square = 0.5 / (1 + cot * cot)
    return normal[0] * square + normal[1] * (arccot(cot) / 2 - cot * square)


def cosine_moments(cot: Tensor, normal: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """Like `lit_share`, times cos(theta) and times sin(theta): the bent normal along v^ and t^."""
    sine = (1 + cot * cot).rsqrt()
    cosine = cot * sine
    cube, sine_cube = (1 - cosine**3) / 3, sine**3 / 3
    return (
        normal[0] * cube + normal[1] * sine_cube,
        normal[0] * sine_cube + normal[1] * (2 / 3 - cosine + cosine**3 / 3),
    )
