"""One list a family; every member is run through every test of its family.

A new source, material, layer, solver or ray caster adds one line here; the completeness test
(`tests/contracts/test_completeness.py`) fails until it does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

from torchradiometry import export, geometry, materials, plan, shade, solve, sources, transport
from torchradiometry.numerics import guarded_divide


class Sizes(NamedTuple):
    """Sizes of the axes that stay dynamic in an exported graph."""

    batch: int = 2
    height: int = 3
    width: int = 4
    light: int = 2


SMALL, OTHER = Sizes(), Sizes(3, 5, 2, 4)


def rand(*shape: int, dtype: torch.dtype, seed: int = 0, low: float = 0.1, high: float = 1.0):
    """Reproducible uniform numbers."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(*shape, dtype=dtype, generator=generator) * (high - low) + low


def directions(*shape: int, dtype: torch.dtype, seed: int = 0) -> Tensor:
    """Reproducible unit vectors within about 60 degrees of +z, last axis 3."""
    generator = torch.Generator().manual_seed(seed)
    v = torch.randn(*shape, 3, dtype=dtype, generator=generator) * 0.4
    v[..., 2] = 1
    return v / v.norm(dim=-1, keepdim=True)


class Case(NamedTuple):
    """One member of a family: how to build it, and what to call it with.

    `build(dtype)` gives the module; `inputs(dtype, sizes)` its tensors, in order.
    """

    name: str
    member: object  #: the class or function that this line covers
    build: Callable[[torch.dtype], nn.Module]
    inputs: Callable[[torch.dtype, Sizes], tuple[Tensor, ...]]


def surface_points(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, Tensor]:
    """Positions near the origin and normals about +z, `batch point 3`."""
    points = sizes.height * sizes.width
    position = rand(sizes.batch, points, 3, dtype=dtype, seed=1, low=-0.5, high=0.5)
    return position, directions(sizes.batch, points, dtype=dtype, seed=2)


def surface_directions(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, Tensor, Tensor]:
    """Incident, outgoing and normal directions, `light batch point 3` and `batch point 3`."""
    points = sizes.height * sizes.width
    return (
        directions(sizes.light, sizes.batch, points, dtype=dtype, seed=3),
        directions(sizes.batch, points, dtype=dtype, seed=4),
        directions(sizes.batch, points, dtype=dtype, seed=5) * 0
        + torch.tensor([0, 0, 1.0]).to(dtype),
    )


class First(nn.Module):
    """One of the outputs of a layer."""

    def __init__(self, layer: nn.Module, place: int = 0) -> None:
        super().__init__()
        self.layer, self.place = layer, place

    def forward(self, *tensors: Tensor) -> Tensor:
        return self.layer(*tensors)[self.place]


class Named(nn.Module):
    """A layer called with tensors in order; their names are `input_names`."""

    def __init__(self, layer: nn.Module, *names: str) -> None:
        super().__init__()
        self.layer, self.input_names = layer, names

    def forward(self, *tensors: Tensor) -> Tensor:
        return self.layer(**dict(zip(self.input_names, tensors, strict=True)))


def images(*names: str, light: int | None = None) -> Callable[[torch.dtype, Sizes], tuple]:
    """Image inputs by name: maps of normals, albedo, positions, visibility ...

    `light` fixes the light axis of the visibility where the lights are in the layer.
    """

    def make(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, ...]:
        b, h, w = sizes.batch, sizes.height, sizes.width
        lights = light or sizes.light
        every = {
            "normal": directions(b, h, w, dtype=dtype, seed=41).permute(0, 3, 1, 2).contiguous(),
            "albedo": rand(b, 3, h, w, dtype=dtype, seed=42),
            "position": rand(b, 3, h, w, dtype=dtype, seed=43, low=-0.5, high=0.5),
            "visibility": rand(b, lights, h, w, dtype=dtype, seed=44),
            "occlusion": rand(b, 1, h, w, dtype=dtype, seed=45),
            "specular": rand(b, 3, h, w, dtype=dtype, seed=46),
            "shininess": rand(b, 1, h, w, dtype=dtype, seed=47, low=3, high=9),
            "radiance": rand(b, 3, dtype=dtype, seed=48),
            "source_direction": directions(lights, dtype=dtype, seed=49),
            "source_position": directions(lights, dtype=dtype, seed=50) * 2,
            "source_irradiance": rand(lights, 3, dtype=dtype, seed=51),
            "source_intensity": rand(lights, 3, dtype=dtype, seed=52),
        }
        return tuple(every[name] for name in names)

    return make


