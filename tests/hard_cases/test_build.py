"""Values are looked at where a module is built: named errors for every tensor that is held."""

from __future__ import annotations

import inspect
import math

import pytest
import torch
from torch import Tensor, nn

from tests.cases import MATERIALS, SOURCES
from torchradiometry.errors import DTypeError, InvalidValueError, OutOfRangeError

BUILT = {case.name: case for case in (*SOURCES, *MATERIALS)}
#: what may be of any sign: places, directions, and the coefficients of a series
SIGNED = {"position", "center", "corners", "direction", "axis", "up", "coefficients"}


def arguments(module: nn.Module) -> dict[str, object]:
    """What its constructor took, by name."""
    names = inspect.signature(type(module).__init__).parameters
    parts = {key.rsplit(".", 1)[-1]: tensor for key, tensor in module.state_dict().items()}
    options = {n: getattr(module, n, module) for n in names}
    options = {n: v for n, v in options.items() if v is not module and not isinstance(v, nn.Module)}
    return options | {n: t for n, t in parts.items() if n in names}


def held(name: str) -> list[str]:
    found = arguments(BUILT[name].build(torch.float64))
    return [n for n, v in found.items() if isinstance(v, Tensor) and v.is_floating_point()]


EVERY = [(name, tensor) for name in BUILT for tensor in held(name)]
SHARES = [(name, tensor) for name, tensor in EVERY if tensor in ("albedo", "roughness")]


def rebuilt(name: str, tensor: str, value: float | Tensor) -> nn.Module:
    module = BUILT[name].build(torch.float64)
    given = arguments(module)
    old = given[tensor]
    assert isinstance(old, Tensor)
    new = old.clone()
    new.view(-1)[0] = value
    return type(module)(**given | {tensor: new})


@pytest.mark.parametrize(("name", "tensor"), EVERY)
def test_what_is_not_finite_is_refused(name: str, tensor: str) -> None:
    for value in (math.nan, math.inf):
        with pytest.raises(InvalidValueError, match=tensor):
            rebuilt(name, tensor, value)


@pytest.mark.parametrize(("name", "tensor"), [e for e in EVERY if e[1] not in SIGNED])
def test_negative_powers_and_shares_are_refused(name: str, tensor: str) -> None:
    if tensor in SIGNED:
        rebuilt(
            name,
            tensor,
            -0.01 + float(arguments(BUILT[name].build(torch.float64))[tensor].view(-1)[0]),
        )
    else:
        with pytest.raises(OutOfRangeError, match=tensor):
            rebuilt(name, tensor, -0.1)


@pytest.mark.parametrize(("name", "tensor"), SHARES)
def test_shares_above_one_are_refused(name: str, tensor: str) -> None:
    with pytest.raises(OutOfRangeError, match=tensor):
        rebuilt(name, tensor, 1.01)


@pytest.mark.parametrize(("name", "tensor"), EVERY)
def test_complex_numbers_are_refused(name: str, tensor: str) -> None:
    module = BUILT[name].build(torch.float64)
    given = arguments(module)
    with pytest.raises(DTypeError, match=tensor):
        type(module)(**given | {tensor: given[tensor].to(torch.complex64)})
