"""Every member of a family is exported, listed in tests/cases.py, and named in the docs."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

from tests import cases
from torchradiometry import materials, plan, shade, solve, sources, transport
from torchradiometry.transport.rays import AbstractRayCaster

DOCS = Path(__file__).resolve().parents[2] / "docs"
FAMILIES = {
    "sources": (sources, sources.AbstractSource, cases.SOURCES),
    "materials": (materials, materials.AbstractMaterial, cases.MATERIALS),
    "transport": (transport, AbstractRayCaster, cases.RAY_CASTERS),
    "solve": (solve, solve.AbstractAdjoint, cases.ADJOINTS),
    "plan": (plan, plan.AbstractEffect, cases.EFFECTS),
}


def subclasses(base: type) -> set[type]:
    """The classes that can be built; abstract ones only hold what their members share."""
    found = set(base.__subclasses__())
    below = set().union(*(subclasses(member) for member in found))
    return {member for member in found if not member.__name__.startswith("Abstract")} | below


@pytest.mark.parametrize("family", FAMILIES)
def test_every_member_is_exported_tested_and_documented(family: str) -> None:
    room, base, listed = FAMILIES[family]
    members = {c for c in subclasses(base) if c.__module__.startswith("torchradiometry")}
    page = (DOCS / f"{family}.md").read_text()
    covered = {getattr(case, "member", case) for case in listed}
    assert members
    for member in members:
        assert member.__name__ in room.__all__, f"{member.__name__} is missing in {family}.__all__"
        assert member in covered, f"{member.__name__} is missing in tests/cases.py"
        assert f"`{member.__name__}`" in page, f"{member.__name__} is missing in docs/{family}.md"


@pytest.mark.parametrize("room", [shade, solve], ids=["shade", "solve"])
def test_every_layer_and_solver_is_tested_and_documented(room: object) -> None:
    listed = cases.LAYERS if room is shade else cases.SOLVERS
    covered = {case.member for case in listed}
    page = (DOCS / f"{room.__name__.split('.')[-1]}.md").read_text()
    suffix = "Shading" if room is shade else ""
    members = [
        value
        for name in room.__all__
        if inspect.isclass(value := getattr(room, name))
        and (name.endswith(suffix) if suffix else issubclass(value, solve.AbstractSolver))
        and not name.startswith("Abstract")
    ]
    assert members
    for member in members:
        assert member in covered, f"{member.__name__} is missing in tests/cases.py"
        assert f"`{member.__name__}`" in page, f"{member.__name__} is missing in the docs"


@pytest.mark.parametrize(
    "base",
    [
        sources.AbstractSource,
        materials.AbstractMaterial,
        solve.AbstractOperator,
        solve.AbstractSolver,
        solve.AbstractAdjoint,
        plan.AbstractEffect,
    ],
)
def test_classes_are_abstract_or_final(base: type) -> None:
    for member in subclasses(base):
        if member.__module__.startswith("torchradiometry"):
            assert getattr(member, "__final__", False), f"{member.__name__} is not @final"
            assert not member.__subclasses__()
