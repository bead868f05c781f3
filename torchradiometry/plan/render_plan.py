"""How much is enough: from a scene and a tolerance to the settings of the renderer.

The relative L1 error of a picture is budgeted over these causes, each with its own law:

    bounces       q^(k+1),                 q = largest albedo, k bounces (0 on convex bodies)
    patches       C_p i h / R              h patch edge, R half diagonal, i indirect share
    clusters      C_c                      where a tree of clusters stands for the matrix
    shadows       C_s / S                  S shadow rays to an emitting face; 0 where clipped
    edges         C_a / (s^(3/2) n)        s^2 rays in pixels that change, n pixels along
                                           the shorter side

The first is a bound: in a scene whose patches reflect at most q, what is left after k bounces
is at most q^(k+1) of all light. The others are estimates; their constants were measured
against finer pictures of rooms and bodies and then raised to the largest value found times a
margin (see docs/plan.md). An effect is included only if the scene calls for it: no shadow rays
on a convex body, no area sampling without a shining face or where the renderer clips the shadows
of few blockers, no patches where no face can see another, where nothing reflects, or where a
mesh has so many faces that its tree of clusters would take longer than `MOST_SECONDS`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import EmptySceneError, OutOfRangeError
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.plan.pilot import reflected_share, view_in
from torchradiometry.render.indirect import CLUSTER_ERROR, MOST_DENSE
from torchradiometry.render.pixels import EDGE, EMITTER
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import prepare
from torchradiometry.scene.scene import Scene, Triangles
from torchradiometry.transport.rays import RELATIVE_TOLERANCE
from torchradiometry.transport.visibility import possible_blockers

__all__ = ["RenderPlan", "plan_render"]

#: constants of the error laws above
PATCH_ERROR, SHADOW_ERROR, EDGE_ERROR = 0.12, 0.03, 2.4
#: edges of hard shadows come on top of those of bodies
HARD_SHADOWS = 1.5
#: and the edges inside a texture (measured on a chequered floor: 4.3)
TEXTURES = 5.0
#: shares of the tolerance that bounces and the three others may use
BOUNCE_SHARE = 0.1
#: interreflection of a face in a tree of clusters, s on one thread; of all faces at most
FACE_SECONDS, MOST_SECONDS = 2.5e-3, 120.0
#: no plan asks for more than these; faces themselves may be more than the patches they are cut to
MOST_BOUNCES, MOST_PATCHES, MOST_SHADOWS, MOST_SUPERSAMPLING = 64, 6000, 32, 6


@dataclass(frozen=True)
class RenderPlan:
    """Settings of the renderer, why, and the error to expect.

    Attributes:
        bounces, patch_size, shadow_samples, supersampling: as in `RenderSettings`; the patch
            size is None where no patches are made.
        predicted_error: relative L1 error of the picture: the sum of `parts`.
        parts: error by cause.
        reasons: for every effect, whether it is included and why.
        tolerance: what was asked for.
    """

    bounces: int
    patch_size: float | None
    shadow_samples: int
    supersampling: int
    predicted_error: float
    parts: dict[str, float]
    reasons: dict[str, str]
    tolerance: float

    @property
    def settings(self) -> RenderSettings:
        """What `render_scene` takes."""
        return RenderSettings(
            bounces=self.bounces,
            patch_size=self.patch_size,
            shadow_samples=self.shadow_samples,
            supersampling=self.supersampling,
        )

    def to_dict(self) -> dict[str, object]:
        """Plain numbers, strings and dicts, for JSON."""
        return asdict(self)


class _Analysis(NamedTuple):
    """What the scene calls for."""

    area: float
    scale: float
    albedo: float
    blockers: bool
    clipped: bool
    convex_body: bool
    emitters: int
    lamps: int
    sky: bool
    faces: int
    reflected: float
    textured: bool

    @property
    def sources(self) -> bool:
        """There is light that no face emits."""
        return self.lamps > 0 or self.sky

    @property
    def shines(self) -> bool:
        """There is light at all."""
        return self.emitters > 0 or self.sources


def plan_render(scene: Scene, camera: AbstractCamera, tolerance: float) -> RenderPlan:
    """The cheapest settings whose predicted error meets the tolerance, as far as it goes.

    Args:
        scene: surfaces and sources.
        camera: who looks; its picture size matters for edges.
        tolerance: relative L1 error of the picture, 0 < tolerance < 1.

    Returns:
        The plan. `predicted_error` may exceed the tolerance where the limits of the planner
        (patches, rays) are reached; `reasons` says so.

    Raises:
        OutOfRangeError: the tolerance is not between 0 and 1.
        EmptySceneError: no triangle.
    """
    if not (isinstance(tolerance, (int, float)) and 0 < tolerance < 1):
        raise OutOfRangeError("tolerance", f"{tolerance!r}", "pass a number between 0 and 1")
    found = _analyse(scene)
    reasons: dict[str, str] = {}
    parts: dict[str, float] = {}
    bounces = _plan_bounces(found, tolerance, parts, reasons)
    patch_size = _plan_patches(found, tolerance, bounces, parts, reasons)
    shadows = _plan_shadows(found, tolerance, parts, reasons)
    side = _plan_edges(found, camera, tolerance, parts, reasons)
    total = sum(parts.values())
    if total > tolerance:
        reasons["tolerance"] = f"not met: the limits of the planner leave {total:.3g}"
    return RenderPlan(bounces, patch_size, shadows, side, total, parts, reasons, tolerance)


@torch.no_grad()
def _analyse(scene: Scene) -> _Analysis:
    if not any(surface.count for surface in scene.surfaces):
        raise EmptySceneError("scene", "no triangles", "add a surface with faces")
    triangles = scene.triangles
    points = triangles.corners.reshape(-1, 3).to(torch.float64)
    scale = float((points.amax(0) - points.amin(0)).norm()) / 2
    margin = scale * RELATIVE_TOLERANCE
    emits = (triangles.emission > 0).any(-1)
    albedo = float(triangles.albedo.max())
    convex = _is_convex_body(triangles, points, margin)
    world = None if convex else prepare(scene, RenderSettings())
    return _Analysis(
        float(triangles.patches.area.sum()),
        scale,
        albedo,
        _anything_blocks(triangles.corners, points, margin),
        world is not None and world.blockers is not None,
        convex,
        int(emits.sum()),
        sum(source.has_direction for source in scene.sources),
        any(not source.has_direction for source in scene.sources),
        len(emits) + int(triangles.two_sided.sum()),
        0.0 if world is None else reflected_share(albedo, view_in(world)),
        any(surface.texture is not None for surface in scene.surfaces),
    )


def _anything_blocks(corners: Tensor, points: Tensor, margin: float) -> bool:
    """Whether some face can come between two points; looks no further than the first one."""
    blocks = (possible_blockers(part, points, margin) for part in corners.split(1024))
    return any(bool(block.any()) for block in blocks)


def _is_convex_body(triangles: Triangles, points: Tensor, margin: float) -> bool:
    """No point lies in front of any face: nothing sees anything."""
    if bool(triangles.two_sided.any()):
        return False
    a, b, c = triangles.corners.to(torch.float64).unbind(1)
    normal = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1)
    parts = zip(normal.split(1024), a.split(1024), strict=True)
    return all(
        float((n @ points.mT - (n * o).sum(-1, keepdim=True)).max()) <= margin for n, o in parts
    )


def _plan_bounces(
    found: _Analysis, tolerance: float, parts: dict[str, float], reasons: dict[str, str]
) -> int:
    if found.convex_body:
        reasons["interreflection"] = "left out: the scene is one convex body, no face sees another"
        return 0
    if found.albedo <= 0:
        reasons["interreflection"] = "left out: nothing reflects"
        return 0
    if not found.shines:
        reasons["interreflection"] = "left out: nothing shines"
        return 0
    seconds = found.faces * FACE_SECONDS
    too_many = seconds > MOST_SECONDS
    if too_many or found.reflected < BOUNCE_SHARE * tolerance:
        why = (
            f"{found.faces} faces would take about {seconds:.0f} s, the planner allows "
            f"{MOST_SECONDS:.0f} s"
        )
        parts["interreflection"] = found.reflected
        reasons["interreflection"] = (
            f"left out: {why if too_many else 'surfaces hardly see each other'}; about "
            f"{found.reflected:.2g} of the light at most"
        )
        return 0
    q = min(found.albedo, 1.0)
    goal = BOUNCE_SHARE * tolerance
    needed = math.ceil(math.log(goal) / math.log(q)) - 1 if q < 1 else MOST_BOUNCES
    bounces = max(1, min(needed, MOST_BOUNCES))
    parts["bounces"] = q ** (bounces + 1)
    reasons["interreflection"] = (
        f"{bounces} bounces: with albedos up to {q:.3g} at most {parts['bounces']:.2g} of the "
        "light is left"
    )
    return bounces


def _plan_patches(
    found: _Analysis,
    tolerance: float,
    bounces: int,
    parts: dict[str, float],
    reasons: dict[str, str],
) -> float | None:
    if bounces == 0:
        reasons["patches"] = "none: no interreflection"
        return None
    # patches blur reflected light only; near contacts its share exceeds the mean
    share = max(found.reflected, found.albedo / 2)
    wanted = 0.4 * tolerance * found.scale / (PATCH_ERROR * share)
    # n triangles of longest edge h cover about n h^2 / 4
    smallest = math.sqrt(4 * found.area / MOST_PATCHES)
    size = min(max(wanted, smallest), found.scale / 3)
    parts["patches"] = PATCH_ERROR * share * size / found.scale
    why = "as the tolerance asks"
    if size != wanted:
        limit = f"at most {MOST_PATCHES} patches"
        why = limit if size > wanted else "a third of the half diagonal is enough"
    reasons["patches"] = f"edges up to {size:.3g} m: {why}"
    count = round(max(found.faces, 4 * found.area / size**2))
    if count > MOST_DENSE:
        parts["clusters"] = CLUSTER_ERROR
        reasons["clusters"] = f"{count} patches or more: they exchange light through clusters"
    return size


def _plan_shadows(
    found: _Analysis, tolerance: float, parts: dict[str, float], reasons: dict[str, str]
) -> int:
    if not found.shines:
        reasons["shadows"] = "left out: nothing shines"
        return 0
    if found.convex_body or not (found.blockers or found.sources):
        reasons["shadows"] = "left out: no face can come between two points of the scene"
        return 0
    told = ["one ray to each lamp"] * (found.lamps > 0)
    told += [f"{RenderSettings().sky_samples} rays to the sky"] * found.sky
    samples = 1
    if found.emitters == 0:
        told += ["no face shines, so no area is sampled"]
    elif not found.blockers:
        told += ["nothing hides a shining face"]
    elif found.clipped:
        told += ["few faces block, so the visible parts of shining ones are clipped, not sampled"]
    else:
        wanted = math.ceil(SHADOW_ERROR / (0.25 * tolerance))
        samples = max(2, min(wanted, MOST_SHADOWS))
        parts["shadows"] = SHADOW_ERROR / samples
        told += [f"{samples} rays to each shining polygon, {4 * samples} in penumbras"]
    reasons["shadows"] = "; ".join(told)
    return samples


def _plan_edges(
    found: _Analysis,
    camera: AbstractCamera,
    tolerance: float,
    parts: dict[str, float],
    reasons: dict[str, str],
) -> int:
    pixels = min(camera.width, camera.height)
    edge_error = EDGE_ERROR * (HARD_SHADOWS if found.sources and not found.convex_body else 1)
    edge_error *= TEXTURES if found.textured else 1
    wanted = (edge_error / (0.25 * tolerance * pixels)) ** (2 / 3)
    side = max(1, min(math.ceil(wanted), MOST_SUPERSAMPLING))
    parts["edges"] = edge_error / (side**1.5 * pixels)
    reasons["supersampling"] = _rays_a_pixel(found, side)
    return side


def _rays_a_pixel(found: _Analysis, side: int) -> str:
    if side == 1:
        return "one ray a pixel"
    bends = "on textures and where light bends" if found.textured else "where light bends"
    places = {side: bends, EDGE * side: "at edges"}
    if found.emitters:
        places[EMITTER * side] = "at edges of shining faces"
    return ", ".join(["one ray a pixel", *(f"{n} x {n} {where}" for n, where in places.items())])
