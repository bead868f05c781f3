"""The baselines of the benchmarks compute what the layers compute."""

import torch

from tests.benchmarks.layers import cases, rows


def test_plain_formulas_equal_the_layers() -> None:
    for ways, read in cases(1, 4, 5).values():
        torch.testing.assert_close(ways["layer"](*read), ways["plain formula"](*read))


def test_every_row_has_a_time() -> None:
    table = rows((1, 4, 5), 3)
    assert len(table) == 10
    assert all(row["median_ms"] > 0 for row in table)
