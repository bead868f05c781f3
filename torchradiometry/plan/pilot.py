"""A quick look at how much surfaces see of each other.

    h = mean over surface points of the cosine-weighted share of directions that meet a front

h = 0 for a convex body, 1 for a closed room. With albedo q every bounce keeps at most q of the
light and, on average, returns the share h of it, so reflected light is about

    q h / (1 - q h)   of the direct light,

an estimate (a cavity that holds all the light exceeds the mean), which `reflected_share`
doubles and never lets exceed the bound q of the total.
"""

from __future__ import annotations

import torch

from torchradiometry.render.direct import cosine_directions
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World, prepare
from torchradiometry.scene.scene import Scene

__all__ = ["mutual_view", "reflected_share", "view_in"]

#: points on the surfaces and rays from each
POINTS, RAYS = 512, 16
MARGIN = 2.0


def mutual_view(scene: Scene, seed: int = 0) -> float:
    """h: how much the surfaces of a scene see of each other, 0..1."""
    return view_in(prepare(scene, RenderSettings()), seed)


@torch.no_grad()
def view_in(world: World, seed: int = 0) -> float:
    """`mutual_view` of a prepared scene."""
    generator = torch.Generator().manual_seed(seed)
    corners = world.triangles.corners
    a, b, c = corners.unbind(1)
    area = torch.linalg.cross(b - a, c - a).norm(dim=-1)
    if not bool(area.sum() > 0):
        return 0.0
    chosen = torch.multinomial(area.cpu(), POINTS, True, generator=generator).to(corners.device)
    weight = torch.rand(POINTS, 2, generator=generator, dtype=torch.float64).to(corners)
    weight = torch.where(weight.sum(-1, keepdim=True) > 1, 1 - weight, weight)
    side = (b - a)[chosen] * weight[:, :1] + (c - a)[chosen] * weight[:, 1:]
    normal = world.normal[chosen]
    start = world.rays.lift(a[chosen] + side, normal)
    where = torch.rand(POINTS, RAYS, 2, generator=generator, dtype=torch.float64).to(corners)
    direction = cosine_directions(where, normal).reshape(-1, 3)
    hits = world.rays.closest(start.repeat_interleave(RAYS, 0), direction)
    triangle = hits.triangle.clamp(min=0)
    front = (world.normal[triangle] * direction).sum(-1) < 0
    return float((hits.found & (front | world.triangles.two_sided[triangle])).double().mean())


def reflected_share(albedo: float, view: float) -> float:
    """Estimated share of reflected light in all light that leaves, 0..1, on the safe side.

    >>> reflected_share(0.5, 0.0), reflected_share(0.9, 1.0)
    (0.0, 0.9)
    """
    ratio = MARGIN * albedo * view / max(1 - albedo * view, torch.finfo(torch.float64).tiny)
    return min(albedo, ratio / (1 + ratio))
