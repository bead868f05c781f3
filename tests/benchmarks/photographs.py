"""How far the shipped networks are from true normals: `python -m tests.benchmarks.photographs`.

Measures a model folder on real photographs that no training saw, and on new synthetic ones,
writes every figure to its `metrics.json` and prints the table that its card shows. Mean angle
over the mask in degrees, through onnxruntime. Nothing random but what a stated seed draws.

The photographs lie beside the repository (`../shared/data`) or where `--data` says:

    diligent/ball bear cat pot1      96 lights each, true normals from a laser scan
    mit_berkeley/*                   ten painted objects, one photograph each, in colour
    uw_grey_sphere                   a matt sphere under 12 lights, and a chrome sphere that
                                     mirrors them: L = 2 (n . v) n - v at its highlight, v = z

Both spheres' centres and radii are those of discs with the area and centroid of their masks.

References: B. Shi et al., "A benchmark dataset and evaluation for non-Lambertian and
uncalibrated photometric stereo", TPAMI 2019 (DiLiGenT).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from tests.conftest import DATA
from torchradiometry.deploy import (
    Photograph,
    Photographs,
    angular_error,
    estimate_normals,
    open_model,
    read_photographs,
    run_model,
)
from torchradiometry.files import read_counts
from torchradiometry.learn import (
    PhotometricSamples,
    ShadingSamples,
    SurfaceOptions,
    angle_degrees,
    drawn_lights,
    evaluate,
    evaluate_single,
    find_objects,
    geometric_mean,
    least_squares,
    make_bank,
    make_shapes,
    read_training,
    robust_normals,
    surface_normals,
)
from torchradiometry.places import atomic_path

MODELS = Path(__file__).resolve().parents[2] / "models"
OBJECTS = ("ball", "bear", "cat", "pot1")
#: seeds of the ten lights drawn from 96
DRAWS = range(5)
#: number of the one photograph of each object, from 1
PHOTOGRAPH = 46
#: the cards' trainings have seed 1
NEW_SEED = 2
#: pixels along an edge of the new synthetic images
SIZE = 64
#: how bright a highlight's pixels are beside its brightest
HIGHLIGHT = 0.9

Row: TypeAlias = dict[str, float]
Rows: TypeAlias = dict[str, Row]


def photometric_rows(model: Path, data: Path) -> Rows:
    """The network beside least squares on the same photographs."""
    rows: Rows = {}
    few: Rows = {}
    for name in OBJECTS:
        photographs = read_photographs(data / "diligent" / name)
        rows[f"{name}, 96 lights"] = beside_least_squares(photographs, model)
        drawn = (drawn_lights(96, 10, seed) for seed in DRAWS)
        draws = [beside_least_squares(photographs.under(lights), model) for lights in drawn]
        few[f"{name}, 10 lights"] = _mean(draws)
    rows["mean, 96 lights"] = _mean(list(rows.values()))
    few["mean, 10 lights"] = _mean(list(few.values()))
    sphere = grey_sphere(data / "uw_grey_sphere")
    rows |= few | {"matt sphere, 12 lights": beside_least_squares(sphere, model)}
    return rows | {"new synthetic pixels": new_pixels(model)}


def shading_rows(model: Path, data: Path) -> Rows:
    """The network beside the same network without the photograph, and beside no network."""
    sphere = grey_sphere(data / "uw_grey_sphere")
    each = [one_photograph(sphere, number, model) for number in range(len(sphere.images))]
    rows = {"matt sphere, mean of 12 photographs": _mean(each)}
    for name in OBJECTS:
        photographs = read_photographs(data / "diligent" / name)
        rows[name] = one_photograph(photographs, PHOTOGRAPH - 1, model)
    rows |= painted_rows(model, data / "mit_berkeley")
    return rows | {"new synthetic images": new_images(model)}


def painted_rows(model: Path, data: Path) -> Rows:
    """Painted objects by the benchmark's own measure, N-MAE, in degrees."""
    rows = {}
    for folder in find_objects(data):
        found = evaluate_single(folder, model)
        with np.load(folder / "geometry.npz", allow_pickle=False) as arrays:
            truth = surface_normals(arrays["Z"])
        facing = np.arccos(truth[np.isfinite(truth).all(-1)][:, 2]).mean()
        angles = {"this model": found.radians, "its outline alone": found.outline}
        rows[f"painted {folder.name}"] = {
            way: float(np.degrees(angle)) for way, angle in angles.items()
        } | {"facing the camera": float(np.degrees(facing))}
    columns = next(iter(rows.values()))
    means = {c: geometric_mean([row[c] for row in rows.values()]) for c in columns}
    return rows | {"painted objects, geometric mean": means}


