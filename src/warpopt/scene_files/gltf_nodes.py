"""The nodes of a glTF file: which ones the scene shows, and their transforms."""

import dataclasses

import numpy as np

from .gltf_accessors import Accessors
from .gltf_document import Document
from .gltf_item import GltfError, Item

_INSTANCED = "EXT_mesh_gpu_instancing"
# A unit quaternion in signed bytes may be off by 1 %; twice the length is an error.
_UNIT = 0.05


@dataclasses.dataclass(frozen=True, eq=False)
class Node:
    """A node that the scene shows.

    Attributes:
        item: the node's JSON object.
        world: (4, 4), node to world.
        visible: by `KHR_node_visibility` of the node and all its ancestors.
        above: its parent; None for a root.
    """

    item: Item
    world: np.ndarray
    visible: bool
    above: "Node | None"

    def names(self) -> list[str]:
        """The node's name and those of its ancestors."""
        names, node = [], self
        while node is not None:
            names.append(node.item.text("name"))
            node = node.above
        return names


class Nodes:
    """The node tree of a document.

    Attributes:
        shown: the nodes of the default scene, depth first; of the first scene if no default is named, and all nodes if
            there is no scene.
        worlds: (4, 4) of every node.
    """

    def __init__(self, document: Document):
        """Walk the tree.

        Raises:
            GltfError: nodes that are not a tree, or an invalid transform.
        """
        items = [document.item("nodes", i) for i in range(document.count("nodes"))]
        children = [document.indices(item, "children", "nodes") for item in items]
        parent: dict[int, int] = {}
        for i, own in enumerate(children):
            for child in own:
                if child in parent:
                    raise GltfError(
                        f"{items[child].where}: got two parents, {items[parent[child]].where} and {items[i].where}, "
                        "expected a tree of nodes"
                    )
                parent[child] = i
        self.worlds: dict[int, np.ndarray] = {}
        nodes: dict[int, Node] = {}
        below: dict[int, list[int]] = {}
        for root in range(len(items)):
            if root in parent:
                continue
            stack, order = [root], []
            while stack:
                index = stack.pop()
                order.append(index)
                above = nodes.get(parent.get(index, -1))
                nodes[index] = _placed(items[index], above)
                self.worlds[index] = nodes[index].world
                stack += reversed(children[index])
            below[root] = order
        if len(nodes) < len(items):
            lost = next(i for i in range(len(items)) if i not in nodes)
            raise GltfError(f"{items[lost].where}: got nodes that go in a circle, expected a tree of nodes")
        self.shown = [nodes[i] for root in _roots(document, items, parent) for i in below[root]]


def instances(node: Item, accessors: Accessors) -> np.ndarray | None:
    """(K, 4, 4), instance to node; None for a node that is not instanced.

    Raises:
        GltfError: attributes of different counts, or none.
    """
    extension = node.extension(_INSTANCED)
    if extension is None:
        return None
    attributes = extension.child("attributes")
    if attributes is None or not attributes.data:
        raise extension.refused("attributes", "at least one")
    counts = {key: accessors.count(attributes, key) for key in attributes.data}
    if len(set(counts.values())) != 1:
        raise GltfError(f"{attributes.where}: got counts {', '.join(map(str, counts.values()))}, expected equal ones")
    (count,) = set(counts.values())
    parts = []
    for key, kind, default in (
        ("TRANSLATION", "VEC3", [0, 0, 0]),
        ("ROTATION", "VEC4", [0, 0, 0, 1]),
        ("SCALE", "VEC3", [1, 1, 1]),
    ):
        given = accessors.floats(attributes, key, kind) if key in attributes else np.array([default])
        parts.append(np.broadcast_to(given.astype(float), (count, len(default))))
    return _transform(*parts, where=attributes.where)


def _roots(document: Document, items: list[Item], parent: dict[int, int]) -> list[int]:
    if not document.count("scenes"):
        return [i for i in range(len(items)) if i not in parent]
    which = document.index(document.root, "scene", "scenes") if "scene" in document.root else 0
    scene = document.item("scenes", which)
    roots = document.indices(scene, "nodes", "nodes")
    for i in roots:
        if i in parent:
            raise GltfError(f"{scene.where}: got {items[i].where}, which is a child of another, expected roots")
    if len(set(roots)) < len(roots):
        raise scene.refused("nodes", "each of them once")
    return roots


def _placed(item: Item, above: Node | None) -> Node:
    # Broken numbers may overflow; non-finite values are refused where they are used.
    with np.errstate(over="ignore", invalid="ignore"):
        local = _local(item)
        world = local if above is None else above.world @ local
    visibility = item.extension("KHR_node_visibility")
    visible = visibility is None or visibility.flag("visible", True)
    return Node(item, world, visible and (above is None or above.visible), above)


def _local(item: Item) -> np.ndarray:
    given = [key for key in ("translation", "rotation", "scale") if key in item]
    if "matrix" in item:
        if given:
            raise GltfError(f"{item.where}: got matrix and {given[0]}, expected one or the other")
        matrix = item.numbers("matrix", [], 16).reshape(4, 4).T
        if np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-6:
            raise GltfError(f"{item.where}: got a matrix whose last row is not 0, 0, 0, 1, expected an affine one")
        return matrix
    if not given:
        return np.eye(4)
    parts = (
        item.numbers("translation", [0, 0, 0]),
        item.numbers("rotation", [0, 0, 0, 1]),
        item.numbers("scale", [1, 1, 1]),
    )
    return _transform(*(part[None] for part in parts), where=item.where)[0]


def _transform(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray, where: str) -> np.ndarray:
    """(K, 4, 4) of (K, 3), quaternions (K, 4) and (K, 3)."""
    length = np.sqrt((rotation * rotation).sum(1))
    # Also refuses NaN.
    wrong = ~(np.abs(length - 1) < _UNIT)
    if wrong.any():
        raise GltfError(f"{where}: got a rotation of length {length[wrong][0]:.3g}, expected a unit quaternion")
    x, y, z, w = (rotation / length[:, None]).T
    matrix = np.zeros((len(length), 4, 4))
    matrix[:, :3, :3] = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    matrix[:, :3, :3] *= scale[:, None]
    matrix[:, :3, 3] = translation
    matrix[:, 3, 3] = 1
    return matrix
