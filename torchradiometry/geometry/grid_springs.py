"""Springs between neighbouring pixels: the Poisson equation of an image, with natural borders.

    energy = sum over pairs of k (h_next - h - s)^2      =>      D^T k D h = D^T (k s)

k is the stiffness of the spring between a pixel and the next one, to the right or below, s the
step that it would like, D the difference. Where there is no pair k = 0, so nothing has to be said
about borders, holes or pieces; each piece floats freely, and only its mean is unknown.

The system is solved by conjugate gradients. One cycle of multigrid is the preconditioner: 2 x 2
pixels are one of the next grid, and springs that run side by side between two of those add up.
Half of their sum is the right one for a surface that is smooth, since there the spring of the next
grid is twice as long (Braess 1995). Pixels are smoothed by damped Jacobi steps.

The solve is its own adjoint: with g the gradient that arrives and D^T k D a = g,

    d energy / d (k s) = D a,        d energy / dk = -(D a) (D h).

References: D. Braess, "Towards algebraic multigrid for elliptic problems of second order",
Computing 55 (1995); O. Tatebe, "The multigrid preconditioned conjugate gradient method" (1993).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn import functional

from torchradiometry.numerics import guarded_divide

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Springs", "pieces", "relaxed", "without_mean"]

#: the error that is left, relative to the solution, in the norm of the energy: of a solution, and
#: of a guess for the next one
ENOUGH, ROUGHLY = 2.0**-34, 2.0**-14
#: steps of conjugate gradients at most
MOST = 500
#: damping of a Jacobi step, and how many there are before and after the coarser grids
DAMPING, SWEEPS = 0.8, 2


class Springs(NamedTuple):
    """One number for each pair of neighbours, at the place of its first pixel.

    Attributes:
        right: between a pixel and the one to its right; the last column is 0.
        down: between a pixel and the one below; the last row is 0.
    """

    right: Float[Tensor, "B H W"]
    down: Float[Tensor, "B H W"]

    def times(self, other: Springs) -> Springs:
        """Pair by pair."""
        return Springs(self.right * other.right, self.down * other.down)


class Level(NamedTuple):
    """One grid: stiffness, and the inverse of the matrix's diagonal, 0 where no spring ends."""

    stiffness: Springs
    inverse: Float[Tensor, "B H W"]


def steps_of(height: Float[Tensor, "B H W"]) -> Springs:
    """D h: next minus this."""
    right = functional.pad(height[..., 1:] - height[..., :-1], (0, 1))
    return Springs(right, functional.pad(height[..., 1:, :] - height[..., :-1, :], (0, 0, 0, 1)))


def pulls(force: Springs) -> Float[Tensor, "B H W"]:
    """D^T f of forces whose last column and row are 0."""
    right = functional.pad(force.right[..., :-1], (1, 0)) - force.right
    return right + functional.pad(force.down[..., :-1, :], (0, 0, 1, 0)) - force.down


def relaxed(
    stiffness: Springs, force: Springs, start: Float[Tensor, "B H W"], enough: float = ENOUGH
) -> tuple[Float[Tensor, "B H W"], Float[Tensor, "B"], int]:
    """h with D^T k D h = D^T f, found from a first guess.

    Args:
        stiffness: k >= 0, float64.
        force: f = k s; 0 where k is.
        start: any heights.
        enough: the error to stop at.

    Returns:
        h; the error that is left of each, relative, in the norm of the energy; and the steps that
        it took. The mean of each piece is arbitrary.

    Differentiable in: stiffness and force, once.
    Export: no, it stops when it is good enough.
    """
    height, left, steps = _Relaxed.apply(enough, *stiffness, *force, start)
    return height, left, int(steps)


def pieces(joined: tuple[Bool[Tensor, "B H W"], Bool[Tensor, "B H W"]]) -> Int[Tensor, "B H W"]:
    """For each pixel the lowest number of a pixel of its piece, counted through the batch.

    Args:
        joined: whether a pixel and its right, its lower neighbour belong together; the last
            column and row are False.
    """
    shape, right, down = joined[0].shape, *(j.flatten().nonzero().squeeze(1) for j in joined)
    ends = torch.cat((right, down)), torch.cat((right + 1, down + shape[-1]))
    label = torch.arange(joined[0].numel(), device=joined[0].device)
    while True:
        a, b = label[ends[0]], label[ends[1]]
        if torch.equal(a, b):
            return label.reshape(shape)
        lower = torch.minimum(a, b)
        label = label.scatter_reduce(0, torch.cat((a, b)), torch.cat((lower, lower)), "amin")
        while not torch.equal(label[label], label):
            label = label[label]