def grey_sphere(folder: Path) -> Photographs:
    """The matt sphere with its true normals, lights found in the chrome sphere."""
    chrome, matt = (_mask(folder / f"{name}.mask.png") for name in ("chrome", "gray"))
    images = np.stack([_picture(folder / f"gray.{k}.png") for k in range(12)])
    mirrors = [_picture(folder / f"chrome.{k}.png") for k in range(12)]
    normal = sphere_normals(chrome)
    lights = np.stack([reflected(image, chrome, normal) for image in mirrors])
    truth = sphere_normals(matt).astype(np.float32)
    return Photographs(images, matt, lights.astype(np.float32), truth, "matt sphere")


def markdown(rows: Rows) -> str:
    """The rows as a Markdown table, as the cards show it."""
    columns = list(next(iter(rows.values())))
    lines = [["mean angle, degrees", *columns], ["---"] * (1 + len(columns))]
    lines += [[name, *(f"{row[c]:.2f}" for c in columns)] for name, row in rows.items()]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def metrics(model: Path, data: Path) -> dict[str, Any]:
    """Everything that `metrics.json` holds; angles rounded to hundredths of a degree."""
    single = {item.name for item in open_model(model).inputs} == {"image", "mask"}
    rows = (shading_rows if single else photometric_rows)(model, data)
    network = read_training(model.parent / "training.toml").network()
    return {
        "bytes": model.stat().st_size,
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "mean_angle_degrees": {
            name: {column: round(value, 2) for column, value in row.items()}
            for name, row in rows.items()
        },
    }


def write_metrics(folder: Path, data: Path) -> dict[str, Any]:
    """Measure `folder/model.onnx` and replace `folder/metrics.json` in one step."""
    found = metrics(folder / "model.onnx", data)
    with atomic_path(folder / "metrics.json") as temporary:
        temporary.write_text(json.dumps(found, indent=2) + "\n")
    return found


def beside_least_squares(photographs: Photographs, model: Path) -> Row:
    found = evaluate(photographs, model)
    intensity, light = (
        torch.from_numpy(a) for a in (photographs.grey(), photographs.light_directions)
    )
    truth = photographs.ground_truth
    assert truth is not None
    robust = angle_degrees(
        robust_normals(intensity, light.float()), torch.from_numpy(truth[photographs.mask]).float()
    )
    return {
        "this model": found.degrees,
        "robust fit": float(robust.mean()),
        "least squares": found.least_squares,
    }


def one_photograph(photographs: Photographs, number: int, model: Path) -> Row:
    """Also: the model shown a uniform white object, which has the outline and nothing else."""
    truth, mask, name = photographs.ground_truth, photographs.mask, photographs.name
    assert truth is not None
    shown = photographs.images[number]
    ways = {
        "this model": estimate_normals(Photograph(shown, mask, name), model),
        "its outline alone": estimate_normals(Photograph(np.ones_like(shown), mask, name), model),
        "facing the camera": np.broadcast_to(np.array([0.0, 0.0, 1.0]), truth.shape),
    }
    return {way: float(angular_error(n, truth, mask).mean()) for way, n in ways.items()}


