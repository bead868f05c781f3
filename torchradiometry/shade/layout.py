"""The boundary between images (`B C H W`) and surface points (`batch point channel`).

    point = row * width + column

An image layer permutes once on the way in and once on the way out; both are views, no pixel
is copied. The checks here are static (rank, channels, size). What the *values* hold is the
business of `validate_layer_inputs`, which a caller runs once on new data and no layer runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from torchradiometry.errors import (
    DTypeError,
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
    require_kind,
)
from torchradiometry.sources.base import AbstractSource

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = [
    "check_image",
    "check_sources",
    "chosen_sources",
    "to_image",
    "to_points",
    "validate_layer_inputs",
    "visibility_to_points",
]

#: how far from 1 the length of a normal may be: an 8-bit normal map rounds each component
#: by 1/255 of its range -1..1, which changes the length by at most sqrt(3)/255
UNIT_TOLERANCE = 3**0.5 / 255
#: a linear albedo or visibility is at most 1; from here on it is a scale mistake
SCALE_MISTAKE = 2.0


def to_points(image: Float[Tensor, "B C H W"]) -> Float[Tensor, "B point C"]:
    """An image as surface points, row by row; a view.

    >>> to_points(torch.zeros(2, 3, 4, 5)).shape
    torch.Size([2, 20, 3])
    """
    _require_rank("image", image, 4, "B C H W")
    return image.permute(0, 2, 3, 1).flatten(1, 2)


def to_image(
    points: Float[Tensor, "B point C"], like: Float[Tensor, "B _ H W"]
) -> Float[Tensor, "B C H W"]:
    """Points back as an image of the height and width of `like`; the inverse of `to_points`."""
    _require_rank("points", points, 3, "B point C")
    _require_rank("like", like, 4, "B C H W")
    if points.shape[1] != like.shape[2] * like.shape[3]:
        got = f"{points.shape[1]} for images of {like.shape[2]} x {like.shape[3]} pixels"
        raise ShapeError("points", got, "pass one point for each pixel")
    return points.mT.unflatten(2, like.shape[-2:])


def _require_rank(where: str, tensor: Tensor, rank: int, axes: str) -> None:
    """For numbers of any kind."""
    require_kind(where, tensor, Tensor)
    if tensor.ndim != rank:
        raise ShapeError(where, f"a tensor of shape {tuple(tensor.shape)}", f"pass `{axes}`")


def visibility_to_points(
    visibility: Float[Tensor, "B light H W"] | None,
) -> Float[Tensor, "light B point"] | None:
    """Visibility maps with the light axis first, as sources report their light."""
    return None if visibility is None else visibility.flatten(2).transpose(0, 1)


def check_image(
    where: str,
    image: Float[Tensor, "B C H W"],
    channels: int | None = None,
    like: Float[Tensor, "B _ H W"] | None = None,
    one_or: int | None = None,
) -> None:
    """Raise unless `image` is `B x C x H x W`.

    Args:
        where: the name of the argument, for the message.
        image: what was passed.
        channels: the number of channels it must have; None takes any.
        like: an image whose batch (or 1), height, width, dtype and device it must share.
        one_or: it must have one channel or this many.

    Raises:
        DTypeError: not a tensor of real floating-point numbers, or not those of `like`.
        ShapeError: another rank, channel count or size.
    """
    if not isinstance(image, Tensor):
        raise DTypeError(where, f"a {type(image).__name__}", "pass a tensor B x C x H x W")
    if not image.is_floating_point():
        raise DTypeError(where, f"a tensor of {image.dtype}", "pass linear floating-point numbers")
    got = f"a tensor of shape {tuple(image.shape)}"
    if image.ndim != 4:
        raise ShapeError(where, got, f"pass B x {channels or 'C'} x H x W")
    if channels is not None and image.shape[1] != channels:
        last = image.shape[-1] == channels
        hint = f"permute it to B x {channels} x H x W" if last else f"pass {channels} channels"
        raise ShapeError(where, got, hint)
    if one_or is not None and image.shape[1] not in (1, one_or):
        raise ShapeError(where, got, f"pass 1 or {one_or} channels")
    if like is not None:
        _check_same_size(where, image, like)


def _check_same_size(where: str, image: Tensor, like: Tensor) -> None:
    if (image.dtype, image.device) != (like.dtype, like.device):
        raise DTypeError(
            where,
            f"{image.dtype} on {image.device} beside maps of {like.dtype} on {like.device}",
            "bring all maps to one dtype and device",
        )
    if image.shape[2:] != like.shape[2:] or image.shape[0] not in (1, like.shape[0]):
        batch, _, height, width = like.shape
        raise ShapeError(
            where,
            f"a tensor of shape {tuple(image.shape)}",
            f"pass batch {batch} (or 1), height {height} and width {width}, as other maps",
        )


def check_sources(
    sources: Sequence[AbstractSource],
    normal: Float[Tensor, "B 3 H W"],
    position: Float[Tensor, "B 3 H W"] | None,
) -> None:
    """Raise unless the sources share dtype and device with the normals and know where they are.

    Raises:
        DTypeError: parameters of another dtype or on another device than the normals.
        ShapeError: no positions for a near source.
    """
    for source in sources:
        _check_same_kind(source, normal)
    near = [type(source).__name__ for source in sources if source.needs_position]
    if position is not None:
        check_image("position", position, 3, normal)
    elif near:
        raise ShapeError(
            "position", "None", f"{near[0]} is a near source; pass position B x 3 x H x W in m"
        )


def _check_same_kind(source: AbstractSource, normal: Tensor) -> None:
    for held in (*source.parameters(), *source.buffers()):
        if held.is_floating_point() and (held.dtype, held.device) != (normal.dtype, normal.device):
            raise DTypeError(
                type(source).__name__,
                f"{held.dtype} on {held.device} under normals of {normal.dtype} on {normal.device}",
                "move one of them: source.to(normal) moves the source",
            )


def chosen_sources(
    held: Iterable[nn.Module], passed: AbstractSource | Sequence[AbstractSource] | None
) -> Sequence[AbstractSource]:
    """The sources of the constructor or those of the call: exactly one of the two.

    Raises:
        DTypeError: both, neither, or something that is not a source.
    """
    if isinstance(passed, AbstractSource):
        passed = [passed]
    own = list(held)
    if not own and not passed:
        raise DTypeError("sources", "none", "pass them to the constructor or to the call")
    if own and passed is not None:
        raise DTypeError(
            "sources", "some in the constructor and some in the call", "pass them in one place"
        )
    found: list[AbstractSource] = []
    for source in own or passed or ():
        if not isinstance(source, AbstractSource):
            raise DTypeError("sources", f"a {type(source).__name__}", "pass sources only")
        found.append(source)
    return found


def validate_layer_inputs(
    normal: Float[Tensor, "B 3 H W"] | None = None,
    albedo: Float[Tensor, "B C H W"] | None = None,
    *,
    visibility: Float[Tensor, "B light H W"] | None = None,
    position: Float[Tensor, "B 3 H W"] | None = None,
    specular: Float[Tensor, "B C H W"] | None = None,
    shininess: Float[Tensor, "B 1 H W"] | None = None,
) -> None:
    """Raise if the *values* of a layer's inputs are not what they claim to be.

    Run it once on new data; no layer does, because it must read every pixel and branch on
    what it finds, which a compiled or exported graph cannot.

    Args:
        normal: unit within 8-bit rounding; all-zero normals (background) are allowed.
        albedo: 0..1, linear.
        visibility: 0..1.
        position: finite, m.
        specular: 0..1.
        shininess: >= 0.

    Raises:
        InvalidValueError: NaN or infinite numbers.
        OutOfRangeError: normals that are not unit or mostly point away from the camera;
            shares below 0 or above 1.

    >>> validate_layer_inputs(albedo=torch.full((1, 3, 2, 2), 200.0))
    Traceback (most recent call last):
        ...
    torchradiometry.errors.OutOfRangeError: albedo: got a maximum of 200, which looks like \
