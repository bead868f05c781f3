"""pyrender against the layers: two implementations, one physics; and against closed forms."""

from __future__ import annotations

import math
import os
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from torchradiometry.errors import (
    DTypeError,
    EmptySceneError,
    InvalidValueError,
    NoGraphicsError,
    OutOfRangeError,
    ResourceLimitError,
    ShapeError,
)
from torchradiometry.geometry.cameras import (
    AbstractCamera,
    OrthographicCamera,
    PinholeCamera,
    look_at,
)
from torchradiometry.geometry.polygon_irradiance import polygon_irradiance
from torchradiometry.materials.base import AbstractMaterial
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.materials.lambertian import Lambertian
from torchradiometry.materials.phong import NormalizedPhong, OriginalPhong, Phong
from torchradiometry.materials.sum import SumMaterial
from torchradiometry.numerics import safe_normalize
from torchradiometry.reference import graphics
from torchradiometry.reference.pyrender import ReferenceBuffers, render_reference
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.surface import Surface, Texture
from torchradiometry.shade.points import shade_points
from torchradiometry.sources.base import AbstractSource
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.dome import AmbientDome
from torchradiometry.sources.point import PointSource
from torchradiometry.sources.polygon import PolygonSource
from torchradiometry.sources.sphere import SphereSource
from torchradiometry.sources.spot import SpotSource
from torchradiometry.transport.brute_force import BruteForceRays

pytestmark = pytest.mark.gl

#: what the comparison is promised to reach, away from silhouettes and shadow edges
MEDIAN, WORST = 3e-3, 1e-2
#: What it reaches on the rasteriser's own positions and normals: float32 rounding (eps 6e-8)
#: in the median; a cosine of 1e-3 or the end of a spot's cone magnifies it a thousand times.
MEDIAN_FLOAT32, WORST_FLOAT32 = 1e-6, 1e-3
#: pixels darker than this share of the brightest have no relative error worth the name
DARK = 1e-5


@pytest.fixture(autouse=True, scope="module")
def _context() -> None:
    """Skip only where no context can be made and nobody promised one."""
    try:
        with graphics.graphics_context(4, 4):
            pass
    except (NoGraphicsError, ImportError):
        if os.environ.get("CI"):
            raise
        pytest.skip("no OpenGL context")


def f64(values: object) -> Tensor:
    return torch.from_numpy(np.array(values, np.float64))


def surface(mesh: trimesh.Trimesh, smooth: bool = True, **options: object) -> Surface:
    given = {"name": "mesh", "albedo": f64([0.8, 0.5, 0.3])} | options
    return Surface(
        vertices=f64(mesh.vertices),
        faces=torch.from_numpy(np.array(mesh.faces, np.int64)),
        normals=f64(mesh.vertex_normals) if smooth else None,
        **given,
    )


def quad(corners: object, **options: object) -> Surface:
    given = {"name": "quad", "albedo": f64([0.8, 0.5, 0.3])} | options
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    return Surface(vertices=f64(corners), faces=faces, **given)


def ground(half: float = 4.0, **options: object) -> Surface:
    """The plane y = 0 with its front up."""
    corners = [[-half, 0, half], [half, 0, half], [half, 0, -half], [-half, 0, -half]]
    return quad(corners, **options)


def shapes() -> tuple[Surface, ...]:
    ball = trimesh.creation.icosphere(subdivisions=4)
    ring = trimesh.creation.torus(1.0, 0.3)
    ring.apply_translation((-1.5, 0.2, -1))
    box = trimesh.creation.box((0.8, 0.8, 0.8))
    box.apply_translation((1.6, -0.6, 0.4))
    floor = trimesh.creation.box((8, 0.2, 8))
    floor.apply_translation((0, -1.1, 0))
    return (
        surface(ball),
        surface(ring, albedo=f64([0.9])),
        surface(box, smooth=False, albedo=f64([0.2, 0.6, 0.9])),
        surface(floor, smooth=False),
    )


