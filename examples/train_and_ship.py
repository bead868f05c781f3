"""Train a network on shaded images, export it, and run it without torch.

    train       `PhotometricTraining`: surfaces with shadows and bounces, new materials and lamps in
                every step; the network looks at one pixel under any number of lamps
    export      one ONNX file, compared with torch on sizes it was not traced with
    run         onnxruntime, on photographs that no training saw (a relief, by `ShadeDepth`)

Beside it the same photographs by least squares and by the network that is shipped, which was
trained in the same way for longer.

Run it: `python examples/train_and_ship.py`. It writes `docs/pictures/train_and_ship.png`: the
learning curve, and the error maps of least squares, this network and the shipped one, 0 to 10
degrees.
"""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from torchradiometry.demo.trainer import export_network, torch_threads
from torchradiometry.deploy import angular_error, estimate_normals, least_squares_normals
from torchradiometry.learn import PhotometricTraining, SurfaceOptions, train

HERE = Path(__file__).resolve().parent
PICTURE = HERE.parent / "docs" / "pictures" / "train_and_ship.png"


def photographs(size: int) -> object:
    """The made-up photographs of `photometric_stereo.py`."""
    spec = importlib.util.spec_from_file_location("stereo", HERE / "photometric_stereo.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.made_up(size)


def main(fast: bool = False, out: Path = PICTURE) -> dict[str, float]:
    """Train, ship, run; errors in degrees, and torch against onnxruntime."""
    if fast:
        training = PhotometricTraining(steps=60, surfaces=SurfaceOptions(shapes=8), features=96)
    else:
        training = PhotometricTraining(steps=500, surfaces=SurfaceOptions(shapes=60), features=256)
    seen = photographs(24 if fast else 96)
    with tempfile.TemporaryDirectory() as folder, torch_threads(1):
        trained = train(training)
        model = Path(folder) / "mine.onnx"
        check = export_network(trained.network, model)
        normals = {
            "least squares": least_squares_normals(seen),
            f"{training.steps} steps": estimate_normals(seen, model),
            "shipped": estimate_normals(seen),
        }
    figure = Figure(figsize=(9.6, 2.6), layout="constrained")
    curve, *maps = figure.subplots(1, 4, width_ratios=[1.6, 1, 1, 1])
    curve.plot(trained.degrees, lw=0.6)
    curve.set(xlabel="step", ylabel="error in training, degrees", ylim=(0, None))
    errors = {"torch against onnxruntime": check.max_absolute}
    for axes, (name, found) in zip(maps, normals.items(), strict=True):
        error = np.zeros(seen.mask.shape)
        error[seen.mask] = angular_error(found, seen.ground_truth, seen.mask)
        errors[name] = float(error[seen.mask].mean())
        drawn = axes.imshow(error, cmap="magma", vmin=0, vmax=10, interpolation="nearest")
        axes.set_title(f"{name}: {errors[name]:.1f}°", fontsize=9)
        axes.set_axis_off()
    figure.colorbar(drawn, ax=maps, shrink=0.8, ticks=[0, 5, 10], label="error, degrees")
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=100, pil_kwargs={"optimize": True})
    return errors


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name}: {value:.2e}" if "torch" in name else f"{name}: {value:.2f} degrees")
