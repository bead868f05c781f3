"""Every kind of file that is read, damaged in many ways: what it says, or a named error.

Each reader gets a good file, then copies that are cut short, with bytes changed, doubled, removed
or replaced at random (seeded). Nothing but a `RadiometryError` may come out, soon, and files
that claim to be huge may not make the process large. Writers that are interrupted at the last
moment leave the folder as it was.
"""

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.demo.test_run import write_sphere_set
from tests.learn.test_benchmarks import write_object
from torchradiometry.cli import main
from torchradiometry.demo import relighting_page
from torchradiometry.demo.relighting_page import GLUE, RUNTIME_VERSION, SCRIPT, WASM
from torchradiometry.deploy import find_model, open_model, read_photograph, read_photographs
from torchradiometry.errors import RadiometryError, ResourceLimitError
from torchradiometry.files import read_counts, read_picture, write_picture
from torchradiometry.learn import (
    ShadingTraining,
    StoredSamples,
    evaluate_single,
    load_checkpoint,
    read_training,
    train,
    write_samples,
    write_training,
)
from torchradiometry.plan import Costs, DepthPlan, DepthPlanner, Plan, Planner
from torchradiometry.scene.build import cornell_like_room
from torchradiometry.scene.load import load_scene
from torchradiometry.scene.write import save_scene
from torchradiometry.sources.directional import DirectionalSource

SMALL = ShadingTraining(steps=1, images=1, size=16, shapes=1, features=8, checkpoint_every=1)
COPIES = 24
#: seconds that one damaged file may take, far more than any does
SOON = 20.0


