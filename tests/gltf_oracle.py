"""An independent reader of the glTF 2.0 specification: vertex by vertex, in plain Python, sharing nothing with ours.

It trusts its input, and knows neither Draco nor meshopt: tests compare those with the same data written out.
"""

import base64
import itertools
import math
import struct

import numpy as np

_FORMATS = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5125: "I", 5126: "f"}
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_NORMAL = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}


def triangles(data: dict) -> np.ndarray:
    """World triangles (N, 3, 3) of the default scene of a document whose buffers are data URIs."""
    reader = _Reader(data)
    scene = data["scenes"][data.get("scene", 0)]
    found = []
    for root in scene["nodes"]:
        reader.visit(root, True, found)
    return np.array(found, float).reshape(-1, 3, 3)


def box(corners: np.ndarray) -> np.ndarray:
    """(least, largest) of all corners."""
    points = corners.reshape(-1, 3)
    return np.stack([points.min(0), points.max(0)])


def areas(corners: np.ndarray) -> np.ndarray:
    """Of each triangle, by Heron's formula in Kahan's order."""
    sides = [math.dist for _ in range(3)]
    result = []
    for p, q, r in corners:
        a, b, c = sorted((f(*e) for f, e in zip(sides, ((p, q), (q, r), (r, p)), strict=True)), reverse=True)
        result.append(math.sqrt(max((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)), 0)) / 4)
    return np.array(result)


class _Reader:
    def __init__(self, data: dict):
        self.data = data
        self.buffers = [base64.b64decode(b["uri"].split(",")[1]) for b in data.get("buffers", [])]
        self.parents = {child: i for i, node in enumerate(data["nodes"]) for child in node.get("children", [])}

    def elements(self, index: int) -> list[tuple]:
        accessor = self.data["accessors"][index]
        size, kind = _SIZES[accessor["type"]], accessor["componentType"]
        if "bufferView" in accessor:
            values = self._raw(accessor, accessor["count"], size, kind)
        else:
            values = [(0,) * size] * accessor["count"]
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            where = self._raw(sparse["indices"], sparse["count"], 1, sparse["indices"]["componentType"])
            what = self._raw(sparse["values"], sparse["count"], size, kind)
            for (place,), value in zip(where, what, strict=True):
                values[place] = value
        if accessor.get("normalized"):
            values = [tuple(max(v / _NORMAL[kind], -1.0) for v in value) for value in values]
        return values

    def _raw(self, place: dict, count: int, size: int, kind: int) -> list[tuple]:
        view = self.data["bufferViews"][place["bufferView"]]
        form = struct.Struct("<" + _FORMATS[kind] * size)
        start = view.get("byteOffset", 0) + place.get("byteOffset", 0)
        step = view.get("byteStride", form.size)
        return [form.unpack_from(self.buffers[view["buffer"]], start + i * step) for i in range(count)]

    def visit(self, index: int, visible: bool, found: list) -> None:
        node = self.data["nodes"][index]
        extensions = node.get("extensions", {})
        visible = visible and extensions.get("KHR_node_visibility", {}).get("visible", True)
        if visible and "mesh" in node:
            self._mesh(index, node, extensions.get("EXT_mesh_gpu_instancing"), found)
        for child in node.get("children", []):
            self.visit(child, visible, found)

    def to_world(self, index: int, point: tuple) -> tuple:
        """Up the tree, node by node."""
        while index is not None:
            point = self._moved(self.data["nodes"][index], point)
            index = self.parents.get(index)
        return point

    @staticmethod
    def _moved(node: dict, point: tuple) -> tuple:
        if "matrix" in node:
            m = node["matrix"]  # column by column
            return tuple(sum(m[4 * c + r] * v for c, v in enumerate((*point, 1.0))) for r in range(3))
        scaled = [s * v for s, v in zip(node.get("scale", (1, 1, 1)), point, strict=True)]
        *axis, w = node.get("rotation", (0, 0, 0, 1))
        length = math.sqrt(sum(a * a for a in axis) + w * w)
        axis, w = [a / length for a in axis], w / length
        # v + 2 w (q x v) + 2 q x (q x v)
        once = np.cross(axis, scaled)
        turned = scaled + 2 * w * once + 2 * np.cross(axis, once)
        return tuple(t + v for t, v in zip(node.get("translation", (0, 0, 0)), turned, strict=True))

    def _mesh(self, index: int, node: dict, instancing: dict | None, found: list) -> None:
        mesh = self.data["meshes"][node["mesh"]]
        weights = node.get("weights", mesh.get("weights", []))
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", 4)
            if mode < 4 or "POSITION" not in primitive["attributes"]:
                continue
            points = [tuple(p) for p in self.elements(primitive["attributes"]["POSITION"])]
            for weight, target in zip(weights, primitive.get("targets", []), strict=False):
                if "POSITION" in target:
                    deltas = self.elements(target["POSITION"])
                    points = [
                        tuple(p + weight * d for p, d in zip(*both, strict=True))
                        for both in zip(points, deltas, strict=True)
                    ]
            order = [i for (i,) in self.elements(primitive["indices"])] if "indices" in primitive else None
            order = list(range(len(points))) if order is None else order
            if mode == 4:
                faces = [order[i : i + 3] for i in range(0, len(order), 3)]
            elif mode == 5:
                faces = [order[i : i + 3] for i in range(len(order) - 2)]
            else:
                faces = [[order[0], *pair] for pair in itertools.pairwise(order[1:])]
            for world in self._placed(index, node, primitive, points, instancing):
                found += [[world[i] for i in face] for face in faces]

    def _placed(self, index: int, node: dict, primitive: dict, points: list, instancing: dict | None) -> list[list]:
        if "skin" in node:
            return [self._skinned(self.data["skins"][node["skin"]], primitive["attributes"], points)]
        if instancing is None:
            return [[self.to_world(index, p) for p in points]]
        names = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
        columns = {names[k]: self.elements(v) for k, v in instancing["attributes"].items() if k in names}
        count = self.data["accessors"][next(iter(instancing["attributes"].values()))]["count"]
        places = [{name: values[i] for name, values in columns.items()} for i in range(count)]
        return [[self.to_world(index, self._moved(place, p)) for p in points] for place in places]

    def _skinned(self, skin: dict, attributes: dict, points: list) -> list:
        inverse = self.elements(skin["inverseBindMatrices"]) if "inverseBindMatrices" in skin else None
        joints, shares = [[] for _ in points], [[] for _ in points]
        for number in itertools.count():
            if f"JOINTS_{number}" not in attributes:
                break
            for i, both in enumerate(
                zip(
                    self.elements(attributes[f"JOINTS_{number}"]),
                    self.elements(attributes[f"WEIGHTS_{number}"]),
                    strict=True,
                )
            ):
                joints[i] += both[0]
                shares[i] += both[1]
        world = []
        for point, js, ws in zip(points, joints, shares, strict=True):
            at = np.zeros(3)
            for j, w in ((j, w) for j, w in zip(js, ws, strict=True) if w):
                bound = self._moved({"matrix": inverse[j]}, point) if inverse else point
                at += w / sum(ws) * np.array(self.to_world(skin["joints"][j], bound))
            world.append(tuple(at))
        return world
