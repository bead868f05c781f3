"""Exact visible parts: closed forms, dense rays, additivity, gradients, odd configurations."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry import errors
from torchradiometry.geometry.patches import Patches
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.transport.blockers import convex_blockers
from torchradiometry.transport.brute_force import BruteForceRays
from torchradiometry.transport.visible_parts import visible_irradiance, visible_polygon

#: a panel that looks down, 2 m above the origin
PANEL = torch.tensor([[1.0, -1, 2], [-1, -1, 2], [-1, 1, 2], [1, 1, 2]], dtype=torch.float64)
UP = torch.tensor([0.0, 0, 1], dtype=torch.float64)
#: dense rays: cells of the grid of 300 x 300 that a shadow's edge meets, at most 4 per row and
#: edge, each half wrong: 8 edges x 4 x 300 / 300^2 / 2, and they cancel at random
DENSE = 300
RAYS = 8 * 4 / DENSE / 2 / DENSE**0.5


def triangles(count: int, generator: torch.Generator) -> Tensor:
    """Random blockers about the space between the origin and the panel, and beyond both."""
    options = {"generator": generator, "dtype": torch.float64}
    middle = torch.rand(count, 1, 3, **options) * 2 - torch.tensor([1.0, 1.0, -0.1])
    return middle + 0.5 * torch.randn(count, 3, 3, **options)


def points(count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    options = {"generator": generator, "dtype": torch.float64}
    normal = UP + 0.4 * torch.randn(count, 3, **options)
    position = torch.rand(count, 3, **options) - torch.tensor([0.5, 0.5, 0.4])
    return position, torch.nn.functional.normalize(normal, dim=-1)


def by_rays(position: Tensor, normal: Tensor, blockers: Tensor) -> Tensor:
    """Irradiance by the panel, by a fine midpoint rule with a ray to each cell."""
    step = (torch.arange(DENSE, dtype=torch.float64) + 0.5) / DENSE * 2 - 1
    x, y = torch.meshgrid(step, step, indexing="ij")
    target = torch.stack((x, y, torch.full_like(x, 2.0)), -1).reshape(-1, 3)
    rays = BruteForceRays(blockers)
    values = []
    for start, up in zip(position, normal, strict=True):
        ray = target - start
        weight = (ray @ up).clamp(min=0) * ray[:, 2].clamp(min=0) / (ray * ray).sum(-1) ** 2
        values.append((weight * rays.visible(start, target)).sum() * 4 / DENSE**2)
    return torch.stack(values)


def test_a_half_covered_panel_gives_half_the_light() -> None:
    screen = torch.tensor([[[0.0, -9, 1], [9, -9, 1], [9, 9, 1], [0, 9, 1]]], dtype=torch.float64)
    whole = polygon_irradiance(torch.zeros(3).double(), UP, PANEL)
    for turned in (screen, screen.flip(1), screen[..., [1, 0, 2]], screen[:, [0, 1, 2, 3, 3]]):
        seen = visible_irradiance(torch.zeros(3).double(), UP, PANEL, turned)
        assert_close(seen, whole / 2)
    diagonal = screen @ torch.tensor([[1.0, 1, 0], [-1, 1, 0], [0, 0, 1]], dtype=torch.float64)
    assert_close(visible_irradiance(torch.zeros(3).double(), UP, PANEL, diagonal), whole / 2)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("size", [0.3, 0.999, 1.0, 1.5])
def test_a_similar_figure_shadows_a_similar_figure(share: float, size: float) -> None:
    x = torch.tensor([0.3, 0.2, 0.1], dtype=torch.float64)
    shadow = PANEL.mean(0) + size * (PANEL - PANEL.mean(0))
    screen = x + share * (shadow - x)
    seen = visible_irradiance(x, UP, PANEL, screen.unsqueeze(0))
    whole, hidden = (polygon_irradiance(x, UP, p) for p in (PANEL, shadow))
    assert_close(seen, (whole - hidden).clamp(min=0), atol=1e-13)


def test_against_dense_rays(generator: torch.Generator) -> None:
    position, normal = points(12, generator)
    blockers = triangles(6, generator)
    seen = visible_irradiance(position, normal, PANEL, blockers)
    whole = polygon_irradiance(position, normal, PANEL)
    assert ((seen > 0.05 * whole) & (seen < 0.95 * whole)).sum() >= 6
    assert_close(seen, by_rays(position, normal, blockers), atol=RAYS * float(whole.max()))


def test_blockers_through_the_planes_of_point_and_panel() -> None:
    x = torch.zeros(1, 3, dtype=torch.float64)
    upright = torch.tensor([[0.5, -3, -1], [0.5, 3, -1], [0.5, 3, 5], [0.5, -3, 5]]).double()
    seen = visible_irradiance(x, UP.expand(1, 3), PANEL, upright.unsqueeze(0))
    left = torch.cat((PANEL[1:3], PANEL[[3, 0]] * torch.tensor([0.5, 1, 1])))
    assert_close(seen, polygon_irradiance(x, UP.expand(1, 3), left))
    slanted = upright + torch.tensor([[-3.0, 0, 0], [-3, 0, 0], [3, 0, 0], [3, 0, 0]])
    rays = by_rays(x, UP.expand(1, 3), torch.stack((slanted[:3], slanted[[0, 2, 3]])))
    seen = visible_irradiance(x, UP.expand(1, 3), PANEL, slanted.unsqueeze(0))
    assert_close(seen, rays, atol=RAYS * float(rays.max()))


def test_visible_and_shadow_make_the_whole(generator: torch.Generator) -> None:
    position, normal = points(30, generator)
    middle = torch.rand(30, 1, 2, generator=generator, dtype=torch.float64) * 0.8 - 0.4
    corner = torch.randn(30, 3, 2, generator=generator, dtype=torch.float64) * 0.1
    shadow = torch.cat((middle + corner, torch.full((30, 3, 1), 2.0)), -1)
    turn = torch.linalg.cross(shadow[:, 1] - shadow[:, 0], shadow[:, 2] - shadow[:, 0])[:, 2]
    shadow = torch.where((turn > 0)[:, None, None], shadow.flip(1), shadow)
    for x, n, figure in zip(position, normal, shadow, strict=True):
        share = torch.rand(3, 1, generator=generator, dtype=torch.float64) * 0.8 + 0.1
        seen = visible_irradiance(x, n, PANEL, (x + share * (figure - x)).unsqueeze(0))
        hidden = polygon_irradiance(x, n, figure)
        assert hidden > 0
        assert_close(seen + hidden, polygon_irradiance(x, n, PANEL))


def test_pieces_tile_the_visible_part(generator: torch.Generator) -> None:
    position, normal = points(20, generator)
    blockers = triangles(8, generator)
    parts = visible_polygon(position, PANEL, blockers)
    area = torch.zeros(20).double().index_add(0, parts.view, Patches(parts.corners).area)
    assert (area <= 4 + 1e-12).all()
    assert parts.view.bincount(minlength=20).amax() > 1
    part = polygon_irradiance(position[parts.view], normal[parts.view], parts.corners)
    total = torch.zeros(20).double().index_add(0, parts.view, part)
    assert_close(total, visible_irradiance(position, normal, PANEL, blockers))


def test_a_wall_of_many_triangles_has_no_slits(generator: torch.Generator) -> None:
    position, normal = points(200, generator)
    step = torch.linspace(-8, 8, 9, dtype=torch.float64)
    x, y = torch.meshgrid(step, step, indexing="ij")
    height = 1.2 + 0.2 * torch.rand(9, 9, generator=generator, dtype=torch.float64)
    grid = torch.stack((x, y, height), -1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    wall = torch.cat([torch.stack(t, 2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])
    assert (visible_irradiance(position, normal, PANEL, wall) == 0).all()


def test_halves_overlaps_and_repetitions_do_not_matter(generator: torch.Generator) -> None:
    position, normal = points(200, generator)
    quad = torch.tensor([[-0.5, -0.4, 1], [0.4, -0.6, 1.1], [0.5, 0.3, 1.2]]).double()
    a, b, c = quad.unbind()
    quad = torch.cat((quad, (a + 0.9 * (c - a) - 0.6 * (b - a)).unsqueeze(0)))
    halves = torch.stack((quad[:3], quad[[0, 2, 3]]))
    assert len(convex_blockers(halves)) == 1
    once = visible_irradiance(position, normal, PANEL, quad.unsqueeze(0))
    assert (once < polygon_irradiance(position, normal, PANEL)).sum() > 20
    smaller = quad.mean(0) + 0.7 * (quad - quad.mean(0))
    for blockers in (
        torch.stack((quad, quad)),
        halves,
        torch.stack((smaller, quad)),
        torch.cat((quad[[0, 1, 2, 2]].unsqueeze(0), quad[[0, 2, 3, 3]].unsqueeze(0))),
    ):
        assert_close(visible_irradiance(position, normal, PANEL, blockers), once)


@settings(max_examples=20)
@given(st.integers(0, 2**31), st.permutations(range(5)))
def test_order_does_not_matter_and_more_blockers_never_brighten(seed: int, order: list) -> None:
    generator = torch.Generator().manual_seed(seed)
    position, normal = points(5, generator)
    blockers = triangles(5, generator)
    seen = visible_irradiance(position, normal, PANEL, blockers)
    assert_close(visible_irradiance(position, normal, PANEL, blockers[order]), seen, atol=1e-12)
    fewer = visible_irradiance(position, normal, PANEL, blockers[:3])
    assert (seen <= fewer + 1e-12).all()
    assert (fewer <= polygon_irradiance(position, normal, PANEL) + 1e-12).all()


def test_own_plane_emitter_and_neighbours_hide_nothing() -> None:
    x = torch.tensor([[0.2, 0.1, 0.0]], dtype=torch.float64)
    whole = polygon_irradiance(x, UP.expand(1, 3), PANEL)
    floor, ceiling = PANEL * torch.tensor([1.0, 1, 0]), PANEL * torch.tensor([3.0, 3, 1])
    for blocker in (PANEL, PANEL.flip(0), floor, ceiling, floor - UP, ceiling + UP):
        assert visible_irradiance(x, UP.expand(1, 3), PANEL, blocker.unsqueeze(0)) == whole
    needle = torch.tensor([[[0.1, 0.1, 1], [0.1, 0.1, 1], [0.2, 0.2, 1.5]]], dtype=torch.float64)
    assert visible_irradiance(x, UP.expand(1, 3), PANEL, needle) == whole
    assert visible_irradiance(x, UP.expand(1, 3), PANEL, needle[:0]) == whole


def test_a_fin_on_the_panel_and_one_at_the_point() -> None:
    x = torch.tensor([[0.5, 0.25, 0.0]], dtype=torch.float64)
    fin = torch.tensor([[0.0, -1, 2], [0, 1, 2], [0, 1, 1.5], [0, -1, 1.5]]).double()
    edge = 0.5 - 0.5 / 0.75  # where the ray over the fin's lower edge meets the panel
    # the fin's shadow runs from x = 0 to x = edge; its ends reach from wall to wall
    lit = [PANEL.clone(), PANEL.clone()]
    lit[0][1:3, 0], lit[1][[0, 3], 0] = 0.0, edge
    ends = fin.clone()
    ends[:, 1] *= 20
    seen = visible_irradiance(x, UP.expand(1, 3), PANEL, ends.unsqueeze(0))
    assert_close(seen, sum(polygon_irradiance(x, UP.expand(1, 3), p) for p in lit))
    standing = torch.tensor([[0.5, -9, 0], [0.5, 9, 0], [0.5, 9, 1], [0.5, -9, 1]]).double()
    inside = visible_irradiance(x, UP.expand(1, 3), PANEL, standing.unsqueeze(0))
    assert inside == polygon_irradiance(x, UP.expand(1, 3), PANEL)


@pytest.mark.parametrize("seed", range(2))
def test_gradients_with_respect_to_everything(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    position, normal = points(2, generator)
    blockers = triangles(2, generator)
    read = [t.requires_grad_() for t in (position, normal, PANEL.clone(), blockers)]
    whole = polygon_irradiance(position, normal, PANEL)
    assert (visible_irradiance(*read) < whole).any()
    assert gradcheck(lambda *t: visible_irradiance(*t, margin=1e-14), read, atol=1e-7)


def test_a_shadow_boundary_moves_with_its_gradient() -> None:
    """d/ds of half a panel: the radiance of the strip that the boundary sweeps."""
    shift = torch.zeros((), dtype=torch.float64, requires_grad=True)
    screen = torch.tensor([[0.0, -9, 1], [9, -9, 1], [9, 9, 1], [0, 9, 1]], dtype=torch.float64)
    moved = screen + shift * screen.new_tensor([1.0, 0, 0])
    seen = visible_irradiance(torch.zeros(3).double(), UP, PANEL, moved.unsqueeze(0))
    (slope,) = torch.autograd.grad(seen, shift)
    # the boundary moves at twice the screen's speed; int of 4 / (4 + y^2)^2 dy over -1..1
    y = torch.tensor(1.0, dtype=torch.float64)
    strip = 2 * (y / 2 / (4 + y**2) + torch.atan(y / 2) / 4)
    assert_close(slope, 2 * strip)


@pytest.mark.parametrize(
    ("scale", "place"), [(1e-3, 0.0), (1e6, 0.0), (1.0, 1e6), (1e-12, 0.0), (1e12, 0.0)]
)
def test_scale_and_place(scale: float, place: float, generator: torch.Generator) -> None:
    position, normal = points(50, generator)
    blockers = triangles(6, generator)
    seen = visible_irradiance(position, normal, PANEL, blockers)
    moved = (t * scale + place for t in (position, PANEL, blockers))
    x, panel, screens = moved
    # coordinates of size 1e6 are stored to 1e-10 m
    tolerance = 1e-9 if place else 1e-12
    assert_close(visible_irradiance(x, normal, panel, screens), seen, atol=tolerance)


def test_batches_broadcast_and_dtypes_stay(generator: torch.Generator) -> None:
    position, normal = points(7, generator)
    blockers = triangles(5, generator)
    panels = torch.stack((PANEL, PANEL * torch.tensor([0.5, 2, 1.1])))
    table = visible_irradiance(position.unsqueeze(1), normal.unsqueeze(1), panels, blockers)
    assert table.shape == (7, 2)
    for column, panel in zip(table.unbind(1), panels, strict=True):
        assert_close(column, visible_irradiance(position, normal, panel, blockers))
    single = (t.float() for t in (position, normal, PANEL, blockers))
    seen = visible_irradiance(*single)
    assert seen.dtype == torch.float32
    assert_close(seen, table[:, 0].float(), atol=1e-5)
    assert visible_irradiance(position[:0], normal[:0], PANEL, blockers).shape == (0,)


def test_the_back_of_a_panel_is_dark_or_two_sided(generator: torch.Generator) -> None:
    position, normal = points(20, generator)
    blockers = triangles(5, generator)
    behind = PANEL.flip(0)
    assert (visible_irradiance(position, normal, behind, blockers) == 0).all()
    seen = visible_irradiance(position, normal, behind, blockers, two_sided=True)
    assert_close(seen, visible_irradiance(position, normal, PANEL, blockers))


def test_shapes_are_named() -> None:
    x = torch.zeros(3)
    with pytest.raises(errors.ShapeError, match="blockers"):
        visible_irradiance(x, x, torch.zeros(4, 3), torch.zeros(4, 3))
    with pytest.raises(errors.ShapeError, match="polygon"):
        visible_polygon(x, torch.zeros(2, 3), torch.zeros(1, 4, 3))
