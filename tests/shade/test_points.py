"""shade_points: any material under any sources is f_r E cos V, summed."""

from __future__ import annotations

import math

import pytest
import torch

from tests.cases import MATERIALS, SMALL, Case, directions, source, surface_points
from tests.tolerances import assert_close
from torchradiometry.errors import ShapeError
from torchradiometry.materials import Lambertian, LambertianSpecular, Phong
from torchradiometry.shade import LambertianShading, PointShading, shade_points, to_points
from torchradiometry.sources import AmbientDome, DirectionalSource, PointSource

F64 = torch.float64


@pytest.mark.parametrize("case", MATERIALS, ids=lambda case: case.name)
def test_sum_over_lights_of_brdf_irradiance_and_cosine(case: Case) -> None:
    material, lamps = case.build(F64), source("point", F64)
    position, normal = surface_points(F64, SMALL)
    eye = directions(2, 12, dtype=F64, seed=11)
    visibility = torch.rand(2, 2, 12, dtype=F64)
    expected = 0
    for i in range(2):
        offset = lamps.position[i] - position
        distance = offset.norm(dim=-1, keepdim=True)
        towards = offset / distance
        cosine = (towards * normal).sum(-1, keepdim=True).clamp(min=0)
        facing = lamps.intensity[i] / distance**2
        brdf = material(towards, eye, normal)
        expected = expected + brdf * facing * cosine * visibility[i].unsqueeze(-1)
    assert_close(shade_points(material, [lamps], position, normal, eye, visibility), expected)


def test_points_and_image_agree() -> None:
    normal = directions(2, 3, 4, dtype=F64, seed=12).permute(0, 3, 1, 2)
    sun, dome = source("directional", F64), source("half_dome", F64)
    albedo = torch.tensor([0.2, 0.5, 0.8], dtype=F64)
    image = LambertianShading([sun, dome])(normal, albedo.reshape(1, 3, 1, 1).expand_as(normal))
    points = to_points(normal)
    eye = torch.tensor([0.0, 0.0, 1.0], dtype=F64).expand_as(points)
    assert_close(PointShading(Lambertian(albedo), [sun, dome])(None, points, eye), to_points(image))


def test_a_dome_meets_the_diffuse_part_only() -> None:
    dome = AmbientDome(torch.tensor([2.0], dtype=F64))
    _, normal = surface_points(F64, SMALL)
    painted = LambertianSpecular(0.4, 0.5, 30.0).to(F64)
    assert_close(
        shade_points(painted, [dome], None, normal, normal), torch.full((2, 12, 1), 0.8), rtol=1e-7
    )
    assert (shade_points(Phong(0.5, 9.0).to(F64), [dome], None, normal, normal) == 0).all()


def test_any_batch_axes() -> None:
    normal = directions(2, 3, 5, dtype=F64, seed=13)
    sun = source("directional", F64)
    material = MATERIALS[-1].build(F64)
    full = shade_points(material, [sun], None, normal, normal)
    assert_close(full[1, 2], shade_points(material, [sun], None, normal[1, 2], normal[1, 2]))


def test_from_below_and_behind_a_surface_is_black() -> None:
    up = torch.tensor([[0.0, 0.0, 1.0]], dtype=F64)
    material = MATERIALS[-1].build(F64)
    for light, eye in ((up, -up), (-up, up)):
        sun = DirectionalSource(light[0], torch.ones(1, dtype=F64))
        assert (shade_points(material, [sun], None, up, eye) == 0).all()


def test_one_pixel_by_hand() -> None:
    up = torch.tensor([[0.0, 0.0, 1.0]], dtype=F64)
    lamp = PointSource(torch.tensor([0.0, 0.0, 2.0], dtype=F64), torch.tensor([8.0], dtype=F64))
    white = Lambertian(torch.ones(1, dtype=F64))
    assert_close(PointShading(white, lamp)(0 * up, up, up), [[2 / math.pi]])


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        ({"position": None}, "position"),
        ({"normal": torch.zeros(5, 2)}, "normal"),
        ({"outgoing_direction": torch.zeros(3, 5)}, "outgoing_direction"),
        ({"visibility": torch.zeros(3, 5)}, "visibility"),
        ({"sources": []}, "sources"),
    ],
)
def test_mistakes_are_named(arguments: dict, where: str) -> None:
    points = torch.zeros(5, 3)
    call = {
        "sources": [PointSource([0.0, 0, 1], [1.0])],
        "position": points,
        "normal": points,
        "outgoing_direction": points,
    }
    with pytest.raises(ShapeError) as caught:
        shade_points(Lambertian(0.5), **{**call, **arguments})
    assert caught.value.where == where
