"""Real photographs, predicted from others of the same object under other lamps.

`python -m tests.benchmarks.photographs_explained`

A camera that looks along z sees a point of known normal n under a distant lamp l. With V the
lamp's cast shadow and E_r the light that the object sends to itself,

    I = rho (sum_k d_k pi f_k(l, z, n) c V + t E_r) + sum_k w_k pi g_k(l, z, n) c V
    c = max(0, n . l),   I within what the camera can record under that lamp

rho is the albedo of the pixel; f_k are rough diffuse surfaces (Oren-Nayar) of a few roughnesses
and g_k highlights of a few widths. `torchradiometry.learn.reflectance` finds albedos and weights
from the photographs with odd numbers. Those with even numbers are predicted, and

    error = sqrt(sum (I_predicted - I)^2 / sum I^2)    over all their pixels of the object.

Rungs of the ladder add one thing each (`explain`); in the last one every pixel has weights of its
own. Heights come from the normals by `normals_to_heights`, with weights for breaks. E_r is one
bounce and an ambient tail. Its albedo is known only up to a factor, the same that photographs have
to radiance; the mean albedo is found so that t = 1.

It needs the four DiLiGenT objects of `SOURCE` and writes `docs/pictures/photographs.png`, the
ladder. With `--panels FILE` it also writes measured, predicted and their difference (times 4) for
one photograph of each object there: the photographs are not ours to publish.

References: B. Shi et al., "A benchmark dataset and evaluation for non-Lambertian and uncalibrated
photometric stereo", TPAMI 2019.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor
from torch.nn import functional

from torchradiometry.deploy import read_photographs
from torchradiometry.files import write_picture
from torchradiometry.geometry import normals_to_heights
from torchradiometry.learn.reflectance import (
    ReflectanceFit,
    Responses,
    chosen_share,
    fit_object,
    fit_pixels,
    material_responses,
    predict_pixels,
    recorded,
)
from torchradiometry.materials import AbstractMaterial, BlinnPhong, Microfacet, OrenNayar
from torchradiometry.shade import CastShadow
from torchradiometry.shade.interreflection import reflected_irradiance
from torchradiometry.sources import DirectionalSource

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "pictures" / "photographs.png"
SOURCE = ROOT.parent / "shared" / "data" / "diligent"
OBJECTS = ("ball", "bear", "cat", "pot1")
ODD, EVEN = slice(0, None, 2), slice(1, None, 2)
GREY = torch.tensor([0.2989, 0.5870, 0.1140])

ROUGH = [OrenNayar([1.0], [r]) for r in (0.0, 0.5, 1.0)]
WIDTHS = (0.013, 0.018, 0.026, 0.04, 0.065, 0.1, 0.17, 0.3, 0.5, 0.9)
MIRRORS = [Microfacet([0.04], [a]) for a in WIDTHS]
PHONG = [BlinnPhong([0.04], [n]) for n in (3.0, 10.0, 30.0, 100.0, 400.0, 2e3, 5e3)]
#: angular radius of a lamp, radians: softens what the heights have of errors
PENUMBRA = 0.05
#: of the grid for reflected light, an edge
CELLS = 32


@dataclass(frozen=True, eq=False)
class View:
    """Photographs of one object whose surface is known.

    Attributes:
        grey: I, `pixel lamp`.
        ceiling: largest I that the camera can record, `lamp`.
        lamps: to the lamps, unit, `lamp 3`.
        normals: unit, `pixel 3`.
        mask: `H W`.
    """

    grey: Tensor
    ceiling: Tensor
    lamps: Tensor
    normals: Tensor
    mask: Tensor

    def image(self, values: Tensor) -> Tensor:
        """`pixel channel` as `1 channel H W`, 0 outside."""
        image = values.new_zeros(*self.mask.shape, values.shape[-1])
        image[self.mask] = values
        return image.permute(2, 0, 1)[None]

    def responses(self, materials: Sequence[AbstractMaterial]) -> Tensor:
        """Of materials, `material pixel lamp`, without shadows."""
        return material_responses(materials, self.normals, self.lamps)


def error(predicted: Tensor, seen: Tensor) -> float:
    """Of the module's first lines."""
    return float(((predicted - seen).square().sum() / seen.square().sum()).sqrt())


