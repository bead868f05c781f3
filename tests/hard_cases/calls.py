"""The kinds of extreme that are about tensors and not about numbers, and NaN that must not spread.

Each trial takes a subject and a dtype and gives an `Outcome`, or None where it does not apply.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from tests.hard_cases.bank import (
    DTYPES,
    VALUE_ROUNDINGS,
    Outcome,
    Result,
    attempt,
    easy_leaves,
)
from tests.hard_cases.kinds import at_first
from tests.hard_cases.subjects import TINY, Leaves, Subject, role

#: errors that may answer a tensor of the wrong dtype
NOT_A_NUMBER = {"InvalidValueError"}


class Trial(NamedTuple):
    """A kind by name, and what it gives for a subject in a dtype."""

    name: str
    outcome: Callable[[Subject, torch.dtype], Outcome | None]


def inputs_of(leaves: Leaves) -> list[str]:
    return [key for key in leaves if key.startswith("input.")]


def joined(found: list[Outcome]) -> Outcome:
    """One outcome for several: the words in order, all faults."""
    words = sorted({o.word for o in found})
    return Outcome(" / ".join(words), "; ".join(o.fault for o in found if o.fault))


def in_dtype(subject: Subject, dtype: torch.dtype) -> Leaves:
    return {k: t.to(dtype) for k, t in easy_leaves(subject, dtype).items()}


# layout


def strided(tensor: Tensor) -> Tensor:
    """The same numbers with holes between them in memory."""
    room = tensor.new_zeros(*tensor.shape, 2)
    room[..., 0] = tensor
    return room[..., 0]


def expanded(tensor: Tensor) -> Tensor:
    """The first entry for all, by a stride of 0."""
    return tensor[:1].expand_as(tensor)


def laid_out(change: Callable[[Tensor], Tensor], subject: Subject, dtype: torch.dtype) -> Outcome:
    """The inputs in another layout of memory, beside contiguous copies of the same numbers."""
    leaves = {
        k: change(t) if k.startswith("input.") else t for k, t in in_dtype(subject, dtype).items()
    }
    found = attempt(subject, dtype, leaves)
    if change is strided:
        plain = easy_result(subject, dtype)
    else:
        plain = attempt(subject, dtype, {k: t.contiguous() for k, t in leaves.items()})
    if isinstance(found, Outcome) or isinstance(plain, Outcome):
        return found if isinstance(found, Outcome) else Outcome("same", "only the copy raises")
    if change is expanded:  # which of the equal entries the gradient goes to is not said
        found, plain = (r._replace(gradients=_summed(r.gradients)) for r in (found, plain))
    return Outcome("same", "; ".join(differences(found, plain, dtype)))


def _summed(gradients: Leaves) -> Leaves:
    return {k: t.sum(0) if k.startswith("input.") else t for k, t in gradients.items()}


def differences(found: Result, plain: Result, dtype: torch.dtype) -> Iterator[str]:
    """Names of tensors that differ by more than another order of summation would make them."""
    for name, a in found.named().items():
        b = plain.named()[name]
        finite = torch.isfinite(b)
        scale = float(b[finite].abs().max()) if bool(finite.any()) else 0.0
        allowed = VALUE_ROUNDINGS * torch.finfo(dtype).eps * scale
        same = (a == b) | ((a - b).abs() <= allowed)
        if not bool(same.all()):
            yield f"{name} differs"


# sizes


def resized(sizes: dict[str, int], subject: Subject, dtype: torch.dtype) -> Outcome | None:
    """The member with axes of other sizes."""
    other = Subject(subject.family, subject.case, TINY._replace(**sizes))
    if all(other.easy[k].shape == subject.easy[k].shape for k in inputs_of(subject.easy)):
        return None
    found = attempt(other, dtype, in_dtype(other, dtype))
    if isinstance(found, Outcome):
        return found
    exact = attempt(
        other, torch.float64, {k: t.double() for k, t in in_dtype(other, dtype).items()}
    )
    empty = all(o.numel() == 0 for o in found.outputs)
    bad = [n for n, t in found.named().items() if not _as_finite(t, exact, n)]
    return Outcome("empty" if empty else "right", ", ".join(f"{n} not finite" for n in bad))


def _as_finite(t: Tensor, exact: Result | Outcome, name: str) -> bool:
    return isinstance(exact, Result) and bool(
        (torch.isfinite(t) | torch.isinf(exact.named()[name])).all()
    )


# dtypes


def recast(to: torch.dtype | None, subject: Subject, dtype: torch.dtype) -> Outcome:
    """Each input in turn in another dtype (None: another precision)."""
    other = to or (torch.float32 if dtype == torch.float64 else torch.float64)
    found = []
    for key in inputs_of(subject.easy):
        leaves = in_dtype(subject, dtype)
        result = attempt(subject, dtype, leaves | {key: leaves[key].to(other)})
        found.append(result if isinstance(result, Outcome) else _finite(result))
    return joined(found)


def _finite(result: Result) -> Outcome:
    bad = [n for n, t in result.named().items() if bool(torch.isnan(t).any())]
    return Outcome("finite", ", ".join(f"{n} is NaN" for n in bad))


# numbers that are none


def easy_result(subject: Subject, dtype: torch.dtype) -> Result | Outcome:
    if dtype not in subject.known:
        subject.known[dtype] = attempt(subject, dtype, in_dtype(subject, dtype))
    return subject.known[dtype]


def spoiled(value: float, name: str, subject: Subject, dtype: torch.dtype) -> Outcome | None:
    """NaN or infinity in the first entry of an input: it stays where that entry matters."""
    key = f"input.{name}"
    if key not in subject.easy:
        return None
    leaves = in_dtype(subject, dtype)
    easy = easy_result(subject, dtype)
    found = attempt(subject, dtype, leaves | {key: _with(leaves[key], value)})
    if isinstance(found, Outcome) or isinstance(easy, Outcome):
        return found if isinstance(found, Outcome) else easy
    reach = reached(subject, key)
    bad = [
        f"{n} not finite elsewhere ({int((~torch.isfinite(t) & ok).sum())})"
        for n, t in found.named().items()
        if bool((~torch.isfinite(t) & (ok := ~reach[n] & torch.isfinite(easy.named()[n]))).any())
    ]
    finite = all(
        bool((torch.isfinite(t) | ~torch.isfinite(easy.named()[n])).all())
        for n, t in found.named().items()
    )
    return Outcome("finite" if finite else "kept", "; ".join(bad))


def _with(tensor: Tensor, value: float) -> Tensor:
    tensor = tensor.clone()
    tensor.view(-1)[0] = value
    return tensor


def reached(subject: Subject, key: str) -> dict[str, Tensor]:
    """Which results may hold what the first entry of an input makes of them.

    Those that move when the whole first point does, to numbers of either sign. Where depths or
    patches couple the points, all of the first image; where nothing else is shared, no other.
    """
    if key not in subject.reach:
        leaves = subject.easy
        base = attempt(subject, torch.float64, leaves)
        assert isinstance(base, Result)
        moved = {n: torch.zeros_like(t, dtype=torch.bool) for n, t in base.named().items()}
        few = subject.family == "function"  # whose whole first entry is spoiled anyway
        steps = ((0.3, 1.0),) if few else itertools.product((-0.7, 0.3, 3.0), (-1.0, 1.0))
        for value, other in steps:
            # form factors of one sign: with others, a solver may wander as long as it is allowed
            first = abs(value) if key == "input.form_factors" else value
            changed = {key: _with(leaves[key], first)}
            if not key.startswith("input.source_") and key != "input.intrinsics":
                own = {k: value if role(k) == "normal" else other for k in leaves if _own(k)}
                changed |= {k: _point(k, leaves[k], v) for k, v in own.items()}
            found = attempt(subject, torch.float64, leaves | changed)
            if isinstance(found, Result):
                for n, t in found.named().items():
                    moved[n] |= t != base.named()[n]
        if subject.family == "source":  # samples that face away move for no change of the point
            for name, there in moved.items():
                if name.startswith("output"):
                    there[:, 0, 0] = True
        coupled = {"input.depth", "input.form_factors", "input.corners"} & set(leaves)
        coupled |= {subject.family} & {"function"}  # a polygon, a mesh, a room: one entry
        for there in moved.values():
            if key.startswith("input.source_"):  # a light shines on every point, if only with 0
                there |= True
            if few and there.ndim == 1:
                there[:1] = True
            if coupled and there.ndim > 1:
                there |= there.flatten(1).any(1).reshape(-1, *(1,) * (there.ndim - 1))
        subject.reach[key] = moved
    return subject.reach[key]


def _own(key: str) -> bool:
    """Whether a tensor is an input with an entry for each point or patch."""
    shared = {"intrinsics", "form_factors", "corners", "depth", "radiance"}
    return (
        key.startswith("input.") and not key.startswith("input.source_") and role(key) not in shared
    )


def _point(key: str, tensor: Tensor, value: float) -> Tensor:
    """The first point of an input, moved by `value` in all its numbers, or set to it."""
    name = key.removeprefix("input.")
    steps = torch.linspace(0.5, 1, at_first({key: tensor}, name).numel(), dtype=tensor.dtype)
    return at_first({key: tensor}, name, value * steps)


def trials(names: set[str]) -> list[Trial]:
    """All of them; `names` are the inputs that any member takes."""
    found = [
        Trial("tensors with gaps in memory", partial(laid_out, strided)),
        Trial("expanded tensors", partial(laid_out, expanded)),
        Trial(
            "one pixel, one light, batch of one",
            partial(resized, {"batch": 1, "height": 1, "width": 1, "light": 1}),
        ),
        Trial("no images (batch 0)", partial(resized, {"batch": 0})),
        Trial("no pixels (height 0)", partial(resized, {"height": 0})),
        Trial("no lights", partial(resized, {"light": 0})),
        Trial("an integer input", partial(recast, torch.int64)),
        Trial("a complex input", partial(recast, torch.complex64)),
        Trial("an input of another precision", partial(recast, None)),
    ]
    for name in sorted(names):
        found.append(Trial(f"NaN in one {name}", partial(spoiled, math.nan, name)))
        found.append(Trial(f"infinity in one {name}", partial(spoiled, math.inf, name)))
    return found


__all__ = ["DTYPES", "Trial", "trials"]
