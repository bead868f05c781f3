"""What all solvers share: the checks before, the certificate after, double precision inside.

A solver says how B is found (`approximate`); `solve` checks the albedo, widens float32 to
float64 for solvers that iterate to a tolerance, and bounds the error of what came out.

A room has no solution if some light in it is never absorbed: if a group of patches that
reflect all they receive (albedo x row sum = 1) sends nothing to any other patch. It is found
by asking which patches lose light, then which send light to those, and so on.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import (
    DTypeError,
    EmptySceneError,
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
    SingularSystemError,
    require_device,
    require_floating,
)
from torchradiometry.solve.certificate import certified, gamma, inverse_norm
from torchradiometry.solve.operators import AbstractOperator, DenseOperator, as_operator, reflected
from torchradiometry.solve.solution import Solution

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["AbstractSolver", "Approximation", "check_albedo"]

#: how far below 0 form factors may lie
NUDGE = 2.0**-10


class Approximation(NamedTuple):
    """B before its error is known.

    Attributes:
        radiosity: B, W/m2.
        products: with F that were spent.
        residual: M + rho F B - B, W/m2, where it came for free; exact but for rounding.
        one_sign: whether the residual is known to have one sign.
        converged: for each system whether a tolerance was reached; None if none was promised.
        above: (I - rho F)^-1 1, where it came for free.
        bounces: B by reflections, on request.
    """

    radiosity: Float[Tensor, "*batch patch channel"]
    products: int | Tensor
    residual: Float[Tensor, "*batch patch channel"] | None = None
    one_sign: bool = False
    converged: Bool[Tensor, "*batch channel"] | None = None
    above: Float[Tensor, "*batch patch channel"] | None = None
    bounces: Float[Tensor, "*batch bounce patch channel"] | None = None


class AbstractSolver(ABC):
    """Anything that solves B = M + rho F B.

    Attributes:
        promises: True if the solver iterates until a tolerance is met (or solves at once):
            it computes in float64 and refuses systems without a solution.
        unrolls: True if the steps of the solver may be differentiated. A solver that stops when
            the radiosity is good enough may not: in a dark room, or at albedo 0, it stops
            before it has seen what a small change would add. It builds no graph; gradients
            come from an adjoint.
    """

    promises: ClassVar[bool]
    unrolls: ClassVar[bool]

    @abstractmethod
    def approximate(
        self,
        operator: AbstractOperator,
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
    ) -> Approximation:
        """B without checks and bound; albedo and exitance have the same shape."""

    def segments(self, every: int) -> tuple[AbstractSolver, ...]:
        """Solvers which one after the other, each on the residual of the last, do the same."""
        return (self,)

    def solve(
        self,
        operator: AbstractOperator | Float[Tensor, "*batch patch patch"],
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
    ) -> Solution:
        """B of B = M + rho F B with its residual, bound and status.

        Args:
            operator: F, or form factors F[receiver, emitter].
            albedo: 0..1; broadcasts against `exitance`.
            exitance: M, W/m2.

        Raises:
            OutOfRangeError, InvalidValueError: albedo outside 0..1, negative form factors, or NaN.
            SingularSystemError: light that is never absorbed, if a solution is promised.

        Differentiable in: all tensors if the solver `unrolls`; else see `solve_radiosity`.
        Export: see the solver.
        """
        operator = as_operator(operator)
        albedo, exitance = broadcast(operator, albedo, exitance)
        if not torch.compiler.is_compiling():
            if operator.patches == 0:
                raise EmptySceneError("operator", "no patches", "add a surface to the scene")
            check_albedo(albedo)
            _require_shares(operator)
            if self.promises:
                _require_loss(type(self).__name__, operator, albedo)
        return self._certified(operator, albedo, exitance)

    def radiosity(
        self,
        operator: AbstractOperator,
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
    ) -> Float[Tensor, "*batch patch channel"]:
        """B alone, of arguments that were checked before; W/m2."""
        albedo, exitance = broadcast(operator, albedo, exitance)
        return self._widened(operator, albedo, exitance)[-1].radiosity.to(exitance.dtype)

    def _widened(
        self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor
    ) -> tuple[AbstractOperator, Tensor, Tensor, Approximation]:
        """The system in the dtype that it is solved in, and what was found."""
        half = exitance.dtype in (torch.float16, torch.bfloat16)
        if half or (self.promises and not torch.compiler.is_compiling()):
            operator = operator.wide()
            albedo, exitance = albedo.to(operator.dtype), exitance.to(operator.dtype)
        with torch.set_grad_enabled(self.unrolls and torch.is_grad_enabled()):
            return operator, albedo, exitance, self.approximate(operator, albedo, exitance)

    def _certified(self, operator: AbstractOperator, albedo: Tensor, exitance: Tensor) -> Solution:
        dtype = exitance.dtype
        operator, albedo, exitance, found = self._widened(operator, albedo, exitance)
        norm = self._inverse_norm(operator, albedo, found)
        solution = certified(
            operator,
            albedo,
            exitance,
            found.radiosity,
            found.residual,
            found.products,
            steps=0 if found.one_sign else 3,
            norm=norm,
            converged=found.converged,
        )._replace(bounces=found.bounces)
        return solution if dtype == exitance.dtype else _rounded(solution, dtype)

    def _inverse_norm(
        self, operator: AbstractOperator, albedo: Tensor, found: Approximation
    ) -> Tensor | None:
        """From a computed (I - T)^-1 1, where 1 / (1 - q) says nothing."""
        if not self.promises or torch.compiler.is_compiling() or not albedo.numel():
            return None
        with torch.no_grad():
            above = found.above
            if above is None:
                share = (albedo * operator.row_sums().unsqueeze(-1)).amax()
                if share < 1 - gamma(operator.terms, operator.dtype):
                    return None
                above = self.approximate(operator, albedo, torch.ones_like(albedo)).radiosity
            return inverse_norm(operator, albedo, above)


def broadcast(
    operator: AbstractOperator, albedo: Tensor, exitance: Tensor
) -> tuple[Tensor, Tensor]:
    """Albedo and exitance in one shape, of as many patches as the operator has."""
    require_floating("albedo", albedo)
    require_floating("exitance", exitance)
    if albedo.ndim < 2 or exitance.ndim < 2:
        raise ShapeError(
            "albedo, exitance",
            f"shapes {tuple(albedo.shape)}, {tuple(exitance.shape)}",
            "pass `patch channel`",
        )
    if exitance.dtype != operator.dtype:
        raise DTypeError(
            "exitance",
            f"{exitance.dtype} with form factors in {operator.dtype}",
            "bring both to one dtype",
        )
    require_device("albedo", albedo, "exitance", exitance)
    if exitance.device != operator.device:
        got = f"a tensor on {exitance.device} with form factors on {operator.device}"
        raise DTypeError("exitance", got, "bring both to one device")
    try:
        albedo, exitance = torch.broadcast_tensors(albedo.to(exitance), exitance)
    except RuntimeError as error:
        raise ShapeError(
            "albedo, exitance",
            f"shapes {tuple(albedo.shape)}, {tuple(exitance.shape)}",
            "pass shapes that broadcast",
        ) from error
    if albedo.shape[-2] != operator.patches:
        raise ShapeError(
            "albedo, exitance",
            f"{albedo.shape[-2]} patches with form factors of {operator.patches}",
            "pass one row for each patch",
        )
    return albedo, exitance


def check_albedo(albedo: Float[Tensor, "..."]) -> None:
    """Refuse an albedo outside 0..1 and NaN.

    Raises:
        InvalidValueError: NaN.
        OutOfRangeError: below 0 or above 1.
    """
    values = albedo.detach()
    if not values.numel():
        return
    low, high = (float(x) for x in torch.aminmax(values))
    if low != low or high != high:
        raise InvalidValueError("albedo", "NaN", "pass numbers from 0 to 1")
    if low < 0 or high > 1:
        raise OutOfRangeError("albedo", f"{low:g}..{high:g}", "pass 0..1, what is reflected")


@torch.no_grad()
def _require_shares(operator: AbstractOperator) -> None:
    """Refuse a matrix with entries below 0, which are no shares of light.

    Finite differences step below 0, but not far.
    """
    if isinstance(operator, DenseOperator):
        least = float(operator.form_factors.min())
        if least < -NUDGE:
            mend = "pass F[receiver, emitter] >= 0, such as `form_factors` gives"
            raise OutOfRangeError("form_factors", f"entries down to {least:.3g}", mend)


@torch.no_grad()
def _require_loss(name: str, operator: AbstractOperator, albedo: Tensor) -> None:
    """Refuse a room in which some light is never absorbed."""
    rounding = gamma(operator.terms, operator.dtype)
    share = albedo * operator.row_sums().unsqueeze(-1)
    if not bool(torch.isfinite(share).all()):
        raise InvalidValueError("form_factors", "NaN or infinity", "pass finite numbers")
    loses = share < 1 - rounding
    while not bool(loses.all()):
        more = loses | (reflected(operator, albedo, loses.to(albedo)) > rounding)
        if torch.equal(more, loses):
            raise SingularSystemError(
                name,
                "patches that enclose a space and reflect all they receive",
                "lower some albedo below 1 or open the scene",
            )
        loses = more


def _rounded(solution: Solution, dtype: torch.dtype) -> Solution:
    """The solution in a narrower dtype; the bound covers that rounding too."""
    step = torch.finfo(dtype).eps
    largest = solution.radiosity.detach().abs().amax(-2)
    return solution._replace(
        radiosity=solution.radiosity.to(dtype),
        residual=solution.residual.to(dtype),
        bound=((solution.bound + step * largest) * (1 + step)).to(dtype),
        bounces=None if solution.bounces is None else solution.bounces.to(dtype),
    )
