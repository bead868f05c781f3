"""What callers pass: numbers and lists become tensors, shapes must broadcast, or a named error."""

from __future__ import annotations

import torch
from torch import Tensor

from torchradiometry.errors import DTypeError, ShapeError

__all__ = ["as_numbers", "broadcast_shape"]


def broadcast_shape(where: str, *shapes: torch.Size) -> torch.Size:
    """The shape that tensors of these leading axes broadcast to; `ShapeError` if to none."""
    try:
        return torch.broadcast_shapes(*shapes)
    except RuntimeError as error:
        got = ", ".join(str(tuple(shape)) for shape in shapes)
        raise ShapeError(where, f"leading axes {got}", "pass shapes that broadcast") from error


def as_numbers(where: str, value: object, dtype: torch.dtype | None = None) -> Tensor:
    """A tensor as it is; numbers and lists of them as one, floating-point in any case.

    Args:
        where: what an error calls it.
        value: what `torch.as_tensor` takes.
        dtype: wanted; by default that of a floating-point tensor, torch's default otherwise.

    Raises:
        DTypeError: no numbers, lists of different lengths, or complex numbers.
    """
    try:
        # digits of Python's numbers are not to pass through torch's default dtype
        tensor = value if isinstance(value, Tensor) else torch.as_tensor(value, dtype=dtype)
    except (TypeError, ValueError, RuntimeError) as error:
        raise DTypeError(where, f"{value!r}"[:60], "pass a tensor, a number or a list") from error
    if tensor.is_complex():
        raise DTypeError(where, f"a tensor of {tensor.dtype}", "pass real numbers")
    if dtype is None and not tensor.is_floating_point():
        dtype = torch.get_default_dtype()
    return tensor.to(dtype)
