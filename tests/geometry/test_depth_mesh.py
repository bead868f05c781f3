"""Meshes of depth maps: planes exactly, every square, every mask, towards the camera."""

import math
from itertools import product

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import ShapeError
from torchradiometry.geometry.depth import depth_to_normals, depth_to_points
from torchradiometry.geometry.depth_mesh import depth_to_mesh
from torchradiometry.geometry.meshes import face_areas, face_corners, face_normals, vertex_normals

MATRIX = torch.tensor([[9.0, 0, 4.5], [0, 9, 3.5], [0, 0, 1]], dtype=torch.float64)
CAMERAS = pytest.mark.parametrize(
    "camera", [{"intrinsics": MATRIX}, {"pixel_size": 0.25}], ids=["pinhole", "orthographic"]
)


def rough(generator: torch.Generator, rows: int = 7, columns: int = 9) -> Tensor:
    return 1 + torch.rand(1, 1, rows, columns, dtype=torch.float64, generator=generator)


def test_a_plane_has_its_area_and_its_normal() -> None:
    slope = torch.arange(9, dtype=torch.float64).expand(1, 1, 7, 9) * 0.25 + 1
    vertices, faces = depth_to_mesh(slope, pixel_size=0.25)
    assert faces.shape == (2 * 6 * 8, 3)
    assert_close(face_areas(vertices, faces).sum(), 6 * 8 * 0.25**2 * math.sqrt(2))
    normal = torch.tensor([1.0, 0, 1], dtype=torch.float64) / math.sqrt(2)
    assert_close(face_normals(vertices, faces), normal.expand(len(faces), 3))


@CAMERAS
def test_vertices_are_the_points_of_the_pixels(camera, generator: torch.Generator) -> None:
    depth = rough(generator)
    vertices, faces = depth_to_mesh(depth, **camera)
    assert_close(vertices.T.reshape(1, 3, 7, 9), depth_to_points(depth, **camera))
    assert torch.equal(faces.unique(), torch.arange(63))


@CAMERAS
def test_every_face_turns_to_the_camera(camera, generator: torch.Generator) -> None:
    vertices, faces = depth_to_mesh(rough(generator), **camera)
    eye = torch.zeros(3, dtype=torch.float64)
    middle = face_corners(vertices, faces).mean(1)
    backward = eye - middle if "intrinsics" in camera else torch.tensor([0.0, 0, 1]).double()
    assert ((face_normals(vertices, faces) * backward).sum(-1) > 0).all()


@CAMERAS
def test_each_inner_edge_joins_two_faces_that_pass_it_in_opposite_ways(camera, generator) -> None:
    """A closed sheet: no gap and no overlap, and consistently turned."""
    _, faces = depth_to_mesh(rough(generator), **camera)
    edges = torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len(edges.unique(dim=0)) == len(edges)
    joined, count = edges.sort(-1).values.unique(dim=0, return_counts=True)
    assert len(joined) == 7 * 8 + 6 * 9 + 6 * 8  # rows, columns, diagonals
    assert (count == 1).sum() == 2 * (6 + 8)  # the border


@pytest.mark.parametrize("mask", list(product([False, True], repeat=4)))
def test_a_masked_square_keeps_the_triangle_that_is_left(mask: tuple[bool, ...]) -> None:
    depth = torch.ones(1, 1, 2, 2, dtype=torch.float64)
    hidden = torch.tensor(mask).reshape(1, 1, 2, 2)
    depth[hidden] = math.nan
    vertices, faces = depth_to_mesh(depth, pixel_size=1.0)
    missing = sum(mask)
    assert len(faces) == {0: 2, 1: 1}.get(missing, 0)
    assert torch.isfinite(vertices[faces]).all()
    assert torch.equal(torch.isnan(vertices).all(-1), hidden.flatten())
    assert_close(face_areas(vertices, faces), torch.full((len(faces),), 0.5).double())
    assert (face_normals(vertices, faces)[:, 2] == 1).all()


def test_a_hole_is_left_out_and_the_rest_stays(generator: torch.Generator) -> None:
    whole = rough(generator)
    holed = whole.clone()
    holed[0, 0, 3, 4], holed[0, 0, 0, 0] = math.inf, math.nan
    _, all_faces = depth_to_mesh(whole, pixel_size=0.25)
    _, faces = depth_to_mesh(holed, pixel_size=0.25)
    # each of the 4 squares around a hole keeps one of its 2 triangles, so does the corner's
    assert len(faces) == len(all_faces) - 4 - 1
    assert not torch.isin(faces, torch.tensor([0, 3 * 9 + 4])).any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (4, 1)])
def test_a_map_without_squares_has_no_face(shape: tuple[int, int]) -> None:
    vertices, faces = depth_to_mesh(torch.ones(1, 1, *shape), pixel_size=1.0)
    assert vertices.shape == (shape[0] * shape[1], 3)
    assert faces.shape == (0, 3)


def test_normals_of_a_smooth_map_agree_with_those_of_the_depth_map() -> None:
    axis = torch.linspace(-0.5, 0.5, 65, dtype=torch.float64)
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    depth = (2 - (1 - x * x - y * y).sqrt())[None, None]
    vertices, faces = depth_to_mesh(depth, pixel_size=1 / 64)
    found = vertex_normals(vertices, faces).T.reshape(3, 65, 65)[:, 1:-1, 1:-1]
    expected = depth_to_normals(depth, pixel_size=1 / 64)[0, :, 1:-1, 1:-1]
    assert (found * expected).sum(0).min() > math.cos((1 / 64) ** 2)


@CAMERAS
def test_gradients(camera, generator: torch.Generator) -> None:
    depth = rough(generator, 3, 3).requires_grad_()
    assert gradcheck(lambda d: depth_to_mesh(d, **camera)[0], depth)


@pytest.mark.parametrize("shape", [(4, 4), (2, 1, 4, 4), (1, 2, 4, 4)])
def test_more_than_one_map_is_named(shape: tuple[int, ...]) -> None:
    with pytest.raises(ShapeError, match="depth"):
        depth_to_mesh(torch.ones(shape), pixel_size=1.0)
