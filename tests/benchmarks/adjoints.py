"""What a gradient through a solve costs: `python -m tests.benchmarks.adjoints`.

A closed room with a random albedo up to 0.9 in three channels; gradients for albedo, exitance
and all form factors. Baselines in the same run: the forward solve alone, and the unrolled
Neumann series (the same number of products forward). Memory is what the graph keeps besides
the form factors themselves. Error is that of the gradients against a dense LU solve, largest
of the three, relative to the largest entry. Median and spread (interquartile range), ms.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from statistics import quantiles

import torch
from torch import Tensor
from torch.autograd.graph import saved_tensors_hooks

from tests.solve.rooms import room
from torchradiometry import solve

Way = tuple[str, solve.AbstractSolver, solve.AbstractAdjoint]


def ways() -> list[Way]:
    unrolled, implicit = solve.Unrolled(), solve.Implicit()
    return [
        *((f"Neumann({n}), Unrolled", solve.Neumann(n), unrolled) for n in (10, 40, 160)),
        ("Neumann(160), Unrolled(checkpoint=13)", solve.Neumann(160), solve.Unrolled(13)),
        *((f"Neumann({n}), Implicit", solve.Neumann(n), implicit) for n in (10, 40, 160)),
        ("ConjugateGradient, Implicit", solve.ConjugateGradient(), implicit),
        ("ConjugateGradient(1e-6), Implicit", solve.ConjugateGradient(1e-6), implicit),
        ("ConjugateGradient, Truncated(10)", solve.ConjugateGradient(), solve.Truncated(10)),
        ("GaussSeidel(1e-6), Implicit", solve.GaussSeidel(1e-6), implicit),
        ("Southwell(1e-6), Implicit", solve.Southwell(1e-6), implicit),
    ]  # fmt: skip


def solved(way: Way, tensors: tuple[Tensor, ...], area: Tensor) -> Tensor:
    albedo, exitance, factors = tensors
    operator = solve.DenseOperator(factors, area)
    return solve.solve_radiosity(operator, albedo, exitance, way[1], way[2]).radiosity


def measured(calls: list[Callable[[], object]], repeats: int) -> tuple[float, float]:
    """Median and interquartile range in ms of the last of two calls that follow each other."""
    times = []
    for _ in range(repeats + 1):
        state: object = None
        for call in calls:
            began = time.perf_counter()
            state = call() if state is None else call(state)  # type: ignore[call-arg]
        times.append(1e3 * (time.perf_counter() - began))
    low, median, high = quantiles(times[1:], n=4)
    return median, high - low


def kept(way: Way, tensors: tuple[Tensor, ...], area: Tensor) -> float:
    """MB that the graph keeps besides the form factors."""
    sizes: dict[int, int] = {}

    def pack(tensor: Tensor) -> Tensor:
        storage = tensor.untyped_storage()
        sizes[storage.data_ptr()] = storage.nbytes()
        return tensor

    with saved_tensors_hooks(pack, lambda tensor: tensor):
        _ = solved(way, tensors, area)
    sizes.pop(tensors[2].untyped_storage().data_ptr(), None)
    return sum(sizes.values()) / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--patches", type=int, default=1000)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--json", help="write the rows to this file too")
    arguments = parser.parse_args()
    generator = torch.Generator().manual_seed(0)
    operator = room("closed", arguments.patches, torch.float64)
    shape = (arguments.patches, 3)
    albedo = torch.rand(shape, dtype=torch.float64, generator=generator) * 0.9
    exitance = torch.rand(shape, dtype=torch.float64, generator=generator) ** 8
    weight = torch.rand(shape, dtype=torch.float64, generator=generator)
    tensors = tuple(t.requires_grad_() for t in (albedo, exitance, operator.form_factors))
    assert operator.area is not None
    area = operator.area

    def backward(radiosity: Tensor) -> tuple[Tensor, ...]:
        return torch.autograd.grad((radiosity * weight).sum(), tensors)

    exact = backward(solved(("", solve.Direct(), solve.Unrolled()), tensors, area))
    rows = []
    print(
        "| solver, adjoint | forward, ms | backward, ms | backward / forward | kept, MB | error |"
    )
    print("|" + "---|" * 6)
    for way in ways():
        forward = lambda way=way: solved(way, tensors, area)  # noqa: E731
        with torch.no_grad():
            alone = measured([forward], arguments.repeats)
        gradient = measured([forward, backward], arguments.repeats)
        pairs = zip(backward(forward()), exact, strict=True)
        error = max(float((a - b).abs().max() / b.abs().max()) for a, b in pairs)
        row = (way[0], *alone, *gradient, gradient[0] / alone[0], kept(way, tensors, area), error)
        rows.append(row)
        print("| {} | {:.1f} ({:.1f}) | {:.1f} ({:.1f}) | {:.2f} | {:.2f} | {:.0e} |".format(*row))
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(rows, file)


if __name__ == "__main__":
    main()
