"""The browser page in headless Chromium: it opens, shows normals, and lights them as torch does."""

from __future__ import annotations

import base64
import contextlib
import functools
import http.server
import io
import json
import re
import shutil
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from tests.web import WEB, require, run_script
from torchradiometry.cli import main
from torchradiometry.demo import relighting_page as module
from torchradiometry.demo.relighting_page import browser_page
from torchradiometry.demo.sample_pictures import sample_photograph, sample_set
from torchradiometry.deploy import estimate_normals, read_photograph, read_photographs
from torchradiometry.errors import FileFormatError, InputFileError
from torchradiometry.files import linear_to_srgb, read_picture, write_counts
from torchradiometry.materials import NormalizedPhong
from torchradiometry.shade import PhongShading
from torchradiometry.sources import DirectionalSource

SCRIPTS = sorted(module.SOURCES.glob("*.js"))
#: between the page's and our normals: onnxruntime's two builds round differently
NORMALS = 1e-3
PIXEL = 1 / 255 + 1e-3


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page, built once."""
    require(browser=True)
    out = tmp_path_factory.mktemp("page") / "page"
    with pytest.MonkeyPatch.context() as patch, io.StringIO() as printed:
        patch.setattr(sys, "argv", ["torchradiometry", "page", "--out", str(out), "--json"])
        with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
            main()
        report = json.loads(printed.getvalue())
    assert report["bytes"] == sum(file.stat().st_size for file in out.iterdir())
    assert report["page"] == str(out / "index.html")
    return out


def write_inputs(folder: Path) -> Path:
    """The files that the script opens."""
    (folder / "photo.png").write_bytes(sample_photograph()["figure.png"])
    picture = read_picture(folder / "photo.png")
    object_ = abs(picture - picture[0, 0]).max(-1) > 0.1
    write_counts(folder / "mask.png", (255 * object_).astype(np.uint8))
    (folder / "words.png").write_text("no picture")
    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    huge = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + header + bytes(40)
    (folder / "huge.png").write_bytes(huge)
    for name in ("set", "broken"):
        (folder / name).mkdir()
        for file, data in sample_set().items():
            (folder / name / file).write_bytes(data)
    (folder / "broken" / "008.png").unlink()
    return folder


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_inputs(tmp_path_factory.mktemp("inputs"))


class Quiet(http.server.SimpleHTTPRequestHandler):
    """`python -m http.server` without its log."""

    def log_message(self, *_: object) -> None: ...


@contextlib.contextmanager
def served(folder: Path) -> Iterator[str]:
    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/index.html"
        server.shutdown()


@pytest.fixture(scope="module")
def report(page: Path, inputs: Path) -> dict[str, Any]:
    """What the script of `web/` saw on the page, served as the docs say."""
    with served(page) as url:
        return run_script("check_page.mjs", url, inputs)


def array(text: str, dtype: str) -> NDArray[Any]:
    return np.frombuffer(base64.b64decode(text), dtype)


def planes(seen: dict[str, Any], name: str) -> NDArray[np.float32]:
    return array(seen[name], "<f4").reshape(3, -1)


def shown(seen: dict[str, Any]) -> NDArray[np.float64]:
    """Pixels of the relit canvas that hold the object, `pixel 3`, 0..1."""
    return array(seen["picture"], "u1").reshape(-1, 4)[array(seen["pixels"], "<i4"), :3] / 255


def by_torch(seen: dict[str, Any]) -> NDArray[np.float64]:
    """The same pixels by the layer in torch."""
    normal, paint = (torch.tensor(planes(seen, n)).view(1, 3, 1, -1) for n in ("normal", "albedo"))
    surface, light = seen["surface"], seen["light"]
    albedo = (surface["albedo"] * paint).clamp(max=1)
    sun = DirectionalSource(light["direction"], [light["irradiance"]] * 3)
    gloss = torch.full_like(albedo, surface["specular"])
    shininess = torch.full_like(albedo[:, :1], surface["shininess"])
    with torch.no_grad():
        radiance = PhongShading(NormalizedPhong, sun)(normal, albedo, gloss, shininess)
    return linear_to_srgb(radiance[0, :, 0].T.double().numpy())


@pytest.mark.parametrize("state", ["first", "moved", "duller", "photograph", "brushed", "set"])
def test_pixels_are_those_of_the_layer_in_torch(report: dict[str, Any], state: str) -> None:
    seen = report[state]
    assert shown(seen).max() > 0.5
    assert abs(shown(seen) - by_torch(seen)).max() <= PIXEL


def test_pointer_keyboard_touch_and_sliders_change_the_picture(report: dict[str, Any]) -> None:
    first, moved = report["first"], report["moved"]
    assert abs(shown(first) - shown(moved)).mean() > 0.05
    # the script points at 0.7, 0.3 of the picture, presses left, and touches 0.25, 0.75 of it;
    # the unit is half of the picture's shorter side
    shorter = min(first["width"], first["height"])
    wide, high = first["width"] / shorter, first["height"] / shorter
    places = {"moved": (0.4 * wide, 0.4 * high), "key": (0.4 * wide - 0.08, 0.4 * high)}
    places["touch"] = (-0.5 * wide, -0.5 * high)
    lights = {"moved": moved["light"], "key": report["key"], "touch": report["touch"]}
    for name, (x, y) in places.items():
        assert lights[name]["direction"][:2] == pytest.approx([x, y], abs=0.01)
    assert report["duller"]["surface"]["shininess"] == 10


def test_the_keyboard_alone_reaches_and_does_everything(report: dict[str, Any]) -> None:
    stops = [stop["id"] for stop in report["stops"]]
    files = ["photograph", "folder", "sample", "sample-set"]
    mask = ["summary", "threshold", "brush", "brush-size", "mask-file", "undo-brush"]
    relit = ["relit-canvas", "albedo", "specular", "shininess", "power", "painted"]
    assert stops == [*files, *mask, "detail", "save", *relit]
    for stop in report["stops"]:
        assert stop["name"], f"{stop['id']} has no name"
        assert stop["outlined"], f"the focus on {stop['id']} is not seen"
        assert stop["inside"], f"{stop['id']} has the focus out of sight"
    assert report["home"]["direction"] == pytest.approx(report["first"]["light"]["direction"])
    keys = report["keys"]
    assert keys["sliders"] == [0.01, 0.5, 0, 3]
    assert keys["spoken"] == ["0.01", "0.50", "1.0", "3.00 π"]
    assert not keys["painted"]
    assert keys["brush"] == "-1"
    assert keys["closed"]
    assert keys["focus"] == "sample"  # the focus stays where Enter was pressed
    assert keys["saved"] == "normals.png"


def test_normals_of_one_photograph_are_those_of_the_package(
    report: dict[str, Any], inputs: Path
) -> None:
    photograph = read_photograph(inputs / "photo.png", inputs / "mask.png")
    expected = estimate_normals(photograph)[photograph.mask]
    assert abs(planes(report["photograph"], "normal").T - expected).max() < NORMALS
    assert report["dropped"]["pixels"] == report["photograph"]["pixels"]  # let fall on the page
    # the threshold of the page finds the same object in the sample as the mask does
    assert report["sample"]["pixels"] == report["first"]["pixels"]
    found = len(array(report["sample"]["pixels"], "<i4"))
    assert found == pytest.approx(photograph.mask.sum(), rel=0.02)
    assert len(array(report["brushed"]["pixels"], "<i4")) != found


def test_normals_of_a_folder_are_those_of_the_package(report: dict[str, Any], inputs: Path) -> None:
    photographs = read_photographs(inputs / "set")
    expected = estimate_normals(photographs)[photographs.mask]
    assert abs(planes(report["set"], "normal").T - expected).max() < NORMALS


def test_faults_are_sentences_and_the_console_stays_empty(report: dict[str, Any]) -> None:
    sentences = report["sentences"]
    assert sentences["words.png"].startswith("words.png is no picture that this browser can decode")
    assert sentences["dropped"] == sentences["words.png"]
    assert "60000 x 60000 pixels" in sentences["huge.png"]
    assert "without light_directions.txt" in sentences["two"]
    assert "8 rows for 7 photographs" in sentences["folder"]
    assert report["status"].startswith("Ready")
    assert report["complaints"] == []


def test_it_opens_from_a_disk_too(page: Path, report: dict[str, Any]) -> None:
    seen = run_script("open_page.mjs", (page / "index.html").as_uri())
    assert seen["complaints"] == []
    assert seen["status"] == report["status"]
    assert seen["pixels"] == len(array(report["first"]["pixels"], "<i4"))


@pytest.mark.parametrize("script", [*SCRIPTS, *sorted(WEB.glob("*.mjs"))], ids=lambda p: p.name)
def test_scripts_parse(script: Path) -> None:
    if shutil.which("node") is None:
        require(browser=False)
    subprocess.run(["node", "--check", str(script)], check=True, capture_output=True)


def test_the_page_names_every_script_and_forbids_connections() -> None:
    html = (module.SOURCES / "index.html").read_text()
    loaded = re.findall(r'<script src="([^"]+)"', html)
    assert sorted(loaded) == sorted([*(script.name for script in SCRIPTS), "onnxruntime.js"])
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', html)
    assert policy is not None
    assert "default-src 'none'" in policy[1]
    assert "connect-src 'none'" in policy[1]
    assert "unsafe-inline" not in policy[1]
    assert re.search(r"<script>|\son\w+=|style=", html) is None
    text = "".join(script.read_text() for script in SCRIPTS)
    assert re.search(r"innerHTML|\beval\(|new Function|fetch\(|XMLHttpRequest", text) is None


def test_the_pinned_version_is_the_one_that_is_tested() -> None:
    for name in ("package.json", "package-lock.json"):
        assert f'"onnxruntime-web": "{module.RUNTIME_VERSION}"' in (WEB / name).read_text()


def test_a_missing_or_other_runtime_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="npm ci in web/"):
        browser_page(tmp_path / "page", runtime=tmp_path)
    library = tmp_path / "onnxruntime-web"
    (library / "dist").mkdir(parents=True)
    (library / "dist" / module.SCRIPT).write_text("")
    (library / "package.json").write_text('{"version": "1.0.0"}')
    with pytest.raises(FileFormatError, match=r"onnxruntime-web 1\.0\.0"):
        browser_page(tmp_path / "page", runtime=tmp_path)
    with pytest.raises(InputFileError, match="does not exist"):
        browser_page(tmp_path / "nowhere" / "page", runtime=tmp_path)
    assert not (tmp_path / "page").exists()
