"""glTF files written by hand, so that nothing of the package takes part in their making."""

from __future__ import annotations

import base64
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


class GltfFile:
    """A tree and one buffer, filled by `accessor`, written as `.gltf` or `.glb`."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "accessors": [],
            "bufferViews": [],
            "meshes": [],
            "nodes": [],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
        }

    def view(self, data: bytes, **more: Any) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more}
        self.data += data
        self.tree["bufferViews"].append(entry)
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: Any, dtype: str = "f4", **more: Any) -> int:
        array = np.asarray(values).astype(f"<{dtype}")
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        entry = {"componentType": CODES[dtype], "count": len(array), "type": kind}
        view = self.view(array.tobytes())
        self.tree["accessors"].append({"bufferView": view, **entry, **more})
        return len(self.tree["accessors"]) - 1

    def primitive(
        self, points: Any, order: Any = None, attributes: dict[str, int] | None = None, **more: Any
    ) -> dict[str, Any]:
        entry = {"attributes": {"POSITION": self.accessor(points), **(attributes or {})}, **more}
        if order is not None:
            entry["indices"] = self.accessor(order, "u2")
        return entry

    def mesh(self, *primitives: dict[str, Any]) -> int:
        self.tree["meshes"].append({"primitives": list(primitives)})
        return len(self.tree["meshes"]) - 1

    def node(self, **fields: Any) -> int:
        self.tree["nodes"].append(fields)
        return len(self.tree["nodes"]) - 1

    def gltf(self, path: Path) -> Path:
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        buffers = [{"byteLength": len(self.data), "uri": uri}] if self.data else []
        path.write_text(json.dumps({"buffers": buffers, **self.tree}))
        return path

    def glb(self, path: Path) -> Path:
        tree = {"buffers": [{"byteLength": len(self.data)}], **self.tree}
        text = json.dumps(tree).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.data) + b"\0" * (-len(self.data) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        return path


def png(pixels: Any) -> bytes:
    """An 8-bit RGB or grey PNG file."""
    array = np.asarray(pixels, dtype=np.uint8)
    height, width = array.shape[:2]
    colour = 2 if array.ndim == 3 else 0
    rows = b"".join(b"\0" + row.tobytes() for row in array)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, colour, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def data_uri(data: bytes, kind: str = "image/png") -> str:
    return f"data:{kind};base64," + base64.b64encode(data).decode()


TRIANGLE = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]
SQUARE = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def one_triangle(**material: Any) -> GltfFile:
    """A file with one triangle in z = 0 that faces +z, of the given material."""
    file = GltfFile()
    more = {}
    if material:
        file.tree["materials"] = [material]
        more = {"material": 0}
    file.node(name="leaf", mesh=file.mesh(file.primitive(TRIANGLE, [0, 1, 2], **more)))
    return file
