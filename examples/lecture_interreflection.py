"""A room by the number of reflections, and with one number in their place.

Run it: `python examples/lecture_interreflection.py`. It writes
`docs/pictures/lecture_interreflection.png`, and prints the share of the light that each holds.
"""

from __future__ import annotations

from pathlib import Path

import torch

from torchradiometry.demo.curve import write_panels
from torchradiometry.render import RenderSettings, render_scene
from torchradiometry.scene import cornell_like_room

PICTURE = (
    Path(__file__).resolve().parent.parent / "docs" / "pictures" / "lecture_interreflection.png"
)


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """A room by bounces, and with one calibrated number in place of all of them."""
    size = 20 if fast else 180
    scene = cornell_like_room(width=size, height=size)
    common = {"supersampling": 1 if fast else 2, "patch_size": 2.0 if fast else 0.6}
    ways = {
        "direct light": RenderSettings(bounces=0, **common),  # type: ignore[arg-type]
        "+ an ambient number": RenderSettings(bounces=0, ambient=True, **common),  # type: ignore[arg-type]
        "+ 1 bounce": RenderSettings(bounces=1, ambient_tail=False, **common),  # type: ignore[arg-type]
        "+ 2 bounces": RenderSettings(bounces=2, ambient_tail=False, **common),  # type: ignore[arg-type]
        "+ all": RenderSettings(bounces=24, **common),  # type: ignore[arg-type]
    }
    shares, pictures = {}, {}
    for name, settings in ways.items():
        with torch.no_grad():
            pictures[name] = render_scene(scene, scene.cameras[0], settings)
    full = pictures["+ all"]
    exposure = 1 / float(full.radiance[~full.emitter].quantile(0.98))
    for name, picture in pictures.items():
        keep = ~full.emitter
        shares[name] = float(picture.radiance[keep].sum() / full.radiance[keep].sum())
    panels = [picture.radiance.numpy() for picture in pictures.values()]
    write_panels(out, [panels], [*ways], exposure=exposure)
    return shares


if __name__ == "__main__":
    print({name: round(value, 4) for name, value in main().items()})
