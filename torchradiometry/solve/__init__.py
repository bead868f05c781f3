"""(I - rho F) B = M: one solver a file; knows no geometry."""

from torchradiometry.solve.adaptive_neumann import AdaptiveNeumann
from torchradiometry.solve.adjoints import AbstractAdjoint, Implicit, Truncated, Unrolled
from torchradiometry.solve.ambient import ambient_tail
from torchradiometry.solve.certificate import certified, inverse_norm
from torchradiometry.solve.conjugate_gradient import ConjugateGradient
from torchradiometry.solve.direct import Direct
from torchradiometry.solve.gauss_seidel import GaussSeidel
from torchradiometry.solve.hierarchical_operator import HierarchicalOperator
from torchradiometry.solve.neumann import (
    Neumann,
    bounce_series,
    neumann_series,
    separate_bounces,
)
from torchradiometry.solve.operators import (
    AbstractOperator,
    DenseOperator,
    MatrixFreeOperator,
    as_operator,
)
from torchradiometry.solve.radiosity import solve_radiosity
from torchradiometry.solve.solution import Solution, Status, advice
from torchradiometry.solve.solver import AbstractSolver, check_albedo
from torchradiometry.solve.southwell import Southwell

__all__ = [
    "AbstractAdjoint",
    "AbstractOperator",
    "AbstractSolver",
    "AdaptiveNeumann",
    "ConjugateGradient",
    "DenseOperator",
    "Direct",
    "GaussSeidel",
    "HierarchicalOperator",
    "Implicit",
    "MatrixFreeOperator",
    "Neumann",
    "Solution",
    "Southwell",
    "Status",
    "Truncated",
    "Unrolled",
    "advice",
    "ambient_tail",
    "as_operator",
    "bounce_series",
    "certified",
    "check_albedo",
    "inverse_norm",
    "neumann_series",
    "separate_bounces",
    "solve_radiosity",
]