def without_mean(
    height: Float[Tensor, "B H W"], piece: Int[Tensor, "B H W"]
) -> Float[Tensor, "B H W"]:
    """Heights less the mean of their piece."""
    index = piece.flatten()
    sums = torch.zeros_like(height.flatten()).index_add(0, index, height.flatten())
    count = torch.zeros_like(sums).index_add(0, index, torch.ones_like(sums))
    return height - (sums / count.clamp(min=1))[index].reshape(height.shape)


class _Relaxed(torch.autograd.Function):
    """`relaxed`, with the gradient of the solution and not of the steps."""

    @staticmethod
    def forward(ctx: Any, enough: float, *tensors: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        right, down, force_right, force_down, start = tensors
        stiffness = Springs(right, down)
        wanted = pulls(Springs(force_right, force_down))
        height, left, steps = _conjugate_gradients(stiffness, wanted, start, enough)
        ctx.enough = enough
        ctx.save_for_backward(right, down, height)
        ctx.mark_non_differentiable(left, steps)
        return height, left, steps

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        right, down, height = ctx.saved_tensors
        stiffness = Springs(right, down)
        joined = right != 0, down != 0
        wanted = without_mean(gradients[0], pieces(joined))
        aside, _, _ = _conjugate_gradients(stiffness, wanted, 0 * height, ctx.enough)
        force, step = steps_of(aside), steps_of(height)
        stiff = force.times(step)
        return None, -stiff.right, -stiff.down, force.right, force.down, None


def _conjugate_gradients(
    stiffness: Springs, wanted: Tensor, start: Tensor, enough: float
) -> tuple[Tensor, Tensor, Tensor]:
    """All images of the batch together; one that is good enough stands still."""

    def inner(a: Tensor, b: Tensor) -> Tensor:
        return (a * b).sum((-2, -1), keepdim=True)

    levels = _levels(stiffness)
    height, rest = start, wanted - _applied(stiffness, start)
    ahead = ready = _cycle(levels, rest)
    power, whole = inner(rest, ready), inner(wanted, _cycle(levels, wanted))
    steps = 0
    while steps < MOST and bool((power > enough**2 * whole).any()):
        pushed = _applied(stiffness, ahead)
        length = guarded_divide(power, inner(ahead, pushed))
        length = torch.where(power > enough**2 * whole, length, 0)
        height, rest = height + length * ahead, rest - length * pushed
        ready = _cycle(levels, rest)
        power, before = inner(rest, ready), power
        ahead = ready + guarded_divide(power, before) * ahead
        steps += 1
    left = guarded_divide(power.clamp(min=0), whole).sqrt().flatten()
    return height, left, torch.tensor(steps)


def _applied(stiffness: Springs, height: Tensor) -> Tensor:
    """D^T k D h."""
    return pulls(stiffness.times(steps_of(height)))


def _levels(stiffness: Springs) -> list[Level]:
    """From the finest grid to a single pixel."""
    levels = []
    while True:
        right, down = stiffness
        total = right + functional.pad(right[..., :-1], (1, 0))
        total = total + down + functional.pad(down[..., :-1, :], (0, 0, 1, 0))
        levels.append(Level(stiffness, guarded_divide(torch.ones_like(total), total)))
        if right.shape[-2:].numel() == 1:
            return levels
        # pairs within a pixel of the next grid vanish; pairs between two of them add up
        right, down = (_halved(k) for k in stiffness)
        stiffness = Springs(right[..., 1].sum(-1) / 2, down[..., 1, :].sum(-1) / 2)


def _halved(image: Tensor) -> Tensor:
    """`B H W` as `B H/2 W/2 2 2`, padded to even sizes."""
    image = functional.pad(image, (0, image.shape[-1] % 2, 0, image.shape[-2] % 2))
    return image.unflatten(-1, (-1, 2)).unflatten(-3, (-1, 2)).transpose(-3, -2)


def _cycle(levels: list[Level], rest: Tensor) -> Tensor:
    """One V-cycle from height 0: symmetric, and positive on what is not a mean."""
    (stiffness, inverse), *coarser = levels
    inverse = DAMPING * inverse
    height = inverse * rest
    for _ in range(SWEEPS - 1):
        height = height + inverse * (rest - _applied(stiffness, height))
    if not coarser:
        return height
    left = _halved(rest - _applied(stiffness, height)).sum((-2, -1))
    moved = _cycle(coarser, left).repeat_interleave(2, -2).repeat_interleave(2, -1)
    height = height + moved[..., : rest.shape[-2], : rest.shape[-1]]
    for _ in range(SWEEPS):
        height = height + inverse * (rest - _applied(stiffness, height))
    return height
