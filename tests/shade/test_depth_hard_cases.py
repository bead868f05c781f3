"""Depth maps and lights at the edge of what has a meaning: finite, masked, and nobody else's.

One call shades every map under every light here: along the view, grazing, below the horizon,
behind the camera, below the surface and exactly on it, near and distant, areas, samples, a dome.
"""

import math

import pytest
import torch
from torch import Tensor

from tests.tolerances import assert_close
from torchradiometry.geometry import depth_to_points
from torchradiometry.shade import (
    DepthSettings,
    InterreflectionShading,
    ShadeDepth,
    ambient_occlusion,
    cast_shadows,
    reflected_irradiance,
)
from torchradiometry.sources import (
    AbstractSource,
    AmbientDome,
    DirectionalSource,
    PointSource,
    SphereSource,
)

CAMERAS = pytest.mark.parametrize("camera", ["pinhole", "orthographic"])
DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])


def rough(rows: int = 8, columns: int = 8, dtype: torch.dtype = torch.float64) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return 2 + 0.3 * torch.rand(1, 1, rows, columns, dtype=dtype, generator=generator)


def flat() -> Tensor:
    return torch.full((1, 1, 8, 8), 2.0, dtype=torch.float64)


def with_values(depth: Tensor, **places: tuple) -> Tensor:
    depth = depth.clone()
    for value, where in places.values():
        depth[(0, 0, *where)] = value
    return depth


def holes() -> Tensor:
    generator = torch.Generator().manual_seed(3)
    hidden = torch.rand(1, 1, 8, 8, generator=generator) < 0.3
    return rough().masked_fill(hidden, math.nan)


ALL = slice(None)
MAPS = {
    "flat": flat(),
    "rough": rough(),
    "cliff": with_values(flat(), near=(1.0, (ALL, slice(4, None)))),
    "deep cliff": with_values(flat(), far=(1e4, (ALL, slice(0, 4)))),
    "spike": with_values(flat(), tip=(0.4, (3, 5))),
    "pit": with_values(flat(), floor=(60.0, (3, 5))),
    "holes": holes(),
    "masked border": with_values(
        rough(), top=(math.nan, (slice(0, 2),)), right=(math.nan, (ALL, slice(6, None)))
    ),
    "all masked": torch.full((1, 1, 5, 4), math.nan, dtype=torch.float64),
    "infinite": with_values(
        rough(), one=(math.inf, (2, 3)), other=(-math.inf, (5, 5)), third=(math.inf, (0, 0))
    ),
    "behind the camera": with_values(rough(), zero=(0.0, (2, 3)), below=(-3.0, (5, 5))),
    "one pixel": rough(1, 1),
    "one masked pixel": torch.full((1, 1, 1, 1), math.nan, dtype=torch.float64),
    "one row": rough(1, 8),
    "one column": rough(8, 1),
    "one column with holes": holes()[..., 1:2],
    "two by two": rough(2, 2),
    "alone": with_values(
        torch.full((1, 1, 5, 5), math.nan, dtype=torch.float64), one=(2.0, (2, 2))
    ),
}
EVERY = pytest.mark.parametrize("name", MAPS)


def view(camera: str, depth: Tensor, unit: float = 1.0) -> dict:
    if camera == "orthographic":
        return {"pixel_size": 0.1 * unit}
    rows, columns = depth.shape[-2:]
    matrix = torch.tensor([[30.0, 0, columns / 2], [0, 29, rows / 2], [0, 0, 1]])
    return {"intrinsics": matrix.to(depth)}


