"""Random shapes: the same for the same seed, unit normals that fit the heights."""

import pytest
import torch

from torchradiometry.errors import OutOfRangeError
from torchradiometry.learn.samples.shapes import FAMILIES, height_to_normals, random_shapes


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_the_same_seed_gives_the_same_shapes() -> None:
    first, again = random_shapes(6, 32, seeded(3)), random_shapes(6, 32, seeded(3))
    other = random_shapes(6, 32, seeded(4))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(first.height, other.height)


@pytest.mark.parametrize("family", FAMILIES)
def test_normals_are_unit_and_face_the_camera(family: str) -> None:
    shapes = random_shapes(12, 40, seeded(5), [family])
    torch.testing.assert_close(shapes.normal.norm(dim=1), torch.ones(12, 40, 40))
    assert (shapes.normal[:, 2] > 0).all()
    assert torch.isfinite(shapes.height).all()
    assert shapes.mask.flatten(1).any(1).all()


def test_normals_of_a_ball() -> None:
    size, radius = 65, 40.0
    axis = torch.arange(size) - (size - 1) / 2
    y, x = torch.meshgrid(-axis, axis, indexing="ij")
    z = torch.sqrt((radius**2 - x * x - y * y).clamp(min=0))
    truth = torch.stack([x, y, z]) / radius
    inside = x * x + y * y < (0.8 * radius) ** 2
    inside[[0, -1]] = inside[:, [0, -1]] = False  # one-sided differences at the edge
    found = height_to_normals(z.unsqueeze(0))[0]
    # central differences over 2 pixels: error about 1/(6 radius^2) of the third derivative
    assert (found - truth)[:, inside].abs().max() < 2e-3


def test_wrong_requests_are_named() -> None:
    with pytest.raises(OutOfRangeError, match="count"):
        random_shapes(0, 32, seeded(0))
    with pytest.raises(OutOfRangeError, match="size"):
        random_shapes(1, 8, seeded(0))
    with pytest.raises(OutOfRangeError, match="families"):
        random_shapes(1, 32, seeded(0), ["cubes"])
