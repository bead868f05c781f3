"""Triangles merged into convex quads: the same points, fewer pieces."""

import torch
import trimesh

from tests.tolerances import assert_close
from torchradiometry.geometry.patches import Patches
from torchradiometry.scene.build import cornell_like_room
from torchradiometry.transport.blockers import convex_blockers, possible_blockers

SQUARE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)


def cut(quad: torch.Tensor, start: int = 0) -> torch.Tensor:
    quad = quad.roll(start, 0)
    return torch.stack((quad[[0, 1, 2]], quad[[0, 2, 3]]))


def test_a_box_becomes_six_quads() -> None:
    triangles = torch.tensor(trimesh.creation.box((1, 2, 3)).triangles.copy())
    merged = convex_blockers(triangles)
    assert merged.shape == (6, 4, 3)
    assert_close(Patches(merged).area.sum(), 22.0)


def test_a_room_stored_in_float32_is_merged_too() -> None:
    triangles = cornell_like_room(dtype=torch.float32).triangles.corners
    merged = convex_blockers(triangles)
    assert len(merged) == len(triangles) / 2
    assert_close(Patches(merged).area.sum(), Patches(triangles).area.sum(), rtol=1e-6)


def test_corners_off_the_plane_and_concave_unions_stay_triangles() -> None:
    bent = SQUARE + SQUARE.new_tensor([[0.0, 0, 0], [0, 0, 0.1], [0, 0, 0], [0, 0, 0]])
    dart = SQUARE + SQUARE.new_tensor([[0.0, 0, 0], [-0.7, 0.7, 0], [0, 0, 0], [0, 0, 0]])
    for quad in (bent, dart):
        merged = convex_blockers(cut(quad))
        assert len(merged) == 2
        assert (merged[:, 2] == merged[:, 3]).all()


def test_one_partner_each_and_nothing_is_lost(generator: torch.Generator) -> None:
    points = torch.rand(6, 7, generator=generator, dtype=torch.float64)
    x, y = torch.meshgrid(torch.arange(6).double(), torch.arange(7).double(), indexing="ij")
    grid = torch.stack((x + 0.3 * points, y + 0.3 * points.flip(0), torch.zeros_like(x)), -1)
    cells = (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
    quads = torch.stack(cells, 2).reshape(-1, 4, 3)
    triangles = torch.cat([cut(q, k % 2) for k, q in enumerate(quads)])
    merged = convex_blockers(triangles[torch.randperm(len(triangles), generator=generator)])
    assert_close(Patches(merged).area.sum(), Patches(triangles).area.sum())
    assert len(merged) < 0.7 * len(triangles)


def test_triangles_without_area_are_left_out() -> None:
    assert len(convex_blockers(torch.zeros(3, 3, 3))) == 0
    assert len(convex_blockers(torch.zeros(0, 3, 3))) == 0
    assert len(convex_blockers(torch.cat((cut(SQUARE), SQUARE[None, [0, 0, 1]])))) == 1


def test_walls_of_a_convex_room_block_nothing() -> None:
    triangles = cornell_like_room(dtype=torch.float64).triangles.corners
    quads = convex_blockers(triangles)
    possible = possible_blockers(quads, triangles.reshape(-1, 3), 1e-5)
    assert possible.sum() == 10  # five sides of each of the two boxes
