"""Every fault is named, with the mesh and the face."""

import math
from dataclasses import replace

import pytest
import torch

from torchradiometry.errors import (
    DegenerateGeometryError,
    EmptySceneError,
    IndexRangeError,
    InvalidValueError,
    OutOfRangeError,
)
from torchradiometry.geometry.cameras import PinholeCamera
from torchradiometry.scene import Scene, Surface, Texture, cornell_like_room, quad, sphere
from torchradiometry.sources import DirectionalSource, PointSource

CAMERA = PinholeCamera(width=4, height=4, yfov=1.0, camera_to_world=torch.eye(4))
SUN = DirectionalSource([0.0, 0, 1], [1.0])
BALL = sphere("ball", 1.0, subdivisions=0)


def scene_of(*surfaces: Surface, sources=(SUN,), cameras=(CAMERA,)) -> Scene:
    return Scene(surfaces, sources, cameras)


def changed(field: str, row: int, value: object) -> Surface:
    """The ball with one row of one of its tensors replaced."""
    tensor = getattr(BALL, field).clone()
    tensor[row] = torch.as_tensor(value, dtype=tensor.dtype)
    return replace(BALL, **{field: tensor})


def test_good_scenes() -> None:
    for scene in (cornell_like_room(), cornell_like_room(lamp=True), scene_of(BALL)):
        assert scene.validate() == ()
        scene.require_valid()


PAINT = Texture(torch.full((1, 1, 3), 1.5), torch.zeros(12, 2))
FAULTS = {
    "nan vertex": (changed("vertices", 3, math.nan), "vertex 3", InvalidValueError),
    "infinite vertex": (changed("vertices", 3, math.inf), "vertex 3", InvalidValueError),
    "index": (changed("faces", 4, [0, 1, 12]), "face 4", IndexRangeError),
    "negative index": (changed("faces", 5, [0, -1, 2]), "face 5", IndexRangeError),
    "zero area": (changed("faces", 6, [0, 1, 1]), "face 6", DegenerateGeometryError),
    "albedo": (replace(BALL, albedo=torch.tensor([0.5, 1.2, 0])), "albedo", OutOfRangeError),
    "nan albedo": (replace(BALL, albedo=torch.full((3,), math.nan)), "albedo", InvalidValueError),
    "emission": (replace(BALL, emission=torch.tensor([-1.0, 1, 1])), "emission", OutOfRangeError),
    "normal length": (changed("normals", 2, [0, 0, 3]), "normal 2", DegenerateGeometryError),
    "nan normal": (changed("normals", 2, math.nan), "normal 2", InvalidValueError),
    "flipped": (replace(BALL, normals=-BALL.normals), "face 0", DegenerateGeometryError),
    "texture": (replace(BALL, texture=PAINT), "texture", OutOfRangeError),
    "coordinates": (
        replace(BALL, texture=Texture(torch.ones(1, 1, 3), torch.full((12, 2), math.nan))),
        "vertex 0",
        InvalidValueError,
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults(name: str) -> None:
    surface, where, error = FAULTS[name]
    faults = scene_of(
        quad("wall", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), surface
    ).validate()
    assert faults[0].where == f"surface 'ball', {where}"
    assert faults[0].error is error
    with pytest.raises(error, match="ball"):
        scene_of(surface).require_valid()


def test_all_are_counted() -> None:
    fault = scene_of(replace(BALL, normals=-BALL.normals)).validate()
    assert len(fault) == 1
    assert "(20 of them)" in fault[0].what
    assert str(fault[0]).startswith("surface 'ball', face 0: ")


def test_several_faults_are_all_named() -> None:
    bad = replace(changed("vertices", 3, math.nan), albedo=torch.full((3,), 2.0))
    faults = Scene((bad,)).validate()
    assert [f.error for f in faults] == [
        InvalidValueError,
        OutOfRangeError,
        EmptySceneError,
        EmptySceneError,
    ]
    with pytest.raises(InvalidValueError, match="and 3 more faults"):
        Scene((bad,)).require_valid()


def test_thin_faces_count_as_without_area() -> None:
    """A needle whose height is lost in the rounding of its length."""
    corners = torch.tensor([[0.0, 0, 0], [1e4, 0, 0], [5e3, 1e-5, 0]])
    needle = Surface("needle", corners, torch.tensor([[0, 1, 2]]), torch.ones(3))
    assert "no area" in scene_of(needle).validate()[0].what


def test_small_scenes_are_fine() -> None:
    tiny = replace(BALL, vertices=BALL.vertices * 1e-6)
    assert scene_of(tiny).validate() == ()


def test_nothing() -> None:
    faults = Scene().validate()
    assert [f.what for f in faults] == ["no faces", "no light", "no camera"]
    assert {f.error for f in faults} == {EmptySceneError}
    assert scene_of(replace(BALL, emission=torch.ones(3)), sources=()).validate() == ()


def test_sources() -> None:
    bad = (PointSource([0.0, 1, 0], [1.0]), DirectionalSource([0.0, 0, 1], [1.0]))
    bad[0].position.fill_(math.nan)
    bad[1].irradiance.fill_(-1)
    faults = scene_of(BALL, sources=bad).validate()
    assert [f.where for f in faults] == [
        "source 0 (PointSource), position",
        "source 1 (DirectionalSource), irradiance",
    ]
    assert [f.error for f in faults] == [InvalidValueError, OutOfRangeError]
