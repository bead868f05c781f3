"""Shapes from meshes: closed forms of a ball, a box and a ring; chance; faults by name."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
import torch
import trimesh
from torch import Tensor

from torchradiometry.errors import (
    DegenerateGeometryError,
    EmptySceneError,
    FileFormatError,
    IndexRangeError,
    InputFileError,
    InvalidValueError,
    MissingDependencyError,
    OutOfRangeError,
)
from torchradiometry.learn.samples.mesh_shapes import mesh_heights, mesh_shapes, random_rotation
from torchradiometry.learn.samples.shapes import random_shapes
from torchradiometry.learn.samples.solids import grid
from torchradiometry.learn.training.settings import ShadingTraining
from torchradiometry.learn.training.settings_file import training_from_table, training_table
from torchradiometry.transport.brute_force import BruteForceRays
from torchradiometry.transport.embree import EmbreeRays

SIZE = 48


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def triangles(mesh: trimesh.Trimesh) -> Tensor:
    return torch.tensor(mesh.triangles.copy(), dtype=torch.float64)


def written(mesh: trimesh.Trimesh, path: Path) -> Path:
    mesh.export(path)
    return path


def pixels() -> tuple[Tensor, Tensor]:
    x, y = grid(SIZE, SIZE)
    return x.double(), y.double()


@pytest.mark.parametrize("caster", [EmbreeRays, BruteForceRays])
def test_a_ball_from_every_side(caster: type) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3 if caster is BruteForceRays else 5)
    ball.apply_scale(0.013)
    ball.apply_translation((70.0, -20.0, 3.0))
    rays, radius = caster(triangles(ball)), 0.45 * SIZE
    x, y = pixels()
    room_left = radius**2 - x * x - y * y
    flat = 0.02 if caster is BruteForceRays else 2e-3  # of the radius, by which faces cut corners
    for seed in range(3):
        height, inside = mesh_heights(rays, random_rotation(seeded(seed)), SIZE, 0.45)
        sure = room_left > 0.15 * radius**2
        truth = room_left.clamp(min=0).sqrt()
        assert inside[sure].all()
        assert not inside[room_left < -0.02 * radius**2].any()
        assert (height - truth)[sure].abs().max() < flat * radius


def test_a_box_that_stands_on_its_corner() -> None:
    """The lowest of the planes through its faces, exactly."""
    sides = torch.tensor([2.0, 3.0, 1.0], dtype=torch.float64)
    rays = EmbreeRays(triangles(trimesh.creation.box(sides.numpy())))
    rotation = random_rotation(seeded(5))
    height, inside = mesh_heights(rays, rotation, SIZE, 0.4)
    reach = (rotation.abs() @ sides)[:2].max() / 2
    half = sides / 2 * (0.4 * SIZE / reach)
    x, y = pixels()
    enter, leave = torch.full_like(x, math.inf), torch.full_like(x, -math.inf)
    for k in range(3):  # of the slab |(R^T q)_k| < half_k: where the ray along z is inside
        across, along = rotation[0, k] * x + rotation[1, k] * y, float(rotation[2, k])
        ends = torch.stack(((half[k] - across) / along, (-half[k] - across) / along))
        enter, leave = torch.minimum(enter, ends.amax(0)), torch.maximum(leave, ends.amin(0))
    sure = (enter - leave).abs() > 1e-3
    assert torch.equal(inside[sure], (enter > leave)[sure])
    torch.testing.assert_close(height[inside], enter[inside], rtol=0, atol=1e-9 * SIZE)


def test_a_ring_seen_along_its_axis() -> None:
    ring = trimesh.creation.torus(1.0, 0.25, major_sections=256, minor_sections=128)
    rays = EmbreeRays(triangles(ring))
    height, inside = mesh_heights(rays, torch.eye(3, dtype=torch.float64), SIZE, 0.45)
    x, y = pixels()
    scale = 0.45 * SIZE / 1.25
    room_left = (0.25 * scale) ** 2 - (torch.sqrt(x * x + y * y) - scale) ** 2
    sure = room_left > 0.15 * (0.25 * scale) ** 2
    assert inside[sure].all()
    assert not inside[room_left < -0.02 * scale**2].any()
    assert not inside[SIZE // 2, SIZE // 2]
    assert (height - room_left.clamp(min=0).sqrt())[sure].abs().max() < 2e-3 * scale


def test_rotations_are_even_and_proper() -> None:
    found = torch.stack([random_rotation(seeded(k)) for k in range(400)])
    eye = torch.eye(3, dtype=torch.float64).expand_as(found)
    torch.testing.assert_close(found @ found.mT, eye)
    torch.testing.assert_close(torch.linalg.det(found), torch.ones(400, dtype=torch.float64))
    assert found.mean(0).abs().max() < 4 / math.sqrt(3 * 400)  # each entry has variance 1/3


def test_the_same_rules_as_random_shapes(tmp_path: Path) -> None:
    files = [
        written(trimesh.creation.box((1, 2, 3)), tmp_path / "box.obj"),
        written(trimesh.creation.torus(1.0, 0.4), tmp_path / "ring.stl"),
    ]
    shapes, usual = mesh_shapes(files, 6, SIZE, seeded(1)), random_shapes(6, SIZE, seeded(1))
    for ours, theirs in zip(shapes, usual, strict=True):
        assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)
    torch.testing.assert_close(shapes.normal.norm(dim=1), torch.ones(6, SIZE, SIZE))
    assert (shapes.normal[:, 2] > 0).all()
    outside = ~shapes.mask
    assert (shapes.normal[:, 2][outside] == 1).all()
    seen = shapes.mask.flatten(1).sum(1)
    assert (seen > 0.05 * SIZE * SIZE).all()
    rim = torch.nn.functional.max_pool2d(outside.float().unsqueeze(1), 3, 1, 1).squeeze(1) > 0
    inner = shapes.mask & ~rim
    assert torch.isfinite(shapes.height).all()
    floor = shapes.height.flatten(1).amin(1)
    assert (torch.where(inner, shapes.height, 0).flatten(1).amin(1) - floor > SIZE).all()


def test_the_same_seed_gives_the_same_shapes(tmp_path: Path) -> None:
    files = [written(trimesh.creation.icosphere(), tmp_path / f"{k}.ply") for k in range(3)]
    first, again = (mesh_shapes(files, 3, 32, seeded(2)) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(first.height, mesh_shapes(files, 3, 32, seeded(3)).height)


def test_only_what_is_drawn_is_opened(tmp_path: Path) -> None:
    """One file a shape: with one shape of many files, the missing ones are not missed."""
    there = written(trimesh.creation.icosphere(), tmp_path / "ball.ply")
    drawn = int(torch.randint(0, 50, (1,), generator=seeded(4)))
    files = [tmp_path / f"{k}.ply" for k in range(50)]
    files[drawn] = there
    assert mesh_shapes(files, 1, 32, seeded(4)).mask.any()


def test_the_frame_can_be_chosen(tmp_path: Path) -> None:
    path = written(trimesh.creation.icosphere(), tmp_path / "ball.ply")
    for fill in (0.2, 0.45):
        mask = mesh_shapes([path], 2, SIZE, seeded(1), fill).mask
        wide = torch.maximum(mask.any(1).sum(1), mask.any(2).sum(1))
        # less the mask's rim, and pixels of the limb that rays through their centres miss
        assert ((2 * fill * SIZE - 2 - wide).abs() <= 3).all()
    with pytest.raises(OutOfRangeError, match="fill"):
        mesh_shapes([path], 2, SIZE, seeded(1), 0.6)


def test_without_embree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(trimesh.creation.icosphere(), tmp_path / "ball.ply")
    fast = mesh_shapes([path], 1, 32, seeded(0))

    def missing(corners: Tensor) -> None:
        raise MissingDependencyError("embreex", "no installation", "install it")

    module = import_module("torchradiometry.learn.samples.mesh_shapes")
    monkeypatch.setattr(module, "EmbreeRays", missing)
    slow = mesh_shapes([path], 1, 32, seeded(0))
    assert torch.equal(fast.mask, slow.mask)
    torch.testing.assert_close(fast.height, slow.height, rtol=0, atol=1e-5)


def test_a_sheet_is_turned_until_it_is_seen(tmp_path: Path) -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    shapes = mesh_shapes([written(sheet, tmp_path / "sheet.obj")], 8, 32, seeded(1))
    assert (shapes.mask.flatten(1).sum(1) > 10).all()


def test_faults_are_named(tmp_path: Path) -> None:
    def one(name: str) -> list[Path]:
        return [tmp_path / name]

    with pytest.raises(OutOfRangeError, match="files"):
        mesh_shapes([], 1, 32, seeded(0))
    with pytest.raises(OutOfRangeError, match="count"):
        mesh_shapes(one("x.obj"), 0, 32, seeded(0))
    with pytest.raises(OutOfRangeError, match="size"):
        mesh_shapes(one("x.obj"), 1, 8, seeded(0))
    with pytest.raises(InputFileError):
        mesh_shapes(one("x.obj"), 1, 32, seeded(0))
    (tmp_path / "noise.stl").write_bytes(bytes(range(256)))
    # as text, where trimesh can guess an encoding, it is a file without triangles
    with pytest.raises((EmptySceneError, FileFormatError)):
        mesh_shapes(one("noise.stl"), 1, 32, seeded(0))
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    with pytest.raises((EmptySceneError, FileFormatError)):
        mesh_shapes(one("empty.obj"), 1, 32, seeded(0))
    (tmp_path / "nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InvalidValueError):
        mesh_shapes(one("nan.obj"), 1, 32, seeded(0))
    (tmp_path / "index.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    with pytest.raises((IndexRangeError, FileFormatError)):
        mesh_shapes(one("index.off"), 1, 32, seeded(0))
    (tmp_path / "point.obj").write_text("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
    with pytest.raises(DegenerateGeometryError, match="extent"):
        mesh_shapes(one("point.obj"), 1, 32, seeded(0))
    (tmp_path / "needle.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0.001 0\nf 1 2 3\n")
    with pytest.raises(DegenerateGeometryError, match="too thin"):
        mesh_shapes(one("needle.obj"), 1, 32, seeded(0))


def test_named_meshes_are_every_second_shape_of_a_training(tmp_path: Path) -> None:
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=4).export(path)
    own = ShadingTraining(steps=1, images=20, size=24, shapes=4, features=8)  # all four are shown
    named = replace(own, meshes=(str(path),))
    plain, mixed = own.samples().bank, named.samples().bank
    assert torch.equal(plain.height[::2], mixed.height[::2])
    rows, columns = (mixed.mask[1::2].any(axis).sum(-1) for axis in (1, 2))
    assert torch.equal(rows, columns)  # a ball, whichever way it is turned
    assert not torch.equal(plain.mask[1::2], mixed.mask[1::2])
    assert training_from_table(training_table(named), "here") == named
