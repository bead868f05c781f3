"""Laws of the image layers, on drawn maps: same bits twice, no image knows another, light adds up.

Inputs are recognised by their names or shapes as `tests.cases` makes them.
"""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from torch import Tensor

from tests.cases import LAYERS, SMALL, Case
from tests.invariants import draws
from tests.invariants.draws import invariant, same
from torchradiometry import materials, shade, sources

LAYER = pytest.mark.parametrize("case", LAYERS, ids=lambda case: case.name)
PIXELS = SMALL.batch * SMALL.height * SMALL.width
#: directions of a map are stored rounded to unit length; light is steep in them at a shadow's edge
TURNED = 1e-11


def jittered(tensors: tuple[Tensor, ...], seed: int) -> list[Tensor]:
    """The inputs of a case, each number changed by up to 20 %, directions unit again."""
    draw, found = draws.generator(seed), []
    for tensor in tensors:
        factor = draws.uniform(draw, *tensor.shape, low=0.8, high=1.2)
        unit = [
            axis
            for axis in (1, -1)
            if tensor.ndim > 1
            and tensor.shape[axis] == 3
            and bool(((tensor.norm(dim=axis) - 1).abs() < 1e-6).all())
        ]
        # intrinsics are no numbers of a map
        square = (
            tensor.ndim == 3 and tensor.shape[-2:] == (3, 3) and bool((tensor[:, 2, 2] == 1).all())
        )
        changed = tensor if square else tensor * factor
        found.append(changed / changed.norm(dim=unit[0], keepdim=True) if unit else changed)
    return found


@LAYER
@given(seed=draws.seeds)
@invariant(PIXELS)
def test_same_bits_and_images_do_not_know_each_other(case: Case, seed: int) -> None:
    """Every pixel of the batch is compared."""
    layer = case.build(torch.float64)
    tensors = jittered(case.inputs(torch.float64, SMALL), seed)
    with torch.no_grad():
        value = draws.repeats(lambda: layer(*tensors))
    assert torch.isfinite(value).all()
    shared = {"form_factors", "source_direction", "source_irradiance", "source_position"}
    names = getattr(layer, "input_names", ())
    if case.member is shade.RadiosityShading or shared & set(names):
        return  # its last input has no batch axis
    with torch.no_grad():
        one = layer(*(t[:1] if t.shape[0] == SMALL.batch else t for t in tensors))
    same(one, value[:1])


def maps(seed: int, *shape: int) -> tuple[Tensor, Tensor, Tensor]:
    """Normals, albedo and positions of 2 x 3 x 4 pixels."""
    draw = draws.generator(seed)
    normal = draws.units(draw, 2, 3, 4).movedim(-1, 1)
    position = draws.uniform(draw, 2, 3, 3, 4, low=-0.5, high=0.5)
    return normal, draws.uniform(draw, 2, 3, 3, 4), position


def lamps(seed: int) -> list[sources.AbstractSource]:
    draw = draws.generator(seed)
    return [
        sources.DirectionalSource(draws.units(draw, 2), draws.uniform(draw, 2, 3)),
        sources.PointSource(2 * draws.units(draw, 2), draws.uniform(draw, 2, 3)),
        sources.SphereSource(
            2 * draws.units(draw, 1), draws.uniform(draw, 1, 1, high=0.5), draws.uniform(draw, 1, 3)
        ),
    ]


@pytest.mark.parametrize("lobe", [None, materials.Phong, materials.NormalizedPhong])
@given(seed=draws.seeds, factor=draws.factors)
@invariant(PIXELS)
def test_light_adds_up_in_shading(lobe: type | None, seed: int, factor: float) -> None:
    """Superposition of sources, linearity in the albedo, and a camera frame that may turn."""
    normal, albedo, position = maps(seed)
    if lobe is None:
        layer, surface = shade.LambertianShading(), (albedo,)
    else:
        layer = shade.PhongShading(lobe)
        draw = draws.generator(seed + 1)
        surface = (
            albedo,
            draws.uniform(draw, 2, 3, 3, 4),
            draws.uniform(draw, 2, 1, 3, 4, high=9),
        )
    lights = lamps(seed)

    def seen(chosen: list, *maps: Tensor) -> Tensor:
        return layer(normal, *maps, sources=chosen, position=position)

    together = draws.repeats(lambda: seen(lights, *surface))
    assert (together >= 0).all()
    same(sum(seen([light], *surface) for light in lights), together)
    brighter = [draws.brighter(light, factor) for light in lights]
    same(seen(brighter, *surface), factor * together)
    scaled = [t * 0.5 for t in surface[:2]] + list(surface[2:])
    same(seen(lights, *scaled), 0.5 * together)


