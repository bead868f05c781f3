"""Every public name that takes numbers is in a bank; those on NumPy arrays are brought here."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from tests import cases
from tests.hard_cases.elsewhere import ELSEWHERE
from tests.hard_cases.survey import MEMBERS
from torchradiometry import deploy, errors, geometry, learn, solve

ROOT = Path(__file__).resolve().parents[2]
#: annotations of what holds numbers
NUMBERS = re.compile(r"Tensor|NDArray|float|object")


def takes_numbers(member: object) -> bool:
    """Functions and classes with tensors, arrays or numbers among their arguments."""
    if not callable(member) or getattr(member, "__name__", "").startswith("Abstract"):
        return False
    if inspect.isclass(member) and issubclass(member, (tuple, Exception)):
        return False  # results and errors, which compute nothing
    try:
        arguments = inspect.signature(member).parameters.values()
    except ValueError:
        return False
    return any(NUMBERS.search(str(a.annotation)) for a in arguments)


def public() -> dict[str, object]:
    names = (ROOT / "tests/contracts/public_api.txt").read_text().split()
    rooms = {n: importlib.import_module(f"torchradiometry.{n.split('.')[0]}") for n in names}
    return {name: getattr(room, name.split(".")[1]) for name, room in rooms.items()}


def test_every_public_name_that_takes_numbers_is_brought_to_its_edge() -> None:
    covered = [case.member for case in MEMBERS.values()] + cases.EFFECTS + cases.RAY_CASTERS
    missing = [
        name
        for name, member in public().items()
        if takes_numbers(member) and member not in covered and name not in ELSEWHERE
    ]
    assert not missing, "add a line to tests/hard_cases/functions.py (or say in elsewhere.py who)"
    assert set(ELSEWHERE) <= set(public())


@pytest.mark.parametrize("name", ELSEWHERE)
def test_who_is_said_to_test_it_does(name: str) -> None:
    where = ELSEWHERE[name]
    assert where in MEMBERS or re.search(rf"\b{name.split('.')[1]}\b", (ROOT / where).read_text())


@pytest.mark.parametrize("factor", [1.0, 0.0, 2.0**-40])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float16])
def test_a_norm_in_fewer_digits_is_no_smaller(dtype: torch.dtype, factor: float) -> None:
    exchange = torch.ones(6, 6, dtype=dtype)
    area = exchange.sum(-1)
    room = solve.DenseOperator(exchange / 6, area)
    albedo = (factor * torch.linspace(0.25, 0.5, 6)).to(dtype).reshape(1, 6, 1)
    above = torch.full((1, 6, 1), 4.0, dtype=dtype)
    found = solve.inverse_norm(room, albedo, above)
    wide = solve.DenseOperator(room.form_factors.double(), area.double())
    exact = solve.inverse_norm(wide, albedo.double(), above.double())
    assert bool(torch.isfinite(found).all())
    assert bool((found.double() >= exact - 1e-12).all())


def test_axes_of_meshes_and_indices_are_named() -> None:
    corners = torch.zeros(3, 3)
    for faces in ([[0, 1, 3]], [[-1, 0, 1]]):
        with pytest.raises(errors.IndexRangeError, match="face 0"):
            geometry.face_areas(corners, torch.tensor(faces))


UP = np.tile(np.float32([0, 0, 1]), (4, 4, 1))
INSIDE = np.ones((4, 4), bool)
GREY = np.full((16, 3), 0.5)
LIGHTS = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [0, 0.6, 0.8], [-0.6, 0, 0.8]])
COUNTS = np.full((4, 4, 3), 100, np.uint8)

ARRAYS: dict[str, Callable[[], NDArray]] = {
    "normals of length 0, shone on": lambda: deploy.shine(0 * UP, np.ones((9, 3))),
    "a black image": lambda: deploy.fit_light(0 * GREY, UP.reshape(-1, 3), GREY),
    "black paint": lambda: deploy.fit_light(GREY, UP.reshape(-1, 3), 0 * GREY),
    "normals of length 0, integrated": lambda: deploy.integrate_normals(0 * UP, INSIDE),
    "no light": lambda: deploy.solve_least_squares(np.zeros((5, 4)), LIGHTS),
    "normals of length 0, compared": lambda: deploy.angular_error(0 * UP, UP, INSIDE),
    "no pixels to compare": lambda: deploy.angular_error(UP, UP, ~INSIDE),
    "all black": lambda: deploy.merge_exposures([0 * COUNTS] * 2, [1, 2], deploy.srgb_response)[0],
    "a flat height": lambda: learn.surface_normals(np.zeros((3, 3)))[1, 1],
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_at_the_edge_are_finite(name: str) -> None:
    assert np.isfinite(ARRAYS[name]()).all()


REFUSED: dict[str, tuple[Callable[[], object], type[Exception]]] = {
    "lights in a plane": (
        lambda: deploy.solve_least_squares(np.ones((5, 4)), 0 * LIGHTS),
        errors.DegenerateGeometryError,
    ),
    "a light too few": (
        lambda: deploy.solve_least_squares(np.ones((5, 4)), LIGHTS[:3]),
        errors.ShapeError,
    ),
    "masks of another size": (
        lambda: deploy.integrate_normals(UP, INSIDE[:2]),
        errors.ShapeError,
    ),
    "normals of another size": (
        lambda: deploy.angular_error(UP[:2], UP, INSIDE),
        errors.ShapeError,
    ),
    "albedo of another size": (
        lambda: deploy.fit_light(GREY[:2], UP.reshape(-1, 3), GREY),
        errors.ShapeError,
    ),
    "an exposure of no time": (
        lambda: deploy.merge_exposures([COUNTS] * 2, [0, 1], deploy.linear_response),
        errors.OutOfRangeError,
    ),
    "an exposure of NaN seconds": (
        lambda: deploy.debevec_response([COUNTS] * 2, [float("nan"), 1]),
        errors.OutOfRangeError,
    ),
    "no photographs": (lambda: deploy.linear_response([], []), errors.ShapeError),
    "floating counts": (
        lambda: deploy.srgb_response([COUNTS * 1.0], [1.0]),
        errors.DTypeError,
    ),
    "a photograph of 4 x 4 pixels": (
        lambda: deploy.debevec_response([COUNTS] * 2, [1, 2]),
        errors.ShapeError,
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_arrays_that_mean_nothing_are_refused_by_name(name: str) -> None:
    call, error = REFUSED[name]
    with pytest.raises(error):
        call()


def test_a_mean_of_nothing_or_of_zero_is_no_traceback() -> None:
    assert learn.geometric_mean([1.0, 4.0]) == pytest.approx(2)
