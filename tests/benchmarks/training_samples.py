"""Training shapes, drawn by pyrender: `python -m tests.benchmarks.training_samples`.

Each shape of the training data is made a triangle mesh (`depth_to_mesh`) and given to OpenGL, which
finds the visible surface, looks the paint up in a texture and shades it by a shader that shares no
line with the layers. Compared pixel by pixel, two pixels inside the outline and nowhere across a
jump of the height:

    depth       of the rasteriser, against the height field
    radiance    Lambertian + Blinn-Phong under a distant light, against `PhongShading`
    shadow      whether a shadow map darkens the pixel, against `cast_shadows`; one pixel off the
                shadows' edges

Prints a Markdown table, one row a family of shapes.
"""

from __future__ import annotations

import argparse
import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry import OrthographicCamera, depth_to_mesh
from torchradiometry.learn import Shapes, random_shapes
from torchradiometry.learn.samples.shapes import FAMILIES
from torchradiometry.materials import BlinnPhong
from torchradiometry.reference import ReferenceBuffers, render_reference
from torchradiometry.scene import Scene, Surface, Texture
from torchradiometry.shade import PhongShading, cast_shadows
from torchradiometry.sources import DirectionalSource

#: largest angle of a light from the viewing direction
WIDEST = math.radians(75)
#: slopes above this are taken for jumps of the height
STEEPEST = 8.0
#: pixels darker than this share of the brightest have no relative error worth the name
DARK = 1e-3


class Sample(NamedTuple):
    """One shape and how it is painted and lit; images are `1 C H W`, float64."""

    depth: Tensor
    normal: Tensor
    mask: Tensor
    albedo: Tensor
    specular: float
    shininess: float
    source: DirectionalSource


class Compared(NamedTuple):
    """Of one sample, pixel by pixel: relative errors, errors of depth in pixels, shadows."""

    radiance: Tensor
    depth: Tensor
    differ: Tensor
    shadowed: Tensor


def random_sample(shapes: Shapes, k: int, generator: torch.Generator) -> Sample:
    """Shape k with paint in patches, a highlight and a distant light."""
    mask, size = shapes.mask[k][None, None], shapes.mask.shape[-1]
    height = torch.where(mask, shapes.height[k].double(), torch.nan)
    coarse = torch.rand(1, 3, 6, 6, generator=generator, dtype=torch.float64)
    paint = torch.nn.functional.interpolate(coarse, (size, size), mode="nearest") * 0.9 + 0.05
    chance = torch.rand(4, generator=generator, dtype=torch.float64)
    slant, turn = WIDEST * float(chance[2]), 2 * math.pi * float(chance[3])
    aside = math.sin(slant)
    light = [[aside * math.cos(turn), aside * math.sin(turn), math.cos(slant)]]
    source = DirectionalSource(
        torch.tensor(light, dtype=torch.float64), torch.tensor([[3.0, 2.5, 2.0]]).double()
    )
    return Sample(
        float(shapes.height[k][shapes.mask[k]].max()) + 10 - height,
        shapes.normal[k].double()[None],
        mask,
        paint,
        0.3 * float(chance[0]),
        float(2 ** (2 + 6 * chance[1])),
        source,
    )


def drawn(sample: Sample, shadows: bool) -> ReferenceBuffers:
    """The sample through OpenGL."""
    rows, columns = sample.mask.shape[-2:]
    vertices, faces = depth_to_mesh(sample.depth, pixel_size=1.0)
    held = sample.mask.flatten()
    place = torch.cumsum(held, 0) - 1
    v, u = (torch.arange(n, dtype=torch.float64) + 0.5 for n in (rows, columns))
    across, up = (u / columns).expand(rows, -1), (1 - v / rows).unsqueeze(1).expand(-1, columns)
    corner = torch.stack((across, up), -1)
    surface = Surface(
        "shape",
        vertices[held],
        place[faces],
        torch.ones(3, dtype=torch.float64),
        normals=sample.normal[0].flatten(1).T[held],
        two_sided=True,
        texture=Texture(sample.albedo[0].permute(1, 2, 0), corner.reshape(-1, 2)[held]),
    )
    camera = OrthographicCamera(
        width=columns, height=rows, ymag=rows / 2, camera_to_world=torch.eye(4, dtype=torch.float64)
    )
    shine = BlinnPhong(
        torch.full((3,), sample.specular, dtype=torch.float64),
        torch.tensor([sample.shininess], dtype=torch.float64),
    )
    return render_reference(
        Scene((surface,), (sample.source,)), camera, materials=[shine], shadows=shadows
    )


