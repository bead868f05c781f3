"""One tolerance table by dtype; anything looser is a named constant with its derivation."""

import torch

#: relative error of a layer or formula against its closed form
RELATIVE = {torch.float64: 1e-12, torch.float32: 1e-6}
#: absolute floor for values that are zero in exact arithmetic, per unit of the largest value
ABSOLUTE = {torch.float64: 1e-13, torch.float32: 1e-6}


def assert_close(actual: torch.Tensor, expected: object, **overrides: float) -> None:
    """`torch.testing.assert_close` with this table; `rtol`/`atol` override it by name."""
    expected = torch.as_tensor(expected, dtype=actual.dtype, device=actual.device)
    scale = float(expected.abs().max()) if expected.numel() else 1.0
    rtol = overrides.get("rtol", RELATIVE[actual.dtype])
    atol = overrides.get("atol", ABSOLUTE[actual.dtype] * scale)
    torch.testing.assert_close(actual, expected.expand_as(actual), rtol=rtol, atol=atol)
