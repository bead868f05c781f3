"""The bytes of a glTF file: its JSON tree, buffers and pictures.

A `.glb` holds `magic version length`, then chunks `length type data`: the tree and at most one
buffer. A `.gltf` is the tree; its buffers and pictures are data URIs or files beside it. Only
files inside its own folder are opened: no absolute path, no `..`, no network.

References: Khronos, *glTF 2.0 Specification* (2021), 2.8 (URIs), 4.4 (binary container).
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from pathlib import Path
from urllib.parse import unquote, unquote_to_bytes

from torchradiometry.errors import FileFormatError, ResourceLimitError
from torchradiometry.files import MAX_BYTES, check_readable
from torchradiometry.scene.gltf_fields import Fields

__all__ = ["Container", "confined", "open_gltf"]

#: bytes of JSON that are parsed: as Python objects they grow about twentyfold
MAX_JSON = 2**26
MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", b"JSON", b"BIN\0"
#: what the readers understand; a file that *requires* anything else is refused
EXTENSIONS = frozenset(
    {
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
    }
)


class Container:
    """An opened file.

    Args:
        path: the file.
        tree: its JSON.
        binary: the buffer of a `.glb`.
    """

    def __init__(self, path: Path, tree: Fields, binary: bytes | memoryview | None) -> None:
        self.path, self.tree, self._binary = path, tree, binary
        self._opened: dict[str, bytes] = {}
        self.buffers = tree.records("buffers")
        self.views = tree.records("bufferViews")
        self.accessors = tree.records("accessors")

    def view(self, owner: Fields, key: str = "bufferView") -> memoryview:
        """The bytes of the buffer view that `owner` names at `key`."""
        fields = owner.index(key, self.views)
        buffer = self._buffer(fields)
        start, length = fields.integer("byteOffset", 0), fields.integer("byteLength")
        if start + length > len(buffer):
            got = f"bytes {start} to {start + length} of a buffer of {len(buffer)} bytes"
            raise fields.fault("byteLength", got)
        return buffer[start : start + length]

    def _buffer(self, view: Fields) -> memoryview:
        fields = view.index("buffer", self.buffers)
        if "uri" in fields:
            data: bytes | memoryview = self.resource(fields, "uri")
        elif self._binary is not None and fields is self.buffers[0]:
            data = self._binary
        else:
            raise fields.fault("uri", "nothing", "name the file that holds the buffer")
        declared = fields.integer("byteLength")
        if declared > len(data):
            got = f"{len(data)} bytes where {declared} are declared"
            raise fields.fault("byteLength", got, "the file is cut short: copy it again")
        return memoryview(data)[:declared]

    def resource(self, fields: Fields, key: str) -> bytes:
        """The bytes that a URI names: embedded, or of a file in the same folder."""
        uri = fields.text(key)
        if uri not in self._opened:
            if uri.startswith("data:"):
                self._opened[uri] = _embedded(fields, key, uri)
            else:
                beside = confined(self.path.parent, unquote(uri))
                if beside is None:
                    mend = "only files inside the folder of the scene are opened"
                    raise fields.fault(key, f"the address {uri[:80]!r}", mend)
                room = MAX_BYTES - sum(map(len, self._opened.values()))
                self._opened[uri] = check_readable(beside, "buffer or picture", room).read_bytes()
        return self._opened[uri]


def open_gltf(path: Path) -> Container:
    """Read the container; see the module for what is refused.

    Raises:
        InputFileError, FileFormatError, ResourceLimitError: with the place at fault.
    """
    path = check_readable(path, "glTF file")
    with path.open("rb") as stream:
        head = stream.read(12)
        size = path.stat().st_size
        if head[:4] == MAGIC:
            text, binary = _chunks(path, head, memoryview(stream.read()), size)
        else:
            _require_small(path, size)
            text, binary = head + stream.read(), None
    container = Container(path, Fields(path.name, "", _tree(path, text)), binary)
    _require_readable(container.tree)
    return container


def confined(folder: Path, name: str) -> Path | None:
    """The file `name` inside `folder`, or None if the name leads out of it.

    >>> confined(Path("/scenes"), "../secret") is None
    True
    """
    relative = Path(name)
    suspicious = ":" in name or "\\" in name or "\0" in name or not name
    if suspicious or relative.is_absolute() or ".." in relative.parts:
        return None
    path = (folder / relative).resolve()
    return path if path.is_relative_to(folder.resolve()) else None


def _embedded(fields: Fields, key: str, uri: str) -> bytes:
    header, comma, body = uri.partition(",")
    if not comma:
        raise fields.fault(key, "a data URI without data")
    if not header.endswith(";base64"):
        return unquote_to_bytes(body)
    try:
        return base64.b64decode(unquote(body), validate=True)
    except (binascii.Error, ValueError) as error:
        raise fields.fault(key, f"a data URI that is not base64 ({error})") from error


def _chunks(
    path: Path, head: bytes, rest: memoryview, size: int
) -> tuple[bytes, memoryview | None]:
    """The JSON text and the binary buffer of a `.glb`: its first two chunks."""
    cut = FileFormatError(str(path), "a .glb file that is cut short", "copy or export it again")
    if len(head) < 12:
        raise cut
    version, length = struct.unpack("<II", head[4:])
    if version != 2:
        raise FileFormatError(str(path), f"glTF version {version}", "convert it to glTF 2.0")
    if length > size:
        raise cut
    chunks: dict[bytes, memoryview] = {}
    rest, offset = rest[: length - 12], 0
    while offset < len(rest) and len(chunks) < 2:
        if offset + 8 > len(rest):
            raise cut
        count, kind = struct.unpack("<I4s", rest[offset : offset + 8])
        if offset + 8 + count > len(rest):
            raise cut
        if kind in chunks:
            raise FileFormatError(str(path), "two chunks of a kind", "export it again")
        chunks[kind] = rest[offset + 8 : offset + 8 + count]
        offset += 8 + count
    if JSON_CHUNK not in chunks:
        raise FileFormatError(str(path), "a .glb file without a JSON chunk", "export it again")
    _require_small(path, len(chunks[JSON_CHUNK]))
    return bytes(chunks[JSON_CHUNK]), chunks.get(BINARY_CHUNK)


def _require_small(path: Path, size: int) -> None:
    if size > MAX_JSON:
        mend = f"save it as .glb, whose JSON may have {MAX_JSON}"
        raise ResourceLimitError(str(path), f"{size} bytes of JSON", mend)


def _tree(path: Path, text: bytes) -> dict[str, object]:
    try:
        tree = json.loads(text.decode("utf-8-sig"), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        got = f"no glTF: its JSON cannot be read ({type(error).__name__}: {error})"
        raise FileFormatError(str(path), got, "pass a .gltf or .glb file") from error
    if not isinstance(tree, dict):
        raise FileFormatError(str(path), "JSON that is no glTF", "pass a .gltf or .glb file")
    return tree


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON number")


def _require_readable(tree: Fields) -> None:
    """Version 2, and no required extension that the readers do not know."""
    version = tree.record("asset").text("version", "")
    if version.split(".")[0] != "2":
        got = f"version {version!r}" if version else "no version"
        raise tree.fault("asset", got, "pass a glTF 2.0 file")
    unknown = sorted(set(tree.texts("extensionsRequired")) - EXTENSIONS)
    if unknown:
        mend = f"export it without; understood are {', '.join(sorted(EXTENSIONS))}"
        raise tree.fault("extensionsRequired", ", ".join(unknown)[:200], mend)