def lights(kind: str, count: int) -> AbstractSource:
    generator = torch.Generator().manual_seed(count)
    place = torch.rand(count, 3, generator=generator, dtype=torch.float64) * 4 - 2
    power = torch.rand(count, 3, generator=generator, dtype=torch.float64) * 10 + 1
    place[:, 1] = 2
    if kind == "directional":
        return DirectionalSource(place, power)
    if kind == "point":
        return PointSource(place, power)
    return SpotSource(place, -place, power, 0.2 * torch.ones(count, 1), 0.7 * torch.ones(count, 1))


def camera(kind: str, width: int = 96, height: int = 72) -> AbstractCamera:
    pose = look_at(f64([0, 2, 6]), f64([0, 0, 0]))
    if kind == "perspective":
        return PinholeCamera(width=width, height=height, yfov=0.9, camera_to_world=pose)
    return OrthographicCamera(width=width, height=height, ymag=2.5, camera_to_world=pose)


def outgoing(view: AbstractCamera, position: Tensor) -> Tensor:
    if isinstance(view, PinholeCamera):
        return safe_normalize(view.position - position)
    return (-view.forward).expand_as(position)


def layers(
    view: AbstractCamera,
    position: Tensor,
    normal: Tensor,
    albedo: Tensor,
    gloss: AbstractMaterial | None,
    source: AbstractSource,
) -> Tensor:
    """The package's own radiance of surface points."""
    diffuse = Lambertian(albedo)
    material = diffuse if gloss is None else SumMaterial([diffuse, gloss])
    return shade_points(
        material, [source], position, safe_normalize(normal), outgoing(view, position)
    )


def relative_error(ours: Tensor, theirs: Tensor) -> Tensor:
    larger = torch.maximum(ours, theirs)
    bright = larger > DARK * larger.max()
    assert bright.float().mean() > 0.1
    return ((ours - theirs).abs() / larger)[bright]


def inner(mask: Tensor, pixels: int = 2) -> Tensor:
    """A mask without the `pixels` next to its edge."""
    outside = (~mask).float()[None, None]
    size = 2 * pixels + 1
    padded = torch.nn.functional.pad(outside, [pixels] * 4, value=1.0)
    return torch.nn.functional.max_pool2d(padded, size, stride=1)[0, 0] == 0


def away_from_silhouettes(buffers: ReferenceBuffers) -> Tensor:
    kept = torch.zeros_like(buffers.instance, dtype=torch.bool)
    for k in range(int(buffers.instance.max()) + 1):
        kept |= inner(buffers.instance == k, 1)
    return kept


GLOSSES = {
    "lambertian": None,
    "phong": Phong(f64([0.3, 0.2, 0.1]), f64([20])),
    "normalised": NormalizedPhong(f64([0.3]), f64([200])),
    "original": OriginalPhong(f64([0.3]), f64([7.5])),
    "blinn": BlinnPhong(f64([0.3]), f64([60])),
}


@pytest.mark.parametrize("count", [1, 6])
@pytest.mark.parametrize("kind", ["directional", "point", "spot"])
@pytest.mark.parametrize("view", ["perspective", "orthographic"])
@pytest.mark.parametrize("gloss", GLOSSES)
def test_layers_agree_with_pyrender(gloss: str, view: str, kind: str, count: int) -> None:
    source, eye = lights(kind, count), camera(view)
    scene = Scene(shapes(), (source,))
    seen = render_reference(scene, eye, materials=[GLOSSES[gloss]] * 4)
    hit = seen.instance >= 0
    ours = layers(
        eye, seen.position[hit], seen.normal[hit], seen.albedo[hit], GLOSSES[gloss], source
    )
    error = relative_error(ours, seen.radiance[hit])
    assert error.median() < MEDIAN_FLOAT32
    assert error.max() < WORST_FLOAT32