def on_the_surface(depth: Tensor, options: dict) -> Tensor:
    """The points of the first and of the middle pixel that are seen; else the camera."""
    points = depth_to_points(depth, **options)[0].flatten(1).mT
    points = points[points.isfinite().all(-1)]
    return points[[0, len(points) // 2]] if len(points) else torch.zeros(1, 3).to(depth)


def every_light(
    depth: Tensor, options: dict, unit: float = 1.0, *, touching: bool = True
) -> list[AbstractSource]:
    """Lengths in `unit` m; some lamps stand exactly on the surface where `touching`."""

    def made(*rows: tuple) -> Tensor:
        return torch.tensor(rows, dtype=depth.dtype)

    way = made((0, 0, 1), (1, 0, 1e-6), (1, 0, 0), (0, 1, 0), (0.6, 0, -0.8), (0.6, 0.3, 0.7))
    way = way / way.norm(dim=-1, keepdim=True)
    near = unit * made((0, 0, 0), (0.1, 0.05, -1.5), (0.1, 0.05, 1.5), (0.1, 0.05, -5.0))
    if touching:
        near = torch.cat((near, on_the_surface(depth, options)))
    ball, bright = unit * made((0.1, 0.05, -1.0)), made((1, 2, 3))
    return [
        DirectionalSource(way, bright),
        PointSource(near, unit**2 * bright),
        SphereSource(ball, unit * made((0.2,)), bright),
        SphereSource(ball, unit * made((0.2,)), bright, samples=5),
        AmbientDome(bright),
    ]


def is_there(depth: Tensor, camera: str) -> Tensor:
    return depth.isfinite() & ((depth > 0) if camera == "pinhole" else True)


def weighed(image: Tensor) -> Tensor:
    """One number in which every element counts differently."""
    weight = torch.linspace(0.5, 1.5, image.numel(), dtype=image.dtype)
    return (image * weight.reshape(image.shape)).sum()


def check(images: tuple[Tensor, ...], inputs: dict[str, Tensor], seen: Tensor) -> None:
    """Finite values and gradients; 0 where nothing is seen."""
    for image in images:
        assert image.isfinite().all()
        assert (image[~seen.expand_as(image)] == 0).all()
    total = sum(weighed(image) for image in images)
    slopes = torch.autograd.grad(total, list(inputs.values()), allow_unused=True)
    for (name, leaf), slope in zip(inputs.items(), slopes, strict=True):
        if slope is None:
            continue
        assert slope.isfinite().all(), name
        if leaf.shape[-2:] == seen.shape[-2:]:
            assert (slope[~seen.expand_as(slope)] == 0).all(), name


def leaf(value: Tensor) -> Tensor:
    return value.clone().requires_grad_()


def under_the_mask(seen: Tensor, *channels: float) -> Tensor:
    """A map of so many numbers, NaN where nothing is seen."""
    values = torch.tensor(channels, dtype=torch.float64).reshape(1, -1, 1, 1)
    return torch.where(seen, values, math.nan)


@EVERY
@CAMERAS
@DTYPES
def test_values_and_gradients_are_finite(name: str, camera: str, dtype: torch.dtype) -> None:
    """All effects under all lights; albedo 0, 0.5 and 1, and not a number under the mask."""
    depth = MAPS[name].to(dtype)
    options, seen = view(camera, depth), is_there(depth, camera)
    size, matrix = options.get("pixel_size"), options.get("intrinsics")
    sources = every_light(depth, options)
    albedo = under_the_mask(seen, 0.0, 0.5, 1.0).to(dtype)
    gloss = under_the_mask(seen, 0.0, 0.5, 1.0).to(dtype)
    shininess = under_the_mask(seen, 4.0).to(dtype)
    for width in (None, 0.3):
        settings = DepthSettings(shadow_width=width, bounces=2, ambient_tail=True, cells=4)
        layer = ShadeDepth(settings, sources, pixel_size=size)
        inputs = {
            "depth": leaf(depth),
            "albedo": leaf(albedo),
            "specular": leaf(gloss),
            "shininess": leaf(shininess),
        }
        eye = {} if matrix is None else {"intrinsics": leaf(matrix)}
        maps = dict(inputs)
        image = layer(maps.pop("depth"), maps.pop("albedo"), **eye, **maps)
        check((image,), inputs | eye, seen)


@EVERY
@CAMERAS
def test_each_layer_alone_is_finite(name: str, camera: str) -> None:
    """In single precision, where less is finite; the camera's gradients, too."""
    dtype = torch.float32
    depth = MAPS[name].to(dtype)
    options, seen = view(camera, depth), is_there(depth, camera)
    eye = {k: leaf(torch.as_tensor(v, dtype=dtype)) for k, v in options.items()}
    sources = every_light(depth, options)
    for width in (None, 1e-3, 1.5):
        inputs = {"depth": leaf(depth)} | eye
        shares = cast_shadows(inputs["depth"], sources, **eye, width=width)
        assert ((shares >= 0) & (shares <= 1)).all()
        if shares.requires_grad:
            check((shares,), inputs, seen)
        check((shares.detach() + 0 * inputs["depth"].nan_to_num(0, 0, 0),), inputs, seen)
    inputs = {"depth": leaf(depth)} | eye
    check(ambient_occlusion(**inputs, azimuths=5), inputs, seen)
    lit = under_the_mask(seen, 0.0, 1.0, 2.0).to(dtype)
    for cells in ((2, 3), (8, 8)):
        inputs = {"depth": leaf(depth), "albedo": leaf(lit / 2), "irradiance": leaf(lit)} | eye
        check((reflected_irradiance(**inputs, cells=cells, bounces=2, tail=True),), inputs, seen)


@CAMERAS
def test_normals_need_no_value_under_the_mask(camera: str) -> None:
    """Normals of another layer, not numbers where nothing is seen."""
    depth = MAPS["holes"]
    options, seen = view(camera, depth), is_there(depth, camera)
    eye = {k: leaf(torch.as_tensor(v, dtype=torch.float64)) for k, v in options.items()}
    normal = under_the_mask(seen, 0.0, 0.6, 0.8)
    lit = under_the_mask(seen, 0.0, 1.0, 2.0)
    inputs = {"depth": leaf(depth), "normal": leaf(normal)} | eye
    check(ambient_occlusion(**inputs), inputs, seen)
    maps = {"albedo": leaf(lit / 2), "irradiance": leaf(lit)}
    check((reflected_irradiance(**inputs, **maps, cells=(8, 8)),), inputs | maps, seen)
    layer = InterreflectionShading(8, pixel_size=options.get("pixel_size"))
    radiance = layer(
        inputs["depth"], maps["albedo"], maps["irradiance"], eye.get("intrinsics"), inputs["normal"]
    )
    inputs.pop("pixel_size", None)
    check((radiance,), inputs | maps, seen)


@CAMERAS
@DTYPES
@pytest.mark.parametrize("power", [-40, 40])
def test_units_of_any_size_are_finite(camera: str, dtype: torch.dtype, power: int) -> None:
    """2^40 and 2^-40 m for a metre: the same picture, gradients in the other unit."""
    unit = 2.0**power
    pictures, slopes = [], []
    for size in (1.0, unit):
        depth = MAPS["holes"].to(dtype) * size
        options, seen = view(camera, depth, size), is_there(depth, camera)
        # where light and surface touch, which is over the other is a matter of rounding
        sources = every_light(depth, options, size, touching=False)
        settings = DepthSettings(shadow_width=0.3, bounces=2, ambient_tail=True, cells=4)
        layer = ShadeDepth(settings, sources, pixel_size=options.get("pixel_size"))
        albedo = under_the_mask(seen, 0.0, 0.5, 1.0).to(dtype)
        inputs = {"depth": leaf(depth), "albedo": leaf(albedo)}
        image = layer(*inputs.values(), options.get("intrinsics"))
        check((image,), inputs, seen)
        again = layer(*inputs.values(), options.get("intrinsics"))
        pictures.append(again.detach())
        slopes.append(torch.autograd.grad(weighed(again), inputs["depth"])[0] * size)
    rounding = 1e-4 if dtype is torch.float32 else 1e-11
    for first, second in (pictures, slopes):
        assert_close(second, first, rtol=rounding, atol=rounding * float(first.abs().max()))


@CAMERAS
def test_a_mask_changes_nothing_for_those_that_do_not_see_it(camera: str) -> None:
    """Behind a high wall: what happens there is nothing to the pixels before it."""
    depth = rough(8, 12)
    depth[..., 5] = 0.6  # a wall across the map
    masked = with_values(depth, some=(math.nan, (slice(2, 5), slice(8, 11))))
    options = view(camera, depth)
    before = slice(0, 4)  # the normal of the pixel at the wall is also the wall's
    assert_close(
        ambient_occlusion(masked, **options)[0][..., before],
        ambient_occlusion(depth, **options)[0][..., before],
    )
    lit = torch.ones(1, 1, 8, 12, dtype=torch.float64)
    first, second = (
        reflected_irradiance(d, 0.5 * lit, lit, **options, cells=(8, 12), fine=1)
        for d in (depth, masked)
    )
    assert_close(second[..., before], first[..., before])
    way = torch.tensor([[-0.6, 0.2, 0.5], [0.7, 0.1, 0.3]], dtype=torch.float64)
    sun = DirectionalSource(way / way.norm(dim=-1, keepdim=True), torch.ones(1, 1).double())
    for width in (None, 0.05):
        whole, part = (cast_shadows(d, [sun], **options, width=width) for d in (depth, masked))
        assert_close(part[..., before], whole[..., before])


@CAMERAS
def test_lights_that_cannot_shine_do_not(camera: str) -> None:
    """Below the surface, or in its plane: no radiance, whatever the visibility says."""
    depth = flat()
    options = view(camera, depth)
    albedo = torch.ones(1, 1, 8, 8, dtype=torch.float64)
    grazing = torch.tensor([[1.0, 0, 0], [0.6, 0, -0.8]], dtype=torch.float64)
    below = torch.tensor([[0.1, 0.05, -2.5], [0.2, 0.0, -2.0]], dtype=torch.float64)
    one = torch.ones(1, 1, dtype=torch.float64)
    for source in (DirectionalSource(grazing, one), PointSource(below, one)):
        layer = ShadeDepth(DepthSettings(cells=4), source, pixel_size=options.get("pixel_size"))
        assert (layer(depth, albedo, options.get("intrinsics")) <= 1e-12).all()


@CAMERAS
@DTYPES
def test_a_light_along_the_view_is_seen_from_everywhere(camera: str, dtype: torch.dtype) -> None:
    for name, depth in MAPS.items():
        depth = depth.to(dtype)
        options, seen = view(camera, depth), is_there(depth, camera)
        eye = torch.tensor([0.0, 0, 1 if camera == "orthographic" else 0], dtype=dtype)
        kind = DirectionalSource if camera == "orthographic" else PointSource
        for width in (None, 1e-3):
            found = cast_shadows(
                depth, [kind(eye, torch.ones(1, dtype=dtype))], **options, width=width
            )
            assert torch.equal(found, seen.to(dtype)), name
