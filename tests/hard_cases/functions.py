"""The free functions of the public API that take tensors, as a family beside those of `cases.py`.

One line a function: its arguments as shapes of easy numbers, and a call where it takes more than
tensors (indices, patches, sources) or gives more than tensors. `ELSEWHERE` names what other lists
or tests bring to its edge; what is in neither is a failing test.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import torch
from torch import Tensor

import torchradiometry
from tests.cases import Case, Named, Sizes, directions, rand
from torchradiometry import geometry, materials, shade, solve, sources, transport
from torchradiometry.geometry import Patches
from torchradiometry.numerics import guarded_divide

#: numbers of a dtype, for axes of these sizes, from this seed
Numbers = Callable[[torch.dtype, Sizes, int], Tensor]


def shape(axes: tuple[str | int, ...], sizes: Sizes) -> list[int]:
    """Axes by name (those of `Sizes`, and `point`, one for each pixel) or by size."""
    known = sizes._asdict() | {"point": sizes.height * sizes.width}
    return [known[a] if isinstance(a, str) else a for a in axes]


def unit(*axes: str | int) -> Numbers:
    return lambda dtype, sizes, seed: directions(*shape(axes, sizes), dtype=dtype, seed=seed)


def real(*axes: str | int, low: float = 0.1, high: float = 1.0) -> Numbers:
    return lambda dtype, sizes, seed: rand(
        *shape(axes, sizes), dtype=dtype, seed=seed, low=low, high=high
    )


def near(values: list, *axes: str | int, noise: float = 0.0) -> Numbers:
    """These numbers (a corner list, a matrix) for every entry of the axes, a little apart."""

    def make(dtype: torch.dtype, sizes: Sizes, seed: int) -> Tensor:
        base = torch.tensor(values, dtype=dtype)
        spread = rand(*shape(axes, sizes), *base.shape, dtype=dtype, seed=seed, low=-1)
        return base + noise * spread

    return make


def unit_map(*axes: str | int) -> Numbers:
    """An image of unit vectors, `B 3 H W`."""
    return lambda dtype, sizes, seed: (
        directions(*shape(axes, sizes), dtype=dtype, seed=seed).movedim(-1, 1).contiguous()
    )


def symmetric(dtype: torch.dtype, sizes: Sizes, seed: int) -> Tensor:
    """Exchange areas of a closed room, m2."""
    patches = sizes.height * sizes.width
    weight = rand(patches, patches, dtype=dtype, seed=seed)
    return weight + weight.mT


def function(name: str, call: Callable | None = None, /, **arguments: Numbers) -> Case:
    """A free function by its public name, called by name with tensors."""
    member = reduce(getattr, name.split("."), torchradiometry)
    made = call or member

    def inputs(dtype: torch.dtype, sizes: Sizes) -> tuple[Tensor, ...]:
        return tuple(n(dtype, sizes, 100 + i) for i, n in enumerate(arguments.values()))

    return Case(name, member, lambda dtype: Named(made, *arguments), inputs)


def faces(count: int) -> Tensor:
    """Triangles of neighbouring vertices."""
    first = torch.arange(max(count - 2, 0))
    return torch.stack((first, first + 1, first + 2), 1)


def on_mesh(of: Callable[[Tensor, Tensor], Tensor]) -> Callable[[Tensor], Tensor]:
    return lambda vertices: of(vertices, faces(vertices.shape[0] if vertices.ndim else 0))


def in_pairs(count: int) -> tuple[Tensor, Tensor]:
    """Each patch and the next."""
    return torch.arange(count), torch.arange(count).roll(1)


def held_dtype(dtype: torch.dtype) -> torch.dtype:
    """What a module beside tensors of this dtype holds: no integers."""
    return dtype if dtype.is_floating_point else torch.float32


def lit(dtype: torch.dtype) -> list[sources.AbstractSource]:
    """Two lights whose numbers every dtype holds."""
    sun = sources.DirectionalSource([0.25, -0.5, 1.0], [1.0, 0.5, 2.0])
    lamp = sources.PointSource([0.25, 0.5, 2.0], [2.0, 1.0, 0.5])
    return [sun.to(held_dtype(dtype)), lamp.to(held_dtype(dtype))]


def glossy(dtype: torch.dtype) -> materials.AbstractMaterial:
    return materials.LambertianSpecular(0.25, 0.125, 4.0).to(held_dtype(dtype))


def arrived(direction: Tensor, irradiance: Tensor, normal: Tensor) -> Tensor:
    distance = torch.ones_like(direction[..., 0])
    return sources.irradiance(sources.Arrival(direction, irradiance, distance), normal)


def operator(form_factors: Tensor) -> solve.DenseOperator:
    """A closed reciprocal room made from any positive matrix."""
    exchange = form_factors + form_factors.mT
    area = exchange.sum(-1)
    return solve.DenseOperator(guarded_divide(exchange, area.unsqueeze(-1)), area)


def solved(albedo: Tensor, exitance: Tensor, form_factors: Tensor) -> Tensor:
    return solve.solve_radiosity(operator(form_factors), albedo, exitance).radiosity


def counted(found: Tensor) -> Tensor:
    """Truth values as numbers."""
    return found.to(torch.int64)


P = ("batch", "point")
IMAGE = ("batch", 3, "height", "width")
ONE = ("batch", 1, "height", "width")
SQUARE = [[-1.0, -1, 2], [-1, 1, 2], [1, 1, 2], [1, -1, 2]]
TRIANGLE = [[-1.0, -1, 2], [-1, 1, 2], [1, 1, 2]]
SCREEN = [[0.0, -9, 1], [9, -9, 1], [9, 9, 1], [0, 9, 1]]
FLOOR = [[-1.0, -1, 0], [1, -1, 0], [1, 1, 0]]
CEILING = [[1.0, 1, 2], [1, -1, 2], [-1, -1, 2]]
FACING = near([FLOOR, CEILING], noise=0.1)
ROOM = {
    "albedo": real("batch", "point", 3, high=0.8),
    "exitance": real("batch", "point", 3),
    "form_factors": real("point", "point"),
}

# fmt: off
FUNCTIONS = [
    function("quantities.flux_from_intensity", radiant_intensity=real(*P)),
    function("quantities.intensity_from_flux", radiant_flux=real(*P)),
    function("quantities.radiance_from_radiosity", radiosity=real(*P)),
    function("quantities.radiosity_from_radiance", radiance=real(*P)),
    function("geometry.Patches", lambda corners: (Patches(corners).area, Patches(corners).normal, Patches(corners).centroid), corners=near(TRIANGLE, "point", noise=0.5)),
    function("geometry.clip_polygon", polygon=near(SQUARE, *P, noise=0.1), height=real(*P, 4, low=-1)),
    function("geometry.corner_angles", corners=near(TRIANGLE, *P, noise=0.1)),
    function("geometry.face_areas", on_mesh(geometry.face_areas), vertices=real("point", 3)),
    function("geometry.face_corners", on_mesh(geometry.face_corners), vertices=real("point", 3)),
    function("geometry.face_normals", on_mesh(geometry.face_normals), vertices=real("point", 3)),
    function("geometry.vertex_normals", on_mesh(geometry.vertex_normals), vertices=real("point", 3)),
    function("geometry.integrate_hemisphere", lambda weight: geometry.integrate_hemisphere(lambda w: w[..., 2], geometry.HemisphereQuadrature(geometry.hemisphere_quadrature(2, 2, weight.dtype).direction, weight)), weight=real(4)),
    function("geometry.local_frame", normal=unit(*P)),
    function("geometry.look_at", eye=real(3, low=2, high=3), target=real(3), up=unit()),
    function("geometry.normals_to_heights", lambda normal: geometry.normals_to_heights(normal).height, normal=unit_map("batch", "height", "width")),
    function("geometry.points_to_normals", points=real(*IMAGE)),
    function("geometry.polygon_irradiance", position=real(*P, 3, low=-0.5, high=0.5), normal=unit(*P), polygon=near(SQUARE, *P)),
    function("geometry.polygon_vector_irradiance", position=real(*P, 3, low=-0.5, high=0.5), normal=unit(*P), polygon=near(SQUARE, *P)),
    function("geometry.reflect", direction=unit(*P), normal=unit(*P)),
    function("geometry.rigid", matrix=near(torch.eye(4).tolist(), noise=1e-4)),
    function("geometry.solid_angle_cone", half_angle=real(*P)),
    function("geometry.solid_angle_patch", area=real(*P), cosine=real(*P), distance=real(*P)),
    function("geometry.solid_angle_polygon", position=real(*P, 3, low=-0.5, high=0.5), polygon=near(SQUARE, *P)),
    function("geometry.solid_angle_triangle", position=real(*P, 3, low=-0.5, high=0.5), triangle=near(TRIANGLE, *P, noise=0.1)),
    function("geometry.solid_angle_sphere", distance=real(*P, low=2, high=3), radius=real(*P)),
    function("geometry.spherical_direction", polar=real(*P), azimuth=real(*P)),
    function("geometry.subdivide", lambda corners: geometry.subdivide(Patches(corners), 1e300)[0].corners, corners=near(TRIANGLE, "point", noise=0.1)),
    function("geometry.triangulate_polygon", polygon=near(SQUARE)),
    function("geometry.vector_area", corners=near(SQUARE, *P, noise=0.1)),
    function("sources.arrive", lambda position, normal: tuple(sources.arrive(lit(normal.dtype), position, normal))[:2], position=real(*P, 3, low=-0.5, high=0.5), normal=unit(*P)),
    function("sources.arriving_irradiance", lambda position, normal, visibility: sources.arriving_irradiance(lit(normal.dtype), position, normal, visibility), position=real(*P, 3, low=-0.5, high=0.5), normal=unit(*P), visibility=real(2, *P)),
    function("sources.cone_attenuation", direction=unit(*P), axis=unit(*P), inner_cone=real(*P, low=0.1, high=0.2), outer_cone=real(*P, low=0.4)),
    function("sources.directional_irradiance", direction=unit("batch", "light"), irradiance=real("batch", "light", 3), normal=unit(*P)),
    function("sources.harmonic_basis", direction=unit(*P)),
    function("sources.irradiance", arrived, direction=unit("light", *P), irradiance=real("light", *P, 3), normal=unit(*P)),
    function("sources.sphere_vector_irradiance", offset=real(*P, 3, low=1, high=2), normal=unit(*P), radius=real(*P)),
    function("sources.project_harmonics", direction=unit("point"), radiance=real("batch", "point", 3), weight=real("point")),
    function("materials.mean_lobe_reflectance", shininess=real(*P, 1, low=3, high=9)),
    function("materials.mirror_direction", incident_direction=unit(*P), normal=unit(*P)),
    function("materials.lambertian_specular_reflectance", lambda albedo: materials.lambertian_specular_reflectance(albedo, materials.NormalizedPhong(0.25, 4.0).to(held_dtype(albedo.dtype))), albedo=real(*P, 3)),
    function("transport.cap_rows", exchange=symmetric, area=real("point", low=3, high=4)),
    function("transport.close_enclosure", exchange=symmetric, area=real("point", low=3, high=4)),
    function("transport.convex_blockers", triangles=near(TRIANGLE, "point", noise=0.1)),
    function("transport.certain_pairs", lambda corners, blockers: tuple(counted(t) for t in transport.certain_pairs(Patches(corners), blockers, *in_pairs(len(corners)))), corners=real("point", 3, 3), blockers=near(SCREEN, 1)),
    function("transport.exchange_areas", lambda corners: transport.exchange_areas(Patches(corners)), corners=FACING),
    function("transport.form_factors", lambda corners: transport.form_factors(Patches(corners), transport.BruteForceRays(corners)), corners=FACING),
    function("transport.occluded_exchange", lambda first, second, blockers: transport.occluded_exchange(first, second, blockers).exchange, first=near(FLOOR, 1, noise=0.1), second=near(CEILING, 1, noise=0.1), blockers=near(SCREEN[:3], 1)),
    function("transport.polygon_exchange", first=near(FLOOR, "point", noise=0.1), second=near(CEILING, "point", noise=0.1)),
    function("transport.unoccluded_exchange", lambda corners: transport.unoccluded_exchange(Patches(corners)), corners=FACING),
    function("transport.pair_visibility", lambda corners, blockers: transport.pair_visibility(Patches(corners), transport.BruteForceRays(blockers), *in_pairs(len(corners))).visibility, corners=real("point", 3, 3), blockers=near(SCREEN[:3], 1)),
    function("transport.height_field_hits", lambda height, direction: transport.height_field_hits(height, direction), height=real("batch", "height", "width"), direction=unit("light")),
    function("transport.height_field_visibility", height=real("batch", "height", "width"), direction=unit("batch", "light")),
    function("transport.patch_points", lambda corners: tuple(transport.patch_points(corners, 2)), corners=real("point", 3, 3)),
    function("transport.possible_blockers", lambda corners, points: counted(transport.possible_blockers(corners, points, 0.0)), corners=near(SCREEN, 2), points=real("point", 3)),
    function("transport.sample_patches", corners=near(TRIANGLE, *P, noise=0.1), where=real(*P, 2)),
    function("transport.visible_irradiance", position=real(*P, 3, low=-0.5, high=0.5), normal=unit(*P), polygon=near(SQUARE, *P), blockers=near(SCREEN, 1)),
    function("transport.visible_polygon", lambda position, polygon, blockers: torch.zeros_like(position).index_add(0, (parts := transport.visible_polygon(position, polygon, blockers)).view, geometry.vector_area(parts.corners).to(position.dtype)), position=real("point", 3, low=-0.5, high=0.5), polygon=near(SQUARE, "point"), blockers=near(SCREEN, 1)),
    function("solve.ambient_tail", lambda albedo, rest, form_factors: solve.ambient_tail(operator(form_factors), albedo, rest), albedo=ROOM["albedo"], rest=ROOM["exitance"], form_factors=ROOM["form_factors"]),
    function("solve.as_operator", lambda form_factors, radiosity: solve.as_operator(form_factors)(radiosity), form_factors=real("point", "point"), radiosity=real("batch", "point", 3)),
    function("solve.bounce_series", lambda albedo, exitance, form_factors: tuple(solve.bounce_series(operator(form_factors), albedo, exitance, 2)), **ROOM),
    function("solve.neumann_series", lambda albedo, exitance, form_factors: solve.neumann_series(operator(form_factors), albedo, exitance, 2), **ROOM),
    function("solve.certified", lambda albedo, exitance, form_factors, radiosity: solve.certified(operator(form_factors), albedo, exitance, radiosity)[:2], **ROOM, radiosity=real("batch", "point", 3)),
    function("solve.inverse_norm", lambda albedo, above, form_factors: solve.inverse_norm(operator(form_factors), albedo, above), albedo=ROOM["albedo"], above=real("batch", "point", 3, low=5, high=6), form_factors=ROOM["form_factors"]),
    function("solve.separate_bounces", lambda albedo, exitance, form_factors: solve.separate_bounces(solve.solve_radiosity(operator(form_factors), albedo, exitance), operator(form_factors), albedo, exitance, 2).bounces, **ROOM),
    function("solve.solve_radiosity", solved, **ROOM),
    function("shade.cast_shadows", lambda depth: shade.cast_shadows(depth, lit(depth.dtype)[:1], pixel_size=0.1, width=0.3), depth=real(*ONE, low=2, high=2.2)),
    function("shade.image_irradiance", lambda normal, position: shade.image_irradiance(normal, lit(normal.dtype), position), normal=unit_map("batch", "height", "width"), position=real(*IMAGE, low=-0.5, high=0.5)),
    function("shade.shade_points", lambda position, normal, outgoing_direction: shade.shade_points(glossy(normal.dtype), lit(normal.dtype), position, normal, outgoing_direction), position=real(*P, 3, low=-0.5, high=0.5), normal=unit(*P), outgoing_direction=unit(*P)),
    function("shade.view_directions", lambda normal, position: shade.view_directions(normal, position, perspective=True), normal=unit_map("batch", "height", "width"), position=real(*IMAGE, low=-3, high=-2)),
    function("shade.to_points", image=real(*IMAGE)),
    function("shade.to_image", points=real("batch", "point", 3), like=real(*IMAGE)),
    function("learn.albedo_loss", albedo=real(*IMAGE), truth=real(*IMAGE), mask=real(*ONE)),
    function("learn.angle_degrees", normal=unit(*P), truth=unit(*P)),
    function("learn.chord_loss", normal=unit(*P), truth=unit(*P), weight=real(*P)),
    function("learn.estimate_light", image=real("batch", 3, 4, 4), normal=unit_map("batch", 4, 4), albedo=real("batch", 3, 4, 4), mask=real("batch", 1, 4, 4)),
    function("learn.height_to_normals", height=real("batch", "height", "width")),
    function("learn.integrability_loss", normal=unit_map("batch", 3, 3), mask=real("batch", 1, 3, 3)),
    function("learn.least_squares", intensity=real(*P, 5), direction=unit("batch", 5)),
    function("learn.robust_normals", intensity=real(*P, 5), direction=unit("batch", 5)),
    function("learn.observation_map", lambda values, place: torchradiometry.learn.observation_map(values, place, 2, 0.5), values=real("batch", "light", 2), place=real("batch", "light", 2)),
    function("learn.relative_to_mean", image=real(*IMAGE), mask=real(*ONE)),
    function("learn.rendering_loss", radiance=real(*IMAGE), image=real(*IMAGE), mask=real(*ONE)),
]
# fmt: on