@pytest.mark.parametrize("view", ["perspective", "orthographic"])
def test_layers_on_ray_cast_points_agree_with_pyrender(view: str) -> None:
    """Nothing is shared with the rasteriser: hits, normals and albedo come from our rays."""
    source, eye = lights("point", 2), camera(view, 48, 36)
    scene = Scene(shapes(), (source,))
    gloss = GLOSSES["phong"]
    seen = render_reference(scene, eye, materials=[gloss] * 4)
    rays = eye.rays(eye.pixel_grid().reshape(-1, 2))
    triangles = scene.triangles
    hits = BruteForceRays(triangles.corners).closest(*rays)
    instance = torch.where(hits.found, triangles.surface[hits.triangle], -1).reshape(36, 48)
    kept = away_from_silhouettes(seen).reshape(-1)
    assert (instance.reshape(-1) == seen.instance.reshape(-1))[kept].all()
    assert (instance == seen.instance).double().mean() > 0.99
    position = rays.origin + hits.distance.unsqueeze(-1) * rays.direction
    weights = hits.barycentric.unsqueeze(-1)
    normal = safe_normalize((triangles.normals[hits.triangle] * weights).sum(-2))
    albedo = triangles.albedo[hits.triangle]
    ours = layers(eye, position[kept], normal[kept], albedo[kept], gloss, source)
    error = relative_error(ours, seen.radiance.reshape(-1, 3)[kept])
    assert error.median() < MEDIAN
    assert error.max() < WORST


@pytest.mark.parametrize("view", ["perspective", "orthographic"])
def test_smooth_sphere_is_shaded_as_the_analytic_one(view: str) -> None:
    radius, eye, source = 1.0, camera(view), lights("point", 3)
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    ball = replace(surface(mesh), normals=f64(mesh.vertices / radius))
    seen = render_reference(Scene((ball,), (source,)), eye)
    origin, direction = eye.rays(eye.pixel_grid())
    along = -(origin * direction).sum(-1)
    inside = radius**2 - ((origin + along.unsqueeze(-1) * direction) ** 2).sum(-1)
    cosine = inside.clamp(min=0).sqrt() / radius
    point = origin + (along - radius * cosine).unsqueeze(-1) * direction
    kept = cosine > 0.3
    assert (seen.instance[kept] == 0).all()
    assert (seen.instance[inside < -0.01] == -1).all()
    # A facet lies below the sphere by at most 1 - cos(angle to its corners); a ray meets it
    # later by that over the cosine.
    sag = radius - float(np.linalg.norm(mesh.triangles_center, axis=-1).min())
    assert (seen.depth - eye.depth(point))[kept].abs().max() < sag / 0.3 + 1e-5
    normal = point / radius
    assert (seen.normal - normal)[kept].norm(dim=-1).max() < 2e-3
    albedo = f64([0.8, 0.5, 0.3]).expand(int(kept.sum()), 3)
    ours = layers(eye, point[kept], normal[kept], albedo, None, source)
    lit = ours.amax(-1) > 0.02 * ours.max()  # a terminator is an edge too
    error = relative_error(ours[lit], seen.radiance[kept][lit])
    assert error.median() < MEDIAN
    assert error.max() < WORST


@pytest.mark.parametrize("view", ["perspective", "orthographic"])
def test_plane_depth_position_and_background(view: str) -> None:
    eye = camera(view)
    seen = render_reference(Scene((ground(1.5),)), eye)
    origin, direction = eye.rays(eye.pixel_grid())
    point = origin - (origin[..., 1] / direction[..., 1]).unsqueeze(-1) * direction
    outside = (point[..., [0, 2]].abs().amax(-1) - 1.5).where(direction[..., 1] < 0, f64(1.0))
    on, off = outside < -0.05, outside > 0.05
    assert (seen.instance[on] == 0).all()
    torch.testing.assert_close(seen.depth[on], eye.depth(point)[on], rtol=1e-5, atol=0)
    torch.testing.assert_close(seen.position[on], point[on], rtol=0, atol=3e-5)
    torch.testing.assert_close(seen.normal[on], f64([0, 1, 0]).expand(int(on.sum()), 3))
    assert (seen.instance[off] == -1).all()
    assert torch.isinf(seen.depth[off]).all()
    for buffer in (seen.radiance, seen.normal, seen.position, seen.albedo):
        assert (buffer[off] == 0).all()


