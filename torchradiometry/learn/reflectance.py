"""Reflectance from photographs of a surface that is known, under lamps that are known.

A camera sees pixel p, of normal n, under the distant lamp l. Materials are columns, what a weight
of 1 adds to each photograph:

    I = rho_p sum_k d_k D_kpl + sum_k w_k S_kpl,    D, S = pi f(l, z, n) max(0, n . l) V_pl

D are diffuse materials (and whatever else the albedo rho multiplies, such as light that the object
sends itself), S highlights, V the lamp's shadow. Weights d, w >= 0 belong to the object and the
albedo to the pixel: least squares in turns (`fit_object`), the weights with the albedos projected
out (variable projection), by descent along one axis at a time. What is at the camera's ceiling only
says "at least", and a highlight counts for less where it is bright: its place is off by a share
`DOUBT` of itself.

`fit_pixels` gives each pixel weights of its own, drawn to the object's: w_kp is about w_k, give or
take the share tau of what it contributes (ridge regression); `chosen_share` finds the tau with
which two thirds of the photographs predict the others best.

References: G. Golub and V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least
squares problems whose variables separate", SIAM J. Numer. Anal. 10 (1973).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from torchradiometry.materials.base import AbstractMaterial
from torchradiometry.numerics import guarded_divide

__all__ = [
    "ReflectanceFit",
    "Responses",
    "chosen_share",
    "fit_object",
    "fit_pixels",
    "material_responses",
    "non_negative",
    "predict_pixels",
    "recorded",
]

#: tau that are tried; 0 is the object's own weights
SHARES = (0.0, 0.1, 0.3, 1.0, 3.0)
#: the brightest that a column without weight in its object makes a pixel, of the pixel's mean
FRESH = 0.1
#: how far off a highlight is in the pixel that it is on, of its own brightness
DOUBT = 0.3
#: light, of a lamp's, that is too little to tell an albedo or a weight by
DIM = 1e-3
#: pixels that shared weights are fitted to, that tau is chosen with, and that are held at a time
SOME, FEW, BLOCK = 16384, 4096, 4096


@dataclass(frozen=True, eq=False)
class Responses:
    """What a weight of 1 adds to each observation, `column pixel lamp`.

    What is diffuse is multiplied by the albedo too.
    """

    diffuse: Tensor
    specular: Tensor

    def under(self, lamps: slice | Tensor) -> Responses:
        """Under some of the lamps."""
        return Responses(self.diffuse[..., lamps], self.specular[..., lamps])

    def at(self, pixels: slice) -> Responses:
        """At some of the pixels."""
        return Responses(self.diffuse[:, pixels], self.specular[:, pixels])

    def columns(self) -> Tensor:
        """All, `column pixel lamp`."""
        return torch.cat((self.diffuse, self.specular))


@dataclass(frozen=True, eq=False)
class ReflectanceFit:
    """Albedo `pixel`, and one weight for each column."""

    albedo: Tensor
    diffuse: Tensor
    specular: Tensor

    def parts(self, responses: Responses) -> tuple[Tensor, Tensor]:
        """What the albedo multiplies, and what it does not, `pixel lamp`."""
        matt = torch.einsum("k,kpn->pn", self.diffuse, responses.diffuse)
        return matt, torch.einsum("k,kpn->pn", self.specular, responses.specular)

    def predict(self, responses: Responses) -> Tensor:
        """I, `pixel lamp`."""
        matt, shine = self.parts(responses)
        return self.albedo.unsqueeze(1) * matt + shine

    def weights(self) -> Tensor:
        """`pixel column`, albedo and all."""
        shine = self.specular.expand(len(self.albedo), -1)
        return torch.cat((self.albedo.unsqueeze(1) * self.diffuse, shine), 1)


def material_responses(
    materials: Iterable[AbstractMaterial], normal: Tensor, lamps: Tensor, block: int = 8192
) -> Tensor:
    """pi f max(0, n . l), `material pixel lamp`, seen along z.

    Args:
        materials: of one channel.
        normal: unit, `pixel 3`.
        lamps: to the lamps, unit, `lamp 3`.
        block: pixels at a time.
    """
    eye = normal.new_tensor((0.0, 0.0, 1.0))
    cosine = (normal @ lamps.T).clamp(min=0)

    def seen(material: AbstractMaterial) -> Tensor:
        parts = [material(lamps, eye, n.unsqueeze(1))[..., 0] for n in normal.split(block)]
        return math.pi * cosine * torch.cat(parts)

    return torch.stack([seen(material) for material in materials])


def recorded(predicted: Tensor, ceiling: Tensor | None) -> Tensor:
    """What a camera of 8 bits records of it; the ceiling, `lamp`, is its largest value."""
    # counts 0 and 255 stand for the middles of their intervals: 0.5 and 255.5
    return predicted if ceiling is None else predicted.clamp(ceiling / 511, ceiling)


def fit_object(
    responses: Responses, seen: Tensor, ceiling: Tensor | None = None, rounds: int = 8
) -> ReflectanceFit:
    """One set of weights, and an albedo for each pixel.

    Args:
        responses: of the photographs.
        seen: I, `pixel lamp`.
        ceiling: largest I that the camera can record, `lamp`; None: there is none.
        rounds: of weights and albedos in turns.
    """
    kinds = len(responses.diffuse)
    matt = responses.diffuse[0]
    albedo = (matt * seen).sum(1) / (matt * matt).sum(1).clamp(min=DIM**2)
    none = seen.new_zeros(len(responses.specular))
    fit = ReflectanceFit(albedo, torch.eye(kinds).to(seen)[0], none)
    used = torch.ones_like(seen)
    some = slice(None, None, 1 + len(seen) // SOME)
    for _ in range(rounds):
        found = _shared_weights(responses.at(some), seen[some], used[some], fit, some)
        fit = ReflectanceFit(fit.albedo, found[:kinds] / found[:kinds].sum(), found[kinds:])
        matt, shine = fit.parts(responses)
        sure = used * _certainty(seen - fit.predict(responses), shine)
        # an albedo that no lamp shows is 0
        shown = (sure * matt * matt).sum(1).clamp(min=DIM**2)
        albedo = (sure * matt * (seen - shine)).sum(1) / shown
        fit = replace(fit, albedo=albedo.clamp(min=0))
        used = _telling(fit.predict(responses), seen, ceiling)
    return fit


def fit_pixels(
    responses: Responses, seen: Tensor, ceiling: Tensor, fit: ReflectanceFit, share: float
) -> Tensor:
    """Weights of each pixel, `pixel column`, drawn to those of its object.

    Args:
        responses, seen, ceiling: as of `fit_object`.
        fit: of the object.
        share: tau; 0: the object's own weights.
    """
    mean = fit.weights()
    if share == 0:
        return mean
    predicted = fit.predict(responses)
    used = _telling(predicted, seen, ceiling)
    noise = (used * (predicted - seen)).square().mean()
    used = used * _certainty(predicted - seen, fit.parts(responses)[1])
    fresh = guarded_divide(
        FRESH * predicted.mean(1, keepdim=True), responses.columns().amax((1, 2))
    )
    trust = noise / (share * (mean + fresh)).clamp(min=DIM**2).square()
    found = []
    for start in range(0, len(seen), BLOCK):
        block = slice(start, start + BLOCK)
        table = responses.at(block).columns().permute(1, 2, 0)
        held = (table * used[block].unsqueeze(-1)).mT
        right = (held @ seen[block].unsqueeze(-1)).squeeze(-1) + trust[block] * mean[block]
        gram = held @ table + torch.diag_embed(trust[block])
        found.append(non_negative(gram, right, mean[block], 40))
    return torch.cat(found)


def predict_pixels(responses: Responses, weights: Tensor, ceiling: Tensor) -> Tensor:
    """I, `pixel lamp`, of weights `pixel column`."""
    return recorded(torch.einsum("pk,kpn->pn", weights, responses.columns()), ceiling)


def chosen_share(responses: Responses, seen: Tensor, ceiling: Tensor) -> float:
    """tau with which two thirds of the photographs predict the others best."""
    some = slice(None, None, 1 + len(seen) // FEW)
    part, seen = responses.at(some), seen[some]
    third = torch.arange(seen.shape[1]) % 3
    errors = torch.zeros(len(SHARES))
    for left_out in range(3):
        here, there = third != left_out, third == left_out
        known = part.under(here), seen[:, here], ceiling[here]
        fit = fit_object(*known)
        for k, share in enumerate(SHARES):
            weights = fit_pixels(*known, fit, share)
            predicted = predict_pixels(part.under(there), weights, ceiling[there])
            errors[k] += (predicted - seen[:, there]).square().sum()
    return SHARES[int(errors.argmin())]


def non_negative(gram: Tensor, right: Tensor, start: Tensor, sweeps: int) -> Tensor:
    """x >= 0 that minimises x G x / 2 - b x, `*batch column`, by descent along one axis a time."""
    found, rest = start.clone(), right - (gram @ start.unsqueeze(-1)).squeeze(-1)
    diagonal = gram.diagonal(dim1=-2, dim2=-1)
    for _ in range(sweeps):
        for k in range(right.shape[-1]):
            step = guarded_divide(rest[..., k], diagonal[..., k])
            moved = (found[..., k] + step).clamp(min=0)
            rest -= (moved - found[..., k]).unsqueeze(-1) * gram[..., k]
            found[..., k] = moved
    return found


def _shared_weights(
    responses: Responses, seen: Tensor, used: Tensor, fit: ReflectanceFit, some: slice
) -> Tensor:
    """Weights of the object, whatever the albedos: those follow."""
    albedo, held = fit.albedo[some], torch.cat((fit.diffuse, fit.specular)).double()
    table = torch.cat((albedo.unsqueeze(1) * responses.diffuse, responses.specular)) * used
    # what albedos can undo, or nothing shows, stays as it is: a weak pull to where weights are
    energy = table.double().square().sum((1, 2))
    pull = 1e-4 * energy.clamp(min=1e-3 * float(energy[0]))
    along = functional.normalize(used * fit.parts(responses)[0], dim=1)
    table = table - (table * along).sum(2, keepdim=True) * along
    rest = used * seen
    rest = rest - (rest * along).sum(1, keepdim=True) * along
    table, rest = table.flatten(1).double(), rest.flatten().double()
    gram = table @ table.T + torch.diag(pull)
    return non_negative(gram, table @ rest + pull * held, held, 100).to(seen)


def _certainty(error: Tensor, shine: Tensor) -> Tensor:
    """Of what a pixel shows besides its highlights, which are off by a share of themselves."""
    usual = error.square().mean()
    return guarded_divide(usual, usual + (DOUBT * shine).square(), 1.0)


def _telling(predicted: Tensor, seen: Tensor, ceiling: Tensor | None) -> Tensor:
    """1, or 0 where a photograph at the ceiling is as predicted: brighter than it can tell."""
    if ceiling is None:
        return torch.ones_like(seen)
    return (~((seen >= 0.99 * ceiling) & (predicted >= seen))).to(seen)
