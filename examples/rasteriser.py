"""The layers against a rasteriser that shares no code with them.

    difference = 100,000 x |L - L'|        at the same exposure as the pictures

Run it: `python examples/rasteriser.py`. It writes `docs/pictures/rasteriser.png`: a ball by
pyrender with shaders of the package's definitions, by `shade_points` on the points and normals
that the rasteriser saw, and the difference. It needs OpenGL (EGL); see `docs/reference.md`.
"""

from __future__ import annotations

from pathlib import Path

import torch

from torchradiometry.demo.curve import write_panels
from torchradiometry.geometry import PinholeCamera, look_at
from torchradiometry.materials import LambertianSpecular, NormalizedPhong
from torchradiometry.reference import render_reference
from torchradiometry.scene import Scene, sphere
from torchradiometry.shade import shade_points
from torchradiometry.sources import DirectionalSource, PointSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "rasteriser.png"
ALBEDO, SPECULAR, SHININESS = [0.6, 0.35, 0.2], 0.1, 40.0
#: where the camera stands, m
EYE = [0.0, 0.0, 4.0]


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Draw the ball twice; median and worst relative difference where it is lit."""
    size = 48 if fast else 224
    ball = sphere("ball", 1.0, (0.0, 0.0, 0.0), subdivisions=3, albedo=ALBEDO)
    lamps = (
        DirectionalSource([-1.0, 0.6, 0.5], [[2.0, 2.0, 2.4]]),
        PointSource([1.6, 1.4, 1.8], [[6.0, 5.4, 4.5]]),
    )
    place = look_at(EYE, [0.0, 0.0, 0.0])
    camera = PinholeCamera(width=size, height=size, yfov=0.6, camera_to_world=place)
    lobe = NormalizedPhong([SPECULAR], [SHININESS])
    seen = render_reference(Scene((ball,), lamps), camera, materials=[lobe])

    hit = seen.instance >= 0
    points, normals = seen.position[hit], seen.normal[hit]
    towards = torch.nn.functional.normalize(torch.tensor(EYE).double() - points, dim=-1)
    plastic = LambertianSpecular(ALBEDO, SPECULAR, SHININESS).double()
    ours = torch.zeros_like(seen.radiance)
    ours[hit] = shade_points(plastic, [s.double() for s in lamps], points, normals, towards)

    difference = (ours - seen.radiance).abs()
    lit = seen.radiance > 1e-3 * seen.radiance.max()
    relative = (difference / seen.radiance)[lit]
    panels = [picture.numpy() for picture in (seen.radiance, ours, 1e5 * difference)]
    titles = ("rasteriser", "layers", "difference x 100,000")
    write_panels(out, [panels], titles, exposure=1 / float(seen.radiance[hit].quantile(0.99)))
    return {"median": float(relative.median()), "worst": float(relative.max())}


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name}: {value:.1e}")
