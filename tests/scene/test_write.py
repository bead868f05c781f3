"""Written scenes come back as they were."""

import math
from pathlib import Path

import pytest
import torch
import trimesh

from tests.tolerances import assert_close
from torchradiometry.errors import FileFormatError, InputFileError
from torchradiometry.geometry.cameras import OrthographicCamera, look_at
from torchradiometry.scene import (
    Scene,
    Surface,
    Texture,
    cornell_like_room,
    load_scene,
    quad,
    save_scene,
    sphere,
)
from torchradiometry.sources import AmbientDome, DirectionalSource, PointSource, SpotSource


def written(scene: Scene, folder: Path) -> Scene:
    return load_scene(save_scene(scene, folder / "scene.glb"), dtype=torch.float64)


def test_room(tmp_path: Path) -> None:
    scene = cornell_like_room(width=320, height=200, lamp=True)
    again = written(scene, tmp_path)
    for a, b in zip(scene.surfaces, again.surfaces, strict=True):
        assert (a.name, a.two_sided) == (b.name, b.two_sided)
        assert_close(b.vertices.float(), a.vertices)
        assert (a.faces == b.faces).all()
        assert_close(b.albedo.float(), a.albedo)
        assert_close(b.emission.float(), a.emission)
    assert_close(again.sources[0].position.float(), scene.sources[0].position)
    assert_close(again.sources[0].intensity.float(), scene.sources[0].intensity)
    camera = again.cameras[0]
    assert camera.yfov == scene.cameras[0].yfov
    assert camera.width / camera.height == pytest.approx(1.6)
    assert_close(camera.camera_to_world.float(), scene.cameras[0].camera_to_world, atol=1e-6)
    assert again.validate() == ()


def test_trimesh_reads_it_too(tmp_path: Path) -> None:
    path = save_scene(cornell_like_room(lamp=True), tmp_path / "room.glb")
    assert trimesh.load_scene(path).area == pytest.approx(94 + 8.2 + 4.6, rel=1e-6)


def test_normals_and_sides(tmp_path: Path) -> None:
    ball = sphere("ball", 1.0, subdivisions=1)
    leaf = quad("leaf", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], albedo=[0.3], two_sided=True)
    first, second = written(Scene((ball, leaf)), tmp_path).surfaces
    assert_close(first.normals.float(), ball.normals)
    assert second.normals is None
    assert second.two_sided
    assert_close(second.albedo, [0.3] * 3, rtol=1e-7)


@pytest.mark.parametrize(
    "towards", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0], [0.48, 0.6, -0.64]]
)
def test_lights(tmp_path: Path, towards: list[float]) -> None:
    direction = torch.tensor(towards, dtype=torch.float64)
    floor = quad("floor", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    colour = torch.tensor([1.0, 2, 4], dtype=torch.float64)
    spot = SpotSource(direction, -direction, colour, 0.25, 0.5)
    scene = Scene((floor,), (DirectionalSource(direction, colour), spot))
    distant, cone = written(scene, tmp_path).sources
    assert_close(distant.direction[0], direction, atol=1e-12)
    assert_close(distant.irradiance, colour[None])
    assert_close(cone.axis[0], -direction, atol=1e-12)
    assert_close(cone.position[0], direction)
    assert_close(torch.cat((cone.inner_cone, cone.outer_cone)), [[0.25], [0.5]])


def test_many_lights_in_one_source(tmp_path: Path) -> None:
    floor = quad("floor", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    lamps = PointSource(torch.rand(3, 3), torch.tensor([[2.0]]))
    again = written(Scene((floor,), (lamps,)), tmp_path).sources
    assert len(again) == 3
    assert_close(torch.cat([s.position for s in again]).float(), lamps.position)
    assert_close(again[2].intensity, [[2.0] * 3])


def test_orthographic_camera(tmp_path: Path) -> None:
    place = look_at((1.0, 2, 3), (0.0, 0, 0))
    camera = OrthographicCamera(width=30, height=20, ymag=1.5, camera_to_world=place)
    floor = quad("floor", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    (again,) = written(Scene((floor,), (), (camera,)), tmp_path).cameras
    assert isinstance(again, OrthographicCamera)
    assert again.ymag == 1.5
    assert again.width / again.height == 1.5


def test_refuses(tmp_path: Path) -> None:
    scene = cornell_like_room()
    with pytest.raises(FileFormatError, match=r"\.glb"):
        save_scene(scene, tmp_path / "scene.gltf")
    with pytest.raises(InputFileError):
        save_scene(scene, tmp_path / "absent" / "scene.glb")
    with pytest.raises(FileFormatError, match="AmbientDome"):
        save_scene(Scene(sources=(AmbientDome([1.0]),)), tmp_path / "a.glb")
    wall = scene.surfaces[0]
    paint = Texture(torch.ones(1, 1, 3), torch.zeros(len(wall.vertices), 2))
    skin = Surface("skin", wall.vertices, wall.faces, wall.albedo, texture=paint)
    with pytest.raises(FileFormatError, match="texture"):
        save_scene(Scene((skin,)), tmp_path / "a.glb")
    strange = quad("q", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], albedo=[math.nan, 0.1])
    with pytest.raises(FileFormatError, match="2 channels"):
        save_scene(Scene((strange,)), tmp_path / "a.glb")
    assert list(tmp_path.iterdir()) == []


def test_lobes(tmp_path: Path) -> None:
    floor = quad("floor", [[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], albedo=[0.3, 0.2, 0.1])
    for specular, shininess in (([0.5, 0.4, 0.6], 80.0), (0.2, 0.0), (0.7, 3e5)):
        made = Scene((floor.shiny(specular, shininess),))
        again = written(made, tmp_path).surfaces[0]
        assert_close(again.specular.float(), made.surfaces[0].specular)
        assert_close(again.albedo.float(), made.surfaces[0].albedo)
        assert float(again.shininess) == pytest.approx(shininess, rel=1e-6)
    with pytest.raises(FileFormatError, match="largest specular"):
        save_scene(Scene((floor.shiny([0.9, 0.1, 0.1], 5.0),)), tmp_path / "wrong.glb")