def mesh(path: Path) -> Path:
    """One square, in whatever format the ending says."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
    trimesh = pytest.importorskip("trimesh")
    trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]], process=False).export(path)
    return path


def picture(path: Path) -> Path:
    write_picture(path, np.random.default_rng(0).random((6, 5, 3)).astype(np.float32))
    return path


def checkpoint(path: Path) -> Path:
    train(SMALL, checkpoint=path)
    return path


def small_plan(path: Path) -> Path:
    Planner(0.1).plan(cornell_like_room()).save(path)
    return path


def depth_plan(path: Path) -> Path:
    flat = torch.ones(1, 1, 8, 8)
    lamp = DirectionalSource([0.0, 0.6, 0.8], [1.0])
    DepthPlanner(0.1).plan(flat, flat / 2, lamp, pixel_size=0.1).save(path)
    return path


def settings(path: Path) -> Path:
    write_training(path, SMALL)
    return path


def samples(path: Path) -> Path:
    write_samples(SMALL, path.parent / "set")
    return path.parent / "set" / "manifest.json"


def batch(path: Path) -> Path:
    return samples(path).parent / "00000000.npz"


def stored(path: Path) -> object:
    return StoredSamples(path.parent)[0]


def room(path: Path) -> Path:
    save_scene(cornell_like_room(), path)
    return path


def prices(path: Path) -> Path:
    Costs().save(path)
    return path


def model(path: Path) -> Path:
    path.write_bytes(find_model("shading").read_bytes())
    return path


def lights(path: Path) -> Path:
    return write_sphere_set(path.parent / "ball") / "light_directions.txt"


def heights(path: Path) -> Path:
    write_object(path.parent / "object")
    return path.parent / "object" / "geometry.npz"


def one_photograph(path: Path) -> object:
    return read_photograph(path, path)


#: name of the file -> what writes a good one (and its path), what reads it
READERS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], object]]] = {
    "room.glb": (room, load_scene),
    "mesh.obj": (mesh, load_scene),
    "mesh.ply": (mesh, load_scene),
    "mesh.stl": (mesh, load_scene),
    "mesh.off": (mesh, load_scene),
    "picture.png": (picture, read_picture),
    "counts.png": (picture, read_counts),
    "photograph.png": (picture, one_photograph),
    "picture.npy": (picture, read_picture),
    "picture.hdr": (picture, read_picture),
    "picture.exr": (picture, read_picture),
    "model.onnx": (model, open_model),
    "checkpoint.pt": (checkpoint, lambda path: load_checkpoint(path, SMALL)),
    "plan.json": (small_plan, Plan.load),
    "depth_plan.json": (depth_plan, DepthPlan.load),
    "prices.json": (prices, Costs.load),
    "training.toml": (settings, read_training),
    "manifest.json": (samples, stored),
    "batch.npz": (batch, stored),
    "lights.txt": (lights, lambda path: read_photographs(path.parent)),
    "heights.npz": (heights, lambda path: evaluate_single(path.parent)),
}
#: a copy of these takes long to make or to read
FEWER = {"model.onnx": 6, "checkpoint.pt": 16, "heights.npz": 12}


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """One random wound."""
    place, length = (int(rng.integers(0, max(1, len(data)))) for _ in range(2))
    length = 1 + length % 64
    noise = rng.bytes(length)
    kind = int(rng.integers(0, 6))
    if kind == 0:
        return data[:place]
    if kind == 1:
        return data[:place] + noise + data[place + length :]
    if kind == 2:
        return data[:place] + data[place + length :]
    if kind == 3:
        return data[:place] + data[place : place + length] * 50 + data[place + length :]
    if kind == 4:
        return data[:place] + bytes([data[place] ^ (1 << int(rng.integers(8)))]) + data[place + 1 :]
    return (
        data[:place]
        + rng.choice([b"9" * 30, b"-1", b"nan", b"\xff" * 8, b"[" * 20_000])
        + data[place + 1 :]
    )


def outcome(read: Callable[[Path], object], path: Path) -> str | None:
    """What a reader says of a file it refuses; any other error is passed on."""
    try:
        read(path)
    except RadiometryError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_read_or_named(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write, read = READERS[name]
    path = write(tmp_path / name)
    read(path)  # the good one
    data, rng, refused = path.read_bytes(), np.random.default_rng(7), 0
    for copy in range(FEWER.get(name, COPIES)):
        path.write_bytes(b"" if copy == 0 else damaged(data, rng))
        began = time.monotonic()
        said = outcome(read, path)
        refused += said is not None
        assert said is None or (len(said) < 1000 and "\n" not in said)
        assert time.monotonic() - began < SOON
    assert refused > 0


HUGE = """
import json, resource, struct, sys, zipfile
from pathlib import Path
import numpy as np
from torchradiometry.errors import RadiometryError
from torchradiometry.archives import read_arrays
from torchradiometry.files import read_picture
from torchradiometry.scene.load import load_scene
folder = Path(sys.argv[1])
files = {
    "a.ply": b"ply\\nformat binary_little_endian 1.0\\nelement vertex 2000000000\\n"
    b"property float x\\nproperty float y\\nproperty float z\\nelement face 2000000000\\n"
    b"property list uchar int vertex_indices\\nend_header\\n",
    "a.stl": b"\\0" * 80 + struct.pack("<I", 2**32 - 1),
    "a.off": b"OFF\\n2000000000 2000000000 0\\n0 0 0\\n",
    "a.hdr": b"#?RADIANCE\\nFORMAT=32-bit_rle_rgbe\\n\\n-Y 60000 +X 60000\\n",
    "a.npy": b"\\x93NUMPY\\x01\\x00v\\x00{'descr': '<f4', 'fortran_order': False, "
    b"'shape': (60000, 60000), }" + b" " * 53 + b"\\n",
    "a.npz": b"",
}
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
refused = {}
for name, data in files.items():
    (folder / name).write_bytes(data)
    if name == "a.npz":
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as archive:
            with archive.open("Z.npy", "w", force_zip64=True) as member:
                for _ in range(80):
                    member.write(bytes(2**24))
    reader = load_scene if name[2:] in ("ply", "stl", "off") else read_picture
    if name == "a.npz":
        reader = lambda path: read_arrays(path, "file", ["Z"])
    try:
        reader(folder / name)
    except RadiometryError as error:
        refused[name] = type(error).__name__
grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
print(json.dumps({"refused": refused, "grown": grown}))
"""


def test_files_that_claim_to_be_huge_stay_small(tmp_path: Path) -> None:
    """In a process that may hold 6 GB of addresses: none of them is believed."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30, 6 * 2**30))

    done = subprocess.run(
        [sys.executable, "-c", HUGE, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limited,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-1000:]
    report = json.loads(done.stdout)
    assert set(report["refused"]) == {"a.ply", "a.stl", "a.off", "a.hdr", "a.npy", "a.npz"}
    assert report["grown"] < 300  # MB


WRITERS = {
    "render": ["SCENE", "--width", "8", "--height", "8", "--tolerance", "0.5"],
    "plan": ["SCENE", "--tolerance", "0.5"],
    "normals": ["BALL"],
    "export": ["lambertian-directional"],
    "train": ["shading", "--config", "SETTINGS"],
    "dataset": ["shading", "--config", "SETTINGS", "--count", "1"],
    "calibrate": ["BALL/001.png"],
    "tradeoff": ["ball", "--width", "8", "--height", "6", "--repeats", "1"],
    "evaluate": ["shading", "OBJECT"],
    "page": ["--runtime", "LIBRARY"],
    "demo": ["--fast"],
}
ENDINGS = {
    "render": "a.npy",
    "plan": "a.json",
    "normals": "a.npy",
    "export": "a.onnx",
    "evaluate": "a.csv",
}


def runtime_library(folder: Path) -> None:
    """What stands for onnxruntime-web: its files by name, of no content."""
    package = folder / "onnxruntime-web"
    (package / "dist").mkdir(parents=True)
    described = {"name": "onnxruntime-web", "version": RUNTIME_VERSION, "license": "MIT"}
    (package / "package.json").write_text(json.dumps(described))
    for name in (SCRIPT, GLUE, WASM):
        (package / "dist" / name).write_bytes(b"nothing")


@pytest.mark.parametrize("command", WRITERS)
def test_an_interrupt_at_the_last_moment_leaves_no_half_file(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C comes where the finished temporary file would get its name."""
    save_scene(cornell_like_room(), tmp_path / "a.glb")
    write_sphere_set(tmp_path / "ball")
    write_object(tmp_path / "object")
    runtime_library(tmp_path / "library")
    write_training(tmp_path / "mine.toml", SMALL)
    names = {
        "SCENE": "a.glb",
        "SETTINGS": "mine.toml",
        "BALL": "ball",
        "BALL/001.png": "ball/001.png",
        "OBJECT": "object",
        "LIBRARY": "library",
    }
    given = [str(tmp_path / names[each]) if each in names else each for each in WRITERS[command]]
    out = tmp_path / "out"
    out.mkdir()
    target = out / ENDINGS.get(command, "a.npy" if command == "calibrate" else "a")
    asked = ["--table" if command == "evaluate" else "--out", str(target)]
    replace = Path.replace

    def interrupted(path: Path, name: str | Path) -> Path:
        if out in Path(name).parents:
            raise KeyboardInterrupt
        return replace(path, name)

    monkeypatch.setattr(relighting_page, "_exported_layer", bytes)  # dear, not in `out`
    monkeypatch.setattr(Path, "replace", interrupted)
    monkeypatch.setattr(sys, "argv", ["torchradiometry", command, *given, *asked])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130
    left = [path for path in out.rglob("*") if path.is_file()]
    assert left == []


@pytest.mark.parametrize("name", ["training.toml", "lights.txt"])
def test_texts_of_any_size_are_not_read(name: str, tmp_path: Path) -> None:
    """Their readers take a time that grows with the square of what they are given."""
    write, read = READERS[name]
    path = write(tmp_path / name)
    with path.open("ab") as file:
        file.truncate(2**24 + 1)
    with pytest.raises(ResourceLimitError, match="bytes"):
        read(path)
