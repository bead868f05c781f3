"""Laws that every material obeys: isotropy, reciprocity, energy."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor, nn

from tests.cases import MATERIALS, Case
from tests.invariants import draws
from tests.invariants.draws import Motion, invariant, same
from torchradiometry import materials
from torchradiometry.materials.lobes import AbstractLobe

MATERIAL = pytest.mark.parametrize("case", MATERIALS, ids=lambda case: case.name)
#: as docs/materials.md says: the paper's Phong is not reciprocal
NOT_RECIPROCAL = {materials.OriginalPhong}
#: nor is its reflectance bounded; that of a sum is not checked
NO_PROMISE = {materials.OriginalPhong, materials.SumMaterial}
SETS, PAIRS = 8, 20
#: largest values of the parameters, by name
MOST = {"albedo": 1.0, "specular": 1.0, "roughness": 1.0, "shininess": 60.0}
#: the small rule below, against the default one of `mirror_quadrature`
RULE = 1e-3


def drawn(case: Case, seed: int) -> nn.Module:
    """The material with `SETS` sets of parameters drawn by their names."""
    material, draw = case.build(torch.float64), draws.generator(seed)
    for part in material.modules():
        for name, tensor in list(part.named_buffers(recurse=False)):
            assert name in MOST, f"say in MOST how large `{name}` may be"
            shape = (SETS, tensor.shape[-1])
            low = 0.05 if name == "roughness" else 0.0
            part.register_buffer(name, draws.uniform(draw, *shape, low=low, high=MOST[name]))
        if isinstance(part, AbstractLobe):
            part.specular.div_(part.normal_reflectance().amax(-1, keepdim=True).clamp(min=1))
    if isinstance(material, materials.LambertianSpecular):
        total = material.albedo + material.lobe.normal_reflectance()
        for part in (material.albedo, material.lobe.specular):
            part.div_(total.amax(-1, keepdim=True).clamp(min=1))
    return material


def pairs(seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """Directions on both sides of the surface, half of the pairs near the mirror's."""
    draw = draws.generator(seed)
    up = torch.tensor([0.0, 0, 1], dtype=torch.float64)
    wi, other = draws.units(draw, PAIRS, 1), draws.units(draw, PAIRS, 1)
    near = wi * up.new_tensor([-1, -1, 1]) + 0.1 * other
    near = near / near.norm(dim=-1, keepdim=True)
    half = (torch.arange(PAIRS) < PAIRS // 2).reshape(-1, 1, 1)
    return wi, torch.where(half, other, near), up.expand(PAIRS, 1, 3)


@MATERIAL
@given(seed=draws.seeds)
@invariant(PAIRS)
def test_isotropic_reciprocal_and_never_negative(case: Case, seed: int) -> None:
    material, motion = drawn(case, seed), Motion(seed)
    wi, wo, normal = pairs(seed)
    value = draws.repeats(lambda: material(wi, wo, normal))
    assert (value >= 0).all()
    below = (wi[..., 2:] <= 0) | (wo[..., 2:] <= 0)
    assert (value[below.expand_as(value)] == 0).all()
    turned = material(*(motion.turn(v) for v in (wi, wo, normal)))
    # near the horizon a BRDF may be steep: what is compared is the light, with its cosine
    cosine = wi[..., 2:].clamp(min=0) * wo[..., 2:].clamp(min=0)
    same(turned * cosine, value * cosine, 1e-11)
    if case.member not in NOT_RECIPROCAL:
        same(material(wo, wi, normal) * cosine, value * cosine, 1e-11)


@MATERIAL
@given(seed=draws.seeds, angle=st.floats(0, math.radians(85)))
@invariant(SETS)
def test_no_more_light_leaves_than_arrives(case: Case, seed: int, angle: float) -> None:
    rule = materials.mirror_quadrature(angle, 8, 16)
    material = drawn(case, seed)
    share = materials.directional_hemispherical_reflectance(material, angle, rule)
    assert torch.isfinite(share).all()
    assert (share >= 0).all()
    if case.member not in NO_PROMISE:
        assert (share <= 1 + RULE).all()
