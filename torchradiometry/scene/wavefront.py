"""The text of an `.obj` and of its `.mtl`, put so that trimesh loses nothing of it in silence.

trimesh drops lines that are indented or written with tabs, counts relative corners from the end of
the file, reads the first `mtllib` alone, paints a mesh grey that has texture coordinates and no
picture, gives up every material for one line it does not understand, and cuts each face into a
fan, right for convex ones:

    v x y z    vt u v    f v/vt/vn v/vt/vn v/vt/vn ...    mtllib FILE    usemtl NAME
    newmtl NAME    Kd r g b (0..1; one number stands for three)    map_Kd FILE

References: Wavefront Technologies, *Advanced Visualizer*, appendices B1 and B2 (1992).
"""

from __future__ import annotations

import math
import re
import warnings
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchradiometry.errors import FileFormatError, ResourceLimitError

__all__ = ["as_utf8", "material_names", "tidied_materials", "tidied_mesh"]

#: materials by name in one file; the time to take them apart grows with their square
MAX_MATERIALS = 2**12
#: what a face may lose of its area, or count twice, where its corners turn back
CONCAVITY = 1e-5
#: faces that are looked at together
AT_ONCE = 2**16

# each line follows a line feed, which is found several times faster than the start of a line
INDENT = re.compile(rb"\n ")
COMMENT = re.compile(rb"\n#[^\n]*")
REMARK = re.compile(rb"(\n(?:v|vt|vn|f) [^#\n]*)#[^\n]*")
LIBRARY = re.compile(rb"\nmtllib([^\n]*)")
USED = re.compile(rb"\nusemtl ([^\n]*)")
COORDINATES = re.compile(rb"\nvt [^\n]*")
VERTEX = re.compile(rb"\nv ([^ \n]+ [^ \n]+ [^ \n]+)")
SHORT = re.compile(rb"\nf(?! [^ \n]+ [^ \n]+ [^ \n])(?=[ \n])[^\n]*")
BEFORE_FIRST = re.compile(rb"\nf[^\n]* (?:0+(?![^ /\n])|-)[^\n]*")
RELATIVE = re.compile(rb"\nf[^\n]*[ /]-\d")
COUNTED = re.compile(rb"\n(v|vt|vn|f) ([^\n]*)")
POLYGON = re.compile(rb"\nf((?: [^ \n]+){4,})")
BESIDES = re.compile(rb"/[^ ]*")


def as_utf8(text: bytes) -> bytes:
    """Text in UTF-8; anything else is read as Latin-1, in which every byte is a letter."""
    try:
        text.decode()
    except UnicodeDecodeError:
        return text.decode("latin-1").encode()
    return text


def tidied_mesh(path: Path, data: bytes) -> bytes:
    """The text of an `.obj` without comments, indents, tabs and idle texture coordinates.

    Raises:
        FileFormatError: faces of fewer than three corners, with one before the first vertex, or
            not convex; several material files.
        ResourceLimitError: more than `MAX_MATERIALS` materials.
    """
    data = _lines(as_utf8(data))
    if (used := len(set(USED.findall(data)))) > MAX_MATERIALS:
        raise ResourceLimitError(str(path), f"{used} materials", f"join them to {MAX_MATERIALS}")
    if RELATIVE.search(data) is not None:
        data = _absolute(data)
    for pattern, got, mend in (
        (SHORT, "a face of fewer than three corners", "take it out"),
        (BEFORE_FIRST, "a corner before the first vertex", "count from 1, or back from -1"),
    ):
        if (found := pattern.search(data)) is not None:
            raise FileFormatError(str(path), f"{got} ({_quoted(found[0])})", mend)
    _require_convex(path, data)
    libraries = {name.strip() for name in LIBRARY.findall(data)}
    if len(libraries) > 1:
        got = f"{len(libraries)} material files"
        raise FileFormatError(str(path), got, "join them and name the one file")
    return data if libraries else COORDINATES.sub(b"", data)


def material_names(data: bytes) -> set[str]:
    """The materials that the faces of a tidied `.obj` ask for."""
    return {name.decode().strip() for name in USED.findall(data)}


def tidied_materials(path: Path, data: bytes) -> tuple[bytes, set[str]]:
    """The lines of an `.mtl` that say the diffuse reflectance, and the names of its materials.

    Raises:
        FileFormatError: a material without a name; a `Kd` that is not one or three numbers
            from 0 to 1 (or four, with an opacity); a `map_Kd` with options.
    """
    lines, names = [], set()
    for line in _lines(as_utf8(data)).decode().split("\n"):
        key, _, rest = line.strip().partition(" ")
        match key.lower():
            case "newmtl":
                if not rest:
                    raise FileFormatError(str(path), "a material without a name", "name it")
                names.add(rest)
                lines.append(f"newmtl {rest}")
            case "kd":
                lines.append("Kd {} {} {}".format(*_reflectance(path, rest)))
            case "map_kd":
                if rest.startswith("-"):
                    mend = "take the options out and leave the name of the file"
                    raise FileFormatError(str(path), f"options ({_quoted(line.encode())})", mend)
                lines.append(f"map_Kd {rest}")
    return "\n".join(lines).encode(), names


