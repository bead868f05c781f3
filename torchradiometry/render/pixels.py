"""Camera rays: one to a pixel, more where the picture changes.

    L(pixel) = mean over its rays of L

Every pixel is seen through its middle first, which is the mean of a pixel whose light is
linear. Where that surface is textured or shiny, or direct light departs from linear between two
opposite neighbours by more than `JUMP`, the pixel gets s x s rays instead, one at a random place
in each of s x s parts. Where it and a neighbour do not lie on one smooth surface,
2s x 2s rays find out which share of the pixel each face covers (4s x 4s at the edge of an
emitter, which outshines everything), and light is evaluated once for each face, in the middle
of what the pixel shows of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.render.direct import emitter_weights, lamp_irradiance
from torchradiometry.render.points import SurfacePoints, see
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Samples", "camera_samples", "pixel_means"]

#: camera rays that are followed at a time
BLOCK = 2**16
#: second difference of direct light, relative to the largest of three, that calls for more rays
JUMP = 0.125
#: light is compared with no less than this share of its mean in the picture
DIM = 0.1
#: cosine of normals, and slope out of the plane, up to which neighbours lie on one surface
BEND, STEP = 0.98, 0.2
#: rays along each side of a pixel with an edge, of bodies and of emitters, per `supersampling`
EDGE, EMITTER = 2, 4


class Samples(NamedTuple):
    """What camera rays meet, and the direct light there.

    Attributes:
        pixel: which pixel a ray belongs to, row by row.
        share: of the pixel that a ray stands for, 0..1.
        points: where it ends; black backs and the background are left out.
        weights: W of the emitters on the points, W/m2 per W/m2/sr.
        lamps: E by the scene's sources, W/m2.
    """

    pixel: Int[Tensor, "ray"]
    share: Float[Tensor, "ray"]
    points: SurfacePoints
    weights: Float[Tensor, "ray emitter"]
    lamps: Float[Tensor, "ray channel"]

    def take(self, chosen: Bool[Tensor, "ray"]) -> Samples:
        """Some of the rays."""
        rest = (t[chosen] for t in (self.weights, self.lamps))
        return Samples(self.pixel[chosen], self.share[chosen], self.points.take(chosen), *rest)


def pixel_means(
    radiance: Float[Tensor, "ray channel"],
    share: Float[Tensor, "ray"],
    pixel: Int[Tensor, "ray"],
    size: tuple[int, int],
) -> Float[Tensor, "height width channel"]:
    """The picture: every ray's radiance times its share, summed over the rays of each pixel."""
    height, width = size
    full = radiance.new_zeros(height * width, radiance.shape[-1])
    full = full.index_add(0, pixel, radiance * share.unsqueeze(-1))
    return full.reshape(height, width, -1)


def camera_samples(world: World, camera: AbstractCamera, settings: RenderSettings) -> Samples:
    """The camera rays that end on surfaces, and the direct light there."""
    generator = torch.Generator().manual_seed(settings.seed)
    every = torch.arange(camera.height * camera.width)
    found = _follow(world, camera, settings, every, 1, False, generator)
    side = settings.supersampling
    if side == 1:
        return found
    changes = _changes(world, camera, settings, found)
    parts = [found.take(~changes.any[found.pixel])]
    for mask, number, cover in (
        (changes.light, side, False),
        (changes.edge & ~changes.light & ~changes.bright, EDGE * side, True),
        (changes.bright & ~changes.light, EMITTER * side, True),
    ):
        chosen = torch.nonzero(mask).squeeze(-1)
        parts.append(_follow(world, camera, settings, chosen, number, cover, generator))
    return _joined(parts)


def _joined(parts: list[Samples]) -> Samples:
    pixel, share, points, weights, lamps = zip(*parts, strict=True)
    joined = SurfacePoints(*(torch.cat(t) for t in zip(*points, strict=True)))
    return Samples(torch.cat(pixel), torch.cat(share), joined, torch.cat(weights), torch.cat(lamps))


