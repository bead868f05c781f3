"""`.obj`, `.mtl` and `.ply`: nothing of them is lost in silence, colour, picture, face or line."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from tests.tolerances import assert_close
from torchradiometry.errors import (
    FileFormatError,
    InputFileError,
    MissingDependencyError,
    RadiometryError,
    ResourceLimitError,
)
from torchradiometry.files import srgb_to_linear
from torchradiometry.geometry.meshes import face_areas
from torchradiometry.scene import Surface, beside, load_scene, surface_from_trimesh
from torchradiometry.scene.wavefront import CONCAVITY, as_utf8, tidied_mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n"
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
PAINTED = "mtllib m.mtl\n" + CORNERS + "usemtl m\nf 1/1 2/2 3/3\n"


def loaded(folder: Path, mesh: str, paint: str | None = None, name: str = "a.obj") -> Surface:
    (folder / name).write_bytes(mesh.encode())
    if paint is not None:
        (folder / "m.mtl").write_bytes(paint.encode())
    (surface,) = load_scene(folder / name, dtype=torch.float64).surfaces
    return surface


def linear(*encoded: float) -> list[float]:
    return srgb_to_linear(np.array(encoded)).tolist()


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("Kd 0.3 0.5 0.7", (0.3, 0.5, 0.7)),
        ("Kd 0.4 0.4 0.4", (0.4, 0.4, 0.4)),  # what trimesh fills in where nothing is said
        ("Kd 0.3001 0.5 0.7", (0.3001, 0.5, 0.7)),  # not rounded to 8 bits
        ("Kd 0.8", (0.8, 0.8, 0.8)),
        ("Kd 0.1 0.2 0.3 1.0", (0.1, 0.2, 0.3)),
        ("kd 1 0 0", (1.0, 0.0, 0.0)),
        ("\tKd\t1  0 \t0 ", (1.0, 0.0, 0.0)),
        ("Ks 0.5\nNs x\nillum\nimage 3\nKd 1 0 0", (1.0, 0.0, 0.0)),
    ],
)
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_reflectance_is_what_the_file_says(
    tmp_path: Path, said: str, meant: tuple[float, ...], ending: str
) -> None:
    paint = f"# paint\nnewmtl m\n{said}\n".replace("\n", ending)
    assert_close(loaded(tmp_path, PAINTED, paint).albedo, linear(*meant))


@pytest.mark.parametrize(
    "said", ["255 128 0", "-1 0 0", "1 x 0", "nan 0 0", "inf 0 0", "1 1", "xyz 1 1 1", ""]
)
def test_a_reflectance_that_is_none_is_refused(tmp_path: Path, said: str) -> None:
    with pytest.raises(FileFormatError, match="three numbers from 0 to 1"):
        loaded(tmp_path, PAINTED, f"newmtl m\nKd {said}\n")


@pytest.mark.parametrize("faces", ["f 1 2 3\n", "f 1/1 2/2 3/3\n", "usemtl m\nf 1/1 2/2 3/3\n"])
def test_without_a_colour_the_albedo_is_a_half(tmp_path: Path, faces: str) -> None:
    """trimesh paints a mesh of texture coordinates without a picture in a grey of its own."""
    for library in ("", "mtllib m.mtl\n", "# no mtllib here\n"):
        paint = "newmtl m\nillum 2\n" if library else None
        surface = loaded(tmp_path, library + CORNERS + faces, paint)
        assert surface.texture is None
        assert_close(surface.albedo, [0.5] * 3)


def test_texture_coordinates_cost_no_colours(tmp_path: Path) -> None:
    corners = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    assert_close(loaded(tmp_path, corners + "f 1/1 2/2 3/3\n").albedo, [1.0, 0, 0])
    assert_close(loaded(tmp_path, ply(""), name="a.ply").albedo, [1.0, 0, 0])


def ply(comment: str) -> str:
    floats = "".join(f"property float {name}\n" for name in "xyzst")
    bytes_ = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    head = f"ply\nformat ascii 1.0\n{comment}element vertex 3\n{floats}{bytes_}element face 1\n"
    rows = "0 0 0 0 0 255 0 0\n1 0 0 1 0 255 0 0\n0 1 0 0 1 255 0 0\n3 0 1 2\n"
    return head + "property list uchar int vertex_indices\nend_header\n" + rows


@pytest.mark.parametrize("address", ["wood.png", "deep/wood.png", "deep\\wood.png", " wood.png "])
def test_pictures_beside_the_mesh(tmp_path: Path, address: str) -> None:
    (tmp_path / "deep").mkdir()
    for folder in (tmp_path, tmp_path / "deep"):
        Image.new("RGB", (3, 2), (255, 0, 0)).save(folder / "wood.png")
    for surface in (
        loaded(tmp_path, PAINTED, f"newmtl m\nmap_Kd {address}\n"),
        loaded(tmp_path, ply(f"comment TextureFile {address}\n"), name="a.ply"),
    ):
        assert surface.texture is not None
        assert_close(surface.texture.image[0, 0], [1.0, 0, 0])


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("none.png", "a missing file, 'none.png'; put it beside the mesh"),
        ("torn.png", "no picture that can be read"),
        ("-s 2 2 1 wood.png", "take the options out"),
        ("C:\\pictures\\wood.png", "only files inside the folder"),
        ("../wood.png", "only files inside the folder"),
        ("/wood.png", "only files inside the folder"),
        ("folder", "a folder"),
        ("w" * 300 + ".png", "the system refuses"),
        ("deep.png", "more than 8 bits"),
        ("float.tiff", "more than 8 bits"),
    ],
)
def test_a_picture_that_is_none_is_named(tmp_path: Path, address: str, message: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "torn.png").write_bytes(b"xx")
    Image.fromarray(np.full((2, 2), 30000, np.uint16)).save(tmp_path / "deep.png")
    Image.new("F", (2, 2), 0.5).save(tmp_path / "float.tiff")
    with pytest.raises(RadiometryError, match=message):
        loaded(tmp_path, PAINTED, f"newmtl m\nKd 1 1 1\nmap_Kd {address}\n")


def test_a_picture_that_is_cut_off_is_named(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    for name in ("a.png", "a.jpg"):
        Image.fromarray(noise).save(tmp_path / name)
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[: len(whole) // 2])
        with pytest.raises(InputFileError, match="truncated"):
            loaded(tmp_path, PAINTED, f"newmtl m\nmap_Kd {name}\n")


def test_a_picture_of_a_ply_is_named_without_a_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(InputFileError, match=r"a missing file, 'none\.png'"):
        loaded(tmp_path, ply("comment TextureFile none.png\n"), name="a.ply")
    assert not caplog.records


def test_a_picture_of_too_many_pixels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.new("RGB", (30, 30)).save(tmp_path / "a.png")
    for most in (700, 300):  # beyond the bound Pillow warns, beyond twice the bound it refuses
        monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", most)
        with pytest.raises(ResourceLimitError, match=f"shrink it to {most} pixels"):
            loaded(tmp_path, PAINTED, "newmtl m\nmap_Kd a.png\n")


def test_without_pillow_a_picture_is_not_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing() -> None:
        raise MissingDependencyError("Pillow", "no installation", "install it")

    Image.new("RGB", (3, 3)).save(tmp_path / "a.png")
    monkeypatch.setattr(beside, "pillow", missing)
    with pytest.raises(MissingDependencyError, match="Pillow"):
        loaded(tmp_path, PAINTED, "newmtl m\nmap_Kd a.png\n")


def test_every_corner_of_a_picture_has_coordinates(tmp_path: Path) -> None:
    Image.new("RGB", (3, 3)).save(tmp_path / "a.png")
    for faces in ("f 1 2 3\n", "f 1/1 2/2 3/3\nf 1 2 3\n"):
        mesh = "mtllib m.mtl\n" + CORNERS + "usemtl m\n" + faces
        with pytest.raises(FileFormatError, match=r"a\.png: .* without texture coordinates"):
            loaded(tmp_path, mesh, "newmtl m\nmap_Kd a.png\n")


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        ("mtllib none.mtl\n" + CORNERS + "f 1 2 3\n", "a missing file, 'none.mtl'"),
        ("mtllib m.txt\n" + CORNERS + "f 1 2 3\n", r"ends in \.mtl"),
        ("mtllib\n" + CORNERS + "f 1 2 3\n", "the address ''"),
        ("mtllib m.mtl\nmtllib n.mtl\n" + CORNERS + "f 1 2 3\n", "2 material files"),
        ("mtllib m.mtl\n" + CORNERS + "usemtl q\nf 1 2 3\n", r"its material file lacks \(q\)"),
    ],
)
def test_material_files_that_say_nothing_are_named(tmp_path: Path, mesh: str, message: str) -> None:
    (tmp_path / "m.txt").write_text("newmtl m\nKd 1 0 0\n")
    with pytest.raises(RadiometryError, match=message):
        loaded(tmp_path, mesh, "newmtl m\nKd 1 1 1\n")
    with pytest.raises(FileFormatError, match="a material without a name"):
        loaded(tmp_path, PAINTED, "newmtl \nKd 1 1 1\n")


def test_names_of_materials_are_told_apart_by_words(tmp_path: Path) -> None:
    mesh = PAINTED.replace("usemtl m", "usemtl\tMaterial #1  a ")
    assert_close(loaded(tmp_path, mesh, "newmtl  Material #1 a\nKd 1 0 0\n").albedo, [1.0, 0, 0])


@pytest.mark.parametrize(
    "mesh",
    [
        SQUARE + "f 1 2 3\nf 2 4 3\n",
        SQUARE + "f 1 2 4 3\n",
        SQUARE + "f\t1 2 3\nf 2 4 3\n",
        SQUARE + "f 1 2 3\nf\t2 4 3\n",
        SQUARE + "  f 1 2 3\nf 2 4 3\n",
        SQUARE + "f 1 2 3\n\tf 2 4 3",
        SQUARE + "f 1 2 3 # one\nf 2 4 3 # two\n",
        SQUARE.replace("v ", " v\t") + "f 1 2 3\nf 2 4 3\n",
        SQUARE.replace("\n", " # corner\n") + "f 1 2 3\nf 2 4 3\n",
        SQUARE + "f 1 2 \\\n 3\nf 2 4\\\n 3\n",
        SQUARE + "f -4 -3 -2\nf -3 -1 -2\n",
        SQUARE + "f -4 -3 -1 -2\n",
        SQUARE + "vn 0 0 1\nf 1//1 2//1 4//1 3//1\n",
        SQUARE + "g a\nf 1 2 3\ng b\nf 2 4 3\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 1 1 0\nf 2 4 3\n",
        "v 9 9 9\nv 8 8 8\nv 7 0 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf -3//-1 -2//-1 -1//-1\n"
        "v 1 1 0\nvn 0 0 1\nf -3//1 -1//-1 -2//-1\nv 5 5 5\nvn 0 1 0\n",
        "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1\nv 5 5 5\n",
    ],
)
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_no_line_is_lost(tmp_path: Path, mesh: str, ending: str) -> None:
    surface = loaded(tmp_path, mesh.replace("\n", ending))
    assert surface.count == 2
    assert face_areas(surface.vertices, surface.faces).tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ("f 1 2\nf 2 4 3\n", r"fewer than three corners \(f 1 2\)"),
        ("f 2 4 3\nf\n", "fewer than three corners"),
        ("f 0 1 2\n", r"before the first vertex \(f 0 1 2\)"),
        ("f 1/1 2/2 00/3\n", "before the first vertex"),
        ("f -1 -2 -5\n", r"before the first vertex \(f 4 3 0\)"),
        ("f -1 -2 -6\n", r"before the first vertex \(f 4 3 -1\)"),
        ("f 1 2 3 4\n", "not convex"),
    ],
)
def test_faces_that_are_none_are_refused(tmp_path: Path, faces: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=message):
        loaded(tmp_path, SQUARE + faces)


def test_corners_and_numbers_that_are_none_are_named(tmp_path: Path) -> None:
    for mesh in (
        SQUARE + "f 1 2 x 3\n",
        SQUARE + "f 1 2 99999999999999999999 3\n",
        SQUARE.replace("1 0 0", "1 a 0") + "f 1 2 4 3\n",
    ):
        with pytest.raises(FileFormatError, match="no mesh"):
            loaded(tmp_path, mesh)


AXES = st.sampled_from([0, 1, 2])
POINTS = st.lists(st.tuples(*[st.integers(-4, 4)] * 2), min_size=4, max_size=8, unique=True)


@given(POINTS, AXES, st.sampled_from([1e-9, 1.0, 1e9]))
def test_polygons_keep_their_area_or_are_refused(
    tmp_path_factory: pytest.TempPathFactory,
    points: list[tuple[int, int]],
    axis: int,
    scale: float,
) -> None:
    """The fan of a flat polygon has the area of the shoelace formula, or the face is refused."""
    corners = scale * np.insert(np.array(points, dtype=float), axis, 2.0, axis=1)
    rows = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
    text = rows + "f" + "".join(f" {k + 1}" for k in range(len(points))) + "\n"
    x, y = scale * np.array(points, dtype=float).T
    shoelace = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    (a, b), rest = points[0], points[1:]
    turns = [(p - a) * (v - b) - (q - b) * (u - a) for (p, q), (u, v) in pairwise(rest)]
    one_way = all(turn >= 0 for turn in turns) or all(turn <= 0 for turn in turns)
    folder = tmp_path_factory.mktemp("polygon")
    if not one_way:
        with pytest.raises(FileFormatError, match="not convex"):
            loaded(folder, text)
        return
    surface = loaded(folder, text)
    total = face_areas(surface.vertices, surface.faces).sum().item()
    assert total == pytest.approx(shoelace, rel=CONCAVITY)


def test_a_quad_that_is_hardly_warped_is_no_concave_one(tmp_path: Path) -> None:
    warped = SQUARE.replace("v 1 1 0", "v 1 1 0.4")
    assert loaded(tmp_path, warped + "f 1 2 4 3\n").count == 2


@given(st.binary(max_size=60), st.sampled_from(["v", "f", "mtllib", "usemtl", "#", "vt"]))
def test_any_bytes_are_tidied_or_named(line: bytes, key: str) -> None:
    text = SQUARE.encode() + key.encode() + b" " + line + b"\n\nf 1 2 4 3\n"
    try:
        tidied = tidied_mesh(Path("a.obj"), text)
    except RadiometryError:
        return
    assert b"\nf 1 2 4 3\n" in tidied
    assert b"\r" not in tidied
    assert as_utf8(tidied) == tidied


def test_meshes_in_memory_follow_the_same_rules() -> None:
    import trimesh

    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)))
    assert_close(surface_from_trimesh(box).albedo, [0.5] * 3)
    box.visual.material.image = Image.fromarray(np.full((2, 2), 30000, np.uint16))
    with pytest.raises(FileFormatError, match="more than 8 bits"):
        surface_from_trimesh(box)
