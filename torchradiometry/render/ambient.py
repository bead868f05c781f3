"""Ambient light: reflected light as if it arrived everywhere alike, calibrated and not guessed.

    B_mean = mean(rho E_direct) / (1 - mean(rho h))         E_ambient = mean(h) B_mean

The means run over surface points; h is the cosine-weighted share of a point's hemisphere in which
it sees fronts of surfaces. That is the balance of light between surfaces that all receive
the mean radiosity from where they see each other: exact in a closed room of one albedo under even
light, an estimate elsewhere.

References: M. Cohen, S. Chen, J. Wallace and D. Greenberg, SIGGRAPH 1988, section 5 (overall
interreflection factor).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor

from torchradiometry.errors import SingularSystemError
from torchradiometry.numerics import guarded_divide
from torchradiometry.render.direct import cosine_directions, emitter_weights, lamp_irradiance
from torchradiometry.render.points import Receivers, look
from torchradiometry.render.settings import RenderSettings
from torchradiometry.render.world import World
from torchradiometry.scene.scene import Triangles
from torchradiometry.transport.rules import sample_patches, sequence

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = [
    "AmbientExchange",
    "SurfaceSample",
    "ambient_exchange",
    "ambient_irradiance",
    "balanced_irradiance",
    "on_surfaces",
]

#: points on the surfaces and rays from each
POINTS, RAYS = 512, 16


class SurfaceSample(NamedTuple):
    """Points spread evenly over the free sides of all surfaces.

    Attributes:
        receivers: the points.
        triangle: which one a point lies on.
        face: which one-sided face of it.
        view: h, 0..1.
        weight: 1; 0 for points inside of bodies.
    """

    receivers: Receivers
    triangle: Int[Tensor, "point"]
    face: Int[Tensor, "point"]
    view: Float[Tensor, "point"]
    weight: Float[Tensor, "point"]

    @property
    def mutual_view(self) -> float:
        """Mean of h."""
        return float(guarded_divide((self.view * self.weight).sum(), self.weight.sum()))


class AmbientExchange(NamedTuple):
    """What ambient light takes from geometry, whatever surfaces reflect and emit.

    Attributes:
        sample: points on the surfaces.
        weights, lamps: W of the emitters and E by lamps there, see `direct`.
    """

    sample: SurfaceSample
    weights: Float[Tensor, "point emitter"]
    lamps: Float[Tensor, "point channel"]


@torch.no_grad()
def on_surfaces(world: World, points: int = POINTS, seed: int = 0) -> SurfaceSample:
    """Points of all reflecting sides, by area, and what share of their hemisphere is surfaces."""
    generator = torch.Generator().manual_seed(seed)
    corners = world.faces.corners
    a, b, c = corners.unbind(1)
    cross = torch.linalg.cross(b - a, c - a)
    reached = cross.norm(dim=-1).cumsum(0)
    where = (sequence(points, 3, corners) + torch.rand(3, generator=generator).to(corners)).frac()
    face = torch.searchsorted(reached, (where[:, 0] * reached[-1]).contiguous())
    face = face.clamp(max=len(corners) - 1)
    normal = torch.nn.functional.normalize(cross, dim=-1)[face]
    position = sample_patches(corners[face], where[:, 1:])
    turn = torch.rand(points, 1, 2, generator=generator, dtype=torch.float64).to(corners)
    direction = cosine_directions((sequence(RAYS, 2, corners) + turn).frac(), normal)
    front, back = look(world, world.rays.lift(position, normal).unsqueeze(1), direction)
    buried = back.all(-1)
    sample = Receivers(position, normal, normal)
    view = front.to(corners).mean(-1)
    return SurfaceSample(sample, world.faces.triangle[face], face, view, (~buried).to(corners))


def ambient_exchange(world: World, settings: RenderSettings) -> AmbientExchange:
    """Direct light on points of the surfaces."""
    sample = on_surfaces(world, seed=settings.seed)
    generator = torch.Generator().manual_seed(settings.seed)
    weights = emitter_weights(world, settings, sample.receivers, generator)
    return AmbientExchange(
        sample, weights, lamp_irradiance(world, settings, sample.receivers, generator)
    )


def ambient_irradiance(
    world: World, exchange: AmbientExchange, triangles: Triangles
) -> Float[Tensor, "channel"]:
    """E_ambient, W/m2.

    Raises:
        SingularSystemError: nothing absorbs and nothing escapes.

    Differentiable in: albedo and emission of the triangles.
    """
    sample = exchange.sample
    albedo = triangles.reflectance[sample.triangle].to(torch.float64)
    direct = exchange.lamps + exchange.weights @ world.glow(triangles)
    return balanced_irradiance(albedo, direct, sample.view, sample.weight)


def balanced_irradiance(
    albedo: Float[Tensor, "point channel"],
    direct: Float[Tensor, "point channel"],
    view: Float[Tensor, "point"],
    weight: Float[Tensor, "point"],
) -> Float[Tensor, "channel"]:
    """E_ambient of points, W/m2.

    Args:
        albedo: 0..1.
        direct: irradiance, W/m2.
        view: h, 0..1.
        weight: of each point.

    Raises:
        SingularSystemError: as of `ambient_irradiance`.
    """
    weight = guarded_divide(weight, weight.sum()).unsqueeze(-1)
    kept = 1 - (weight * albedo * view.unsqueeze(-1)).sum(0)
    if not torch.compiler.is_compiling() and bool((kept <= torch.finfo(kept.dtype).eps).any()):
        raise SingularSystemError(
            "ambient", "surfaces that lose no light", "use albedos below 1 or open the scene"
        )
    return (weight.squeeze(-1) * view).sum() * (weight * albedo * direct).sum(0) / kept
