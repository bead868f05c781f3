"""Visibility of pairs: certain without rays, honest errors with them, any place and scale."""

import pytest
import torch
import trimesh
from torch import Tensor

from tests.cases import RAY_CASTERS
from torchradiometry import transport
from torchradiometry.geometry.patches import Patches, subdivide
from torchradiometry.transport.blockers import convex_blockers
from torchradiometry.transport.rays import AbstractRayCaster
from torchradiometry.transport.rules import sample_patches
from torchradiometry.transport.shafts import certain_pairs
from torchradiometry.transport.visibility import pair_visibility

CASTERS = pytest.mark.parametrize("caster", RAY_CASTERS, ids=lambda c: c.__name__)
PLACES = pytest.mark.parametrize(
    ("scale", "place"), [(1.0, 0.0), (1e-3, 0.0), (1e6, 0.0), (1.0, 1e6)]
)
FLOOR = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=torch.float64)
CEILING = FLOOR.flip(1) + torch.tensor([0, 0, 1.0], dtype=torch.float64)


def halved(quads: Tensor) -> Tensor:
    return torch.cat((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def box(size: list[float], centre: list[float], inward: bool = False) -> Tensor:
    triangles = torch.tensor(trimesh.creation.box(size).triangles.copy())
    sides = convex_blockers(triangles + torch.tensor(centre, dtype=torch.float64))
    return sides.flip(1) if inward else sides


def furnished(max_edge: float = 0.7) -> tuple[Patches, Tensor]:
    """A room with a crate on its floor and one in the air; patches and triangles."""
    walls = box([2, 2, 2], [0, 0, 1], inward=True)
    crate = box([0.6, 0.8, 0.7], [-0.2, 0.1, 0.35])
    crate = crate[crate.mean(1)[:, 2] > 0.01]
    air = box([0.5, 0.4, 0.3], [0.4, -0.3, 1.3])
    sides = torch.cat((walls, crate, air))
    return subdivide(Patches(sides), max_edge)[0], halved(sides)


def facing(patches: Patches) -> tuple[Tensor, Tensor]:
    """Pairs that would see something of each other without blockers."""
    height = torch.einsum("jcx,ix->ijc", patches.corners, patches.normal)
    offset = (patches.normal * patches.corners[:, 0]).sum(-1)
    above = (height.amax(-1) - offset.unsqueeze(1)) > 1e-6
    return torch.nonzero((above & above.mT).triu(1), as_tuple=True)


def brute_force(
    patches: Patches, rays: AbstractRayCaster, i: Tensor, j: Tensor, count: int = 200
) -> Tensor:
    """V by independent random segments."""
    generator = torch.Generator().manual_seed(7)
    normal = patches.normal
    free, valid = torch.zeros(2, len(i)).double()
    for _ in range(count // 20):
        where = torch.rand(2, len(i), 20, 2, generator=generator, dtype=torch.float64)
        a, b = (
            rays.lift(sample_patches(patches.corners[k].unsqueeze(1), w), normal[k].unsqueeze(1))
            for k, w in zip((i, j), where, strict=True)
        )
        ahead = ((b - patches.corners[i][:, :1]) * normal[i].unsqueeze(1)).sum(-1) > 0
        ahead &= ((a - patches.corners[j][:, :1]) * normal[j].unsqueeze(1)).sum(-1) > 0
        free += (rays.visible(a, b) & ahead).sum(-1)
        valid += ahead.sum(-1)
    return torch.where(valid > 0, free / valid.clamp(min=1), 1)


class NoRays(AbstractRayCaster):
    """Blockers that refuse to be asked."""

    def __init__(self, corners: Tensor) -> None:
        self._hold(corners)

    def closest(self, origin, direction):
        raise AssertionError

    def occluded(self, origin, target):
        raise AssertionError("a ray was cast")


def counted(caster: type[AbstractRayCaster]) -> type[AbstractRayCaster]:
    class Counted(caster):
        rays = 0

        def occluded(self, origin, target):
            self.rays += len(origin)
            return super().occluded(origin, target)

    return Counted


def test_certain_pairs_are_certain(generator: torch.Generator) -> None:
    patches, triangles = furnished()
    i, j = facing(patches)
    rays = transport.BruteForceRays(triangles)
    blockers = convex_blockers(triangles)
    visible, hidden = certain_pairs(patches, blockers, i, j, rays.tolerance)
    assert visible.double().mean() > 0.3
    assert hidden.any()
    assert not (visible & hidden).any()
    certain = torch.nonzero(visible | hidden).squeeze(-1)
    found = brute_force(patches, rays, i[certain], j[certain], 100)
    assert (found == visible[certain]).all()


def test_separating_planes_and_projections_find_nearly_all(generator: torch.Generator) -> None:
    """One random blocker between small random patches: few pairs stay open, none is wrong."""
    options = {"generator": generator, "dtype": torch.float64}
    below, above = torch.rand(2, 300, 1, 3, **options) * 2 - 1
    small = 0.05 * torch.randn(2, 300, 3, 3, **options) * torch.tensor([1.0, 1, 0])
    below, above = below + small[0], above + small[1]
    below[..., 2] -= 2
    above[..., 2] += 2
    down = torch.linalg.cross(below[:, 1] - below[:, 0], below[:, 2] - below[:, 0])[:, 2] < 0
    below = torch.where(down[:, None, None], below.flip(1), below)
    up = torch.linalg.cross(above[:, 1] - above[:, 0], above[:, 2] - above[:, 0])[:, 2] > 0
    above = torch.where(up[:, None, None], above.flip(1), above)
    patches = Patches(torch.cat((below, above)))
    screen = torch.tensor([[[-0.5, -0.6, 0], [0.6, -0.5, 0.3], [0.5, 0.5, 0.2]]]).double()
    screen = screen[:, [0, 1, 2, 2]]
    i, j = torch.arange(300), torch.arange(300) + 300
    visible, hidden = certain_pairs(patches, screen, i, j)
    found = brute_force(patches, transport.BruteForceRays(screen[:, :3]), i, j)
    assert (found[visible] == 1).all()
    assert (found[hidden] == 0).all()
    assert hidden.sum() > 30
    whole = (found == 0) | (found == 1)
    # the pairs that stay open although the rays saw no change are those near the edges
    assert (visible | hidden)[whole].double().mean() > 0.95


@PLACES
def test_no_ray_is_cast_for_pairs_that_are_clear_or_covered(scale: float, place: float) -> None:
    cover = FLOOR * 3 + torch.tensor([-1.0, -1, 0.5])
    beside = FLOOR + torch.tensor([1.0, 0, 0.5])  # its edge lies in the border of the shaft
    pair = Patches(torch.cat((FLOOR, CEILING)) * scale + place)
    one, other = torch.tensor([0]), torch.tensor([1])
    for blockers, expected in ((cover, 0.0), (beside, 1.0), (torch.cat((FLOOR, CEILING)), 1.0)):
        rays = NoRays(halved(blockers) * scale + place)
        found = pair_visibility(pair, rays, one, other)
        assert (float(found.visibility), float(found.error)) == (expected, 0.0)


@CASTERS
@PLACES
def test_patches_that_share_edges_and_corners_with_blockers(caster, scale, place) -> None:
    walls = box([2, 2, 2], [0, 0, 1], inward=True)
    step = box([1, 1, 1], [0.5, 0.5, 0.5])  # in a corner of the room
    middle = step.mean(1)
    step = step[(middle[:, :2] < 0.99).all(-1) & (middle[:, 2] > 0.01)]
    assert len(step) == 3
    sides = torch.cat((walls, step)) * scale + place
    patches, parent = subdivide(Patches(sides), 1.01 * scale)
    i, j = facing(patches)
    found = pair_visibility(patches, caster(halved(sides)), i, j, samples=4)
    exact = brute_force(patches, transport.BruteForceRays(halved(sides)), i, j, 200)
    # what rays find free or blocked throughout is so, contacts included
    assert (found.visibility[exact == 1] == 1).double().mean() > 0.99
    touching = (parent[i] < 6) & (parent[j] >= 6)
    assert (found.visibility[touching] > 0).any()
    assert (found.visibility[exact == 0] == 0).double().mean() > 0.98
    assert (found.visibility - exact).square().mean().sqrt() < 0.1


@CASTERS
def test_the_stated_error_is_honest(caster) -> None:
    patches, triangles = furnished()
    i, j = facing(patches)
    exact = brute_force(patches, transport.BruteForceRays(triangles), i, j)
    rays = caster(triangles)
    for samples in (2, 4, 8):
        found = [pair_visibility(patches, rays, i, j, samples, seed) for seed in range(2)]
        open_ = torch.stack([f.error > 0 for f in found])
        stated = torch.stack([f.error for f in found])[open_].square().mean().sqrt()
        true = torch.stack([f.visibility - exact for f in found])[open_].square().mean().sqrt()
        assert 0.3 * stated < true < 1.05 * stated
        off = torch.stack([(f.visibility - exact).abs() for f in found])[open_]
        assert (off > 3 * torch.stack([f.error for f in found])[open_]).double().mean() < 0.01


def test_more_samples_smaller_errors_and_reproducible() -> None:
    patches, triangles = furnished()
    i, j = facing(patches)
    rays = transport.BruteForceRays(triangles)
    few, same, many = (pair_visibility(patches, rays, i, j, s, 1) for s in (2, 2, 16))
    assert (few.visibility == same.visibility).all()
    assert many.error.mean() < 0.5 * few.error.mean()
    assert (few.visibility != pair_visibility(patches, rays, i, j, 2, 2).visibility).any()


def test_rays_go_where_the_weight_is() -> None:
    patches, triangles = furnished()
    i, j = facing(patches)
    rays = counted(transport.BruteForceRays)(triangles)
    weight = torch.where(torch.arange(len(i)) % 4 == 0, 1.0, 0.01).double()
    even = pair_visibility(patches, rays, i, j, 4)
    used = rays.rays
    found = pair_visibility(patches, rays, i, j, 4, weight=weight)
    assert rays.rays - used <= 1.1 * used
    assert (weight * found.error).square().sum() < 0.8 * (weight * even.error).square().sum()
    nowhere = pair_visibility(patches, rays, i, j, 4, weight=torch.zeros_like(weight))
    assert torch.isfinite(nowhere.error).all()


def test_small_patches_need_few_rays() -> None:
    patches, triangles = furnished(0.4)
    i, j = facing(patches)
    rays = counted(transport.BruteForceRays)(triangles)
    found = pair_visibility(patches, rays, i, j, 2)
    assert (found.error > 0).double().mean() < 0.5
    assert rays.rays < 2 * len(i)


@CASTERS
@PLACES
def test_half_a_wall_halves_the_view(caster, scale: float, place: float) -> None:
    wall = torch.tensor([[[0.5, -9, 0.5], [9, -9, 0.5], [9, 9, 0.5], [0.5, 9, 0.5]]]).double()
    patches = Patches(torch.cat((FLOOR, CEILING)) * scale + place)
    rays = caster(halved(wall) * scale + place)
    found = pair_visibility(patches, rays, torch.tensor([0]), torch.tensor([1]), 64)
    assert 0 < float(found.error) < 0.05
    assert abs(float(found.visibility) - 0.5) < 3 * float(found.error)


@CASTERS
@pytest.mark.parametrize("width", [1e-3, 1e-7, 1e-12, 0.0])
def test_needles_hide_next_to_nothing(caster, width: float) -> None:
    needle = torch.tensor([[[-1.0, 0.4, 0.4], [2, 0.6, 0.6], [2, 0.6 + width, 0.6]]]).double()
    patches = Patches(torch.cat((FLOOR, CEILING)))
    found = pair_visibility(patches, caster(needle), torch.tensor([0]), torch.tensor([1]), 16)
    assert float(found.visibility) >= 1 - 4 * width - 3 * float(found.error)
    assert torch.isfinite(found.error).all()


def test_many_blockers_are_left_to_the_rays() -> None:
    ball = torch.tensor(trimesh.creation.icosphere(subdivisions=2, radius=0.3).triangles.copy())
    triangles = torch.cat((ball + torch.tensor([0.5, 0.5, 0.5]), halved(FLOOR * 5 - 2)))
    patches, _ = subdivide(Patches(torch.cat((FLOOR, CEILING))), 0.3)
    i, j = facing(patches)
    rays = counted(transport.BruteForceRays)(triangles)
    found = pair_visibility(patches, rays, i, j, 2)
    assert rays.rays >= 2 * len(i) * 0.9
    exact = brute_force(patches, transport.BruteForceRays(triangles), i, j, 100)
    assert (found.visibility - exact).square().mean() < 1.1 * found.error.square().mean()


def test_nothing_in_nothing_out_and_dtypes() -> None:
    patches = Patches(torch.cat((FLOOR, CEILING)).float())
    none = torch.zeros(0, dtype=torch.int64)
    rays = transport.BruteForceRays(halved(FLOOR + 0.25))
    assert pair_visibility(patches, rays, none, none).visibility.shape == (0,)
    found = pair_visibility(patches, rays, torch.tensor([0]), torch.tensor([1]))
    assert found.visibility.dtype == found.error.dtype == torch.float32
    empty = transport.BruteForceRays(torch.zeros(0, 3, 3))
    assert float(pair_visibility(patches, empty, torch.tensor([0]), torch.tensor([1]))[0]) == 1


def test_weights_of_any_size_spend_the_same_rays() -> None:
    patches, triangles = furnished()
    i, j = facing(patches)
    spread = 10 ** torch.linspace(-60, 3, len(i), dtype=torch.float64)
    for weight in (torch.ones(len(i)).double() * 1e-300, spread, spread.flip(0)):
        rays = counted(transport.BruteForceRays)(triangles)
        pair_visibility(patches, rays, i, j, 4)
        even = rays.rays
        pair_visibility(patches, rays, i, j, 4, weight=weight)
        assert 0.6 * even < rays.rays - even < 1.1 * even
