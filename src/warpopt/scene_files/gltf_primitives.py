"""A primitive of a glTF mesh as vertices and triangles: modes, Draco, morph targets, skins."""

import dataclasses
from typing import Any

import numpy as np

from .gltf_accessors import Accessors, real
from .gltf_document import Document
from .gltf_item import GltfError, Item

TRIANGLES, STRIP, FAN = 4, 5, 6
POINTS, LINES = 0, (1, 2, 3)
DRACO = "KHR_draco_mesh_compression"


@dataclasses.dataclass(frozen=True, eq=False)
class Primitive:
    """Vertices and triangles in mesh space.

    Attributes:
        vertices: (V, 3), morphed.
        triangles: (T, 3) indices of vertices.
        joints, weights: (V, 4 S) for S sets; None if the primitive has none.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    joints: np.ndarray | None
    weights: np.ndarray | None


def read_primitive(item: Item, weights: np.ndarray, document: Document, accessors: Accessors) -> Primitive:
    """A primitive of triangles.

    Args:
        item: with a mode from `TRIANGLES` on, and a POSITION.
        weights: of its morph targets.

    Raises:
        GltfError: names the error.
    """
    source = _Source(item, document, accessors)
    vertices = source.floats("POSITION", "VEC3")
    count = len(vertices)
    targets = item.children("targets", "target")
    if len(targets) != len(weights) and len(weights):
        raise GltfError(f"{item.where}: got {len(targets)} morph targets, expected {len(weights)}, one for each weight")
    for target, weight in zip(targets, weights, strict=False):
        if weight and "POSITION" in target:
            moved = accessors.floats(target, "POSITION", "VEC3")
            _same_count(target, "POSITION", moved, count)
            vertices = vertices + weight * moved.astype(float)
    joints, shares = source.skin(count)
    return Primitive(vertices, _triangles(source.indices(), count, source.mode, item), joints, shares)


def triangle_count(item: Item, accessors: Accessors) -> int:
    """The number of triangles that a primitive declares; used for a limit before allocation."""
    attributes = item.required("attributes")
    mode = item.integer("mode", TRIANGLES)
    count = accessors.count(item, "indices") if "indices" in item else accessors.count(attributes, "POSITION")
    return count // 3 if mode == TRIANGLES else max(count - 2, 0)


def skinned(primitive: Primitive, joints: np.ndarray, where: str) -> np.ndarray:
    """(V, 3) world positions of a skinned primitive.

    Args:
        joints: (J, 4, 4), mesh space to world for each joint.
        where: for messages.

    Raises:
        GltfError: joints out of range, or invalid weights.
    """
    if primitive.joints is None or primitive.weights is None:
        raise GltfError(f"{where}: got a mesh without JOINTS_0 on a skin, expected them")
    used = np.where(primitive.weights > 0, primitive.joints, 0)  # unused joints may have any value
    if used.max() >= len(joints):
        raise GltfError(f"{where}: got joint {used.max()}, expected one of the skin's {len(joints)}")
    total = primitive.weights.sum(1, keepdims=True)
    if not (total > 0).all() or (primitive.weights < 0).any():
        raise GltfError(f"{where}: got vertices whose WEIGHTS are negative or all 0, expected a sum of 1")
    vertices = primitive.vertices.astype(float)
    world = np.zeros_like(vertices)
    # Sums over a vertex's joints one at a time: a matrix per vertex would take ten times the memory.
    for joint, share in zip(used.T, (primitive.weights / total).T, strict=True):
        turn = joints[joint]
        world += share[:, None] * (np.einsum("vij,vj->vi", turn[:, :3, :3], vertices) + turn[:, :3, 3])
    return world


class _Source:
    """The source of a primitive's attributes and indices: accessors, or Draco's data."""

    def __init__(self, item: Item, document: Document, accessors: Accessors):
        self._item, self._accessors = item, accessors
        self._attributes = item.required("attributes")
        self.mode = item.integer("mode", TRIANGLES)
        packed = item.extension(DRACO)
        if packed is not None and "bufferView" in accessors.accessor(self._attributes, "POSITION"):
            packed = None  # the same uncompressed, without loss
        self._mesh = None if packed is None else _draco(packed, document)
        self._ids = None if packed is None else packed.required("attributes")
        if self._mesh is not None:
            self.mode = TRIANGLES  # Draco stores strips as triangles

    def floats(self, name: str, kind: str) -> np.ndarray:
        values = self._packed(name, kind)
        if values is None:
            return self._accessors.floats(self._attributes, name, kind)
        return real(values, self._accessors.accessor(self._attributes, name))

    def skin(self, count: int) -> tuple[np.ndarray | None, np.ndarray | None]:
        joints, weights = [], []
        while f"JOINTS_{len(joints)}" in self._attributes:
            names = f"JOINTS_{len(joints)}", f"WEIGHTS_{len(joints)}"
            if names[1] not in self._attributes:
                raise self._attributes.refused(names[1], f"weights with {names[0]}")
            packed = self._packed(names[0], "VEC4")
            joints.append(self._accessors.integers(self._attributes, names[0], "VEC4") if packed is None else packed)
            weights.append(self.floats(names[1], "VEC4"))
            for name, values in zip(names, (joints[-1], weights[-1]), strict=True):
                _same_count(self._attributes, name, values, count)
        if not joints:
            return None, None
        return np.concatenate(joints, 1).astype(np.int64), np.concatenate(weights, 1).astype(float)

    def indices(self) -> np.ndarray | None:
        if self._mesh is not None:
            return np.asarray(self._mesh.faces)
        if "indices" not in self._item:
            return None
        indices = self._accessors.integers(self._item, "indices", "SCALAR")[:, 0]
        if indices.max() == np.iinfo(indices.dtype).max:
            raise GltfError(
                f"{self._item.where}: got index {indices.max()}, which restarts a primitive, expected others"
            )
        return indices

    def _packed(self, name: str, kind: str) -> np.ndarray | None:
        if self._mesh is None or self._ids is None or name not in self._ids:
            return None
        which = self._ids.integer(name)
        found = next((a for a in self._mesh.attributes if a["unique_id"] == which), None)
        size = int(kind[3:])
        if found is None or found["num_components"] != size:
            raise self._ids.refused(name, f"the id of an attribute with {size} components in the data")
        return np.asarray(found["data"]).reshape(-1, size)


def _draco(packed: Item, document: Document) -> Any:
    view = document.refers(packed, "bufferView", "bufferViews")
    if view is None:
        raise packed.refused("bufferView", "one")
    if packed.child("attributes") is None:
        raise packed.refused("attributes", "an object")
    content = bytes(document.slice(view))
    try:
        import DracoPy
    except ImportError:
        raise GltfError(
            f"{packed.where}: got compressed data, expected the package DracoPy to read it with: "
            "pip install 'warpopt[scene]'"
        ) from None
    try:
        mesh = DracoPy.decode(content)
    except Exception:  # broken data can raise anything
        raise GltfError(f"{packed.where}: got data that cannot be decompressed, expected Draco") from None
    if not hasattr(mesh, "faces"):
        raise GltfError(f"{packed.where}: got a cloud of points, expected triangles")
    return mesh


def _triangles(indices: np.ndarray | None, count: int, mode: int, item: Item) -> np.ndarray:
    """(T, 3) from a list of indices, or from all vertices in order if there is none."""
    if indices is None:
        indices = np.arange(count)
    if indices.size and indices.max() >= count:
        raise GltfError(f"{item.where}: got index {indices.max()}, expected indices below {count}, the vertices")
    listed = mode == TRIANGLES
    if indices.size < 3 or (listed and indices.size % 3):
        raise GltfError(
            f"{item.where}: got {indices.size} corners, expected " + ("a multiple of 3" if listed else "at least 3")
        )
    if listed:
        return indices.reshape(-1, 3)
    if mode == FAN:
        return np.stack([np.broadcast_to(indices[0], len(indices) - 2), indices[1:-1], indices[2:]], 1)
    # Every other triangle of a strip is reversed, so that all face the same side.
    strip = np.stack([indices[:-2], indices[1:-1], indices[2:]], 1)
    strip[1::2, 1:] = strip[1::2, :0:-1].copy()
    return strip


def _same_count(item: Item, name: str, values: np.ndarray, count: int) -> None:
    if len(values) != count:
        raise GltfError(f"{item.where}: got {len(values)} of {name}, expected {count}, one for each vertex")
