"""Accessors of a glTF file: typed arrays in its buffers.

    value[k] = the `components` numbers at  view offset + accessor offset + k * stride
    normalised integers c become c / 255, c / 65535 (unsigned), max(c / 127, -1),
    max(c / 32767, -1) (signed);  a sparse accessor then overwrites some of the values.

trimesh decodes accessors too, but leaves out sparse values and the scale of normalised
integers, so they are read here.

References: Khronos, *glTF 2.0 Specification* (2021), 3.6.2 (accessors), 3.11 (quantisation).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchradiometry.errors import ResourceLimitError
from torchradiometry.scene.gltf_container import Container
from torchradiometry.scene.gltf_fields import Fields

__all__ = ["MAX_BLANK", "read_indices", "read_values"]

#: elements of an accessor that has no bytes in the file (all zero, some overwritten)
MAX_BLANK = 2**20
TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read_values(container: Container, accessor: Fields, components: int) -> NDArray[np.float64]:
    """An accessor as float64, `count components`, normalised integers scaled."""
    values = _decoded(container, accessor, components)
    if accessor.flag("normalized") and values.dtype.kind in "iu":
        scaled = values.astype(np.float64) / (2.0 ** _value_bits(values.dtype) - 1)
        return np.maximum(scaled, -1.0)
    return values.astype(np.float64)


def read_indices(container: Container, accessor: Fields) -> NDArray[np.int64]:
    """An accessor of unsigned integers as int64, `count`."""
    values = _decoded(container, accessor, 1)
    if values.dtype.kind != "u":
        raise accessor.fault("componentType", f"indices of {values.dtype}", "use unsigned integers")
    return values[:, 0].astype(np.int64)


def _decoded(container: Container, accessor: Fields, components: int) -> NDArray[np.generic]:
    kind, count = accessor.text("type"), accessor.integer("count")
    if COMPONENTS.get(kind) != components:
        raise accessor.fault("type", repr(kind)[:40], f"{components} numbers each are needed")
    dtype = _dtype(accessor)
    if "bufferView" in accessor:
        values = _strided(container, accessor, dtype, count, components)
    elif count <= MAX_BLANK:
        values = np.zeros((count, components), dtype)
    else:
        where = f"{accessor.file}, {accessor.place}"
        got = f"{count} elements without data"
        raise ResourceLimitError(where, got, f"store them, or at most {MAX_BLANK}")
    return _overwritten(container, accessor, values) if "sparse" in accessor else values


def _value_bits(dtype: np.dtype[np.generic]) -> int:
    """Bits of an integer without its sign."""
    return 8 * dtype.itemsize - (dtype.kind == "i")


def _dtype(fields: Fields) -> np.dtype[np.generic]:
    code = fields.integer("componentType")
    if code not in TYPES:
        raise fields.fault("componentType", f"{code}", f"use one of {sorted(TYPES)}")
    return np.dtype(TYPES[code])


def _strided(
    container: Container,
    fields: Fields,
    dtype: np.dtype[np.generic],
    count: int,
    components: int,
) -> NDArray[np.generic]:
    """A copy of `count components` numbers that lie in a buffer view."""
    view = container.view(fields)
    element = dtype.itemsize * components
    stride = fields.index("bufferView", container.views).integer("byteStride", element)
    start = fields.integer("byteOffset", 0)
    if stride < element:
        raise fields.fault("bufferView", f"a byteStride of {stride} for {element} bytes each")
    if count == 0:
        return np.zeros((0, components), dtype)
    end = start + (count - 1) * stride + element
    if end > len(view):
        got = f"{count} elements that end at byte {end} of {len(view)}"
        raise fields.fault("count", got)
    shape, strides = (count, components), (stride, dtype.itemsize)
    return np.ndarray(shape, dtype, buffer=view, offset=start, strides=strides).copy()


def _overwritten(
    container: Container, accessor: Fields, values: NDArray[np.generic]
) -> NDArray[np.generic]:
    """The values with the sparse ones put in."""
    sparse = accessor.record("sparse")
    count = sparse.integer("count", most=len(values))
    where, what = sparse.record("indices"), sparse.record("values")
    dtype = _dtype(where)
    if dtype.kind != "u":
        raise where.fault("componentType", f"indices of {dtype}", "use unsigned integers")
    index = _strided(container, where, dtype, count, 1)[:, 0]
    if count and int(index.max()) >= len(values):
        raise where.fault("", f"index {int(index.max())} of {len(values)} elements")
    values[index] = _strided(container, what, values.dtype, count, values.shape[1])
    return values
