"""RadiosityShading: closed forms on geometry, and static mistakes by name."""

import pytest
import torch
import trimesh

from tests.tolerances import assert_close
from torchradiometry import errors, shade, solve, transport
from torchradiometry.errors import NotConvergedWarning
from torchradiometry.geometry.patches import Patches, subdivide


def inside(mesh: trimesh.Trimesh) -> Patches:
    return Patches(torch.tensor(mesh.triangles.copy(), dtype=torch.float64).flip(1))


@pytest.mark.parametrize("albedo", [0.0, 0.5, 0.9])
def test_integrating_sphere(albedo: float) -> None:
    """Uniform exitance on the inside of a sphere: B = M / (1 - rho) everywhere."""
    patches = inside(trimesh.creation.icosphere(subdivisions=2))
    layer = shade.RadiosityShading(transport.form_factors(patches, closed=True), solve.Direct())
    rho = torch.full((patches.count, 1), albedo, dtype=torch.float64)
    assert_close(layer(rho, torch.ones_like(rho)), 1 / (1 - albedo))


def test_a_lamp_in_a_sphere_makes_uniform_irradiance() -> None:
    """Flux from one facet: its reflections light every facet alike, rho / (1 - rho) M A / S."""
    patches = inside(trimesh.creation.icosphere(subdivisions=2))
    layer = shade.RadiosityShading(transport.form_factors(patches, closed=True), solve.Direct())
    rho = torch.full((patches.count, 1), 0.8, dtype=torch.float64)
    exitance = torch.zeros_like(rho)
    exitance[0] = 1
    reflected = layer(rho, exitance) - exitance
    uniform = 0.8 / 0.2 * patches.area[0] / patches.area.sum()
    # a flat facet does not see itself, and hardly its neighbours; 320 facets are no sphere
    distant = patches.normal @ patches.normal[0] < 0.8
    assert_close(reflected[distant], uniform.expand_as(reflected[distant]), rtol=0.03)
    power = (patches.area.unsqueeze(-1) * (1 - rho) * reflected / rho).sum()
    assert_close(power, patches.area[0])


def test_furnace_in_a_cube() -> None:
    patches = subdivide(inside(trimesh.creation.box((1, 2, 3))), 1.0)[0]
    factors = transport.form_factors(patches, closed=True)
    generator = torch.Generator().manual_seed(3)
    albedo = torch.rand(patches.count, 3, dtype=torch.float64, generator=generator)
    layer = shade.RadiosityShading(factors, solve.Direct())
    assert_close(layer(albedo, 1 - albedo), 1.0)


def test_form_factors_move_with_the_module() -> None:
    layer = shade.RadiosityShading(torch.eye(3)).to(torch.float64)
    assert layer.form_factors.dtype == torch.float64
    assert "form_factors" in layer.state_dict()
    assert "patches=3" in repr(layer)
    dense = solve.DenseOperator(torch.eye(3), torch.ones(3))
    layer = shade.RadiosityShading(dense).to(torch.float64)
    assert set(layer.state_dict()) == {"form_factors", "area"}
    assert layer.operator.exchange(torch.ones(3, 1).double()).dtype == torch.float64


def test_operators_solvers_and_adjoints_are_interchangeable() -> None:
    """A dense matrix, an operator and a callable; gradients by every default."""
    patches = subdivide(inside(trimesh.creation.box((1, 2, 3))), 1.5)[0]
    factors = transport.form_factors(patches, closed=True)
    area = patches.area
    dense = solve.DenseOperator(factors, area)
    free = solve.MatrixFreeOperator(dense.exchange, area)
    generator = torch.Generator().manual_seed(3)
    albedo = torch.rand(patches.count, 3, dtype=torch.float64, generator=generator) * 0.9
    albedo.requires_grad_()
    exitance = torch.rand(patches.count, 3, dtype=torch.float64, generator=generator)
    exact = shade.RadiosityShading(factors, solve.Direct())(albedo, exitance)
    gradient = torch.autograd.grad(exact.square().sum(), albedo)[0]
    exact = exact.detach()
    for held, solver in (
        (dense, solve.ConjugateGradient()),
        (free, solve.ConjugateGradient()),
        (free, solve.GaussSeidel()),
        (free, solve.Southwell()),
        (factors, solve.AdaptiveNeumann(1e-12)),
    ):
        layer = shade.RadiosityShading(held, solver)
        assert isinstance(layer.adjoint, solve.Implicit)
        found = layer(albedo, exitance)
        assert_close(found, exact, rtol=1e-10)
        assert_close(torch.autograd.grad(found.square().sum(), albedo)[0], gradient, rtol=1e-9)
        assert_close(
            shade.RadiosityShading(None, solver)(albedo, exitance, held), exact, rtol=1e-10
        )
    assert isinstance(shade.RadiosityShading(factors).adjoint, solve.Unrolled)


def test_static_mistakes_are_named() -> None:
    albedo = torch.rand(3, 1)
    with pytest.raises(errors.ShapeError, match="receiver emitter"):
        shade.RadiosityShading(torch.rand(3, 4))
    with pytest.raises(errors.ShapeError, match="pass them here"):
        shade.RadiosityShading()(albedo, albedo)
    with pytest.raises(errors.ShapeError, match="patch channel"):
        shade.RadiosityShading(torch.eye(3))(albedo[:, 0], albedo)


def test_a_solver_that_stops_early_warns_and_says_so_in_its_status() -> None:
    factors = torch.full((3, 3), 1 / 3, dtype=torch.float64)
    bright, light = torch.full((3, 1), 0.9).double(), torch.tensor([[1.0], [0], [0]]).double()
    layer = shade.RadiosityShading(factors, solve.Southwell(max_shots=1, at_once=1))
    with pytest.warns(NotConvergedWarning, match="Southwell: got an error of up to"):
        found = layer(bright, light)
    solution = layer.solution(bright, light)
    assert (solution.status == solve.Status.NOT_CONVERGED).all()
    assert torch.equal(found, solution.radiosity)
    shade.RadiosityShading(factors, solve.Direct())(bright, light)  # warnings are errors here
