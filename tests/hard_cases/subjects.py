"""A member of a family as named tensors, so that a kind of extreme can reach into it.

The tensors of a subject are the inputs of its case, by the names of its `forward`, and the
floating-point tensors that it holds, by the last part of their names in `state_dict`. A name is a
role: a kind that is made for `albedo` applies to every subject with a tensor of that name.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cached_property

import torch
from torch import Tensor, nn

from tests.cases import Case, Sizes

#: two images of 2 x 2 pixels (or 4 points, patches, triangles) under two lights
TINY = Sizes(2, 2, 2, 2)

#: tensors by key: `input.<name>` and `held.<name in state_dict>`
Leaves = dict[str, Tensor]


def role(key: str) -> str:
    """What a tensor is: the last part of its name, without the `source_` of lights as inputs."""
    return key.rsplit(".", 1)[-1].removeprefix("source_")


def is_light(key: str) -> bool:
    """Whether a tensor belongs to a light (or to a material that the member holds)."""
    return key.startswith(("held.", "input.source_"))


class Subject:
    """One member, its easy inputs in float64, and how to call it with others."""

    def __init__(self, family: str, case: Case, sizes: Sizes = TINY) -> None:
        self.family, self.case = family, case
        self.modules: dict[torch.dtype, nn.Module] = {}
        self.known: dict[object, object] = {}  #: results that several trials ask for
        self.reach: dict[str, dict[str, Tensor]] = {}  #: what `calls.reached` found
        self.names = input_names(self.module(torch.float64))
        inputs = case.inputs(torch.float64, sizes)
        self.names = self.names[: len(inputs)]
        self.easy: Leaves = {f"input.{n}": t for n, t in zip(self.names, inputs, strict=True)}
        for name, tensor in self.module(torch.float64).state_dict().items():
            if tensor.is_floating_point() and not self.replaced(name):
                self.easy[f"held.{name}"] = tensor

    @cached_property
    def name(self) -> str:
        return f"{self.family}-{self.case.name}"

    def replaced(self, name: str) -> bool:
        """Whether a held tensor only keeps the place of an input of the same role."""
        return f"source_{role(name)}" in self.names

    def module(self, dtype: torch.dtype) -> nn.Module:
        if dtype not in self.modules:
            self.modules[dtype] = self.case.build(dtype).eval()
        return self.modules[dtype]

    def call(self, dtype: torch.dtype, leaves: Leaves) -> tuple[Tensor, ...]:
        """The outputs of the member in `dtype` for these tensors."""
        held = {k.removeprefix("held."): t for k, t in leaves.items() if k.startswith("held.")}
        inputs = tuple(leaves[f"input.{name}"] for name in self.names)
        found = torch.func.functional_call(self.module(dtype), held, inputs)
        return (found,) if isinstance(found, Tensor) else tuple(found)


def input_names(module: nn.Module) -> tuple[str, ...]:
    """The names of a module's inputs: its own list, or the arguments of `forward`."""
    while not hasattr(module, "input_names"):
        names = _arguments(module.forward)
        if names:
            return names
        module = module.layer
    return tuple(module.input_names)


def _arguments(call: Callable) -> tuple[str, ...]:
    parameters = inspect.signature(call).parameters.values()
    return tuple(p.name for p in parameters if p.kind is not p.VAR_POSITIONAL)
