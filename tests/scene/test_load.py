"""Plain mesh files through trimesh: every format, colours, transforms; default views."""

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from tests.scene.gltf_files import png
from tests.tolerances import assert_close
from torchradiometry.errors import (
    DegenerateGeometryError,
    DTypeError,
    EmptySceneError,
    FileFormatError,
    IndexRangeError,
)
from torchradiometry.files import srgb_to_linear
from torchradiometry.geometry.meshes import face_normals
from torchradiometry.scene import (
    Scene,
    cornell_like_room,
    load_scene,
    quad,
    surface_from_trimesh,
    with_default_view,
)

LINEAR = float(srgb_to_linear(np.array(204 / 255)))


@pytest.mark.parametrize("ending", ["obj", "ply", "stl", "off", "glb", "gltf"])
def test_a_box_in_every_format(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"crate.{ending}"
    made = trimesh.creation.box(extents=(1, 2, 3)).export(file_type=ending)
    files = made if isinstance(made, dict) else {path.name: made}
    for name, data in files.items():
        place = path if name == "model.gltf" else tmp_path / name
        place.write_bytes(data.encode() if isinstance(data, str) else data)
    scene = load_scene(path, dtype=torch.float64)
    (surface,) = scene.surfaces
    low, high = scene.bounds
    assert_close(torch.stack((low, high)), [[-0.5, -1, -1.5], [0.5, 1, 1.5]])
    assert_close(scene.triangles.patches.area.sum(), 22.0)
    outward = (scene.triangles.corners.mean(1) * scene.triangles.patches.normal).sum(-1)
    assert (outward > 0).all()
    assert not surface.two_sided
    assert (surface.emission == 0).all()
    assert scene.sources == scene.cameras == ()
    if ending in ("ply", "stl", "off"):
        assert_close(surface.albedo, [0.5, 0.5, 0.5])


def test_open_meshes_are_two_sided(tmp_path: Path) -> None:
    (tmp_path / "leaf.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (surface,) = load_scene(tmp_path / "leaf.obj").surfaces
    assert surface.name == "leaf"
    assert surface.two_sided
    assert_close(surface.albedo, [0.5, 0.5, 0.5])


def test_material_and_normals_of_obj(tmp_path: Path) -> None:
    (tmp_path / "paint.mtl").write_text("newmtl red\nKd 0.8 0 0\n")
    (tmp_path / "a.obj").write_text(
        "mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0.6 0.8\nusemtl red\nf 1//1 2//1 3//1\n"
    )
    (surface,) = load_scene(tmp_path / "a.obj", dtype=torch.float64).surfaces
    assert_close(surface.albedo, [LINEAR, 0, 0])
    assert_close(surface.normals, [[0.0, 0.6, 0.8]] * 3)


def test_texture_of_obj(tmp_path: Path) -> None:
    (tmp_path / "p.png").write_bytes(png([[[255, 0, 0], [204, 204, 204]]]))
    (tmp_path / "paint.mtl").write_text("newmtl skin\nmap_Kd p.png\n")
    (tmp_path / "a.obj").write_text(
        "mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.5\nvt 0.75 0.5\nvt 0.25 0.5\n"
        "usemtl skin\nf 1/1 2/2 3/3\n"
    )
    scene = load_scene(tmp_path / "a.obj", dtype=torch.float64)
    corners = torch.eye(3, dtype=torch.float64)
    found = scene.albedo_at(torch.zeros(3, dtype=torch.int64), corners)
    assert_close(found, [[1.0, 0, 0], [LINEAR] * 3, [1, 0, 0]], atol=1e-12)


def test_vertex_colours(tmp_path: Path) -> None:
    mesh = trimesh.creation.box()
    mesh.visual.vertex_colors = [204, 204, 204, 255]
    mesh.export(tmp_path / "a.ply")
    assert_close(load_scene(tmp_path / "a.ply").surfaces[0].albedo, [LINEAR] * 3)


def test_parts_keep_their_transforms() -> None:
    mesh = trimesh.creation.box()
    mirrored = np.diag([-2.0, 1, 1, 1])
    mirrored[:3, 3] = [5, 0, 0]
    surface = surface_from_trimesh(mesh, transform=mirrored, dtype=torch.float64)
    assert_close(surface.vertices.amin(0), [4.0, -0.5, -0.5])
    centre = surface.vertices[surface.faces].mean(1) - surface.vertices.mean(0)
    assert ((face_normals(surface.vertices, surface.faces) * centre).sum(-1) > 0).all()


def test_given_colours_win() -> None:
    surface = surface_from_trimesh(trimesh.creation.box(), albedo=0.2, emission=3.0, two_sided=True)
    assert_close(surface.albedo, [0.2] * 3)
    assert_close(surface.emission, [3.0] * 3)
    assert surface.two_sided


def test_faults_of_the_file_are_left_to_validate(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nv 0 1 0\nf 1 2 3\nf 2 3 4\n")
    faults = load_scene(tmp_path / "a.obj").validate()
    assert any("NaN" in fault.what for fault in faults)
    assert any("no area" in fault.what for fault in faults)


def test_numbers_beyond_float32_are_left_to_validate(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 1e300 inf 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "a.off").write_text("OFF\n3 1 0\ninf 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    for name in ("a.obj", "a.off"):
        faults = load_scene(tmp_path / name).validate()
        assert faults[0].what == "NaN or infinite coordinates"


def test_letters_of_other_encodings(tmp_path: Path) -> None:
    data = "# caf\u00e9\nmtllib p.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl r\u00f6t\nf 1 2 3\n"
    (tmp_path / "a.obj").write_bytes(data.encode("latin-1"))
    (tmp_path / "p.mtl").write_bytes("newmtl r\u00f6t\nKd 0.8 0 0\n".encode("latin-1"))
    assert_close(load_scene(tmp_path / "a.obj").surfaces[0].albedo, [LINEAR, 0, 0])


def test_flat_vertices(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(FileFormatError):
        load_scene(tmp_path / "a.obj")


def test_indices_beyond_the_vertices_are_left_to_validate(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    header = "ply\nformat ascii 1.0\nelement vertex 3\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_text(header + "0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n")
    faults = load_scene(path).validate()
    assert faults[0].error is IndexRangeError


def test_clouds_have_no_triangles(tmp_path: Path) -> None:
    trimesh.PointCloud(np.zeros((3, 3))).export(tmp_path / "a.ply")
    with pytest.raises(EmptySceneError, match="no triangles"):
        load_scene(tmp_path / "a.ply")


def test_whole_number_dtype(tmp_path: Path) -> None:
    with pytest.raises(DTypeError):
        load_scene(tmp_path / "a.obj", dtype=torch.int64)


@pytest.mark.parametrize(("width", "height"), [(64, 48), (30, 90)])
def test_default_view_sees_everything(width: int, height: int) -> None:
    wall = quad("wall", [[3, 7, 1], [4, 7, 1], [4, 9, 2], [3, 9, 2]], dtype=torch.float64)
    scene = with_default_view(Scene((wall,)), width=width, height=height)
    scene.require_valid()
    camera = scene.cameras[0]
    low, high = scene.bounds
    choice = torch.cartesian_prod(*(torch.arange(2),) * 3).double()
    pixels = camera.project(low + choice * (high - low))
    assert (camera.depth(low + choice * (high - low)) > 0).all()
    assert (pixels > 0).all()
    assert (pixels < torch.tensor([width, height])).all()
    assert camera.camera_to_world.dtype == torch.float64


def test_default_view_keeps_what_is_there() -> None:
    scene = cornell_like_room()
    kept = with_default_view(scene)
    assert kept.cameras == scene.cameras
    assert kept.sources == ()


def test_default_view_of_nothing() -> None:
    with pytest.raises(EmptySceneError):
        with_default_view(Scene())
    with pytest.raises(DegenerateGeometryError):
        with_default_view(Scene((quad("dot", torch.zeros(4, 3)),)))
