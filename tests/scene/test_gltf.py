"""glTF: every mapping of materials, lights, cameras and transforms, checked by hand."""

import io
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from tests.scene.gltf_files import SQUARE, TRIANGLE, GltfFile, data_uri, one_triangle, png
from tests.tolerances import assert_close
from torchradiometry import errors
from torchradiometry.geometry.cameras import OrthographicCamera, PinholeCamera
from torchradiometry.geometry.meshes import face_normals
from torchradiometry.scene import Scene, Surface, load_scene
from torchradiometry.sources import DirectionalSource, PointSource, SpotSource

HALF = math.sqrt(0.5)
#: 90 degrees about +y: -z becomes -x
TURN_Y = [0, HALF, 0, HALF]


def load(file: GltfFile, folder: Path, dtype: torch.dtype = torch.float64) -> Scene:
    """The scene of a file, which must be the same as .gltf and as .glb."""
    text = load_scene(file.gltf(folder / "scene.gltf"), dtype=dtype)
    binary = load_scene(file.glb(folder / "scene.glb"), dtype=dtype)
    for a, b in zip(text.surfaces, binary.surfaces, strict=True):
        assert a.name == b.name
        assert_close(a.vertices, b.vertices)
        assert (a.faces == b.faces).all()
    assert len(text.sources) == len(binary.sources)
    assert len(text.cameras) == len(binary.cameras)
    return text


def only(scene: Scene) -> Surface:
    (surface,) = scene.surfaces
    return surface


def winding(surface: Surface) -> torch.Tensor:
    return face_normals(surface.vertices, surface.faces)


def test_default_material(tmp_path: Path) -> None:
    surface = only(load(one_triangle(), tmp_path))
    assert surface.name == "leaf"
    assert_close(surface.vertices, TRIANGLE)
    assert_close(surface.albedo, [1.0, 1, 1])
    assert_close(surface.emission, [0.0, 0, 0])
    assert surface.normals is None
    assert surface.texture is None
    assert not surface.two_sided


def test_material(tmp_path: Path) -> None:
    file = one_triangle(
        pbrMetallicRoughness={"baseColorFactor": [0.2, 0.4, 0.6, 0.9]},
        emissiveFactor=[1.0, 0.5, 0.25],
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}},
        doubleSided=True,
    )
    surface = only(load(file, tmp_path))
    assert_close(surface.albedo, [0.2, 0.4, 0.6])
    assert_close(surface.emission, [8.0, 4, 2])
    assert surface.two_sided


def test_emission_without_strength(tmp_path: Path) -> None:
    surface = only(load(one_triangle(emissiveFactor=[0.1, 0.2, 0.3]), tmp_path))
    assert_close(surface.emission, [0.1, 0.2, 0.3])


def test_a_lobe_takes_the_place_of_the_base_colour(tmp_path: Path) -> None:
    """Diffuse and specular colour share the light; the default is a white mirror."""
    name = "KHR_materials_pbrSpecularGlossiness"
    given = {"diffuseFactor": [0.5, 0.25, 1.0, 1.0], "specularFactor": [0.1, 0.2, 0.2]}
    file = one_triangle(
        pbrMetallicRoughness={"baseColorFactor": [0.9, 0.9, 0.9, 1.0]},
        extensions={name: {**given, "glossinessFactor": 0.5}},
    )
    file.tree["extensionsRequired"] = [name]
    surface = only(load(file, tmp_path))
    assert_close(surface.albedo, [0.4, 0.2, 0.8])
    assert_close(surface.specular, [0.1, 0.2, 0.2])
    assert float(surface.shininess) == pytest.approx(7.5)  # roughness 1/4: (16 - 1) / 2
    mirror = only(load(one_triangle(extensions={name: {}}), tmp_path))
    assert_close(mirror.albedo, [0.0, 0, 0])
    assert_close(mirror.specular, [1.0, 1, 1])
    assert float(mirror.shininess) == pytest.approx(1e6)
    assert only(load(one_triangle(), tmp_path)).glossy is False


