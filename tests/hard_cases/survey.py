"""Every kind through one member: the rows of the table, and what is wrong."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import torch

from tests.cases import ADJOINTS, LAYERS, MATERIALS, SOLVERS, SOURCES, TRANSPORT, Case
from tests.hard_cases.arguments import argument_trials
from tests.hard_cases.bank import DTYPES, Outcome, outcomes
from tests.hard_cases.calls import trials
from tests.hard_cases.functions import FUNCTIONS
from tests.hard_cases.kinds import KINDS
from tests.hard_cases.policy import named
from tests.hard_cases.subjects import Subject, input_names

#: the families whose members are modules with tensors in and out
FAMILIES: dict[str, list[Case]] = {
    "source": SOURCES,
    "material": MATERIALS,
    "layer": LAYERS,
    "solver": SOLVERS,
    "adjoint": ADJOINTS,
    "transport": TRANSPORT,
    "function": FUNCTIONS,
}
MEMBERS = {f"{family}-{case.name}": case for family, cases in FAMILIES.items() for case in cases}


class Survey(NamedTuple):
    """Words by kind, one for each of `DTYPES`, and the faults."""

    words: dict[str, tuple[str, ...]]
    faults: list[str]


@cache
def kind_names() -> tuple[str, ...]:
    """All kinds, in the order of the table."""
    found = (*KINDS, *argument_trials(), *_trials())
    return tuple(kind.name for kind in found)


@cache
def _trials() -> tuple:
    modules = (case for family, cases in FAMILIES.items() if family != "function" for case in cases)
    names = (input_names(case.build(torch.float64)) for case in modules)
    return tuple(trials({name for found in names for name in found}))


@cache
def survey(member: str) -> Survey:
    """One member, `family-name`, through everything."""
    subject = Subject(member.split("-")[0], MEMBERS[member])
    words, faults = {}, []
    free = subject.family == "function"
    for kind in KINDS[:1] if free else KINDS:  # arguments have roles of their own
        words[kind.name] = _words(kind.name, member, outcomes(subject, kind), faults)
    for trial in (*argument_trials(), *trials(set())) if free else _trials():
        found = {d: trial.outcome(subject, d) or Outcome("-") for d in DTYPES}
        words[trial.name] = _words(trial.name, member, found, faults)
    return Survey({k: w for k, w in words.items() if set(w) != {"-"}}, faults)


def _words(kind: str, member: str, found: dict, faults: list[str]) -> tuple[str, ...]:
    """The words of a row; what is wrong and not documented goes to `faults`."""
    documented, words = named(kind, member), []
    for dtype, outcome in found.items():
        if outcome.fault and documented is None:
            faults.append(f"{kind}, {str(dtype)[6:]}: {outcome.word}: {outcome.fault}")
        words.append(documented.word if outcome.fault and documented else outcome.word)
    return tuple(words)
