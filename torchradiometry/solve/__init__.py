"""(I - rho F) B = M: one solver a file; knows no geometry."""

from torchradiometry.solve.direct import Direct
from torchradiometry.solve.neumann import Neumann, neumann_series
from torchradiometry.solve.solution import Solution, Status, advice, certified

__all__ = [
    "Direct",
    "Neumann",
    "Solution",
    "Status",
    "advice",
    "certified",
    "neumann_series",
]
