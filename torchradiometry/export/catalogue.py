"""Ready-made layers to export by name: the list behind `torchradiometry export LAYER`.

    export_layer("phong", "phong.onnx")       export_catalogue() -> every name with its inputs

The lights of a catalogue layer are inputs of its graph, so one file serves any number of them.
A name is `<shading>-<source>`; `lambertian`, `phong` and the other lobes alone stand for
directional light.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from torchradiometry.errors import NotConvergedError, OutOfRangeError
from torchradiometry.export.onnx_file import export_onnx
from torchradiometry.export.parity import check_onnx
from torchradiometry.export.sources_as_inputs import SourcesAsInputs
from torchradiometry.export.vocabulary import InputNote, note_for
from torchradiometry.geometry.depth import depth_to_normals
from torchradiometry.materials.blinn_phong import BlinnPhong
from torchradiometry.materials.phong import NormalizedPhong, OriginalPhong, Phong
from torchradiometry.places import atomic_path, check_place
from torchradiometry.shade.ambient import AmbientShading
from torchradiometry.shade.interreflection import InterreflectionShading
from torchradiometry.shade.lambertian import LambertianShading
from torchradiometry.shade.phong import PhongShading
from torchradiometry.sources.base import AbstractSource
from torchradiometry.sources.directional import DirectionalSource
from torchradiometry.sources.dome import AmbientDome
from torchradiometry.sources.harmonics import HarmonicSource
from torchradiometry.sources.point import PointSource
from torchradiometry.sources.polygon import PolygonSource
from torchradiometry.sources.sphere import SphereSource
from torchradiometry.sources.spot import SpotSource

__all__ = ["LAYERS", "ExportLayer", "export_catalogue", "export_file", "export_layer"]

BATCH, HEIGHT, WIDTH, LIGHTS = 2, 3, 4, 2


class ExportLayer(NamedTuple):
    """One entry: what to export, what to call it with, and what comes out.

    Attributes:
        module: the layer, its lights as inputs.
        example: tensors by input name.
        outputs: output name -> unit.
        axes: axis names of the inputs that the vocabulary has otherwise.
    """

    module: nn.Module
    example: dict[str, Tensor]
    outputs: dict[str, str]
    axes: Mapping[str, Sequence[str]] = {}

    @property
    def notes(self) -> dict[str, InputNote]:
        """Axes, quantity and unit of each input."""
        return {n: note_for(n, tensor, self.axes.get(n)) for n, tensor in self.example.items()}


class NormalsFromDepth(nn.Module):
    """Depth map and pinhole matrix in, unit normals out."""

    def forward(self, depth: Tensor, intrinsics: Tensor) -> Tensor:
        """Normals `B 3 H W` towards the camera from depth `B 1 H W` in m and K `3 3`."""
        return depth_to_normals(depth, intrinsics)


def _images() -> dict[str, Tensor]:
    def full(channels: int, value: float) -> Tensor:
        return torch.full((BATCH, channels, HEIGHT, WIDTH), value)

    normal = full(3, 0.0)
    normal[:, 2] = 1
    return {
        "normal": normal,
        "albedo": full(3, 0.5),
        "specular": full(3, 0.2),
        "shininess": full(1, 10.0),
        "position": full(3, 0.0),
        "visibility": full(1, 1.0),
    }


def _square() -> Tensor:
    """Two squares of 1 m above the origin that shine down, `light corner 3`."""
    corners = [[-0.5, -0.5, 2.0], [-0.5, 0.5, 2.0], [0.5, 0.5, 2.0], [0.5, -0.5, 2.0]]
    return torch.tensor(corners).expand(LIGHTS, 4, 3)


def _lights(*vector: float) -> Tensor:
    return torch.tensor(vector).expand(LIGHTS, len(vector))


SOURCES: dict[str, Callable[[], AbstractSource]] = {
    "directional": lambda: DirectionalSource(_lights(0.0, 0, 1), _lights(1.0, 1, 1)),
    "point": lambda: PointSource(_lights(0.0, 0, 2), _lights(1.0, 1, 1)),
    "spot": lambda: SpotSource(
        _lights(0.0, 0, 2), _lights(0.0, 0, -1), _lights(1.0, 1, 1), _lights(0.2), _lights(0.6)
    ),
    "sphere": lambda: SphereSource(_lights(0.0, 0, 2), _lights(0.3), _lights(1.0, 1, 1)),
    "polygon": lambda: PolygonSource(_square(), _lights(1.0, 1, 1)),
    "dome": lambda: AmbientDome(_lights(1.0, 1, 1)),
    "harmonics": lambda: HarmonicSource(torch.full((LIGHTS, 9, 3), 0.1)),
}
LOBES: dict[str, type] = {
    "phong": Phong,
    "normalized-phong": NormalizedPhong,
    "original-phong": OriginalPhong,
    "blinn-phong": BlinnPhong,
}


def _with_lights(layer: nn.Module, source: str, *names: str) -> ExportLayer:
    near = SOURCES[source]().needs_position
    inputs = (*names, "position") if near else names
    module = SourcesAsInputs(layer, inputs)
    images = _images()
    example = {**{name: images[name] for name in inputs}, **module.example()}
    return ExportLayer(module, example, {"radiance": "W/m2/sr"})


def _lambertian(source: str) -> ExportLayer:
    return _with_lights(LambertianShading(SOURCES[source]()), source, "normal", "albedo")


def _phong(lobe: str, source: str) -> ExportLayer:
    layer = PhongShading(LOBES[lobe], SOURCES[source]())
    return _with_lights(layer, source, "normal", "albedo", "specular", "shininess")


def _ambient() -> ExportLayer:
    images = _images()
    example = {"albedo": images["albedo"], "visibility": images["visibility"]}
    example["radiance"] = torch.ones(BATCH, 3)
    axes = {"visibility": ("batch", "1", "height", "width")}
    return ExportLayer(AmbientShading(), example, {"shaded": "W/m2/sr"}, axes)


def _normals_from_depth() -> ExportLayer:
    depth = torch.ones(BATCH, 1, HEIGHT, WIDTH)
    intrinsics = torch.tensor([[4.0, 0, 2], [0, 4, 1.5], [0, 0, 1]])
    return ExportLayer(
        NormalsFromDepth(), {"depth": depth, "intrinsics": intrinsics}, {"normal": "1"}
    )


def _interreflection() -> ExportLayer:
    """One bounce on 16 x 16 cells of a pinhole's depth map."""
    images, depth = _images(), _normals_from_depth().example
    example = {"depth": depth["depth"], "albedo": images["albedo"]}
    example |= {"irradiance": torch.ones(BATCH, 3, HEIGHT, WIDTH)}
    example |= {"intrinsics": depth["intrinsics"]}
    return ExportLayer(InterreflectionShading(), example, {"radiance": "W/m2/sr"})