class Ladder:
    """Fits odd photographs, predicts even ones, and notes errors and seconds of a core by rung."""

    def __init__(self, view: View) -> None:
        self.view, self.errors, self.seconds = view, {}, {}
        self.seen, self.ceiling = view.grey[:, ODD], view.ceiling[ODD]
        self.since = time.process_time()

    def add(self, name: str, predicted: Tensor) -> None:
        """Note a rung by its predictions under even lamps; the last ones are kept."""
        self.seconds[name] = time.process_time() - self.since
        self.predicted, self.errors[name] = predicted, error(predicted, self.view.grey[:, EVEN])
        self.since = time.process_time()

    def of_object(self, name: str, responses: Responses, limited: bool = False) -> ReflectanceFit:
        """One set of weights for the object; limited: within what the camera can record."""
        fit = fit_object(responses.under(ODD), self.seen, self.ceiling if limited else None)
        ceiling = self.view.ceiling[EVEN] if limited else None
        self.add(name, recorded(fit.predict(responses.under(EVEN)), ceiling))
        return fit

    def of_pixels(self, name: str, responses: Responses, fit: ReflectanceFit) -> float:
        """Weights for each pixel; returns their share tau."""
        known = responses.under(ODD), self.seen, self.ceiling
        share = chosen_share(*known)
        weights = fit_pixels(*known, fit, share)
        self.add(name, predict_pixels(responses.under(EVEN), weights, self.view.ceiling[EVEN]))
        return share


