"""Ray-traced truth for shading on depth maps: shadows, sky and interreflection.

The surface is the triangle mesh of the depth map (`depth_to_mesh`), rays are Embree's, and
everything is evaluated at the points of the pixels, which are the mesh's vertices, about the
normals of `depth_to_normals`. Nothing of the package's transport or shading is used.

    hard shadow     V(x) = 1 if x faces the light and the segment between them is free
    sky             s(x) = 1/pi int V cos dw,        bent normal = normalize(int V cos w dw)
    bounces         E_k = T rho (E_0 + E_(k-1)),     (T B)(x) = 1/pi int B(hit of w) cos dw

with cos the cosine at x's normal; integrals are means over directions drawn with density
cos/pi from a Sobol sequence, the same for every pixel but shifted by a random pair (modulo 1)
of its own. B between vertices is linear on the triangle. A triangle met from behind (possible
only through a hole) blocks and sends nothing.

**Where rays start.** A vertex lies on its triangles and has, at a crease, no tangent plane.
What is right is the limit from just above the surface: a ray that enters the cone of the
vertex's own triangles is blocked at once (at the bottom of a groove the walls hide most of the
sky that the mean normal faces), and one that leaves it must not see them. Rays start from the
vertex, moved by a thousandth of a pixel *towards the camera*: along its own line of sight a
point can never pass through a surface that the camera sees, while along the mean normal it
does where steep and gentle slopes meet (left slope a and mean slope m with a m < -1, as at the
foot of a cliff). The price is a horizon that is at most 0.001 rad off.

**Noise**, as the standard error over four seeds at 64 x 64 and the rays below: sky visibility
0.0005 to 0.0008 (root mean square over the pixels); converged indirect light at albedo 0.8
under one distant light 0.3 % (bowl, groove), 0.6 % (ripple), 0.8 % (block), 1.0 % (random) of
its mean, as mean absolute error. Four times the rays leave a third of it.

References: I. Sobol' (1967); R. Cranley and T. Patterson, SIAM J. Numer. Anal. 13 (1976), for
the shifts; M. Cohen and J. Wallace, *Radiosity and Realistic Image Synthesis* (1993), ch. 4.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy import sparse
from torch import Tensor
from torch.nn import functional
from torch.quasirandom import SobolEngine

from torchradiometry.geometry import depth_to_mesh, depth_to_normals, local_frame

__all__ = [
    "SkyTruth",
    "bounced",
    "boundary_band",
    "hard_shadow",
    "indirect_irradiance",
    "sky_visibility",
    "transport_matrix",
]

#: how far rays start above the surface, in pixels
LIFT = 1e-3
#: rays in one block of memory
BLOCK = 2**19
#: converged bounces change no irradiance by more than this share of the largest direct one
CONVERGED = 1e-6


class SkyTruth(NamedTuple):
    """`visibility` `H W`, 0...1, and the unit `bent_normal` `3 H W`; both 0 where masked."""

    visibility: Tensor
    bent_normal: Tensor


class Sheet:
    """The mesh of one depth map in Embree, and where its pixels' rays start."""

    def __init__(self, depth: Tensor, intrinsics: Tensor | None, pixel_size: float | None) -> None:
        vertices, faces = depth_to_mesh(depth.to(torch.float64), intrinsics, pixel_size)
        normals = depth_to_normals(depth.to(torch.float64), intrinsics, pixel_size)[0]
        self.shape = tuple(depth.shape[-2:])
        self.faces = faces.numpy()
        self.normal = normals.flatten(1).T
        self.seen = (self.normal.abs().sum(-1) > 0).nonzero().squeeze(-1)
        self.start = vertices + LIFT * _to_camera(vertices, intrinsics, pixel_size)
        # Embree counts in float32: its numbers stay below 1, around the middle of the mesh
        known = vertices[torch.isfinite(vertices).all(-1)]
        self.centre = (known.amax(0) + known.amin(0)) / 2
        self.scale = float((known - self.centre).abs().max())
        self.scene = EmbreeScene(robust=True)
        inside = self._unit(torch.nan_to_num(vertices))
        if len(faces):
            TriangleMesh(self.scene, inside, self.faces.astype(np.int32))

    def free(self, origin: Tensor, direction: Tensor, reach: float) -> Tensor:
        """True where nothing lies on the ray within `reach` lengths of its direction."""
        heading = (direction / self.scale).to(torch.float32).numpy()
        reaches = np.full(len(heading), min(reach, 1e30), dtype=np.float32)
        hit = self.scene.run(self._unit(origin), heading, dists=reaches, query="OCCLUDED")
        return torch.from_numpy(hit < 0)

    def first(self, origin: Tensor, direction: Tensor) -> tuple[np.ndarray, np.ndarray]:
        """Vertices `ray 3` of the triangle met and their weights; 0 for none or from behind."""
        heading = direction.to(torch.float32).numpy()
        hit = self.scene.run(self._unit(origin), heading, query="INTERSECT", output=1)
        face, u, v = hit["primID"], hit["u"].astype(float), hit["v"].astype(float)
        front = (face >= 0) & ((hit["Ng"] * heading).sum(-1) < 0)
        weights = np.stack([1 - u - v, u, v], -1) * front[:, None]
        return self.faces[np.maximum(face, 0)], weights

    def blocks(self, rays: int, seed: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Some pixels at a time and the directions `pixel ray 3` of their rays."""
        square = SobolEngine(2, scramble=True, seed=seed).draw(rays, dtype=torch.float64)
        generator = torch.Generator().manual_seed(seed)
        shifts = torch.rand(len(self.normal), 1, 2, dtype=torch.float64, generator=generator)
        for pixels in self.seen.split(max(1, BLOCK // rays)):
            yield pixels, _about(self.normal[pixels], (square + shifts[pixels]) % 1)

    def _unit(self, points: Tensor) -> np.ndarray:
        return ((points - self.centre) / self.scale).to(torch.float32).contiguous().numpy()


def hard_shadow(
    depth: Tensor,
    light_direction: Tensor | None = None,
    light_position: Tensor | None = None,
    *,
    intrinsics: Tensor | None = None,
    pixel_size: float | None = None,
) -> Tensor:
    """True where a light is seen: `*light H W` for lights `*light 3`; False where masked.

    Args:
        depth: `1 1 H W`, m.
        light_direction: unit vectors to distant lights, or
        light_position: places of near ones, m; both in the camera frame.

    A pixel whose normal turns away from the light is dark; its own triangles would say so too,
    but at the border of the map there are none on one side. An area light is the mean over
    positions on it.
    """
    sheet = Sheet(depth, intrinsics, pixel_size)
    lights = light_direction if light_position is None else light_position
    assert lights is not None
    lit = torch.zeros(lights[..., 0].numel(), len(sheet.start), dtype=torch.bool)
    start = sheet.start[sheet.seen]
    for row, light in zip(lit, lights.to(torch.float64).reshape(-1, 3), strict=True):
        near = light_position is not None
        heading = light - start if near else light.expand_as(start)
        faces = (heading * sheet.normal[sheet.seen]).sum(-1) > 0
        row[sheet.seen] = faces & sheet.free(start, heading, 1.0 if near else math.inf)
    return lit.reshape(*lights.shape[:-1], *sheet.shape)


def boundary_band(visible: Tensor, pixels: int) -> Tensor:
    """True within `pixels` (in rows or columns) of a pixel of the other kind; `*batch H W`."""
    field = visible.to(torch.float32).reshape(-1, 1, *visible.shape[-2:])
    widest = functional.max_pool2d(field, 2 * pixels + 1, 1, pixels)
    lowest = -functional.max_pool2d(-field, 2 * pixels + 1, 1, pixels)
    return (widest != lowest).reshape(visible.shape)


def sky_visibility(
    depth: Tensor,
    *,
    intrinsics: Tensor | None = None,
    pixel_size: float | None = None,
    rays: int = 4096,
    seed: int = 0,
) -> SkyTruth:
    """Cosine-weighted share of the hemisphere that is free, and its mean direction.

    Args:
        depth: `1 1 H W`, m.
        rays: per pixel, a power of 2.
        seed: of the directions; the same seed gives the same numbers.
    """
    sheet = Sheet(depth, intrinsics, pixel_size)
    share = torch.zeros(len(sheet.normal), dtype=torch.float64)
    bent = torch.zeros_like(sheet.normal)
    for pixels, direction in sheet.blocks(rays, seed):
        origin = sheet.start[pixels].unsqueeze(1).expand_as(direction)
        free = sheet.free(origin.reshape(-1, 3), direction.reshape(-1, 3), math.inf)
        free = free.reshape(direction.shape[:2]).to(torch.float64)
        share[pixels] = free.mean(1)
        bent[pixels] = functional.normalize((free.unsqueeze(-1) * direction).sum(1), dim=-1)
    return SkyTruth(
        share.reshape(sheet.shape).to(depth.dtype),
        bent.T.reshape(3, *sheet.shape).to(depth.dtype),
    )


def transport_matrix(
    depth: Tensor,
    *,
    intrinsics: Tensor | None = None,
    pixel_size: float | None = None,
    rays: int = 2048,
    seed: int = 0,
) -> sparse.csr_array:
    """T `pixel pixel`: irradiance at each pixel's point per radiosity at each; see the module.

    Rays are traced once, here; a row sums to the share of the hemisphere that is not sky.
    """
    sheet = Sheet(depth, intrinsics, pixel_size)
    count = len(sheet.normal)
    shares, rows, columns = [], [], []
    for pixels, direction in sheet.blocks(rays, seed):
        origin = sheet.start[pixels].unsqueeze(1).expand_as(direction)
        vertices, weights = sheet.first(origin.reshape(-1, 3), direction.reshape(-1, 3))
        place = np.repeat(np.arange(len(pixels)) * count, rays)[:, None] + vertices
        summed = np.bincount(place.ravel(), weights.ravel(), len(pixels) * count)
        block = sparse.coo_array(summed.reshape(-1, count) / rays)
        shares.append(block.data)
        rows.append(pixels.numpy()[block.row])
        columns.append(block.col)
    whole = np.concatenate(shares), (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array(whole, shape=(count, count))


def bounced(
    transport: sparse.csr_array, albedo: Tensor, direct: Tensor, bounces: int | None = None
) -> Tensor:
    """Irradiance `H W C` that came by way of the surface; `bounces` None: all, to `CONVERGED`."""
    rho = albedo.to(torch.float64).expand(direct.shape).flatten(0, 1).numpy()
    first = torch.nan_to_num(direct.to(torch.float64)).flatten(0, 1).numpy()
    indirect, done = np.zeros_like(first), 0
    while bounces is None or done < bounces:
        before = indirect
        indirect = transport @ (rho * (first + before))
        done += 1
        if np.abs(indirect - before).max() <= CONVERGED * np.abs(first).max():
            break
    return torch.from_numpy(indirect).reshape(direct.shape).to(direct.dtype)


def indirect_irradiance(
    depth: Tensor,
    albedo: Tensor,
    direct: Tensor,
    *,
    intrinsics: Tensor | None = None,
    pixel_size: float | None = None,
    bounces: int | None = None,
    rays: int = 2048,
    seed: int = 0,
) -> Tensor:
    """Irradiance `H W C` at each pixel's point by way of the surface.

    Args:
        depth: `1 1 H W`, m.
        albedo: `H W C` (or what expands to it), 0...1.
        direct: irradiance from the sources `H W C`, shadows and cosine included.
        bounces: how often light is reflected at most; None is all of them.
        rays: per pixel, a power of 2.
        seed: of the directions.
    """
    transport = transport_matrix(
        depth, intrinsics=intrinsics, pixel_size=pixel_size, rays=rays, seed=seed
    )
    return bounced(transport, albedo, direct, bounces)


def _to_camera(points: Tensor, intrinsics: Tensor | None, pixel_size: float | None) -> Tensor:
    """From each point to the camera, as long as a pixel is wide there."""
    if intrinsics is None:
        assert pixel_size is not None
        return torch.tensor([0.0, 0.0, pixel_size], dtype=points.dtype).expand_as(points)
    width = -points[:, 2:] / intrinsics[0, 0].to(points.dtype)
    return functional.normalize(-points, dim=-1) * width


def _about(normal: Tensor, square: Tensor) -> Tensor:
    """Directions `pixel ray 3` of density cos/pi about each normal, from the unit square."""
    radius, angle = square[..., 0].sqrt(), 2 * math.pi * square[..., 1]
    tangent, bitangent = (side.unsqueeze(1) for side in local_frame(normal))
    level = (radius * angle.cos()).unsqueeze(-1) * tangent
    level = level + (radius * angle.sin()).unsqueeze(-1) * bitangent
    return level + (1 - square[..., :1]).sqrt() * normal.unsqueeze(1)
