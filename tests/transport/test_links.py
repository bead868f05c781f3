from __future__ import annotations

import pytest
import torch
from torch import Tensor

from torchradiometry import BruteForceRays, EmbreeRays, Patches, exchange_areas, subdivide
from torchradiometry.errors import (
    InvalidValueError,
    OutOfRangeError,
    ResourceLimitError,
    ShapeError,
)
from torchradiometry.scene.build import box, sphere
from torchradiometry.transport.cluster_tree import cluster_tree
from torchradiometry.transport.exchange import unoccluded_exchange
from torchradiometry.transport.exchange_links import (
    PATCH_BYTES,
    ExchangeLinks,
    exchange_links,
)
from torchradiometry.transport.link_visibility import (
    first_look,
    looked_again,
    may_be_blocked,
    sight,
)
from torchradiometry.transport.links import Pairs, Refinement


def corners_of(*surfaces) -> Tensor:
    return torch.cat([s.vertices[s.faces] for s in surfaces]).double()


WALLS = corners_of(box("room", (2, 1, 1.5), inward=True))
CRATE = corners_of(box("crate", (0.5, 0.4, 0.5), (0.2, 0.05, 0.1), turn=0.4))
ROOM = subdivide(Patches(WALLS), 0.5)[0]
BALL = Patches(corners_of(sphere("ball", 1.0, subdivisions=2)).flip(1))
SCENES = {"room": ROOM, "ball": BALL}


def members(links: ExchangeLinks) -> Tensor:
    """`cluster patch`: 1 where the patch belongs to the cluster."""
    held = torch.zeros(links.levels[-1], len(links.leaf), dtype=torch.float64)
    held[links.leaf, torch.arange(len(links.leaf))] = 1
    for number in range(len(links.levels) - 2, 0, -1):
        level = slice(links.levels[number], links.levels[number + 1])
        held.index_add_(0, links.parent[level], held[level].clone())
    return held


def dense(links: ExchangeLinks) -> Tensor:
    """H of the links, entry by entry."""
    share = torch.zeros(links.levels[-1], len(links.leaf), 3, dtype=torch.float64)
    share[links.leaf, torch.arange(len(links.leaf))] = 1 / 3
    for number in range(len(links.levels) - 2, 0, -1):
        level = slice(links.levels[number], links.levels[number + 1])
        share.index_add_(0, links.parent[level], share[level] @ links.transfer[level])
    clusters, size = len(links.parent), len(links.leaf)
    kernel = torch.zeros(clusters, clusters, 3, 3, dtype=torch.float64)
    kernel[links.first, links.second] = links.kernel
    flat = share.movedim(1, 2).reshape(3 * clusters, size) * links.area
    half = flat.mT @ kernel.movedim(2, 1).reshape(3 * clusters, 3 * clusters) @ flat
    half[links.near_first, links.near_second] += links.near_exchange
    return half + half.mT


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("error", [1e-1, 1e-3])
def test_every_pair_is_linked_once(name: str, error: float) -> None:
    patches = SCENES[name]
    links = exchange_links(patches, limits=Refinement(error))
    held = members(links)
    times = held[links.first].mT @ held[links.second]
    times[links.near_first, links.near_second] += 1
    times = times + times.mT
    assert float(times.max()) == 1
    exchange, _ = exchange_areas(patches, rtol=1e-3)
    missed = torch.where(times == 0, exchange, 0).sum(1) / patches.area
    assert float(missed.max()) < error
    if error == 1e-3:
        assert len(links.kernel) > 0
        assert len(links.near_first) > 0


@pytest.mark.parametrize("name", SCENES)
def test_no_entry_is_negative_and_finer_limits_come_nearer(name: str) -> None:
    patches = SCENES[name]
    exact, _ = exchange_areas(patches, rtol=1e-4)
    errors = []
    for error in (1e-2, 1e-3, 1e-4):
        found = dense(exchange_links(patches, limits=Refinement(error)))
        assert float(found.min()) >= -1e-12 * float(found.max())
        errors.append(float((found - exact).sum(1).abs().sum() / exact.sum()))
    assert errors[0] > errors[2]
    assert errors[2] < 1e-3