@given(seed=draws.seeds)
@invariant(PIXELS)
def test_lambertian_shading_turns_with_the_camera(seed: int) -> None:
    normal, albedo, position = maps(seed)
    motion, lights = draws.Motion(seed, reach=1.0), lamps(seed)
    layer = shade.LambertianShading()
    held = layer(normal, albedo, sources=lights, position=position)
    turned = motion.turn(normal.movedim(1, -1)).movedim(-1, 1)
    moved = motion.move(position.movedim(1, -1)).movedim(-1, 1)
    found = layer(turned, albedo, sources=[motion.of(x) for x in lights], position=moved)
    same(found, held, TURNED)


def relief(seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """Depth, albedo and irradiance of 2 x 6 x 6 pixels."""
    draw = draws.generator(seed)
    depth = draws.uniform(draw, 2, 1, 6, 6, low=2, high=2.3)
    return depth, draws.uniform(draw, 2, 1, 6, 6, high=0.9), draws.uniform(draw, 2, 1, 6, 6)


@given(seed=draws.seeds, scale=draws.factors)
@invariant(2 * 36)
def test_depth_maps_keep_the_laws_of_light(seed: int, scale: float) -> None:
    """Sky 0..1 whatever the unit; reflected light adds up, and more bounces never darken."""
    depth, albedo, irradiance = relief(seed)
    size = 0.1
    sky, bent = shade.AmbientOcclusion(4, 3, pixel_size=size)(depth)
    assert ((sky >= 0) & (sky <= 1 + 1e-12)).all()
    larger = shade.AmbientOcclusion(4, 3, pixel_size=scale * size)(scale * depth)
    same(larger[0], sky, 1e-11)
    same(larger[1], bent, 1e-11)

    def reflecting(bounces: int, unit: float = 1.0) -> shade.InterreflectionShading:
        return shade.InterreflectionShading(3, bounces, azimuths=4, fine=1, pixel_size=unit * size)

    seen = [albedo * irradiance / math.pi]
    seen += [reflecting(bounces)(depth, albedo, irradiance) for bounces in (1, 3)]
    assert (seen[0] <= seen[1] * (1 + 1e-12)).all()
    assert (seen[1] <= seen[2] * (1 + 1e-12)).all()
    part = 0.3 * irradiance
    both = [reflecting(3)(depth, albedo, light) for light in (part, irradiance - part)]
    same(both[0] + both[1], seen[2])
    same(reflecting(3, scale)(scale * depth, albedo, irradiance), seen[2], 1e-10)


@given(seed=draws.seeds)
@invariant(2 * 36)
def test_shadows_are_shares_and_mirror(seed: int) -> None:
    depth, _, _ = relief(seed)
    sun = sources.DirectionalSource(
        draws.units(draws.generator(seed), 2), torch.ones(1, 1).double()
    )
    for width in (None, 0.3):
        layer = shade.CastShadow(sun, width=width, pixel_size=0.1)
        visible = draws.repeats(lambda layer=layer: layer(depth))
        assert ((visible >= 0) & (visible <= 1)).all()
        mirrored = sources.DirectionalSource(
            sun.direction * sun.direction.new_tensor([-1.0, 1, 1]), sun.irradiance
        )
        flipped = shade.CastShadow(mirrored, width=width, pixel_size=0.1)(depth.flip(-1))
        same(flipped.flip(-1), visible, 1e-9)