def depth_maps(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, Tensor]:
    """Depth in m, `batch 1 height width`, and intrinsics `batch 3 3`."""
    depth = rand(sizes.batch, 1, sizes.height, sizes.width, dtype=dtype, seed=71, low=2, high=3)
    matrix = torch.tensor([[5, 0, sizes.width / 2], [0, 5, sizes.height / 2], [0, 0, 1]])
    return depth, matrix.to(dtype).expand(sizes.batch, 3, 3).contiguous()


def reliefs(*names: str) -> Callable[[torch.dtype, Sizes], tuple]:
    """A depth map with slopes around 45 degrees for pixels of 0.1 m, and maps by name beside it."""

    def make(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, ...]:
        depth = rand(
            sizes.batch, 1, sizes.height, sizes.width, dtype=dtype, seed=72, low=2, high=2.2
        )
        matrix = torch.tensor([[22, 0, sizes.width / 2], [0, 21, sizes.height / 2], [0, 0, 1]])
        every = {"intrinsics": matrix.to(dtype).expand(sizes.batch, 3, 3).contiguous()}
        every["irradiance"] = rand(sizes.batch, 3, sizes.height, sizes.width, dtype=dtype, seed=73)
        found = (every[n] if n in every else images(n)(dtype, sizes)[0] for n in names)
        return depth, *found

    return make


def triangles(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor]:
    """Scattered triangles `patch 3 3` in m that see each other here and there."""
    return (rand(sizes.height * sizes.width, 3, 3, dtype=dtype, seed=81),)


def enclosure(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, Tensor, Tensor]:
    """Albedo and exitance `batch patch 3` and closed form factors `patch patch`."""
    patches = sizes.height * sizes.width
    factors = rand(patches, patches, dtype=dtype, seed=54)
    return (
        rand(sizes.batch, patches, 3, dtype=dtype, seed=55, high=0.8),
        rand(sizes.batch, patches, 3, dtype=dtype, seed=56),
        factors / factors.sum(-1, keepdim=True),
    )


class ClosedRoom(nn.Module):
    """A `RadiosityShading` of a closed reciprocal room made from any positive matrix.

    H = W + W^T are exchange areas in m2; each area is the sum of its row, so all rows of F are
    closed, and a change of W keeps the room reciprocal.
    """

    def __init__(self, solver: solve.AbstractSolver, adjoint: solve.AbstractAdjoint | None = None):
        super().__init__()
        self.layer = shade.RadiosityShading(solver=solver, adjoint=adjoint)

    @staticmethod
    def operator(weights: Tensor) -> solve.DenseOperator:
        exchange = weights + weights.mT
        area = exchange.sum(-1)
        return solve.DenseOperator(guarded_divide(exchange, area.unsqueeze(-1)), area)

    def forward(self, albedo: Tensor, exitance: Tensor, form_factors: Tensor) -> Tensor:
        return self.layer(albedo, exitance, self.operator(form_factors))


def source(name: str, dtype: torch.dtype) -> nn.Module:
    """The source of that name in `SOURCES`."""
    return next(case for case in SOURCES if case.name == name).build(dtype)


def lambertian_case(kind: str, *extra: str, light: int | None = None) -> Case:
    names = ("normal", "albedo", *extra)
    return Case(
        f"lambertian_{kind}",
        shade.LambertianShading,
        lambda t: Named(shade.LambertianShading(_sources(kind, t)), *names),
        images(*names, light=light),
    )


def phong_case(kind: str, lobe: type, *extra: str, **options: bool) -> Case:
    names = ("normal", "albedo", "specular", "shininess", *extra)
    return Case(
        f"{lobe.__name__.lower()}_{kind}",
        shade.PhongShading,
        lambda t: Named(shade.PhongShading(lobe, _sources(kind, t), **options), *names),
        images(*names, light=6),
    )


def _sources(kind: str, dtype: torch.dtype) -> list[nn.Module]:
    kinds = ("directional", "point", "dome") if kind == "mixed" else (kind,)
    return [source(name, dtype) for name in kinds]


def lights_as_inputs(build: Callable[[nn.Module], nn.Module], kind: str, *names: str) -> Case:
    """A layer whose lights are inputs, so that their number is dynamic too."""
    tensors = {"directional": ("direction", "irradiance"), "point": ("position", "intensity")}
    light_names = [f"source_{name}" for name in tensors[kind]]
    return Case(
        f"{kind}_lights_as_inputs",
        export.SourcesAsInputs,
        lambda t: export.SourcesAsInputs(build(source(kind, t)), names),
        images(*names, *light_names),
    )