def layered(sample: Sample) -> Tensor:
    """The sample through the layers, `H W 3`."""
    specular = torch.full_like(sample.albedo, sample.specular)
    shininess = torch.full_like(sample.depth, sample.shininess)
    layer = PhongShading(BlinnPhong, sample.source)
    return layer(sample.normal, sample.albedo, specular, shininess)[0].permute(1, 2, 0)


def compared(sample: Sample) -> Compared:
    """Both, where neither sees an edge."""
    plain, cast = drawn(sample, False), drawn(sample, True)
    smooth = well_inside(sample)
    ours = layered(sample)
    bright = smooth & (ours.amin(-1) > DARK * ours[smooth].max())
    error = ((plain.radiance - ours).abs() / ours).amax(-1)[bright]
    depth = (plain.depth - sample.depth[0, 0])[smooth].abs()
    visible = cast_shadows(sample.depth, [sample.source], pixel_size=1.0)[0, 0] > 0.5
    dark = cast.radiance.sum(-1) < 0.5 * plain.radiance.sum(-1)
    sure = bright & (inner(visible) | inner(~visible))
    return Compared(error, depth, (dark == visible)[sure], ~visible[sure])


def well_inside(sample: Sample) -> Tensor:
    """Two pixels inside the outline, and no jump beside the pixel."""
    height = torch.where(sample.mask, -sample.depth, 0)[0, 0]
    jump = torch.zeros_like(height, dtype=torch.bool)
    for axis in (0, 1):
        steep = height.diff(dim=axis).abs() > STEEPEST
        first, last = [0, 0, 0, 0], [0, 0, 0, 0]
        first[3 - 2 * axis], last[2 - 2 * axis] = 1, 1
        for pad in (first, last):
            jump |= torch.nn.functional.pad(steep, pad)
    return inner(inner(sample.mask[0, 0])) & ~jump


def inner(mask: Tensor) -> Tensor:
    """Pixels whose eight neighbours are in the image and in the mask too."""
    outside = torch.nn.functional.pad((~mask).float()[None, None], (1, 1, 1, 1), value=1)
    return torch.nn.functional.max_pool2d(outside, 3, stride=1)[0, 0] == 0


def figures(family: str, count: int, size: int, generator: torch.Generator) -> Compared:
    """All pixels of `count` samples of a family."""
    shapes = random_shapes(count, size, generator, [family])
    parts = [compared(random_sample(shapes, k, generator)) for k in range(count)]
    return Compared(*(torch.cat(part) for part in zip(*parts, strict=True)))


def row(family: str, found: Compared) -> str:
    worst = float(found.radiance.max())
    return (
        f"| {family} | {len(found.radiance)} | {float(found.radiance.median()):.1e} | {worst:.1e} "
        f"| {float(found.depth.max()):.1e} | {float(found.shadowed.double().mean()):.3f} "
        f"| {float(found.differ.double().mean()):.1e} |"
    )


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=6, help="shapes of each family")
    options.add_argument("--size", type=int, default=64)
    chosen = options.parse_args()
    print(
        "| family | pixels | radiance, median | worst | depth, worst, pixels | in shadow | differ |"
    )
    print("|---|---|---|---|---|---|---|")
    generator = torch.Generator().manual_seed(0)
    for family in FAMILIES:
        print(row(family, figures(family, chosen.count, chosen.size, generator)), flush=True)


if __name__ == "__main__":
    main()