def _visible() -> ExportLayer:
    """Directional light with a visibility map for each light."""
    module = SourcesAsInputs(
        LambertianShading(SOURCES["directional"]()), ("normal", "albedo", "visibility")
    )
    images = _images()
    images["visibility"] = torch.ones(BATCH, LIGHTS, HEIGHT, WIDTH)
    example = {name: images[name] for name in module.layer_inputs}
    return ExportLayer(module, {**example, **module.example()}, {"radiance": "W/m2/sr"})


def _named(source: str) -> Callable[[], ExportLayer]:
    return lambda: _lambertian(source)


def _lobed(lobe: str, source: str) -> Callable[[], ExportLayer]:
    return lambda: _phong(lobe, source)


#: name -> how to build the layer; building is cheap, exporting takes seconds
LAYERS: Mapping[str, Callable[[], ExportLayer]] = {
    "lambertian": _named("directional"),
    **{f"lambertian-{source}": _named(source) for source in SOURCES},
    "lambertian-visibility": _visible,
    **{lobe: _lobed(lobe, "directional") for lobe in LOBES},
    **{f"{lobe}-{s}": _lobed(lobe, s) for lobe in LOBES for s in ("directional", "point")},
    **{f"phong-{source}": _lobed("phong", source) for source in ("spot", "sphere", "polygon")},
    "ambient": _ambient,
    "interreflection": _interreflection,
    "normals-from-depth": _normals_from_depth,
}


def export_layer(name: str, path: str | Path) -> Path:
    """Write the catalogue's layer of that name as an ONNX file.

    Args:
        name: a key of `LAYERS`.
        path: where to write.

    Returns:
        The path.

    Raises:
        OutOfRangeError: no such name.
        InputFileError: the folder of `path` does not exist.
        MissingDependencyError: onnx or onnxscript is not installed.
    """
    if name not in LAYERS:
        raise OutOfRangeError("layer", f"{name!r}", f"pass one of {', '.join(LAYERS)}")
    layer = LAYERS[name]()
    return export_onnx(layer.module, layer.example, path, axes=layer.axes, outputs=layer.outputs)


def export_file(name: str, path: str | Path) -> dict[str, object]:
    """Write a layer of the catalogue, check it under onnxruntime, and report: the command.

    Args:
        name: a key of `LAYERS`.
        path: where to write; nothing is left there when the check fails.

    Returns:
        `out`, `layer`, `max_absolute`, `max_relative` and the `shapes` that were tried.

    Raises:
        OutOfRangeError: no such name.
        FileFormatError: another ending than `.onnx`.
        InputFileError: the folder of `path` does not exist.
        NotConvergedError: onnxruntime computes something else.
    """
    check_place(path, (".onnx",))
    with atomic_path(path) as temporary:
        export_layer(name, temporary)
        check = check_onnx(temporary, LAYERS[name]().module)
        if not check.passed:
            raise NotConvergedError(
                name, f"a difference of {check.max_relative:.1e}", "report it with your versions"
            )
    return {
        "out": str(path),
        "layer": name,
        "max_absolute": check.max_absolute,
        "max_relative": check.max_relative,
        "shapes": check.shapes,
    }


def export_catalogue() -> list[dict[str, Any]]:
    """Every name with its inputs (axes and unit each) and outputs, ready for printing or JSON.

    >>> entry = next(e for e in export_catalogue() if e["name"] == "lambertian")
    >>> entry["inputs"]["source_irradiance"]
    {'axes': ['light', '3'], 'unit': 'W/m2'}
    """
    return [_described(name, build()) for name, build in LAYERS.items()]


def _described(name: str, layer: ExportLayer) -> dict[str, object]:
    inputs = {
        key: {"axes": list(note.axes), "unit": note.unit} for key, note in layer.notes.items()
    }
    return {"name": name, "inputs": inputs, "outputs": layer.outputs}