def test_zero_tolerance_gives_every_pair_exactly() -> None:
    patches = subdivide(Patches(WALLS), 1.0)[0]
    links = exchange_links(patches, limits=Refinement(0.0, near=1e-8))
    exact, _ = exchange_areas(patches, rtol=1e-8)
    assert len(links.kernel) == 0
    torch.testing.assert_close(dense(links), exact, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("power", [-10, 20])
def test_scale_does_not_matter_at_all(power: int) -> None:
    here = exchange_links(ROOM, limits=Refinement(1e-3))
    there = exchange_links(Patches(ROOM.corners * 2.0**power), limits=Refinement(1e-3))
    torch.testing.assert_close(dense(there) / 4.0**power, dense(here), rtol=1e-12, atol=1e-16)


def test_place_and_order_matter_less_than_the_tolerance() -> None:
    # ties are broken another way, so that the trees differ; both keep their limit
    order = torch.randperm(ROOM.count, generator=torch.Generator().manual_seed(0))
    expected = dense(exchange_links(ROOM, limits=Refinement(1e-4))).sum(1)
    moved = Patches(ROOM.corners + 10.0)
    shuffled = Patches(ROOM.corners[order])
    for patches, right in ((moved, expected), (shuffled, expected[order])):
        found = dense(exchange_links(patches, limits=Refinement(1e-4))).sum(1)
        assert float((found - right).abs().max() / right.max()) < 1e-3


@pytest.mark.parametrize("caster", [BruteForceRays, EmbreeRays])
def test_blockers_cast_the_shadows_of_the_dense_matrix(caster: type) -> None:
    patches = subdivide(Patches(torch.cat((WALLS, CRATE))), 0.8)[0]
    rays = caster(torch.cat((WALLS, CRATE)))
    links = exchange_links(patches, rays, Refinement(1e-3, samples=16, more=16))
    exact, _ = exchange_areas(patches, rays, rtol=1e-3, samples=8)
    unoccluded, _ = exchange_areas(patches, rtol=1e-3)
    found = dense(links)
    assert float((exact.sum(1) - unoccluded.sum(1)).abs().sum() / exact.sum()) > 0.025
    assert float((found.sum(1) - exact.sum(1)).abs().sum() / exact.sum()) < 5e-3


def test_a_lamp_below_a_ceiling_is_not_taken_for_a_part_of_it() -> None:
    lamp = corners_of(box("lamp", (0.6, 0.1, 0.4), (0.1, 0.44, 0), sides=("bottom",)))
    patches, parent = subdivide(Patches(torch.cat((WALLS, lamp))), 0.3)
    shines = parent >= len(WALLS)
    expected = unoccluded_exchange(patches, 1e-4)[shines].sum()
    found = dense(exchange_links(patches, limits=Refinement(1e-3)))[shines].sum()
    assert abs(float(found / expected) - 1) < 1e-3


def test_further_segments_go_where_they_help() -> None:
    solid = torch.cat((WALLS, CRATE))
    patches = subdivide(Patches(solid), 0.5)[0]
    tree, rays = cluster_tree(patches), EmbreeRays(solid)
    view = sight(tree, patches, rays, seed=0)
    leaves = tree.leaf.sort().values
    pairs = Pairs(*(t.flatten() for t in torch.meshgrid(leaves, leaves, indexing="ij")))
    number = may_be_blocked(view, pairs) * 4
    before = first_look(view, pairs, number)
    total = 4 * int(number.sum())
    after = looked_again(view, pairs, before, torch.ones(len(number)).double(), total)
    more = after.drawn - before.drawn
    assert 0 < int(more.sum()) <= total
    assert not bool(more[number == 0].any())
    mixed = (before.free > 0) & (before.free < before.valid)
    assert float(more[mixed].double().mean()) > 2 * float(more[number > 0].double().mean())
    assert bool((after.visibility[number == 0] == 1).all())


def test_patches_without_area_exchange_nothing() -> None:
    corners = ROOM.corners.clone()
    corners[3] = corners[3, :1]
    links = exchange_links(Patches(corners), limits=Refinement(1e-3))
    found = dense(links)
    assert torch.isfinite(found).all()
    assert float(found[3].abs().max()) == 0
    assert len(exchange_links(Patches(corners[:0])).kernel) == 0


def test_bad_input_is_named() -> None:
    with pytest.raises(ShapeError, match="triangles or"):
        exchange_links(Patches(torch.zeros(2, 5, 3)))
    with pytest.raises(InvalidValueError, match="finite"):
        exchange_links(Patches(torch.full((1, 3, 3), torch.nan)))
    with pytest.raises(OutOfRangeError, match="limits"):
        exchange_links(ROOM, limits=Refinement(-1.0))
    with pytest.raises(ResourceLimitError, match=f"{ROOM.count} patches.* bytes of 1000"):
        exchange_links(ROOM, budget=1000)
    with pytest.raises(ResourceLimitError, match="links between clusters"):
        exchange_links(ROOM, limits=Refinement(1e-4), budget=PATCH_BYTES * ROOM.count + 1000)
