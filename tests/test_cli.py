"""The command line: one library call a command, JSON alone on stdout, one sentence on errors."""

from __future__ import annotations

import importlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.demo.test_run import write_sphere_set
from tests.demo.test_trainer import touch
from tests.learn.test_benchmarks import write_object
from torchradiometry.cli import main
from torchradiometry.cli.interrupt import heard_interrupts
from torchradiometry.deploy import find_model
from torchradiometry.files import read_picture, write_picture
from torchradiometry.scene.build import box, cornell_like_room
from torchradiometry.scene.scene import Scene
from torchradiometry.scene.write import save_scene


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["torchradiometry", *map(str, arguments)])
        try:
            main()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture
def room(tmp_path: Path) -> Path:
    path = tmp_path / "scene" / "room.glb"
    path.parent.mkdir()
    save_scene(cornell_like_room(), path)
    return path


def only_inputs_remain(folder: Path, *names: str) -> bool:
    return sorted(p.name for p in folder.iterdir()) == sorted(names)


@pytest.mark.parametrize(
    "command",
    [
        "demo",
        "render",
        "tradeoff",
        "plan",
        "normals",
        "train",
        "dataset",
        "evaluate",
        "calibrate",
        "export",
        "page",
    ],
)
def test_help_shows_an_example(capsys: pytest.CaptureFixture[str], command: str) -> None:
    code, out, _ = run(capsys, command, "--help")
    assert code == 0
    assert f"torchradiometry {command}" in out


@pytest.mark.parametrize(("begun", "whole"), [("pl", "plan"), ("train p", "photometric")])
def test_a_shell_completes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, begun: str, whole: str
) -> None:
    monkeypatch.setenv("_TORCHRADIOMETRY_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", f"torchradiometry {begun}")
    monkeypatch.setenv("COMP_CWORD", str(1 + begun.count(" ")))
    code, out, _ = run(capsys)
    assert code == 0
    assert whole in out.split()


def test_help_lists_every_command_with_a_summary(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, "--help")
    commands = out.split("Commands:")[1].strip().splitlines()
    assert len(commands) >= 10
    assert all(len(line.split()) > 3 for line in commands)
    assert "--install-completion" in out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--version")
    assert (code, out) == (0, "torchradiometry 0.1.0\n")


@pytest.mark.parametrize("ending", [".npy", ".exr", ".hdr", ".png"])
def test_render_writes_every_format(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, room: Path, ending: str
) -> None:
    out = tmp_path / f"room{ending}"
    size = ("--width", 24, "--height", 16, "--tolerance", 0.3)
    code, stdout, _ = run(capsys, "render", room, *size, "--out", out, "--json")
    assert code == 0
    report = json.loads(stdout)
    assert {"seconds", "plan", "predicted_error", "out"} <= set(report)
    assert report["out"] == str(out)
    pixels = read_picture(out)
    assert pixels.shape == (16, 24, 3)
    assert pixels.max() > 0
    if ending == ".npy":
        assert np.load(out).dtype == np.float32


