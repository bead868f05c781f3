"""Reliefs from one photograph by a local and by a global model: mean angular errors.

`python -m tests.benchmarks.concave_reliefs`

`examples/concave_relief.py` on more reliefs, albedos and lights, and with an albedo that is found
along with the depth. Under oblique lights the global model casts shadows too, with a penumbra of
0.05 rad.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from rich.progress import track

from examples.concave_relief import (
    GLOBAL,
    LOCAL,
    bowl,
    degrees,
    depth_map,
    groove,
    lights,
    photograph,
    recover,
)
from torchradiometry import ShadeDepth

if TYPE_CHECKING:
    from examples.concave_relief import Height

SIZE, STEPS = 24, 60


def waves(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """Hills and hollows, up to 60 degrees steep."""
    return 0.1 * (torch.sin(9 * x + 4 * y) + torch.sin(3 * x - 11 * y + 1))


#: relief, albedo, angle between the lights and the camera's axis (degrees)
CASES: dict[str, tuple[Height, float, float]] = {
    "bowl, albedo 0.9": (bowl, 0.9, 25),
    "groove of 90 degrees, 0.9": (groove, 0.9, 25),
    "waves, 0.9": (waves, 0.9, 25),
    "bowl under oblique lights, with shadows": (bowl, 0.9, 45),
    "bowl, 0.6": (bowl, 0.6, 25),
    "groove, 0.6": (groove, 0.6, 25),
    "bowl, 0.3": (bowl, 0.3, 25),
    "groove, 0.3": (groove, 0.3, 25),
}


def errors(height: Height, albedo: float, angle: float, size: int, steps: int) -> list[float]:
    """Local and global model with the albedo known, then with it unknown."""
    source = lights(angle)
    picture = photograph(height, albedo, source, size)
    truth = depth_map(height, (torch.arange(size) + 0.5) / size - 0.5)
    full = replace(GLOBAL, cells=size)
    if angle > 25:
        full = replace(full, cast_shadows=True, shadow_width=0.05)
    models = [ShadeDepth(s, source, pixel_size=1 / size) for s in (LOCAL, full)]
    found = [recover(picture, m, known, steps) for known in (albedo, None) for m in models]
    return [degrees(depth, truth) for depth in found]


def main() -> None:
    """A table in Markdown."""
    print("| relief | local | global | local, albedo unknown | global, albedo unknown |")
    print("|---|---|---|---|---|")
    for name, case in track(CASES.items()):
        print(f"| {name} | " + " | ".join(f"{e:.1f}" for e in errors(*case, SIZE, STEPS)) + " |")


if __name__ == "__main__":
    main()