0..255 or another scale; pass linear values in 0..1 (files.srgb_to_linear for sRGB pictures).
    """
    shares = {"albedo": albedo, "visibility": visibility, "specular": specular}
    others = {"normal": normal, "position": position, "shininess": shininess}
    for where, image in {**shares, **others}.items():
        if image is not None and not torch.isfinite(image).all():
            bad = int((~torch.isfinite(image)).sum())
            raise InvalidValueError(where, f"{bad} NaN or infinite values", "pass finite numbers")
    for where, image in shares.items():
        if image is not None and image.numel():
            _check_share(where, float(image.min()), float(image.max()))
    if normal is not None:
        _check_unit(normal)
    if shininess is not None and bool((shininess < 0).any()):
        raise OutOfRangeError("shininess", f"{float(shininess.min()):g}", "pass exponents >= 0")


def _check_share(where: str, low: float, high: float) -> None:
    if low < 0:
        raise OutOfRangeError(where, f"a minimum of {low:g}", "pass values in 0..1")
    if high > SCALE_MISTAKE:
        raise OutOfRangeError(
            where,
            f"a maximum of {high:g}, which looks like 0..255 or another scale",
            "pass linear values in 0..1 (files.srgb_to_linear for sRGB pictures)",
        )
    if high > 1 + 1e-5:  # float32 rounding of a share computed by a few operations
        raise OutOfRangeError(where, f"a maximum of {high:g}", "pass values in 0..1")


def _check_unit(normal: Tensor) -> None:
    length = normal.norm(dim=1)
    wrong = ((length - 1).abs() > UNIT_TOLERANCE) & (length != 0)
    if bool(wrong.any()):
        raise OutOfRangeError(
            "normal",
            f"{int(wrong.sum())} that are not unit (a length of {float(length[wrong][0]):g})",
            "divide each by its length; leave background normals zero",
        )
    away = int((normal[:, 2] < 0).sum())
    if away > int((normal[:, 2] > 0).sum()):
        raise OutOfRangeError(
            "normal",
            f"{away} that point away from the camera (negative z)",
            "flip them: x is right, y up, z to the camera",
        )
