"""The kinds of extreme for free functions: each argument in turn, whatever its name.

A function has no roles that the kinds of `kinds.py` know all of; its signature says which of its
axes are fixed, so a missing component must be refused by name and not be broadcast.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from functools import cache, partial

import torch
from torch import Tensor

from tests.hard_cases.bank import (
    DTYPES,
    HALF,
    Outcome,
    Result,
    attempt,
    attempt_watched,
    held,
    judged,
)
from tests.hard_cases.calls import Trial, in_dtype, inputs_of, joined, spoiled
from tests.hard_cases.kinds import Kind
from tests.hard_cases.subjects import Leaves, Subject

#: kinds for one argument, and whether values and gradients are those of float64
CHANGES: dict[str, tuple[Callable[[Tensor], Tensor], bool]] = {
    "an argument of zeros": (lambda t: t * 0, False),
    "an argument times 2^40": (lambda t: t * 2.0**40, True),
    "an argument times 2^-40": (lambda t: t * 2.0**-40, True),
    "all arguments times 1024": (lambda t: t * 1024, True),
    "an argument times -1": (lambda t: -t, False),
    "all arguments times 2^40": (lambda t: t * 2.0**40, True),
    "all arguments times 2^-40": (lambda t: t * 2.0**-40, True),
}


def changed(name: str, subject: Subject, dtype: torch.dtype) -> Outcome | None:
    """Each argument in turn, beside float64 fed with the same numbers."""
    change, smooth = CHANGES[name]
    found = []
    keys = inputs_of(subject.easy)
    for key in keys if name.startswith("an ") else ["all"]:
        leaves = in_dtype(subject, dtype)
        exact = {k: change(leaves[k].double()) for k in (keys if key == "all" else [key])}
        leaves |= {k: t.to(dtype) for k, t in exact.items()}
        if not all(held(leaves[k], t) for k, t in exact.items()):
            continue
        # float64 and float32 share their numbers, and so do the two half precisions
        known = (name, key, dtype in HALF)
        if known not in subject.known:
            wide = {k: t.double() for k, t in leaves.items()}
            subject.known[known] = attempt(subject, torch.float64, wide)
        truth = subject.known[known]
        assert isinstance(truth, (Outcome, Result))
        run_it = attempt_watched if dtype == torch.float32 else attempt
        result = truth if dtype == torch.float64 else run_it(subject, dtype, leaves)
        kind = Kind(name, lambda _: None, smooth=smooth)
        outcome = judged(result, truth, kind, dtype)
        fault = outcome.fault and f"{key}: {outcome.fault}"
        found.append(outcome._replace(fault=fault))
    return joined(found) if found else None


def spoiled_in_turn(value: float, subject: Subject, dtype: torch.dtype) -> Outcome:
    """NaN or infinity in the first entry of each argument."""
    found = []
    for key in inputs_of(subject.easy):
        outcome = spoiled(value, key.removeprefix("input."), subject, dtype)
        assert outcome is not None
        fault = outcome.fault and f"{key}: {outcome.fault}"
        found.append(outcome._replace(fault=fault))
    return joined(found)


@cache
def fixed_axes(member: object) -> dict[str, list[int]]:
    """By argument: which axes, counted from the end, the signature gives a size."""
    found = {}
    for name, parameter in inspect.signature(member).parameters.items():  # type: ignore[arg-type]
        axes = re.match(r"^\s*(?:Float|Int)\[Tensor, '([^']*)'\]", str(parameter.annotation))
        words = axes.group(1).split() if axes else []
        found[name] = [i - len(words) for i, word in enumerate(words) if word.isdigit()]
    return found


def cut(subject: Subject, dtype: torch.dtype) -> Outcome | None:
    """Each fixed axis of each argument, one entry short: refused by name."""
    found = []
    fixed = fixed_axes(subject.case.member)
    for key in inputs_of(subject.easy):
        for axis in fixed.get(key.removeprefix("input."), ()):
            leaves = in_dtype(subject, dtype)
            leaves[key] = leaves[key].narrow(axis, 0, leaves[key].shape[axis] - 1)
            found.append(_refused(attempt(subject, dtype, leaves), f"{key}, axis {axis}"))
    return joined(found) if found else None


def flat(subject: Subject, dtype: torch.dtype) -> Outcome | None:
    """A number instead of each argument that has fixed axes: refused by name."""
    found = []
    fixed = fixed_axes(subject.case.member)
    for key in inputs_of(subject.easy):
        if fixed.get(key.removeprefix("input.")):
            leaves: Leaves = in_dtype(subject, dtype)
            leaves[key] = leaves[key].reshape(-1)[0]
            found.append(_refused(attempt(subject, dtype, leaves), key))
    return joined(found) if found else None


def _refused(found: object, what: str) -> Outcome:
    if isinstance(found, Outcome):
        return found._replace(fault=found.fault and f"{what}: {found.fault}")
    return Outcome("accepted", f"{what}: not refused")


def argument_trials() -> list[Trial]:
    """All of them."""
    return [
        *(Trial(name, partial(changed, name)) for name in CHANGES),
        Trial("NaN in one entry", partial(spoiled_in_turn, math.nan)),
        Trial("infinity in one entry", partial(spoiled_in_turn, math.inf)),
        Trial("a vector or matrix one short", cut),
        Trial("a number for a vector", flat),
    ]


__all__ = ["DTYPES", "argument_trials"]
