"""Ray casters: exact hits, closed edges, both ends excluded, any place and scale."""

import pytest
import torch
from torch import Tensor

from tests.cases import RAY_CASTERS
from tests.tolerances import assert_close
from torchradiometry import errors, transport
from torchradiometry.transport import embree

CASTERS = pytest.mark.parametrize("caster", RAY_CASTERS, ids=lambda c: c.__name__)
#: (scale, distance from the origin) of a scene, m
PLACES = [(1.0, 0.0), (1e-3, 0.0), (1e6, 0.0), (1.0, 1e6)]


def soup(count: int, generator: torch.Generator) -> Tensor:
    middle = torch.rand(count, 1, 3, dtype=torch.float64, generator=generator)
    return middle + 0.3 * torch.randn(count, 3, 3, dtype=torch.float64, generator=generator)


def cube(dtype: torch.dtype = torch.float64) -> Tensor:
    """The unit cube's 12 triangles."""
    square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=dtype)
    sides = [square.roll(k, -1) for k in range(3)]
    sides += [s + torch.eye(3, dtype=dtype)[(2 + k) % 3] for k, s in enumerate(sides)]
    return torch.cat([torch.stack((s[[0, 1, 2]], s[[0, 2, 3]])) for s in sides])


@CASTERS
@pytest.mark.parametrize(("scale", "place"), PLACES)
def test_hit_distance_and_weights_are_exact(caster, scale: float, place: float) -> None:
    rays = caster(cube() * scale + place)
    origin = torch.tensor([[0.25, 0.25, 0.5]], dtype=torch.float64) * scale + place
    hits = rays.closest(origin, torch.tensor([[0.0, 0.0, 2.0]], dtype=torch.float64))
    assert_close(hits.distance, [0.25 * scale], rtol=1e-9)
    point = (hits.barycentric[0].unsqueeze(-1) * rays.corners[hits.triangle[0]]).sum(0)
    assert_close((point - place) / scale, [0.25, 0.25, 1.0], rtol=1e-9)


@pytest.mark.parametrize(("scale", "place"), PLACES)
def test_casters_agree(scale: float, place: float, generator: torch.Generator) -> None:
    corners = soup(200, generator) * scale + place
    origin, target = torch.rand(2, 5000, 3, dtype=torch.float64, generator=generator)
    origin, target = origin * scale + place, target * scale + place
    fast, exact = transport.EmbreeRays(corners), transport.BruteForceRays(corners, budget=2**22)
    a, b = (rays.closest(origin, target - origin) for rays in (fast, exact))
    same = a.triangle == b.triangle
    # float32 may decide otherwise where two triangles cross or a ray grazes an edge
    assert same.double().mean() > 0.999
    assert (a.triangle >= 0).double().mean() > 0.5
    finite = same & a.found
    assert_close(a.distance[finite], b.distance[finite])
    assert (fast.occluded(origin, target) == exact.occluded(origin, target)).double().mean() > 0.999


@CASTERS
def test_no_ray_leaves_a_closed_box_through_edges_or_corners(caster, generator) -> None:
    rays = caster(cube())
    origin = torch.full((4000, 3), 0.5, dtype=torch.float64)
    target = torch.rand(4000, 3, dtype=torch.float64, generator=generator).round()
    target[:2000, 0] = torch.rand(2000, dtype=torch.float64, generator=generator)
    assert rays.closest(origin, target - origin).found.all()
    beyond = origin + 2 * (target - origin)
    assert rays.occluded(origin, beyond).all()
    away = torch.randn(4000, 3, dtype=torch.float64, generator=generator)
    assert rays.closest(origin, away).found.all()


@CASTERS
@pytest.mark.parametrize(("scale", "place"), PLACES)
def test_segments_between_surfaces_do_not_meet_them(caster, scale, place, generator) -> None:
    corners = cube() * scale + place
    rays = caster(corners)
    weights = torch.rand(2, 3000, 3, dtype=torch.float64, generator=generator)
    weights = weights / weights.sum(-1, keepdim=True)
    triangle = torch.randint(12, (2, 3000), generator=generator)
    points = (weights.unsqueeze(-1) * corners[triangle]).sum(-2)
    a, b, c = corners.unbind(1)
    normal = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1)
    inward = ((corners.mean((0, 1)) - a) * normal).sum(-1, keepdim=True).sign() * normal
    start, end = (rays.lift(p, inward[t]) for p, t in zip(points, triangle, strict=True))
    assert not rays.occluded(start, end).any()
    through = (triangle[0] // 2) != (triangle[1] // 2)
    far = points[1] + 3 * (points[1] - points[0])
    assert rays.occluded(start, far)[through].all()


@CASTERS
def test_distant_points_see_the_scene(caster) -> None:
    rays = caster(cube())
    far = torch.tensor([[0.25, 0.25, 1e7]], dtype=torch.float64)
    hits = rays.closest(far, torch.tensor([[0.0, 0.0, -1.0]], dtype=torch.float64))
    assert_close(hits.distance, [1e7 - 1])
    assert rays.occluded(far, torch.tensor([[0.25, 0.25, 0.5]], dtype=torch.float64)).all()
    above = torch.tensor([[0.25, 0.25, 1.5]], dtype=torch.float64)
    assert not rays.occluded(above, rays.beyond(above, torch.tensor([[0.0, 0, 1]]).double())).any()


@CASTERS
def test_nothing_in_nothing_out(caster) -> None:
    empty = caster(torch.zeros(0, 3, 3))
    origin, direction = torch.zeros(2, 3), torch.eye(3)[:2]
    assert (empty.closest(origin, direction).triangle == -1).all()
    assert torch.isinf(empty.closest(origin, direction).distance).all()
    assert not empty.occluded(origin, direction).any()
    some = caster(cube())
    assert some.closest(origin[:0], direction[:0]).triangle.shape == (0,)
    assert some.occluded(origin[:0], direction[:0]).shape == (0,)
    assert not some.closest(origin, torch.zeros(2, 3)).found.any()
    assert not some.occluded(origin + 0.5, origin + 0.5).any()


@CASTERS
def test_bad_corners_are_named(caster) -> None:
    with pytest.raises(errors.ShapeError, match="triangle 3 3"):
        caster(torch.zeros(4, 3))
    with pytest.raises(errors.InvalidValueError, match="NaN"):
        caster(torch.full((1, 3, 3), torch.nan))


@CASTERS
def test_zero_area_triangles_are_not_hit(caster) -> None:
    rays = caster(torch.zeros(1, 3, 3))
    assert not rays.closest(torch.tensor([[0.0, 0, -1]]), torch.tensor([[0.0, 0, 1]])).found.any()


def test_missing_embreex_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "embreex.rtcore_scene", None)
    with pytest.raises(errors.MissingDependencyError, match=r"torchradiometry\[rays\]"):
        embree.EmbreeRays(cube())


@pytest.mark.cuda
def test_brute_force_runs_on_cuda(generator: torch.Generator) -> None:
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    corners = soup(100, generator)
    origin, target = torch.rand(2, 1000, 3, dtype=torch.float64, generator=generator)
    here = transport.BruteForceRays(corners).closest(origin, target - origin)
    there = transport.BruteForceRays(corners.cuda()).closest(
        origin.cuda(), (target - origin).cuda()
    )
    assert (here.triangle == there.triangle.cpu()).all()