@pytest.mark.parametrize("view", ["perspective", "orthographic"])
def test_a_scene_far_from_the_origin_keeps_its_digits(view: str) -> None:
    eye, source, away = camera(view), lights("point", 1), f64([1e6, -2e6, 3e6])
    near = render_reference(Scene((ground(),), (source,)), eye)
    pose = eye.camera_to_world.clone()
    pose[:3, 3] += away
    options = {"yfov": 0.9} if view == "perspective" else {"ymag": 2.5}
    moved_eye = type(eye)(width=eye.width, height=eye.height, camera_to_world=pose, **options)
    floor = ground()
    moved = Surface("moved", floor.vertices + away, floor.faces, floor.albedo)
    lamp = PointSource(source.position + away, source.intensity)
    far = render_reference(Scene((moved,), (lamp,)), moved_eye)
    both = (near.instance == 0) & (far.instance == 0)
    assert both.double().mean() > 0.3
    torch.testing.assert_close(far.radiance[both], near.radiance[both], rtol=1e-5, atol=1e-7)


def test_near_surfaces_are_not_cut_off() -> None:
    """The near plane follows the nearest surface: 1 mm in front of the eye and 1 km away."""
    tile = [[-1e-4, -1e-4, -1e-3], [1e-4, -1e-4, -1e-3], [1e-4, 1e-4, -1e-3], [-1e-4, 1e-4, -1e-3]]
    wall = [[-2e3, -2e3, -1e3], [2e3, -2e3, -1e3], [2e3, 2e3, -1e3], [-2e3, 2e3, -1e3]]
    eye = PinholeCamera(width=33, height=33, yfov=1.0, camera_to_world=torch.eye(4).double())
    seen = render_reference(Scene((quad(tile), quad(wall))), eye)
    assert seen.instance[16, 16] == 0
    assert seen.instance[0, 0] == 1
    torch.testing.assert_close(seen.depth[16, 16], f64(1e-3))
    torch.testing.assert_close(seen.depth[0, 0], f64(1e3))


def test_an_orthographic_camera_amid_the_scene_sees_what_is_in_front() -> None:
    def wall(z: float) -> Surface:
        return quad([[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]])

    pose = torch.eye(4).double()
    eye = OrthographicCamera(width=4, height=4, ymag=0.5, camera_to_world=pose)
    seen = render_reference(Scene((wall(1.0), wall(-2.0), wall(-3.0))), eye)
    assert (seen.instance == 1).all()
    torch.testing.assert_close(seen.depth, torch.full((4, 4), 2.0, dtype=torch.float64))
    distant = OrthographicCamera(
        width=4, height=4, ymag=0.5, camera_to_world=look_at(f64([0, 0, 1e6]), f64([0, 0, 0]))
    )
    seen = render_reference(Scene((wall(1.0), wall(1.0 - 1e-3))), distant)
    assert (seen.instance == 0).all()
    torch.testing.assert_close(seen.depth, torch.full((4, 4), 999999.0, dtype=torch.float64))


def shadow_scene(source: AbstractSource) -> Scene:
    box = trimesh.creation.box((0.8, 0.8, 0.8))
    box.apply_translation((0.2, 0.6, 0.1))
    return Scene((ground(), surface(box, smooth=False)), (source,))


SHADOWING = {
    "directional": DirectionalSource(f64([0.6, 0.8, -0.7]), f64([3.0])),
    "narrow spot": SpotSource(f64([1.0, 3, -1]), f64([-0.4, -1, 0.6]), f64([30.0]), 0.4, 0.9),
    "wide spot": SpotSource(f64([1.0, 3, -1]), f64([-0.4, -1, 0.6]), f64([30.0]), 0.4, 1.5),
    "point": PointSource(f64([1.0, 2.0, -1.0]), f64([20.0])),
}


