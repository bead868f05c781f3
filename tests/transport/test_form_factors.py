"""Form factors: closed forms, reciprocity and closure by construction, visibility, gradients."""

import math

import pytest
import torch
import trimesh
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry import errors, transport
from torchradiometry.geometry.patches import Patches, subdivide
from torchradiometry.reference.closed_forms import parallel_rectangles, perpendicular_rectangles

SQUARE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)


def triangles_of(mesh: trimesh.Trimesh, inward: bool = True) -> Tensor:
    corners = torch.tensor(mesh.triangles.copy(), dtype=torch.float64)
    return corners.flip(1) if inward else corners


def room(max_edge: float = 0.5) -> Patches:
    return subdivide(Patches(triangles_of(trimesh.creation.box((1, 1, 1)))), max_edge)[0]


def assert_reciprocal(factors: Tensor, area: Tensor) -> None:
    exchange = area.unsqueeze(-1) * factors
    assert_close(exchange, exchange.mT)


@pytest.mark.parametrize("gap", [0.3, 1.0, 4.0])
def test_parallel_squares(gap: float) -> None:
    facing = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, gap])
    parts, parent = subdivide(Patches(torch.stack((SQUARE, facing))), 0.25)
    factors = transport.form_factors(parts)
    mean = (parts.area.unsqueeze(-1) * factors)[parent == 0][:, parent == 1].sum()
    assert_close(mean, parallel_rectangles(1.0, 1.0, gap))


def test_perpendicular_squares_with_a_common_edge() -> None:
    wall = torch.stack((SQUARE[0], SQUARE[3], SQUARE[3] + SQUARE.new_tensor([0, 0, 1])))
    wall = torch.cat((wall, SQUARE.new_tensor([[0, 0, 1]])))
    parts, parent = subdivide(Patches(torch.stack((SQUARE, wall))), 0.25)
    factors = transport.form_factors(parts)
    mean = (parts.area.unsqueeze(-1) * factors)[parent == 0][:, parent == 1].sum()
    assert_close(mean, perpendicular_rectangles(1.0, 1.0, 1.0))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("rays", [None, transport.BruteForceRays, transport.EmbreeRays])
def test_a_cube_is_closed_and_reciprocal(dtype: torch.dtype, rays) -> None:
    parts = room()
    patches = Patches(parts.corners.to(dtype))
    blockers = rays and rays(triangles_of(trimesh.creation.box((1, 1, 1))))
    factors = transport.form_factors(patches, blockers, closed=True)
    assert factors.dtype == dtype
    assert_close(factors.sum(-1), 1.0)
    assert_reciprocal(factors, patches.area)
    assert (factors.diagonal() == 0).all()
    assert (factors >= 0).all()


def prism(height: float) -> trimesh.Trimesh:
    """A wedge: two rectangles that meet at a small angle, a back wall, two triangular ends."""
    corners = [[0, 0, 0], [1, 0, 0], [1, 0, height], [0, 2, 0], [1, 2, 0], [1, 2, height]]
    faces = [[0, 1, 2], [3, 5, 4], [0, 4, 1], [0, 3, 4], [1, 5, 2], [1, 4, 5], [0, 5, 3], [0, 2, 5]]
    return trimesh.Trimesh(corners, faces, process=False)


ENCLOSURES = {
    "cube": (trimesh.creation.box((1, 1, 1)), 0.5),
    "two plates": (trimesh.creation.box((1, 1, 0.01)), 0.6),
    "needle": (trimesh.creation.box((1, 1, 100)), 60.0),
    "wedge of 2 degrees": (prism(0.03), 1.2),
    "sphere": (trimesh.creation.icosphere(subdivisions=1), 9.0),
}


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("name", ENCLOSURES)
def test_enclosures_are_closed_before_closing(name: str, dtype: torch.dtype) -> None:
    mesh, max_edge = ENCLOSURES[name]
    inward = -1 if mesh.volume > 0 else 1
    corners = triangles_of(mesh, inward=inward < 0)
    patches = subdivide(Patches(corners.to(dtype)), max_edge)[0]
    exchange = transport.unoccluded_exchange(patches)
    wide = Patches(patches.corners.double())
    assert_close(exchange.sum(-1), wide.area, rtol=1e-12 if dtype == torch.float64 else 1e-6)
    factors = transport.form_factors(patches)
    assert_close(factors.sum(-1), 1.0)
    assert_reciprocal(factors, patches.area)


