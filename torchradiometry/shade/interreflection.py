"""Interreflection on a depth map: what the parts of one visible surface send each other.

    L = rho / pi (E + E_r),    B = rho (E + E_r),
    E_r(x) = integral over the surface seen from x of  B/pi max(0, n . w) dw

E is the direct irradiance, E_r that of light reflected by the surface itself, bounce by bounce,
and optionally what comes after the last bounce as ambient light (`solve.ambient`). Radiosity B
is solved on a grid of cells. The pixel in the middle of each cell looks at the map in slices
through its ray to the eye (`transport.depth_maps.exchange`); what arrives there is irradiance
between the cells' centres too, linearly. With one cell a pixel nothing is between.

Only what the camera sees takes part. A convex surface, or albedo 0, gives exactly local shading.

References: D. Forsyth and A. Zisserman, "Reflections on Shading", PAMI 13 (1991); S. Nayar, K.
Ikeuchi and T. Kanade, "Shape from Interreflections", IJCV 6 (1991).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import torch
from torch import Tensor, nn

from torchradiometry.errors import ShapeError, require_whole
from torchradiometry.geometry.image_space import (
    HeightField,
    View,
    checked_size,
    height_field,
    image_normals,
    view_of,
)
from torchradiometry.numerics import guarded_divide, single
from torchradiometry.shade.lambertian import check_channels, diffuse_radiance
from torchradiometry.shade.layout import check_image
from torchradiometry.solve.ambient import ambient_tail
from torchradiometry.solve.neumann import neumann_series
from torchradiometry.solve.operators import AbstractOperator
from torchradiometry.transport.depth_maps.exchange import SliceExchange, slice_exchange
from torchradiometry.transport.depth_maps.horizons import sliced_pixels
from torchradiometry.transport.depth_maps.pooling import grid_over

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = ["InterreflectionShading", "reflected_irradiance"]


def reflected_irradiance(
    depth: Float[Tensor, "B 1 H W"],
    albedo: Float[Tensor, "B C H W"],
    irradiance: Float[Tensor, "B C H W"],
    intrinsics: Float[Tensor, "B 3 3"] | None = None,
    pixel_size: float | Tensor | None = None,
    normal: Float[Tensor, "B 3 H W"] | None = None,
    *,
    cells: tuple[int, int] = (16, 16),
    bounces: int = 1,
    tail: bool = False,
    azimuths: int = 8,
    fine: int = 4,
) -> Float[Tensor, "B C H W"]:
    """E_r, W/m2: what the surface sends to itself.

    Args:
        depth: m along the viewing axis; NaN or infinite where nothing is seen.
        albedo: 0..1.
        irradiance: E, direct, W/m2.
        intrinsics: `3 3` or `B 3 3` of a pinhole camera.
        pixel_size: side of a pixel of a parallel camera, m; one of the two.
        normal: unit; None: `depth_to_normals`.
        cells: rows and columns of the grid that radiosity is solved on.
        bounces: how often light is reflected, >= 1.
        tail: what comes after them as one number, calibrated.
        azimuths: slices through each cell.
        fine: how many heights are looked at on the way across a cell.

    Returns:
        0 on convex surfaces and without albedo, exactly; 0 where nothing is seen.

    Raises:
        DTypeError: maps that are not floating-point.
        ShapeError: wrong axes or sizes, or both or neither of `intrinsics` and `pixel_size`.

    Differentiable in: depth, albedo, irradiance, normal, the camera.
    Export: compile yes, ONNX yes; batch, height and width may stay dynamic.

    References: see the module.
    """
    maps = _cleaned(depth, albedo, irradiance, intrinsics, pixel_size, normal)
    return _reflected(*maps, cells, bounces, tail, azimuths, fine).to(depth.dtype)


def _cleaned(
    depth: Tensor,
    albedo: Tensor,
    irradiance: Tensor,
    intrinsics: Tensor | None,
    pixel_size: float | Tensor | None,
    normal: Tensor | None,
) -> tuple[HeightField, View, Tensor, Tensor, Tensor]:
    """The map, its normals, and albedo and irradiance that are 0 where nothing is seen."""
    view = view_of(depth, intrinsics, pixel_size)
    field = height_field(depth, view.perspective)
    seen = field.seen.unsqueeze(1)
    if normal is None:
        normal = image_normals(field, view)
    else:
        check_image("normal", normal, 3, depth)
        (normal,) = single(normal)
        normal = torch.where(seen, normal, 0)
    check_image("albedo", albedo, None, depth)
    check_image("irradiance", irradiance, None, depth)
    check_channels("albedo", albedo, irradiance)
    held = single(albedo, irradiance)
    albedo, irradiance = (torch.where(seen, image, 0) for image in held)
    return field, view, normal, albedo, irradiance


def _reflected(
    field: HeightField,
    view: View,
    normal: Tensor,
    albedo: Tensor,
    irradiance: Tensor,
    cells: tuple[int, int],
    bounces: int,
    tail: bool,
    azimuths: int,
    fine: int,
) -> Float[Tensor, "B C H W"]:
    """E_r of maps that are 0 where nothing is seen."""
    height = field.height
    grid = grid_over((height.shape[-2], height.shape[-1]), cells, height)
    probes = sliced_pixels(field, view, normal, azimuths, grid.middle)
    if not torch.compiler.is_compiling():  # no more than one height a pixel
        widest = max(-(-n // m) for n, m in zip(height.shape[-2:], cells, strict=True))
        fine = min(fine, widest)
    steps = torch.arange(1, 1 + fine * (max(cells) - 1), dtype=height.dtype, device=height.device)
    steps = (steps * (grid.spacing / fine)).round().clamp(min=1).reshape(-1, fine)
    own = torch.arange(cells[0] * cells[1], device=height.device)
    exchange = slice_exchange(probes, steps, grid.cell_of, own)
    seen = field.seen.unsqueeze(1)
    share = grid.means(seen.to(height.dtype))
    held, leaving = (
        _rows(guarded_divide(grid.means(image), share)) for image in (albedo, albedo * irradiance)
    )
    radiosity = _bounced(_Exchange(exchange), held, leaving, bounces, tail)
    arriving = exchange.irradiance(radiosity.permute(2, 1, 0)).permute(2, 0, 1)
    # probes that see nothing themselves leave their cells to their neighbours
    known = (probes.normal[0] > 0).to(height.dtype).mT.unsqueeze(1)
    near = grid.at_pixels(known.unflatten(-1, cells))
    received = grid.at_pixels((arriving * known).unflatten(-1, cells))
    return received * guarded_divide(seen.to(near.dtype), near)


def _rows(image: Float[Tensor, "B C row column"]) -> Float[Tensor, "B cell C"]:
    """Cells as patches of a solver."""
    return image.flatten(2).mT


def _bounced(
    operator: AbstractOperator, albedo: Tensor, leaving: Tensor, bounces: int, tail: bool
) -> Float[Tensor, "B cell C"]:
    """Radiosity whose next reflection is the last: after bounces - 1, and what a tail adds."""
    if bounces == 1 and not tail:
        return leaving
    radiosity, rest = neumann_series(
        operator, albedo, leaving, bounces - 1 if tail else bounces - 2
    )
    return radiosity + (ambient_tail(operator, albedo, rest)[0] if tail else rest)


@final
class _Exchange(AbstractOperator):
    """F of the cells, for the solver."""

    area = None

    def __init__(self, exchange: SliceExchange) -> None:
        self.between = exchange

    def exchange(self, x: Tensor) -> Tensor:
        raise ShapeError(
            "operator", "slices, which give F without areas", "solve by bounces (Neumann)"
        )

    def __call__(self, x: Float[Tensor, "B cell channel"]) -> Float[Tensor, "B cell channel"]:
        return self.between.irradiance(x.permute(2, 1, 0)).permute(2, 1, 0)

    @property
    def patches(self) -> int:
        return self.between.cell.shape[-1]

    @property
    def dtype(self) -> torch.dtype:
        return self.between.weight.dtype


@final
class InterreflectionShading(nn.Module):
    """Image layer: a diffuse surface in its direct light and in the light it sends to itself.

    Args:
        cells: rows and columns of the grid that radiosity is solved on, or one number for both.
        bounces: how often light is reflected, >= 1.
        tail: add what comes after them as calibrated ambient light.
        azimuths: slices through each cell, >= 4.
        fine: heights that are looked at on the way across a cell, >= 1.
        pixel_size: side of a pixel of a parallel camera, m; None for a pinhole, whose `intrinsics`
            are then passed to `forward`.

    Raises:
        OutOfRangeError: no cells, bounces, or too few azimuths.

    >>> layer = InterreflectionShading(cells=4, pixel_size=0.1)
    >>> flat, one = torch.ones(1, 1, 8, 8), torch.ones(1, 1, 8, 8)
    >>> bool((layer(flat, one, torch.pi * one) == 1).all())  # a plane sends nothing to itself
    True
    """

    def __init__(
        self,
        cells: int | tuple[int, int] = 16,
        bounces: int = 1,
        *,
        tail: bool = False,
        azimuths: int = 8,
        fine: int = 4,
        pixel_size: float | None = None,
    ) -> None:
        super().__init__()
        if isinstance(cells, tuple | list) and len(cells) != 2:
            raise ShapeError("cells", f"{cells!r}", "pass rows and columns, or one number for both")
        across, down = cells if isinstance(cells, tuple | list) else (cells, cells)
        least = {"bounces": (bounces, 1), "azimuths": (azimuths, 4), "fine": (fine, 1)}
        for name, (value, low) in least.items():
            require_whole(name, value, low)
        for size in (across, down):
            require_whole("cells", size, 2)
        self.cells = (across, down)
        self.bounces, self.tail, self.azimuths, self.fine = bounces, tail, azimuths, fine
        self.pixel_size = checked_size(pixel_size)

    def forward(
        self,
        depth: Float[Tensor, "B 1 H W"],
        albedo: Float[Tensor, "B C H W"],
        irradiance: Float[Tensor, "B C H W"],
        intrinsics: Float[Tensor, "B 3 3"] | None = None,
        normal: Float[Tensor, "B 3 H W"] | None = None,
    ) -> Float[Tensor, "B C H W"]:
        """Radiance `B C H W` in W/m2/sr; see `reflected_irradiance` for the arguments."""
        maps = _cleaned(depth, albedo, irradiance, intrinsics, self.pixel_size, normal)
        grid = (self.cells, self.bounces, self.tail, self.azimuths, self.fine)
        reflected, (albedo, irradiance) = _reflected(*maps, *grid), maps[-2:]
        return diffuse_radiance(albedo, irradiance + reflected).to(depth.dtype)

    def extra_repr(self) -> str:
        after = " + ambient tail" if self.tail else ""
        return (
            f"cells={self.cells}, bounces={self.bounces}{after}, azimuths={self.azimuths}, "
            f"pixel_size={self.pixel_size} [m] -> radiance [W/m2/sr]"
        )
