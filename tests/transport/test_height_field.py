"""Height-field shadows against closed forms."""

import math

import pytest
import torch

from torchradiometry.errors import ShapeError
from torchradiometry.transport.height_field import height_field_hits, height_field_visibility


def grid(size: int) -> tuple[torch.Tensor, torch.Tensor]:
    axis = torch.arange(size) - (size - 1) / 2
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    return x, y


def unit(*direction: float) -> torch.Tensor:
    vector = torch.tensor(direction)
    return vector / vector.norm()


@pytest.mark.parametrize("direction", [(0.5, 0.3, 0.8), (0.8, 0.0, 0.6), (-0.3, -0.7, 0.6)])
def test_shadow_of_a_half_ball_on_a_plane(direction: tuple[float, float, float]) -> None:
    """A point of the plane is dark where its ray to the light meets the ball."""
    radius, light = 30.0, unit(*direction)
    x, y = grid(129)
    height = torch.sqrt((radius**2 - x * x - y * y).clamp(min=0))
    seen = height_field_visibility(height.unsqueeze(0), light.unsqueeze(0))[0, 0]
    point = torch.stack([x, y, height], -1)
    towards = point @ light
    discriminant = towards**2 - (point * point).sum(-1) + radius**2
    dark = (discriminant > 0) & (-towards + discriminant.clamp(min=0).sqrt() > 0)
    # the outline of the shadow is right to a pixel: leave out the band where it flips
    edge = (
        torch.nn.functional.max_pool2d((dark.float())[None], 5, 1, 2)[0]
        != -(torch.nn.functional.max_pool2d(-dark.float()[None], 5, 1, 2)[0])
    )
    plane = (x * x + y * y > (radius + 1) ** 2) & ~edge
    assert dark[plane].any()
    torch.testing.assert_close(seen[plane], (~dark[plane]).float(), rtol=0, atol=0)


@pytest.mark.parametrize("azimuth", range(0, 360, 45))
def test_length_of_the_shadow_of_a_wall(azimuth: int) -> None:
    """A wall of height h under a light of elevation e casts a shadow of length h / tan(e)."""
    x, y = grid(81)
    angle = math.radians(azimuth)
    along = x * math.cos(angle) + y * math.sin(angle)
    height = torch.where((along > 0) & (along < 3), 10.0, 0.0)
    light = unit(math.cos(angle), math.sin(angle), 1.0)
    seen = height_field_visibility(height.unsqueeze(0), light.unsqueeze(0))[0, 0]
    middle = x * x + y * y < 28**2  # shadows of the ends of the wall stay outside
    lit = middle & ((along < -11) | (along > 5))
    dark = middle & (along > -8) & (along < -2)
    assert (seen[lit] == 1).all()
    assert (seen[dark] == 0).all()


@pytest.mark.parametrize("direction", [(0.3, 0.2, 0.9), (-0.9, 0.1, 0.2), (0.0, 0.0, 1.0)])
def test_a_plane_and_a_dome_cast_no_shadow(direction: tuple[float, float, float]) -> None:
    light = unit(*direction)
    x, y = grid(48)
    plane = -(light[0] * x + light[1] * y) / 4 + 0.3 * x
    facing = torch.tensor([0.3 - light[0] / 4, -light[1] / 4])
    seen = height_field_visibility(plane.unsqueeze(0), light.unsqueeze(0))
    if light[2] > (facing * light[:2]).sum():
        assert (seen == 1).all()
    dome = torch.sqrt((40.0**2 - x * x - y * y).clamp(min=0))
    normal = torch.stack([x, y, dome], -1) / 40
    lit = (normal @ light) > 0.05
    assert (height_field_visibility(dome.unsqueeze(0), light.unsqueeze(0))[0, 0][lit] == 1).all()


def test_lights_below_the_horizon_are_not_seen() -> None:
    flat = torch.zeros(1, 4, 5)
    light = torch.stack([unit(0.3, 0.1, -0.2), unit(1.0, 0.0, 0.0), unit(0.0, 0.0, 1.0)])
    seen = height_field_visibility(flat, light)
    assert (seen[:2] == 0).all()
    assert (seen[2] == 1).all()


def test_lights_per_image_agree_with_one_image_at_a_time(generator: torch.Generator) -> None:
    height = 4 * torch.rand(3, 12, 17, generator=generator)
    light = torch.randn(3, 5, 3, generator=generator)
    light[..., 2] = light[..., 2].abs() + 0.3
    light = light / light.norm(dim=-1, keepdim=True)
    together = height_field_visibility(height, light)
    assert together.shape == (5, 3, 12, 17)
    for k in range(3):
        alone = height_field_visibility(height[k : k + 1], light[k])
        assert torch.equal(together[:, k : k + 1], alone)


def test_pixel_size_is_a_unit(generator: torch.Generator) -> None:
    height = 4 * torch.rand(1, 16, 16, generator=generator)
    light = unit(0.5, -0.4, 0.6).unsqueeze(0)
    small = height_field_visibility(height / 1024, light, pixel_size=1 / 1024)
    assert torch.equal(height_field_visibility(height, light), small)


def test_hits_name_the_wall_that_is_met() -> None:
    x, _ = grid(21)
    height = torch.where(x == 6, 9.0, 0.0).unsqueeze(0)
    ray = torch.stack([unit(1.0, 0.0, 0.5), unit(-1.0, 0.0, 0.5), unit(1.0, 0.0, 5.0)])
    met = height_field_hits(height, ray).reshape(3, 21, 21)
    assert (met[0, 10, :16] == 10 * 21 + 16).all()
    assert (met[1, :, :16] == -1).all()
    assert (met[2, 10, 10] == -1).all()
    some = height_field_hits(height, ray, torch.tensor([5, 230]))
    assert torch.equal(some[:, 0], met.flatten(1)[:, [5, 230]])


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(ShapeError, match="height"):
        height_field_visibility(torch.zeros(4, 4), torch.zeros(1, 3))
    with pytest.raises(ShapeError, match="direction"):
        height_field_visibility(torch.zeros(1, 4, 4), torch.zeros(3))


def test_compiles_to_one_graph(generator: torch.Generator) -> None:
    height = 3 * torch.rand(2, 9, 7, generator=generator)
    light = torch.stack([unit(0.4, 0.3, 0.7), unit(-0.1, 0.8, 0.5)])
    compiled = torch.compile(height_field_visibility, fullgraph=True, backend="eager")
    assert torch.equal(compiled(height, light), height_field_visibility(height, light))
