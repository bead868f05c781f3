"""Meshes: normals and areas against closed forms."""

import math

import pytest
import torch
import trimesh
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import IndexRangeError, ShapeError
from torchradiometry.geometry import meshes

CUBE = trimesh.creation.box()
VERTICES = torch.tensor(CUBE.vertices, dtype=torch.float64)
FACES = torch.tensor(CUBE.faces, dtype=torch.int64)


def test_cube() -> None:
    assert_close(meshes.face_areas(VERTICES, FACES), torch.full((12,), 0.5).double())
    assert_close(meshes.face_normals(VERTICES, FACES), torch.tensor(CUBE.face_normals))
    # angle weights make the corner normals the diagonals, however the squares are cut
    diagonal = VERTICES / VERTICES.norm(dim=-1, keepdim=True)
    assert_close(meshes.vertex_normals(VERTICES, FACES), diagonal)


def test_vertex_normals_of_a_ball_are_radial() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    vertices = torch.tensor(ball.vertices, dtype=torch.float64)
    found = meshes.vertex_normals(vertices, torch.tensor(ball.faces))
    assert (found * vertices).sum(-1).min() > math.cos(0.02)


def test_faces_without_area() -> None:
    vertices = VERTICES.clone().requires_grad_()
    faces = torch.tensor([[0, 0, 1], [2, 2, 2]])
    for function in (meshes.face_normals, meshes.face_areas, meshes.vertex_normals):
        out = function(vertices, faces)
        assert (out == 0).all()
        (gradient,) = torch.autograd.grad(out.sum(), vertices)
        assert (gradient == 0).all()


def test_gradients() -> None:
    vertices = VERTICES.clone().requires_grad_()
    for function in (meshes.face_normals, meshes.face_areas, meshes.vertex_normals):
        assert gradcheck(lambda v, f=function: f(v, FACES), (vertices,))


def test_corner_angles() -> None:
    corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=torch.float64)
    assert_close(meshes.corner_angles(corners), [math.pi / 2, math.pi / 4, math.pi / 4])


def test_no_faces() -> None:
    none = torch.zeros(0, 3, dtype=torch.int64)
    assert meshes.face_normals(VERTICES, none).shape == (0, 3)
    assert (meshes.vertex_normals(VERTICES, none) == 0).all()


@pytest.mark.parametrize("index", [8, -1])
def test_index_out_of_range_names_the_face(index: int) -> None:
    with pytest.raises(IndexRangeError, match="face 1"):
        meshes.face_normals(VERTICES, torch.tensor([[0, 1, 2], [0, 1, index]]))


def test_shapes() -> None:
    with pytest.raises(ShapeError):
        meshes.face_normals(VERTICES[:, :2], FACES)
    with pytest.raises(ShapeError):
        meshes.face_normals(VERTICES, FACES[:, :2])