@pytest.mark.parametrize("bad", [{"specularFactor": [2, 0, 0]}, {"glossinessFactor": "high"}])
def test_a_lobe_that_is_none_is_named(bad: dict[str, object], tmp_path: Path) -> None:
    file = one_triangle(extensions={"KHR_materials_pbrSpecularGlossiness": bad})
    with pytest.raises(errors.RadiometryError):
        load_scene(file.gltf(tmp_path / "scene.gltf")).require_valid()


def test_lights(tmp_path: Path) -> None:
    file = one_triangle()
    file.tree["extensions"] = {
        "KHR_lights_punctual": {
            "lights": [
                {"type": "point", "intensity": 3.0, "color": [1.0, 0.5, 0.0], "range": 2.0},
                {"type": "directional", "intensity": 4.0},
                {"type": "spot", "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.3}},
                {"type": "spot", "spot": {}},
            ]
        }
    }
    for light in range(4):
        extension = {"KHR_lights_punctual": {"light": light}}
        file.node(translation=[1, 2, 3], rotation=TURN_Y, scale=[5, 5, 5], extensions=extension)
    file.tree["scenes"][0]["nodes"] = [0, 1, 2, 3, 4]
    point, distant, spot, plain = load(file, tmp_path).sources
    assert isinstance(point, PointSource)
    assert_close(point.position, [[1.0, 2, 3]])
    assert_close(point.intensity, [[3.0, 1.5, 0]])
    assert isinstance(distant, DirectionalSource)
    assert_close(distant.direction, [[1.0, 0, 0]])
    assert_close(distant.irradiance, [[4.0, 4, 4]])
    assert isinstance(spot, SpotSource)
    assert_close(spot.axis, [[-1.0, 0, 0]])
    assert_close(spot.intensity, [[1.0, 1, 1]])
    assert_close(torch.cat((spot.inner_cone, spot.outer_cone)), [[0.1], [0.3]])
    assert_close(torch.cat((plain.inner_cone, plain.outer_cone)), [[0.0], [math.pi / 4]])


def test_light_shines_along_minus_z(tmp_path: Path) -> None:
    """A directional light on an unrotated node lights what faces +z."""
    file = one_triangle()
    light = {"type": "directional", "intensity": 2.0}
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    file.tree["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    (source,) = load(file, tmp_path).sources
    up = torch.tensor([[0.0, 0, 1]], dtype=torch.float64)
    arrival = source(None, up)
    assert_close((arrival.direction * up).sum(-1), [[1.0]])


def test_cameras(tmp_path: Path) -> None:
    file = one_triangle()
    perspective = {"yfov": 0.7, "aspectRatio": 2.0, "znear": 0.1}
    parallel = {"xmag": 1.0, "ymag": 2.0, "znear": 0.1, "zfar": 9.0}
    file.tree["cameras"] = [
        {"type": "perspective", "perspective": perspective},
        {"type": "orthographic", "orthographic": parallel},
    ]
    file.node(camera=0, translation=[1, 2, 3], rotation=TURN_Y, scale=[2, 3, 4])
    file.node(camera=1, scale=[-1, 1, 1])
    file.tree["scenes"][0]["nodes"] = [0, 1, 2]
    pinhole, flat = load(file, tmp_path).cameras
    assert isinstance(pinhole, PinholeCamera)
    assert (pinhole.yfov, pinhole.width / pinhole.height) == (0.7, 2.0)
    assert_close(pinhole.position, [1.0, 2, 3])
    assert_close(pinhole.forward, [-1.0, 0, 0], atol=1e-12)
    assert isinstance(flat, OrthographicCamera)
    assert (flat.ymag, flat.width / flat.height) == (2.0, 0.5)
    assert_close(flat.forward, [0.0, 0, -1])


def test_nested_transforms(tmp_path: Path) -> None:
    """T R S of the child, then of the parent; a matrix does the same."""
    file = one_triangle()
    file.tree["nodes"][0] |= {"scale": [2, 3, 4], "translation": [0, 0, 1]}
    file.node(translation=[10, 0, 0], rotation=TURN_Y, children=[0])
    matrix = np.array([[1, 0, 0, 0], [0, 1, 0, 5], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    file.node(matrix=matrix.T.reshape(-1).tolist(), children=[1])
    file.tree["scenes"][0]["nodes"] = [2]
    surface = only(load(file, tmp_path))
    # (0,0,0) -> (0,0,1) -> about y: (1,0,0) -> (11,0,0) -> (11,5,0); x becomes -z, z becomes x
    assert_close(surface.vertices, [[11.0, 5, 0], [11, 5, -2], [11, 8, 0]], atol=1e-12)
    assert_close(winding(surface), [[1.0, 0, 0]], atol=1e-12)


def test_normals_use_the_inverse_transpose(tmp_path: Path) -> None:
    file = GltfFile()
    slanted = np.array([[HALF, 0, HALF]] * 3)
    points = [[0.0, 0, 0], [0, 1, 0], [-1, 0, 1]]
    normals = file.accessor(slanted)
    primitive = file.primitive(points, [0, 1, 2], attributes={"NORMAL": normals})
    file.node(mesh=file.mesh(primitive), scale=[4, 1, 1])
    surface = only(load(file, tmp_path))
    expected = torch.tensor([0.25, 0, 1], dtype=torch.float64)
    expected = expected / expected.norm()
    assert_close(surface.normals, expected.expand(3, 3), rtol=1e-7)
    assert_close(winding(surface).abs(), expected[None], rtol=1e-7)


@pytest.mark.parametrize("scale", [[-1, 1, 1], [1, 1, -1], [-1, -1, -1], [2, -3, 4]])
def test_mirrored_node_keeps_its_front(tmp_path: Path, scale: list[float]) -> None:
    file = GltfFile()
    normals = file.accessor([[0.0, 0, 1]] * 3)
    primitive = file.primitive(TRIANGLE, [0, 1, 2], attributes={"NORMAL": normals})
    file.node(mesh=file.mesh(primitive), scale=scale)
    scene = load(file, tmp_path)
    surface = only(scene)
    front = torch.tensor([[0.0, 0, np.sign(scale[2])]], dtype=torch.float64)
    assert_close(surface.normals, front.expand(3, 3))
    assert_close(winding(surface), front)


def test_flat_scale_keeps_the_normal(tmp_path: Path) -> None:
    """Scale 0 along the normal leaves the triangle and its normal as they are."""
    file = GltfFile()
    normals = file.accessor([[0.0, 0, 1]] * 3)
    primitive = file.primitive(TRIANGLE, [0, 1, 2], attributes={"NORMAL": normals})
    file.node(mesh=file.mesh(primitive), scale=[1, 1, 0])
    assert_close(only(load(file, tmp_path)).normals, [[0.0, 0, 1]] * 3)


def test_instances_and_primitives(tmp_path: Path) -> None:
    file = GltfFile()
    points = {"mode": 0}
    parts = (file.primitive(TRIANGLE), file.primitive(SQUARE, [0, 1, 2, 0, 2, 3]))
    mesh = file.mesh(*parts, file.primitive(TRIANGLE, **points))
    file.node(name="a", mesh=mesh)
    file.node(name="b", mesh=mesh, translation=[0, 0, 1])
    file.tree["scenes"] = [{"nodes": []}, {"nodes": [0, 1]}]
    file.tree["scene"] = 1
    scene = load(file, tmp_path)
    assert [s.count for s in scene.surfaces] == [1, 2, 1, 2]
    assert len({s.name for s in scene.surfaces}) == 4
    assert scene.surfaces[3].vertices[:, 2].tolist() == [1.0] * 4


def test_strips_and_fans(tmp_path: Path) -> None:
    file = GltfFile()
    zigzag = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]]
    strip = file.primitive(zigzag, [0, 1, 2, 3, 4, 4], mode=5)
    fan = file.primitive(SQUARE, mode=6)
    file.node(mesh=file.mesh(strip, fan))
    a, b = load(file, tmp_path).surfaces
    assert a.count == 3
    assert b.count == 2
    for surface in (a, b):
        assert_close(winding(surface), [[0.0, 0, 1]])


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_index_types(tmp_path: Path, dtype: str) -> None:
    file = GltfFile()
    primitive = file.primitive(SQUARE)
    primitive["indices"] = file.accessor([0, 1, 2, 0, 2, 3], dtype)
    file.node(mesh=file.mesh(primitive))
    assert only(load(file, tmp_path)).faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_strided_sparse_and_quantised_accessors(tmp_path: Path) -> None:
    file = GltfFile()
    mixed = np.zeros(3, dtype=[("point", "<f4", 3), ("normal", "i1", 3), ("gap", "u1")])
    mixed["point"] = TRIANGLE
    mixed["normal"] = [0, 0, 127]
    view = file.view(mixed.tobytes(), byteStride=16)
    base = {"bufferView": view, "count": 3, "type": "VEC3"}
    where, what = (
        file.view(np.array([2], "<u2").tobytes()),
        file.view(np.array([[0, 7, 0]], "<f4").tobytes()),
    )
    sparse = {
        "count": 1,
        "indices": {"bufferView": where, "componentType": 5123},
        "values": {"bufferView": what},
    }
    file.tree["accessors"] += [
        {**base, "componentType": 5126, "sparse": sparse},
        {**base, "componentType": 5120, "byteOffset": 12, "normalized": True},
    ]
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1}}
    file.node(mesh=file.mesh(primitive))
    surface = only(load(file, tmp_path))
    assert_close(surface.vertices, [[0.0, 0, 0], [1, 0, 0], [0, 7, 0]])
    assert_close(surface.normals, [[0.0, 0, 1]] * 3)


