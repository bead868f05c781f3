"""A described world: surfaces, sources and cameras, and its triangles in one list.

The scene frame is glTF's: right-handed, lengths in m, y up by custom. Everything is already
in world space; there is no hierarchy left.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import DTypeError, EmptySceneError, ShapeError
from torchradiometry.geometry.cameras import AbstractCamera
from torchradiometry.geometry.meshes import face_corners, face_normals
from torchradiometry.geometry.patches import Patches
from torchradiometry.materials.phong import mean_lobe_reflectance
from torchradiometry.scene.surface import Surface
from torchradiometry.scene.texture_lookup import sample_texture, triangle_means
from torchradiometry.scene.validate import Fault, require_none, scene_faults
from torchradiometry.sources.base import AbstractSource

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

__all__ = ["Scene", "Triangles"]


class Triangles(NamedTuple):
    """All triangles of a scene, in the order of its surfaces and their faces.

    Attributes:
        corners: world, m, counter-clockwise seen from the front.
        normals: shading normals at the three corners (the face normal where shaded flat).
        surface: index into `scene.surfaces`.
        albedo: mean over the triangle, 0..1.
        emission: emitted radiance, W/m2/sr.
        two_sided: the back reflects and emits too.
        specular: k_s of the lobe, 0..1.
        shininess: n of the lobe.
    """

    corners: Float[Tensor, "triangle 3 3"]
    normals: Float[Tensor, "triangle 3 3"]
    surface: Int[Tensor, "triangle"]
    albedo: Float[Tensor, "triangle channel"]
    emission: Float[Tensor, "triangle channel"]
    two_sided: Bool[Tensor, "triangle"]
    specular: Float[Tensor, "triangle channel"]
    shininess: Float[Tensor, "triangle"]

    @property
    def reflectance(self) -> Float[Tensor, "triangle channel"]:
        """Share of even light that is reflected, 0..1: the albedo, and the mean of the lobe."""
        lobe = mean_lobe_reflectance(self.shininess.unsqueeze(-1))
        return self.albedo + self.specular * lobe.to(self.specular)

    @property
    def patches(self) -> Patches:
        """The triangles as flat patches."""
        return Patches(self.corners)


@dataclass(frozen=True, eq=False)
class Scene:
    """Surfaces, sources and cameras.

    Args:
        surfaces: the meshes; those with `emission` shine.
        sources: the other lights (point, spot, distant ...).
        cameras: who looks.

    Raises:
        DTypeError: a member of the wrong class.
        ShapeError: surfaces whose colours have different numbers of channels (1 fits all).
    """

    surfaces: tuple[Surface, ...] = ()
    sources: tuple[AbstractSource, ...] = ()
    cameras: tuple[AbstractCamera, ...] = ()

    def __post_init__(self) -> None:
        kinds = {"surfaces": Surface, "sources": AbstractSource, "cameras": AbstractCamera}
        for name, kind in kinds.items():
            members = getattr(self, name)
            if not isinstance(members, Iterable):
                got = f"a {type(members).__name__}"
                raise DTypeError(f"scene.{name}", got, f"pass a tuple of {kind.__name__}s")
            members = tuple(members)
            object.__setattr__(self, name, members)
            for member in members:
                if not isinstance(member, kind):
                    got = f"a {type(member).__name__}"
                    raise DTypeError(f"scene.{name}", got, f"pass {kind.__name__}s")
        counts = {surface.channels for surface in self.surfaces} - {1}
        if len(counts) > 1:
            got = f"surfaces with {sorted(counts)} channels"
            raise ShapeError("scene.surfaces", got, "give all the same number (or 1)")

    @property
    def channels(self) -> int:
        """Number of colour channels of the surfaces."""
        return max((surface.channels for surface in self.surfaces), default=1)

    @property
    def emissive(self) -> tuple[Surface, ...]:
        """The surfaces that shine."""
        return tuple(s for s in self.surfaces if bool((s.emission.detach() > 0).any()))

    @property
    def bounds(self) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
        """Lowest and highest corner of the box around all vertices, m.

        Raises:
            EmptySceneError: no vertices.
        """
        vertices = [s.vertices.detach() for s in self.surfaces if len(s.vertices)]
        if not vertices:
            raise EmptySceneError("scene", "no surfaces", "add a surface")
        low = torch.stack([v.amin(0) for v in vertices]).amin(0)
        return low, torch.stack([v.amax(0) for v in vertices]).amax(0)

    @property
    def triangles(self) -> Triangles:
        """All triangles; computed at each call, so keep the result.

        Raises:
            EmptySceneError: no triangle.
            IndexRangeError: a face that names a vertex which does not exist.

        Differentiable in: vertices, normals, albedo, emission and texture images.
        """
        if not any(surface.count for surface in self.surfaces):
            raise EmptySceneError("scene", "no triangles", "add a surface with faces")
        parts = [self._part(k, s) for k, s in enumerate(self.surfaces)]
        return Triangles(*(torch.cat(column) for column in zip(*parts, strict=True)))

    def _part(self, index: int, surface: Surface) -> Triangles:
        """The triangles of one surface."""
        corners = face_corners(surface.vertices, surface.faces)
        if surface.normals is None:
            flat = face_normals(surface.vertices, surface.faces)
            normals = flat.unsqueeze(-2).expand(-1, 3, 3)
        else:
            normals = surface.normals[surface.faces]
        albedo = surface.albedo
        if surface.texture is not None:
            albedo = albedo * triangle_means(surface.texture, surface.faces)
        shape = (surface.count, self.channels)
        device = surface.faces.device
        return Triangles(
            corners,
            normals,
            torch.full(shape[:1], index, dtype=torch.int64, device=device),
            albedo.expand(shape),
            surface.emission.expand(shape),
            torch.full(shape[:1], surface.two_sided, dtype=torch.bool, device=device),
            surface.specular.expand(shape),
            surface.shininess.expand(shape[:1]),
        )

    def albedo_at(
        self, triangle: Int[Tensor, "ray"], barycentric: Float[Tensor, "ray 3"]
    ) -> Float[Tensor, "ray channel"]:
        """Albedo at points of triangles, textures looked up bilinearly.

        Args:
            triangle: index into `triangles`; -1 (nothing hit) gives 0.
            barycentric: weights of the three corners.

        Differentiable in: albedo, texture images, barycentric.
        """
        counts = torch.tensor([s.count for s in self.surfaces], device=triangle.device)
        ends = counts.cumsum(0)
        surface = torch.searchsorted(ends, triangle, right=True)
        table = torch.stack([s.albedo.expand(self.channels) for s in self.surfaces])
        inside = (triangle >= 0) & (triangle < ends[-1])
        surface = torch.where(inside, surface, 0)
        albedo = torch.where(inside.unsqueeze(-1), table[surface], 0)
        for k, member in enumerate(self.surfaces):
            if member.texture is not None:
                rays = torch.nonzero(inside & (surface == k)).squeeze(-1)
                face = member.faces[triangle[rays] - (ends[k] - counts[k])]
                corner = member.texture.coordinates[face]
                where = torch.einsum("rc,rcx->rx", barycentric[rays].to(corner), corner)
                colour = albedo[rays] * sample_texture(member.texture, where).to(albedo)
                albedo = albedo.index_put((rays,), colour)
        return albedo

    def to(self, dtype: torch.dtype | None = None, device: object = None) -> Scene:
        """A copy in another dtype or on another device."""
        return replace(
            self,
            surfaces=tuple(s.to(dtype, device) for s in self.surfaces),
            sources=tuple(copy.deepcopy(s).to(device=device, dtype=dtype) for s in self.sources),  # type: ignore[call-overload]
            cameras=tuple(c.to(dtype, device) for c in self.cameras),
        )

    def validate(self) -> tuple[Fault, ...]:
        """Every fault of the scene, with the mesh and the face; empty if there is none."""
        return scene_faults(self.surfaces, self.sources, self.cameras)

    def require_renderable(self) -> tuple[Fault, ...]:
        """Raise for the first grave fault; give back the slight ones, which a picture survives.

        Faces without area show nothing, and shading normals on the wrong side give way to the
        face's own; a file with a few of them can still be rendered.
        """
        faults = self.validate()
        require_none([fault for fault in faults if fault.grave])
        return tuple(fault for fault in faults if not fault.grave)

    def require_valid(self) -> None:
        """Raise the named error of the first fault that `validate` finds."""
        require_none(self.validate())
