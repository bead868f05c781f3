"""F of a large scene: clusters of patches that exchange light through a few numbers a pair.

    H x = S (U K U^T + N) S x

    up       m_I = sum of U^T x over the members      from the leaves to the root
    across   y_I = sum over links (I, J) of K m_J,  and K^T the other way
    down     the transpose of up, from the root to the leaves
    near     N: entries of single pairs;   S: diagonal, closes an enclosure

Each cluster has three nodes; light that varies linearly over a cluster passes up and down
unchanged. H is symmetric by construction. A product costs as many multiplications as there are
patches, links and near pairs, times a small constant.

References: P. Hanrahan, D. Salzman and L. Aupperle, "A Rapid Hierarchical Radiosity
Algorithm", SIGGRAPH 1991 (push and pull); W. Hackbusch and S. Boerm, Appl. Numer. Math. 43
(2002) (nested bases).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from torchradiometry.errors import ShapeError
from torchradiometry.solve.operators import AbstractOperator

if TYPE_CHECKING:
    from jaxtyping import Float, Int

__all__ = ["HierarchicalOperator"]

#: links that one step of a product holds
BLOCK = 2**19


@final
class HierarchicalOperator(AbstractOperator):
    """F through a tree of clusters; `hierarchical_operator` makes one from patches.

    Args:
        area: of the patches, m2 (what F refers to; the exposed part).
        full_area: of the patches, m2 (what the links refer to).
        leaf: cluster of each patch.
        parent: of each cluster, -1 of the root.
        levels: first cluster of each level, root first, and the number of clusters at the end.
        transfer: share of the parent's nodes (last) at the nodes of each cluster.
        first, second, kernel: links and their K, 1/m2; each stands for both directions.
        near_first, near_second, near_exchange: pairs of patches and their H, m2, likewise.
        scale: diagonal of S.

    Differentiable in: area, transfer, kernel, near_exchange, scale.
    Export: no, trees have as many shapes as scenes.

    >>> one = torch.ones(1)  # two patches, each a leaf under the root, linked directly
    >>> share = torch.full((3, 3, 3), 1 / 3)
    >>> leaf, none = torch.tensor([1, 2]), torch.zeros(0, dtype=torch.int64)
    >>> F = HierarchicalOperator(
    ...     area=torch.ones(2), full_area=torch.ones(2), leaf=leaf,
    ...     parent=torch.tensor([-1, 0, 0]), levels=(0, 1, 3), transfer=share,
    ...     first=leaf[:1], second=leaf[1:], kernel=torch.full((1, 3, 3), 0.2),
    ...     near_first=none, near_second=none, near_exchange=one[:0], scale=torch.ones(2))
    >>> F(torch.tensor([[1.0], [0.0]])).T
    tensor([[0.0000, 0.2000]])
    """

    area: Float[Tensor, "patch"]

    def __init__(
        self,
        *,
        area: Float[Tensor, "patch"],
        full_area: Float[Tensor, "patch"],
        leaf: Int[Tensor, "patch"],
        parent: Int[Tensor, "cluster"],
        levels: tuple[int, ...],
        transfer: Float[Tensor, "cluster 3 3"],
        first: Int[Tensor, "link"],
        second: Int[Tensor, "link"],
        kernel: Float[Tensor, "link 3 3"],
        near_first: Int[Tensor, "near"],
        near_second: Int[Tensor, "near"],
        near_exchange: Float[Tensor, "near"],
        scale: Float[Tensor, "patch"],
    ) -> None:
        self.area, self.full_area, self.scale = area, full_area, scale
        self.leaf, self.parent, self.levels, self.transfer = leaf, parent, levels, transfer
        self.first, self.second, self.kernel = first, second, kernel
        self.near_first, self.near_second = near_first, near_second
        self.near_exchange = near_exchange

    def exchange(
        self, x: Float[Tensor, "*batch patch channel"]
    ) -> Float[Tensor, "*batch patch channel"]:
        if x.ndim < 2 or x.shape[-2] != len(self.area):
            got = f"shape {tuple(x.shape)}"
            raise ShapeError("x", got, f"pass `patch channel` with {len(self.area)} patches")
        rows = x.to(self.area.dtype).movedim(-2, 0)
        flat = self.scale.unsqueeze(-1) * rows.reshape(len(rows), -1)
        found = self._linked(flat) + self._near(flat)
        return (self.scale.unsqueeze(-1) * found).reshape(rows.shape).movedim(0, -2)

    def _near(self, x: Tensor) -> Float[Tensor, "patch column"]:
        found = torch.zeros_like(x)
        value = self.near_exchange.unsqueeze(-1)
        for here, there in (
            (self.near_first, self.near_second),
            (self.near_second, self.near_first),
        ):
            found = found.index_add(0, here, value * x[there])
        return found

    def _linked(self, x: Tensor) -> Float[Tensor, "patch column"]:
        nodes = self.transfer.shape[-1]
        sent = (self.full_area.unsqueeze(-1) * x / nodes).unsqueeze(1).expand(-1, nodes, -1)
        arriving = self._down(self._across(self._up(sent)))
        return self.full_area.unsqueeze(-1) * arriving.mean(1)

    def _up(self, sent: Tensor) -> list[Tensor]:
        """Moments of the clusters of each level, root first."""
        moments = sent.new_zeros(self.levels[-1], *sent.shape[1:]).index_copy(0, self.leaf, sent)
        found = list(moments.split([b - a for a, b in self._bounds()]))
        for number in range(len(found) - 1, 0, -1):
            parent, transfer = self._above(number)
            found[number - 1] = found[number - 1].index_add(0, parent, transfer.mT @ found[number])
        return found

    def _across(self, moments: list[Tensor]) -> Float[Tensor, "cluster node column"]:
        sent = torch.cat(moments) if moments else self.transfer.new_zeros(0, 3, 1)
        found = torch.zeros_like(sent)
        blocks = (t.split(BLOCK) for t in (self.first, self.second, self.kernel))
        for here, there, kernel in zip(*blocks, strict=True):
            found = found.index_add(0, here, kernel @ sent[there])
            found = found.index_add(0, there, kernel.mT @ sent[here])
        return found

    def _down(self, arriving: Tensor) -> Float[Tensor, "patch node column"]:
        levels = list(arriving.split([b - a for a, b in self._bounds()]))
        for number in range(1, len(levels)):
            parent, transfer = self._above(number)
            levels[number] = levels[number] + transfer @ levels[number - 1][parent]
        return torch.cat(levels)[self.leaf] if levels else arriving

    def _bounds(self) -> list[tuple[int, int]]:
        return list(zip(self.levels[:-1], self.levels[1:], strict=True))

    def _above(self, number: int) -> tuple[Tensor, Tensor]:
        """Parents of the clusters of a level, counted from the level above, and transfers."""
        level = slice(self.levels[number], self.levels[number + 1])
        return self.parent[level] - self.levels[number - 1], self.transfer[level]
