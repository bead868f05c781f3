"""Every member of every family through every kind of extreme, values and gradients, four dtypes.

What comes out is what the policy of `docs/hard-cases.md` says: its table is compared word by word.
"""

from __future__ import annotations

from functools import cache

import pytest
import torch
from torch import Tensor, nn

from tests.cases import Case
from tests.hard_cases.bank import Outcome, outcomes
from tests.hard_cases.calls import spoiled
from tests.hard_cases.kinds import KINDS, Kind
from tests.hard_cases.subjects import Subject
from tests.hard_cases.survey import MEMBERS, kind_names, survey
from tests.hard_cases.table import PAGE, read_table


@cache
def committed() -> dict[str, dict[str, tuple[str, ...]]]:
    return read_table(PAGE.read_text())


@pytest.mark.parametrize("member", MEMBERS)
def test_no_extreme_gives_what_the_policy_does_not_name(member: str) -> None:
    found = survey(member)
    assert not found.faults, "\n".join(found.faults)
    assert found.words == committed()[member], (
        "the table of docs/hard-cases.md is not what the bank gives: "
        "run python -m tests.hard_cases.table and look at what changed"
    )


def test_table_names_only_kinds_that_exist() -> None:
    named = {kind for words in committed().values() for kind in words}
    assert named <= set(kind_names())


def test_every_kind_applies_to_some_member() -> None:
    named = {kind for words in committed().values() for kind in words}
    assert {kind.name for kind in KINDS} <= named


class Wrong(nn.Module):
    """Layers with the mistakes that the bank is to find."""

    def __init__(self, mistake: str) -> None:
        super().__init__()
        self.mistake = mistake

    def forward(self, normal: Tensor, albedo: Tensor) -> Tensor:
        length = (normal * normal).sum(1, keepdim=True)
        if self.mistake == "gradient of a root":
            return albedo * length.sqrt()
        if self.mistake == "hidden":  # 0 / 0 in the backward pass, which where does not pass on
            bent = torch.where(length > 0, length, length.detach()).sqrt()
            return albedo * torch.where(length > 0, bent, 0)
        if self.mistake == "overflow":
            return albedo * (length * 1e4).sqrt().clamp(min=1e-3) / 100
        if self.mistake == "wrong value":
            return albedo * torch.where(albedo == 0, 1, length)
        if self.mistake == "spreads":
            return albedo - albedo.mean((2, 3), keepdim=True) * 0
        return albedo + length


def wrong(mistake: str) -> Subject:
    def inputs(dtype: torch.dtype, sizes: object) -> tuple[Tensor, Tensor]:
        steps = torch.arange(1, 25, dtype=dtype).reshape(2, 3, 2, 2)
        return steps / 32, steps.flip(0) / 32

    return Subject("layer", Case(mistake, Wrong, lambda dtype: Wrong(mistake), inputs))


def kind(name: str) -> Kind:
    return next(k for k in KINDS if k.name == name)


@pytest.mark.parametrize(
    ("mistake", "under", "dtype", "said"),
    [
        ("gradient of a root", "a zero normal", torch.bfloat16, "not finite"),
        ("hidden", "a zero normal", torch.float32, "nan"),
        ("overflow", "normals of length 1000", torch.float16, "not finite"),
        ("none", "a zero normal", torch.float32, ""),
    ],
)
def test_the_bank_finds_mistakes(mistake: str, under: str, dtype: torch.dtype, said: str) -> None:
    found = outcomes(wrong(mistake), kind(under))[dtype]
    assert said in found.fault
    assert bool(found.fault) == bool(said)


def test_the_bank_finds_nan_that_spreads() -> None:
    found = spoiled(float("nan"), "albedo", wrong("spreads"), torch.float32)
    assert isinstance(found, Outcome)
    assert "elsewhere" in found.fault
    assert not spoiled(float("nan"), "albedo", wrong("none"), torch.float32).fault