def _lines(data: bytes) -> bytes:
    """Lines that end in a line feed, flush left, words apart by one space, without comments."""
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b"")
    data = data.replace(b"\t", b" ")
    while b"  " in data:
        data = data.replace(b"  ", b" ")
    data = COMMENT.sub(b"", INDENT.sub(b"\n", b"\n" + data + b"\n"))
    return REMARK.sub(rb"\1", data) if b"#" in data else data


def _reflectance(path: Path, words: str) -> list[float]:
    try:
        values = [float(word) for word in words.split()]
    except ValueError:
        values = []
    right = len(values) in (1, 3, 4) and all(math.isfinite(v) and 0 <= v <= 1 for v in values)
    if not right:
        mend = "write three numbers from 0 to 1 (bytes divided by 255)"
        raise FileFormatError(str(path), _quoted(f"Kd {words}".encode()), mend)
    return (values * 3)[:3]


def _quoted(line: bytes) -> str:
    return line.decode(errors="replace").strip()[:80]


def _absolute(data: bytes) -> bytes:
    """The text with relative corners (-1 is the last vertex above the face) counted from 1."""
    counts = {b"v": 0, b"vt": 0, b"vn": 0}

    def counted(found: re.Match[bytes]) -> bytes:
        key, words = found.groups()
        if key != b"f":
            counts[key] += 1
            return found[0]
        return b"\nf " + b" ".join(b"/".join(corner(word)) for word in words.split())

    def corner(word: bytes) -> list[bytes]:
        parts = zip(word.split(b"/"), counts.values(), strict=False)
        return [
            str(count + int(part) + 1).encode() if re.fullmatch(rb"-\d{1,18}", part) else part
            for part, count in parts
        ]

    return COUNTED.sub(counted, data)


def _require_convex(path: Path, data: bytes) -> None:
    """Faces of four and more corners come out right as a fan: each turns one way all round."""
    if POLYGON.search(data) is None:
        return
    points, matches = _positions(data), POLYGON.finditer(data)
    while some := list(islice(matches, AT_ONCE)):
        rows = [BESIDES.sub(b"", found[1]).split() for found in some]
        lengths = np.array([len(row) for row in rows])
        for corners in np.unique(lengths):
            chosen = np.flatnonzero(lengths == corners)
            faces = _integers([rows[i] for i in chosen]) - 1
            if faces.min() < 0 or faces.max() >= len(points):
                continue  # corners that do not exist are left to trimesh and to `validate`
            bad = _turns_back(points[faces])
            if bad.any():
                line = _quoted(some[chosen[np.argmax(bad)]][0])
                mend = "triangulate the mesh when you save it"
                raise FileFormatError(str(path), f"a face that is not convex ({line})", mend)


def _integers(rows: list[list[bytes]]) -> NDArray[np.int64]:
    """Corners of faces; 0, which stands for none, where they are no numbers (trimesh says so)."""
    try:
        return np.array(rows).astype(np.int64)
    except (ValueError, OverflowError):
        return np.zeros((1, 1), dtype=np.int64)


def _positions(data: bytes) -> NDArray[np.float64]:
    """Positions `n 3` of the vertices; NaN where they are no numbers (trimesh says so)."""
    texts = VERTEX.findall(data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of text that is no number
        try:
            numbers = np.fromstring(b" ".join(texts), dtype=np.float64, sep=" ")
        except ValueError:
            numbers = np.empty(0)
    whole = numbers.size == 3 * len(texts)
    return numbers.reshape(-1, 3) if whole else np.full((len(texts), 3), np.nan)


def _turns_back(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which polygons `n k 3` have a triangle of their fan that faces backwards."""
    spokes = points[:, 1:] - points[:, :1]
    areas = np.cross(spokes[:, :-1], spokes[:, 1:])
    whole, total = areas.sum(1), np.linalg.norm(areas, axis=-1).sum(-1)
    size = np.linalg.norm(whole, axis=-1)
    along = (areas * whole[:, None]).sum(-1).min(-1)
    longest = np.linalg.norm(spokes, axis=-1).max(-1)
    rounding = np.finfo(points.dtype).eps * np.abs(points).max((1, 2)) * longest
    seen = total > 16 * points.shape[1] * rounding  # the others have no area, as `validate` says
    return seen & ((along < -CONCAVITY * total * size) | (size < CONCAVITY * total))
