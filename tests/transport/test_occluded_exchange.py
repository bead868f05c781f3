"""Exchange of partly hidden pairs: closed forms, both directions, fine references, gradients."""

import math

import pytest
import torch
import trimesh
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry import errors
from torchradiometry.geometry.patches import Patches, subdivide
from torchradiometry.reference.closed_forms import parallel_rectangles, perpendicular_rectangles
from torchradiometry.transport.blockers import convex_blockers
from torchradiometry.transport.occluded_exchange import occluded_exchange
from torchradiometry.transport.rules import patch_points
from torchradiometry.transport.visible_parts import visible_irradiance

#: what the issue asks for
ASKED = 1e-8
FLOOR = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=torch.float64)
CEILING = FLOOR.flip(1) + torch.tensor([0, 0, 1.0], dtype=torch.float64)
NOTHING = FLOOR[:0]
#: planar, in nobody's symmetry
SCREEN = torch.tensor(
    [[[0.3, 0.25, 0.5], [0.8, 0.35, 0.45], [0.7, 0.8, 0.6], [0.37, 0.69, 0.625]]]
).double()
SCREEN[0, 3] = (
    SCREEN[0, 0] + 0.8 * (SCREEN[0, 2] - SCREEN[0, 0]) - 0.4 * (SCREEN[0, 1] - SCREEN[0, 0])
)
WALL = torch.tensor([[[1.0, 0, 0], [1, 0, 1], [1, 1, 1], [1, 1, 0]]], dtype=torch.float64)


def crate() -> Tensor:
    """A turned box that stands on the floor, without its bottom."""
    triangles = torch.tensor(trimesh.creation.box((0.3, 0.4, 0.5)).triangles.copy())
    turn = torch.tensor([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1.0]], dtype=torch.float64)
    sides = convex_blockers(triangles @ turn + torch.tensor([0.45, 0.5, 0.25]))
    return sides[sides.mean(1)[:, 2] > 0.01]


def assert_both_ways(first: Tensor, second: Tensor, blockers: Tensor) -> float:
    """K and its mirror image come from different cells, rules and kinks."""
    here, there = (occluded_exchange(*p, blockers) for p in ((first, second), (second, first)))
    assert (here.error <= ASKED * here.exchange).all()
    assert_close(here.exchange, there.exchange, rtol=ASKED)
    return float(here.exchange)


def test_without_blockers_the_closed_forms() -> None:
    assert_close(
        occluded_exchange(FLOOR, CEILING, NOTHING).exchange,
        [parallel_rectangles(1.0, 1.0, 1.0)],
        rtol=ASKED / 10,
    )
    found = occluded_exchange(FLOOR, WALL.flip(1), NOTHING)
    assert float(found.exchange) == 0  # its back
    found = occluded_exchange(FLOOR, WALL, NOTHING)
    assert_close(found.exchange, [perpendicular_rectangles(1.0, 1.0, 1.0)], rtol=ASKED)


def test_a_wall_between_two_halves() -> None:
    wall = torch.tensor([[[0.5, -9, 0], [0.5, 9, 0], [0.5, 9, 1], [0.5, -9, 1]]]).double()
    half = parallel_rectangles(0.5, 1.0, 1.0) / 2
    assert_close(occluded_exchange(FLOOR, CEILING, wall).exchange, [2 * half], rtol=ASKED)


def test_a_blocker_that_hides_half_by_symmetry() -> None:
    half = torch.tensor([[[0.5, -9, 0.5], [9, -9, 0.5], [9, 9, 0.5], [0.5, 9, 0.5]]]).double()
    whole = parallel_rectangles(1.0, 1.0, 1.0)
    assert_close(occluded_exchange(FLOOR, CEILING, half).exchange, [whole / 2], rtol=ASKED)
    corners = torch.tensor([[-9.0, 10], [10, -9], [19, 0], [0, 19]]).double()
    diagonal = torch.cat((corners, torch.full((4, 1), 0.5)), 1).unsqueeze(0)
    assert_close(occluded_exchange(FLOOR, CEILING, diagonal).exchange, [whole / 2], rtol=ASKED)


