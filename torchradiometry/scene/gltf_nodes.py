"""The node tree of a glTF file, flattened: each node with its matrix to world space.

    M_world = M_parent M_node,    M_node = matrix, or T R S

Positions transform by M, directions of light by its upper 3 x 3 block A, normals by the
inverse transpose of A. The normal is taken as sign(det A) cof(A) n, which is the same
direction and also has a value where the scale is 0 in one axis. det A < 0 mirrors, so faces
then run the other way round.

References: Khronos, *glTF 2.0 Specification* (2021), 3.5 (scenes, nodes, transformations).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchradiometry.scene.gltf_container import Container
from torchradiometry.scene.gltf_fields import LETTERS, Fields

__all__ = ["Node", "mirrors", "placed_nodes", "transformed_normals", "transformed_points"]

Matrix = NDArray[np.float64]


class Node(NamedTuple):
    """A node of the scene and its place in the world."""

    fields: Fields
    name: str
    matrix: Matrix


def placed_nodes(container: Container) -> list[Node]:
    """All nodes of the file's default scene, parents before children.

    Raises:
        FileFormatError: a node with two parents, or that is its own ancestor.
    """
    nodes = container.tree.records("nodes")
    waiting = [(k, np.eye(4)) for k in reversed(_roots(container.tree, nodes))]
    seen: set[int] = set()
    placed: list[Node] = []
    while waiting:
        number, parent = waiting.pop()
        fields = nodes[number]
        if number in seen:
            mend = "give every node one parent and no cycle"
            raise fields.fault("", "a node that is reached twice", mend)
        seen.add(number)
        matrix = parent @ _local(fields)
        if not np.isfinite(matrix).all():
            raise fields.fault("", "a transform beyond the numbers of float64")
        name = fields.text("name", f"node {number}")[:LETTERS]
        placed.append(Node(fields, name, matrix))
        children = _indices(fields, "children", nodes)
        waiting.extend((k, matrix) for k in reversed(children))
    return placed


def transformed_points(matrix: Matrix, points: Matrix) -> Matrix:
    """Points `n 3` in world space."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def transformed_normals(matrix: Matrix, normals: Matrix) -> Matrix:
    """Normals `n 3` in world space, unit; zero ones stay zero."""
    a = matrix[:3, :3]
    cofactors = np.stack((np.cross(a[1], a[2]), np.cross(a[2], a[0]), np.cross(a[0], a[1])))
    turned = normals @ cofactors.T * (-1.0 if mirrors(matrix) else 1.0)
    scale = np.abs(turned).max(axis=1, keepdims=True, initial=0.0)
    turned = turned / np.where(scale > 0, scale, 1.0)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return turned / np.where(length > 0, length, 1.0)


def mirrors(matrix: Matrix) -> bool:
    """Whether a transform turns right hands into left ones."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


def _roots(tree: Fields, nodes: list[Fields]) -> list[int]:
    scenes = tree.records("scenes")
    if scenes:
        scene = tree.integer("scene", 0, most=len(scenes) - 1)
        return _indices(scenes[scene], "nodes", nodes)
    children = {k for fields in nodes for k in _indices(fields, "children", nodes)}
    return [k for k in range(len(nodes)) if k not in children]


def _indices(fields: Fields, key: str, nodes: list[Fields]) -> list[int]:
    found = fields.integers(key)
    if found and max(found) >= len(nodes):
        raise fields.fault(key, f"node {max(found)} of {len(nodes)}")
    return found


def _local(fields: Fields) -> Matrix:
    """The node's own matrix."""
    if "matrix" in fields:
        columns = fields.numbers("matrix", 16, (0.0,) * 16)
        matrix = np.array(columns).reshape(4, 4).T
        if not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise fields.fault("matrix", "a projective matrix", "make its last row 0 0 0 1")
        return matrix
    matrix = np.eye(4)
    scale = np.array(fields.numbers("scale", 3, (1.0, 1.0, 1.0)))
    matrix[:3, :3] = _rotation(fields) * scale
    matrix[:3, 3] = fields.numbers("translation", 3, (0.0, 0.0, 0.0))
    return matrix


def _rotation(fields: Fields) -> Matrix:
    """Rotation matrix of the quaternion x y z w."""
    q = np.array(fields.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0)))
    q = q / np.abs(q).max() if q.any() else q
    length = np.linalg.norm(q)
    if length == 0:
        raise fields.fault("rotation", "a quaternion of length 0", "give a unit quaternion")
    x, y, z, w = q / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