def test_tradeoff_writes_tables_and_plots(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    size = ("--width", 8, "--height", 6, "--repeats", 1)
    code, stdout, _ = run(capsys, "tradeoff", "ball", *size, "--out", tmp_path / "ball", "--json")
    assert code == 0
    report = json.loads(stdout)
    assert report["rows"][0]["error"] > report["rows"][-1]["error"] >= 0
    endings = ("csv", "json", "pdf", "png")
    assert only_inputs_remain(tmp_path / "ball", *(f"tradeoff.{e}" for e in endings))


def test_export_list_names_inputs_with_units(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "export", "--list", "--json")
    layers = {row["name"]: row for row in json.loads(out)["layers"]}
    assert code == 0
    assert {"lambertian", "phong"} <= set(layers)
    assert "normal" in json.dumps(layers["lambertian"])


def test_export_writes_a_checked_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "lambertian.onnx"
    code, out, _ = run(capsys, "export", "lambertian", "--out", path, "--json")
    report = json.loads(out)
    assert code == 0
    assert report["max_relative"] < 1e-5
    assert path.stat().st_size > 0


def test_normals_of_a_set_and_of_one_photograph(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    images = write_sphere_set(tmp_path / "ball")
    code, out, _ = run(capsys, "normals", images, "--out", tmp_path / "n.npy", "--json")
    assert code == 0
    assert json.loads(out)["lights"] == 6
    normals = np.load(tmp_path / "n.npy")
    inside = read_picture(images / "mask.png")[..., 0] > 0.5
    np.testing.assert_allclose(np.linalg.norm(normals[inside], axis=-1), 1, atol=1e-5)
    assert (normals[~inside] == 0).all()
    photograph = (images / "001.png", "--mask", images / "mask.png")
    code, out, _ = run(capsys, "normals", *photograph, "--out", tmp_path / "n.png", "--json")
    assert code == 0
    assert json.loads(out)["pixels"] == inside.sum()


def test_dataset_then_train_then_evaluate(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torchradiometry.demo.trainer.export_network", touch)
    (tmp_path / "t.toml").write_text(
        'kind = "shading"\nimages = 2\nsize = 24\nshapes = 5\nfeatures = 8\n'
    )
    common = ("shading", "--config", tmp_path / "t.toml", "--seed", 5, "--json")
    data, trained = tmp_path / "data", tmp_path / "trained"
    code, out, _ = run(capsys, "dataset", *common, "--count", 2, "--out", data)
    assert code == 0
    assert json.loads(out)["count"] == 2
    code, out, err = run(
        capsys, "train", *common, "--steps", 2, "--data", data, "--out", trained, "--bfloat16"
    )
    assert code == 0
    settings = json.loads(out)["training"]
    assert (settings["steps"], settings["seed"], settings["bfloat16"]) == (2, 5, True)
    assert "degrees" in err  # the progress bar
    write_object(tmp_path / "objects" / "ball")
    model = ("--model", find_model("shading"))
    code, out, _ = run(capsys, "evaluate", "shading", tmp_path / "objects", *model)
    assert code == 0
    assert "N-MAE" in out
    assert "its outline alone" in out


def test_calibrate_says_what_it_did(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_sphere_set(tmp_path / "ball")
    photographs = [tmp_path / "ball" / name for name in ("001.png", "002.png")]
    given = ("--times", "1/30, 0.1", "--response", "linear", "--light", "1,2,1/2")
    code, out, _ = run(capsys, "calibrate", *photographs, *given, "--out", tmp_path / "x.exr")
    assert code == 0
    assert "merged 2 exposures of 0.0333 to 0.1 s (8-bit counts taken as linear)" in out
    assert "divided by the light's 1, 2, 0.5" in out
    assert read_picture(tmp_path / "x.exr").max() > 0


def test_an_interrupt_is_one_sentence(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("torchradiometry.deploy.normals_file", interrupted)
    code, out, err = run(capsys, "normals", tmp_path, "--out", tmp_path / "n.npy")
    assert (code, out, err) == (130, "", "torchradiometry: interrupted.\n")


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C as in a terminal: a shell's background job ignores it, and so would its tests."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_that_an_import_swallows_is_heard_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    swallowing = "try:\n    {}\nexcept BaseException:\n    pass\n"
    raised = "import signal; signal.raise_signal(signal.SIGINT)"
    (tmp_path / "greedy.py").write_text(swallowing.format(raised))
    monkeypatch.syspath_prepend(tmp_path)

    def command() -> None:
        importlib.import_module("greedy")
        for _ in range(200):
            time.sleep(0.05)

    with pytest.raises(KeyboardInterrupt), heard_interrupts():
        command()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with pytest.raises(KeyboardInterrupt), heard_interrupts():
        signal.raise_signal(signal.SIGINT)


def test_an_ignored_interrupt_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with heard_interrupts():
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    "arguments",
    [
        ("train", "radiosity"),
        ("train", "shading", "--steps", "0"),
        ("calibrate", "a.png", "--times", "fast", "--out", "x.npy"),
        ("calibrate", "a.png", "--light", "1/0", "--out", "x.npy"),
        ("evaluate", "photometric", "ball", "--lights", "2"),
    ],
    ids=" ".join,
)
def test_a_wrong_value_is_a_usage_error(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert "Error" in err


def test_normals_never_loads_torch(tmp_path: Path) -> None:
    images = write_sphere_set(tmp_path / "ball")
    arguments = ["torchradiometry", "normals", str(images), "--out", str(tmp_path / "n.npy")]
    code = (
        "import sys\n"
        f"sys.argv = {arguments!r}\n"
        "from torchradiometry.cli import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code\n"
        "assert 'torch' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    assert (tmp_path / "n.npy").exists()


def not_a_mesh(folder: Path) -> Path:
    (folder / "a.glb").write_bytes(b"nonsense")
    return folder / "a.glb"


def empty_scene(folder: Path) -> Path:
    (folder / "a.gltf").write_text('{"asset": {"version": "2.0"}, "scenes": [{"nodes": []}]}')
    return folder / "a.gltf"


def nan_scene(folder: Path) -> Path:
    vertices = ("v nan 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 3")
    (folder / "a.obj").write_text("\n".join(vertices) + "\n")
    return folder / "a.obj"


@pytest.mark.parametrize("make", [not_a_mesh, empty_scene, nan_scene])
def test_bad_scenes_end_in_one_sentence(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, make
) -> None:
    scene = make(tmp_path)
    code, out, err = run(capsys, "render", scene, "--out", tmp_path / "x.npy", "--json")
    assert (code, out) == (2, "")
    assert err.startswith("torchradiometry: ")
    assert err.count("\n") == 1
    assert only_inputs_remain(tmp_path, scene.name)


@pytest.mark.parametrize(
    "arguments",
    [
        ("render", "missing.glb", "--out", "x.npy"),
        ("render", ".", "--out", "x.npy"),
        ("render", "box.glb", "--out", "x.jpg"),
        ("render", "box.glb", "--out", "none/x.npy"),
        ("render", "box.glb", "--out", "x.npy", "--tolerance", "0"),
        ("render", "box.glb", "--out", "x.npy", "--tolerance", "nan"),
        ("tradeoff", "missing.glb", "--out", "x"),
        ("tradeoff", "ball", "--out", "none/x"),
        ("tradeoff", "cornell", "--out", "box.glb"),
        ("plan", "box.glb", "--width", "8", "--height", "8", "--out", "empty"),
        ("plan", "box.glb", "--out", "plan.png"),
        ("plan", "box.glb", "--out", "none/plan.json"),
        ("normals", "missing", "--out", "x.npy"),
        ("normals", "empty", "--out", "x.npy"),
        ("normals", "ball/001.png", "--out", "x.npy"),
        ("normals", "ball/001.png", "--mask", "missing.png", "--out", "x.npy"),
        ("normals", "ball", "--out", "x.jpg"),
        ("normals", "ball", "--model", "box.glb", "--out", "x.npy"),
        ("export", "no-such-layer", "--out", "x.onnx"),
        ("export", "lambertian", "--out", "none/x.onnx"),
        ("export", "lambertian", "--out", "empty"),
        ("demo", "--images", "missing"),
        ("train", "shading", "--out", "box.glb"),
        ("train", "shading", "--out", "none/x"),
        ("train", "shading", "--out", "x", "--config", "missing.toml"),
        ("train", "shading", "--out", "x", "--config", "box.glb"),
        ("train", "shading", "--out", "x", "--device", "abacus"),
        ("train", "shading", "--out", "x", "--data", "empty"),
        ("dataset", "shading", "--out", "none/x", "--count", "1"),
        ("dataset", "shading", "--out", "box.glb", "--count", "1"),
        ("evaluate", "photometric", "empty"),
        ("evaluate", "shading", "missing"),
        ("evaluate", "photometric", "ball", "--model", "box.glb"),
        ("evaluate", "photometric", "ball", "--published", "missing.csv"),
        ("calibrate", "missing.png", "--out", "x.npy"),
        ("calibrate", "empty", "--out", "x.npy"),
        ("calibrate", "ball/001.png", "--out", "x.png"),
        ("calibrate", "ball/001.png", "ball/002.png", "--out", "x.npy"),
        ("calibrate", "ball/001.png", "--out", "x.npy", "--light", "0"),
    ],
    ids=" ".join,
)
def test_bad_arguments_end_in_one_sentence(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_sphere_set(tmp_path / "ball")
    (tmp_path / "empty").mkdir()
    save_scene(Scene((box("crate", (1.0, 1.0, 1.0)),)), tmp_path / "box.glb")
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("torchradiometry: ")
    assert err.count("\n") == 1
    assert only_inputs_remain(tmp_path, "ball", "box.glb", "empty")


def spoil_mask(folder: Path) -> None:
    (folder / "mask.png").unlink()


def spoil_count(folder: Path) -> None:
    (folder / "006.png").unlink()


def spoil_size(folder: Path) -> None:
    write_picture(folder / "002.png", np.ones((5, 5, 3), np.float32))


def spoil_picture(folder: Path) -> None:
    (folder / "003.png").write_bytes(b"nonsense")


def spoil_lights(folder: Path) -> None:
    (folder / "light_directions.txt").write_text("nan 0 1\n" * 6)


def spoil_numbers(folder: Path) -> None:
    (folder / "light_intensities.txt").write_text("one two three\n" * 6)


@pytest.mark.parametrize(
    "spoil", [spoil_mask, spoil_count, spoil_size, spoil_picture, spoil_lights, spoil_numbers]
)
def test_bad_photograph_sets_end_in_one_sentence(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, spoil
) -> None:
    spoil(write_sphere_set(tmp_path / "ball"))
    code, out, err = run(capsys, "normals", tmp_path / "ball", "--out", tmp_path / "x.npy")
    assert (code, out) == (2, "")
    assert err.startswith("torchradiometry: ")
    assert err.count("\n") == 1
    assert only_inputs_remain(tmp_path, "ball")


def test_a_missing_option_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "export", "lambertian")
    assert (code, out) == (2, "")
    assert "--out" in err


def test_module_entry_point_is_the_command() -> None:
    command = [sys.executable, "-m", "torchradiometry", "--version"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout == f"torchradiometry {__import__('torchradiometry').__version__}\n"
