"""Radiosity of diffuse patches that light each other.

    B = M + rho F B

B (W/m2) is what leaves a patch for every cause, M what it emits, rho its albedo,
F[receiver, emitter] the form factors. The layer holds the form factors of a scene, a solver
and an adjoint; albedo and exitance are its inputs, so that one geometry serves many
materials, lamps and colour channels, and gradients reach all of them.

References: C. Goral, K. Torrance, D. Greenberg and B. Battaile, "Modeling the Interaction of
Light Between Diffuse Surfaces", SIGGRAPH 1984.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import NotConvergedWarning, ShapeError
from torchradiometry.solve.adjoints import AbstractAdjoint, Implicit, Unrolled
from torchradiometry.solve.neumann import Neumann
from torchradiometry.solve.operators import AbstractOperator, DenseOperator, as_operator
from torchradiometry.solve.solution import Solution, Status, advice
from torchradiometry.solve.solver import AbstractSolver

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["RadiosityShading"]


@final
class RadiosityShading(nn.Module):
    """B = M + rho F B for the patches of a scene.

    Args:
        form_factors: `receiver emitter`, 0..1 (see `form_factors`), or an operator; None if
            they are passed to `forward`. The tensors of a `DenseOperator` move with the layer
            and are in its `state_dict`; those of other operators stay where they are.
        solver: what solves; `Neumann(8)` by default, which compiles and exports.
        adjoint: how gradients pass it; by default `Unrolled()` where the solver allows it, else
            `Implicit()`.

    >>> import torch
    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])
    >>> half = torch.full((2, 1), 0.5)
    >>> RadiosityShading(F, Neumann(30))(half, half).T
    tensor([[1., 1.]])
    >>> RadiosityShading(F, Neumann(30), Implicit())(half, half).T
    tensor([[1., 1.]])
    """

    form_factors: Tensor | None
    area: Tensor | None

    def __init__(
        self,
        form_factors: AbstractOperator | Float[Tensor, "patch patch"] | None = None,
        solver: AbstractSolver | None = None,
        adjoint: AbstractAdjoint | None = None,
    ) -> None:
        super().__init__()
        operator = None if form_factors is None else as_operator(form_factors)
        dense = operator if isinstance(operator, DenseOperator) else None
        self.register_buffer("form_factors", None if dense is None else dense.form_factors)
        self.register_buffer("area", None if dense is None else dense.area)
        self._operator = operator if dense is None else None
        self.solver: AbstractSolver = Neumann(8) if solver is None else solver
        default = Unrolled() if self.solver.unrolls else Implicit()
        self.adjoint: AbstractAdjoint = default if adjoint is None else adjoint

    @property
    def operator(self) -> AbstractOperator | None:
        """F as the layer holds it."""
        if self.form_factors is None:
            return self._operator
        return DenseOperator(self.form_factors, self.area)

    def forward(
        self,
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
        form_factors: AbstractOperator | Float[Tensor, "*batch patch patch"] | None = None,
    ) -> Float[Tensor, "*batch patch channel"]:
        """The radiosity of every patch.

        Args:
            albedo: 0..1.
            exitance: M, W/m2, >= 0: emitted, or reflected from sources that are no patches.
            form_factors: a matrix or operator instead of that which the layer holds.

        Returns:
            B, W/m2; divided by pi it is the patch's radiance.

        Warns:
            NotConvergedWarning: a solver that promises a tolerance stopped before it (with its
                bound; make it an error by `warnings.filterwarnings`). `solution` says the same
                in its status, without a warning.

        Differentiable in: all arguments, and what the operator holds.
        Export: compile yes, ONNX yes with `Neumann` and `AdaptiveNeumann`; the patch axis
            may stay dynamic.
        """
        found = self.solution(albedo, exitance, form_factors)
        if self.solver.promises and not torch.compiler.is_compiling():
            _warn(type(self.solver).__name__, found)
        return found.radiosity

    def solution(
        self,
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
        form_factors: AbstractOperator | Float[Tensor, "*batch patch patch"] | None = None,
    ) -> Solution:
        """The radiosity with its residual, bound and status; arguments as of `forward`."""
        operator = self.operator if form_factors is None else form_factors
        if operator is None:
            raise ShapeError("form_factors", "None", "pass them here or to the constructor")
        return self.adjoint.solve(self.solver, operator, albedo, exitance)

    def extra_repr(self) -> str:
        operator = self.operator
        patches = "given at call" if operator is None else operator.patches
        return f"patches={patches}, solver={self.solver}, adjoint={self.adjoint}, radiosity [W/m2]"


def _warn(solver: str, found: Solution) -> None:
    """Say that some system was not solved as well as it was asked to be."""
    stopped = found.status == Status.NOT_CONVERGED
    if bool(stopped.any()):
        bound = float(found.bound[stopped].max())
        text = f"{solver}: got an error of up to {bound:.2g} W/m2; {advice(Status.NOT_CONVERGED)}."
        warnings.warn(text, NotConvergedWarning, stacklevel=3)
