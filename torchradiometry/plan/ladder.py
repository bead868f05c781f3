"""The ladder: from one dot product a pixel to the finest picture, one effect a rung.

    local      one dot product, + fall-off, + shadows, + area, + penumbras, + highlights, + edges
    ambient    the same light from everywhere stands in for reflections
    bounces    1, 2, 4, 8; each without and with an ambient tail for the bounces left out
    radiosity  all bounces on patches of half, a quarter, an eighth of the scene's half diagonal,
               and then more rays at edges
    finest     patches as small as `MOST_PATCHES` allows, and more rays

A rung keeps what the one below it has. Rungs that the scene makes pointless are left out: fall-off
without near lamps, area and penumbras without shining faces, highlights without lobes, everything
that reflects where no surface sees another.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import torch

from torchradiometry.render.ambient import on_surfaces
from torchradiometry.render.indirect import first_patches
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World, prepare
from torchradiometry.scene.scene import Scene

__all__ = ["Rung", "ladder"]

#: bounces of the rungs between ambient light and radiosity, and of radiosity
BOUNCES, ALL_BOUNCES = (1, 2, 4, 8), 64
#: patch edges as parts of the half diagonal: of bounces, of radiosity, and tried for the finest
BOUNCE_PART, PARTS, FINEST_PARTS = 4, (2, 4, 8), tuple(16 / 2 ** (k / 4) for k in range(13))
#: patches beyond which a rung is left out, and of the finest
MOST_PATCHES = 5000
#: rays in a lobe, and of the finest
LOBES, FINEST_LOBES = 16, 256
#: shadow rays of the rungs, rays along a side of a pixel, and the same of the finest
SHADOWS, SIDE, FINEST_SHADOWS, FINEST_SIDE, FINEST_PAIRS = 4, 2, 16, 6, 8


class Rung(NamedTuple):
    """One way to make the picture.

    Attributes:
        name: short enough for a plot.
        settings: of the renderer.
    """

    name: str
    settings: RenderSettings


@torch.no_grad()
def ladder(scene: Scene) -> tuple[Rung, ...]:
    """The rungs that a scene calls for, from the cheapest to the finest.

    Args:
        scene: surfaces and sources.

    Raises:
        EmptySceneError: no triangle.

    >>> from torchradiometry.scene.standard import STANDARD_SCENES
    >>> [rung.name for rung in ladder(STANDARD_SCENES["ball"](8, 6))]
    ['one dot product', '+ shadows', '+ edges', 'finest']
    """
    world = prepare(scene, RenderSettings())
    rungs = _local(world)
    last = rungs[-1].settings
    finest = replace(
        last,
        shadow_samples=FINEST_SHADOWS,
        supersampling=FINEST_SIDE,
        pair_samples=FINEST_PAIRS,
        lobe_samples=last.lobe_samples and FINEST_LOBES,
    )
    reflects = bool((world.triangles.albedo > 0).any())
    if reflects and on_surfaces(world).mutual_view > 0:
        rungs += _global(world, last)
        part = next((p for p in FINEST_PARTS if _fits(world, p)), FINEST_PARTS[-1])
        size = world.rays.scale / part
        finest = replace(finest, bounces=ALL_BOUNCES, patch_size=size)
    return (*rungs, Rung("finest", finest))


def _local(world: World) -> list[Rung]:
    """Light that comes straight from its source."""
    shines = len(world.emitters.corners) > 0
    shiny = bool((world.triangles.specular > 0).any())
    near = any(source.needs_position for source in world.scene.sources)
    steps = [
        ("+ fall-off", near, {"near": True}),
        ("+ shadows", True, {"shadow_samples": 1}),
        ("+ area", shines, {"extent": True}),
        ("+ penumbras", shines, {"penumbra": True, "shadow_samples": SHADOWS}),
        ("+ highlights", shiny, {"lobe_samples": LOBES}),
        ("+ edges", True, {"supersampling": SIDE}),
    ]
    settings = RenderSettings(
        bounces=0, supersampling=1, shadow_samples=0, penumbra=False, extent=False, near=False,
        lobe_samples=0,
    )  # fmt: skip
    rungs = [Rung("one dot product", settings)]
    for name, wanted, change in steps:
        settings = replace(settings, **change)  # type: ignore[arg-type]
        if wanted:
            rungs.append(Rung(name, settings))
    return rungs


def _global(world: World, local: RenderSettings) -> list[Rung]:
    """Light that was reflected before."""
    scale = world.rays.scale
    rungs = [Rung("+ ambient", replace(local, ambient=True))]
    size = scale / BOUNCE_PART
    for count in BOUNCES:
        name = f"{count} bounce" + ("s" if count > 1 else "")
        short = replace(local, bounces=count, patch_size=size, ambient_tail=False)
        rungs += [Rung(name, short), Rung(f"{name}, tail", replace(short, ambient_tail=True))]
    whole = replace(local, bounces=ALL_BOUNCES)
    sizes = [scale / p for p in PARTS if p == PARTS[0] or _fits(world, p)]
    rungs += [Rung(f"radiosity, {s:.2g} m", replace(whole, patch_size=s)) for s in sizes]
    sharp = replace(whole, patch_size=sizes[-1], supersampling=FINEST_SIDE)
    return [*rungs, Rung("+ fine edges", sharp)]


def _fits(world: World, part: float) -> bool:
    """Whether patches of this part of the half diagonal are few enough."""
    settings = RenderSettings(patch_size=world.rays.scale / part)
    return len(first_patches(world, settings).corners) <= MOST_PATCHES
