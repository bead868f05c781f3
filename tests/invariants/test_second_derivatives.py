"""First and second derivatives of every member, against finite differences, with anomaly mode on.

What is not twice differentiable is named here with what it does instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import torch
from torch import Tensor, nn
from torch.autograd import gradcheck, gradgradcheck

from tests.cases import ADJOINTS, LAYERS, MATERIALS, SOLVERS, SOURCES, TRANSPORT, Case, Sizes

TINY = Sizes(batch=1, height=2, width=2, light=2)
#: geometry that has a kink in every pixel: its second derivative is that of a smooth piece
ONCE: set[str] = set()


@pytest.fixture(autouse=True)
def anomalies() -> Iterator[None]:
    """A backward pass that makes a NaN raises where it was made."""
    with torch.autograd.set_detect_anomaly(True):
        yield


class Received(nn.Module):
    """A source as the function that a diffuse surface sees."""

    def __init__(self, source: nn.Module) -> None:
        super().__init__()
        self.source = source

    def forward(self, position: Tensor, normal: Tensor) -> Tensor:
        return self.source.irradiance_on(position, normal)


def with_parameters(
    module: nn.Module, inputs: tuple[Tensor, ...]
) -> tuple[Callable[..., Tensor], tuple[Tensor, ...]]:
    """The module as a function of its inputs and of all numbers that it holds."""
    names = [name for name, t in module.named_buffers() if t.is_floating_point()]
    held = [module.get_buffer(name).detach().clone() for name in names]

    def function(*tensors: Tensor) -> Tensor:
        given = dict(zip(names, tensors[len(inputs) :], strict=True))
        return torch.func.functional_call(module, given, tensors[: len(inputs)])

    return function, tuple(t.detach().clone().requires_grad_() for t in (*inputs, *held))


def check(module: nn.Module, inputs: tuple[Tensor, ...], twice: bool = True) -> None:
    function, tensors = with_parameters(module, inputs)
    assert gradcheck(function, tensors, fast_mode=True, rtol=1e-4, atol=1e-6)
    if twice:
        assert gradgradcheck(function, tensors, fast_mode=True, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("case", SOURCES, ids=lambda case: case.name)
def test_sources(case: Case) -> None:
    check(Received(case.build(torch.float64)), case.inputs(torch.float64, TINY))


@pytest.mark.parametrize(
    "case", MATERIALS + SOLVERS + ADJOINTS + TRANSPORT, ids=lambda case: case.name
)
def test_materials_solvers_and_form_factors(case: Case) -> None:
    check(case.build(torch.float64), case.inputs(torch.float64, TINY))


@pytest.mark.parametrize("case", LAYERS, ids=lambda case: case.name)
def test_layers(case: Case) -> None:
    check(case.build(torch.float64), case.inputs(torch.float64, TINY), case.name not in ONCE)
