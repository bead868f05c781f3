"""Scenes: triangles, bounds, albedo at points, moving, static mistakes."""

import pytest
import torch
from torch.autograd import gradcheck

from tests.tolerances import assert_close
from torchradiometry.errors import DTypeError, EmptySceneError, OutOfRangeError, ShapeError
from torchradiometry.scene import Scene, Surface, Texture, quad, sphere
from torchradiometry.scene.texture_lookup import sample_texture, triangle_means
from torchradiometry.sources import PointSource

SQUARE = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
UV = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]], dtype=torch.float64)


def picture(height: int, width: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(height, width, 3, dtype=torch.float64, generator=generator)


def painted(image: torch.Tensor, name: str = "painted") -> Surface:
    plain = quad(name, SQUARE, albedo=[0.5, 1, 1], dtype=torch.float64)
    return Surface(
        name, plain.vertices, plain.faces, plain.albedo, texture=Texture(image, UV, ("clamp",) * 2)
    )


def test_triangles_of_several_surfaces() -> None:
    lamp = quad("lamp", SQUARE, albedo=0.2, emission=[1.0, 2, 3], two_sided=True)
    ball = sphere("ball", 2.0, (5, 0, 0), subdivisions=1)
    triangles = Scene((lamp, ball)).triangles
    assert triangles.corners.shape == (82, 3, 3)
    assert triangles.surface.tolist() == [0] * 2 + [1] * 80
    assert triangles.two_sided.tolist() == [True] * 2 + [False] * 80
    assert_close(triangles.emission[:3], [[1.0, 2, 3], [1, 2, 3], [0, 0, 0]])
    assert_close(triangles.albedo[[0, 81]], [[0.2] * 3, [0.5] * 3])
    assert_close(triangles.normals[0], [[0.0, 0, 1]] * 3)
    radial = (triangles.corners[2:] - torch.tensor([5.0, 0, 0])) / 2
    assert_close(triangles.normals[2:], radial, atol=1e-6)
    assert triangles.patches.area[:2].tolist() == [0.5, 0.5]


def test_one_channel_fits_all() -> None:
    grey = quad("grey", SQUARE, albedo=[0.4], emission=[1.0])
    colour = quad("colour", SQUARE, albedo=[0.1, 0.2, 0.3, 0.4], emission=[2.0])
    scene = Scene((grey, colour))
    assert scene.channels == 4
    assert_close(scene.triangles.albedo[0], [0.4] * 4)
    assert_close(scene.triangles.emission[3], [2.0] * 4)


def test_albedo_at() -> None:
    plain = quad("plain", SQUARE, albedo=[0.1, 0.2, 0.3], dtype=torch.float64)
    image = picture(5, 4)
    scene = Scene((plain, painted(image), painted(image * 0.5, "dim")))
    # a texel centre: column 2, row 1 from the top
    x, y = 2.5 / 4, 1 - 1.5 / 5
    barycentric = torch.tensor([[1 - y, x, y - x]], dtype=torch.float64).expand(4, 3)
    triangle = torch.tensor([1, 3, 5, -1])
    factor = torch.tensor([0.5, 1, 1], dtype=torch.float64)
    found = scene.albedo_at(triangle, barycentric)
    expected = torch.stack((plain.albedo, factor * image[1, 2], factor * image[1, 2] / 2))
    assert_close(found, torch.cat((expected, torch.zeros(1, 3).double())))


def test_mean_is_the_average_of_the_look_up() -> None:
    """Against the mean of many random look-ups, and exactly for a picture of one colour."""
    scene = Scene((painted(picture(6, 6)),))
    generator = torch.Generator().manual_seed(1)
    s, t = torch.rand(2, 200_000, dtype=torch.float64, generator=generator)
    root = s.sqrt()
    barycentric = torch.stack((1 - root, root * (1 - t), root * t), -1)
    for face in (0, 1):
        points = scene.albedo_at(torch.full((200_000,), face), barycentric)
        assert_close(scene.triangles.albedo[face], points.mean(0), rtol=0.02)
    flat = Texture(torch.full((7, 9, 3), 0.25).double(), UV)
    assert_close(triangle_means(flat, torch.tensor([[0, 1, 2]])), [[0.25] * 3])


def test_fine_pictures_are_averaged_first() -> None:
    """A checkerboard of 1024 texels has mean 1/2, however it falls on the samples."""
    board = (torch.arange(1024)[:, None] + torch.arange(1024)[None]) % 2
    texture = Texture(board.double().unsqueeze(-1), UV, ("clamp", "clamp"))
    means = triangle_means(texture, torch.tensor([[0, 1, 2], [0, 2, 3]]))
    assert_close(means, [[0.5], [0.5]], rtol=1e-3)


@pytest.mark.parametrize(
    ("wrap", "column"), [("repeat", 1), ("mirror", 2), ("clamp", 3)]
)  # u = 1.375 of four texels
def test_wrapping(wrap: str, column: int) -> None:
    image = torch.arange(4, dtype=torch.float64).reshape(1, 4, 1)
    texture = Texture(image, UV, (wrap, wrap))
    where = torch.tensor([1.375, 0.5], dtype=torch.float64)
    assert sample_texture(texture, where).item() == pytest.approx(column)
    for far in (-1e9, 1e9, float("nan"), float("inf")):
        value = sample_texture(texture, torch.tensor([far, 0.5], dtype=torch.float64))
        assert torch.isnan(value).item() or 0 <= value.item() <= 3


def test_gradients() -> None:
    image = picture(3, 3).requires_grad_()
    paint = torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64, requires_grad=True)
    vertices = torch.tensor(SQUARE, dtype=torch.float64, requires_grad=True)
    weights = torch.tensor([[0.2, 0.3, 0.5]], dtype=torch.float64)

    def numbers(v, a, i):
        faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
        scene = Scene((Surface("s", v, faces, a, texture=Texture(i, UV)),))
        triangles = scene.triangles
        return (
            triangles.corners,
            triangles.normals,
            triangles.albedo,
            scene.albedo_at(torch.tensor([1]), weights),
        )

    assert gradcheck(numbers, (vertices, paint, image))


