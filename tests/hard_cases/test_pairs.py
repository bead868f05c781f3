"""Two extremes at once: whatever the pair, values and gradients are finite where float64's are.

The bank asks each kind for the right numbers; here pairs are drawn and only what is not finite is a
fault: two kinds together may stand on a kink that neither stands on alone. `--thorough`: 30 times
as many.
"""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest
import torch

from tests.hard_cases.bank import outcomes
from tests.hard_cases.kinds import KINDS, Kind
from tests.hard_cases.policy import named
from tests.hard_cases.subjects import Leaves, Subject
from tests.hard_cases.survey import FAMILIES

MEMBERS = {
    f"{family}-{case.name}": (family, case)
    for family, cases in FAMILIES.items()
    for case in cases
    if family != "function"  # their kinds change each argument in turn
}
PAIRS, THOROUGH = 6, 180


def together(first: Kind, second: Kind) -> Kind:
    """Both changes, one after the other; not where they make a NaN of each other."""

    def change(leaves: Leaves) -> Leaves | None:
        found = first.change(leaves)
        more = None if found is None else second.change(leaves | found)
        if found is None or more is None:
            return None
        both = found | more
        return both if all(bool(torch.isfinite(t).all()) for t in both.values()) else None

    return Kind(f"{first.name} and {second.name}", change, smooth=False, values=False)


def pairs(member: str, count: int) -> Iterator[tuple[Subject, Kind]]:
    """Drawn pairs of the kinds that are about finite numbers."""
    subject = Subject(*MEMBERS[member])
    fit = [
        kind
        for kind in KINDS
        if not any(word in kind.name for word in ("NaN", "infin", "easy"))
        and named(kind.name, member) is None
        and kind.change(subject.easy) is not None
    ]
    draw = random.Random(member)  # the same pairs in every run
    for _ in range(count if len(fit) > 1 else 0):
        yield subject, together(*draw.sample(fit, 2))


@pytest.mark.parametrize("member", MEMBERS)
def test_two_extremes_at_once_stay_finite(member: str, request: pytest.FixtureRequest) -> None:
    count = THOROUGH if request.config.getoption("thorough") else PAIRS
    faults = []
    for subject, kind in pairs(member, count):
        found = outcomes(subject, kind)
        faults += [f"{kind.name}, {d}: {o.fault}" for d, o in found.items() if o.fault]
    assert not faults, "\n".join(faults)
