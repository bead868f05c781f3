"""Materials of a glTF file: albedo, emission, sides, and the albedo texture.

| glTF | here |
|---|---|
| `pbrMetallicRoughness.baseColorFactor` (linear) | `albedo`; its alpha is ignored |
| `baseColorTexture` (sRGB) | `texture`, linearised; wraps as its sampler says |
| `emissiveFactor` x `KHR_materials_emissive_strength` | `emission`, W/m2/sr |
| `emissiveTexture` (sRGB) | `emission` is multiplied by its area mean: the flux is kept |
| `doubleSided` | `two_sided` |
| `KHR_materials_pbrSpecularGlossiness` | in place of the base colour: |
| ... `diffuseFactor` x (1 - largest specular), `diffuseTexture` | `albedo`, `texture` |
| ... `specularFactor` | `specular` |
| ... `glossinessFactor` g | `shininess` = ((1 - g)^-4 - 1)/2, at most `SHINIEST` |

The lobe of that extension is a microfacet's of roughness a = (1 - g)^2, whose half vectors are
spread as cos^N with N = 2/a^2 - 2; Phong's mirrored direction takes N/4 to be as wide. Without
it every surface is diffuse. Metal, roughness, normal, occlusion and specular maps, alpha and
vertex colours are ignored.

References: Khronos, *glTF 2.0 Specification* (2021), 3.8, 3.9; KHR_materials_emissive_strength;
KHR_materials_pbrSpecularGlossiness; KHR_texture_transform; B. Walter et al., "Microfacet Models
for Refraction through Rough Surfaces", EGSR 2007 (N of a roughness).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from torchradiometry.errors import FileFormatError, ResourceLimitError
from torchradiometry.files import MAX_PIXELS, decode_picture, srgb_to_linear
from torchradiometry.scene.gltf_container import Container
from torchradiometry.scene.gltf_fields import Fields

__all__ = ["GLOSS", "Map", "Material", "Materials", "glossiness_of", "shininess_of"]

#: the extension that has a lobe, and the largest exponent read from it
GLOSS, SHINIEST = "KHR_materials_pbrSpecularGlossiness", 1e6

WRAPPING = {33071: "clamp", 33648: "mirror", 10497: "repeat"}


class Map(NamedTuple):
    """A texture as a material uses it.

    Attributes:
        image: `height width 3`, linear; one tensor for all that use it.
        coordinates: which `TEXCOORD_n` of the mesh.
        transform: `2 3`, applied to them (glTF's: v runs down).
        wrap: along u and v.
    """

    image: torch.Tensor
    coordinates: int
    transform: NDArray[np.float64]
    wrap: tuple[str, str]


class Material(NamedTuple):
    """What a surface is made of."""

    albedo: tuple[float, ...] = (1.0, 1.0, 1.0)
    emission: tuple[float, ...] = (0.0, 0.0, 0.0)
    two_sided: bool = False
    albedo_map: Map | None = None
    emission_map: Map | None = None
    specular: tuple[float, ...] = (0.0, 0.0, 0.0)
    shininess: float = 0.0


class Materials:
    """The materials of a file; each, and each picture, is read once and when it is needed."""

    def __init__(self, container: Container, dtype: torch.dtype) -> None:
        self._container, self._dtype = container, dtype
        self._materials = container.tree.records("materials")
        self._textures = container.tree.records("textures")
        self._images = container.tree.records("images")
        self._samplers = container.tree.records("samplers")
        self._read: dict[str, Material] = {}
        self._pictures: dict[str, torch.Tensor] = {}

    def of(self, primitive: Fields) -> Material:
        """The material of a mesh primitive; glTF's default (white, no emission) if it has none."""
        if "material" not in primitive:
            return Material()
        fields = primitive.index("material", self._materials)
        if fields.place not in self._read:
            self._read[fields.place] = self._material(fields)
        return self._read[fields.place]

    def _material(self, fields: Fields) -> Material:
        pbr = fields.record("pbrMetallicRoughness")
        strong = fields.extension("KHR_materials_emissive_strength")
        strength = strong.number("emissiveStrength", 1.0) if strong else 1.0
        factor = fields.numbers("emissiveFactor", 3, (0.0, 0.0, 0.0))
        shines = any(factor) and strength != 0
        gloss = fields.extension(GLOSS)
        albedo = pbr.numbers("baseColorFactor", 4, (1.0,) * 4)[:3]
        owner, paint, shininess = pbr, "baseColorTexture", 0.0
        specular: tuple[float, ...] = (0.0, 0.0, 0.0)
        if gloss is not None:
            specular = gloss.numbers("specularFactor", 3, (1.0,) * 3)
            rest = 1 - max(specular)
            albedo = tuple(rest * c for c in gloss.numbers("diffuseFactor", 4, (1.0,) * 4)[:3])
            shininess = shininess_of(gloss.number("glossinessFactor", 1.0))
            owner, paint = gloss, "diffuseTexture"
        return Material(
            specular=specular,
            shininess=shininess,
            albedo=albedo,
            emission=tuple(strength * value for value in factor),
            two_sided=fields.flag("doubleSided"),
            albedo_map=self._map(owner, paint),
            emission_map=self._map(fields, "emissiveTexture") if shines else None,
        )

    def _map(self, owner: Fields, key: str) -> Map | None:
        if key not in owner:
            return None
        info = owner.record(key)
        texture = info.index("index", self._textures)
        set_number, transform = _transform(info)
        image = texture.index("source", self._images)
        return Map(self._picture(image), set_number, transform, self._wrap(texture))

    def _wrap(self, texture: Fields) -> tuple[str, str]:
        if "sampler" not in texture:
            return ("repeat", "repeat")
        sampler = texture.index("sampler", self._samplers)
        codes = sampler.integer("wrapS", 10497), sampler.integer("wrapT", 10497)
        if not set(codes) <= set(WRAPPING):
            raise sampler.fault("wrapS, wrapT", f"{codes}", f"use {sorted(WRAPPING)}")
        return WRAPPING[codes[0]], WRAPPING[codes[1]]

    def _picture(self, image: Fields) -> torch.Tensor:
        """The linear picture of an image entry; all together have at most `MAX_PIXELS`."""
        if image.place not in self._pictures:
            if "uri" in image:
                data = self._container.resource(image, "uri")
            else:
                data = bytes(self._container.view(image))
            where = f"{image.file}, {image.place}"
            picture = torch.from_numpy(linear_picture(data, where))
            self._pictures[image.place] = picture.to(self._dtype)
            pixels = sum(each[..., 0].numel() for each in self._pictures.values())
            if pixels > MAX_PIXELS:
                mend = f"shrink the pictures to {MAX_PIXELS} together"
                raise ResourceLimitError(where, f"{pixels} pixels so far", mend)
        return self._pictures[image.place]


def shininess_of(glossiness: float) -> float:
    """n of Phong's lobe for a glossiness, 0..1.

    >>> shininess_of(0.0), shininess_of(0.5)
    (0.0, 7.5)
    """
    rough = max(1 - min(max(glossiness, 0.0), 1.0), (1 + 2 * SHINIEST) ** -0.25)
    return (rough**-4 - 1) / 2


def glossiness_of(shininess: float) -> float:
    """The inverse of `shininess_of`."""
    return 1 - (1 + 2 * shininess) ** -0.25


def linear_picture(data: bytes, where: str) -> NDArray[np.float32]:
    """An sRGB PNG or JPEG picture as linear `height width 3`.

    Raises:
        FileFormatError: no picture.
        ResourceLimitError: more pixels than are decoded.
    """
    encoded = decode_picture(data, where)
    if encoded.ndim == 2:
        encoded = np.repeat(encoded[..., None], 3, axis=2)
    if 0 in encoded.shape:
        raise FileFormatError(where, "a picture without pixels", "replace the picture")
    for row in encoded:  # in place: a large picture is not held three times over
        row[:] = srgb_to_linear(row)
    return encoded


def _transform(info: Fields) -> tuple[int, NDArray[np.float64]]:
    """Which set of coordinates, and the matrix of KHR_texture_transform."""
    chosen = info.integer("texCoord", 0)
    extra = info.extension("KHR_texture_transform")
    if extra is None:
        return chosen, np.eye(2, 3)
    u, v = extra.numbers("offset", 2, (0.0, 0.0))
    su, sv = extra.numbers("scale", 2, (1.0, 1.0))
    angle = extra.number("rotation", 0.0)
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.array([[c * su, s * sv, u], [-s * su, c * sv, v]])
    return extra.integer("texCoord", chosen), matrix
