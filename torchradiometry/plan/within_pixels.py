"""What one ray a pixel makes of a picture: edges of surfaces, and light that bends.

Each pilot pixel is seen through its middle x and through a pair of opposite places x +- u in it.
L(x) - (L(x + u) + L(x - u)) / 2 vanishes where the picture is linear and has, at an edge, the mean
size of the error of one ray a pixel.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.numerics import guarded_divide
from torchradiometry.plan.highlights import shown_by_looks
from torchradiometry.render.pixels import DIM, JUMP

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

    from torchradiometry.plan.pilot import Pilot

__all__ = ["OneRay", "look_within_pixels"]

#: blockers x shining polygons up to which penumbras are clipped at all pixels, and at one in how
#: many otherwise
CLIPS, SPARSE = 16, 6
#: slope out of the plane above which two points of a pixel lie on different surfaces
STEP = 0.2


class OneRay(NamedTuple):
    """What one ray a pixel makes of a picture.

    Attributes:
        at_edges, inside: relative L1 error by pixels that show an edge of a surface, and by
            those whose light bends.
        share, bent: of the pixels that show an edge, and of those whose light bends enough for the
            renderer to take more rays.
    """

    at_edges: float
    inside: float
    share: float
    bent: float


class _Steps(NamedTuple):
    """Of each pilot pixel.

    Attributes:
        size: what its middle differs from its pair, pi L, sum of channels, W/m2.
        light: of its middle, likewise.
        jumps: whether that is a jump for the renderer.
    """

    size: Float[Tensor, "pixel"]
    light: Float[Tensor, "pixel"]
    jumps: Bool[Tensor, "pixel"]


def look_within_pixels(pilot: Pilot) -> OneRay:
    """What a pilot's pixels, with a camera and some light, show within themselves."""
    edge, blockers = _edges(pilot), pilot.lit_world.blockers
    work = 0 if blockers is None else len(blockers) * len(pilot.lit_world.emitters.corners)
    counts = pilot.looks[1]
    found = _steps(pilot, counts, clip=work <= CLIPS)
    bent, share = (found.size * ~edge).mean(), (found.jumps & ~edge).double().mean()
    if work > CLIPS:
        # some pixels tell by how much the noise of penumbras makes steps larger than they are
        part = torch.arange(len(edge), device=edge.device) % SPARSE == 0
        exact = _steps(pilot, counts & part, clip=True)
        share = (exact.jumps & ~edge)[part].double().mean()
        bent = (bent - ((found.size - exact.size) * ~edge)[part].mean()).clamp(min=0)
    spread = found.size.std() / len(found.size) ** 0.5
    at_edges, inside, error = (
        float(guarded_divide(part, found.light.mean()))
        for part in ((found.size * edge).mean(), bent, spread)
    )
    both = at_edges + inside
    more = 1 + error / both if both > 0 else 1.0
    return OneRay(at_edges * more, inside * more, float(edge.double().mean()), float(share))


def _edges(pilot: Pilot) -> Bool[Tensor, "pixel"]:
    """Pixels that show more than one surface, or a bent one."""
    where, counts = pilot.looks
    surface = pilot.world.triangles.surface[where.triangle.clamp(min=0)]
    kind = torch.where(where.triangle >= 0, surface, -1).reshape(counts.shape)
    middle = where.take(torch.arange(counts.shape[1], device=counts.device).repeat(3))
    step = ((where.position - middle.position) * middle.normal).sum(-1)
    bent = (step.abs() > STEP * pilot.world.rays.scale / 100).reshape(counts.shape).any(0)
    return ((kind != kind[0]).any(0) | bent) & counts.any(0)


def _steps(pilot: Pilot, counts: Bool[Tensor, "look pixel"], clip: bool) -> _Steps:
    """Of the looks that count; `clip` where penumbras are to be without noise."""
    where, world, fine = pilot.looks[0], pilot.lit_world, pilot.fine
    flat = torch.nonzero(counts.reshape(-1)).squeeze(-1)
    found = where.take(flat)
    albedo = pilot.scene.albedo_at(found.triangle, found.barycentric).detach().double()
    clip = clip and world.blockers is not None
    free = None if clip else pilot.unblocked(found.receivers, fine.extent)
    light = pilot.direct_at(found.receivers, fine, free) + pilot.reflections.at(found)
    look, pixel = flat // counts.shape[1], flat % counts.shape[1]
    lobes = shown_by_looks(world, fine, found, look, pixel, pilot.reflections)
    light = albedo * light + math.pi * lobes
    full = light.new_zeros(counts.numel()).index_copy(0, flat, light.sum(-1))
    middle, *pair = full.reshape(counts.shape)
    # pixels partly covered by an emitter are not counted, as they are not in the picture
    emits = (pilot.world.triangles.emission > 0).any(-1)[where.triangle.clamp(min=0)]
    shines = (emits & (where.triangle >= 0)).reshape(counts.shape).any(0)
    step = (middle - (pair[0] + pair[1]) / 2).abs() * ~shines
    most = torch.maximum(torch.maximum(*pair), middle).clamp(min=DIM * float(middle.mean()))
    return _Steps(step, middle, (2 * step > JUMP * most) & counts.all(0))
