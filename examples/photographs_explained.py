"""Real photographs, predicted from others of the same object under other lamps.

A camera that looks along z sees a point of known normal n under a distant lamp l. With V the
lamp's cast shadow and E_r the light that the object sends to itself,

    I = rho (sum_k d_k pi f_k(l, z, n) c V + t E_r) + sum_k w_k pi g_k(l, z, n) c V
    c = max(0, n . l),   I within what the camera can record under that lamp

rho is the albedo of the pixel; f_k are rough diffuse surfaces (Oren-Nayar) of a few roughnesses
and g_k highlights of a few widths. Their weights d, w, t >= 0 belong to the object: they and the
albedos are least squares in turns, over the photographs with odd numbers. Those with even numbers
are predicted, and

    error = sqrt(sum (I_predicted - I)^2 / sum I^2)    over all their pixels of the object.

Rungs of the ladder add one thing each; in the last one every pixel has weights of its own, drawn
to the object's: w_kp is about w_k, give or take the share tau of what it contributes. How
large tau should be, two thirds of the odd photographs tell by predicting the other third.

Heights come from the normals by `normals_to_heights`, with weights for breaks.

E_r is one bounce and an ambient tail. Its albedo is known only up to a factor, the same that
photographs have to radiance; the mean albedo is found so that t = 1.

Run it: `python examples/photographs_explained.py`, with the four DiLiGenT objects of `SOURCE`. It
writes `docs/pictures/photographs.png`, the ladder. With a file name behind it, it also writes
measured, predicted and their difference (times 4) for one photograph of each object there: the
photographs are not ours to publish.

References: B. Shi et al., "A benchmark dataset and evaluation for non-Lambertian and uncalibrated
photometric stereo", TPAMI 2019.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from torch import Tensor
from torch.nn import functional

from torchradiometry.deploy import Photographs, read_photographs
from torchradiometry.files import write_picture
from torchradiometry.geometry import normals_to_heights
from torchradiometry.materials import AbstractMaterial, BlinnPhong, Microfacet, OrenNayar
from torchradiometry.shade import CastShadow
from torchradiometry.shade.interreflection import reflected_irradiance
from torchradiometry.sources import DirectionalSource

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "pictures" / "photographs.png"
SOURCE = ROOT.parent / "shared" / "data" / "diligent"
OBJECTS = ("ball", "bear", "cat", "pot1")
ODD, EVEN = slice(0, None, 2), slice(1, None, 2)
GREY = torch.tensor([0.2989, 0.5870, 0.1140])
EYE = torch.tensor([0.0, 0.0, 1.0])

ROUGH = [OrenNayar([1.0], [r]) for r in (0.0, 0.5, 1.0)]
WIDTHS = (0.013, 0.018, 0.026, 0.04, 0.065, 0.1, 0.17, 0.3, 0.5, 0.9)
MIRRORS = [Microfacet([0.04], [a]) for a in WIDTHS]
PHONG = [BlinnPhong([0.04], [n]) for n in (3.0, 10.0, 30.0, 100.0, 400.0, 2e3, 5e3)]
#: angular radius of a lamp, radians: softens what the heights have of errors
PENUMBRA = 0.05
#: of the weights of a pixel; 0 is the object's own
SHARES = (0.0, 0.1, 0.3, 1.0, 3.0)
#: the brightest that a column without weight in its object makes a pixel, of the pixel's mean
FRESH = 0.1
#: how far off a highlight is in the pixel that it is on, of its own brightness
DOUBT = 0.3
#: of the grid for reflected light, an edge
CELLS = 32


@dataclass(frozen=True, eq=False)
class View:
    """Photographs of one object whose surface is known.

    Attributes:
        grey: I, `pixel lamp`.
        ceiling: largest I that the camera can record, `lamp`.
        lamps: to the lamps, unit, `lamp 3`.
        normal: unit, `H W 3`.
        mask: `H W`.
    """

    grey: Tensor
    ceiling: Tensor
    lamps: Tensor
    normal: Tensor
    mask: Tensor

    def image(self, values: Tensor) -> Tensor:
        """`pixel channel` as `1 channel H W`, 0 outside."""
        image = values.new_zeros(*self.mask.shape, values.shape[-1])
        image[self.mask] = values
        return image.permute(2, 0, 1)[None]


@dataclass(frozen=True, eq=False)
class Columns:
    """What a weight of 1 adds to each observation, `column pixel lamp`.

    What is diffuse is multiplied by the albedo too.
    """

    diffuse: Tensor
    specular: Tensor

    def under(self, lamps: slice | Tensor) -> Columns:
        return Columns(self.diffuse[..., lamps], self.specular[..., lamps])

    def at(self, pixels: slice) -> Columns:
        return Columns(self.diffuse[:, pixels], self.specular[:, pixels])

    def by_pixel(self) -> Tensor:
        """`pixel lamp column`."""
        return torch.cat((self.diffuse, self.specular)).permute(1, 2, 0)


@dataclass(frozen=True, eq=False)
class Fit:
    """Albedo `pixel`, and one weight for each column."""

    albedo: Tensor
    diffuse: Tensor
    specular: Tensor

    def parts(self, columns: Columns) -> tuple[Tensor, Tensor]:
        """What the albedo multiplies, and what it does not, `pixel lamp`."""
        matt = torch.einsum("k,kpn->pn", self.diffuse, columns.diffuse)
        return matt, torch.einsum("k,kpn->pn", self.specular, columns.specular)

    def predict(self, columns: Columns) -> Tensor:
        matt, shine = self.parts(columns)
        return self.albedo.unsqueeze(1) * matt + shine

    def weights(self) -> Tensor:
        """`pixel column`."""
        shine = self.specular.expand(len(self.albedo), -1)
        return torch.cat((self.albedo.unsqueeze(1) * self.diffuse, shine), 1)


@dataclass(frozen=True, eq=False)
class Rung:
    """One step of the ladder: predictions under even lamps, their error, seconds of a core."""

    predicted: Tensor
    error: float
    seconds: float


def responses(
    materials: Iterable[AbstractMaterial], view: View, some: slice = slice(None), block: int = 8192
) -> Tensor:
    """pi f c, `column pixel lamp`, of some of the pixels."""
    normal = view.normal[view.mask][some]
    cosine = (normal @ view.lamps.T).clamp(min=0)

    def seen(material: AbstractMaterial) -> Tensor:
        parts = [material(view.lamps, EYE, n.unsqueeze(1))[..., 0] for n in normal.split(block)]
        return math.pi * cosine * torch.cat(parts)

    return torch.stack([seen(material) for material in materials])


def non_negative(gram: Tensor, right: Tensor, start: Tensor, sweeps: int) -> Tensor:
    """x >= 0 that minimises x G x / 2 - b x, `*batch column`, by descent along one axis a time."""
    found, rest = start.clone(), right - (gram @ start.unsqueeze(-1)).squeeze(-1)
    diagonal = gram.diagonal(dim1=-2, dim2=-1).clamp(min=1e-12)
    for _ in range(sweeps):
        for k in range(right.shape[-1]):
            moved = (found[..., k] + rest[..., k] / diagonal[..., k]).clamp(min=0)
            rest -= (moved - found[..., k]).unsqueeze(-1) * gram[..., k]
            found[..., k] = moved
    return found


def fit_object(columns: Columns, seen: Tensor, ceiling: Tensor | None, rounds: int = 8) -> Fit:
    """One set of weights, and an albedo for each pixel, by least squares in turns."""
    kinds = len(columns.diffuse)
    matt = columns.diffuse[0]
    albedo = (matt * seen).sum(1) / (matt * matt).sum(1).clamp(min=1e-6)
    fit = Fit(albedo, torch.eye(kinds)[0], torch.zeros(len(columns.specular)))
    used = torch.ones_like(seen)
    for _ in range(rounds):
        some = slice(None, None, 1 + len(seen) // 16384)
        found = shared_weights(columns.at(some), seen[some], used[some], fit, some)
        fit = Fit(fit.albedo, found[:kinds] / found[:kinds].sum(), found[kinds:])
        matt, shine = fit.parts(columns)
        sure = used * certainty(seen - fit.predict(columns), shine)
        # an albedo that no lamp shows is 0
        albedo = (sure * matt * (seen - shine)).sum(1) / (sure * matt * matt).sum(1).clamp(min=1e-6)
        fit = replace(fit, albedo=albedo.clamp(min=0))
        if ceiling is not None:  # what is brighter than the camera can tell is as predicted
            used = (~((seen >= 0.99 * ceiling) & (fit.predict(columns) >= seen))).float()
    return fit


def certainty(error: Tensor, shine: Tensor) -> Tensor:
    """Of what a pixel shows besides its highlights, which are off by a share of themselves."""
    usual = error.square().mean()
    return usual / (usual + (DOUBT * shine).square()).clamp(min=1e-12)


def shared_weights(columns: Columns, seen: Tensor, used: Tensor, fit: Fit, some: slice) -> Tensor:
    """Weights of the object, whatever the albedos: those follow (variable projection)."""
    albedo, held = fit.albedo[some], torch.cat((fit.diffuse, fit.specular)).double()
    table = torch.cat((albedo.unsqueeze(1) * columns.diffuse, columns.specular)) * used
    # what albedos can undo, or nothing shows, stays as it is: a weak pull to where weights are
    energy = table.double().square().sum((1, 2))
    pull = 1e-4 * energy.clamp(min=1e-3 * float(energy[0]))
    along = functional.normalize(used * fit.parts(columns)[0], dim=1)
    table = table - (table * along).sum(2, keepdim=True) * along
    rest = used * seen
    rest = rest - (rest * along).sum(1, keepdim=True) * along
    table, rest = table.flatten(1).double(), rest.flatten().double()
    gram = table @ table.T + torch.diag(pull)
    return non_negative(gram, table @ rest + pull * held, held, 100).float()


def fit_pixels(columns: Columns, seen: Tensor, ceiling: Tensor, fit: Fit, share: float) -> Tensor:
    """Weights of each pixel, `pixel column`, drawn to those of its object."""
    mean = fit.weights()
    if share == 0:
        return mean
    peak = torch.cat((columns.diffuse.amax((1, 2)), columns.specular.amax((1, 2))))
    predicted = fit.predict(columns)
    used = (~((seen >= 0.99 * ceiling) & (predicted >= seen))).float()
    noise = (used * (predicted - seen)).square().mean()
    used = used * certainty(predicted - seen, fit.parts(columns)[1])
    fresh = FRESH * predicted.mean(1, keepdim=True) / peak.clamp(min=1e-9)
    trust = noise / (share * (mean + fresh)).square().clamp(min=1e-12)
    found = []
    for start in range(0, len(seen), 4096):
        block = slice(start, start + 4096)
        table = columns.at(block).by_pixel()
        held = (table * used[block].unsqueeze(-1)).mT
        right = (held @ seen[block].unsqueeze(-1)).squeeze(-1) + trust[block] * mean[block]
        gram = held @ table + torch.diag_embed(trust[block])
        found.append(non_negative(gram, right, mean[block], 40))
    return torch.cat(found)


def chosen_share(columns: Columns, seen: Tensor, ceiling: Tensor) -> float:
    """tau with which two thirds of the photographs predict the others best."""
    some = slice(None, None, 1 + len(seen) // 4096)
    part, seen = columns.at(some), seen[some]
    third = torch.arange(seen.shape[1]) % 3
    errors = torch.zeros(len(SHARES))
    for left_out in range(3):
        here, there = third != left_out, third == left_out
        known = part.under(here), seen[:, here], ceiling[here]
        fit = fit_object(*known)
        for k, share in enumerate(SHARES):
            weights = fit_pixels(*known, fit, share)
            predicted = by_weights(part.under(there), weights, ceiling[there])
            errors[k] += (predicted - seen[:, there]).square().sum()
    return SHARES[int(errors.argmin())]


def by_weights(columns: Columns, weights: Tensor, ceiling: Tensor) -> Tensor:
    """I, `pixel lamp`, of weights `pixel column`."""
    table = torch.cat((columns.diffuse, columns.specular))
    return within(torch.einsum("pk,kpn->pn", weights, table), ceiling)


def within(predicted: Tensor, ceiling: Tensor | None) -> Tensor:
    """What the camera records of it."""
    # counts 0 and 255 stand for the middles of their intervals: 0.5 and 255.5
    return predicted if ceiling is None else predicted.clamp(ceiling / 511, ceiling)


def relative_error(predicted: Tensor, seen: Tensor) -> float:
    """Of the module's first lines."""
    return float(((predicted - seen).square().sum() / seen.square().sum()).sqrt())