@pytest.mark.parametrize("kind", SHADOWING)
def test_shadow_maps_agree_with_rays(kind: str) -> None:
    source = SHADOWING[kind]
    pose = look_at(f64([0, 3, 3.5]), f64([0, 0.2, 0]))
    scene = shadow_scene(source)
    eye = PinholeCamera(width=120, height=90, yfov=0.9, camera_to_world=pose)
    full = render_reference(scene, eye)
    cast = render_reference(scene, eye, shadows=True)
    lit = (full.radiance[..., 0] > 0) & (full.instance >= 0)
    assert (cast.instance == full.instance).all()
    rays = BruteForceRays(scene.triangles.corners)
    start = rays.lift(full.position, full.normal)
    arrival = source(start.reshape(1, -1, 3), full.normal.reshape(1, -1, 3))
    towards = arrival.direction.reshape(full.normal.shape)
    if kind == "directional":
        target = rays.beyond(start, towards)
    else:
        target = start + towards * arrival.distance.reshape(*start.shape[:-1], 1)
    truth = rays.visible(start, target)
    dark = cast.radiance[..., 0] < 0.5 * full.radiance[..., 0]
    interior = lit & (inner(truth) | inner(~truth))
    assert interior.sum() > 1000
    assert (dark & interior).sum() > 100
    agree = (dark != truth)[interior].double().mean()
    assert agree >= 0.995
    assert (dark != truth)[lit].double().mean() > 0.95
    kept = interior & truth & ~dark
    torch.testing.assert_close(cast.radiance[kept], full.radiance[kept])


PANEL = [[-0.5, 2, -0.4], [0.5, 2, -0.4], [0.5, 2, 0.4], [-0.5, 2, 0.4]]


def panel_irradiance(position: Tensor) -> Tensor:
    up = f64([0.0, 1, 0]).expand_as(position)
    return polygon_irradiance(position, up, f64(PANEL))


def test_many_lights_converge_to_the_exact_area_light() -> None:
    lamp = quad(PANEL, emission=f64([4.0, 2, 1]), name="lamp", albedo=f64([0.0]))
    eye = camera("perspective", 48, 36)
    errors = []
    for samples in (4, 64, 1024):
        seen = render_reference(Scene((ground(), lamp)), eye, area_samples=samples)
        floor = seen.instance == 0
        exact = panel_irradiance(seen.position[floor]).unsqueeze(-1)
        exact = exact * f64([4.0, 2, 1]) * f64([0.8, 0.5, 0.3]) / math.pi
        error = (seen.radiance[floor] - exact).abs() / exact
        errors.append((float(error.median()), float(error.max())))
    assert errors[0][0] > 4 * errors[1][0] > 16 * errors[2][0]
    assert errors[2][0] < MEDIAN / 10
    assert errors[2][1] < WORST / 10


@pytest.mark.parametrize("two_sided", [False, True])
def test_an_area_source_is_a_glowing_surface(two_sided: bool) -> None:
    turned = PANEL[::-1] if two_sided else PANEL
    eye = camera("perspective", 24, 18)
    source = PolygonSource(f64(turned), f64([3.0]), two_sided=two_sided)
    seen = render_reference(Scene((ground(),), (source,)), eye, area_samples=400)
    floor = seen.instance == 0
    exact = panel_irradiance(seen.position[floor]).unsqueeze(-1) * 3 * f64([0.8, 0.5, 0.3])
    torch.testing.assert_close(seen.radiance[floor], exact / math.pi, rtol=MEDIAN, atol=0)


def test_a_sphere_source_is_many_lights() -> None:
    source = SphereSource(f64([0.0, 1.5, 0]), f64([0.5]), f64([3.0]))
    eye = camera("perspective", 24, 18)
    seen = render_reference(Scene((ground(),), (source,)), eye, area_samples=2000)
    floor = seen.instance == 0
    position, normal = seen.position[floor], seen.normal[floor]
    albedo = f64([0.8, 0.5, 0.3]).expand_as(position)
    ours = layers(eye, position, normal, albedo, None, source)
    torch.testing.assert_close(seen.radiance[floor], ours, rtol=WORST, atol=0)


def test_a_shadowed_area_light_has_a_soft_edge() -> None:
    lamp = quad(PANEL, emission=f64([4.0]), name="lamp", albedo=f64([0.0]))
    blocker = quad([[0, 1, 1], [2, 1, 1], [2, 1, -1], [0, 1, -1]], two_sided=True)
    pose = look_at(f64([0, 0.9, 0]), f64([0, 0, 0]), f64([0, 0, -1]))
    eye = OrthographicCamera(width=40, height=8, ymag=0.2, camera_to_world=pose)
    seen = render_reference(Scene((ground(), lamp, blocker)), eye, shadows=True, area_samples=32)
    row = seen.radiance[4, :, 0]
    assert (seen.instance == 0).all()
    free = panel_irradiance(seen.position[4]) * 4 * 0.8 / math.pi
    share = row / free
    # Seen from x on the floor, the blocker's edge hides the panel right of -x.
    expected = (0.5 - seen.position[4, :, 0]).clamp(0, 1)
    assert (share - expected).abs().max() < 0.15
    assert share[0] > 0.99


