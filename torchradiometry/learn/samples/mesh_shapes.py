"""Shapes from meshes that the user names, turned at random, as height fields.

A vertex v is seen at q = s (R (v - c) - m): c is the middle of the mesh, R a random rotation, m
the middle of what R makes of it, s the scale at which it fills as much of the picture as random
shapes do. A pixel's ray (q_x, q_y fixed, q_z falling) is turned back into the frame of the mesh,
where a ray caster finds the first triangle; the height is where it is hit,

    v = c + R^T (q / s + m),      z = q_z of the hit.

Rotations are even over all rotations: a quaternion of four Gaussian numbers, divided by its length
(K. Shoemake, "Uniform random rotations", Graphics Gems III, 1992). Frame, lengths (pixels), heights
outside and the mask's rim are those of `random_shapes`, and so are the normals: of the heights.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.errors import (
    DegenerateGeometryError,
    IndexRangeError,
    InvalidValueError,
    MissingDependencyError,
    OutOfRangeError,
)
from torchradiometry.files import check_readable
from torchradiometry.geometry.meshes import face_corners
from torchradiometry.learn.samples.shapes import Shapes, finished
from torchradiometry.learn.samples.solids import grid, uniform
from torchradiometry.scene.load import load_scene
from torchradiometry.scene.validate import require_none, scene_faults
from torchradiometry.transport.brute_force import BruteForceRays
from torchradiometry.transport.embree import EmbreeRays
from torchradiometry.transport.rays import AbstractRayCaster

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

__all__ = ["mesh_heights", "mesh_shapes", "random_rotation"]

#: half of the longer side of what is seen, as a share of the picture
SMALLEST, LARGEST = 0.34, 0.47
#: rotations that are tried for a mesh that is thin to see, and the share of the picture that its
#: mask has to fill
TRIES, THINNEST = 16, 0.01


def mesh_shapes(
    files: Sequence[str | Path],
    count: int,
    size: int,
    generator: torch.Generator,
    fill: float | None = None,
) -> Shapes:
    """`count` height fields of meshes that are drawn from `files`, each turned at random.

    Args:
        files: anything that `load_scene` reads; of a scene all surfaces together. Only what is
            drawn is opened, each file once.
        count: how many, >= 1.
        size: pixels along an edge, >= 16.
        generator: the source of chance; the same state and files give the same shapes.
        fill: half of the longer side of what is seen, as a share of the picture, up to 0.5; None
            draws it.

    Returns:
        Heights, normals and masks, as of `random_shapes`; join them with `torch.cat` field by
        field. Rays are cast by Embree where it is installed, otherwise by `BruteForceRays`.

    Raises:
        OutOfRangeError: no files, a count below 1, a size below 16, or a fill outside 0..0.5.
        InputFileError, FileFormatError, EmptySceneError, ResourceLimitError: see `load_scene`.
        InvalidValueError, IndexRangeError: NaN, or faces that name no vertex.
        DegenerateGeometryError: a mesh without extent, or one too thin to be seen.

    >>> from tempfile import TemporaryDirectory
    >>> import trimesh
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "ball.ply"
    ...     _ = trimesh.creation.icosphere().export(path)
    ...     shapes = mesh_shapes([path], 2, 32, torch.Generator().manual_seed(0))
    >>> shapes.height.shape
    torch.Size([2, 32, 32])
    """
    if not files:
        raise OutOfRangeError("files", "none", "name at least one mesh")
    if count < 1:
        raise OutOfRangeError("count", str(count), "ask for at least one shape")
    if size < 16:
        raise OutOfRangeError("size", str(size), "use at least 16 pixels along an edge")
    if fill is not None and not 0 < fill <= 0.5:
        raise OutOfRangeError("fill", str(fill), "pass a share above 0 and up to 0.5")
    drawn = torch.randint(0, len(files), (count,), generator=generator).tolist()
    paths = {k: check_readable(files[k], "mesh") for k in sorted(set(drawn))}
    meshes = {k: _held(path, path.stat().st_mtime_ns) for k, path in paths.items()}
    made = [_seen(meshes[k], size, generator, fill, str(files[k])) for k in drawn]
    return Shapes(*(torch.cat(parts) for parts in zip(*made, strict=True)))


def random_rotation(generator: torch.Generator) -> Float[Tensor, "3 3"]:
    """A rotation matrix, even over all rotations, float64."""
    w, x, y, z = torch.nn.functional.normalize(
        torch.randn(4, generator=generator, dtype=torch.float64), dim=0
    ).tolist()
    return torch.tensor(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ],
        dtype=torch.float64,
    )


def mesh_heights(
    rays: AbstractRayCaster, rotation: Float[Tensor, "3 3"], size: int, fill: float
) -> tuple[Float[Tensor, "H W"], Bool[Tensor, "H W"]]:
    """Heights in pixels of turned triangles, seen orthographically along -z, and where they are.

    Args:
        rays: holds the triangles.
        rotation: R.
        size: pixels along an edge.
        fill: half of the longer side of what is seen, as a share of the picture.

    Returns:
        Heights, float64, 0 in the middle of the turned mesh and where nothing is, and whether
        something is.
    """
    turned = (rays.corners.reshape(-1, 3) - rays.centre) @ rotation.T
    low, high = turned.amin(0), turned.amax(0)
    scale = fill * size / float((high - low)[:2].max() / 2)
    x, y = (axis.to(turned) for axis in grid(size, size))
    above = (high - low)[2] / 2 * scale + 1
    start = torch.stack((x, y, above.expand_as(x)), -1).reshape(-1, 3)
    origin = rays.centre + (start / scale + (low + high) / 2) @ rotation
    down = (-rotation[2] / scale).expand_as(origin)
    hits = rays.closest(origin, down)
    height = torch.where(hits.found, above - hits.distance, 0).reshape(size, size)
    return height, hits.found.reshape(size, size)


@lru_cache(maxsize=8)
def _held(path: Path, changed: int) -> AbstractRayCaster:
    """The triangles of a file as it was when it was last `changed`."""
    return _rays(path)


def _rays(path: Path) -> AbstractRayCaster:
    """The triangles of a file."""
    surfaces = load_scene(path, dtype=torch.float64).surfaces
    faults = scene_faults(surfaces, (), ())
    require_none([f for f in faults if f.error in (InvalidValueError, IndexRangeError)])
    corners = torch.cat([face_corners(s.vertices, s.faces) for s in surfaces])
    extent = corners.reshape(-1, 3).amax(0) - corners.reshape(-1, 3).amin(0)
    if not bool((extent > 0).any()):
        raise DegenerateGeometryError(str(path), "a mesh without extent", "pass one with a size")
    try:
        return EmbreeRays(corners)
    except MissingDependencyError:
        return BruteForceRays(corners)


def _seen(
    rays: AbstractRayCaster, size: int, generator: torch.Generator, fill: float | None, name: str
) -> Shapes:
    """One shape; a sheet that is seen from its edge is turned again."""
    for _ in range(TRIES):
        rotation = random_rotation(generator)
        chance = float(uniform(generator, SMALLEST, LARGEST))
        height, inside = mesh_heights(rays, rotation, size, fill or chance)
        if not bool(inside.any()):
            continue
        height = torch.where(inside, height, height[inside].min()).float()
        shapes = finished(height[None], inside[None])
        if int(shapes.mask.sum()) > THINNEST * size * size:
            return shapes
    got = f"a mesh that is too thin to be seen on {size} x {size} pixels"
    raise DegenerateGeometryError(name, got, "pass a thicker one or more pixels")
