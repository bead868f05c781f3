"""One training on several processes: each takes its share of every batch.

    gradient = (1/P) sum over processes p of  P (w_p / sum of w) gradient of mean loss_p
             = gradient of the mean loss over the whole batch

with w_p what process p's mean is over (its pixels). `torchrun` starts the processes and says in
the environment which is which; the data of step k are the same on each, which keeps every P-th
item of the batch, so the result is that of one process up to rounding. Process 0 writes.

References: S. Li et al., "PyTorch Distributed: experiences on accelerating data parallel
training", VLDB 2020.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor, distributed

from torchradiometry.errors import OutOfRangeError

__all__ = ["ALONE", "Processes", "joined_processes", "started_together"]

B = TypeVar("B", bound=tuple[Tensor, ...])


@dataclass(frozen=True)
class Processes:
    """Which of how many processes this one is.

    Attributes:
        rank: 0 for the one that writes.
        count: how many there are.
    """

    rank: int
    count: int

    @property
    def writes(self) -> bool:
        """Whether this process reports, and writes the files."""
        return self.rank == 0

    def share(self, batch: B) -> B:
        """Every count-th item of a batch (a named tuple whose tensors begin with the items).

        Raises:
            OutOfRangeError: fewer items than processes.

        >>> from torchradiometry.learn.samples.single_images import SingleImages
        >>> four = torch.arange(4.0)
        >>> Processes(1, 2).share(SingleImages(*(four for _ in SingleImages._fields)))[0]
        tensor([1., 3.])
        """
        if self.count == 1:
            return batch
        if len(batch[0]) < self.count:
            raise OutOfRangeError(
                "the batch", f"{len(batch[0])} items for {self.count} processes", "enlarge it"
            )
        return type(batch)(*(part[self.rank :: self.count] for part in batch))

    def total(self, values: Tensor) -> Tensor:
        """The sum over all processes, the same on each."""
        if self.count > 1:
            distributed.all_reduce(values)
        return values


ALONE = Processes(0, 1)


def started_together() -> Processes:
    """What `torchrun` said in the environment; `ALONE` without it."""
    environment = os.environ
    if "RANK" not in environment or "WORLD_SIZE" not in environment:
        return ALONE
    return Processes(int(environment["RANK"]), int(environment["WORLD_SIZE"]))


@contextmanager
def joined_processes(device: torch.device) -> Iterator[Processes]:
    """The processes that were started together, connected inside the block.

    Args:
        device: what they compute on; gloo connects processors, nccl graphics cards.
    """
    processes = started_together()
    if processes.count == 1:
        yield processes
        return
    distributed.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield processes
    finally:
        distributed.destroy_process_group()