class Ladder:
    """Fits odd photographs, predicts even ones, and notes what each rung took."""

    def __init__(self, view: View) -> None:
        self.view, self.rungs = view, {}
        self.seen, self.ceiling = view.grey[:, ODD], view.ceiling[ODD]
        self.since = time.process_time()

    def add(self, name: str, predicted: Tensor) -> None:
        seconds = time.process_time() - self.since
        error = relative_error(predicted, self.view.grey[:, EVEN])
        self.rungs[name] = Rung(predicted, error, seconds)
        self.since = time.process_time()

    def object_rung(self, name: str, columns: Columns, limited: bool = False) -> Fit:
        """One set of weights for the object."""
        fit = fit_object(columns.under(ODD), self.seen, self.ceiling if limited else None)
        ceiling = self.view.ceiling[EVEN] if limited else None
        self.add(name, within(fit.predict(columns.under(EVEN)), ceiling))
        return fit

    def pixel_rung(self, name: str, columns: Columns, fit: Fit) -> float:
        """Weights for each pixel; returns their share tau."""
        known = columns.under(ODD), self.seen, self.ceiling
        share = chosen_share(*known)
        weights = fit_pixels(*known, fit, share)
        self.add(name, by_weights(columns.under(EVEN), weights, self.view.ceiling[EVEN]))
        return share


