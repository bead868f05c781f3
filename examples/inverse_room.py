"""Inverse radiosity: the paint of every wall and the power of the lamp, from one picture of a room.

Light that was reflected twice carries the colours of two walls, so that the unknowns are tied to
each other by B = M + rho F B. The camera sees part of the room and is blinded by the lamp, whose
pixels are left out; geometry is known, and its form factors are found once:

    minimise over albedos and emission    mean ((develop(view, scene) - picture) / (picture + e))^2

by L-BFGS, with the gradient of the whole radiosity solve in every step. The picture is made by a
finer solution than the one that is fitted: smaller patches, more bounces, other shadow rays.

Direct light alone fixes the product of paint and lamp, and of what no lamp reaches (the ceiling)
nothing. It is fitted beside it, and its best factor is given to it: what is reflected counts as
paint. Interreflection fixes the factor too.

Errors: absolute, of the albedo of every surface but the lamp, mean over the colours; relative, of
the lamp's power.

Run it: `python examples/inverse_room.py`. It writes `docs/pictures/inverse_room.png`: the picture,
the paint of the room, what was found of it, and what direct light alone makes of it.

References: Y. Yu, P. Debevec, J. Malik and T. Hawkins, "Inverse Global Illumination", SIGGRAPH
1999.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from torchradiometry.demo.curve import write_panels
from torchradiometry.render import RenderSettings, View, develop, render_scene, view_scene
from torchradiometry.scene import Scene, cornell_like_room

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "inverse_room.png"


def painted(scene: Scene, albedo: Tensor, power: Tensor) -> Scene:
    """The room with other albedos, `surface 3`, and another emission of its lamp, `3`."""
    surfaces = []
    for surface, colour in zip(scene.surfaces, albedo, strict=True):
        shines = bool((surface.emission > 0).any())
        surfaces.append(
            replace(surface, albedo=colour, emission=power if shines else surface.emission)
        )
    return replace(scene, surfaces=tuple(surfaces))


def fit(
    view: View, scene: Scene, picture: Tensor, keep: Tensor, rounds: int
) -> tuple[Tensor, Tensor]:
    """Albedos `surface 3` and emission `3` that reproduce the pixels to keep."""
    raw = torch.zeros(len(scene.surfaces), 3, requires_grad=True)
    log_power = torch.ones(3, requires_grad=True)
    optimiser = torch.optim.LBFGS(
        [raw, log_power], max_iter=rounds, history_size=30, line_search_fn="strong_wolfe"
    )
    floor = 0.05 * picture[keep].mean()

    def loss() -> Tensor:
        optimiser.zero_grad()
        found = develop(view, painted(scene, raw.sigmoid(), log_power.exp())).radiance
        error = ((found - picture) / (picture + floor))[keep].square().mean()
        error.backward()
        return error

    optimiser.step(loss)
    return raw.sigmoid().detach(), log_power.exp().detach()


def errors_of(albedo: Tensor, truth: Tensor) -> dict[str, float]:
    """Mean and worst error of the albedos."""
    error = (albedo - truth).abs().mean(-1)
    return {"albedo, mean": float(error.mean()), "albedo, worst": float(error.max())}


def paint_of(scene: Scene, albedo: Tensor) -> Tensor:
    """A picture of the albedos themselves: surfaces shine with them and reflect nothing."""
    black = torch.zeros(3)
    surfaces = [
        replace(surface, albedo=black, emission=colour)
        for surface, colour in zip(scene.surfaces, albedo, strict=True)
    ]
    settings = RenderSettings(bounces=0, supersampling=1, shadow_samples=0)
    return render_scene(Scene(tuple(surfaces)), scene.cameras[0], settings).radiance.float()


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, dict[str, float]]:
    """Fit with and without interreflection; errors of both."""
    size, rounds = (24, 40) if fast else (72, 60)
    scene = cornell_like_room(width=size, height=size)
    fine = RenderSettings(
        bounces=32, patch_size=1.2 if fast else 0.6, supersampling=1, seed=7, shadow_samples=8
    )
    coarse = RenderSettings(bounces=8, patch_size=1.6 if fast else 1.0, supersampling=1)
    with torch.no_grad():
        made = render_scene(scene, scene.cameras[0], fine)
        view = view_scene(scene, scene.cameras[0], coarse)
    picture, keep = made.radiance.float(), ~made.emitter
    truth = torch.stack([surface.albedo for surface in scene.surfaces])
    lamp = next(k for k, surface in enumerate(scene.surfaces) if bool(surface.emission.any()))
    others = [k for k in range(len(truth)) if k != lamp]

    albedo, power = fit(view, scene, picture, keep, rounds)
    found = {"all light": errors_of(albedo[others], truth[others])}
    found["all light"]["lamp"] = float((power / scene.surfaces[lamp].emission - 1).abs().mean())
    naive, _ = fit(view._replace(exchange=None), scene, picture, keep, rounds)
    factor = (truth[others] * naive[others]).sum() / naive[others].square().sum()
    naive = (naive * factor).clamp(max=1)
    found["direct light alone"] = errors_of(naive[others], truth[others])

    exposure = 1 / float(picture[keep].quantile(0.98))
    paints = [paint_of(scene, colours) for colours in (truth, albedo, naive)]
    panels = [panel.detach().numpy() for panel in (exposure * picture, *paints)]
    titles = ("picture", "true paint", "found, all light", "found, direct light")
    write_panels(out, [panels], titles, scale=2)
    return found


if __name__ == "__main__":
    for name, numbers in main().items():
        print(name, {key: round(value, 4) for key, value in numbers.items()})
