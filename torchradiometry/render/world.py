"""A scene made ready for rays: one-sided faces, blockers, emitters, in float64.

Emitting faces are grouped by their surface, and neighbours (a, b, c), (a, c, d) in one plane are
integrated as one quad.

A triangle has a front; a two-sided one also has a back that reflects and emits. The back of a
one-sided triangle is black: it blocks, and a ray that meets it sees nothing.

An emitting triangle that lies exactly on another triangle (a lamp drawn onto the ceiling) is
moved to its front by four times the rays' tolerance, 2^-16 of the scene's half
diagonal, so that it covers what lies behind it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import InvalidValueError, MissingDependencyError, require_kind
from torchradiometry.numerics import guarded_divide, safe_norm, safe_normalize
from torchradiometry.render.settings import RenderSettings
from torchradiometry.scene.scene import Scene, Triangles
from torchradiometry.transport.blockers import convex_blockers, possible_blockers
from torchradiometry.transport.brute_force import BruteForceRays
from torchradiometry.transport.embree import EmbreeRays
from torchradiometry.transport.rays import RELATIVE_TOLERANCE, AbstractRayCaster
from torchradiometry.transport.rules import patch_points

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Emitters", "Faces", "World", "prepare"]

#: how far a coplanar lamp is moved, in tolerances of the rays
NUDGE = 4
#: largest deviation of cosines of coplanar triangles from 1
COPLANAR = 2.0**-20
#: blockers x emitting polygons up to which visible parts are clipped and not sampled
CLIPPED = 64
#: triangles beyond which blockers are not looked for
LARGE = 2**12
#: points that are asked first which triangles can block
FEW = 64
#: a triangle is flat if its shading normals deviate from its plane by less (cosine)
FLAT = 1 - 2.0**-12


class Faces(NamedTuple):
    """One-sided faces that reflect or emit: all fronts, then the backs of two-sided triangles.

    Attributes:
        corners: m, counter-clockwise seen from the reflecting side.
        triangle: the triangle a face is a side of.
        back: index of a triangle's back face, -1 where it is black.
    """

    corners: Float[Tensor, "face 3 3"]
    triangle: Int[Tensor, "face"]
    back: Int[Tensor, "triangle"]


class Emitters(NamedTuple):
    """Surfaces that shine.

    Attributes:
        corners: of their convex polygons, m, counter-clockwise seen from the front; a triangle
            repeats its last corner.
        member: 1 where a polygon belongs to an emitter.
        triangle: one triangle of each emitter, which knows its radiance.
    """

    corners: Float[Tensor, "polygon 4 3"]
    member: Float[Tensor, "polygon emitter"]
    triangle: Int[Tensor, "emitter"]


class World(NamedTuple):
    """A prepared scene.

    Attributes:
        scene: as it was given.
        triangles: in float64.
        normal: geometric, unit.
        faces: the one-sided faces.
        emitters: what shines.
        blockers: convex polygons that can come between two points of the scene; None if they
            are so many that sampling is cheaper.
        rays: what blocks.
        reason: which ray caster, and why.
    """

    scene: Scene
    triangles: Triangles
    normal: Float[Tensor, "triangle 3"]
    faces: Faces
    emitters: Emitters
    blockers: Float[Tensor, "blocker 4 3"] | None
    rays: AbstractRayCaster
    reason: str

    @property
    def middle(self) -> Float[Tensor, "3"]:
        """Centroid of the surfaces, m."""
        a, b, c = self.triangles.corners.unbind(1)
        area = torch.linalg.cross(b - a, c - a).norm(dim=-1)
        whole = ((a + b + c) / 3 * area.unsqueeze(-1)).sum(0)
        return guarded_divide(whole, area.sum())

    @property
    def parts(self) -> Int[Tensor, "face"]:
        """Which flat or smooth part of a surface each one-sided face belongs to, 0...

        Faces of one surface are of one part if they are flat and have one normal, or if they lie
        on the same side of its smooth ones.
        """
        triangle, triangles = self.faces.triangle, self.triangles
        flat = (triangles.normals * self.normal.unsqueeze(1)).sum(-1).amin(-1) > FLAT
        front = torch.arange(len(triangle), device=triangle.device) < len(triangles.surface)
        side = torch.where(front, 1.0, -1.0).to(self.normal).unsqueeze(-1)
        plane = torch.where(flat[triangle].unsqueeze(-1), self.normal[triangle] * side, 4 * side)
        # a shift by 0.37 keeps round numbers away from the borders of the rounding
        plane = (plane.detach() * 256 + 0.37).floor()
        key = torch.cat((triangles.surface[triangle].unsqueeze(-1).to(plane), plane), -1)
        return torch.unique(key.long(), dim=0, return_inverse=True)[1]

    def glow(self, triangles: Triangles) -> Float[Tensor, "emitter channel"]:
        """Radiance of the emitters, W/m2/sr, in float64.

        Args:
            triangles: of this scene, or of the same one with other colours.
        """
        return triangles.emission[self.emitters.triangle].to(torch.float64)


def prepare(scene: Scene, settings: RenderSettings) -> World:
    """Float64 triangles, ray caster and one-sided faces of a scene.

    Raises:
        DTypeError: no scene.
        InvalidValueError: a colour that is NaN or infinite.
    """
    require_kind("scene", scene, Scene)
    found = scene.triangles
    for name in ("albedo", "emission", "specular"):
        if not bool(getattr(found, name).isfinite().all()):
            mend = "pass finite numbers; scene.validate() says where"
            raise InvalidValueError(f"scene, {name}", "NaN or infinity", mend)
    triangles = Triangles(*(t.to(torch.float64) if t.is_floating_point() else t for t in found))
    corners = triangles.corners
    normal = safe_normalize(_cross(corners))
    corners = corners + _nudge(triangles, normal)
    triangles = triangles._replace(corners=corners)
    rays, reason = _ray_caster(corners, settings)
    backs = torch.nonzero(triangles.two_sided).squeeze(-1)
    back = torch.full_like(triangles.surface, -1)
    back[backs] = len(corners) + torch.arange(len(backs), device=back.device)
    faces = Faces(
        torch.cat((corners, corners[backs].flip(1))),
        torch.cat((torch.arange(len(corners), device=back.device), backs)),
        back,
    )
    emitters = _emitters(triangles, faces, rays.tolerance)
    blockers = _blockers(corners, len(emitters.corners), rays.tolerance)
    return World(scene, triangles, normal, faces, emitters, blockers, rays, reason)


def _blockers(
    corners: Float[Tensor, "triangle 3 3"], emitters: int, tolerance: float
) -> Float[Tensor, "blocker 4 3"] | None:
    """Differentiable in corners: where few faces block, shadows move with them."""
    if len(corners) > LARGE:
        return None
    points, most = corners.reshape(-1, 3), 2 * CLIPPED // max(1, emitters)
    # two triangles make a blocker at best; a few points already show most of those that block
    some = points[:: max(1, len(points) // FEW)]
    if int(possible_blockers(corners, some, tolerance).sum()) > most:
        return None
    found = corners[possible_blockers(corners, points, tolerance)]
    blockers = convex_blockers(found) if len(found) <= most else found
    return blockers if len(blockers) * max(1, emitters) <= CLIPPED else None


def _emitters(triangles: Triangles, faces: Faces, tolerance: float) -> Emitters:
    shining = (triangles.emission.detach() > 0).any(-1)[faces.triangle]
    chosen = torch.nonzero(shining).squeeze(-1)
    corners, triangle = faces.corners[chosen], faces.triangle[chosen]
    surface = triangles.surface[triangle]
    quads, first = _quads(corners, surface, tolerance)
    kind, group = torch.unique(surface[first], return_inverse=True)
    member = (group.unsqueeze(-1) == torch.arange(len(kind), device=group.device)).to(corners)
    place = torch.searchsorted(triangles.surface, kind)
    return Emitters(quads, member, place)


def _quads(
    corners: Float[Tensor, "triangle 3 3"], surface: Int[Tensor, "triangle"], tolerance: float
) -> tuple[Float[Tensor, "polygon 4 3"], Int[Tensor, "polygon"]]:
    """Triangles of which neighbours in the list are joined, and the first one of each polygon."""
    alone = torch.cat((corners, corners[:, 2:]), 1)
    if len(corners) < 2:
        return alone, torch.arange(len(corners), device=surface.device)
    joined = torch.cat((corners[:-1], corners[1:, 2:]), 1)
    edge = joined.detach().roll(-1, 1) - joined.detach()
    turn = torch.linalg.cross(edge.roll(1, 1), edge, dim=-1)
    convex = (turn * turn.sum(1, keepdim=True)).sum(-1).amin(-1) > 0
    shared = (corners[:-1, (0, 2)] - corners[1:, (0, 1)]).detach().abs().amax((1, 2)) < tolerance
    plane = torch.nn.functional.normalize(turn.sum(1), dim=-1).unsqueeze(1)
    flat = ((joined - joined[:, :1]) * plane).detach().sum(-1).abs().amax(-1) < tolerance
    fits = torch.cat((convex & shared & flat & (surface[1:] == surface[:-1]), surface[:1] < 0))
    # in a run of neighbours that fit, every second one begins a quad
    place = torch.arange(len(fits), device=fits.device)
    begun = torch.where(fits, -1, place).cummax(0).values
    begun = torch.cat((begun.new_full((1,), -1), begun[:-1]))
    takes = fits & ((place - begun) % 2 == 1)
    taken = torch.cat((takes.new_zeros(1), takes[:-1]))
    quad = torch.cat((joined, alone[-1:]))
    return torch.where(takes[:, None, None], quad, alone)[~taken], place[~taken]


def _cross(corners: Tensor) -> Tensor:
    a, b, c = corners.unbind(1)
    return torch.linalg.cross(b - a, c - a)


def _ray_caster(corners: Tensor, settings: RenderSettings) -> tuple[AbstractRayCaster, str]:
    if settings.rays is not None:
        return settings.rays(corners), f"{settings.rays.__name__}, as asked"  # type: ignore[call-arg]
    if corners.is_cuda:
        return BruteForceRays(corners), "BruteForceRays: the scene lies on a CUDA device"
    try:
        return EmbreeRays(corners), "EmbreeRays: the scene lies on the CPU"
    except MissingDependencyError as error:
        return BruteForceRays(corners), f"BruteForceRays: {error}"


@torch.no_grad()
def _nudge(triangles: Triangles, normal: Tensor) -> Float[Tensor, "triangle 1 3"]:
    """How far each triangle moves: emitters that lie on something else, forwards."""
    corners = triangles.corners
    points = corners.reshape(-1, 3)
    size = float(safe_norm(points.amax(0) - points.amin(0))) / 2
    emits = (triangles.emission > 0).any(-1)
    others = torch.nonzero(~emits).squeeze(-1)
    moved = torch.zeros_like(normal)
    offset = (normal * corners[:, 0]).sum(-1)
    for block in torch.nonzero(emits).squeeze(-1).split(256):
        parallel = (normal[block] @ normal[others].mT).abs() > 1 - COPLANAR
        distance = (corners[block].mean(1) @ normal[others].mT - offset[others]).abs()
        a, b = torch.nonzero(parallel & (distance < size * RELATIVE_TOLERANCE), as_tuple=True)
        a, b = block[a], others[b]
        hit = a[_overlap(corners[a], corners[b]) | _overlap(corners[b], corners[a])]
        moved[hit] = normal[hit]
    return (moved * (NUDGE * size * RELATIVE_TOLERANCE)).unsqueeze(1)


def _overlap(first: Tensor, second: Tensor) -> Bool[Tensor, "pair"]:
    """Whether points spread over the first triangle lie inside the coplanar second."""
    point = patch_points(first, 5, 2).position
    normal = _cross(second).unsqueeze(1)
    following = second.roll(-1, 1)
    inside = torch.ones_like(point[..., 0], dtype=torch.bool)
    for a, b in zip(second.unbind(1), following.unbind(1), strict=True):
        edge = torch.linalg.cross((b - a).unsqueeze(1).expand_as(point), point - a.unsqueeze(1))
        inside = inside & ((edge * normal).sum(-1) > 0)
    return inside.any(-1)