def test_rtol_bounds_what_closing_changes() -> None:
    for rtol in (1e-2, 1e-4):
        raw = transport.form_factors(room(0.3), rtol=rtol)
        closed = transport.form_factors(room(0.3), closed=True, rtol=rtol)
        assert_close(closed[raw > 0], raw[raw > 0], rtol=2 * rtol)


def test_inside_of_a_sphere_every_factor_is_the_share_of_area() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    patches = Patches(triangles_of(mesh))
    factors = transport.form_factors(patches, closed=True)
    share = patches.area / patches.area.sum()
    distant = (patches.normal @ patches.normal.mT) < 0.5
    # flat facets of a 320-face ball deviate from the sphere by 1 - cos(half a facet) = 2 %
    assert_close(factors[distant], share.expand_as(factors)[distant], rtol=0.06)
    assert_close(factors.sum(-1), 1.0)


def test_backs_are_black() -> None:
    same_way = torch.stack((SQUARE, SQUARE + SQUARE.new_tensor([0, 0, 1])))
    assert (transport.form_factors(Patches(same_way)) == 0).all()


@pytest.mark.parametrize("caster", [transport.BruteForceRays, transport.EmbreeRays])
def test_a_wall_between_two_plates(caster) -> None:
    facing = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, 1])
    patches = Patches(torch.stack((SQUARE, facing)))
    whole = SQUARE * 3 + SQUARE.new_tensor([-1, -1, 0.5])
    hidden = caster(torch.stack((whole[[0, 1, 2]], whole[[0, 2, 3]])))
    assert (transport.form_factors(patches, hidden) == 0).all()
    beside = caster(hidden.corners + SQUARE.new_tensor([5.0, 0, 0]))
    assert_close(transport.form_factors(patches, beside), transport.form_factors(patches))


def test_half_a_wall_halves_the_view() -> None:
    facing = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, 0.02])
    parts, parent = subdivide(Patches(torch.stack((SQUARE, facing))), 0.1)
    half = SQUARE * SQUARE.new_tensor([0.5, 1, 1]) + SQUARE.new_tensor([0, 0, 0.01])
    rays = transport.EmbreeRays(torch.stack((half[[0, 1, 2]], half[[0, 2, 3]])))
    free, blocked = (transport.form_factors(parts, r) for r in (None, rays))
    between = [f[parent == 0][:, parent == 1].sum() for f in (free, blocked)]
    assert_close(between[1] / between[0], 0.5, rtol=0.01)
    assert_reciprocal(blocked, parts.area)


def test_exposed_area_closes_a_room_with_a_buried_patch() -> None:
    parts = room()
    exposure = torch.ones(parts.count, dtype=torch.float64)
    exposure[0], exposure[1] = 0.0, 0.5
    exchange, area = transport.exchange_areas(parts, exposure=exposure)
    assert_close(area[1], parts.area[1] / 2)
    assert (exchange >= 0).all()
    factors = transport.form_factors(parts, exposure=exposure)
    assert (factors[0] == 0).all()
    assert (factors.sum(-1) <= 1 + 1e-12).all()


def test_a_mask_closes_only_its_rows() -> None:
    parts = room()
    open_room = Patches(parts.corners[18:])
    mask = torch.zeros(open_room.count, dtype=torch.bool)
    mask[-4:] = True
    factors = transport.form_factors(open_room, closed=mask)
    assert_close(factors[-4:].sum(-1), 1.0)
    assert_reciprocal(factors, open_room.area)


def test_what_cannot_be_closed_is_named() -> None:
    tilted = SQUARE.flip(0) * 2 + SQUARE.new_tensor([0, 0, 1])
    with pytest.raises(errors.NotConvergedError, match="closed=False"):
        transport.form_factors(Patches(torch.stack((SQUARE, tilted))), closed=True)