@pytest.mark.parametrize("two_sided", [False, True])
def test_backs(two_sided: bool) -> None:
    """A one-sided back is black and blocks; a two-sided one reflects and turns its normal."""
    turned = [[-1, 0, 0], [-1, 1, 0], [1, 1, 0], [1, 0, 0]]
    behind = quad([[-2, -1, -1], [2, -1, -1], [2, 3, -1], [-2, 3, -1]])
    card = quad(turned, two_sided=two_sided, emission=f64([0.25]))
    sun = DirectionalSource(f64([0.0, 0, 1]), f64([math.pi]))
    pose = look_at(f64([0, 0.5, 4]), f64([0, 0.5, 0]))
    eye = PinholeCamera(width=9, height=9, yfov=0.5, camera_to_world=pose)
    seen = render_reference(Scene((card, behind), (sun,)), eye, shadows=False)
    assert seen.instance[4, 4] == 0
    expected = f64([0.8, 0.5, 0.3]) + 0.25 if two_sided else f64([0.0, 0, 0])
    torch.testing.assert_close(seen.radiance[4, 4], expected, rtol=1e-6, atol=0)
    torch.testing.assert_close(seen.normal[4, 4], f64([0, 0, 1.0 if two_sided else -1.0]))
    slanted = DirectionalSource(f64([0.0, 1, 1]), f64([math.pi]))
    pose = look_at(f64([0, -0.5, 4]), f64([0, -0.5, -1]))
    below = PinholeCamera(width=9, height=9, yfov=0.05, camera_to_world=pose)
    shaded = render_reference(Scene((card, behind), (slanted,)), below, shadows=True)
    assert shaded.instance[4, 4] == 1
    assert (shaded.radiance[4, 4] == 0).all()


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_textures_are_looked_up_as_by_the_scene(wrap: str) -> None:
    generator = torch.Generator().manual_seed(3)
    image = torch.rand(5, 7, 3, generator=generator, dtype=torch.float64)
    coordinates = f64([[-0.3, -0.2], [1.4, -0.2], [1.4, 1.3], [-0.3, 1.3]])
    painted = ground(texture=Texture(image, coordinates, (wrap, "repeat")))
    scene, eye = Scene((painted,)), camera("perspective", 60, 45)
    seen = render_reference(scene, eye)
    rays = eye.rays(eye.pixel_grid().reshape(-1, 2))
    hits = BruteForceRays(scene.triangles.corners).closest(*rays)
    expected = scene.albedo_at(hits.triangle, hits.barycentric).reshape(45, 60, 3)
    floor = inner(seen.instance == 0, 1)
    torch.testing.assert_close(seen.albedo[floor], expected[floor], rtol=0, atol=5e-3)


def test_passes_add_up_whatever_their_number() -> None:
    """70 lights need three passes; emission is counted once."""
    eye = camera("perspective", 24, 18)
    glowing = ground(emission=f64([0.5, 0.25, 0.125]))
    source = lights("point", 70)
    seen = render_reference(Scene((glowing,), (source,)), eye)
    hit = seen.instance == 0
    ours = layers(eye, seen.position[hit], seen.normal[hit], seen.albedo[hit], None, source)
    torch.testing.assert_close(
        seen.radiance[hit], ours + f64([0.5, 0.25, 0.125]), rtol=1e-5, atol=0
    )


def test_pictures_of_many_sizes_in_one_process_are_independent() -> None:
    scene = Scene(shapes(), (lights("spot", 2),))
    first = render_reference(scene, camera("perspective", 40, 30), shadows=True)
    for width, height in ((1, 1), (300, 7), (7, 300)):
        seen = render_reference(scene, camera("orthographic", width, height))
        assert seen.radiance.shape == (height, width, 3)
        assert seen.depth.shape == seen.instance.shape == (height, width)
    again = render_reference(scene, camera("perspective", 40, 30), shadows=True)
    for a, b in zip(first, again, strict=True):
        assert torch.equal(a, b)