def test_a_screen_both_ways() -> None:
    whole = parallel_rectangles(1.0, 1.0, 1.0)
    assert 0.5 * whole < assert_both_ways(FLOOR, CEILING, SCREEN) < 0.8 * whole


def test_a_fine_rule_without_cells_agrees() -> None:
    found = occluded_exchange(FLOOR, CEILING, SCREEN).exchange
    parts, _ = subdivide(Patches(FLOOR), 1 / 40)
    rule = patch_points(parts.corners, 5)
    up = torch.tensor([0.0, 0, 1]).double()
    points = rule.position.reshape(-1, 3)
    seen = visible_irradiance(points, up.expand_as(points), CEILING[0], SCREEN)
    mean = (seen.reshape(len(parts.corners), -1) * rule.weight * parts.area.unsqueeze(1)).sum()
    # cells of 1/40 with kinks inside: their share of the area times the square of their size
    assert_close(mean / math.pi, found.squeeze(), rtol=1e-5)


def test_the_hidden_share_adds_up() -> None:
    """What a screen hides is what is seen of the ceiling through a hole of its shape."""
    size, height = 9.0, SCREEN.new_tensor(0.5)
    low, high = 0.25, 0.7
    hole = [[low, low], [high, low], [high, high], [low, high]]
    outer = [[-size, -size], [size, -size], [size, size], [-size, size]]

    def flat(corners: list) -> Tensor:
        points = torch.tensor(corners, dtype=torch.float64)
        return torch.cat((points, height.expand(len(points), 1)), 1)

    around = [[outer[k], outer[(k + 1) % 4], hole[(k + 1) % 4], hole[k]] for k in range(4)]
    frame = torch.stack([flat(c) for c in around])
    screen = flat(hole).unsqueeze(0)
    parts = [occluded_exchange(FLOOR, CEILING, b).exchange for b in (screen, frame)]
    assert_close(parts[0] + parts[1], [parallel_rectangles(1.0, 1.0, 1.0)], rtol=ASKED)


def test_a_box_on_the_floor_both_ways() -> None:
    other = WALL.flip(1) - torch.tensor([1.0, 0, 0])
    seen = assert_both_ways(WALL[:, :3], other, crate())
    assert 0.3 < seen / parallel_rectangles(1.0, 1.0, 1.0) * 2 < 0.9


def test_hidden_behind_and_many_pairs_at_once() -> None:
    cover = FLOOR * 3 + torch.tensor([-1.0, -1, 0.5])
    first = torch.cat((FLOOR, FLOOR, FLOOR, FLOOR + torch.tensor([3.0, 0, 0])))
    second = torch.cat((CEILING, CEILING.flip(1), FLOOR, CEILING + torch.tensor([3.0, 0, 0])))
    found = occluded_exchange(first, second, cover[:, [0, 3, 2, 1]])
    assert (found.exchange[:3] == 0).all()
    assert_close(found.exchange[3], parallel_rectangles(1.0, 1.0, 1.0), rtol=ASKED)
    assert occluded_exchange(first[:0], second[:0], cover).exchange.shape == (0,)


@pytest.mark.parametrize(("scale", "place"), [(1e-3, 0.0), (1e6, 0.0), (1.0, 1e3)])
def test_scale_and_place(scale: float, place: float) -> None:
    corners = (FLOOR[:, :3], CEILING[:, :3], SCREEN[:, :3])
    found = occluded_exchange(*(t * scale + place for t in corners)).exchange / scale**2
    assert_close(found, occluded_exchange(*corners).exchange, rtol=ASKED)


def test_gradients_with_respect_to_patches_and_blockers() -> None:
    # a triangle keeps its plane whichever corner moves
    read = [t[:, :3].clone().requires_grad_() for t in (FLOOR, CEILING, SCREEN)]

    def exchange(*corners: Tensor) -> Tensor:
        return occluded_exchange(*corners, rtol=1e-6).exchange

    assert bool(exchange(*read) < exchange(*read[:2], NOTHING))
    assert gradcheck(exchange, read, atol=1e-6, fast_mode=True)


def test_shapes_are_named() -> None:
    with pytest.raises(errors.ShapeError, match="second"):
        occluded_exchange(FLOOR, CEILING[0], SCREEN)