def textured(image: dict, uv: object = ((0, 0), (1, 0), (1, 1), (0, 1)), **info) -> GltfFile:
    """A square with the picture stretched over it; glTF's v runs down."""
    file = GltfFile()
    texcoord = file.accessor(uv)
    primitive = file.primitive(
        SQUARE, [0, 1, 2, 0, 2, 3], attributes={"TEXCOORD_0": texcoord}, material=0
    )
    factor = {"baseColorFactor": [0.5, 1, 1, 1], "baseColorTexture": {"index": 0, **info}}
    file.tree |= {
        "materials": [{"pbrMetallicRoughness": factor}],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33071, "wrapT": 33648}],
        "images": [image],
    }
    file.node(mesh=file.mesh(primitive))
    return file


#: 8-bit sRGB 188 is linear 0.5029 (IEC 61966-2-1)
GREY188 = ((188 / 255 + 0.055) / 1.055) ** 2.4
PICTURE = png([[[255, 0, 0], [0, 255, 0]], [[188, 188, 188], [0, 0, 255]]])


def albedo_at(scene: Scene, x: float, y: float) -> torch.Tensor:
    """Albedo of the unit square at (x, y)."""
    upper = y > x
    # triangle 0 is (0,0) (1,0) (1,1), triangle 1 is (0,0) (1,1) (0,1)
    weights = [1 - y, x, y - x] if upper else [1 - x, x - y, y]
    barycentric = torch.tensor([weights], dtype=torch.float64)
    return scene.albedo_at(torch.tensor([int(upper)]), barycentric)[0]


