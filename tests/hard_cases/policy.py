"""What the bank may find that is neither the true value nor a named error, with its reason.

Everything else that is not finite, or finite and wrong, fails a test.
"""

from __future__ import annotations

from fnmatch import fnmatch
from typing import NamedTuple


class Named(NamedTuple):
    """An outcome that is documented.

    Attributes:
        kind: name of the kind, or a pattern.
        member: `family-name`, or a pattern.
        word: in the table.
        reason: why it is so, and what to do.
    """

    kind: str
    member: str
    word: str
    reason: str


# fmt: off
NAMED = [
    Named("*depth*", "layer-depth_to_points*", "NaN there", "the point of a pixel that sees nothing is NaN, as its depth; its gradient is 0 and no other pixel is touched"),
    Named("focal length 0", "layer-*", "NaN", "a pinhole of focal length 0 has no rays; intrinsics are values, which no layer reads: check them where they are made"),
    Named("normals of length 1e-3", "*original*phong*", "0", "in float16 a cosine below 0.008 (0.4 degrees, or a normal far from unit) counts as below the horizon, because 1/cos^2 is no number of float16"),
    Named("albedo 1", "solver-*", "unbounded", "a closed room that absorbs nothing has no solution: solvers that promise one raise SingularSystemError, the others return their sum of bounces with Status.UNBOUNDED and an infinite bound"),
    Named("albedo 1", "adjoint-*", "unbounded", "the same"),
    Named("an argument times -1", "function-materials.mean_lobe_reflectance", "pole", "the formula has poles at negative shininess; materials refuse it when they are built"),
    Named("* times 2^40", "function-transport.visible_*", "margin", "a polygon of 2^40 beside faces of size 1: what is closer to a face than 256 roundings of the largest coordinate does not see it; pass `margin`"),
    Named("easy", "function-solve.inverse_norm", "bound", "a bound that counts the roundings of its dtype in: larger in fewer digits"),
    Named("*argument*", "function-solve.inverse_norm", "bound", "the same"),
    Named("all arguments times 1024", "function-solve.ambient_tail", "beyond", "an albedo of a thousand: parts of a solver compute on, float16 ends at 65504; `solve_radiosity` refuses such an albedo"),
    Named("all arguments times 1024", "function-solve.*_series", "beyond", "the same"),
    Named("all arguments times 2^40", "function-solve.*_series", "beyond", "an albedo of 1e12, to the third power: the same in float32"),
    Named("an argument times 2^*", "function-learn.chord_loss", "values", "lengths of 2^40 beside 1: the weights' gradient is a difference of nearly equal chords; normals are unit"),
    Named("* in one entry", "function-learn.integrability_loss", "NaN", "one mean over all pixels: what is not finite in the mask reaches all of them"),
    Named("scene times 2^40", "layer-depth_to_normals_parallel", "values", "at slopes of 1e13 the gradients of neighbours cancel in float32: right to 2e-4 of the largest"),
]
# fmt: on


def named(kind: str, member: str) -> Named | None:
    """The documented outcome of a member under a kind, if there is one."""
    return next((n for n in NAMED if fnmatch(kind, n.kind) and fnmatch(member, n.member)), None)
