"""Every solver and adjoint on CUDA tensors, where there is a device."""

import pytest
import torch

from tests.cases import ADJOINTS, OTHER, SOLVERS, enclosure
from tests.tolerances import assert_close


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("case", [*SOLVERS, *ADJOINTS], ids=lambda c: c.name)
def test_the_device_computes_the_same_with_gradients(case) -> None:
    inputs = enclosure(torch.float64, OTHER)
    results = []
    for device in ("cpu", "cuda"):
        tensors = [t.to(device).requires_grad_() for t in inputs]
        found = case.build(torch.float64).to(device)(*tensors)
        assert found.device.type == device
        gradients = torch.autograd.grad(found.square().sum(), tensors)
        results.append([t.detach().cpu() for t in (found, *gradients)])
    for a, b in zip(results[1], results[0], strict=True):
        assert_close(a, b, rtol=1e-9, atol=1e-10 * float(b.abs().max()))
