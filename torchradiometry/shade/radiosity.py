"""Radiosity of diffuse patches that light each other.

    B = M + rho F B

B (W/m2) is what leaves a patch for every cause, M what it emits, rho its albedo,
F[receiver, emitter] the form factors. The layer holds the form factors of a scene and a
solver; albedo and exitance are its inputs, so that one geometry serves many materials,
lamps and colour channels, and gradients reach all of them.

References: C. Goral, K. Torrance, D. Greenberg and B. Battaile, "Modeling the Interaction of
Light Between Diffuse Surfaces", SIGGRAPH 1984.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, final

from torch import Tensor, nn

from torchradiometry.errors import ShapeError
from torchradiometry.solve.neumann import Neumann
from torchradiometry.solve.solution import Solution

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["AbstractSolver", "RadiosityShading"]


class AbstractSolver(Protocol):
    """Anything that solves B = M + rho F B."""

    def solve(self, form_factors: Tensor, albedo: Tensor, exitance: Tensor) -> Solution:
        """B with residual and bound."""


@final
class RadiosityShading(nn.Module):
    """B = M + rho F B for the patches of a scene.

    Args:
        form_factors: `receiver emitter`, 0..1 (see `form_factors`); None if they are passed
            to `forward`.
        solver: what solves; `Neumann(bounces)` compiles and exports.

    >>> import torch
    >>> F = torch.tensor([[0.0, 1.0], [1.0, 0.0]])
    >>> half = torch.full((2, 1), 0.5)
    >>> RadiosityShading(F, Neumann(30))(half, half).T
    tensor([[1., 1.]])
    """

    form_factors: Tensor | None

    def __init__(
        self,
        form_factors: Float[Tensor, "patch patch"] | None = None,
        solver: AbstractSolver | None = None,
    ) -> None:
        super().__init__()
        if form_factors is not None and (
            form_factors.ndim < 2 or form_factors.shape[-1] != form_factors.shape[-2]
        ):
            raise ShapeError(
                "form_factors", f"shape {tuple(form_factors.shape)}", "pass `receiver emitter`"
            )
        self.register_buffer("form_factors", form_factors)
        self.solver = Neumann(8) if solver is None else solver

    def forward(
        self,
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
        form_factors: Float[Tensor, "*batch patch patch"] | None = None,
    ) -> Float[Tensor, "*batch patch channel"]:
        """The radiosity of every patch.

        Args:
            albedo: 0..1.
            exitance: M, W/m2, >= 0: emitted, or reflected from sources that are no patches.
            form_factors: instead of those the layer holds.

        Returns:
            B, W/m2; divided by pi it is the patch's radiance.

        Differentiable in: all arguments (with `Neumann`; see the solver).
        Export: compile yes, ONNX yes with `Neumann`; the patch axis may stay dynamic.
        """
        return self.solution(albedo, exitance, form_factors).radiosity

    def solution(
        self,
        albedo: Float[Tensor, "*batch patch channel"],
        exitance: Float[Tensor, "*batch patch channel"],
        form_factors: Float[Tensor, "*batch patch patch"] | None = None,
    ) -> Solution:
        """The radiosity with its residual, bound and status; arguments as of `forward`."""
        factors = self.form_factors if form_factors is None else form_factors
        if factors is None:
            raise ShapeError("form_factors", "None", "pass them here or to the constructor")
        if albedo.ndim < 2 or exitance.ndim < 2:
            raise ShapeError(
                "albedo, exitance",
                f"shapes {tuple(albedo.shape)}, {tuple(exitance.shape)}",
                "pass `patch channel`",
            )
        return self.solver.solve(factors, albedo, exitance)

    def extra_repr(self) -> str:
        patches = "given at call" if self.form_factors is None else self.form_factors.shape[-1]
        return f"patches={patches}, solver={self.solver}, radiosity [W/m2]"