# fmt: off
SOURCES = [
    Case("directional", sources.DirectionalSource, lambda t: sources.DirectionalSource(directions(2, dtype=t, seed=6), rand(2, 3, dtype=t, seed=7)), surface_points),
    Case("point", sources.PointSource, lambda t: sources.PointSource(directions(2, dtype=t, seed=21) * 2, rand(2, 3, dtype=t, seed=22)), surface_points),
    Case("spot", sources.SpotSource, lambda t: sources.SpotSource(directions(2, dtype=t, seed=23) * 2, -directions(2, dtype=t, seed=23), rand(2, 3, dtype=t, seed=24), rand(2, 1, dtype=t, high=0.2), rand(2, 1, dtype=t, low=0.4)), surface_points),
    Case("sphere", sources.SphereSource, lambda t: sources.SphereSource(directions(2, dtype=t, seed=61) * 2, rand(2, 1, dtype=t, seed=62), rand(2, 3, dtype=t, seed=63)), surface_points),
    Case("sphere_samples", sources.SphereSource, lambda t: sources.SphereSource(directions(2, dtype=t, seed=61) * 2, rand(2, 1, dtype=t, seed=62), rand(2, 3, dtype=t, seed=63), samples=5), surface_points),
    Case("polygon", sources.PolygonSource, lambda t: sources.PolygonSource(torch.tensor([[[-1, -1, 2], [-1, 1, 2], [1, 1, 2], [1, -1, 2]], [[1.2, 0, -1], [1.2, 1, -1], [1.2, 0, 1], [1.2, -1, 2]]], dtype=t), rand(2, 3, dtype=t, seed=64), two_sided=True), surface_points),
    Case("polygon_samples", sources.PolygonSource, lambda t: sources.PolygonSource(torch.tensor([[-1, -1, 2], [-1, 1, 2], [1, 1, 2], [1, -1, 2]], dtype=t), rand(1, 3, dtype=t, seed=64), samples=4), surface_points),
    Case("dome", sources.AmbientDome, lambda t: sources.AmbientDome(rand(2, 3, dtype=t, seed=65)), surface_points),
    Case("half_dome", sources.AmbientDome, lambda t: sources.AmbientDome(rand(2, 3, dtype=t, seed=65), up=directions(2, dtype=t, seed=66)), surface_points),
    Case("harmonics", sources.HarmonicSource, lambda t: sources.HarmonicSource(rand(2, 9, 3, dtype=t, seed=67, low=0, high=0.3)), surface_points),
]

MATERIALS = [
    Case("lambertian", materials.Lambertian, lambda t: materials.Lambertian(rand(3, dtype=t, seed=8)), surface_directions),
    Case("phong", materials.Phong, lambda t: materials.Phong(rand(3, dtype=t, seed=31), rand(1, dtype=t, low=3, high=9)), surface_directions),
    Case("normalized_phong", materials.NormalizedPhong, lambda t: materials.NormalizedPhong(rand(3, dtype=t, seed=32), rand(1, dtype=t, low=3, high=9)), surface_directions),
    Case("original_phong", materials.OriginalPhong, lambda t: materials.OriginalPhong(rand(3, dtype=t, seed=33), rand(1, dtype=t, low=3, high=9)), surface_directions),
    Case("oren_nayar", materials.OrenNayar, lambda t: materials.OrenNayar(rand(3, dtype=t, seed=36), rand(1, dtype=t, seed=37)), surface_directions),
    Case("microfacet", materials.Microfacet, lambda t: materials.Microfacet(rand(3, dtype=t, seed=38), rand(1, dtype=t, low=0.1, high=0.9)), surface_directions),
    Case("blinn_phong", materials.BlinnPhong, lambda t: materials.BlinnPhong(rand(3, dtype=t, seed=34), rand(1, dtype=t, low=3, high=9)), surface_directions),
    Case("sum_material", materials.SumMaterial, lambda t: materials.SumMaterial([materials.Lambertian(rand(3, dtype=t, seed=35)), materials.Phong(0.2, 5.0)]).to(t), surface_directions),
    Case("lambertian_specular", materials.LambertianSpecular, lambda t: materials.LambertianSpecular(rand(3, dtype=t, high=0.5), rand(3, dtype=t, high=0.5), rand(1, dtype=t, low=3, high=9)), surface_directions),
]

