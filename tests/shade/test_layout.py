"""The image boundary, and the check of values that no layer makes."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchradiometry.errors import InvalidValueError, OutOfRangeError
from torchradiometry.shade import to_image, to_points, validate_layer_inputs

sizes = st.integers(1, 5)


@settings(deadline=None, max_examples=30)
@given(sizes, sizes, sizes, sizes)
def test_there_and_back(b: int, c: int, h: int, w: int) -> None:
    image = torch.arange(b * c * h * w, dtype=torch.float64).reshape(b, c, h, w)
    points = to_points(image)
    assert torch.equal(to_image(points, image), image)
    assert torch.equal(points[:, (h - 1) * w], image[:, :, h - 1, 0])


def test_neither_way_copies() -> None:
    image = torch.rand(2, 3, 4, 5)
    points = to_points(image)
    assert points.data_ptr() == image.data_ptr()
    assert to_image(points, image).data_ptr() == image.data_ptr()


UP = torch.tensor([0.0, 0.0, 1.0]).reshape(1, 3, 1, 1).repeat(1, 1, 2, 2)
GREY = torch.full((1, 3, 2, 2), 0.5)


def test_good_inputs_pass() -> None:
    background = UP.clone()
    background[:, :, 0, 0] = 0
    rounded = torch.round((UP + 1) / 2 * 255) / 255 * 2 - 1  # an 8-bit normal map
    for normal in (UP, background, rounded):
        assert (
            validate_layer_inputs(
                normal, GREY, visibility=GREY, position=5 * UP, specular=GREY, shininess=90 * GREY
            )
            is None
        )


@pytest.mark.parametrize(
    ("arguments", "where", "message"),
    [
        ({"normal": 2 * UP}, "normal", "a length of 2"),
        ({"normal": UP.clone().fill_(torch.nan)}, "normal", "12 NaN or infinite"),
        ({"albedo": GREY * 400}, "albedo", "0..255"),
        ({"albedo": GREY * 2.4}, "albedo", "a maximum of 1.2"),
        ({"albedo": -GREY}, "albedo", "a minimum of -0.5"),
        ({"visibility": 3 * GREY}, "visibility", "a maximum of 1.5"),
        ({"specular": GREY / 0}, "specular", "infinite"),
        ({"position": GREY / 0}, "position", "infinite"),
        ({"shininess": -GREY}, "shininess", "-0.5"),
    ],
)
def test_bad_values_are_named(arguments: dict, where: str, message: str) -> None:
    with pytest.raises((InvalidValueError, OutOfRangeError), match=message) as caught:
        validate_layer_inputs(**arguments)
    assert caught.value.where == where


def test_empty_images_pass() -> None:
    assert validate_layer_inputs(torch.zeros(0, 3, 2, 2), torch.zeros(0, 3, 2, 2)) is None
