"""The two networks: normals from many lights, pixel by pixel, and normals from one image.

**Photometric.** A pixel under N distant lights is an unordered set of (intensity, light
direction). Turning object and lights together about the viewing direction turns the normal
and changes no intensity (of an isotropic material under a distant camera). The network is
built to obey this exactly: the least-squares normal b gives each pixel its own frame, in which
b lies over the x axis; there the set is drawn on an *observation map*, a grid over the light
direction's (x, y),

    m_f(g) = sum over i of w_i(g) f(I_i) / (sum over i of w_i(g) + w_0),
    w_i(g) = exp(-|l_i,xy - g|^2 / 2 s^2),

a perceptron reads the map and corrects b, and the answer is turned back. Any number of lights,
in any order.

**Shading.** A fully convolutional network with skips (image luminance and mask in, normals
out), any height and width.

References: S. Ikehata, "CNN-PS", ECCV 2018 (observation maps); R. J. Woodham (1980);
O. Ronneberger et al., "U-Net", MICCAI 2015.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.numerics import guarded_divide, safe_normalize, safe_sqrt

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["PhotometricNetwork", "ShadingNetwork", "least_squares", "observation_map"]

#: weight below which a cell of the map counts as unlit: one light two widths away
FAINT = 0.1
#: ridge added to L^T L, as a share of the number of lights: 1e-4 of a light turns a normal by
#: less than 0.01 degrees and keeps lights that lie in one plane from dividing by zero
RIDGE = 1e-4


def least_squares(
    intensity: Float[Tensor, "*batch pixel light"], direction: Float[Tensor, "*batch light 3"]
) -> Float[Tensor, "*batch pixel 3"]:
    """Woodham's b = (L^T L + r)^-1 L^T I, with a slight ridge r and the inverse written out.

    Differentiable in: both.
    Export: compile yes, ONNX yes (ONNX has no linear solve).
    """
    gram = direction.mT @ direction
    ridge = RIDGE * direction.shape[-2]
    gram = gram + ridge * torch.eye(3, dtype=gram.dtype, device=gram.device)
    return intensity @ direction @ _inverse(gram)


def _inverse(m: Tensor) -> Tensor:
    """Inverse of symmetric positive definite `*batch 3 3` by cross products of its rows."""
    a, b, c = m[..., 0, :], m[..., 1, :], m[..., 2, :]
    bc, ca, ab = _cross(b, c), _cross(c, a), _cross(a, b)
    determinant = (a * bc).sum(-1)[..., None, None]
    return torch.stack([bc, ca, ab], -1) / determinant


def _cross(a: Tensor, b: Tensor) -> Tensor:
    (ax, ay, az), (bx, by, bz) = a.unbind(-1), b.unbind(-1)
    return torch.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], -1)


def observation_map(
    values: Float[Tensor, "*batch light feature"],
    place: Float[Tensor, "*batch light 2"],
    cells: int,
    width: float,
) -> Float[Tensor, "*batch feature+1 cells cells"]:
    """Values of the lights spread over a grid on the disc of light directions.

    Args:
        values: what to draw for each light.
        place: x and y of the light's direction, -1..1.
        cells: grid points along an edge, over -1..1.
        width: standard deviation s of the brush.

    Returns:
        Weighted means, and last how well each cell is covered, w/(w + w_0) in 0..1.

    Differentiable in: values, place.
    Export: compile yes, ONNX yes (two matrix products, no scatter).
    """
    grid = torch.linspace(-1, 1, cells, dtype=place.dtype, device=place.device)
    x, y = place.unbind(-1)
    along = _brush(x.unsqueeze(-2) - grid.unsqueeze(-1), width)
    across = _brush(y.unsqueeze(-1) - grid, width)
    everything = torch.cat([values.mT, torch.ones_like(x).unsqueeze(-2)], -2)
    weighted = (everything.unsqueeze(-2) * along.unsqueeze(-3)).flatten(-3, -2)
    drawn = (weighted @ across).unflatten(-2, (-1, cells))
    weight = drawn[..., -1:, :, :]
    return torch.cat([drawn[..., :-1, :, :], weight], -3) / (weight + FAINT)


def _brush(distance: Tensor, width: float) -> Tensor:
    """exp(-distance^2 / 2 width^2), cut at e^-30.

    Beyond it the products would be subnormal numbers, which processors multiply a hundred
    times more slowly; a share of e^-30 is far below the rounding of the sum.
    """
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
        self.read = nn.Linear(4 * cells * cells + 4, features)
        self.deepen = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(features), nn.Linear(features, features), nn.GELU())
            for _ in range(depth)
        )
        self.answer = nn.Linear(features, 3)
        nn.init.zeros_(self.answer.weight)
        nn.init.zeros_(self.answer.bias)

    def forward(
        self,
        intensity: Float[Tensor, "*batch pixel light"],
        direction: Float[Tensor, "*batch light 3"],
    ) -> Float[Tensor, "*batch pixel 3"]:
        described, start, turn = self.describe(intensity, direction)
        return self.interpret(described, start, turn)

    def describe(self, intensity: Tensor, direction: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What the perceptron reads, the least-squares normal in the pixel's frame, the frame."""
        mean = intensity.mean(-1, keepdim=True)
        relative = guarded_divide(intensity, mean)
        start = safe_normalize(least_squares(relative, direction))
        turn = _heading(start)
        light = direction.unsqueeze(-3)
        place = torch.stack(
            [
                light[..., 0] * turn[..., :1] + light[..., 1] * turn[..., 1:],
                light[..., 1] * turn[..., :1] - light[..., 0] * turn[..., 1:],
            ],
            -1,
        )
        brightest = relative.amax(-1, keepdim=True)
        values = torch.stack(
            [guarded_divide(relative, brightest), relative.clamp(max=4), (relative * 0.25).sqrt()],
            -1,
        )
        level = torch.sqrt((start[..., :2] ** 2).sum(-1, keepdim=True))
        along = torch.cat([level, torch.zeros_like(level), start[..., 2:]], -1)
        drawn = observation_map(values, place, self.cells, self.width).flatten(-3)
        return torch.cat([drawn, along, 1 / brightest.clamp(min=1)], -1), along, turn

    def interpret(self, described: Tensor, along: Tensor, turn: Tensor) -> Tensor:
        """The normal, from what `describe` gave."""
        hidden = nn.functional.gelu(self.read(described))
        for layer in self.deepen:
            hidden = hidden + layer(hidden)
        found = along + self.answer(hidden)
        x = found[..., :1] * turn[..., :1] - found[..., 1:2] * turn[..., 1:]
        y = found[..., :1] * turn[..., 1:] + found[..., 1:2] * turn[..., :1]
        return safe_normalize(torch.cat([x, y, found[..., 2:]], -1))

    def extra_repr(self) -> str:
        return f"cells={self.cells}, intensity, direction [1] -> normal [1]"


