"""Southwell relaxation: the patches with the most light not yet sent shoot first.

    B_i += rho_i sum_j F_ij u_j,   u likewise,   u_j <- 0      for the brightest patches j

u is the light that a patch has but has not sent on (at first B = u = M). At any time
B = M + rho F (B - u), so B is a lower bound of the solution that grows with every shot, and
its residual is rho F u. This is progressive radiosity: it may stop after any shot.

Unlike the textbook several patches shoot at once, the brightest by A_j sum_channels u_j, which
turns many small products into one; and after each full turn (as many shots as patches), where
the areas are known, an energy balance (`balance`) adds the ambient light that is still
missing, after which u may be negative.

References: R. Southwell, *Relaxation Methods in Engineering Science* (1940); M. Cohen,
S. Chen, J. Wallace and D. Greenberg, "A Progressive Refinement Approach to Fast Radiosity
Image Generation", SIGGRAPH 1988.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple, final

import torch
from torch import Tensor

from torchradiometry.errors import OutOfRangeError, require_whole
from torchradiometry.solve.ambient import with_ambient_tail
from torchradiometry.solve.balance import Balance, balance_of
from torchradiometry.solve.operators import AbstractOperator, reflected
from torchradiometry.solve.solver import AbstractSolver, Approximation
from torchradiometry.solve.stopping import allowed_residual, check_limits, settled

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["Southwell"]


#: turns without progress after which nothing is expected of more shots
STALLED = 100


class _Shooting(NamedTuple):
    """B and what of it has not been sent on, W/m2."""

    radiosity: Float[Tensor, "*batch patch channel"]
    unsent: Float[Tensor, "*batch patch channel"]


class _Watch(NamedTuple):
    """The most light unsent of each system, in the last hundred turns and since, W/m2."""

    before: Tensor
    since: Tensor
    start: int
    stalled: bool = False

    def seen(self, unsent: Tensor, shots: int, patches: int) -> _Watch:
        since = torch.fmax(self.since, unsent.abs().amax(-2))
        if shots - self.start < STALLED * patches:
            return self._replace(since=since)
        return _Watch(since, torch.zeros_like(since), shots, not bool((since < self.before).any()))


@final
@dataclass(frozen=True)
class Southwell(AbstractSolver):
    """Progressive radiosity.

    Args:
        tolerance: stop when the error is known to be below this share of the largest
            radiosity, or (always) when the light not sent is down to rounding.
        max_shots: shots of single patches that are fired at most; status NOT_CONVERGED then, as
            when the light not yet sent is, for a hundred turns (as many shots as patches),
            no less than in the hundred before: then it does not converge.
        max_seconds: the same in s of wall time; None for no such limit.
        ambient_tail: add the calibrated ambient term for the light not sent.
        at_once: patches that shoot together.

    Differentiable in: nothing by itself; see `Implicit`.
    Export: no, the order of shots depends on the data.

    >>> import torch
    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])
    >>> half = torch.full((2, 1), 0.5)
    >>> Southwell().solve(F, half, half).radiosity.T
    tensor([[1., 1.]])
    >>> early = Southwell(max_shots=1, at_once=1).solve(F, half, half)
    >>> early.radiosity.T, early.bound >= 0.5
    (tensor([[0.5000, 0.7500]]), tensor([True]))
    """

    tolerance: float = 0.0
    max_shots: int = 10**6
    max_seconds: float | None = None
    ambient_tail: bool = False
    at_once: int = 32
    promises: ClassVar[bool] = True
    unrolls: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_limits(self.tolerance, "max_shots", self.max_shots)
        require_whole("at_once", self.at_once, 1)
        if self.max_seconds is not None and not self.max_seconds >= 0:
            raise OutOfRangeError("max_seconds", f"{self.max_seconds}", "pass s >= 0 or None")

    def approximate(
        self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor
    ) -> Approximation:
        began, patches, shots = time.monotonic(), operator.patches, 0
        allowed = allowed_residual(operator, albedo, self.tolerance)
        balance, turn = balance_of(operator, albedo), patches
        now = _Shooting(exitance, _sendable(operator, exitance))
        watch = _Watch(now.unsent.new_tensor(torch.inf), now.unsent.new_tensor(0.0), 0)
        while True:
            done = settled(now.unsent, now.radiosity, allowed)
            late = self.max_seconds is not None and time.monotonic() - began > self.max_seconds
            watch = watch.seen(now.unsent, shots, patches)
            if bool(done.all()) or late or watch.stalled or shots >= self.max_shots:
                break
            count = min(self.at_once, self.max_shots - shots, patches)
            now, shots = _shot(now, operator, albedo, count), shots + count
            if shots >= turn and balance is not None:
                now, turn = _balanced(now, balance, albedo), turn + patches
                now = now._replace(unsent=_sendable(operator, now.unsent))
        products = -(-shots // max(patches, 1)) + 2 * (balance is not None)
        found = Approximation(now.radiosity, products, converged=done)
        if not self.ambient_tail:
            return found
        rest = reflected(operator, albedo, now.unsent)
        return with_ambient_tail(operator, albedo, found._replace(products=products + 1), rest)


def _shot(now: _Shooting, operator: AbstractOperator, albedo: Tensor, count: int) -> _Shooting:
    """The `count` brightest patches send what they have."""
    # a system that is not finite is settled, and must not hide the brightest of the others
    power = torch.where(torch.isfinite(now.unsent), now.unsent.abs(), 0).sum(-1)
    power = power if operator.area is None else power * operator.area
    index = power.topk(count, dim=-1, sorted=False).indices
    at = index.unsqueeze(-1).expand(*index.shape, albedo.shape[-1])
    received = albedo * operator.from_patches(index, now.unsent.gather(-2, at))
    unsent = now.unsent.scatter(-2, at, 0) + _sendable(operator, received)
    return _Shooting(now.radiosity + received, unsent)


def _sendable(operator: AbstractOperator, x: Tensor) -> Tensor:
    """What patches may send: nothing where they have no area, which nobody sees."""
    return x if operator.area is None else torch.where(operator.area.unsqueeze(-1) > 0, x, 0)


def _balanced(now: _Shooting, balance: Balance, albedo: Tensor) -> _Shooting:
    """Ambient light for what the room as a whole still lacks: rho a, sent at once."""
    ambient = balance.ambient(now.unsent)
    reflected_once = albedo * balance.arriving * ambient
    return _Shooting(now.radiosity + reflected_once, now.unsent - balance.lost * ambient)
