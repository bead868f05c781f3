"""The two networks: normals from many lights, pixel by pixel, and normals from one image.

**Photometric.** A pixel under N distant lights is an unordered set of (intensity, light
direction). Turning object and lights together about the viewing direction turns the normal and
changes no intensity (of an isotropic material under a distant camera). The network is built to
obey this exactly: a robust fit of Lambert's law (`robust_normals`) gives each pixel its own frame,
whose z axis is the fitted normal b/|b| and whose x axis leans towards the camera; there the set is
drawn on an *observation map*, a grid over the light direction's (x, y),

    m_f(g) = sum over i of w_i(g) f(I_i) / (sum over i of w_i(g) + w_0),
    w_i(g) = exp(-|l_i,xy - g|^2 / 2 s^2),

of what Lambert's law leaves unexplained. A perceptron reads the map and corrects the normal. Any
number of lights, in any order. With zero weights the network is the robust fit.

**Shading.** A fully convolutional network with skips (image and mask in, normals and paint
out), any height and width.

References: S. Ikehata, "CNN-PS", ECCV 2018 (observation maps); R. J. Woodham (1980); P. W. Holland
and R. E. Welsch, "Robust regression using iteratively reweighted least-squares" (1977);
O. Ronneberger et al., "U-Net", MICCAI 2015.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import require_axes, require_between, require_whole
from torchradiometry.learn.lambert_fit import OUTLIER, STEEP, robust_normals
from torchradiometry.numerics import (
    alike,
    guarded_divide,
    narrow,
    safe_norm,
    safe_normalize,
    safe_sqrt,
    single,
)

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = [
    "PhotometricNetwork",
    "ShadingNetwork",
    "observation_map",
    "relative_to_mean",
]

#: weight below which a cell of the map counts as unlit: one light two widths away
FAINT = 0.1
#: sine of the angle to the camera below which a normal faces it
FACING = 1e-4
#: of the mean: what the shading network takes for black
DARK = 0.02


def observation_map(
    values: Float[Tensor, "*batch light feature"],
    place: Float[Tensor, "*batch light 2"],
    cells: int,
    width: float,
    weight: Float[Tensor, "*batch light 1"] | None = None,
) -> Float[Tensor, "*batch feature+1 cells cells"]:
    """Values of the lights spread over a grid on the disc of light directions.

    Args:
        values: what to draw for each light.
        place: x and y of the light's direction, -1..1.
        cells: grid points along an edge, over -1..1; 1...4096.
        width: standard deviation s of the brush, > 0.
        weight: of each light, 0..1; by default 1.

    Returns:
        Weighted means, and last how well each cell is covered, w/(w + w_0) in 0..1.

    Differentiable in: values, place.
    Export: compile yes, ONNX yes (two matrix products, no scatter).
    """
    require_axes("values", values, None, None)
    require_axes("place", place, None, 2)
    require_whole("cells", cells, 1, 2**12)
    require_between("width", width, 0, 2**10, "the width of the brush, > 0")
    values, place = alike(values, place)
    grid = torch.linspace(-1, 1, cells, dtype=place.dtype, device=place.device)
    x, y = place.unbind(-1)
    along = _brush(x.unsqueeze(-2) - grid.unsqueeze(-1), width)
    across = _brush(y.unsqueeze(-1) - grid, width)
    everything = torch.cat([values, torch.ones_like(values[..., :1])], -1)
    everything = (everything if weight is None else everything * weight).mT
    weighted = (everything.unsqueeze(-2) * along.unsqueeze(-3)).flatten(-3, -2)
    drawn = (weighted @ across).unflatten(-2, (-1, cells))
    covered = drawn[..., -1:, :, :]
    return drawn / (covered + FAINT)


def _brush(distance: Tensor, width: float) -> Tensor:
    """exp(-distance^2 / 2 width^2), cut at e^-30: subnormal products cost a hundredfold."""
    return torch.exp(-(distance * distance / (2 * width * width)).clamp(max=30))


@final
class PhotometricNetwork(nn.Module):
    """Normals of pixels under any number of distant lights.

    Args:
        cells: edge of the observation map.
        features: width of the perceptron.
        depth: number of hidden layers after the first, each with a skip.

    Shapes: intensity `*batch pixel light` (any positive scale), direction `*batch light 3`
    unit -> normal `*batch pixel 3` unit.
    """

    def __init__(self, cells: int = 16, features: int = 384, depth: int = 3) -> None:
        super().__init__()
        self.cells = cells
        self.width = 1.6 / cells
        self.read = nn.Linear(4 * cells * cells + 5, features)
        self.deepen = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(features), nn.Linear(features, features), nn.GELU())
            for _ in range(depth)
        )
        self.answer = nn.Linear(features, 2)
        nn.init.zeros_(self.answer.weight)
        nn.init.zeros_(self.answer.bias)

    def forward(
        self,
        intensity: Float[Tensor, "*batch pixel light"],
        direction: Float[Tensor, "*batch light 3"],
    ) -> Float[Tensor, "*batch pixel 3"]:
        return self.interpret(*self.describe(intensity, direction))

    def describe(self, intensity: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
        """What the perceptron reads, and the pixel's frame: rows x, y and the fitted normal."""
        relative = guarded_divide(intensity, intensity.mean(-1, keepdim=True))
        fitted = robust_normals(relative, direction)
        level = safe_norm(fitted).unsqueeze(-1)
        ahead = torch.tensor([0.0, 0.0, 1.0], dtype=fitted.dtype, device=fitted.device)
        frame = _frame(torch.where(level > 0, guarded_divide(fitted, level), ahead))
        light = torch.einsum("...pij,...lj->...pli", frame, direction)
        facing = light[..., 2]
        share = guarded_divide(relative, level)
        expected = facing.relu()
        values = torch.stack(
            [
                (share - expected).clamp(-1, 1),
                torch.sqrt(share.clamp(min=0, max=9)),
                1 / (1 + ((share - expected) / OUTLIER) ** 2),
            ],
            -1,
        )
        lit, unlit = torch.sigmoid(facing * STEEP), torch.sigmoid(-facing * STEEP)
        drawn = observation_map(values, light[..., :2], self.cells, self.width, lit.unsqueeze(-1))
        # what arrives from lights behind the surface; few of them say little
        behind = (share * unlit).sum(-1, keepdim=True) / (1 + unlit.sum(-1, keepdim=True))
        strange = values[..., 2].mean(-1, keepdim=True)
        brightest = share.amax(-1, keepdim=True).clamp(min=1)
        numbers = [
            frame[..., 2, 2:],
            frame[..., 0, 2:],
            behind.clamp(max=2),
            strange,
            1 / brightest,
        ]
        return torch.cat([drawn.flatten(-3), *numbers], -1), frame

    def interpret(self, described: Tensor, frame: Tensor) -> Tensor:
        """The normal, from what `describe` gave."""
        hidden = nn.functional.gelu(self.read(described))
        for layer in self.deepen:
            hidden = hidden + layer(hidden)
        aside = (self.answer(hidden).unsqueeze(-1) * frame[..., :2, :]).sum(-2)
        return safe_normalize(frame[..., 2, :] + aside)

    def extra_repr(self) -> str:
        return f"cells={self.cells}, intensity, direction [1] -> normal [1]"


