"""What interreflection adds: one room with direct light alone, with every bounce, and between.

Run it: `python examples/local_and_global.py`. It writes `docs/pictures/room.png`: direct light,
all light, and what the first leaves out, at the same exposure.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from torchradiometry.demo.curve import write_panels
from torchradiometry.render import RenderSettings, render_scene
from torchradiometry.scene import cornell_like_room

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "room.png"


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Render the room with 0, 1 and 12 bounces; the share of light that each has."""
    scene = cornell_like_room()
    size = 32 if fast else 288
    camera = replace(scene.cameras[0], width=size, height=size)
    common = {"supersampling": 1, "shadow_samples": 2} if fast else {"shadow_samples": 8}
    patch = 1.5 if fast else 0.4
    pictures = []
    for bounces in (0, 1, 12):
        settings = RenderSettings(bounces=bounces, ambient_tail=False, patch_size=patch, **common)
        with torch.no_grad():
            pictures.append(render_scene(scene, camera, settings))
    direct, one, full = (picture.radiance for picture in pictures)
    wall = ~pictures[0].emitter
    exposure = 1 / float(full[wall].amax(-1).quantile(0.98))
    panels = [picture.clamp(min=0).numpy() for picture in (direct, full, full - direct)]
    titles = ("direct light", "all light", "what was reflected: the difference")
    write_panels(out, [panels], titles, exposure=exposure)
    total = float(full[wall].sum())
    return {
        "direct": float(direct[wall].sum()) / total,
        "one bounce": float(one[wall].sum()) / total,
    }


if __name__ == "__main__":
    for name, share in main().items():
        print(f"{name}: {100 * share:.1f} % of the light")