def _heading(start: Tensor) -> Tensor:
    """Unit (x, y) of the least-squares normal; (1, 0) where it faces the camera."""
    flat = start[..., :2]
    aside = (flat.abs().amax(-1, keepdim=True) > 0).to(flat.dtype)
    ahead = torch.stack([torch.ones_like(flat[..., 0]), torch.zeros_like(flat[..., 0])], -1)
    return safe_normalize(flat * aside + ahead * (1 - aside))


@final
class ShadingNetwork(nn.Module):
    """Normals from the luminance of one image and its mask; any height and width.

    Args:
        features: channels at half the resolution, doubled by the next two halvings.

    Shapes: luminance `B 1 H W` (any positive scale), mask `B 1 H W` (1 on the object) ->
    normal `B 3 H W`, unit on the object and 0 elsewhere.
    """

    def __init__(self, features: int = 32) -> None:
        super().__init__()
        wide = [features, 2 * features, 4 * features, 4 * features]
        self.first = _block(4, wide[0], stride=2)
        self.down = nn.ModuleList(_block(a, b, stride=2) for a, b in pairwise(wide))
        self.middle = _block(wide[-1], wide[-1], dilation=2)
        self.up = nn.ModuleList(
            _block(wide[k + 1] + wide[k], wide[k]) for k in reversed(range(len(wide) - 1))
        )
        self.last = nn.Sequential(nn.Conv2d(wide[0] + 4, 16, 3, padding=1), nn.GELU())
        self.answer = nn.Conv2d(16, 3, 3, padding=1)

    def forward(
        self, luminance: Float[Tensor, "B 1 H W"], mask: Float[Tensor, "B 1 H W"]
    ) -> Float[Tensor, "B 3 H W"]:
        described = _described(luminance, mask)
        levels = [self.first(described)]
        for down in self.down:
            levels.append(down(levels[-1]))
        found = self.middle(levels.pop())
        for up in self.up:
            skip = levels.pop()
            found = up(torch.cat([_enlarged(found, skip), skip], 1))
        found = self.last(torch.cat([_enlarged(found, described), described], 1))
        x, y, z = self.answer(found).unbind(1)
        facing = torch.stack([x, y, nn.functional.softplus(z)], -1)
        return safe_normalize(facing).movedim(-1, 1) * mask

    def extra_repr(self) -> str:
        return "luminance, mask [1] -> normal [1]"


def _enlarged(image: Tensor, like: Tensor) -> Tensor:
    """Interpolated linearly to the size of `like`."""
    return nn.functional.interpolate(image, size=like.shape[-2:], mode="bilinear")


def _described(luminance: Tensor, mask: Tensor) -> Tensor:
    """Luminance relative to its mean on the object, mask, and where in the object's box."""
    inside = luminance * mask
    area = mask.sum((-2, -1), keepdim=True)
    relative = guarded_divide(inside, guarded_divide(inside.sum((-2, -1), keepdim=True), area))
    across, down = (torch.cumsum(torch.ones_like(mask), axis) for axis in (-1, -2))
    place = [_standing(axis, mask, area) for axis in (across, down)]
    return torch.cat([relative.clamp(max=4), mask, *place], 1)


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
