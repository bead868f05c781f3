"""Light and depth from one image, on synthetic ones: `python -m tests.benchmarks.one_image`.

Random shapes of one to four colours, in natural light (nine harmonics, dimmed by the share of the
sky that a pixel sees) or under one distant lamp that casts shadows. Surfaces are given as they are,
or as the shading model sees them in the photograph, or as flat and white: of a flat surface even
light is all that can be said, so the last is the floor. Means over the images of

    normals     mean angle, degrees
    light       root mean square error of the irradiance over all normals towards the camera,
                relative to its root mean square, exposure taken out
    explained   1 - sum of squared residuals / sum of squares, of the photograph
    height      root mean square error over the object, relative to its width; of normals_to_heights
                without and with 10 rounds for breaks

Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import torch
from torch import Tensor

from torchradiometry.deploy import find_model, open_model, run_model
from torchradiometry.geometry import hemisphere_quadrature, normals_to_heights
from torchradiometry.learn import Shapes, angle_degrees, estimate_light, random_shapes
from torchradiometry.learn.light import RIDGE
from torchradiometry.learn.samples.shapes import FAMILIES
from torchradiometry.shade import AmbientOcclusion, LambertianShading, cast_shadows
from torchradiometry.sources import DirectionalSource, HarmonicSource

Light = HarmonicSource | DirectionalSource
#: what evenness of light is worth beside guesses
GUESSED = 0.01
#: a relief fills its picture and has no outline
OBJECTS = tuple(family for family in FAMILIES if family != "reliefs")


def natural(count: int, generator: torch.Generator) -> HarmonicSource:
    """Light from all around, mostly from above, a little coloured."""
    order = torch.tensor([0.0, 1, 1, 1, 2, 2, 2, 2, 2]).reshape(9, 1)
    light = torch.randn(count, 9, 1, generator=generator) * 0.9 / (1 + order) ** 1.2
    light[:, :1] = 1
    light[:, 1] += 0.3
    tint = 1 + 0.15 * torch.randn(count, 1, 3, generator=generator).clamp(-2, 2)
    return HarmonicSource((light * tint).unsqueeze(1))


def lamps(count: int, generator: torch.Generator) -> DirectionalSource:
    """One lamp for each image, up to 65 degrees from the viewing direction."""
    turn = 2 * math.pi * torch.rand(count, 1, generator=generator)
    slant = math.radians(65) * torch.rand(count, 1, generator=generator).sqrt()
    towards = torch.stack((slant.sin() * turn.cos(), slant.sin() * turn.sin(), slant.cos()), -1)
    return DirectionalSource(towards, torch.ones(count, 1, 3))


def painted(count: int, size: int, generator: torch.Generator) -> Tensor:
    """One to four colours in patches with sharp borders."""
    coarse = torch.randn(count, 4, 5, 5, generator=generator)
    level = torch.nn.functional.interpolate(coarse, (size, size), mode="bicubic")
    colours = torch.randint(1, 5, (count, 1, 1, 1), generator=generator)
    level = torch.where(torch.arange(4).reshape(1, -1, 1, 1) < colours, level, -torch.inf)
    palette = 0.1 + 0.8 * torch.rand(count, 4, 3, generator=generator)
    return torch.einsum("bkhw,bkc->bchw", torch.softmax(30 * level, 1), palette)


def photographed(shapes: Shapes, albedo: Tensor, source: Light) -> Tensor:
    """Linear radiance with what the shape hides of the light."""
    depth = torch.where(shapes.mask, -shapes.height, torch.nan).unsqueeze(1)
    if isinstance(source, DirectionalSource):
        seen = cast_shadows(depth, [source], pixel_size=1.0, width=0.02)
        return LambertianShading(source)(shapes.normal, albedo, visibility=seen)
    sky, _ = AmbientOcclusion(azimuths=8, pixel_size=1.0)(depth)
    return LambertianShading(source)(shapes.normal, albedo) * sky


def asked(image: Tensor, mask: Tensor, model: Path) -> tuple[Tensor, Tensor]:
    """Normals and paint of the shading model."""
    found = run_model(open_model(model), {"image": image.numpy(), "mask": mask.numpy()})
    normal, albedo = (torch.from_numpy(part) for part in found)
    return normal, albedo


def light_error(found: Tensor, source: Light) -> Tensor:
    """Of the irradiance on normals towards the camera, exposure of each image taken out."""
    rule = hemisphere_quadrature(polar=12, azimuth=24, dtype=torch.float32)
    normal = rule.direction.expand(len(found), -1, -1)
    weight = rule.weight.reshape(1, -1, 1)
    ours, truth = (
        s.irradiance_on(None, normal) for s in (HarmonicSource(found.unsqueeze(1)), source)
    )
    scale = (weight * ours * truth).sum((1, 2)) / (weight * ours * ours).sum((1, 2))
    missed = (weight * (scale.reshape(-1, 1, 1) * ours - truth) ** 2).sum((1, 2))
    return (missed / (weight * truth * truth).sum((1, 2))).sqrt()


def explained(image: Tensor, normal: Tensor, albedo: Tensor, light: Tensor, mask: Tensor) -> Tensor:
    shaded = LambertianShading(HarmonicSource(light.unsqueeze(1)))(normal, albedo)
    missed = (mask * (shaded - image) ** 2).sum((1, 2, 3))
    return 1 - missed / (mask * image**2).sum((1, 2, 3))


def height_error(normal: Tensor, shapes: Shapes, rounds: int) -> Tensor:
    """Relative to the width of the object; a constant is taken out."""
    mask, truth = shapes.mask.unsqueeze(1), shapes.height.unsqueeze(1)
    found = normals_to_heights(normal, mask, rounds=rounds).height
    errors = []
    for ours, theirs, inside in zip(found, truth, mask, strict=True):
        apart = (ours - theirs)[inside]
        wide = inside[0].any(0).sum().clamp(min=1)
        errors.append((apart - apart.median()).square().mean().sqrt() / wide)
    return torch.stack(errors)


def row(
    name: str,
    shapes: Shapes,
    image: Tensor,
    known: tuple[Tensor, Tensor],
    source: Light,
    ridge: float,
) -> str:
    mask = shapes.mask.unsqueeze(1).float()
    normal, albedo = known
    angles = angle_degrees(normal.movedim(1, -1), shapes.normal.movedim(1, -1))[shapes.mask]
    light = estimate_light(image, normal, albedo, mask, ridge=ridge)
    numbers = (
        f"{float(angles.mean()):.1f}",
        f"{float(light_error(light, source).mean()):.3f}",
        f"{float(explained(image, normal, albedo, light, mask).mean()):.3f}",
        *(f"{float(height_error(normal, shapes, r).mean()):.4f}" for r in (0, 10)),
    )
    return f"| {name} | " + " | ".join(numbers) + " |"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=64, help="images")
    options.add_argument("--size", type=int, default=64)
    options.add_argument("--model", type=Path, default=None, help="a shading model")
    chosen = options.parse_args()
    generator = torch.Generator().manual_seed(11)
    shapes = random_shapes(chosen.count, chosen.size, generator, OBJECTS)
    albedo = painted(chosen.count, chosen.size, generator)
    print("| light, surface | normals | light | explained | height | with breaks |")
    print("|---|---|---|---|---|---|")
    for name, make in (("natural", natural), ("lamp", lamps)):
        source = make(chosen.count, generator)
        image = photographed(shapes, albedo, source) * shapes.mask.unsqueeze(1)
        mask = shapes.mask.unsqueeze(1).float()
        guess = asked(image, mask, chosen.model or find_model("shading"))
        up = torch.tensor([0.0, 0.0, 1.0]).reshape(1, 3, 1, 1).expand_as(image)
        for what, known, ridge in (
            ("known", (shapes.normal, albedo), RIDGE),
            ("by the model", guess, GUESSED),
            ("flat and white", (up, torch.ones_like(image)), GUESSED),
        ):
            print(row(f"{name}, {what}", shapes, image, known, source, ridge), flush=True)


if __name__ == "__main__":
    with torch.no_grad():
        main()