def _frame(normal: Tensor) -> Tensor:
    """Rows x, y, z: z the normal, x in the plane of normal and camera, leaning to the camera.

    A normal that faces the camera has the image's x axis.
    """
    nx, ny, nz = normal.unbind(-1)
    flat = torch.sqrt((nx * nx + ny * ny).clamp(min=FACING * FACING))
    aside = (nx * nx + ny * ny > FACING * FACING).to(normal.dtype)
    cx, cy = nx / flat * aside + (1 - aside), ny / flat * aside
    x = torch.stack([-nz * cx, -nz * cy, flat * aside], -1)
    y = torch.stack([cy, -cx, torch.zeros_like(cx)], -1)
    return torch.stack([x, y, torch.stack([nx, ny, nz], -1)], -2)


@final
class ShadingNetwork(nn.Module):
    """Normals and paint from one image and its mask; any height and width.

    Args:
        features: channels at half the resolution, doubled by the next two halvings.

    Shapes: image `B 3 H W` (linear, any positive scale), mask `B 1 H W` (1 on the object) ->
    normal `B 3 H W`, unit on the object and 0 elsewhere, and albedo `B 3 H W` up to a scale, of
    mean 1 on the object and 0 elsewhere.
    """

    def __init__(self, features: int = 32) -> None:
        super().__init__()
        wide = [features, 2 * features, 4 * features, 4 * features]
        self.first = _block(DESCRIBED, wide[0], stride=2)
        self.down = nn.ModuleList(_block(a, b, stride=2) for a, b in pairwise(wide))
        self.middle = _block(wide[-1], wide[-1], dilation=2)
        self.up = nn.ModuleList(
            _block(wide[k + 1] + wide[k], wide[k]) for k in reversed(range(len(wide) - 1))
        )
        self.last = nn.Sequential(nn.Conv2d(wide[0] + DESCRIBED, 24, 3, padding=1), nn.GELU())
        self.answer = nn.Conv2d(24, 6, 3, padding=1)

    def forward(
        self, image: Float[Tensor, "B 3 H W"], mask: Float[Tensor, "B 1 H W"]
    ) -> tuple[Float[Tensor, "B 3 H W"], Float[Tensor, "B 3 H W"]]:
        described = _described(image, mask)
        levels = [self.first(described)]
        for down in self.down:
            levels.append(down(levels[-1]))
        found = self.middle(levels.pop())
        for up in self.up:
            skip = levels.pop()
            found = up(torch.cat([_enlarged(found, skip), skip], 1))
        found = self.last(torch.cat([_enlarged(found, described), described], 1))
        x, y, z, *paint = self.answer(found).unbind(1)
        facing = torch.stack([x, y, nn.functional.softplus(z)], -1)
        normal = safe_normalize(facing).movedim(-1, 1) * mask
        return normal, relative_to_mean(torch.exp(torch.stack(paint, 1).clamp(-6, 6)), mask)

    def extra_repr(self) -> str:
        return "image, mask [1] -> normal, albedo [1]"


