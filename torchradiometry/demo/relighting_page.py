"""The browser page: normals of photographs, and relighting under the pointer, as a static folder.

    index.html, style.css, *.js     the page itself, from `browser/` beside this file
    onnxruntime.js                  onnxruntime-web's script, as it is
    packed-NAME.js                  a binary file as a script: packed[NAME] = gzip in base64

Everything binary (onnxruntime's WebAssembly, our models, the sample pictures) is packed into
scripts, because a script is all that a page opened from a disk (file://) may load; a server sends
the same files. The folder fetches nothing and sends nothing.

onnxruntime-web is not part of this package (14 MB): `web/package.json` pins it, and
`npm ci` in `web/` installs it with its integrity checked against `web/package-lock.json`.
"""

from __future__ import annotations

import base64
import gzip
import json
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from torchradiometry.demo.page import staged_folder
from torchradiometry.demo.sample_pictures import sample_photograph, sample_set
from torchradiometry.deploy.normals import find_model
from torchradiometry.errors import FileFormatError, InputFileError
from torchradiometry.export.catalogue import export_file
from torchradiometry.files import check_readable, read_json
from torchradiometry.places import check_folder_place, writing

__all__ = ["RELIGHTING_LAYER", "browser_page"]

SOURCES = Path(__file__).resolve().parent / "browser"
#: where `npm ci` puts onnxruntime-web, seen from the sources and from where the person stands
RUNTIMES = (SOURCES.parents[2] / "web" / "node_modules", Path("web/node_modules"))
#: the version of onnxruntime-web that the page is tested with; the same as in web/package.json
RUNTIME_VERSION = "1.30.0"
SCRIPT, GLUE, WASM = "ort.wasm.min.js", "ort-wasm-simd-threaded.mjs", "ort-wasm-simd-threaded.wasm"
#: the exported layer that lights the surface again
RELIGHTING_LAYER = "normalized-phong"
NOTICE = """onnxruntime.js, packed-wasm.js and packed-glue.js are onnxruntime-web {version}
(https://github.com/microsoft/onnxruntime), under the MIT License:

Copyright (c) Microsoft Corporation

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and
associated documentation files (the "Software"), to deal in the Software without restriction,
including without limitation the rights to use, copy, modify, merge, publish, distribute,
sublicense, and/or sell copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or
substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT
NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM,
DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT
OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.

Everything else in this folder is torchradiometry, under the Apache License 2.0.
"""


def browser_page(out: str | Path, *, runtime: str | Path | None = None) -> dict[str, object]:
    """Write the page into a folder: the `page` command.

    Args:
        out: the folder; files of an earlier page in it are replaced.
        runtime: an installed onnxruntime-web, or the `node_modules` that holds it; by default
            `web/node_modules` of the sources or of the current folder.

    Returns:
        `page` (its index.html), `bytes` of the folder's files, `runtime` (the version) and
        `seconds`.

    Raises:
        InputFileError: no onnxruntime-web there, or no place for the folder.
        FileFormatError: another version of onnxruntime-web.
    """
    began = time.perf_counter()
    out = check_folder_place(out, "page")
    library = _library(runtime)
    with staged_folder(out) as stage, writing(out):
        for file in sorted(SOURCES.iterdir()):
            (stage / file.name).write_bytes(file.read_bytes())
        (stage / "onnxruntime.js").write_bytes(_part(library, SCRIPT))
        (stage / "NOTICE.txt").write_text(NOTICE.format(version=RUNTIME_VERSION), encoding="utf-8")
        for name, data in _binaries(library).items():
            _pack(stage, name, data)
        size = sum(file.stat().st_size for file in stage.iterdir())
    return {
        "page": str(out / "index.html"),
        "bytes": size,
        "runtime": RUNTIME_VERSION,
        "seconds": time.perf_counter() - began,
    }


def _binaries(library: Path) -> dict[str, bytes]:
    """What is packed, by name."""
    return {
        "wasm": _part(library, WASM),
        "glue": _part(library, GLUE),
        "phong": _exported_layer(),
        "shading": find_model("shading").read_bytes(),
        "photometric": find_model("photometric").read_bytes(),
        "sample": _bundle(sample_photograph()),
        "sample-set": _bundle(sample_set()),
    }


def _exported_layer() -> bytes:
    """The relighting layer as ONNX, checked against torch."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layer.onnx"
        export_file(RELIGHTING_LAYER, path)
        return path.read_bytes()


def _bundle(files: Mapping[str, bytes]) -> bytes:
    """Files by name as one JSON object: text as it is, pictures in base64."""
    entries = {
        name: {"text": data.decode()}
        if name.endswith(".txt")
        else {"base64": base64.b64encode(data).decode()}
        for name, data in files.items()
    }
    return json.dumps(entries).encode()


def _pack(folder: Path, name: str, data: bytes) -> None:
    """A script that sets packed[name]; the same data gives the same bytes."""
    text = base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()
    script = f'(globalThis.packed ??= {{}})["{name}"] =\n  "{text}";\n'
    (folder / f"packed-{name}.js").write_text(script, encoding="ascii")


def _library(runtime: str | Path | None) -> Path:
    """The folder of onnxruntime-web, of the right version."""
    places = RUNTIMES if runtime is None else (Path(runtime),)
    found = [
        folder
        for place in places
        for folder in (place / "onnxruntime-web", place)
        if (folder / "dist" / SCRIPT).is_file()
    ]
    if not found:
        raise InputFileError(
            f"onnxruntime-web in {' or '.join(map(str, places))}",
            "no such package",
            f"run: npm install onnxruntime-web@{RUNTIME_VERSION} (or npm ci in web/), and name its "
            "node_modules with --runtime",
        )
    description = read_json(found[0] / "package.json", "package description")
    version = description.get("version") if isinstance(description, dict) else None
    if version != RUNTIME_VERSION:
        raise FileFormatError(
            str(found[0]), f"onnxruntime-web {version}", f"install version {RUNTIME_VERSION}"
        )
    return found[0]


def _part(library: Path, name: str) -> bytes:
    return check_readable(library / "dist" / name, "file of onnxruntime-web").read_bytes()
