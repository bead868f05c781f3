"""One photograph, under other lamps.

The shipped shading model says how the surface of a photographed face is turned, n; the light of the
photograph is then nine harmonics, found by least squares (`deploy`). What the paint, the pores and
the model's errors do is left as it is, and only the light is exchanged:

    I_new = I  (E_new(n) + e) / (E_old(n) + e),     E_new by `image_irradiance` of any source

e is a twentieth of the mean of E_old: where the old light says little, the new one is a guess.

The photograph is the portrait that matplotlib ships (Grace Hopper, US Navy, public domain); the
mask is an ellipse about the face. Another one: `main(photograph=..., mask=...)`.

Run it: `python examples/relight.py`. It writes `docs/pictures/relight.png`: the photograph, its
normals and the face under a lamp from the left; from the right, from below, from all sides.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from matplotlib.cbook import get_sample_data
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from torchradiometry.demo.curve import write_panels
from torchradiometry.deploy import Photograph, estimate_surface
from torchradiometry.files import read_counts, srgb_to_linear
from torchradiometry.shade import image_irradiance
from torchradiometry.sources import AbstractSource, AmbientDome, DirectionalSource, HarmonicSource

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "relight.png"
#: what is shown of the portrait, and middle and half axes of the face, pixels (rows, columns)
CROP, MIDDLE, AXES = (slice(132, 332), slice(178, 353)), (232, 265), (96, 84)
#: pixels of each panel
SHOWN = (128, 112)
LAMPS: dict[str, list[AbstractSource]] = {
    "left": [DirectionalSource([-1.0, 0.2, 0.5], [2.0]), AmbientDome([0.04])],
    "right": [DirectionalSource([1.0, 0.4, 0.5], [2.0]), AmbientDome([0.04])],
    "below": [DirectionalSource([0.1, -1.0, 0.6], [2.0]), AmbientDome([0.04])],
    "all sides": [AmbientDome([0.5])],
}


def portrait() -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Linear radiance of the portrait, and where the face is."""
    counts = read_counts(Path(str(get_sample_data("grace_hopper.jpg", asfileobj=False))))
    row, column = np.ogrid[: counts.shape[0], : counts.shape[1]]
    ellipse = ((row - MIDDLE[0]) / AXES[0]) ** 2 + ((column - MIDDLE[1]) / AXES[1]) ** 2
    linear = srgb_to_linear(counts[..., :3] / 255).astype(np.float32)
    return linear[CROP], (ellipse < 1)[CROP]


def irradiance(normal: Tensor, sources: list[AbstractSource]) -> Tensor:
    """E, `H W channel`, of normals `H W 3`."""
    lit = image_irradiance(normal.permute(2, 0, 1)[None], sources)
    return lit[0].permute(1, 2, 0).clamp(min=0)


def main(
    fast: bool = False,
    out: Path = PICTURE,
    photograph: NDArray[np.float32] | None = None,
    mask: NDArray[np.bool_] | None = None,
) -> dict[str, float]:
    """Relight; how much of the photograph is explained, and how much the lamps change it."""
    if photograph is None or mask is None:
        photograph, mask = portrait()
    if fast:
        photograph, mask = photograph[::3, ::3], mask[::3, ::3]
    surface = estimate_surface(Photograph(photograph, mask, "portrait"))
    normal = torch.from_numpy(surface.normal)
    seen, inside = torch.from_numpy(photograph.copy()), torch.from_numpy(mask.copy()).unsqueeze(-1)
    light = HarmonicSource(torch.from_numpy(surface.light).float().unsqueeze(0))
    old = irradiance(normal, [light])
    floor = 0.05 * old[mask].mean()
    shown = [torch.where(inside, seen, 0), torch.where(inside, ((normal + 1) / 2) ** 2.2, 0)]
    found = {"explained": float(surface.explained)}
    for name, lamps in LAMPS.items():
        new = irradiance(normal, lamps)
        new = new * (old[mask].mean() / new[mask].mean())
        relit = torch.where(inside, seen * (new + floor) / (old + floor), 0)
        shown.append(relit)
        found[name] = float((relit - seen)[mask].abs().sum() / seen[mask].sum())
    small = functional.interpolate(torch.stack(shown).permute(0, 3, 1, 2), SHOWN, mode="area")
    panels = [*small.permute(0, 2, 3, 1).numpy()]
    lit = ("from the left", "from the right", "from below", "from all sides")
    titles = ("photograph", "normals found", *lit)
    write_panels(out, [panels], titles, exposure=0.9)
    return found


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name}: {value:.3f}")