def best_phong(view: View, matt: Tensor, visible: Tensor, ceiling: Tensor | None = None) -> Tensor:
    """The response of the highlight that explains the photographs best."""
    some = slice(None, None, 1 + len(view.grey) // 2048)
    seen, diffuse = view.grey[some, ODD], matt[:, some, ODD]

    def error(lobe: BlinnPhong) -> float:
        shine = responses([lobe], view, some) * visible[some]
        columns = Columns(diffuse, shine[..., ODD])
        predicted = fit_object(columns, seen, ceiling).predict(columns)
        return relative_error(within(predicted, ceiling), seen)

    return responses([min(PHONG, key=error)], view) * visible


def bounced(view: View, depth: Tensor, visible: Tensor, albedo: Tensor, mean: float) -> Tensor:
    """E_r, `pixel lamp`, with albedos of a given mean."""
    usual = float(albedo[albedo > 0].mean())
    paint = view.image((albedo * (mean / usual)).clamp(max=0.95).unsqueeze(1))
    direct = visible * (view.normal[view.mask] @ view.lamps.T).clamp(min=0)
    irradiance = view.image(direct)
    received = reflected_irradiance(
        depth,
        paint.expand_as(irradiance),
        irradiance,
        pixel_size=1.0,
        normal=view.image(view.normal[view.mask]),
        cells=(min(CELLS, len(paint[0, 0])), min(CELLS, len(paint[0, 0, 0]))),
        tail=True,
    )
    return received[0][:, view.mask].T


def shadowed(view: View, depth: Tensor) -> Tensor:
    """V, `pixel lamp`."""
    lamps = DirectionalSource(view.lamps, torch.ones(len(view.lamps), 1))
    return CastShadow(lamps, width=PENUMBRA, pixel_size=1.0)(depth)[0][:, view.mask].T


def explain(view: View) -> tuple[dict[str, Rung], dict[str, float]]:
    """The ladder, and what was found on the way."""
    ladder, none = Ladder(view), torch.empty(0, *view.grey.shape)
    matt = responses(ROUGH[:1], view)
    ladder.object_rung("Lambertian", Columns(matt, none))
    everywhere = torch.ones_like(view.grey)
    ladder.object_rung("+ Blinn-Phong", Columns(matt, best_phong(view, matt, everywhere)))

    normal = view.image(view.normal[view.mask])
    depth = -normals_to_heights(normal, view.mask[None, None], rounds=10).height
    visible = shadowed(view, depth)
    matt = matt * visible
    shiny = best_phong(view, matt, visible)
    ladder.object_rung("+ cast shadows", Columns(matt, shiny))

    matt = responses(ROUGH, view) * visible
    ladder.object_rung("+ rough diffuse", Columns(matt, shiny))
    shiny = best_phong(view, matt, visible, ladder.ceiling)
    ladder.object_rung("+ the camera's range", Columns(matt, shiny), limited=True)
    mirrors = responses(MIRRORS, view) * visible
    columns = Columns(matt, mirrors)
    fit = ladder.object_rung("microfacets for Blinn-Phong", columns, limited=True)

    mean = 0.4
    for _ in range(2):
        reflected = bounced(view, depth, visible, fit.albedo, mean)[None]
        columns = Columns(torch.cat((matt, reflected)), mirrors)
        fit = fit_object(columns.under(ODD), ladder.seen, ladder.ceiling)
        mean *= float(fit.diffuse[-1] / fit.diffuse[: len(ROUGH)].sum())
        mean = min(max(mean, 0.05), 0.9)
    fit = ladder.object_rung("+ indirect light", columns, limited=True)
    tau = ladder.pixel_rung("+ weights of each pixel", columns, fit)
    return ladder.rungs, {"mean albedo": mean, "tau": tau}


def view_of(photographs: Photographs, folder: Path, step: int = 1) -> View:
    """Every step-th pixel of photographs, with the normals of the scan."""
    assert photographs.ground_truth is not None
    lamps = torch.from_numpy(np.loadtxt(folder / "light_intensities.txt", dtype=np.float32))
    mask = np.zeros_like(photographs.mask)
    mask[::step, ::step] = photographs.mask[::step, ::step]
    grey = replace(photographs, mask=mask).grey()
    return View(
        grey=torch.from_numpy(grey),
        ceiling=(255.5 / 256 / lamps) @ GREY,
        lamps=torch.from_numpy(photographs.light_directions),
        normal=torch.from_numpy(photographs.ground_truth[::step, ::step]),
        mask=torch.from_numpy(photographs.mask[::step, ::step]),
    )


def rows_of(rungs: dict[str, dict[str, Rung]]) -> list[tuple[str, list[float], float, float]]:
    """Of each rung: its name, the objects' errors, their mean, seconds for all objects."""
    rows = []
    for name in next(iter(rungs.values())):
        each = [ladder[name] for ladder in rungs.values()]
        errors = [rung.error for rung in each]
        rows.append((name, errors, sum(errors) / len(errors), sum(r.seconds for r in each)))
    return rows


def table(rungs: dict[str, dict[str, Rung]]) -> str:
    """The ladder in Markdown."""
    lines = [["", *rungs, "mean", "seconds"], ["---"] * (3 + len(rungs))]
    for name, errors, mean, seconds in rows_of(rungs):
        lines.append([name, *(f"{e:.3f}" for e in (*errors, mean)), f"{seconds:.0f}"])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def draw_ladder(rungs: dict[str, dict[str, Rung]], out: Path) -> None:
    """Mean errors as bars, those of each object as points."""
    rows = rows_of(rungs)
    figure = Figure(figsize=(7.5, 0.42 * len(rows) + 1.1), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    places = range(len(rows))
    axes.barh(places, [mean for _, _, mean, _ in rows], color="#9db8d2", label="mean")
    for k, (name, mark) in enumerate(zip(rungs, "osD^", strict=False)):
        axes.plot([row[1][k] for row in rows], places, mark, color="#333333", ms=4, label=name)
    axes.set_yticks(places, [name for name, *_ in rows])
    axes.invert_yaxis()
    axes.set_xlabel("relative RMS error of photographs under lamps that were not fitted")
    axes.legend(frameon=False, fontsize="small", loc="lower right")
    axes.spines[["top", "right"]].set_visible(False)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)


def panel(view: View, rung: Rung, lamp: int = 22) -> Tensor:
    """Measured, predicted, and 1/2 + 4 x their difference, beside each other, `H W`."""
    measured, predicted = view.grey[:, EVEN][:, lamp], rung.predicted[:, lamp]
    scale = 1 / measured.quantile(0.995)
    shown = (measured * scale, predicted * scale, 0.5 + 4 * (predicted - measured) * scale)
    return torch.cat([view.image(s.clamp(0, 1).unsqueeze(1))[0, 0] for s in shown], 1)


def main(
    fast: bool = False, out: Path = PICTURE, source: Path = SOURCE, panels: Path | None = None
) -> dict[str, dict[str, float]]:
    """Relative RMS error of each rung on each object; nothing where there are no photographs."""
    folders = [source / name for name in (OBJECTS[1:3] if fast else OBJECTS)]
    if not all(folder.is_dir() for folder in folders):
        print(f"{source}: no photographs there; nothing to explain (see docs/photographs.md)")
        return {}
    rungs, shown = {}, []
    with torch.no_grad():
        for folder in folders:
            view = view_of(read_photographs(folder), folder, 8 if fast else 1)
            rungs[folder.name], found = explain(view)
            shown.append(panel(view, list(rungs[folder.name].values())[-1]))
            print(folder.name, {name: round(value, 2) for name, value in found.items()})
    print(table(rungs))
    draw_ladder(rungs, out)
    if panels is not None:
        wide = max(image.shape[1] for image in shown)
        rows = [functional.pad(image, (0, wide - image.shape[1])) for image in shown]
        grey = torch.cat(rows).unsqueeze(-1).expand(-1, -1, 3)
        write_picture(panels, grey.numpy(), exposure=1.0)
    return {
        name: {step: rung.error for step, rung in ladder.items()} for name, ladder in rungs.items()
    }


if __name__ == "__main__":
    main(panels=Path(sys.argv[1]) if len(sys.argv) > 1 else None)