def new_pixels(model: Path, shapes: int = 40, batches: int = 20) -> Row:
    options = SurfaceOptions(shapes=shapes)
    samples = PhotometricSamples(make_bank(options, NEW_SEED), options, batches, NEW_SEED)
    opened, rows = open_model(model), []
    for batch in (samples[k] for k in range(batches)):
        pairs = zip(batch.intensity, batch.direction, strict=True)
        found = [
            torch.from_numpy(run_model(opened, {"intensity": i.numpy(), "direction": d.numpy()})[0])
            for i, d in pairs
        ]
        ways = {
            "this model": torch.stack(found),
            "robust fit": robust_normals(batch.intensity, batch.direction),
            "least squares": least_squares(batch.intensity, batch.direction),
        }
        rows.append({w: float(angle_degrees(n, batch.normal).mean()) for w, n in ways.items()})
    return _mean(rows)


def new_images(model: Path, batches: int = 50) -> Row:
    bank = make_shapes(200, SIZE, NEW_SEED)
    samples = ShadingSamples(bank, batches, NEW_SEED, images=8)
    opened = open_model(model)

    def found(seen: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        inputs = {"image": seen.numpy(), "mask": mask.numpy()}
        return torch.from_numpy(run_model(opened, inputs)[0])

    def row(image: torch.Tensor, mask: torch.Tensor, normal: torch.Tensor, _: torch.Tensor) -> Row:
        facing = torch.tensor([0.0, 0.0, 1.0]).view(3, 1, 1).expand_as(normal)
        ways = {
            "this model": found(image, mask),
            "its outline alone": found(mask.expand_as(image), mask),
            "facing the camera": facing,
        }
        truth, inside = normal.movedim(1, -1), mask[:, 0] > 0
        errors = {w: angle_degrees(n.movedim(1, -1), truth)[inside] for w, n in ways.items()}
        return {way: float(error.mean()) for way, error in errors.items()}

    return _mean([row(*samples[k]) for k in range(batches)])


def _mean(rows: list[Row]) -> Row:
    return {column: float(np.mean([row[column] for row in rows])) for column in rows[0]}


def _picture(path: Path) -> NDArray[np.float32]:
    """A linear 8-bit file as 0..1 RGB."""
    return read_counts(path).astype(np.float32) / np.float32(255)


def _mask(path: Path) -> NDArray[np.bool_]:
    counts = read_counts(path)
    return (counts if counts.ndim == 2 else counts.max(-1)) > 127


def sphere_normals(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Normals of a sphere that is seen as the mask from afar; x right, y up, z to the camera."""
    rows, columns = np.nonzero(mask)
    radius = np.sqrt(len(rows) / np.pi)
    row, column = np.indices(mask.shape)
    x, y = (column - columns.mean()) / radius, (rows.mean() - row) / radius
    normal = np.stack([x, y, np.sqrt(np.clip(1 - x * x - y * y, 0, None))], -1)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return normal / np.where(length > 0, length, 1)


def reflected(
    image: NDArray[np.float32], mask: NDArray[np.bool_], normal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The unit direction of the light that the chrome sphere mirrors to the camera."""
    brightness = image.mean(-1) * mask
    mean = normal[brightness >= HIGHLIGHT * brightness.max()].mean(0)
    mean /= np.linalg.norm(mean)
    return 2 * mean[2] * mean - np.array([0.0, 0.0, 1.0])


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    folders = [MODELS / "photometric", MODELS / "shading"]
    parser.add_argument("folders", nargs="*", type=Path, default=folders)
    parser.add_argument("--data", type=Path, default=DATA)
    options = parser.parse_args(arguments)
    if not options.data.is_dir():
        print(f"{options.data}: no photographs there; nothing measured, nothing written")
        return 1
    for folder in options.folders:
        found = write_metrics(folder, options.data)
        print(f"{folder.name}: {found['parameters']} parameters, {found['bytes']} bytes\n")
        print(markdown(found["mean_angle_degrees"]) + "\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
