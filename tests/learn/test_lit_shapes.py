"""Shapes lit by lamps of their own: shadows, bounces, and turns."""

import torch
from torch import Tensor

from torchradiometry.learn import ShapeBank, Shapes, height_to_normals, light_shapes, random_shapes
from torchradiometry.learn.samples.lit_shapes import places, turned_shapes
from torchradiometry.learn.samples.single_images import photograph
from torchradiometry.numerics import clamped_cosine
from torchradiometry.shade.layout import to_points
from torchradiometry.sources.point import point_arrival

SIZE = 48
AXIS = torch.arange(SIZE) - (SIZE - 1) / 2
X, Y = AXIS.expand(SIZE, SIZE), -AXIS.unsqueeze(1).expand(SIZE, SIZE)


def shapes_of(height: Tensor, mask: Tensor) -> Shapes:
    return Shapes(height[None], height_to_normals(height[None]), mask[None])


def ball() -> Shapes:
    room = 20.0**2 - X * X - Y * Y
    return shapes_of(room.clamp(min=0).sqrt(), room > 4)


def groove() -> Shapes:
    """Walls of 45 degrees that meet at x = 0."""
    return shapes_of(X.abs().contiguous(), torch.ones(SIZE, SIZE, dtype=torch.bool))


def facing(bank: ShapeBank) -> Tensor:
    """Irradiance of unit lamps without shadows."""
    power = bank.lamp.square().sum(-1, keepdim=True)
    arrival = point_arrival(bank.lamp, power, to_points(places(bank.height)))
    normal = to_points(height_to_normals(bank.height))
    lit = clamped_cosine(arrival.direction, normal) * arrival.irradiance.squeeze(-1)
    return lit.transpose(0, 1).unflatten(2, bank.height.shape[-2:])


def test_a_ball_hides_no_lamp_and_sends_itself_nothing(generator: torch.Generator) -> None:
    bank = light_shapes(ball(), generator)
    seen = bank.mask[:, None] & (facing(bank) > 0.35)  # beyond the lamp's own width
    assert (bank.visibility[seen] == 1).all()
    assert bank.bounce.abs().max() < 1e-3
    assert bank.sky[bank.mask].min() >= 0.4  # half of the sky at the outline


def test_a_groove_sends_itself_what_its_walls_receive() -> None:
    """Of what falls on an endless groove of 90 degrees, 1 - sin 45 goes from wall to wall."""
    for seed in range(3):
        bank = light_shapes(groove(), torch.Generator().manual_seed(seed))
        middle = slice(SIZE // 2 - 4, SIZE // 2 + 4)
        lit = (facing(bank) * bank.visibility.float())[0, :, middle]
        share = bank.bounce[0, :, middle].float().mean((1, 2)) / lit.mean((1, 2))
        assert (share < 1 - 0.5**0.5).all()  # this one ends
        assert (share > 0.15).all()


def test_lamps_turn_with_their_shapes() -> None:
    bank = light_shapes(
        random_shapes(1, SIZE, torch.Generator().manual_seed(3), ["limbs"]),
        torch.Generator().manual_seed(4),
    )
    lit = facing(bank) * bank.mask[:, None]
    sums = set()
    for seed in range(40):
        made = turned_shapes(bank, torch.Generator().manual_seed(seed))
        again = facing(made) * made.mask[:, None]
        assert torch.equal(made.mask.sum(), bank.mask.sum())
        # the same light on the same places, wherever they have gone
        for one, other in zip(lit[0], again[0], strict=True):
            torch.testing.assert_close(
                one.flatten().sort().values, other.flatten().sort().values, rtol=1e-4, atol=1e-4
            )
        sums.add(tuple(made.lamp[0, 0].round().tolist()))
    assert len(sums) == 8


def test_bounces_reach_the_picture_and_nothing_else() -> None:
    bank = light_shapes(groove(), torch.Generator().manual_seed(1))
    alone, lit = (
        photograph(bank, torch.Generator().manual_seed(5), indirect=indirect)
        for indirect in (False, True)
    )
    assert torch.equal(alone.albedo, lit.albedo)
    assert torch.equal(alone.normal, lit.normal)
    assert (alone.image - lit.image).abs().mean() > 0.001
