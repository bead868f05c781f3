"""F as a product: what a solver needs to know of a scene.

    F x = H x / A,     F^T x = H (x / A),     H_ij = A_i F_ij = A_j F_ji      (m2)

H, the exchange areas, is symmetric by reciprocity; A are the areas of the patches. A solver
asks for products only, so the same solver serves a dense matrix, a callable, or a tree of
clusters. Patches without area exchange nothing: their rows of F are 0.

References: M. Cohen and J. Wallace, *Radiosity and Realistic Image Synthesis* (1993), ch. 5.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import (
    DTypeError,
    EmptySceneError,
    ShapeError,
    require_floating,
    require_kind,
)
from torchradiometry.numerics import guarded_divide

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["AbstractOperator", "DenseOperator", "MatrixFreeOperator", "as_operator"]


class AbstractOperator(ABC):
    """F of a scene, known by its products.

    Attributes:
        area: A, m2, `*batch patch`; None where F is known but not the areas.
    """

    area: Float[Tensor, "*batch patch"] | None

    @abstractmethod
    def exchange(
        self, x: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch patch channel"]:
        """H x, with the symmetric exchange areas H = A F (m2)."""

    def __call__(
        self, x: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch patch channel"]:
        """F x: the irradiance of each patch by the radiosities x, W/m2."""
        return per_area(self.exchange(x), _known(self.area))

    def transposed(
        self, x: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch patch channel"]:
        """F^T x = H (x / A)."""
        return self.exchange(per_area(x, _known(self.area)))

    def row_sums(self) -> Float[Tensor, "*batch patch"]:
        """sum_j F_ij: 1 for a patch that sees only patches."""
        return self(torch.ones_like(_known(self.area)).unsqueeze(-1)).squeeze(-1)

    def from_patches(
        self,
        index: Int[Tensor, "*batch some"],
        x: Float[Tensor, "*batch some channel"],
    ) -> Float[Tensor, "*batch patch channel"]:
        """F x where only the patches `index` send: their columns of F times x."""
        index = index.unsqueeze(-1).expand(x.shape)
        sent = x.new_zeros(*x.shape[:-2], self.patches, x.shape[-1]).scatter(-2, index, x)
        return self(sent)

    def rows(self, first: int, last: int) -> Float[Tensor, "*batch row patch"]:
        """Rows first..last-1 of F, by products with unit vectors."""
        area = _known(self.area)
        unit = torch.eye(self.patches, dtype=area.dtype, device=area.device)[:, first:last]
        return self.transposed(unit.expand(*area.shape, last - first)).mT

    def transpose(self) -> AbstractOperator:
        """F^T as an operator; its "areas" 1/A make it symmetric in the same sense."""
        inverse = guarded_divide(torch.ones_like(_known(self.area)), _known(self.area))
        return MatrixFreeOperator(lambda x: self(per_area(x, _known(self.area))), inverse)

    def wide(self) -> AbstractOperator:
        """The same F with products in float64, or F itself if it has none."""
        return self

    @property
    def patches(self) -> int:
        """Number of patches."""
        return _known(self.area).shape[-1]

    @property
    def dtype(self) -> torch.dtype:
        """Of the products."""
        return _known(self.area).dtype

    @property
    def device(self) -> torch.device:
        """Where the products are computed."""
        return _known(self.area).device

    @property
    def terms(self) -> int:
        """Roundings that one entry of a product may suffer one after the other."""
        return self.patches


@final
class DenseOperator(AbstractOperator):
    """F as a matrix.

    Args:
        form_factors: F[receiver, emitter], 0..1.
        area: m2; None if unknown. Products work all the same, and so does every solver but
            `ConjugateGradient`. With areas the matrix is taken to be reciprocal.

    Raises:
        ShapeError: the matrix is not square, or areas do not fit it.

    Differentiable in: form factors, area.
    Export: compile yes, ONNX yes.

    >>> F = DenseOperator(torch.tensor([[0.0, 0.5], [0.25, 0.0]]), torch.tensor([1.0, 2.0]))
    >>> F(torch.ones(2, 1)).T, F.exchange(torch.ones(2, 1)).T
    (tensor([[0.5000, 0.2500]]), tensor([[0.5000, 0.5000]]))
    """

    def __init__(
        self,
        form_factors: Float[Tensor, "*batch patch patch"],
        area: Float[Tensor, "*batch patch"] | None = None,
    ) -> None:
        shape = form_factors.shape
        if len(shape) < 2 or shape[-1] != shape[-2]:
            raise ShapeError("form_factors", f"shape {tuple(shape)}", "pass `receiver emitter`")
        if area is not None and (area.ndim < 1 or area.shape[-1] != shape[-1]):
            raise ShapeError(
                "area", f"shape {tuple(area.shape)}", f"pass one area for each of {shape[-1]}"
            )
        self.form_factors, self.area = form_factors, area

    def exchange(
        self, x: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch patch channel"]:
        return _known(self.area).unsqueeze(-1) * (self.form_factors @ x)

    def __call__(
        self, x: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch patch channel"]:
        require_system(self, ("x", x))
        return self.form_factors @ x

    def transposed(
        self, x: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch patch channel"]:
        return self.form_factors.mT @ x

    def row_sums(self) -> Float[Tensor, "*batch patch"]:
        return self.form_factors.sum(-1)

    def from_patches(
        self,
        index: Int[Tensor, "*batch some"],
        x: Float[Tensor, "*batch some channel"],
    ) -> Float[Tensor, "*batch patch channel"]:
        factors = self.form_factors
        if factors.ndim == 2:
            return factors.mT[index].mT @ x
        index = index.unsqueeze(-2)
        batch = torch.broadcast_shapes(factors.shape[:-2], index.shape[:-2])
        factors = factors.expand(*batch, *factors.shape[-2:])
        index = index.expand(*batch, factors.shape[-2], index.shape[-1])
        return factors.gather(-1, index) @ x

    def rows(self, first: int, last: int) -> Float[Tensor, "*batch row patch"]:
        return self.form_factors[..., first:last, :]

    def transpose(self) -> AbstractOperator:
        if self.area is None:
            return DenseOperator(self.form_factors.mT)
        inverse = guarded_divide(torch.ones_like(self.area), self.area)
        return DenseOperator(self.form_factors.mT, inverse)

    def wide(self) -> AbstractOperator:
        if self.dtype == torch.float64:
            return self
        area = None if self.area is None else self.area.to(torch.float64)
        return DenseOperator(self.form_factors.to(torch.float64), area)

    @property
    def patches(self) -> int:
        return self.form_factors.shape[-1]

    @property
    def dtype(self) -> torch.dtype:
        return self.form_factors.dtype

    @property
    def device(self) -> torch.device:
        return self.form_factors.device


@final
class MatrixFreeOperator(AbstractOperator):
    """F through a callable that gives H x.

    Args:
        product: x `*batch patch channel` -> H x, m2 times the unit of x; symmetric, linear.
        area: A, m2.

    Differentiable in: area, and what the callable holds.
    Export: as the callable.

    >>> area = torch.tensor([1.0, 3.0])  # the inside of a sphere: H_ij = A_i A_j / sum A
    >>> F = MatrixFreeOperator(lambda x: area[:, None] * (area @ x) / 4, area)
    >>> F(torch.tensor([[4.0], [0.0]])).T
    tensor([[1., 1.]])
    """

    def __init__(
        self, product: Callable[[Tensor], Tensor], area: Float[Tensor, "*batch patch"]
    ) -> None:
        self.product, self.area = product, area

    def exchange(
        self, x: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch patch channel"]:
        return self.product(x)


def require_system(operator: AbstractOperator, *columns: tuple[str, Tensor]) -> None:
    """Raise unless tensors `patch channel` have the dtype and the patches of the operator.

    Raises:
        DTypeError: integer or complex numbers, or another precision than the form factors'.
        EmptySceneError: no patches.
        ShapeError: another number of patches (one broadcasts).
    """
    if operator.patches == 0:
        raise EmptySceneError("operator", "no patches", "add a surface to the scene")
    for name, tensor in columns:
        require_floating(name, tensor)
        if tensor.ndim > 1 and tensor.shape[-2] not in (1, operator.patches):
            got = f"a tensor of shape {tuple(tensor.shape)}"
            raise ShapeError(name, got, f"pass `patch channel` with {operator.patches} patches")
        if tensor.dtype != operator.dtype:
            got = f"{tensor.dtype} with form factors in {operator.dtype}"
            raise DTypeError(name, got, "bring both to one dtype")


def as_operator(
    operator: AbstractOperator | Float[Tensor, "*batch patch patch"],
) -> AbstractOperator:
    """The operator itself, or a matrix of form factors as one."""
    if isinstance(operator, Tensor):
        return DenseOperator(operator)
    require_kind("operator", operator, AbstractOperator, "matrix of form factors, or an operator")
    return operator


def reflected(
    operator: AbstractOperator,
    albedo: Float[Tensor, "*batch patch channel"],
    radiosity: Float[Tensor, "*batch patch channel"],
) -> Float[Tensor, "*batch patch channel"]:
    """rho F B: what the patches reflect of what all patches send, W/m2."""
    return albedo * operator(radiosity)


def per_area(
    x: Float[Tensor, "*batch patch channel"], area: Float[Tensor, "*batch patch"]
) -> Float[Tensor, "*batch patch channel"]:
    """x / A, and 0 on patches without area."""
    return guarded_divide(x, area.unsqueeze(-1))


def _known(area: Tensor | None) -> Tensor:
    if area is None:
        raise ShapeError(
            "operator",
            "form factors without areas",
            "pass DenseOperator(form_factors, area), or use a solver that needs no symmetry "
            "(Neumann, GaussSeidel, Direct)",
        )
    return area