def test_scale_and_place_do_not_matter() -> None:
    parts = room(1.5)
    expected = transport.form_factors(parts)
    for scale, place in ((1e-3, 0.0), (1e6, 0.0), (1.0, 1e3)):
        moved = Patches(parts.corners * scale + place)
        assert_close(transport.form_factors(moved), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("closed", [False, True])
def test_gradients_with_respect_to_corners(closed: bool) -> None:
    corners = triangles_of(trimesh.creation.box((1.0, 1.2, 0.8)))
    vertices, index = corners.reshape(-1, 3).unique(dim=0, return_inverse=True)
    weight = torch.rand(12, 12, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def loss(stretch: Tensor) -> Tensor:
        patches = Patches((vertices * stretch)[index].reshape(-1, 3, 3))
        return (weight * transport.form_factors(patches, closed=closed)).sum()

    stretch = torch.tensor([1.0, 1.1, 0.9], dtype=torch.float64, requires_grad=True)
    assert gradcheck(loss, (stretch,), atol=1e-7)


def test_size_is_refused_before_memory_is_taken() -> None:
    patches = Patches(SQUARE.expand(100_000, 4, 3))
    with pytest.raises(errors.ResourceLimitError, match="100000 patches, which need 480000000000"):
        transport.form_factors(patches)


def test_bad_patches_are_named() -> None:
    with pytest.raises(errors.ShapeError):
        transport.form_factors(Patches(torch.zeros(2, 5, 3)))
    with pytest.raises(errors.InvalidValueError):
        transport.form_factors(Patches(torch.full((2, 3, 3), math.nan)))


def test_bad_quads_are_named() -> None:
    good = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, 1])
    bent = SQUARE + SQUARE.new_tensor([[0, 0, 0], [0, 0, 0], [0, 0, 0.01], [0, 0, 0]])
    reflex = SQUARE * 1.0
    reflex[2] = reflex.new_tensor([0.2, 0.2, 0])
    for bad, match in ((bent, "planar"), (SQUARE[[0, 2, 1, 3]], "crossed"), (reflex, "convex")):
        for scale, place in ((1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 100.0)):
            patches = Patches(torch.stack((good, bad)) * scale + place)
            with pytest.raises(errors.DegenerateGeometryError, match=f"{match}.* patch 1"):
                transport.form_factors(patches)
    turned = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(1)))[0]
    fine = Patches(torch.stack((good, SQUARE)).float() @ turned + 1000)
    assert torch.isfinite(transport.form_factors(fine)).all()
    line = Patches(torch.stack((good, SQUARE * SQUARE.new_tensor([1, 0, 0]))))
    assert (transport.form_factors(line) == 0).all()


def test_a_tolerance_that_is_none_is_named() -> None:
    for rtol in (0.0, -1.0, 1.0, math.nan):
        with pytest.raises(errors.OutOfRangeError, match="rtol"):
            transport.form_factors(room(1.5), rtol=rtol)


def test_coincident_faces_are_finite_and_see_nothing_of_each_other() -> None:
    facing = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, 1])
    patches = Patches(torch.stack((SQUARE, SQUARE, SQUARE.flip(0), facing)))
    factors = transport.form_factors(patches)
    assert (factors[:3, :3] == 0).all()
    # the ceiling sees both copies of the floor: F is not divided between them
    single = parallel_rectangles(1.0, 1.0, 1.0)
    assert_close(factors[3, :2], torch.tensor([single, single], dtype=torch.float64))


def test_a_patch_without_area_sees_nothing() -> None:
    facing = SQUARE.flip(0) + SQUARE.new_tensor([0, 0, 1])
    factors = transport.form_factors(Patches(torch.stack((SQUARE, facing, SQUARE * 0 + 0.5))))
    assert torch.isfinite(factors).all()
    assert (factors[2] == 0).all()
    assert_close(factors[0, 1], parallel_rectangles(1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("wrong", "error", "match"),
    [
        ({"rays": 3}, errors.DTypeError, "rays: got a int; pass a ray caster"),
        ({"samples": 0}, errors.OutOfRangeError, "samples"),
        ({"samples": 1.5}, errors.DTypeError, "samples"),
        ({"seed": 1.5}, errors.DTypeError, "seed"),
        ({"closed": torch.ones(3, dtype=torch.bool)}, errors.ShapeError, "closed: got shape"),
        ({"exposure": torch.ones(3)}, errors.ShapeError, "exposure: got shape"),
        ({"exposure": -torch.ones(2)}, errors.OutOfRangeError, "exposure"),
        ({"closed": "yes"}, errors.DTypeError, "closed"),
        ({"exposure": torch.full((2,), torch.nan)}, errors.InvalidValueError, "exposure"),
    ],
)
def test_options_of_the_wrong_kind_are_named(
    wrong: dict[str, object], error: type[Exception], match: str
) -> None:
    patches = Patches(torch.stack((SQUARE, SQUARE.flip(0) + SQUARE.new_tensor([0, 0, 1]))))
    with pytest.raises(error, match=match):
        transport.form_factors(patches, **wrong)


def test_corners_in_place_of_patches_are_named() -> None:
    corners = torch.rand(2, 3, 3)
    for wrong in (corners, corners.tolist()):
        with pytest.raises(
            errors.DTypeError, match=r"patches: got a .*; pass a Patches\(corners\)"
        ):
            transport.form_factors(wrong)