def _follow(
    world: World,
    camera: AbstractCamera,
    settings: RenderSettings,
    pixel: Int[Tensor, "pixel"],
    side: int,
    cover: bool,
    generator: torch.Generator,
) -> Samples:
    """side x side rays of some pixels, and the direct light where they end.

    With `cover`, the rays of a pixel that end on one face are one, in their middle.
    """
    centre = camera.pixel_grid().to(torch.float64).reshape(-1, 2)
    pixel = pixel.to(centre.device)
    parts = []
    for block in pixel.split(max(1, BLOCK // side**2)):
        place = _strata(centre[block], side, generator)
        points = see(world, *camera.rays(place.reshape(-1, 2)))
        lit = torch.nonzero(points.face >= 0).squeeze(-1)
        points, owner = points.take(lit), block.repeat_interleave(side**2)[lit]
        share = torch.full_like(points.position[:, 0], 1 / side**2)
        if cover:
            points, owner, share = _covered(points, owner, share)
        where = points.receivers
        weights = emitter_weights(world, settings, where, generator)
        lamps = lamp_irradiance(world, settings, where, generator)
        parts.append(Samples(owner, share, points, weights, lamps))
    return _joined(parts)


def _covered(
    points: SurfacePoints, pixel: Int[Tensor, "ray"], share: Float[Tensor, "ray"]
) -> tuple[SurfacePoints, Int[Tensor, "group"], Float[Tensor, "group"]]:
    """One point for each pixel and face."""
    faces = int(points.face.max()) + 1 if len(points.face) else 1
    key, group, count = torch.unique(
        pixel * faces + points.face, return_inverse=True, return_counts=True
    )
    found = points.grouped(group, count.to(share))
    return found, key // faces, count * share[:1]


def _strata(
    centre: Float[Tensor, "pixel 2"], side: int, generator: torch.Generator
) -> Float[Tensor, "pixel ray 2"]:
    """One random place in each of side x side parts of every pixel; the middle of a single one."""
    if side == 1:
        return centre.unsqueeze(1)
    step = torch.arange(side, dtype=torch.float64)
    corner = torch.cartesian_prod(step, step).to(centre)
    inside = torch.rand(len(centre), side**2, 2, generator=generator, dtype=torch.float64)
    return centre.unsqueeze(1) - 0.5 + (corner + inside.to(centre)) / side


class _Changes(NamedTuple):
    """Pixels that one ray does not show.

    Attributes:
        light: textured or shiny, or direct light bends.
        edge: not on one smooth surface with all neighbours.
        bright: the same, and one of the two emits.
    """

    light: Bool[Tensor, "pixel"]
    edge: Bool[Tensor, "pixel"]
    bright: Bool[Tensor, "pixel"]

    @property
    def any(self) -> Bool[Tensor, "pixel"]:
        """Any of these."""
        return self.light | self.edge


@torch.no_grad()
def _changes(
    world: World, camera: AbstractCamera, settings: RenderSettings, found: Samples
) -> _Changes:
    """Compare every pixel with its 8 neighbours."""
    points, triangles = found.points, world.triangles
    surface = triangles.surface[points.triangle]
    emits = (triangles.emission > 0).any(-1)[points.triangle]
    light = torch.cat((found.weights, found.lamps), -1)
    columns = (surface.to(light).unsqueeze(-1), emits.to(light).unsqueeze(-1), light)
    grid = torch.cat((*columns, points.position, points.normal), -1)
    empty = grid.new_full((camera.height * camera.width, grid.shape[-1]), -1)
    grid = empty.index_copy(0, found.pixel, grid).reshape(camera.height, camera.width, -1)
    lobes = settings.lobe_samples > 0
    painted = [s.texture is not None or (lobes and s.glossy) for s in world.scene.surfaces]
    kind = grid[..., 0].long()
    light = torch.tensor(painted, device=kind.device)[kind.clamp(min=0)] & (kind >= 0)
    edge, bright = torch.zeros_like(light), torch.zeros_like(light)
    sizes = (1, 1, grid.shape[-1] - 8, 3, 3)
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        back = (-step[0], -step[1])
        here, there = (_shifted(grid, s).split(sizes, -1) for s in (step, back))
        found_edge, found_bright = _edges(here, there)
        beside = torch.zeros_like(edge)
        for way in (step, back):
            _shifted(beside, way).logical_or_(found_edge)
            _shifted(bright, way).logical_or_(found_bright)
        edge |= beside
        light |= _bends(grid[..., 2:-6], step) & ~beside
    return _Changes(*(c.reshape(-1) for c in (light, edge, bright)))


def _shifted(grid: Tensor, step: tuple[int, int]) -> Tensor:
    """The part of a picture whose neighbours `step` rows and columns away lie inside it; a view."""
    for axis, length in enumerate(step):
        size = grid.shape[axis]
        grid = grid.narrow(axis, max(0, -length), max(0, size - abs(length)))
    return grid


def _edges(
    here: tuple[Tensor, ...], there: tuple[Tensor, ...]
) -> tuple[Bool[Tensor, "row column"], Bool[Tensor, "row column"]]:
    """Where neighbours do not lie on one smooth surface, and where one of them emits besides."""
    offset = there[3] - here[3]
    step = (offset * here[4]).sum(-1).abs() > STEP * offset.norm(dim=-1)
    bend = (here[4] * there[4]).sum(-1) < BEND
    edge = (here[0] != there[0]).squeeze(-1) | bend | step
    return edge, edge & ((here[1] > 0) | (there[1] > 0)).squeeze(-1)


def _bends(
    light: Float[Tensor, "row column light"], step: tuple[int, int]
) -> Bool[Tensor, "row column"]:
    """Where light is not linear between two opposite neighbours; the border repeats itself."""
    padded = torch.nn.functional.pad(light.movedim(-1, 0), (1, 1, 1, 1), "replicate")
    size = light.shape[:2]
    before, after = (
        padded[:, 1 + s * step[0] :, 1 + s * step[1] :][:, : size[0], : size[1]].movedim(0, -1)
        for s in (-1, 1)
    )
    floor = DIM * light.clamp(min=0).mean((0, 1))
    larger = torch.maximum(torch.maximum(before, after), torch.maximum(light, floor))
    return ((before - 2 * light + after).abs() > JUMP * larger).any(-1)
