"""Step 1: one mesh, shaded by our layers and by an independent rasteriser, pixel by pixel.

A dented ball is written as a GLB file, loaded, and lit by a distant, a near and a spot light.
Our side: camera rays, the mesh's interpolated normals, `PhongShading`. Their side: pyrender
with a floating-point framebuffer. Both are linear radiance; pixels at the outline, where one
side may see the surface and the other the background, are left out.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from torchradiometry.demo.page import Figure, Section, Table
from torchradiometry.errors import NoGraphicsError
from torchradiometry.files import write_picture
from torchradiometry.geometry.cameras import AbstractCamera, PinholeCamera, look_at
from torchradiometry.geometry.meshes import vertex_normals
from torchradiometry.materials.phong import NormalizedPhong
from torchradiometry.reference.pyrender import ReferenceBuffers, render_reference
from torchradiometry.render.picture import SurfacePoints, see
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import prepare
from torchradiometry.scene.build import sphere
from torchradiometry.scene.load import load_scene
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.surface import Surface
from torchradiometry.scene.write import save_scene
from torchradiometry.shade.phong import PhongShading
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.point import PointSource
from torchradiometry.sources.spot import SpotSource

__all__ = ["compare_with_rasteriser", "dented_ball"]

SPECULAR, SHININESS = 0.3, 40.0


def dented_ball() -> Surface:
    """A ball of about 1 m with smooth waves in its radius, 20,480 faces."""
    ball = sphere("dented ball", 1.0, subdivisions=5, albedo=(0.75, 0.55, 0.35))
    x, y, z = ball.vertices.unbind(-1)
    waves = 0.09 * torch.sin(5 * x + 1) * torch.sin(4 * y) + 0.05 * torch.sin(7 * z + 2 * x)
    vertices = ball.vertices * (1 + waves).unsqueeze(-1)
    return replace(ball, vertices=vertices, normals=vertex_normals(vertices, ball.faces))


def compare_with_rasteriser(folder: Path, size: int) -> Section:
    """Make the pictures and the figures of step 1."""
    scene, camera = _mesh_from_file(folder / "mesh.glb"), _camera(size)
    ours, points = _by_our_layers(scene, camera)
    write_picture(folder / "mesh-layers.png", ours.numpy(), exposure=_exposure(ours))
    figures = [Figure("mesh-layers.png", "Our layers: PhongShading under three lights.")]
    try:
        lobe = NormalizedPhong([SPECULAR], [SHININESS])
        theirs = render_reference(scene, camera, materials=[lobe])
    except NoGraphicsError as error:
        missing = f"The rasteriser could not run, so there is no comparison here: {error}"
        return Section(TITLE, (missing,), figures, data={"compared": False})
    error_map, difference = _difference(ours, theirs, points)
    white = 10.0 ** math.ceil(math.log10(max(float(difference.max()), torch.finfo().tiny)))
    write_picture(folder / "mesh-pyrender.png", theirs.radiance.numpy(), exposure=_exposure(ours))
    write_picture(folder / "mesh-difference.png", error_map.numpy(), exposure=1 / white)
    figures += [
        Figure("mesh-pyrender.png", "pyrender, linear floating-point framebuffer."),
        Figure("mesh-difference.png", f"Relative difference: white is {100 * white:g} %."),
    ]
    median, worst = float(difference.median()), float(difference.max())
    table = Table(
        ("relative difference of radiance", "%"),
        (("median pixel", f"{100 * median:.2g}"), ("worst pixel", f"{100 * worst:.2g}")),
    )
    words = (
        "A mesh is loaded from a GLB file and lit by a distant, a near and a spot light. Our "
        "layers and an independent rasteriser shade it; both answers are linear radiance.",
        f"{difference.numel()} pixels are compared; the outline is left out.",
    )
    data = {"compared": True, "median": median, "worst": worst, "pixels": difference.numel()}
    return Section(TITLE, words, figures, (table,), data=data)


TITLE = "1. A mesh: our layers beside an independent rasteriser"


def _mesh_from_file(path: Path) -> Scene:
    lights = (
        DirectionalSource([0.3, 0.5, 0.8], [2.0, 1.9, 1.7]),
        PointSource([-1.6, 0.4, 1.2], [1.0, 1.3, 1.8]),
        SpotSource([1.2, -1.4, 1.8], [-0.5, 0.55, -0.67], [3.0, 2.0, 2.0], 0.2, 0.5),
    )
    save_scene(Scene((dented_ball(),), lights), path)
    return load_scene(path)


def _camera(size: int) -> AbstractCamera:
    place = look_at(torch.tensor([0.6, 0.5, 3.6]), torch.zeros(3))
    return PinholeCamera(width=size, height=size, yfov=math.radians(40), camera_to_world=place)


def _by_our_layers(scene: Scene, camera: AbstractCamera) -> tuple[Tensor, SurfacePoints]:
    """Radiance `H W 3` by ray casting and `PhongShading`, and the points that were seen."""
    world = prepare(scene, RenderSettings())
    origin, direction = camera.rays(camera.pixel_grid().to(torch.float64).reshape(-1, 2))
    points = see(world, origin, direction)
    found = (points.face >= 0).unsqueeze(-1)

    def image(values: Tensor) -> Tensor:
        grid = torch.where(found, values, 0).reshape(1, camera.height, camera.width, -1)
        return grid.movedim(-1, 1).double()

    albedo = image(scene.albedo_at(points.triangle.clamp(min=0), points.barycentric))
    one = torch.ones_like(albedo[:, :1])
    layer = PhongShading(NormalizedPhong, list(scene.sources)).double()
    radiance = layer(
        image(points.normal),
        albedo,
        SPECULAR * one,
        SHININESS * one,
        position=image(points.position),
        outgoing_direction=image(-direction),
    )
    return radiance[0].movedim(0, -1).detach(), points


def _difference(
    ours: Tensor, theirs: ReferenceBuffers, points: SurfacePoints
) -> tuple[Tensor, Tensor]:
    """Picture of the relative difference, and its values away from the outline."""
    both = (theirs.instance >= 0) & (points.face >= 0).reshape(theirs.instance.shape)
    outside = (~both).double()[None, None]
    inner = torch.nn.functional.max_pool2d(outside, 5, 1, 2)[0, 0] == 0
    brightness = ours.amax(-1)
    inner &= brightness > 0.01 * brightness.max()
    relative = (ours - theirs.radiance).abs().amax(-1) / torch.where(inner, brightness, 1)
    picture = torch.where(inner, relative, 0).unsqueeze(-1).expand(-1, -1, 3)
    return picture, relative[inner]


def _exposure(radiance: Tensor) -> float:
    return 1 / float(radiance.amax(-1).flatten().quantile(0.995))
