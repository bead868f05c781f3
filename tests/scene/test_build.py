"""Shapes made in Python: sizes, fronts, a room that is closed."""

import math

import pytest
import torch
import trimesh

from tests.tolerances import assert_close
from torchradiometry.errors import OutOfRangeError, ShapeError
from torchradiometry.geometry.meshes import face_areas, face_normals
from torchradiometry.scene import Scene, box, cornell_like_room, quad, room, sphere


def outwards(surface) -> torch.Tensor:
    """Cosine between each face's normal and its direction from the middle."""
    middle = surface.vertices.mean(0)
    centre = surface.vertices[surface.faces].mean(1) - middle
    return (face_normals(surface.vertices, surface.faces) * centre).sum(-1)


def test_box() -> None:
    crate = box("crate", (1, 2, 3), (4, 5, 6), dtype=torch.float64)
    assert_close(crate.vertices.amin(0), [3.5, 4, 4.5])
    assert_close(crate.vertices.amax(0), [4.5, 6, 7.5])
    assert_close(face_areas(crate.vertices, crate.faces).sum(), 2 * (2 + 3 + 6))
    assert (outwards(crate) > 0).all()
    inside = box("room", (1, 2, 3), inward=True)
    assert (outwards(inside) < 0).all()


@pytest.mark.parametrize(
    ("side", "normal"),
    [("left", [-1, 0, 0]), ("right", [1, 0, 0]), ("bottom", [0, -1, 0]), ("top", [0, 1, 0]),
     ("back", [0, 0, -1]), ("front", [0, 0, 1])],
)  # fmt: skip
def test_sides(side: str, normal: list[float]) -> None:
    face = box("side", (1, 2, 3), sides=(side,), dtype=torch.float64)
    assert face.count == 2
    found = face_normals(face.vertices, face.faces)
    assert_close(found, torch.tensor(normal).double().expand(2, 3))


def test_turned_box() -> None:
    """A quarter turn about y takes +x to -z."""
    side = box("side", (1, 1, 1), turn=math.pi / 2, sides=("right",), dtype=torch.float64)
    found = face_normals(side.vertices, side.faces)
    assert_close(found, torch.tensor([[0.0, 0, -1]] * 2).double(), atol=1e-15)


def test_sphere() -> None:
    ball = sphere("ball", 2.0, (1, 2, 3), subdivisions=4, dtype=torch.float64)
    offset = ball.vertices - torch.tensor([1.0, 2, 3], dtype=torch.float64)
    assert_close(offset, 2 * ball.normals, atol=1e-14)
    assert_close(face_areas(ball.vertices, ball.faces).sum(), 16 * math.pi, rtol=0.005)
    assert (outwards(ball) > 0).all()
    assert sphere("ball", 1.0, smooth=False).normals is None


def test_room_is_closed_and_faces_in() -> None:
    walls = room((4, 3, 5), panel=(1, 2), dtype=torch.float64)
    triangles = Scene(walls).triangles
    assert_close(triangles.patches.area.sum(), 2 * (12 + 15 + 20))
    mesh = trimesh.Trimesh(triangles.corners.reshape(-1, 3).numpy(), [[0, 1, 2]], process=False)
    mesh.faces = torch.arange(len(triangles.corners) * 3).reshape(-1, 3).numpy()
    mesh.merge_vertices()
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(-60)
    panel = next(s for s in walls if s.name == "panel")
    assert_close(face_areas(panel.vertices, panel.faces).sum(), 2.0)
    assert_close(face_normals(panel.vertices, panel.faces)[0], [0.0, -1, 0])


def test_cornell_like_room() -> None:
    scene = cornell_like_room(width=20, height=10, lamp=True, dtype=torch.float64)
    camera = scene.cameras[0]
    assert (camera.width, camera.height) == (20, 10)
    assert len(scene.sources) == 1
    low, high = scene.bounds
    assert ((camera.position > low) & (camera.position < high)).all()
    boxes = [s for s in scene.surfaces if "box" in s.name]
    for member in boxes:
        assert member.count == 10
        assert member.vertices[:, 1].min() == 0
        assert (member.vertices.amin(0) >= low).all()
        assert (member.vertices.amax(0) <= high).all()


def test_quads_in_one_surface() -> None:
    corners = torch.rand(3, 4, 3)
    assert quad("three", corners).faces.tolist()[2:4] == [[4, 5, 6], [4, 6, 7]]


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: quad("q", torch.zeros(3, 3)), ShapeError),
        (lambda: box("b", (1, 0, 1)), OutOfRangeError),
        (lambda: box("b", (1, 1, 1), sides=("roof",)), OutOfRangeError),
        (lambda: box("b", (1, 1, 1), sides=()), OutOfRangeError),
        (lambda: sphere("s", -1.0), OutOfRangeError),
        (lambda: sphere("s", 1.0, subdivisions=9), OutOfRangeError),
        (lambda: room((2, 2, 2), panel=(2, 1)), OutOfRangeError),
    ],
)
def test_refuses(make, error) -> None:
    with pytest.raises(error):
        make()
