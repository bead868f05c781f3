"""PhongShading: closed forms of every lobe, domes without highlight, views, errors."""

from __future__ import annotations

import math

import pytest
import torch

from tests.cases import SMALL, directions, images, source
from tests.tolerances import assert_close
from torchradiometry import materials
from torchradiometry.errors import DTypeError, ShapeError
from torchradiometry.materials import BlinnPhong, NormalizedPhong, OriginalPhong, Phong
from torchradiometry.shade import (
    LambertianShading,
    PhongShading,
    phong_shading,
    shade_points,
    to_points,
    view_directions,
)
from torchradiometry.sources import DirectionalSource

DTYPES = [torch.float32, torch.float64]
LOBES = [Phong, NormalizedPhong, OriginalPhong, BlinnPhong]
#: incidence and mirror offset, degrees: eye along z, normal tilted by the incidence / 2
INCIDENCE, SHININESS, SPECULAR, POWER = 0.5, 20.0, 0.25, 3.0


def setting(dtype: torch.dtype) -> tuple[torch.Tensor, ...]:
    """A tilted normal, a light, black albedo, k_s, n: one pixel."""
    light = torch.tensor([math.sin(INCIDENCE), 0.0, math.cos(INCIDENCE)], dtype=dtype)
    normal = torch.tensor([math.sin(0.2), 0.0, math.cos(0.2)], dtype=dtype)
    one = torch.ones(1, 1, 1, 1, dtype=dtype)
    return light, normal.reshape(1, 3, 1, 1), 0 * one, SPECULAR * one, SHININESS * one


def closed_form(lobe: type) -> float:
    """All directions lie in one plane, so every cosine is that of a difference of angles."""
    incidence = math.cos(INCIDENCE - 0.2)
    mirrored = math.cos(2 * 0.2 - INCIDENCE)
    half = math.cos(INCIDENCE / 2 - 0.2)
    n = SHININESS
    brdf = {
        Phong: SPECULAR * mirrored**n,
        OriginalPhong: SPECULAR * mirrored**n / incidence,
        NormalizedPhong: SPECULAR * (n + 2) / (2 * math.pi) * mirrored**n,
        BlinnPhong: SPECULAR * (n + 2) * (n + 4) / (8 * math.pi * (2 ** (-n / 2) + n)) * half**n,
    }[lobe]
    return brdf * POWER * incidence


@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("dtype", DTYPES)
def test_closed_form_of_each_lobe(dtype: torch.dtype, lobe: type) -> None:
    light, normal, albedo, specular, shininess = setting(dtype)
    layer = PhongShading(lobe, DirectionalSource(light, torch.tensor([POWER], dtype=dtype)))
    # an exponent multiplies the rounding of the inputs: 20 roundings in float32
    rtol = 1e-12 if dtype is torch.float64 else SHININESS * torch.finfo(dtype).eps
    assert_close(
        layer(normal, albedo, specular, shininess).reshape(()), closed_form(lobe), rtol=rtol
    )


@pytest.mark.parametrize("lobe", LOBES)
def test_without_specular_it_is_lambertian(lobe: type) -> None:
    normal, albedo, shininess = images("normal", "albedo", "shininess")(torch.float64, SMALL)
    sun = source("directional", torch.float64)
    found = PhongShading(lobe, sun)(normal, albedo, 0 * albedo, shininess)
    assert_close(found, LambertianShading(sun)(normal, albedo))


@pytest.mark.parametrize("lobe", LOBES)
def test_equals_the_material_at_each_point(lobe: type) -> None:
    names = ("normal", "albedo", "specular", "shininess", "position", "visibility")
    values = images(*names, light=6)(torch.float64, SMALL)
    normal, albedo, specular, shininess, position, visibility = values
    members = [source(name, torch.float64) for name in ("directional", "point", "sphere")]
    eye = directions(2, 3, 4, dtype=torch.float64, seed=9).permute(0, 3, 1, 2)
    material = materials.SumMaterial(
        [
            materials.Lambertian(to_points(albedo)),
            lobe(to_points(specular), to_points(shininess)),
        ]
    )
    expected = shade_points(
        material,
        members,
        to_points(position),
        to_points(normal),
        to_points(eye),
        visibility.flatten(2).transpose(0, 1),
    )
    layer = PhongShading(lobe)
    found = layer(
        normal, albedo, specular, shininess, members, position, visibility, outgoing_direction=eye
    )
    assert_close(to_points(found), expected)


