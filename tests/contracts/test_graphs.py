"""Every member computes the same eagerly, compiled and under onnxruntime; gradients agree.

Each graph is traced on one set of sizes and run on another: batch, height, width and (where
the lights are inputs) the number of lights stay dynamic.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from torch.autograd import gradcheck

from tests.cases import (
    LAYERS,
    MATERIALS,
    OTHER,
    SMALL,
    SOURCES,
    TRANSPORT,
    Case,
    Sizes,
    reliefs,
)
from tests.tolerances import assert_close
from torchradiometry.deploy.runtime import open_model, run_model
from torchradiometry.export import export_onnx
from torchradiometry.shade import CastShadow
from torchradiometry.sources import DirectionalSource

FAMILIES = {"source": SOURCES, "material": MATERIALS, "layer": LAYERS, "transport": TRANSPORT}
EVERY = {f"{kind}-{case.name}": case for kind, family in FAMILIES.items() for case in family}
#: layers that go through the C++ code generator, one for each kind of arithmetic; the others
#: take the same traced graphs through the eager backend, whose compilation is cheap
GENERATED = {"layer-lambertian_directional", "layer-phong_directional", "layer-ambient"}
#: compiled and onnxruntime kernels sum and take powers in another order than eager ones:
#: some twenty roundings, times the exponent (9) of the lobes in the cases
KERNEL_ROUNDING = {torch.float32: 2e-5, torch.float64: 1e-12}


class Finite(nn.Module):
    """A member with a tuple of finite outputs: the distance to a distant light becomes 0."""

    def __init__(self, module: nn.Module, inputs: int) -> None:
        super().__init__()
        self.module = module
        self.input_names = tuple(f"input{i}" for i in range(inputs))

    def forward(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        out = self.module(*tensors)
        if isinstance(out, Tensor):
            return (out,)
        return (out[0], out[1], torch.where(torch.isinf(out[2]), 0, out[2]))


def build(case: Case, dtype: torch.dtype) -> nn.Module:
    return Finite(case.build(dtype), len(case.inputs(dtype, SMALL))).eval()


def loss(outputs: tuple[Tensor, ...]) -> Tensor:
    """One number that weighs every output element differently."""
    weights = [torch.linspace(0.5, 1.5, o.numel(), dtype=o.dtype).reshape(o.shape) for o in outputs]
    return sum((o * w).sum() for o, w in zip(outputs, weights, strict=True))


def differentiable(inputs: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    return tuple(t.clone().requires_grad_() for t in inputs)


def values_and_gradients(module: nn.Module, inputs: tuple[Tensor, ...]) -> list[Tensor]:
    """Outputs, then the gradients of every input and of every tensor the member holds."""
    held = [t for t in module.state_dict(keep_vars=True).values() if t.is_floating_point()]
    leaves = [*differentiable(inputs), *(t.requires_grad_() for t in held)]
    outputs = module(*leaves[: len(inputs)])
    grads = torch.autograd.grad(loss(outputs), leaves, allow_unused=True)
    zeros = [torch.zeros_like(t) if g is None else g for g, t in zip(grads, leaves, strict=True)]
    return [*(o.detach() for o in outputs), *zeros]


@pytest.fixture(autouse=True)
def fresh_compiler():
    torch.compiler.reset()
    yield
    torch.compiler.reset()


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.filterwarnings("ignore:.torch.jit.script:DeprecationWarning")  # in torch's own import
def test_compiled_graph_computes_the_same_on_other_sizes(name: str) -> None:
    case, dtype = EVERY[name], torch.float32
    generated = name in GENERATED and shutil.which("g++") is not None
    module = build(case, dtype)
    backend = "inductor" if generated else "aot_eager"
    compiled = torch.compile(module, fullgraph=True, backend=backend)
    for sizes in (SMALL, OTHER):
        inputs = case.inputs(dtype, sizes)
        for a, b in zip(
            values_and_gradients(compiled, inputs),
            values_and_gradients(module, inputs),
            strict=True,
        ):
            assert torch.isfinite(b).all()
            assert_close(a, b, rtol=KERNEL_ROUNDING[dtype], atol=1e-5 * float(b.abs().max() + 1))


def axes(small: Tensor, other: Tensor) -> list[str]:
    """Axes whose size differs between two calls, named by the pair of sizes; others are fixed."""
    pairs = zip(small.shape, other.shape, strict=True)
    return [str(a) if a == b else f"axis_{a}_{b}" for a, b in pairs]


@pytest.mark.parametrize("name", EVERY)
def test_onnxruntime_computes_the_same_on_other_sizes(name: str, tmp_path: Path) -> None:
    case, dtype = EVERY[name], torch.float64
    module = build(case, dtype)
    small, other = case.inputs(dtype, SMALL), case.inputs(dtype, OTHER)
    with torch.no_grad():
        expected = module(*other)
    path = export_onnx(
        module,
        small,
        tmp_path / "member.onnx",
        axes={n: axes(s, o) for n, s, o in zip(module.input_names, small, other, strict=True)},
        outputs={f"output{i}": "1" for i in range(len(expected))},
    )
    model = open_model(path)
    by_name = dict(zip(module.input_names, other, strict=True))
    found = run_model(model, {item.name: by_name[item.name].numpy() for item in model.inputs})
    for a, b in zip(found, expected, strict=True):
        assert_close(torch.as_tensor(a), b)


@pytest.mark.parametrize("name", EVERY)
def test_gradients_agree_with_finite_differences(name: str) -> None:
    case, dtype = EVERY[name], torch.float64
    module = build(case, dtype)
    parameters = {n: p.detach() for n, p in module.state_dict().items() if p.is_floating_point()}
    inputs = case.inputs(dtype, Sizes(1, 1, 2, 2))

    def call(*tensors: Tensor) -> tuple[Tensor, ...]:
        held = dict(zip(parameters, tensors[len(inputs) :], strict=True))
        outputs = torch.func.functional_call(module, held, tensors[: len(inputs)])
        return tuple(o for o in outputs if o.requires_grad)

    assert gradcheck(call, differentiable((*inputs, *parameters.values())))


def test_hard_shadows_run_under_onnx_at_any_size(tmp_path: Path) -> None:
    """They have no gradient, so they are no `Case`; loops over crossings, one for each family."""
    lights = torch.tensor([[0.7, 0.2, 0.6], [-0.3, 0.8, 0.4]], dtype=torch.float64)
    lights = lights / lights.norm(dim=-1, keepdim=True)
    source = DirectionalSource(lights, torch.ones(1, 1, dtype=torch.float64))
    layer = CastShadow(source, pixel_size=0.1).eval()
    make = reliefs()
    (small,), (other,) = make(torch.float64, SMALL), make(torch.float64, OTHER)
    path = export_onnx(
        layer,
        (small,),
        tmp_path / "shadow.onnx",
        axes={"depth": axes(small, other)},
        outputs={"visibility": "1"},
    )
    (found,) = run_model(open_model(path), {"depth": other.numpy()})
    with torch.no_grad():
        expected = layer(other)
    assert 0 < expected.mean() < 1
    assert torch.equal(torch.as_tensor(found), expected)
