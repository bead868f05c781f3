"""Same inputs, same bits: values and gradients of every member of the families, computed twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from tests.cases import ADJOINTS, LAYERS, MATERIALS, SOLVERS, SOURCES, TRANSPORT, Case, Sizes
from tests.hard_cases.functions import FUNCTIONS
from tests.hard_cases.subjects import Leaves, Subject
from tests.invariants import draws
from tests.invariants.draws import invariant
from torchradiometry import render, scene, shade
from torchradiometry.errors import RadiometryError

FAMILIES = {
    "source": SOURCES,
    "material": MATERIALS,
    "layer": LAYERS,
    "solver": SOLVERS,
    "adjoint": ADJOINTS,
    "transport": TRANSPORT,
    "function": FUNCTIONS,
}
MEMBERS = [(family, case) for family, cases in FAMILIES.items() for case in cases]
IDS = [f"{family}-{case.name}" for family, case in MEMBERS]
#: images, pixels (or points, patches, triangles) and lights of one draw
SIZES = Sizes(2, 4, 8, 2)
POINTS = SIZES.batch * SIZES.height * SIZES.width
#: built once
SUBJECTS: dict[tuple[str, str], Subject] = {}
#: large enough for torch to share the work among threads
LARGE, PATCHES = Sizes(2, 96, 96, 2), Sizes(2, 16, 24, 2)


def found(subject: Subject, leaves: Leaves, dtype: torch.dtype, weight: int) -> list[Tensor]:
    """Outputs, and the gradients of a drawn sum of them."""
    held = {key: t.detach().to(dtype).requires_grad_() for key, t in leaves.items()}
    try:
        outputs = subject.call(dtype, held)
    except RadiometryError as error:  # a drawn room that no scaling closes: the same words
        return [torch.tensor(list(str(error).encode()))]
    draw = draws.generator(weight)
    smooth = [t for t in outputs if t.requires_grad]
    if not smooth:
        return list(outputs)
    parts = (torch.rand(t.shape, generator=draw, dtype=torch.float64).to(t) for t in smooth)
    total = torch.stack([(t * w).sum() for t, w in zip(smooth, parts, strict=True)]).sum()
    gradients = torch.autograd.grad(total, list(held.values()), allow_unused=True)
    return [*outputs, *(t for t in gradients if t is not None)]


def same_bits(run: Callable[[], list[Tensor]]) -> None:
    first, again = run(), run()
    assert len(first) == len(again)
    for one, other in zip(first, again, strict=True):
        assert torch.equal(one.nan_to_num(nan=-1.5), other.nan_to_num(nan=-1.5))


@pytest.mark.parametrize(("family", "case"), MEMBERS, ids=IDS)
@given(seed=draws.seeds, single=st.booleans())
@invariant(POINTS)
def test_same_bits(family: str, case: Case, seed: int, single: bool) -> None:
    subject = SUBJECTS.setdefault((family, case.name), Subject(family, case, SIZES))
    draw = draws.generator(seed)
    # a little, so that rooms stay closed, polygons planar and albedos below 1
    leaves = {key: t * draws.uniform(draw, low=0.9, high=1.0) for key, t in subject.easy.items()}
    dtype = torch.float32 if single else torch.float64
    same_bits(lambda: found(subject, leaves, dtype, seed))


@pytest.mark.parametrize("case", [*SOURCES, *MATERIALS, *LAYERS], ids=lambda case: case.name)
def test_same_bits_on_two_threads(case: Case) -> None:
    sizes = PATCHES if case.member is shade.RadiosityShading else LARGE
    subject = Subject("large", case, sizes)
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        same_bits(lambda: found(subject, subject.easy, torch.float32, 0))
    finally:
        torch.set_num_threads(threads)


def test_pictures_have_the_same_bits() -> None:
    """Rays, form factors, a solver and its adjoint, all with their own seeds."""

    def picture() -> list[Tensor]:
        room = scene.cornell_like_room(width=24, height=16)
        paint = torch.full((3,), 0.6, requires_grad=True)
        walls = (replace(s, albedo=paint) if s.name == "walls" else s for s in room.surfaces)
        painted = replace(room, surfaces=tuple(walls))
        radiance = render.render_scene(painted, room.cameras[0]).radiance
        return [radiance, *torch.autograd.grad(radiance.sum(), paint)]

    same_bits(picture)
