"""One piece of a scene: a triangle mesh with what it reflects and emits.

    rho(u, v) = albedo * texture(u, v)        L_emitted = emission, W/m2/sr
    f_r = rho/pi + specular (n+2)/(2 pi) cos^n(alpha)        n = shininess (`NormalizedPhong`)

A surface shines and reflects on the side from which its faces run counter-clockwise. With
`two_sided` it does so on both sides; otherwise its back is black and still blocks light.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from torchradiometry.arguments import as_numbers
from torchradiometry.errors import DTypeError, OutOfRangeError, ShapeError

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["WRAPS", "Surface", "Texture", "colours"]

WRAPS = ("repeat", "mirror", "clamp")


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture of the albedo, stretched over a surface.

    Args:
        image: `height width channel`, **linear** reflectance factors 0..1; row 0 on top.
        coordinates: `vertex 2`, where each vertex lies in the picture: (0, 0) is the lower left
            corner, (1, 1) the upper right.
        wrap: what lies beyond the picture, along u and along v: `repeat`, `mirror` or `clamp`.
    """

    image: Float[Tensor, "height width channel"]
    coordinates: Float[Tensor, "vertex 2"]
    wrap: tuple[str, str] = ("repeat", "repeat")

    def __post_init__(self) -> None:
        require_shape("texture.image", self.image, ("height", "width", "channel"))
        require_shape("texture.coordinates", self.coordinates, ("vertex", 2))
        if 0 in self.image.shape:
            raise ShapeError(
                "texture.image", f"shape {tuple(self.image.shape)}", "pass at least one texel"
            )
        for name in self.wrap:
            if name not in WRAPS:
                raise OutOfRangeError("texture.wrap", repr(name), f"use one of {WRAPS}")

    def to(self, dtype: torch.dtype | None = None, device: object = None) -> Texture:
        """The same texture in another dtype or on another device."""
        image, coordinates = (moved(t, dtype, device) for t in (self.image, self.coordinates))
        return replace(self, image=image, coordinates=coordinates)


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh in world space and its material.

    Args:
        name: how errors and reports call it.
        vertices: `vertex 3`, world, m.
        faces: `face 3`, int64, counter-clockwise seen from the front.
        albedo: `channel`, diffuse reflectance 0..1; multiplies the texture.
        emission: `channel`, emitted radiance, W/m2/sr, >= 0.
        normals: `vertex 3`, unit shading normals; None shades each face flat.
        two_sided: the back reflects and emits too.
        texture: varies the albedo over the surface.
        specular: `channel`, k_s of the lobe, 0..1: the share that it reflects at normal
            incidence; None: no lobe.
        shininess: scalar tensor, n >= 0 of the lobe; None: 0.

    Raises:
        ShapeError, DTypeError: a tensor of the wrong shape or kind. Values are checked by
            `Scene.validate`.

    >>> corner = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> leaf = Surface("leaf", corner, torch.tensor([[0, 1, 2]]), torch.tensor([0.5]))
    >>> leaf.count, leaf.channels
    (1, 1)
    """

    name: str
    vertices: Float[Tensor, "vertex 3"]
    faces: Int[Tensor, "face 3"]
    albedo: Float[Tensor, "channel"]
    emission: Float[Tensor, "channel"] = None  # type: ignore[assignment]
    normals: Float[Tensor, "vertex 3"] | None = None
    two_sided: bool = False
    texture: Texture | None = None
    specular: Float[Tensor, "channel"] = None  # type: ignore[assignment]
    shininess: Float[Tensor, ""] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        require_shape(f"{self.name}.vertices", self.vertices, ("vertex", 3))
        require_shape(f"{self.name}.albedo", self.albedo, ("channel",))
        if self.emission is None:
            object.__setattr__(self, "emission", torch.zeros_like(self.albedo))
        require_shape(f"{self.name}.emission", self.emission, ("channel",))
        if self.specular is None:
            object.__setattr__(self, "specular", torch.zeros_like(self.albedo))
        if self.shininess is None:
            object.__setattr__(self, "shininess", self.albedo.new_zeros(()))
        require_shape(f"{self.name}.specular", self.specular, ("channel",))
        require_shape(f"{self.name}.shininess", self.shininess, ())
        if self.faces.ndim != 2 or self.faces.shape[-1] != 3:
            got = f"a tensor of shape {tuple(self.faces.shape)}"
            raise ShapeError(f"{self.name}.faces", got, "pass `face 3`")
        if self.faces.dtype != torch.int64:
            raise DTypeError(f"{self.name}.faces", f"{self.faces.dtype}", "pass int64 indices")
        self._require_fitting()

    def _require_fitting(self) -> None:
        """Per-vertex tensors have as many rows as vertices; channel counts agree."""
        rows = {"normals": self.normals}
        if self.texture is not None:
            rows["texture.coordinates"] = self.texture.coordinates
        for what, tensor in rows.items():
            if tensor is not None and tensor.shape[0] != self.vertices.shape[0]:
                got = f"{tensor.shape[0]} rows for {self.vertices.shape[0]} vertices"
                raise ShapeError(f"{self.name}.{what}", got, "pass one row per vertex")
        if self.normals is not None:
            require_shape(f"{self.name}.normals", self.normals, ("vertex", 3))
        counts = {c.shape[-1] for c in (self.albedo, self.emission, self.specular)}
        if self.texture is not None:
            counts.add(self.texture.image.shape[-1])
        if len(counts - {1}) > 1:
            got = f"channel counts {sorted(counts)}"
            where = f"{self.name}: albedo, emission, specular, texture"
            raise ShapeError(where, got, "use one, or 1")

    @property
    def count(self) -> int:
        """Number of triangles."""
        return self.faces.shape[0]

    @property
    def channels(self) -> int:
        """Number of colour channels."""
        texture = 1 if self.texture is None else self.texture.image.shape[-1]
        colours = (self.albedo, self.emission, self.specular)
        return max(texture, *(colour.shape[-1] for colour in colours))

    @property
    def glossy(self) -> bool:
        """Whether it has a lobe."""
        return bool((self.specular.detach() > 0).any())

    def shiny(self, specular: object, shininess: object) -> Surface:
        """The same surface with a lobe.

        Args:
            specular: k_s, 0..1, a number or channels.
            shininess: n, >= 0.
        """
        like = self.albedo
        share = as_numbers("specular", specular, like.dtype).to(like.device)
        share = share.expand_as(like) if share.ndim == 0 else share
        power = as_numbers("shininess", shininess, like.dtype).to(like.device)
        return replace(self, specular=share, shininess=power)

    def to(self, dtype: torch.dtype | None = None, device: object = None) -> Surface:
        """The same surface in another dtype or on another device (indices stay int64)."""
        return replace(
            self,
            vertices=moved(self.vertices, dtype, device),
            faces=moved(self.faces, None, device),
            albedo=moved(self.albedo, dtype, device),
            emission=moved(self.emission, dtype, device),
            specular=moved(self.specular, dtype, device),
            shininess=moved(self.shininess, dtype, device),
            normals=None if self.normals is None else moved(self.normals, dtype, device),
            texture=None if self.texture is None else self.texture.to(dtype, device),
        )


def colours(*values: object, dtype: torch.dtype | None = None) -> list[Tensor]:
    """Colours that go together: a bare number has the channels of the others, or three.

    >>> colours(0.5, [0.1, 0.2]), colours(1.0)
    ([tensor([0.5000, 0.5000]), tensor([0.1000, 0.2000])], [tensor([1., 1., 1.])])
    """
    tensors = [as_numbers("colour", v, dtype) for v in values]
    channels = max((t.shape[-1] for t in tensors if t.ndim), default=3)
    return [t if t.ndim else t.expand(channels).clone() for t in tensors]


def moved(tensor: Tensor, dtype: torch.dtype | None, device: object) -> Tensor:
    """`tensor.to` that leaves alone what is None."""
    return tensor.to(dtype=dtype or tensor.dtype, device=device or tensor.device)  # type: ignore[call-overload]


def require_shape(where: str, tensor: Tensor, axes: tuple[str | int, ...]) -> None:
    """Raise `DTypeError` or `ShapeError` unless `tensor` is floating with these axes."""
    wanted = " ".join(str(axis) for axis in axes)
    if not isinstance(tensor, Tensor) or not tensor.is_floating_point():
        got = f"{tensor.dtype}" if isinstance(tensor, Tensor) else f"a {type(tensor).__name__}"
        raise DTypeError(where, got, f"pass a floating-point tensor `{wanted}`")
    sizes = zip(tensor.shape, axes, strict=False)
    fits = tensor.ndim == len(axes) and all(isinstance(a, str) or n == a for n, a in sizes)
    if not fits:
        raise ShapeError(where, f"a tensor of shape {tuple(tensor.shape)}", f"pass `{wanted}`")
