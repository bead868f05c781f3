"""Damaged and hostile files: a named error, soon, and nothing outside the folder is read."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.scene.gltf_files import SQUARE, TRIANGLE, GltfFile, data_uri, one_triangle, png
from torchradiometry import errors
from torchradiometry.errors import (
    EmptySceneError,
    FileFormatError,
    InputFileError,
    RadiometryError,
    ResourceLimitError,
)
from torchradiometry.scene import (
    beside,
    gltf_container,
    gltf_materials,
    gltf_viewers,
    load,
    load_scene,
)
from torchradiometry.scene.gltf_fields import MAX_ENTRIES

BOMB = png(np.zeros((2, 2)))[:16] + struct.pack(">II", 60000, 60000) + png([[0]])[24:]


def test_missing_folder_unknown(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        load_scene(tmp_path / "absent.glb")
    with pytest.raises(InputFileError, match="a folder"):
        load_scene(tmp_path)
    for name in ("scene.blend", "scene", "scene.zip", "scene.txt"):
        (tmp_path / name).write_bytes(b"x")
        with pytest.raises(FileFormatError, match=r"use \.gltf"):
            load_scene(tmp_path / name)


@pytest.mark.parametrize("ending", [".gltf", ".glb", ".obj", ".ply", ".stl", ".off"])
@pytest.mark.parametrize(
    "data", [b"", b"hello", b"\0" * 200, b"glTF", bytes(range(256)), b"solid x", b"{}", b"[]"]
)
def test_no_mesh(tmp_path: Path, ending: str, data: bytes) -> None:
    path = tmp_path / f"file{ending}"
    path.write_bytes(data)
    with pytest.raises((FileFormatError, EmptySceneError)) as caught:
        load_scene(path)
    assert len(str(caught.value)) < 600
    assert "\n" not in str(caught.value)


def test_truncated_at_every_length(tmp_path: Path) -> None:
    whole = one_triangle().glb(tmp_path / "whole.glb").read_bytes()
    path = tmp_path / "cut.glb"
    for length in range(0, len(whole) - 1, 7):
        path.write_bytes(whole[:length])
        with pytest.raises(FileFormatError):
            load_scene(path)


def test_every_byte_of_the_tree_damaged(tmp_path: Path) -> None:
    """Whatever one wrong character does, it is a scene or a named error."""
    text = one_triangle(emissiveFactor=[1, 1, 1]).gltf(tmp_path / "a.gltf").read_text()
    path, outcomes = tmp_path / "b.gltf", set()
    for place in range(0, len(text), 3):
        for character in '9"-':
            path.write_text(text[:place] + character + text[place + 1 :])
            try:
                load_scene(path)
                outcomes.add("scene")
            except RadiometryError as error:
                outcomes.add(type(error).__name__)
    assert outcomes <= {"scene", *errors.__all__}
    assert {"scene", "FileFormatError"} <= outcomes


def broken(change) -> GltfFile:
    file = one_triangle()
    change(file.tree)
    return file


BAD = {
    "version 1": lambda t: t.update(asset={"version": "1.0"}),
    "no version": lambda t: t.update(asset={}),
    "required extension": lambda t: t.update(extensionsRequired=["KHR_draco_mesh_compression"]),
    "cycle": lambda t: t["nodes"][0].update(children=[0]),
    "two parents": lambda t: (
        t["nodes"].extend([{"children": [0]}]),
        t["scenes"][0]["nodes"].append(1),
    ),
    "scene index": lambda t: t.update(scene=3),
    "node index": lambda t: t["scenes"][0].update(nodes=[9]),
    "negative index": lambda t: t["scenes"][0].update(nodes=[-1]),
    "mesh index": lambda t: t["nodes"][0].update(mesh=1),
    "child index": lambda t: t["nodes"][0].update(children=[5]),
    "camera index": lambda t: t["nodes"][0].update(camera=0),
    "light index": lambda t: t["nodes"][0].update(extensions={"KHR_lights_punctual": {"light": 0}}),
    "accessor index": lambda t: t["meshes"][0]["primitives"][0].update(indices=7),
    "no position": lambda t: t["meshes"][0]["primitives"][0].update(attributes={}),
    "accessor past its view": lambda t: t["accessors"][0].update(count=4),
    "huge count": lambda t: t["accessors"][0].update(count=2**24),
    "huge offset": lambda t: t["accessors"][0].update(byteOffset=2**60),
    "component type": lambda t: t["accessors"][0].update(componentType=7),
    "element type": lambda t: t["accessors"][0].update(type="MAT4"),
    "float indices": lambda t: t["meshes"][0]["primitives"][0].update(indices=0),
    "view past its buffer": lambda t: t["bufferViews"][0].update(byteLength=10**9),
    "stride too small": lambda t: t["bufferViews"][0].update(byteStride=4),
    "buffer index": lambda t: t["bufferViews"][0].update(buffer=2),
    "nodes no list": lambda t: t.update(nodes={"a": 1}),
    "node no object": lambda t: t.update(nodes=[3]),
    "matrix of 15": lambda t: t["nodes"][0].update(matrix=[0] * 15),
    "projective matrix": lambda t: t["nodes"][0].update(matrix=[1] * 16),
    "infinite scale": lambda t: t["nodes"][0].update(scale=[1e999, 1, 1]),
    "overflowing scale": lambda t: t["nodes"][0].update(scale=[10**400, 1, 1]),
    "zero quaternion": lambda t: t["nodes"][0].update(rotation=[0, 0, 0, 0]),
    "text for number": lambda t: t["nodes"][0].update(translation=["a", 0, 0]),
    "name no text": lambda t: t["nodes"][0].update(name=5),
    "material index": lambda t: t["meshes"][0]["primitives"][0].update(material=0),
}


@pytest.mark.parametrize("name", BAD)
def test_inconsistent_trees(tmp_path: Path, name: str) -> None:
    path = broken(BAD[name]).gltf(tmp_path / "bad.gltf")
    with pytest.raises(FileFormatError) as caught:
        load_scene(path)
    assert "bad.gltf" in str(caught.value)


def test_lights_and_cameras_with_bad_values(tmp_path: Path) -> None:
    file = one_triangle()
    file.tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 60}}]
    file.tree["nodes"][0]["camera"] = 0
    with pytest.raises(FileFormatError, match="radians"):
        load_scene(file.gltf(tmp_path / "a.gltf"))
    file = one_triangle()
    spot = {"type": "spot", "spot": {"outerConeAngle": 30}}
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [spot]}}
    file.tree["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    with pytest.raises(FileFormatError, match="radians"):
        load_scene(file.gltf(tmp_path / "a.gltf"))


def test_deep_hierarchy(tmp_path: Path) -> None:
    """Ten thousand nodes below each other need no recursion."""
    file = one_triangle()
    for k in range(10_000):
        file.node(children=[k], translation=[0, 0, 1e-4])
    file.tree["scenes"][0]["nodes"] = [10_000]
    vertices = load_scene(file.gltf(tmp_path / "deep.gltf")).surfaces[0].vertices
    assert vertices[0, 2].item() == pytest.approx(1.0)


def test_deep_json(tmp_path: Path) -> None:
    path = tmp_path / "deep.gltf"
    path.write_text('{"nodes":' + "[" * 200_000)
    with pytest.raises(FileFormatError):
        load_scene(path)


def test_many_instances_are_refused_before_they_are_built(tmp_path: Path) -> None:
    file = GltfFile()
    points = np.zeros((60_000, 3))
    mesh = file.mesh(file.primitive(points))
    file.tree["nodes"] = [{"mesh": mesh}] * 2000
    file.tree["scenes"][0]["nodes"] = list(range(2000))
    with pytest.raises(ResourceLimitError):
        load_scene(file.glb(tmp_path / "many.glb"))


def test_blank_accessors_are_bounded(tmp_path: Path) -> None:
    file = one_triangle()
    file.tree["accessors"][0] = {"componentType": 5126, "type": "VEC3", "count": 2**24}
    with pytest.raises(ResourceLimitError):
        load_scene(file.gltf(tmp_path / "blank.gltf"))


@pytest.mark.parametrize(
    "uri",
    ["../secret.bin", "/etc/passwd", "http://example.org/x.bin", "file:///etc/passwd", "a/../../b",
     "%2e%2e/secret.bin", "C:\\x.bin", "..\\secret.bin", ""],
)  # fmt: skip
def test_addresses_outside_the_folder(tmp_path: Path, uri: str) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"\0" * 100)
    file = one_triangle()
    file.tree["buffers"] = [{"byteLength": 42, "uri": uri}]
    with pytest.raises(FileFormatError, match="inside the folder"):
        load_scene(file.gltf(inside / "scene.gltf"))


def test_links_out_of_the_folder(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"\0" * 100)
    (inside / "link.bin").symlink_to(tmp_path / "secret.bin")
    file = one_triangle()
    file.tree["buffers"] = [{"byteLength": 42, "uri": "link.bin"}]
    with pytest.raises(FileFormatError, match="inside the folder"):
        load_scene(file.gltf(inside / "scene.gltf"))


@pytest.mark.parametrize("uri", ["data:;base64,????", "data:nothing", "absent.bin"])
def test_bad_buffers(tmp_path: Path, uri: str) -> None:
    file = one_triangle()
    file.tree["buffers"] = [{"byteLength": 42, "uri": uri}]
    with pytest.raises((FileFormatError, InputFileError)):
        load_scene(file.gltf(tmp_path / "scene.gltf"))


def textured(picture: bytes) -> GltfFile:
    file = GltfFile()
    uv = file.accessor([[0, 0], [1, 0], [1, 1], [0, 1]])
    primitive = file.primitive(SQUARE, [0, 1, 2], attributes={"TEXCOORD_0": uv}, material=0)
    paint = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    file.tree |= {
        "materials": [paint],
        "textures": [{"source": 0}],
        "images": [{"uri": data_uri(picture)}],
    }
    file.node(mesh=file.mesh(primitive))
    return file


@pytest.mark.parametrize(
    ("picture", "error"),
    [
        (b"", FileFormatError),
        (b"GIF89a" + b"\0" * 50, FileFormatError),
        (png([[0]])[:40], FileFormatError),
        (b"\xff\xd8\xff\xe0\0\0", FileFormatError),
        (BOMB, ResourceLimitError),
    ],
)
def test_bad_pictures(tmp_path: Path, picture: bytes, error: type) -> None:
    with pytest.raises(error, match=r"images\[0\]"):
        load_scene(textured(picture).gltf(tmp_path / "a.gltf"))


def test_texture_without_coordinates(tmp_path: Path) -> None:
    file = textured(png([[0]]))
    del file.tree["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"]
    with pytest.raises(FileFormatError, match="TEXCOORD_0"):
        load_scene(file.gltf(tmp_path / "a.gltf"))


def test_nothing_to_see(tmp_path: Path) -> None:
    file = GltfFile()
    file.node(mesh=file.mesh(file.primitive(TRIANGLE, mode=1)))
    with pytest.raises(EmptySceneError, match="no triangles"):
        load_scene(file.gltf(tmp_path / "lines.gltf"))
    (tmp_path / "empty.gltf").write_text(json.dumps({"asset": {"version": "2.0"}}))
    with pytest.raises(EmptySceneError):
        load_scene(tmp_path / "empty.gltf")


def test_obj_reads_no_material_outside(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.mtl").write_text("newmtl red\nKd 1 0 0\n")
    obj = "mtllib ../secret.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
    (inside / "a.obj").write_text(obj)
    with pytest.raises(FileFormatError, match="only files inside the folder"):
        load_scene(inside / "a.obj")


def test_many_primitives_without_corners_are_refused(tmp_path: Path) -> None:
    """They count no vertices, and each would be a surface."""
    file = GltfFile()
    empty = {"attributes": {"POSITION": file.accessor(np.zeros((0, 3)))}, "mode": 0}
    mesh = file.mesh(*[empty] * 1000)
    file.tree["nodes"] = [{"mesh": mesh}] * 1000
    file.tree["scenes"][0]["nodes"] = list(range(1000))
    with pytest.raises(ResourceLimitError, match="primitives"):
        load_scene(file.glb(tmp_path / "many.glb"))


def test_lists_and_lights_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = one_triangle()
    file.tree["nodes"] += [{}] * MAX_ENTRIES
    with pytest.raises(ResourceLimitError, match="entries"):
        load_scene(file.gltf(tmp_path / "nodes.gltf"))
    file = one_triangle()
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    lamp = {"extensions": {"KHR_lights_punctual": {"light": 0}}}
    file.tree["nodes"] += [lamp] * 5
    file.tree["scenes"][0]["nodes"] = list(range(6))
    assert len(load_scene(file.gltf(tmp_path / "lamps.gltf")).sources) == 5
    monkeypatch.setattr(gltf_viewers, "MAX_VIEWERS", 4)
    with pytest.raises(ResourceLimitError, match="lights"):
        load_scene(tmp_path / "lamps.gltf")


def test_a_file_by_many_names_counts_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = one_triangle()
    (tmp_path / "b.bin").write_bytes(bytes(file.data))
    length = len(file.data)
    file.tree["buffers"] = [{"byteLength": length, "uri": "./" * k + "b.bin"} for k in range(2)]
    for k, view in enumerate(file.tree["bufferViews"]):
        view["buffer"] = k
    path = file.gltf(tmp_path / "scene.gltf")
    assert load_scene(path).surfaces[0].count == 1
    monkeypatch.setattr(gltf_container, "MAX_BYTES", 2 * length - 1)
    with pytest.raises(ResourceLimitError, match="bytes"):
        load_scene(path)


def test_pictures_count_together_and_are_held_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = textured(png(np.zeros((8, 8))))
    file.tree["images"] *= 2
    file.tree["textures"].append({"source": 1})
    (primitive,) = file.tree["meshes"][0]["primitives"]
    paint = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}
    file.tree["materials"] += [file.tree["materials"][0], paint]
    file.tree["meshes"][0]["primitives"] = [{**primitive, "material": k} for k in range(3)]
    path = file.gltf(tmp_path / "a.gltf")
    first, again, other = (s.texture.image for s in load_scene(path, dtype=torch.float64).surfaces)
    assert first is again
    assert other is not first
    monkeypatch.setattr(gltf_materials, "MAX_PIXELS", 100)
    with pytest.raises(ResourceLimitError, match="together"):
        load_scene(path)


def test_what_errors_quote_is_short(tmp_path: Path) -> None:
    file = one_triangle()
    file.tree["nodes"][0]["name"] = "a" * 10_000
    assert len(load_scene(file.gltf(tmp_path / "a.gltf")).surfaces[0].name) == 200
    file.tree["asset"]["version"] = "9" * 10_000
    with pytest.raises(FileFormatError) as caught:
        load_scene(file.gltf(tmp_path / "a.gltf"))
    assert len(str(caught.value)) < 1000


def test_only_the_two_chunks_of_the_format_are_read(tmp_path: Path) -> None:
    data = one_triangle().glb(tmp_path / "a.glb").read_bytes()
    more = data + struct.pack("<I4s", 0, b"MORE") * 1000
    whole = more[:8] + struct.pack("<I", len(more)) + more[12:]
    (tmp_path / "a.glb").write_bytes(whole)
    assert load_scene(tmp_path / "a.glb").surfaces[0].count == 1
    again = data + data[12:]
    (tmp_path / "b.glb").write_bytes(again[:8] + struct.pack("<I", len(again)) + again[12:])
    assert load_scene(tmp_path / "b.glb").surfaces[0].count == 1
    start = 20 + struct.unpack("<I", data[12:16])[0]
    twice = data[:start] + data[12:]
    (tmp_path / "c.glb").write_bytes(twice[:8] + struct.pack("<I", len(twice)) + twice[12:])
    with pytest.raises(FileFormatError, match="two chunks"):
        load_scene(tmp_path / "c.glb")


def test_meshes_of_text_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    path = tmp_path / "a.obj"
    path.write_text(corners + "".join(f"usemtl m{k}\nf 1 2 3\n" for k in range(5000)))
    with pytest.raises(ResourceLimitError, match="5000 materials"):
        load_scene(path)
    monkeypatch.setattr(load, "MAX_MESH_TEXT", 100)
    path.write_text(corners + "f 1 2 3\n" + "#" * 100)
    with pytest.raises(ResourceLimitError, match="bytes of text"):
        load_scene(path)


def test_textures_of_an_obj_count_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "p.png").write_bytes(png(np.zeros((8, 8, 3))))
    paints = "".join(f"newmtl m{k}\nmap_Kd p.png\n" for k in range(2))
    (tmp_path / "paint.mtl").write_text(paints)
    faces = "".join(f"usemtl m{k}\nf 1/1 2/2 3/3\n" for k in range(2))
    path = tmp_path / "a.obj"
    path.write_text("mtllib paint.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n" + faces)
    assert [s.texture.image.shape for s in load_scene(path).surfaces] == [(8, 8, 3)] * 2
    monkeypatch.setattr(load, "MAX_PIXELS", 100)
    with pytest.raises(ResourceLimitError, match="pixels"):
        load_scene(path)
    monkeypatch.undo()
    monkeypatch.setattr(beside, "MAX_TEXT", 10)
    with pytest.raises(ResourceLimitError, match="bytes"):
        load_scene(path)
