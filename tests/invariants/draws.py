"""What invariants are drawn from: seeds, rigid motions, and how each number of a module moves.

One run of a property is one seed and the numbers that one would want to see shrink; batches of
points, directions or rooms, each an example of its own, come from the seed. CI checks at least
200 examples of every property, `pytest --thorough` 10,000.

A module is moved by the *names* of its tensors (`ROLES`): a new source or material is covered
without a new line here, unless it brings a word that the house does not know.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import torch
from hypothesis import settings
from hypothesis import strategies as st
from torch import Tensor, nn

from torchradiometry.sources import harmonic_basis

#: examples of each property; `--thorough` loads a profile of 10,000
EXAMPLES = max(200, settings().max_examples)


def invariant(batch: int = 1) -> settings:
    """At least `EXAMPLES` examples, where one run of the property checks `batch` of them."""
    return settings(max_examples=-(-EXAMPLES // batch), deadline=None)


seeds = st.integers(0, 2**31 - 1)
#: factors that change every digit of a number
factors = st.floats(-3, 3).map(lambda power: 10.0**power)

#: rounding of one evaluation in float64, relative to the largest value of the batch
ROUNDING = 2e-13

#: what a rigid motion, a change of scale and a change of power do to a tensor, by its name
PLACES = {"position", "center", "corners"}
DIRECTIONS = {"direction", "axis", "up", "outward"}
LENGTHS = {"radius"}
POWERS = {"radiance", "irradiance"}
PER_DISTANCE = {"intensity"}  # W/sr: E falls with the square of the distance
HARMONICS = {"coefficients"}
NUMBERS = {"inner_cone", "outer_cone", "weight", "tile", "portion"}
ROLES = PLACES | DIRECTIONS | LENGTHS | POWERS | PER_DISTANCE | HARMONICS | NUMBERS


class Motion:
    """x -> scale R x + shift."""

    def __init__(self, seed: int, scale: float = 1.0, reach: float = 10.0) -> None:
        draw = torch.Generator().manual_seed(seed)
        frame = torch.linalg.qr(torch.randn(3, 3, generator=draw, dtype=torch.float64))[0]
        self.rotation = frame * torch.linalg.det(frame)
        self.shift = reach * torch.randn(3, generator=draw, dtype=torch.float64) * scale
        self.scale = scale

    def turn(self, direction: Tensor) -> Tensor:
        return direction @ self.rotation.mT

    def move(self, place: Tensor) -> Tensor:
        return self.scale * self.turn(place) + self.shift

    def _harmonics(self, coefficients: Tensor) -> Tensor:
        """Coefficients of the turned environment: L'(R w) = L(w)."""
        draw = torch.Generator().manual_seed(0)
        w = torch.randn(40, 3, generator=draw, dtype=torch.float64)
        w = w / w.norm(dim=-1, keepdim=True)
        turned = torch.linalg.lstsq(harmonic_basis(self.turn(w)), harmonic_basis(w)).solution
        return turned @ coefficients

    def of(self, module: nn.Module) -> nn.Module:
        """The module, moved; its powers are such that it makes the same irradiance."""
        moved = copy.deepcopy(module)
        for name, tensor in moved.named_buffers():
            key = known(name)
            if key in PLACES:
                tensor.copy_(self.move(tensor))
            elif key in DIRECTIONS:
                tensor.copy_(self.turn(tensor))
            elif key in LENGTHS:
                tensor.mul_(self.scale)
            elif key in PER_DISTANCE:
                tensor.mul_(self.scale**2)
            elif key in HARMONICS:
                tensor.copy_(self._harmonics(tensor))
        return moved


def known(name: str) -> str:
    """The last word of a tensor's name, which the house must know."""
    key = name.split(".")[-1]
    assert key in ROLES, f"say in ROLES what a motion does to `{key}`"
    return key


def brighter(module: nn.Module, factor: float) -> nn.Module:
    """The module with all its powers times a factor."""
    found = copy.deepcopy(module)
    for name, tensor in found.named_buffers():
        if known(name) in POWERS | PER_DISTANCE | HARMONICS:
            tensor.mul_(factor)
    return found


def generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def units(draw: torch.Generator, *shape: int) -> Tensor:
    v = torch.randn(*shape, 3, generator=draw, dtype=torch.float64)
    return v / v.norm(dim=-1, keepdim=True)


def uniform(draw: torch.Generator, *shape: int, low: float = 0.0, high: float = 1.0) -> Tensor:
    return low + (high - low) * torch.rand(shape, generator=draw, dtype=torch.float64)


def same(found: Tensor, expected: Tensor, rounding: float = ROUNDING) -> None:
    """Equal but for roundings of the largest value."""
    scale = float(expected.detach().abs().max()) if expected.numel() else 0.0
    torch.testing.assert_close(found, expected, rtol=0, atol=rounding * max(scale, 1e-300))


def repeats(function: Callable[[], Tensor]) -> Tensor:
    """The value, after a second run gave the same bits."""
    first, second = function(), function()
    assert torch.equal(first, second)
    return first