LAYERS: list[Case] = [
    lambertian_case("directional"),
    lambertian_case("point", "position"),
    lambertian_case("spot", "position"),
    lambertian_case("sphere", "position"),
    lambertian_case("polygon", "position"),
    lambertian_case("half_dome"),
    lambertian_case("harmonics"),
    lambertian_case("mixed", "position", "visibility", light=6),
    phong_case("directional", materials.Phong),
    phong_case("mixed", materials.Phong, "position", "visibility", perspective=True),
    phong_case("point", materials.NormalizedPhong, "position"),
    phong_case("directional", materials.OriginalPhong),
    phong_case("directional", materials.BlinnPhong),
    phong_case("sphere", materials.BlinnPhong, "position"),
    Case("ambient", shade.AmbientShading, lambda t: Named(shade.AmbientShading(), "albedo", "radiance", "visibility"), images("albedo", "radiance", "occlusion")),
    Case("ambient_harmonics", shade.AmbientShading, lambda t: Named(shade.AmbientShading(sources=source("harmonics", t)), "albedo", "normal"), images("albedo", "normal")),
    Case("point_shading", shade.PointShading, lambda t: shade.PointShading(MATERIALS[-1].build(t), _sources("mixed", t)), lambda t, sizes: (*surface_points(t, sizes), directions(sizes.batch, sizes.height * sizes.width, dtype=t, seed=53))),
    Case("radiosity", shade.RadiosityShading, lambda t: shade.RadiosityShading(solver=solve.Neumann(2)), enclosure),
    lights_as_inputs(shade.LambertianShading, "directional", "normal", "albedo", "visibility"),
    lights_as_inputs(lambda s: shade.PhongShading(sources=s), "point", "normal", "albedo", "specular", "shininess", "position"),
    Case("depth_to_points", geometry.DepthToPoints, lambda t: geometry.DepthToPoints(), depth_maps),
    Case("depth_to_points_parallel", geometry.DepthToPoints, lambda t: geometry.DepthToPoints(0.01), lambda t, sizes: depth_maps(t, sizes)[:1]),
    Case("depth_to_normals", geometry.DepthToNormals, lambda t: geometry.DepthToNormals(), depth_maps),
    Case("ambient_occlusion", shade.AmbientOcclusion, lambda t: First(shade.AmbientOcclusion(4, 3)), reliefs("intrinsics")),
    Case("interreflection_bounces", shade.InterreflectionShading, lambda t: Named(shade.InterreflectionShading(2, 3, tail=True, azimuths=4, fine=1), "depth", "albedo", "irradiance", "intrinsics"), reliefs("albedo", "irradiance", "intrinsics")),
    # cast shadows with a width are in shade_depth; hard ones have a test of their own
    Case("shade_depth", shade.ShadeDepth, lambda t: Named(shade.ShadeDepth(shade.DepthSettings(shadow_width=0.3, cells=2, azimuths=4, reach=1), [source("directional", t), source("dome", t)], pixel_size=0.1), "depth", "albedo"), reliefs("albedo")),
    Case("depth_to_normals_parallel", geometry.DepthToNormals, lambda t: geometry.DepthToNormals(0.01), lambda t, sizes: depth_maps(t, sizes)[:1]),
]

SOLVERS: list[Case] = [
    Case("neumann", solve.Neumann, lambda t: ClosedRoom(solve.Neumann(5)), enclosure),
    Case("neumann_tail", solve.Neumann, lambda t: ClosedRoom(solve.Neumann(3, ambient_tail=True)), enclosure),
    Case("adaptive_neumann", solve.AdaptiveNeumann, lambda t: ClosedRoom(solve.AdaptiveNeumann(1e-9)), enclosure),
    Case("gauss_seidel", solve.GaussSeidel, lambda t: ClosedRoom(solve.GaussSeidel()), enclosure),
    Case("southwell", solve.Southwell, lambda t: ClosedRoom(solve.Southwell(at_once=2)), enclosure),
    Case("conjugate_gradient", solve.ConjugateGradient, lambda t: ClosedRoom(solve.ConjugateGradient()), enclosure),
    Case("direct", solve.Direct, lambda t: ClosedRoom(solve.Direct()), enclosure),
]

ADJOINTS: list[Case] = [
    Case("unrolled", solve.Unrolled, lambda t: ClosedRoom(solve.Neumann(5), solve.Unrolled()), enclosure),
    Case("unrolled_checkpoint", solve.Unrolled, lambda t: ClosedRoom(solve.Neumann(5, ambient_tail=True), solve.Unrolled(checkpoint=2)), enclosure),
    Case("implicit", solve.Implicit, lambda t: ClosedRoom(solve.ConjugateGradient(), solve.Implicit()), enclosure),
    Case("implicit_direct", solve.Implicit, lambda t: ClosedRoom(solve.GaussSeidel(), solve.Implicit(solve.Direct())), enclosure),
    Case("truncated", solve.Truncated, lambda t: ClosedRoom(solve.ConjugateGradient(), solve.Truncated(200)), enclosure),
]

TRANSPORT: list[Case] = [
    Case("unoccluded_form_factors", transport.UnoccludedFormFactors, lambda t: transport.UnoccludedFormFactors(6), triangles),
]

EFFECTS: list[object] = [
    plan.CastShadows,
    plan.ColourBleeding,
    plan.FallOff,
    plan.Interreflection,
    plan.PatchSize,
    plan.Penumbra,
    plan.SourceExtent,
    plan.SpecularLobe,
    plan.Supersampling,
]

RAY_CASTERS: list[object] = [
    transport.BruteForceRays,
    transport.EmbreeRays,
]
# fmt: on