def test_faults_are_named() -> None:
    eye = camera("perspective", 4, 4)
    scene = Scene((ground(),), ())
    with pytest.raises(ShapeError, match="one \\(or None\\) per surface"):
        render_reference(scene, eye, materials=[None, None])
    with pytest.raises(DTypeError, match="a Lambertian; use Phong"):
        render_reference(scene, eye, materials=[Lambertian(f64([0.5]))])
    with pytest.raises(DTypeError, match="AmbientDome"):
        render_reference(Scene((ground(),), (AmbientDome(f64([1.0])),)), eye)
    panel = PolygonSource(f64(PANEL), f64([1.0]))
    with pytest.raises(OutOfRangeError, match="area_samples: got 0 with a PolygonSource"):
        render_reference(Scene((ground(),), (panel,)), eye)
    with pytest.raises(OutOfRangeError, match="area_samples"):
        render_reference(scene, eye, area_samples=-1)
    batched = PointSource(torch.zeros(2, 1, 3).double(), f64([1.0]))
    with pytest.raises(ShapeError, match="without a batch axis"):
        render_reference(Scene((ground(),), (batched,)), eye)
    with pytest.raises(ShapeError, match="1 or 3 channels"):
        render_reference(Scene((ground(albedo=f64([0.5, 0.5])),)), eye)
    with pytest.raises(EmptySceneError):
        render_reference(Scene(), eye)
    with pytest.raises(ResourceLimitError, match="draws at most"):
        render_reference(scene, camera("perspective", 2**18, 1))


def test_nan_is_named() -> None:
    broken = ground()
    broken.vertices[0, 0] = math.nan
    with pytest.raises(InvalidValueError, match="NaN"):
        render_reference(Scene((broken,)), camera("perspective", 4, 4))


def test_nothing_is_nan_where_light_has_no_value() -> None:
    """A lamp on the surface, a fold without a normal, a glowing surface under its own light."""
    fold = ground(normals=f64([[0, 1, 0], [0, -1, 0], [0, 1, 0], [0, -1, 0]]))
    lamps = (PointSource(f64([0.0, 0, 0]), f64([1.0])), lights("point", 2))
    pose = look_at(f64([0, 3, 0]), f64([0, 0, 0]), f64([0, 0, -1]))
    eye = PinholeCamera(width=9, height=9, yfov=0.5, camera_to_world=pose)
    for scene in (Scene((fold,), lamps), Scene((ground(),), lamps)):
        for shadows in (False, True):
            seen = render_reference(scene, eye, shadows=shadows)
            assert torch.isfinite(seen.radiance).all()
            assert torch.isfinite(seen.normal).all()
    glowing = Scene((ground(0.5, emission=f64([2.0])),))
    seen = render_reference(glowing, eye, area_samples=800)
    hit = seen.instance == 0
    torch.testing.assert_close(seen.radiance[hit], torch.full_like(seen.radiance[hit], 2.0))


def test_a_camera_that_sees_nothing() -> None:
    pose = look_at(f64([0, 3, 0]), f64([0, 9, 0]), f64([0, 0, -1]))
    eye = PinholeCamera(width=5, height=4, yfov=0.5, camera_to_world=pose)
    seen = render_reference(Scene((ground(),), (lights("point", 1),)), eye, shadows=True)
    assert (seen.instance == -1).all()
    assert (seen.radiance == 0).all()


def test_no_graphics_is_one_sentence_with_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    monkeypatch.setattr(graphics, "_egl_device", lambda: None)
    monkeypatch.setattr(graphics.ctypes.util, "find_library", lambda name: None)
    graphics.load_graphics.cache_clear()
    with pytest.raises(NoGraphicsError, match="apt-get install libegl1 libegl-mesa0") as caught:
        render_reference(Scene((ground(),)), camera("perspective", 4, 4))
    assert "\n" not in str(caught.value)
    assert "libosmesa6" in str(caught.value)


def test_the_environment_is_left_alone() -> None:
    before = dict(os.environ)
    render_reference(Scene((ground(),)), camera("perspective", 4, 4))
    assert dict(os.environ) == before
