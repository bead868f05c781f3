"""One member under one kind in one dtype: what comes out, in a word.

The truth is the same member in float64, fed with the same (rounded) numbers; float64 itself is
held to finite values and gradients here, and to closed forms in the tests of the rooms. float32
runs under torch's anomaly mode: no step of the backward pass may make a NaN, not even one that a
later step hides.
"""

from __future__ import annotations

import math
import warnings
from typing import NamedTuple

import torch
from torch import Tensor

from tests.hard_cases.kinds import Kind
from tests.hard_cases.subjects import Leaves, Subject
from torchradiometry.errors import RadiometryError

DTYPES = (torch.float64, torch.float32, torch.bfloat16, torch.float16)
HALF = (torch.bfloat16, torch.float16)
#: what a word of the table means
WORDS = {
    "right": "finite; values and gradients are those of the same numbers in float64",
    "values": "finite; the values are those of float64 (the gradient stands at a kink)",
    "finite": "finite; the case lies on a jump, where either side is right",
    "same": "the same as for a plain contiguous copy",
    "kept": "what is not finite stays with the pixel, point or image that holds it",
    "empty": "outputs of the same size 0, gradients too",
    "beyond": "the true value or gradient is beyond the largest number of the dtype",
    "-": "the extreme is no number of the dtype, or has no meaning for the member",
}
#: roundings that a value may carry, in eps of the dtype and the largest value beside it
VALUE_ROUNDINGS = 16
#: the same for gradients, which sum over pixels and lights and multiply more factors
GRADIENT_ROUNDINGS = 64


class Result(NamedTuple):
    """Outputs, and the gradients of a weighted sum of them for every tensor."""

    outputs: list[Tensor]
    gradients: dict[str, Tensor]

    def named(self) -> dict[str, Tensor]:
        found = {f"output {i}": t for i, t in enumerate(self.outputs)}
        return found | {f"gradient of {k}": t for k, t in self.gradients.items()}


class Outcome(NamedTuple):
    """A word of `WORDS` or the name of an error; `fault` is empty unless something is wrong."""

    word: str
    fault: str = ""


def run(subject: Subject, dtype: torch.dtype, leaves: Leaves) -> Result:
    leaves = {k: t.detach().requires_grad_(t.is_floating_point()) for k, t in leaves.items()}
    outputs = subject.call(dtype, leaves)
    total = sum((o * weights(o)).sum() for o in outputs if o.requires_grad)
    if not isinstance(total, Tensor):  # nothing depends on the numbers: they were no real ones
        return Result([o.detach() for o in outputs], {})
    active = {k: t for k, t in leaves.items() if t.requires_grad}
    found = torch.autograd.grad(total, list(active.values()), allow_unused=True)
    gradients = {
        k: torch.zeros_like(t) if g is None else g
        for (k, t), g in zip(active.items(), found, strict=True)
    }
    return Result([o.detach() for o in outputs], gradients)


def attempt(subject: Subject, dtype: torch.dtype, leaves: Leaves) -> Result | Outcome:
    """The result, or the outcome of the error that was raised."""
    try:
        return run(subject, dtype, leaves)
    except RadiometryError as error:
        return Outcome(type(error).__name__)
    except Exception as error:
        name = type(error).__name__
        return Outcome(name, f"raised {name}: {error}"[:200])


