"""What every source answers: which light arrives at a point.

A source reports, for each of its lights and each surface point, the direction the light
comes from, the irradiance it would make on a plane that *faces* that direction, and the
distance. It knows neither visibility nor BRDF: the shader multiplies

    L = sum over lights of  f_r * E * max(0, n . wi) * V.

The light axis comes **first** in an `Arrival`, so that every per-point quantity (normals,
albedo, shininess) broadcasts against it as it stands.

An extended source (sphere, polygon, dome) reports the direction and length of its *vector
irradiance*, clipped to the part above the receiver's horizon; E * (n . wi) is then its exact
Lambertian irradiance.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor, nn

from torchradiometry.arguments import as_numbers
from torchradiometry.errors import (
    InvalidValueError,
    OutOfRangeError,
    ShapeError,
    require_axes,
    require_floating,
)
from torchradiometry.numerics import (
    clamped_cosine,
    narrow,
    single,
)

if TYPE_CHECKING:
    from jaxtyping import Float

__all__ = [
    "AbstractSource",
    "Arrival",
    "arrive",
    "arriving_irradiance",
    "check_batch",
    "irradiance",
    "light_first",
]


class Arrival(NamedTuple):
    """The light that arrives at points, one row per light.

    Attributes:
        direction: incident direction wi, unit, from the surface to the source.
        irradiance: W/m2 on a plane that faces `direction`.
        distance: m; infinite for a distant source.
    """

    direction: Float[Tensor, "light *batch point 3"]
    irradiance: Float[Tensor, "light *batch point channel"]
    distance: Float[Tensor, "light *batch point"]


class AbstractSource(nn.Module):
    """One or more lights of one kind. Subclasses are final.

    Parameters of a source have shape `*batch light k`: unbatched (`light k`) they serve every
    image of a batch; batched, each image has its own. `learnable=True` makes them
    `nn.Parameter`s, otherwise they are buffers; both move and save with the module.

    Attributes:
        has_direction: False for light from everywhere (domes), which has no highlight; only
            the diffuse part of a material answers to it.
        needs_position: True if `forward` needs points (near sources); distant ones take None.
        samples: rows of the `Arrival` for each light (extended sources may be sampled).
    """

    has_direction: bool = True
    needs_position: bool = True
    samples: int = 1
    _held_lights: int | None = None

    @abstractmethod
    def forward(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
    ) -> Arrival:
        """The light arriving at `position` (m) on surfaces of unit `normal`."""

    @property
    def lights(self) -> int:
        """Rows of the `Arrival`: the light axis of the first tensor held, times `samples`."""
        first = next(iter((self._parameters or self._buffers).values()))
        return 0 if first is None else first.shape[-2] * self.samples

    def irradiance_on(
        self,
        position: Float[Tensor, "*batch point 3"] | None,
        normal: Float[Tensor, "*batch point 3"],
        visibility: Float[Tensor, "light *batch point"] | None = None,
    ) -> Float[Tensor, "*batch point channel"]:
        """E on the surface itself, W/m2: all lights of this source summed.

        A source overrides it where the sum has a leaner form than an `Arrival` per light.
        """
        return irradiance(self(position, normal), normal, visibility)

    def _hold(
        self,
        name: str,
        value: object,
        learnable: bool,
        last: int | None = None,
        least: float | None = None,
        light_axis: int = -2,
    ) -> None:
        """Keep `value` as a parameter or buffer of shape `*batch light k`.

        A bare vector (`k`) becomes one light; a bare number one light with one channel. The
        parameter that is held first says how many lights there are; a later one for a single
        light serves all of them.
        """
        tensor = as_numbers(name, value)
        if tensor.ndim == 0:
            tensor = tensor.reshape(1)
        if tensor.ndim == 1:
            tensor = tensor.unsqueeze(0)
        if last is not None and tensor.shape[-1] != last:
            raise ShapeError(
                name,
                f"a tensor of shape {tuple(tensor.shape)}",
                f"its last axis holds {last} numbers; pass `light {last}` or `batch light {last}`",
            )
        if not torch.isfinite(tensor).all():
            raise InvalidValueError(name, "NaN or infinity", "pass finite numbers")
        if least is not None and bool((tensor < least).any()):
            raise OutOfRangeError(name, f"{float(tensor.min()):g}", f"pass values >= {least:g}")
        tensor = self._for_every_light(name, tensor, light_axis)
        if learnable:
            self.register_parameter(name, nn.Parameter(tensor.detach().clone()))
        else:
            self.register_buffer(name, tensor)

    def _for_every_light(self, name: str, tensor: Tensor, axis: int) -> Tensor:
        """The parameter with as many lights as the first one held."""
        found = tensor.shape[axis]
        if self._held_lights is None:
            self._held_lights = found
        elif found == 1:
            sizes = [-1] * tensor.ndim
            sizes[axis] = self._held_lights
            return tensor.expand(sizes)
        elif found != self._held_lights:
            raise ShapeError(
                name,
                f"{found} lights, where the parameters before hold {self._held_lights}",
                "pass one for each light, or one for all",
            )
        return tensor

    def _near(self, position: Tensor | None) -> Tensor:
        """`position`, or the named error where a near source was given none."""
        if position is None:
            raise ShapeError(
                "position", "None", f"pass `*batch point 3` in m; {type(self).__name__} is near"
            )
        require_axes("position", position, 3)
        return position


def light_first(parameter: Float[Tensor, "*batch light k"], like: Tensor) -> Tensor:
    """A source parameter as `light *batch 1 k`, ready to broadcast against `like`.

    Args:
        parameter: `*batch light k`; its batch axes match the leading axes of `like` or are
            absent.
        like: points or normals, `*batch point 3`.
    """
    moved = parameter.movedim(-2, 0)
    missing = like.ndim - 1 - (parameter.ndim - 1)
    if missing < 0:
        raise ShapeError(
            "source parameter",
            f"shape {tuple(parameter.shape)} against points of shape {tuple(like.shape)}",
            "a per-image source needs as many batch axes as the points have",
        )
    check_batch(parameter, like)
    shape = moved.shape[:1] + (1,) * missing + moved.shape[1:-1] + (1,) + moved.shape[-1:]
    return moved.reshape(shape)


def check_batch(parameter: Float[Tensor, "*batch light k"], like: Tensor) -> None:
    """Raise unless the batch axes of a parameter match those of the points.

    Raises:
        ShapeError: a source for each image, but not for as many images as there are.
        DTypeError: points that are not floating-point.
    """
    require_floating("position, normal", like)
    own = parameter.shape[:-2]
    wanted = like.shape[len(like.shape) - 2 - len(own) : -2]
    if any(a not in (1, b) for a, b in zip(own, wanted, strict=True)):
        raise ShapeError(
            "source parameter",
            f"batch {tuple(own)} against points of shape {tuple(like.shape)}",
            "a per-image source needs one entry for each image of the batch",
        )


def arrive(
    sources: AbstractSource | Sequence[AbstractSource],
    position: Float[Tensor, "*batch point 3"] | None,
    normal: Float[Tensor, "*batch point 3"],
) -> Arrival:
    """All lights of a mixed list of sources, stacked along the light axis.

    Channels broadcast: a source of one channel shines white on all.
    """
    _require_points(position, normal)
    members = [sources] if isinstance(sources, AbstractSource) else list(sources)
    if not members:
        raise ShapeError("sources", "an empty list", "pass at least one source")
    found = [member(position, normal) for member in members]
    channels = max(arrival.irradiance.shape[-1] for arrival in found)
    points = normal.shape[:-1]
    return Arrival(
        torch.cat([a.direction.expand(-1, *points, 3) for a in found]),
        torch.cat([a.irradiance.expand(-1, *points, channels) for a in found]),
        torch.cat([a.distance.expand(-1, *points) for a in found]),
    )


def _require_points(position: Tensor | None, normal: Tensor) -> None:
    """Raise unless they are points and normals."""
    require_axes("normal", normal, 3)
    if position is not None:
        require_axes("position", position, 3)


def irradiance(
    arrival: Arrival,
    normal: Float[Tensor, "*batch point 3"],
    visibility: Float[Tensor, "light *batch point"] | None = None,
) -> Float[Tensor, "*batch point channel"]:
    """E = sum over lights of E_facing max(0, n . wi) V, in W/m2 on the surface itself."""
    require_axes("normal", normal, 3)
    require_axes("arrival.direction", arrival.direction, 3)
    require_axes("arrival.irradiance", arrival.irradiance, None)
    dtype = torch.promote_types(normal.dtype, arrival.irradiance.dtype)
    normal, direction, facing = single(normal, arrival.direction, arrival.irradiance)
    cosine = clamped_cosine(normal, direction)
    if visibility is not None:
        cosine = cosine * visibility
    return narrow((cosine.unsqueeze(-1) * facing).sum(0), dtype)


def arriving_irradiance(
    sources: Sequence[AbstractSource],
    position: Float[Tensor, "*batch point 3"] | None,
    normal: Float[Tensor, "*batch point 3"],
    visibility: Float[Tensor, "light *batch point"] | None = None,
) -> Float[Tensor, "*batch point channel"]:
    """E on the surface from a mixed list of sources, source by source, in W/m2.

    The same number as `irradiance(arrive(...), ...)`, but no light is kept beside the others,
    so memory does not grow with the number of sources.

    Args:
        sources: at least one.
        position: m; None where every source is distant.
        normal: unit.
        visibility: 0..1, the lights of all sources in their order.

    Differentiable in: position, normal, visibility and every parameter of the sources.
    Export: compile yes, ONNX yes.
    """
    _require_points(position, normal)
    if not sources:
        raise ShapeError("sources", "an empty list", "pass at least one source")
    shares: Sequence[Tensor | None] = [None] * len(sources)
    if visibility is not None:
        require_axes("visibility", visibility, None, None)
        lights = [source.lights for source in sources]
        if sum(lights) != visibility.shape[0]:
            raise ShapeError(
                "visibility",
                f"{visibility.shape[0]} lights",
                f"the sources hold {sum(lights)} lights; pass one visibility for each",
            )
        shares = visibility.split(lights) if len(lights) > 1 else [visibility]
    total = sources[0].irradiance_on(position, normal, shares[0])
    for source, share in zip(sources[1:], shares[1:], strict=True):
        total = total + source.irradiance_on(position, normal, share)
    return total
