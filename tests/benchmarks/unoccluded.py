"""How exact the exportable form factors are: `python -m tests.benchmarks.unoccluded`.

`UnoccludedFormFactors` gives every pair the same points; here pairs of random triangles, each
turned both ways, are held against `polygon_exchange` to 1e-12 (a random triangle has its corners
in the unit cube; a fair one is at least 0.3 times as high as long). Relative errors of A F, and
the worst error of F seen from the smaller triangle, of pairs with F > 1e-9. First, the memory
that 108 triangles take.
"""

from __future__ import annotations

import argparse
import resource
from collections.abc import Callable

import torch
from torch import Tensor

from tests.benchmarks.form_factors import cube
from torchradiometry import Patches, UnoccludedFormFactors, polygon_exchange

#: F below which rounding decides whether a pair sees anything
LEAST = 1e-9
#: pairs that one product of the graph holds
BLOCK = 256
FAIR, STEEP = 0.3, 0.5


def triangles(count: int, generator: torch.Generator) -> Tensor:
    return torch.rand(count, 3, 3, generator=generator, dtype=torch.float64)


def normal(corners: Tensor) -> Tensor:
    a, b, c = corners.unbind(1)
    return torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1)


def fair(corners: Tensor) -> Tensor:
    longest = (corners.roll(-1, 1) - corners).norm(dim=-1).amax(-1)
    return 2 * Patches(corners).area > FAIR * longest.square()


def enters(first: Tensor, second: Tensor) -> Tensor:
    """Whether an edge of the first triangle passes through the second."""
    up = normal(second)
    start, end = first, first.roll(-1, 1)
    low, high = (((t - second[:, :1]) * up.unsqueeze(1)).sum(-1) for t in (start, end))
    place = start + (low / (low - high)).unsqueeze(-1) * (end - start)
    found = low * high < 0
    for a, b in zip(second.unbind(1), second.roll(-1, 1).unbind(1), strict=True):
        side = (b - a).unsqueeze(1).expand_as(place)
        turn = torch.linalg.cross(side, place - a.unsqueeze(1))
        found = found & ((turn * up.unsqueeze(1)).sum(-1) > 0)
    return found.any(-1)


def pierce(first: Tensor, second: Tensor) -> Tensor:
    return enters(first, second) | enters(second, first)


def steep(first: Tensor, second: Tensor) -> Tensor:
    """At least 30 degrees between the planes."""
    return (normal(first) * normal(second)).sum(-1).abs() < (1 - STEEP**2) ** 0.5


def moved(first: Tensor, second: Tensor, share: Tensor) -> tuple[Tensor, Tensor]:
    """A corner of the second triangle at the mixture `share` of the first one's corners."""
    place = (share.unsqueeze(-1) * first).sum(1, keepdim=True)
    return first, second - second[:, :1] + place


def kinds(count: int) -> dict[str, tuple[Tensor, Tensor]]:
    """Name -> pairs of triangles."""
    generator = torch.Generator().manual_seed(0)
    a, b = triangles(count, generator), triangles(count, generator)
    edge = torch.stack((a[:, 0], a[:, 1], b[:, 2]), 1)
    corner = torch.stack((a[:, 0], b[:, 1], b[:, 2]), 1)
    share = torch.rand(count, 3, generator=generator, dtype=torch.float64)
    share = share / share.sum(1, keepdim=True)
    beside = torch.stack((share[:, 0], 1 - share[:, 0], torch.zeros_like(share[:, 0])), 1)
    along = torch.stack((share[:, 0], 2 - share[:, 1]), 1).unsqueeze(-1)
    ends = a[:, :1] + along * (a[:, 1:2] - a[:, :1])
    gap = 10 ** torch.empty(count, 1, dtype=torch.float64).uniform_(-2, 0, generator=generator)
    above = a + (gap * normal(a)).unsqueeze(1)
    within, apart = pierce(a, b), ~pierce(a, corner)
    in_mesh = fair(a) & fair(edge) & steep(a, edge)
    return {
        "share an edge, fair, 30 to 150 degrees": (a[in_mesh], edge[in_mesh]),
        "share an edge": (a, edge),
        "share a corner": (a[apart], corner[apart]),
        "near each other": (a[~within], b[~within]),
        "one above the other, 0.01 to 1 apart": (a, above),
        "share a corner and pierce each other": (a[~apart], corner[~apart]),
        "pierce each other": (a[within], b[within]),
        "an edge on a part of the other's": (a, torch.cat((ends, b[:, 2:]), 1)),
        "a corner on an edge": moved(a, b, beside),
        "a corner on a face": moved(a, b, share),
    }


def both_ways(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    turned = [(a, b) for a in (first, first.flip(1)) for b in (second, second.flip(1))]
    return torch.cat([a for a, _ in turned]), torch.cat([b for _, b in turned])


def errors(first: Tensor, second: Tensor, layer: UnoccludedFormFactors) -> tuple[Tensor, Tensor]:
    """Relative errors, and errors of F from the smaller triangle, of pairs that see each other."""
    first, second = both_ways(first, second)
    pairs = torch.stack((first, second), 1).split(BLOCK)
    graph: Callable[[Tensor], Tensor] = torch.vmap(lambda corners: layer(corners)[0, 1])
    found = torch.cat([graph(block) for block in pairs]) * Patches(first).area
    exact = polygon_exchange(first, second, rtol=1e-12)
    smaller = torch.minimum(Patches(first).area, Patches(second).area)
    seen = exact > LEAST * smaller
    off = (found - exact).abs()[seen]
    return off / exact[seen], off / smaller[seen]


def cube_triangles(parts: int) -> Tensor:
    """Of a cube with `parts` x `parts` squares on each face."""
    squares = cube(parts).corners
    return torch.cat((squares[:, (0, 1, 2)], squares[:, (0, 2, 3)]))


def cube_errors(layer: UnoccludedFormFactors) -> tuple[Tensor, Tensor]:
    """Of the triangles of a cube, two on a face."""
    corners = cube_triangles(1)
    i, j = torch.triu_indices(len(corners), len(corners), 1)
    exact = polygon_exchange(corners[i], corners[j], rtol=1e-12)
    seen, area = exact > 0, Patches(corners).area[i]
    off = (layer(corners)[i, j] * area - exact).abs()[seen]
    return off / exact[seen], off / area[seen]


def memory(layer: UnoccludedFormFactors, corners: Tensor) -> float:
    """GiB that are added to the peak of this process."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    layer(corners)
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 2**20


def row(name: str, relative: Tensor, absolute: Tensor) -> str:
    found = [relative.median(), relative.quantile(0.99), relative.max(), absolute.max()]
    return f"| {name} | {len(relative)} | " + " | ".join(f"{float(x):.0e}" for x in found) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=2000)
    options = parser.parse_args()
    layer = UnoccludedFormFactors()
    many = cube_triangles(3)
    print(f"{len(many)} triangles take {memory(layer, many):.1f} GiB\n")
    print(
        "| two triangles | pairs | median | 99 % | worst | worst of F |\n|---|---|---|---|---|---|"
    )
    print(row("of a cube", *cube_errors(layer)))
    for name, pairs in kinds(options.pairs).items():
        print(row(name, *errors(*pairs, layer)), flush=True)


if __name__ == "__main__":
    main()