def attempt_watched(subject: Subject, dtype: torch.dtype, leaves: Leaves) -> Result | Outcome:
    """The same in anomaly mode; a step that made a NaN is named."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the mode is on, and where the forward step was
        with torch.autograd.set_detect_anomaly(True):
            return attempt(subject, dtype, leaves)


def weights(output: Tensor) -> Tensor:
    """A different factor, a quarter to 1, for every element of an output."""
    steps = torch.arange(output.numel(), dtype=torch.float64)
    factors = (0.25 + torch.remainder(steps * 0.61803, 0.75)).reshape(output.shape)
    return factors.to(output.dtype)


def easy_leaves(subject: Subject, dtype: torch.dtype) -> Leaves:
    """The easy numbers in float64, as the precision of `dtype` holds them.

    They are the same in float64 and float32, and in the two half precisions, so that what is
    true of them must be found twice and not four times.
    """
    coarse = torch.bfloat16 if dtype in HALF else torch.float32
    return {k: t.to(coarse).double() for k, t in subject.easy.items()}


def hard_leaves(subject: Subject, kind: Kind, dtype: torch.dtype) -> Leaves | None:
    """The tensors in `dtype`; None where the kind does not apply."""
    easy = easy_leaves(subject, dtype)
    changed = kind.change(easy)
    if changed is None:
        return None
    leaves = {k: t.to(dtype) for k, t in (easy | changed).items()}
    return leaves if all(held(leaves[k], t) for k, t in changed.items()) else None


def held(rounded: Tensor, exact: Tensor) -> bool:
    """Whether nothing became infinite or was lost to underflow."""
    overflow = torch.isinf(rounded) & torch.isfinite(exact)
    lost = rounded.double().abs() < exact.abs() / 2
    return not bool((overflow | lost).any())


def outcomes(subject: Subject, kind: Kind) -> dict[torch.dtype, Outcome]:
    """The outcome of a kind of numbers in every dtype."""
    found, kept = {}, None
    for dtype in DTYPES:
        leaves = hard_leaves(subject, kind, dtype)
        if leaves is None:
            found[dtype] = Outcome("-")
            continue
        wide = {k: t.double() for k, t in leaves.items()}
        if kept is None or not same_leaves(wide, kept[0]):
            kept = wide, attempt(subject, torch.float64, wide)
        run_it = attempt_watched if dtype == torch.float32 else attempt
        result = kept[1] if dtype == torch.float64 else run_it(subject, dtype, leaves)
        found[dtype] = judged(result, kept[1], kind, dtype)
    return found


def same_leaves(a: Leaves, b: Leaves) -> bool:
    return all(bool(((t == b[k]) | (t.isnan() & b[k].isnan())).all()) for k, t in a.items())


def judged(
    found: Result | Outcome, exact: Result | Outcome, kind: Kind, dtype: torch.dtype
) -> Outcome:
    """The word for a result beside that of float64."""
    if isinstance(found, Outcome):
        return found
    if isinstance(exact, Outcome):
        return Outcome("finite", f"float64 raises {exact.word}, this does not")
    truth, largest = exact.named(), torch.finfo(dtype).max
    beyond = {n for n, t in truth.items() if bool(((t.abs() > largest) & ~torch.isinf(t)).any())}
    faults = []
    for name, a in found.named().items():
        gradient = name.startswith("gradient")
        roundings = GRADIENT_ROUNDINGS if gradient else VALUE_ROUNDINGS
        compared = kind.smooth if gradient else kind.values
        if beyond and (gradient or name in beyond):
            faults += [f"{name} is NaN"] if bool(torch.isnan(a).any()) else []
        else:
            faults += _faults(name, a, truth[name], roundings if compared else math.inf, dtype)
    word = "right" if kind.smooth else "values" if kind.values else "finite"
    return Outcome("beyond" if beyond else word, "; ".join(faults))


def _faults(name: str, a: Tensor, b: Tensor, roundings: float, dtype: torch.dtype) -> list[str]:
    """What is wrong with a tensor, `b` being true: infinite only where that is."""
    wrong = ~torch.isfinite(a) & ~torch.isinf(b)
    if bool(wrong.any()):
        return [f"{name} not finite ({int(wrong.sum())} of {a.numel()})"]
    info, kept = torch.finfo(dtype), torch.isfinite(b)
    if not bool(kept.any()):
        return []
    scale = float(b[kept].abs().max())
    error = float((a.double() - b)[kept].abs().max())
    allowed = roundings * (info.eps * scale + info.smallest_normal)
    return [f"{name} off by {error / scale if scale else error:.2g}"] if error > allowed else []