def test_domes_have_no_highlight() -> None:
    names = ("normal", "albedo", "specular", "shininess")
    inputs = images(*names)(torch.float64, SMALL)
    dome = source("dome", torch.float64)
    expected = LambertianShading(dome)(*inputs[:2])
    assert_close(PhongShading(sources=dome)(*inputs), expected)


def test_the_visibility_of_a_dome_does_not_slip_to_another_light() -> None:
    names = ("normal", "albedo", "specular", "shininess", "visibility")
    *inputs, visibility = images(*names, light=4)(torch.float64, SMALL)
    dome, sun = source("dome", torch.float64), source("directional", torch.float64)
    swapped = visibility[:, [2, 3, 0, 1]]
    assert_close(
        PhongShading()(*inputs, [dome, sun], visibility=visibility),
        PhongShading()(*inputs, [sun, dome], visibility=swapped),
    )


def test_eye_is_above_for_orthographic_and_at_the_origin_for_perspective() -> None:
    normal, position = images("normal", "position")(torch.float64, SMALL)
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).reshape(1, 3, 1, 1)
    assert_close(view_directions(normal), up.expand_as(normal))
    away = view_directions(normal, position - 3 * up, perspective=True)
    assert_close(away, -(position - 3 * up) / (position - 3 * up).norm(dim=1, keepdim=True))


def test_perspective_equals_explicit_directions() -> None:
    names = ("normal", "albedo", "specular", "shininess", "position")
    *inputs, position = images(*names)(torch.float64, SMALL)
    position = position - torch.tensor([0.0, 0.0, 3.0]).double().reshape(1, 3, 1, 1)
    sun = source("directional", torch.float64)
    eye = view_directions(inputs[0], position, perspective=True)
    assert_close(
        PhongShading(sources=sun, perspective=True)(*inputs, position=position),
        phong_shading(Phong, *inputs, [sun], eye),
    )


@pytest.mark.parametrize("lobe", LOBES)
@pytest.mark.parametrize("vector", [[0.0, 0, 0], [0.0, 0, -1], [1.0, 0, 0], [0.0, 0, 1]])
@pytest.mark.parametrize("shininess", [0.0, 0.5, 1e6])
def test_extremes_are_finite_in_value_and_gradient(
    lobe: type, vector: list[float], shininess: float
) -> None:
    normal = torch.tensor(vector).reshape(1, 3, 1, 1)
    one = torch.ones(1, 1, 1, 1)
    leaves = [t.clone().requires_grad_() for t in (normal, 0 * one, 0 * one, shininess * one)]
    sun = DirectionalSource([[1.0, 0, 0], [0.0, 0, 1], [0.0, 0, -1]], torch.ones(3, 1))
    out = PhongShading(lobe, sun)(*leaves)
    out.sum().backward()
    assert torch.isfinite(out).all()
    assert (out >= 0).all()
    assert all(torch.isfinite(t.grad).all() for t in leaves)


def test_a_lobe_of_another_kind_is_named() -> None:
    with pytest.raises(DTypeError, match="NormalizedPhong"):
        PhongShading(materials.Lambertian)


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("specular", torch.zeros(2, 2, 3, 4)),
        ("specular", torch.zeros(2, 3, 4, 3)),
        ("shininess", torch.zeros(2, 3, 3, 4)),
        ("outgoing_direction", torch.zeros(2, 3, 1, 1)),
    ],
)
def test_wrong_shapes_are_named(name: str, bad: torch.Tensor) -> None:
    names = ("normal", "albedo", "specular", "shininess")
    inputs = dict(zip(names, images(*names)(torch.float32, SMALL), strict=True))
    with pytest.raises(ShapeError) as caught:
        PhongShading(sources=source("directional", torch.float32))(**{**inputs, name: bad})
    assert caught.value.where == name


def test_perspective_needs_positions() -> None:
    inputs = images("normal", "albedo", "specular", "shininess")(torch.float32, SMALL)
    with pytest.raises(ShapeError, match="perspective"):
        PhongShading(sources=source("directional", torch.float32), perspective=True)(*inputs)


def test_repr_names_lobe_and_view() -> None:
    assert "BlinnPhong, perspective" in repr(PhongShading(BlinnPhong, perspective=True))
