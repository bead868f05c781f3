"""A layer whose lights are inputs of the graph, so that their number stays dynamic.

In a layer the lights are parameters: an exported graph has them as constants. Here they
become arguments: `torch.func.functional_call` runs the same layer with the tensors that are
passed in place of its own, and the light axis is one more dynamic axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import torch
from torch import Tensor, nn

from torchradiometry.errors import ShapeError, require_floating
from torchradiometry.sources.base import AbstractSource

__all__ = ["SourcesAsInputs"]


@final
class SourcesAsInputs(nn.Module):
    """Calls a layer with the tensors of its sources passed as arguments.

    Args:
        layer: a layer that was built with its sources.
        inputs: names of the layer's own inputs that are passed, in order.

    The names of all arguments, in order, are `input_names`: the layer's, then
    `source_direction`, `source_irradiance` ... (`source0_...` with several sources).

    >>> from torchradiometry.shade.lambertian import LambertianShading
    >>> from torchradiometry.sources.directional import DirectionalSource
    >>> layer = LambertianShading(DirectionalSource([0.0, 0.0, 1.0], [1.0]))
    >>> SourcesAsInputs(layer, ["normal", "albedo"]).input_names
    ('normal', 'albedo', 'source_direction', 'source_irradiance')
    """

    def __init__(self, layer: nn.Module, inputs: Sequence[str]) -> None:
        super().__init__()
        self.layer = layer
        self.layer_inputs = tuple(inputs)
        held = [s for s in layer.children() if isinstance(s, nn.ModuleList)]
        found = [s for group in held for s in group if isinstance(s, AbstractSource)]
        if not found:
            raise ShapeError("layer", "a layer without sources", "build it with its sources")
        tensors = [
            f"sources.{i}.{name}"
            for i, source in enumerate(found)
            for name, tensor in source.state_dict().items()
            if tensor.is_floating_point()
        ]
        self.source_tensors = tuple(tensors)
        many = len(found) > 1
        self.input_names = self.layer_inputs + tuple(_graph_name(name, many) for name in tensors)

    def example(self) -> dict[str, Tensor]:
        """The present tensors of the sources by argument name."""
        state = self.layer.state_dict()
        names = self.input_names[len(self.layer_inputs) :]
        return {n: state[key] for n, key in zip(names, self.source_tensors, strict=True)}

    def forward(self, *tensors: Tensor) -> Tensor:
        """The layer's output; tensors in the order of `input_names`."""
        if len(tensors) != len(self.input_names):
            raise ShapeError("tensors", f"{len(tensors)}", f"pass {self.input_names} in order")
        for name, tensor in zip(self.input_names, tensors, strict=True):
            require_floating(name, tensor)
        count = len(self.layer_inputs)
        inputs = dict(zip(self.layer_inputs, tensors[:count], strict=True))
        held = dict(zip(self.source_tensors, tensors[count:], strict=True))
        return torch.func.functional_call(self.layer, held, (), inputs)


def _graph_name(key: str, many: bool) -> str:
    """`sources.0.direction` as `source_direction`, numbered where there are several."""
    _, number, name = key.split(".", 2)
    return f"source{number if many else ''}_{name}"
