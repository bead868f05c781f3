from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from torchradiometry import Patches, subdivide
from torchradiometry.numerics import dot
from torchradiometry.scene.build import box, sphere
from torchradiometry.transport.cluster_nodes import NODES, cluster_nodes
from torchradiometry.transport.cluster_tree import cluster_tree


def corners_of(*surfaces) -> torch.Tensor:
    return torch.cat([s.vertices[s.faces] for s in surfaces]).double()


def wavy(count: int, seed: int) -> Patches:
    generator = torch.Generator().manual_seed(seed)
    return Patches(torch.randn(count, 3, 3, generator=generator, dtype=torch.float64))


ROOM = subdivide(Patches(corners_of(box("room", (2, 1, 1.5), inward=True))), 0.2)[0]
BALL = Patches(corners_of(sphere("ball", 1.0, subdivisions=3)))
SCENES = {"room": ROOM, "ball": BALL, "random": wavy(300, 0), "two": wavy(2, 1), "one": wavy(1, 2)}


@pytest.mark.parametrize("name", SCENES)
def test_children_part_their_parent_and_leaves_are_the_patches(name: str) -> None:
    patches = SCENES[name]
    tree = cluster_tree(patches)
    assert torch.equal(tree.order.sort().values, torch.arange(patches.count))
    inner = torch.nonzero(tree.child >= 0).squeeze(-1)
    first, second = tree.child[inner], tree.child[inner] + 1
    assert torch.equal(tree.start[first], tree.start[inner])
    assert torch.equal(tree.start[second], tree.start[inner] + tree.size[first])
    assert torch.equal(tree.size[first] + tree.size[second], tree.size[inner])
    assert torch.equal(tree.parent[first], inner)
    assert torch.equal(tree.parent[second], inner)
    assert len(tree.parent) == 2 * patches.count - 1
    assert torch.equal(tree.order[tree.start[tree.leaf]], torch.arange(patches.count))
    assert (tree.size[tree.leaf] == 1).all()


@pytest.mark.parametrize("name", SCENES)
def test_ball_and_cone_hold_every_member(name: str) -> None:
    patches = SCENES[name]
    tree = cluster_tree(patches)
    torch.testing.assert_close(tree.area[0], patches.area.sum())
    for number in range(tree.depth):
        cluster, patch = tree.members(number)
        away = (patches.corners[patch] - tree.centre[cluster].unsqueeze(1)).norm(dim=-1)
        assert (away <= tree.radius[cluster].unsqueeze(1) * (1 + 1e-6)).all()
        cosine = dot(patches.normal[patch], tree.axis[cluster])
        assert (cosine >= tree.cone[cluster].cos() - 1e-6).all()


def test_walls_part_first_and_then_the_tree_is_balanced() -> None:
    tree = cluster_tree(ROOM)
    flat = tree.cone < 1e-6
    assert flat[tree.levels[6] :].all()
    assert tree.depth <= 6 + (ROOM.count - 1).bit_length()


@given(st.integers(0, 2**31), st.integers(2, 60))
def test_nodes_carry_means_of_quadratic_functions(seed: int, count: int) -> None:
    # patches of one plane: the fit is exact there
    patches = wavy(count, seed)
    patches = Patches(patches.corners * torch.tensor([1.0, 1.0, 0.0]))
    turned = dot(patches.normal, torch.tensor([0, 0, 1.0]).double()) < 0
    corners = torch.where(turned[:, None, None], patches.corners.flip(1), patches.corners)
    patches = Patches(corners)
    tree = cluster_tree(patches)
    nodes = cluster_nodes(tree, patches)
    x, y = nodes.position[0, :, 0], nodes.position[0, :, 1]
    a, b, c = corners.unbind(1)
    weight = patches.area / patches.area.sum()
    middle = ((a + b + c) / 3 * weight.unsqueeze(-1)).sum(0)
    torch.testing.assert_close(x.mean(), middle[0])
    # the mean of x y over a triangle is (sum of corners' xy + 9 times the middle's) / 12
    mixed = ((a + b + c)[:, 0] * (a + b + c)[:, 1] + sum(t[:, 0] * t[:, 1] for t in (a, b, c))) / 12
    torch.testing.assert_close((x * y).mean(), (mixed * weight).sum(), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["room", "ball", "random", "two"])
def test_transfers_keep_constant_and_linear_light(name: str) -> None:
    patches = SCENES[name]
    tree = cluster_tree(patches)
    nodes = cluster_nodes(tree, patches)
    torch.testing.assert_close(nodes.transfer.sum(-1), torch.ones(len(tree.parent), NODES).double())
    inner = tree.parent[1:]
    found = nodes.transfer[1:] @ nodes.position[inner]
    across = nodes.position[1:] - found  # what is left points along the parent's axis
    along = dot(across, tree.axis[inner].unsqueeze(1)).unsqueeze(-1) * tree.axis[inner].unsqueeze(1)
    size = tree.radius[0]
    assert float((across - along).abs().max() / size) < 1e-6


def test_degenerate_patches_and_no_patches_leave_finite_trees() -> None:
    corners = ROOM.corners.clone()
    corners[::7] = corners[::7, :1]
    tree = cluster_tree(Patches(corners))
    nodes = cluster_nodes(tree, Patches(corners))
    assert all(torch.isfinite(t).all() for t in (*nodes, tree.radius, tree.cone, tree.centre))
    empty = cluster_tree(Patches(corners[:0]))
    assert len(empty.order) == 0
