"""Steps 2 to 4: shade training images, train a photometric network on them, export it.

The surfaces of a bank get their cast shadows and one bounce of interreflection once; each
training step gives them new materials, lights and a new camera (`learn.images`).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from torch import Tensor

from torchradiometry.demo.curve import draw_learning_curve
from torchradiometry.demo.page import Figure, Section, Table
from torchradiometry.demo.progress import progress_bar
from torchradiometry.demo.trainer import export_network, torch_threads
from torchradiometry.export.parity import OnnxCheck
from torchradiometry.files import write_picture
from torchradiometry.learn.samples.data import SurfaceOptions, generator_for
from torchradiometry.learn.samples.single_images import photograph_shapes
from torchradiometry.learn.training.loop import Trained, train
from torchradiometry.learn.training.settings import PhotometricTraining

__all__ = ["TrainedModel", "demo_training", "train_and_export"]


class TrainedModel(NamedTuple):
    """What steps 2 to 4 leave: the page's sections and the ONNX file."""

    sections: tuple[Section, ...]
    model: Path


def demo_training(fast: bool) -> PhotometricTraining:
    """The network that the demo trains: a small one in seconds, or a useful one in minutes."""
    if fast:
        return PhotometricTraining(steps=250, surfaces=SurfaceOptions(shapes=24), features=192)
    return PhotometricTraining(steps=1500, surfaces=SurfaceOptions(shapes=200))


def train_and_export(folder: Path, fast: bool) -> TrainedModel:
    """Make the training pictures, train, write `photometric.onnx` and check it."""
    training = demo_training(fast)
    pictures = _training_pictures(folder)
    with (
        progress_bar(
            ("Shading training surfaces", training.surfaces_made()),
            ("Training the network", training.steps),
        ) as (surfaces, steps),
        torch_threads(1),
    ):
        trained = train(training, steps, surfaces_advance=surfaces)
    draw_learning_curve(folder / "learning-curve.png", trained.losses, trained.degrees)
    model = folder / "photometric.onnx"
    check = export_network(trained.network, model)
    return TrainedModel((pictures, _learning(training, trained), _exported(model, check)), model)


def _training_pictures(folder: Path) -> Section:
    images = photograph_shapes(12, 96, generator_for(7))
    write_picture(folder / "training-images.png", _sheet(images.image).numpy(), exposure=1.0)
    normals = _sheet((images.normal + 1) / 2 * images.mask)
    write_picture(folder / "training-normals.png", normals.numpy() ** 2.2, exposure=1.0)
    words = (
        "Random shapes and paints, shaded by the package's own layers: Lambertian and Phong "
        "surfaces under lamps and natural light, with cast shadows and ambient occlusion.",
    )
    figures = (
        Figure(
            "training-images.png", "Shaded by PhongShading, LambertianShading and AmbientOcclusion."
        ),
        Figure("training-normals.png", "Their normals: x red, y green, z blue."),
    )
    return Section("2. Training images", words, figures)


def _sheet(images: Tensor) -> Tensor:
    """`12 C H W` as a contact sheet `2H 6W 3`."""
    count, _, height, width = images.shape
    rows = images.expand(-1, 3, -1, -1).reshape(2, count // 2, 3, height, width)
    return rows.permute(0, 3, 1, 4, 2).reshape(2 * height, (count // 2) * width, 3)


def _learning(training: PhotometricTraining, trained: Trained) -> Section:
    last = trained.degrees[-max(1, len(trained.degrees) // 10) :]
    degrees = sum(last) / len(last)
    parameters = sum(p.numel() for p in trained.network.parameters())
    words = (
        f"A network of {parameters:,} parameters looks at one pixel under any number of lights "
        f"and answers its normal. {training.steps} steps took {trained.seconds:.0f} s.",
    )
    figures = (Figure("learning-curve.png", "Loss and mean angle on each new synthetic batch."),)
    data = {"steps": training.steps, "seconds": trained.seconds, "degrees": degrees}
    table = Table(
        ("synthetic error, mean of the last tenth of the steps", "degrees"),
        (("network", f"{degrees:.2f}"),),
    )
    return Section("3. A network is trained", words, figures, (table,), data=data)


def _exported(model: Path, check: OnnxCheck) -> Section:
    # the length of a difference of unit normals, at most sqrt(3) times its largest component
    degrees = math.degrees(math.sqrt(3) * check.max_absolute)
    table = Table(
        ("torch against onnxruntime", ""),
        (
            ("largest difference of a component", f"{check.max_absolute:.1e}"),
            ("largest angle, degrees", f"{degrees:.5f}"),
            ("file", f"{model.stat().st_size / 1e6:.1f} MB"),
        ),
    )
    words = ("The network is written as one ONNX file and run on sizes it was not traced with.",)
    data = {"max_absolute": check.max_absolute, "degrees": degrees}
    return Section("4. Exported to ONNX and checked", words, (), (table,), data=data)
