"""Sources tell a user at once what does not fit together."""

from __future__ import annotations

import pytest
import torch

from torchradiometry import errors
from torchradiometry.shade import LambertianShading, validate_layer_inputs
from torchradiometry.sources import (
    AmbientDome,
    DirectionalSource,
    PointSource,
    PolygonSource,
    SphereSource,
    SpotSource,
)

UP = torch.tensor([0.0, 0.0, 1.0]).reshape(1, 3, 1, 1)


def test_numbers_of_lights_must_agree() -> None:
    with pytest.raises(errors.ShapeError, match=r"irradiance: got 3 lights.*hold 2"):
        DirectionalSource(torch.rand(2, 3), torch.rand(3, 1))
    with pytest.raises(errors.ShapeError, match="intensity"):
        PointSource(torch.rand(4, 2, 3), torch.rand(4, 5, 1))


def test_one_value_serves_all_lights() -> None:
    suns = DirectionalSource(torch.eye(3), [2.0], learnable=True)
    assert suns.irradiance.shape == (3, 1)
    assert suns.lights == 3
    image = LambertianShading(suns)(UP.expand(1, 3, 2, 2), torch.ones(1, 1, 2, 2))
    torch.testing.assert_close(image, torch.full((1, 1, 2, 2), 2 / torch.pi))


@pytest.mark.parametrize(
    "build",
    [
        lambda: DirectionalSource([0.0, 0, 1], [-1.0]),
        lambda: PointSource([0.0, 0, 1], [-1.0]),
        lambda: SpotSource([0.0, 0, 1], [0.0, 0, -1], [-1.0], 0.1, 0.2),
        lambda: SphereSource([0.0, 0, 1], [-0.1], [1.0]),
        lambda: SphereSource([0.0, 0, 1], [0.1], [-1.0]),
        lambda: PolygonSource([[1.0, 0, 1], [0, 0, 1], [0, 1, 1]], [-1.0]),
        lambda: AmbientDome([-1.0]),
    ],
)
def test_negative_light_is_out_of_range(build) -> None:
    with pytest.raises(errors.OutOfRangeError, match="pass values >= 0"):
        build()


@pytest.mark.parametrize("near", [False, True])
def test_a_source_for_each_image_needs_as_many_images(near: bool) -> None:
    kind = PointSource if near else DirectionalSource
    source = kind(torch.rand(3, 1, 3), torch.rand(3, 1, 1))
    image = UP.expand(2, 3, 4, 4)
    with pytest.raises(errors.ShapeError, match=r"batch \(3,\)"):
        LambertianShading()(image, torch.ones(2, 1, 4, 4), source, position=image)


def test_another_dtype_is_named_with_its_remedy() -> None:
    source = DirectionalSource([0.0, 0, 1], [1.0])
    with pytest.raises(errors.DTypeError, match=r"float32 .*float64 .*source\.to\(normal\)"):
        LambertianShading()(UP.double(), torch.ones(1, 1, 1, 1).double(), source)


def test_normals_that_look_away_are_named() -> None:
    with pytest.raises(errors.OutOfRangeError, match="flip them"):
        validate_layer_inputs(-UP)