def test_bounds_and_emissive() -> None:
    lamp = quad("lamp", SQUARE, emission=1.0)
    scene = Scene((lamp, quad("wall", torch.tensor(SQUARE) - 3)))
    low, high = scene.bounds
    assert low.tolist() == [-3.0, -3, -3]
    assert high.tolist() == [1.0, 1, 0]
    assert [s.name for s in scene.emissive] == ["lamp"]


def test_empty() -> None:
    with pytest.raises(EmptySceneError):
        _ = Scene().bounds
    with pytest.raises(EmptySceneError):
        _ = Scene().triangles


def test_to_copies() -> None:
    scene = Scene((painted(picture(2, 2)),), (PointSource([0.0, 0, 1], [1.0]),))
    moved = scene.to(torch.float64)
    assert moved.sources[0].position.dtype == torch.float64
    assert scene.sources[0].position.dtype == torch.float32
    single = scene.to(torch.float32).surfaces[0]
    assert single.vertices.dtype == single.texture.image.dtype == torch.float32
    assert single.faces.dtype == torch.int64


VERTICES, FACES, GREY = torch.zeros(3, 3), torch.zeros(1, 3, dtype=torch.int64), torch.ones(3)


@pytest.mark.parametrize(
    ("fields", "error"),
    [
        ({"vertices": torch.zeros(3, 2)}, ShapeError),
        ({"vertices": torch.zeros(3, 3).long()}, DTypeError),
        ({"faces": torch.zeros(1, 4).long()}, ShapeError),
        ({"faces": torch.zeros(1, 3)}, DTypeError),
        ({"albedo": torch.zeros(1, 3)}, ShapeError),
        ({"albedo": 0.5}, DTypeError),
        ({"emission": torch.zeros(2)}, ShapeError),
        ({"normals": torch.zeros(2, 3)}, ShapeError),
        ({"texture": Texture(torch.zeros(2, 2, 3), torch.zeros(2, 2))}, ShapeError),
        ({"texture": Texture(torch.zeros(2, 2, 2), torch.zeros(3, 2))}, ShapeError),
    ],
)
def test_surfaces_refuse(fields, error) -> None:
    with pytest.raises(error):
        Surface(**({"name": "s", "vertices": VERTICES, "faces": FACES, "albedo": GREY} | fields))


def test_textures_refuse() -> None:
    with pytest.raises(ShapeError):
        Texture(torch.zeros(0, 2, 3), torch.zeros(3, 2))
    with pytest.raises(ShapeError):
        Texture(torch.zeros(2, 2), torch.zeros(3, 2))
    with pytest.raises(OutOfRangeError, match="repeat"):
        Texture(torch.zeros(2, 2, 3), torch.zeros(3, 2), wrap=("tile", "repeat"))


def test_scenes_refuse() -> None:
    with pytest.raises(DTypeError, match="Surfaces"):
        Scene(("wall",))
    with pytest.raises(DTypeError, match="a Surface; pass a tuple of Surfaces"):
        Scene(quad("alone", SQUARE))
    with pytest.raises(DTypeError, match="AbstractSource"):
        Scene(sources=(1,))
    with pytest.raises(ShapeError, match="channels"):
        Scene((quad("a", SQUARE, albedo=[0.1, 0.2]), quad("b", SQUARE)))
