"""Light that the parts of a depth map send each other, in slices through its pixels.

    E(x) = sum over azimuths a and steps k of   w_ak(x) (B(x + s_{k-1} e_a) + B(x + s_k e_a)) / 2
    w_ak = (g(c_{k-1}) - g(c_k)) d phi / pi

x is a probe, a pixel that receives; B is known on cells of the map. c_k is the horizon after
the step s_k (`horizons`): between c_{k-1} and c_k a probe sees the piece of surface between
s_{k-1} and s_k, wholly, or as far as it rises over what lies nearer, and g integrates its
cosine in closed form. So visibility, the cosine and the near field are those of the surface
along the slice. Weights move continuously with the heights, also where a surface appears from
behind another: gradients contain the motion of what hides.

Rows sum to at most 1, whatever the surface: sum of w = 1 - V, V the visible share of the sky.

References: as `horizons`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.transport.depth_maps.azimuths import gathered, neighbours
from torchradiometry.transport.depth_maps.horizons import SlicedPixels, lit_share

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["SliceExchange", "slice_exchange"]


class SliceExchange(NamedTuple):
    """What each probe receives from the cells of a map; step 0 is the probe itself.

    Attributes:
        cell: where each step ends; the number after the last cell is outside.
        weight: of its radiosity in the irradiance of the probe.
    """

    cell: Int[Tensor, "step azimuth probe"]
    weight: Float[Tensor, "step azimuth probe B"]

    def irradiance(
        self, radiosity: Float[Tensor, "channel cell B"]
    ) -> Float[Tensor, "channel probe B"]:
        """E of every probe by the radiosities of the cells, W/m2."""
        rows = torch.cat((radiosity, torch.zeros_like(radiosity[:, :1])), 1)
        place = self.cell.flatten()
        met = (row.index_select(0, place).reshape(self.weight.shape) for row in rows)
        return torch.stack([(self.weight * channel).sum((0, 1)) for channel in met])


def slice_exchange(
    probes: SlicedPixels,
    steps: Float[Tensor, "step fine"],
    cell_of: Int[Tensor, "one_more"],
    own_cell: Int[Tensor, "probe"],
) -> SliceExchange:
    """What the probes receive.

    Takes 2 x steps x azimuths x probes numbers an image.

    Args:
        probes: pixels that receive.
        steps: rising whole distances in pixels at which the surface is looked at; a row of them
            is one step from cell to cell.
        cell_of: the cell of each pixel of the map, and of everything outside.
        own_cell: of each probe.

    Differentiable in: heights, normals, the view.
    Export: compile yes, ONNX yes.
    """
    count = steps.reshape(-1, 1, 1)
    where = neighbours(probes.size, probes.pixel, probes.step, count)
    slope = (gathered(probes.heights, where) - probes.own) / count.unsqueeze(-1)
    steepest = slope.unflatten(0, steps.shape).amax(1)
    horizons = [probes.tangent]
    for met in (probes.slices.alpha * steepest + probes.slices.beta).unbind(0):
        horizons.append(torch.maximum(horizons[-1], met))
    # half of each piece of surface to either end: (c_{k-1} - c_k)/2 + (c_k - c_{k+1})/2
    cot = torch.stack([horizons[0], *horizons, horizons[-1]])
    share = lit_share(cot, probes.normal)
    # equal horizons hide exactly nothing, though arc functions may round them differently
    risen = torch.where(cot[2:] > cot[:-2], share[:-2] - share[2:], 0)
    weight = risen * (probes.weight / math.tau)
    ends = neighbours(probes.size, probes.pixel, probes.step, steps[:, -1:, None])
    nearest = torch.where(ends.share.detach() < 0.5, ends.first, ends.second)
    here = own_cell.expand_as(nearest[:1])
    return SliceExchange(torch.cat((here, cell_of[nearest])), weight)