def best_phong(view: View, matt: Tensor, visible: Tensor, ceiling: Tensor | None = None) -> Tensor:
    """The response of the highlight that explains the photographs best."""
    some = slice(None, None, 1 + len(view.grey) // 2048)
    seen, diffuse = view.grey[some, ODD], matt[:, some, ODD]

    def left(lobe: BlinnPhong) -> float:
        shine = material_responses([lobe], view.normals[some], view.lamps) * visible[some]
        responses = Responses(diffuse, shine[..., ODD])
        predicted = fit_object(responses, seen, ceiling).predict(responses)
        return error(recorded(predicted, ceiling), seen)

    return view.responses([min(PHONG, key=left)]) * visible


def bounced(view: View, depth: Tensor, visible: Tensor, albedo: Tensor, mean: float) -> Tensor:
    """E_r, `pixel lamp`, with albedos of a given mean."""
    usual = float(albedo[albedo > 0].mean())
    paint = view.image((albedo * (mean / usual)).clamp(max=0.95).unsqueeze(1))
    direct = visible * (view.normals @ view.lamps.T).clamp(min=0)
    irradiance = view.image(direct)
    received = reflected_irradiance(
        depth,
        paint.expand_as(irradiance),
        irradiance,
        pixel_size=1.0,
        normal=view.image(view.normals),
        cells=(min(CELLS, len(paint[0, 0])), min(CELLS, len(paint[0, 0, 0]))),
        tail=True,
    )
    return received[0][:, view.mask].T


def shadowed(view: View, depth: Tensor) -> Tensor:
    """V, `pixel lamp`."""
    lamps = DirectionalSource(view.lamps, torch.ones(len(view.lamps), 1))
    return CastShadow(lamps, width=PENUMBRA, pixel_size=1.0)(depth)[0][:, view.mask].T


def explain(view: View) -> tuple[Ladder, dict[str, float]]:
    """The ladder, and what was found on the way."""
    ladder, none = Ladder(view), torch.empty(0, *view.grey.shape)
    matt = view.responses(ROUGH[:1])
    ladder.of_object("Lambertian", Responses(matt, none))
    everywhere = torch.ones_like(view.grey)
    ladder.of_object("+ Blinn-Phong", Responses(matt, best_phong(view, matt, everywhere)))

    depth = -normals_to_heights(view.image(view.normals), view.mask[None, None], rounds=10).height
    visible = shadowed(view, depth)
    matt = matt * visible
    shiny = best_phong(view, matt, visible)
    ladder.of_object("+ cast shadows", Responses(matt, shiny))

    matt = view.responses(ROUGH) * visible
    ladder.of_object("+ rough diffuse", Responses(matt, shiny))
    shiny = best_phong(view, matt, visible, ladder.ceiling)
    ladder.of_object("+ the camera's range", Responses(matt, shiny), limited=True)
    mirrors = view.responses(MIRRORS) * visible
    responses = Responses(matt, mirrors)
    fit = ladder.of_object("microfacets for Blinn-Phong", responses, limited=True)

    mean = 0.4
    for _ in range(2):
        reflected = bounced(view, depth, visible, fit.albedo, mean)[None]
        responses = Responses(torch.cat((matt, reflected)), mirrors)
        fit = fit_object(responses.under(ODD), ladder.seen, ladder.ceiling)
        mean *= float(fit.diffuse[-1] / fit.diffuse[: len(ROUGH)].sum())
        mean = min(max(mean, 0.05), 0.9)
    fit = ladder.of_object("+ indirect light", responses, limited=True)
    tau = ladder.of_pixels("+ weights of each pixel", responses, fit)
    return ladder, {"mean albedo": mean, "tau": tau}


def view_of(folder: Path, step: int = 1) -> View:
    """Every step-th pixel of a folder's photographs, with the normals of the scan."""
    photographs = read_photographs(folder)
    assert photographs.ground_truth is not None
    lamps = torch.from_numpy(np.loadtxt(folder / "light_intensities.txt", dtype=np.float32))
    mask = np.zeros_like(photographs.mask)
    mask[::step, ::step] = photographs.mask[::step, ::step]
    return View(
        grey=torch.from_numpy(replace(photographs, mask=mask).grey()),
        ceiling=(255.5 / 256 / lamps) @ GREY,
        lamps=torch.from_numpy(photographs.light_directions),
        normals=torch.from_numpy(photographs.ground_truth[mask]),
        mask=torch.from_numpy(mask[::step, ::step]),
    )


def table(ladders: dict[str, Ladder]) -> str:
    """Errors of all objects, their mean and seconds, in Markdown."""
    lines = [["", *ladders, "mean", "seconds"], ["---"] * (3 + len(ladders))]
    for rung in next(iter(ladders.values())).errors:
        errors = [ladder.errors[rung] for ladder in ladders.values()]
        seconds = sum(ladder.seconds[rung] for ladder in ladders.values())
        shown = (*errors, sum(errors) / len(errors))
        lines.append([rung, *(f"{e:.3f}" for e in shown), f"{seconds:.0f}"])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def draw_ladder(ladders: dict[str, Ladder], out: Path) -> None:
    """Mean errors as bars, those of each object as points."""
    rungs = [*next(iter(ladders.values())).errors]
    errors = torch.tensor([[*ladder.errors.values()] for ladder in ladders.values()])
    figure = Figure(figsize=(7.5, 0.42 * len(rungs) + 1.1), layout="constrained")
    axes = figure.add_subplot()
    axes.barh(rungs, errors.mean(0).tolist(), color="#9db8d2", label="mean")
    for name, each, mark in zip(ladders, errors, "osD^", strict=False):
        axes.plot(each.tolist(), rungs, mark, color="#333333", ms=4, label=name)
    axes.invert_yaxis()
    axes.set_xlabel("relative RMS error of photographs under lamps that were not fitted")
    axes.legend(frameon=False, fontsize="small", loc="lower right")
    axes.spines[["top", "right"]].set_visible(False)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


def panel(ladder: Ladder, lamp: int = 22) -> Tensor:
    """Measured, predicted, and 1/2 + 4 x their difference, beside each other, `H W`."""
    measured, predicted = ladder.view.grey[:, EVEN][:, lamp], ladder.predicted[:, lamp]
    scale = 1 / measured.quantile(0.995)
    shown = (measured * scale, predicted * scale, 0.5 + 4 * (predicted - measured) * scale)
    return torch.cat([ladder.view.image(s.clamp(0, 1).unsqueeze(1))[0, 0] for s in shown], 1)


def main(
    fast: bool = False, out: Path = PICTURE, source: Path = SOURCE, panels: Path | None = None
) -> dict[str, dict[str, float]]:
    """Relative RMS error of each rung on each object; nothing where there are no photographs."""
    folders = [source / name for name in (OBJECTS[1:3] if fast else OBJECTS)]
    if not all(folder.is_dir() for folder in folders):
        print(f"{source}: no photographs there; nothing to explain (see docs/photographs.md)")
        return {}
    ladders = {}
    with torch.no_grad():
        for folder in folders:
            ladders[folder.name], found = explain(view_of(folder, 8 if fast else 1))
            print(folder.name, {name: round(value, 2) for name, value in found.items()})
    print(table(ladders))
    draw_ladder(ladders, out)
    if panels is not None:
        shown = [panel(ladder) for ladder in ladders.values()]
        wide = max(image.shape[1] for image in shown)
        rows = [functional.pad(image, (0, wide - image.shape[1])) for image in shown]
        write_picture(panels, torch.cat(rows)[..., None].expand(-1, -1, 3).numpy(), exposure=1.0)
    return {name: ladder.errors for name, ladder in ladders.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=SOURCE, help="folder of the four objects")
    parser.add_argument("--panels", type=Path, help="picture to write: measured and predicted")
    options = parser.parse_args()
    main(source=options.data, panels=options.panels)
