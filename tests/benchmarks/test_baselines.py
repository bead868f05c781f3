"""The baselines of the benchmarks compute what the layers compute."""

import torch

from tests.benchmarks import concave_reliefs, operators, unoccluded
from tests.benchmarks.layers import cases, lobe_errors, rows
from torchradiometry import UnoccludedFormFactors, cornell_like_room


def test_plain_formulas_equal_the_layers() -> None:
    for ways, read in cases(1, 4, 5).values():
        torch.testing.assert_close(ways["layer"](*read), ways["plain formula"](*read))


def test_every_row_has_a_time() -> None:
    table = rows((1, 4, 5), 3, compiled=False)
    assert len(table) == 10
    assert all(row["median_ms"] > 0 for row in table)


def test_the_layer_keeps_the_digits_of_a_highlight_that_the_plain_formula_loses() -> None:
    found = lobe_errors(1e3)
    assert found["layer"] < 2e-7 < 1e-5 < found["plain formula"]


def test_pairs_of_triangles_as_they_stand_in_meshes_keep_six_digits() -> None:
    layer = UnoccludedFormFactors()
    assert unoccluded.cube_errors(layer)[0].max() < 1e-11
    pairs = unoccluded.kinds(60)["share an edge, fair, 30 to 150 degrees"]
    relative, _ = unoccluded.errors(*pairs, layer)
    assert len(relative) > 10
    assert relative.max() < 1e-6


def test_a_relief_is_found_by_its_reflected_light_with_its_albedo_unknown() -> None:
    groove = concave_reliefs.CASES["groove, 0.6"]
    local, full, local_unknown, full_unknown = concave_reliefs.errors(*groove, 12, 20)
    assert full < local / 2
    assert full_unknown < local_unknown / 2


def test_a_matrix_and_a_tree_stand_in_rows_of_the_same_patches() -> None:
    found = operators.rows("room", cornell_like_room(), 2.0)
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in found]
    assert [row[2] for row in cells] == ["matrix", "tree"]
    assert cells[0][1] == cells[1][1]
    assert all(float(row[-1].rstrip(" %")) < 5 for row in cells)
