"""Polygon source: the exact irradiance through the source contract, samples, sides, errors."""

import math

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import DegenerateGeometryError, OutOfRangeError, ShapeError
from torchradiometry.geometry import hemisphere_quadrature, polygon_irradiance
from torchradiometry.sources import PolygonSource, irradiance

DTYPES = [torch.float64, torch.float32]
Z = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
PANEL = [[1.0, -1, 2], [-1, -1, 2], [-1, 1, 2], [1, 1, 2]]
EL = [[0, 0, 1], [0, 2, 1], [1, 2, 1], [1, 1, 1], [2, 1, 1], [2, 0, 1.0]]


def receivers(count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    position = torch.randn(count, 3, dtype=torch.float64, generator=generator)
    normal = torch.randn(count, 3, dtype=torch.float64, generator=generator)
    return position, normal / normal.norm(dim=-1, keepdim=True)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("corners", [PANEL, EL])
def test_the_contract_is_exact(
    dtype: torch.dtype, two_sided: bool, corners: list, generator: torch.Generator
) -> None:
    """E_facing * max(0, n . wi) = exact irradiance, also for receivers that are cut."""
    position, normal = (t.to(dtype) for t in receivers(200, generator))
    polygon = torch.tensor(corners, dtype=dtype)
    source = PolygonSource(polygon, torch.tensor([2.0, 5.0], dtype=dtype), two_sided=two_sided)
    arrival = source(position, normal)
    e = irradiance(arrival, normal)
    truth = polygon_irradiance(position, normal, polygon, two_sided=two_sided)
    # two roundings more than the exact figure: the cosine's and the product's
    rtol = 3e-12 if dtype == torch.float64 else 1e-6
    assert_close(e, truth[:, None] * torch.tensor([2, 5]), rtol=rtol, atol=1e-12)
    assert bool((truth > 0).any())
    assert_close(arrival.direction.norm(dim=-1), torch.ones(1, 200))


def test_distance_is_where_the_direction_meets_the_panel(generator: torch.Generator) -> None:
    position, normal = receivers(100, generator)
    source = PolygonSource(PANEL, [1.0]).double()
    arrival = source(position, normal)
    lit = arrival.irradiance[0, :, 0] > 1e-9
    hit = position + arrival.distance[0, :, None] * arrival.direction[0]
    assert int(lit.sum()) > 20
    assert_close(hit[lit][:, 2], 2.0)
    assert bool((hit[lit][:, :2].abs() <= 1 + 1e-9).all())
    assert torch.isfinite(arrival.distance).all()


@pytest.mark.parametrize("corners", [PANEL, EL])
@pytest.mark.parametrize("two_sided", [False, True])
def test_samples_converge(corners: list, two_sided: bool, generator: torch.Generator) -> None:
    position, normal = receivers(30, generator)
    position[:, 2] = -1 - position[:, 2].abs() if not two_sided else 4.0
    exact = PolygonSource(corners, [1.0, 3.0], two_sided=two_sided).double()
    truth = irradiance(exact(position, normal), normal)
    errors = []
    for samples in (16, 1024):
        split = PolygonSource(corners, [1.0, 3.0], two_sided=two_sided, samples=samples).double()
        assert split.lights == samples
        e = irradiance(split(position, normal), normal)
        errors.append(float((e - truth).abs().max() / truth.max()))
    assert errors[1] < 3e-3
    assert errors[1] < errors[0] / 4


def test_samples_converge_for_a_glossy_lobe() -> None:
    """sum E_k cos^6 against a fine sum over directions; one row a light cannot know it."""
    source = PolygonSource(PANEL, [1.0], samples=4096).double()
    arrival = source(torch.zeros(1, 3).double(), Z[None])
    lobe = (arrival.irradiance[..., 0] * arrival.direction[..., 2] ** 6).sum()
    rule = hemisphere_quadrature(600, 1200, dtype=torch.float64)
    flat = rule.direction[:, :2] / rule.direction[:, 2:]
    seen = (flat.abs() <= 0.5).all(-1)
    truth = (rule.direction[:, 2] ** 6 * rule.weight * seen).sum()
    assert_close(lobe, truth, rtol=2e-3)


def test_equal_areas_of_one_polygon_fill_it_evenly() -> None:
    """Centre of mass of the samples; every quarter of the panel holds a quarter of them."""
    source = PolygonSource(EL, [1.0], samples=3000).double()
    arrival = source(torch.zeros(1, 3).double(), Z[None])
    point = (arrival.distance[..., None] * arrival.direction)[:, 0]
    assert_close(point.mean(0), torch.tensor([5 / 6, 5 / 6, 1.0]), rtol=2e-3)
    for x, y, part in ((0, 0, 1 / 3), (1, 0, 1 / 3), (0, 1, 1 / 3), (1, 1, 0)):
        inside = (point[:, 0] // 1 == x) & (point[:, 1] // 1 == y)
        assert abs(float(inside.double().mean()) - part) < 0.01


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("two_sided", [False, True])
def test_gradients(samples: int, two_sided: bool, generator: torch.Generator) -> None:
    position = torch.tensor([[0.1, 0.2, 0.0], [0.5, 0.3, 1.5], [1.4, 1.0, 1.3]]).double()
    normal = torch.nn.functional.normalize(
        Z + 0.5 * torch.randn(3, 3, dtype=torch.float64, generator=generator), dim=-1
    )
    source = PolygonSource([PANEL, [[2.0, 0, 0], [2, 1, 0], [2, 1, 1], [2, 0, 1.2]]],
                           [[1.0, 2], [3, 4]], samples=samples, two_sided=two_sided,
                           learnable=True).double()  # fmt: skip
    names = [name for name, _ in source.named_parameters()]
    assert sorted(names) == ["corners", "radiance"]

    def run(x: Tensor, n: Tensor, *held: Tensor) -> tuple[Tensor, ...]:
        parameters = dict(zip(names, held, strict=True))
        return tuple(torch.func.functional_call(source, parameters, (x, n)))

    held = [p.detach().clone().requires_grad_() for p in source.parameters()]
    assert gradcheck(run, (position.requires_grad_(), normal.requires_grad_(), *held))


@pytest.mark.parametrize("samples", [1, 4])
def test_one_panel_per_image(samples: int, generator: torch.Generator) -> None:
    corners = torch.tensor([[PANEL], [PANEL]]).double()
    corners[1, ..., 0] *= 0.5
    radiance = torch.rand(2, 1, 3, dtype=torch.float64, generator=generator)
    position, normal = torch.zeros(2, 5, 3).double(), Z.expand(2, 5, 3)
    together = PolygonSource(corners, radiance, samples=samples)(position, normal)
    assert together.irradiance.shape == (samples, 2, 5, 3)
    for i in range(2):
        alone = PolygonSource(corners[i], radiance[i], samples=samples)(position[i], normal[i])
        for a, b in zip(together, alone, strict=True):
            assert_close(a[:, i], b)


@pytest.mark.parametrize("samples", [1, 5])
def test_finite_in_the_plane_on_a_corner_and_behind(samples: int) -> None:
    source = PolygonSource(PANEL, [1.0], samples=samples, two_sided=True, learnable=True)
    position = torch.tensor([[0.0, 0, 2], [1, 1, 2], [1, 0, 2], [3, 0, 2], [0, 0, 3], [0, 0, 9e9]])
    position.requires_grad_()
    e = irradiance(source(position, Z.float().expand(6, 3)), Z.float())
    e.sum().backward()
    assert torch.isfinite(e).all()
    for tensor in (position, *source.parameters()):
        assert torch.isfinite(tensor.grad).all()


@pytest.mark.parametrize(
    ("corners", "error", "text"),
    [
        ([[0.0, 0, 0], [1, 0, 0]], ShapeError, "at least 3"),
        ([[0.0, 0], [1, 0], [1, 1]], ShapeError, "at least 3"),
        ([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], DegenerateGeometryError, "without area"),
        ([[0.0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], DegenerateGeometryError, "plane"),
        ([[0.0, 0, 0], [1, 0, 0], [1, math.inf, 0]], ValueError, "infinit"),
    ],
)
def test_named_errors(corners: list, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text):
        PolygonSource(corners, [1.0])


def test_named_errors_of_options() -> None:
    with pytest.raises(OutOfRangeError, match="samples"):
        PolygonSource(PANEL, [1.0], samples=0)
    with pytest.raises(OutOfRangeError, match="radiance"):
        PolygonSource(PANEL, [-1.0])
    with pytest.raises(DegenerateGeometryError, match="crosses"):
        PolygonSource([[0.0, 0, 0], [2, 0, 0], [0.2, 1, 0], [1.9, 1.2, 0]], [1.0], samples=2)


def test_samples_still_converge_after_the_corners_moved() -> None:
    """Places keep; each sample's area follows its triangle (an irregular stretch of the panel)."""
    source = PolygonSource(PANEL, [1.0], samples=2000, learnable=True).double()
    moved = torch.tensor([[[1.0, -1, 2], [-1, -1, 2], [-1, 1, 2], [2.5, 3, 2]]]).double()
    position, normal = torch.tensor([[0.3, -0.2, 0.0]]).double(), Z[None]
    arrival = torch.func.functional_call(source, {"corners": moved}, (position, normal))
    truth = polygon_irradiance(position, normal, moved)
    assert_close(irradiance(arrival, normal)[:, 0], truth, rtol=2e-3)
