"""A handful of exported layers and both models compute the same in Node as in torch and Python.

Every member, in the browser too: `python -m tests.benchmarks.runtimes`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from tests import cases
from tests.benchmarks.runtimes import difference, exported, members, model_work
from tests.cases import OTHER
from tests.runtimes import Script
from tests.web import require

#: one of each kind of arithmetic: products, a power lobe in float64, a loop, double precision
HANDFUL = {
    "layer lambertian_directional": torch.float32,
    "layer phong_directional": torch.float32,
    "material lambertian": torch.float64,
    "solver adaptive_neumann": torch.float32,
}
#: of max |b|: some hundred roundings
CLOSE = {torch.float32: 1e-5, torch.float64: 1e-12}


@pytest.fixture(scope="module")
def node() -> Iterator[Script]:
    require(browser=False)
    script = Script("run_node.mjs")
    yield script
    script.close()


@pytest.mark.parametrize("name", HANDFUL)
def test_a_layer_in_node_is_the_layer_in_torch(
    node: Script, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.benchmarks.runtimes.sizes_of", lambda case: OTHER)
    dtype = HANDFUL[name]
    work = exported(name, members()[name], dtype, tmp_path)
    answer = node.run(work.path, work.inputs, 1, 0.0)
    assert answer.error is None
    assert all(output.dtype == str(dtype)[6:] for output in answer.outputs)
    assert difference(answer.outputs, work.expected) < CLOSE[dtype]


@pytest.mark.parametrize("name", ["shading", "photometric"])
def test_a_model_in_node_is_the_model_in_python(node: Script, name: str) -> None:
    work = model_work(name)
    answer = node.run(work.path, work.inputs, 1, 0.0)
    assert answer.error is None
    assert difference(answer.outputs, work.expected) < CLOSE[torch.float32]


def test_a_fault_is_told_and_the_process_goes_on(node: Script, tmp_path: Path) -> None:
    path = tmp_path / "no-model.onnx"
    path.write_bytes(b"no model")
    assert node.run(path, {}, 1, 0.0).error
    work = model_work("shading")
    assert node.run(work.path, {"image": work.inputs["image"]}, 1, 0.0).error
    assert node.run(work.path, work.inputs, 1, 0.0).error is None


def test_difference_sees_what_it_should() -> None:
    one = np.ones((2, 3), np.float32)
    assert difference([one], [one]) == 0
    assert difference([one * 1.5], [one]) == 0.5
    assert difference([one[:1]], [one]) == np.inf
    assert difference([one * np.nan], [one]) == np.inf


def test_every_family_that_holds_modules_is_measured() -> None:
    counted = sum(len(f) for f in (cases.SOURCES, cases.MATERIALS, cases.LAYERS, cases.SOLVERS))
    assert len(members()) == counted + len(cases.TRANSPORT)