def test_texture(tmp_path: Path) -> None:
    scene = load(textured({"uri": data_uri(PICTURE)}), tmp_path)
    texture = only(scene).texture
    assert texture.wrap == ("clamp", "mirror")
    # picture row 0 lies at v = 0, which glTF puts at y = 0 here
    assert_close(albedo_at(scene, 0.25, 0.25), [0.5, 0, 0], rtol=1e-6, atol=1e-6)
    assert_close(albedo_at(scene, 0.75, 0.25), [0.0, 1, 0], rtol=1e-6, atol=1e-6)
    grey = [GREY188 / 2, GREY188, GREY188]
    assert_close(albedo_at(scene, 0.25, 0.75), grey, rtol=1e-6, atol=1e-6)
    assert_close(albedo_at(scene, 0.5, 0.25), [0.25, 0.5, 0], rtol=1e-6, atol=1e-6)


def test_texture_from_a_buffer_and_a_file(tmp_path: Path) -> None:
    inside = textured({"mimeType": "image/png"})
    inside.tree["images"][0]["bufferView"] = inside.view(PICTURE)
    (tmp_path / "a picture.png").write_bytes(PICTURE)
    beside = textured({"uri": "a%20picture.png"})
    for file in (inside, beside):
        scene = load(file, tmp_path)
        assert_close(albedo_at(scene, 0.75, 0.25), [0.0, 1, 0], rtol=1e-6, atol=1e-6)


