"""One training step: the answer of a network, its loss, its degrees, and the update.

    theta_{k+1} = AdamW(theta_k, gradient of the loss of network(batch_k)),
    loss = chord_loss(normals)    or    chord_loss(normals) + albedo_loss(paint) / 10
    rate_k = rate * min(1, k/warm) * (1 + cos(pi k / steps)) / 2

With `bfloat16` the matrix products of the perceptron and the convolutions round to 8 bits of
mantissa; weights, updates, the least-squares normal, the observation map and the loss keep 24.

References: I. Loshchilov and F. Hutter, "Decoupled weight decay regularization", ICLR 2019,
and "SGDR", ICLR 2017 (the cosine); D. Kalamkar et al., "A study of BFLOAT16 for deep learning
training", arXiv 1905.12322 (2019).
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias, final

import torch
from torch import Tensor, nn

from torchradiometry.learn.losses import albedo_loss, angle_degrees, chord_loss
from torchradiometry.learn.networks import PhotometricNetwork, relative_to_mean
from torchradiometry.learn.samples.images import Observations
from torchradiometry.learn.samples.single_images import SingleImages
from torchradiometry.learn.training.processes import Processes
from torchradiometry.learn.training.settings import Training

__all__ = ["Batch", "Score", "Scored", "set_rate", "take_step"]

#: what the albedo counts beside the normals
PAINT = 0.1

Batch: TypeAlias = Observations | SingleImages


class Score(NamedTuple):
    """How well a network did on a batch.

    Attributes:
        loss: what is minimised.
        degrees: mean angle.
        weight: what both are means over: how many pixels.
    """

    loss: Tensor
    degrees: Tensor
    weight: Tensor


@final
class Scored(nn.Module):
    """A network and its loss as one module, so that processes can average its gradients.

    Args:
        network: of either kind.
        bfloat16: round matrix products.
    """

    def __init__(self, network: nn.Module, bfloat16: bool = False) -> None:
        super().__init__()
        self.network, self.rounds = network, bfloat16

    def forward(self, batch: Batch) -> Score:
        found, truth, weight, besides = self._answer(batch)
        found = found.to(truth.dtype)
        with torch.no_grad():
            angle = angle_degrees(found.detach(), truth)
            counted = torch.ones_like(angle) if weight is None else weight
            total = counted.sum()
            mean = angle.mean() if weight is None else (angle * weight).sum() / total
        return Score(chord_loss(found, truth, weight) + besides, mean, total)

    def _answer(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor | None, Tensor | float]:
        """Found and true normals with the vector last, weights of pixels, and other losses."""
        rounded = torch.autocast(batch.normal.device.type, torch.bfloat16, self.rounds)
        if isinstance(batch, Observations):
            assert isinstance(self.network, PhotometricNetwork)
            described = self.network.describe(batch.intensity, batch.direction)
            with rounded:
                return self.network.interpret(*described), batch.normal, None, 0.0
        with rounded:
            found, paint = self.network(batch.image, batch.mask)
        truth = relative_to_mean(batch.albedo, batch.mask)
        besides = PAINT * albedo_loss(paint.to(truth.dtype), truth, batch.mask)
        weight = batch.mask.squeeze(1)
        return found.movedim(1, -1), batch.normal.movedim(1, -1), weight, besides


def take_step(
    scored: nn.Module, optimizer: torch.optim.Optimizer, batch: Batch, processes: Processes
) -> tuple[float, float]:
    """One update; the loss and the mean angle before it, over the batches of all processes."""
    scored.train()
    score = scored(batch)
    sums = torch.stack([score.loss.detach(), score.degrees, torch.ones_like(score.loss)])
    loss, degrees, weight = processes.total(sums * score.weight).unbind()
    optimizer.zero_grad(set_to_none=True)
    share = processes.count * score.weight / weight  # exactly 1 for a process alone
    torch.autograd.backward(score.loss * share)
    nn.utils.clip_grad_norm_(scored.parameters(), 1.0)
    optimizer.step()
    return float(loss / weight), float(degrees / weight)


def set_rate(optimizer: torch.optim.Optimizer, training: Training, step: int) -> None:
    """A warm start over a tenth of the steps (at most 100), then half a cosine down to 0."""
    warm = min(1.0, (step + 1) / min(100, max(1, training.steps // 10)))
    falling = (1 + math.cos(math.pi * step / training.steps)) / 2
    for group in optimizer.param_groups:
        group["lr"] = training.rate * warm * falling