#: channels that the shading network reads
DESCRIBED = 8


def relative_to_mean(
    image: Float[Tensor, "B C H W"], mask: Float[Tensor, "B 1 H W"]
) -> Float[Tensor, "B C H W"]:
    """An image divided by its mean over the mask and all channels; 0 outside the mask."""
    require_axes("image", image, None, None, None)
    require_axes("mask", mask, 1, None, None)
    dtype = image.dtype
    image, mask = single(image, mask)
    inside = image * mask
    total = inside.sum((-3, -2, -1), keepdim=True)
    area = mask.sum((-2, -1), keepdim=True) * image.shape[-3]
    return narrow(guarded_divide(inside, guarded_divide(total, area)), dtype)


def _enlarged(image: Tensor, like: Tensor) -> Tensor:
    """Interpolated linearly to the size of `like`."""
    return nn.functional.interpolate(image, size=like.shape[-2:], mode="bilinear")


def _described(image: Tensor, mask: Tensor) -> Tensor:
    """Colour relative to the object's mean, its logarithm, mask, and where in the object's box."""
    relative = relative_to_mean(image, mask).clamp(max=4)
    level = torch.log(relative.mean(1, keepdim=True) + DARK) * mask
    across, down = (torch.cumsum(torch.ones_like(mask), axis) for axis in (-1, -2))
    area = mask.sum((-2, -1), keepdim=True)
    place = [_standing(axis, mask, area) for axis in (across, down)]
    edge = nn.functional.avg_pool2d(mask, 9, stride=1, padding=4)
    return torch.cat([relative, level, mask, edge, *place], 1)


def _standing(axis: Tensor, mask: Tensor, area: Tensor) -> Tensor:
    """A coordinate relative to the object's centre and spread."""
    centre = guarded_divide((axis * mask).sum((-2, -1), keepdim=True), area)
    moved = (axis - centre) * mask
    spread = guarded_divide((moved * moved).sum((-2, -1), keepdim=True), area)
    return guarded_divide(moved, safe_sqrt(spread))


def _block(into: int, out: int, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(into, out, 3, stride=stride, padding=dilation, dilation=dilation),
        nn.GroupNorm(4, out),
        nn.GELU(),
        nn.Conv2d(out, out, 3, padding=1),
        nn.GELU(),
    )