def test_texture_transform(tmp_path: Path) -> None:
    """Offset (1/2, 0) and scale 1/2: the square shows the upper right texel only."""
    extension = {"KHR_texture_transform": {"offset": [0.5, 0.0], "scale": [0.0, 0.0]}}
    file = textured({"uri": data_uri(PICTURE)}, extensions=extension)
    file.tree["samplers"] = [{"wrapS": 33071, "wrapT": 33071}]
    scene = load(file, tmp_path)
    assert_close(albedo_at(scene, 0.1, 0.9), [0.25, 0.5, 0], rtol=1e-6, atol=1e-6)
    turn = {"KHR_texture_transform": {"rotation": math.pi / 2, "offset": [0.0, 1.0]}}
    scene = load(textured({"uri": data_uri(PICTURE)}, extensions=turn), tmp_path)
    # (u, v) -> (v, 1 - u): the lower left of glTF's plane, (1/4, 1/4), shows texel (0, 1)
    assert_close(albedo_at(scene, 0.25, 0.25)[0], GREY188 / 2, rtol=1e-6)


def test_grey_picture(tmp_path: Path) -> None:
    scene = load(textured({"uri": data_uri(png([[188]]))}), tmp_path)
    assert_close(albedo_at(scene, 0.5, 0.2), [GREY188 / 2, GREY188, GREY188], rtol=1e-6)


def test_jpeg(tmp_path: Path) -> None:
    stream = io.BytesIO()
    Image.new("RGB", (16, 8), (188, 188, 188)).save(stream, "JPEG", quality=100)
    scene = load(textured({"uri": data_uri(stream.getvalue(), "image/jpeg")}), tmp_path)
    assert only(scene).texture.image.shape == (8, 16, 3)
    grey = [GREY188 / 2, GREY188, GREY188]
    assert_close(albedo_at(scene, 0.5, 0.2), grey, rtol=0.02)


def test_mean_albedo_of_triangles(tmp_path: Path) -> None:
    pixels = np.zeros((64, 64, 3))
    pixels[:, 32:] = 255
    scene = load(textured({"uri": data_uri(png(pixels))}), tmp_path)
    # right half white: 3/4 of the lower right triangle, 1/4 of the upper left one
    mean = scene.triangles.albedo
    assert_close(mean[:, 1], [0.75, 0.25], rtol=1e-3)
    assert_close(mean[:, 0], mean[:, 1] / 2)


def test_emissive_texture_keeps_the_flux(tmp_path: Path) -> None:
    file = textured({"uri": data_uri(png([[0, 255], [0, 255]]))})
    file.tree["materials"] = [{"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}]
    surface = only(load(file, tmp_path))
    assert_close(surface.emission, [0.5, 0.5, 0.5], rtol=1e-2)
    assert surface.texture is None


def test_dtype(tmp_path: Path) -> None:
    scene = load(textured({"uri": data_uri(PICTURE)}), tmp_path, torch.float32)
    assert scene.triangles.albedo.dtype == torch.float32
    assert only(scene).texture.image.dtype == torch.float32
