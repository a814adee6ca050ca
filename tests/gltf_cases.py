"""glTF documents of all kinds, as tagged data for the tests of the reader."""

import base64
import copy

import numpy as np

QUAD = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], "f4")
FACES = np.array([0, 1, 2, 0, 2, 3], "u2")
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


class Builder:
    """A document under construction: arrays go in, indices of accessors come out."""

    def __init__(self):
        self.blob = b""
        self.data = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [],
        }  # fmt: skip

    def view(self, content: bytes, **more) -> int:
        self.blob += b"\xab" * (-len(self.blob) % 4)  # not zeros, so that what reads there is seen
        self.data["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(content), **more})
        self.blob += content
        return len(self.data["bufferViews"]) - 1

    def accessor(self, values, normalized: bool = False, stride: int = 0, offset: int = 0, sparse=None) -> int:
        """Args: stride: bytes between elements; sparse: (places, values) over the given ones, or over none if None."""
        if values is None:
            like = np.asarray(sparse[1])
            count, found = int(sparse[2]), {}
        else:
            like = np.asarray(values).reshape(len(values), -1)
            count, content = len(like), like.tobytes()
            if stride:
                rows = np.full((count, stride), 0xCD, "u1")
                rows[:, : like.strides[0]] = like.view("u1").reshape(count, -1)
                content = rows.tobytes()
            found = {"bufferView": self.view(b"\xef" * offset + content, **({"byteStride": stride} if stride else {}))}
        found |= {"componentType": _COMPONENTS[like.dtype.str[1:]], "count": count, "type": _KINDS[like.shape[1]]}
        if offset:
            found["byteOffset"] = offset
        if normalized:
            found["normalized"] = True
        if sparse is not None:
            places, replaced = np.asarray(sparse[0]), np.asarray(sparse[1])
            found["sparse"] = {
                "count": len(places),
                "indices": {
                    "bufferView": self.view(places.tobytes()),
                    "componentType": _COMPONENTS[places.dtype.str[1:]],
                },
                "values": {"bufferView": self.view(replaced.tobytes())},
            }
        self.data["accessors"].append(found)
        return len(self.data["accessors"]) - 1

    def mesh(self, positions: int, indices: int | None = None, **more) -> int:
        attributes = {"POSITION": positions, **more.pop("attributes", {})}
        primitive = {"attributes": attributes, **more}
        if indices is not None:
            primitive["indices"] = indices
        self.data["meshes"].append({"primitives": [primitive]})
        return len(self.data["meshes"]) - 1

    def quad(self) -> int:
        return self.mesh(self.accessor(QUAD), self.accessor(FACES))

    def node(self, **node) -> int:
        self.data["nodes"].append(node)
        return len(self.data["nodes"]) - 1

    def done(self) -> dict:
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.blob).decode()
        return self.data | {"buffers": [{"byteLength": len(self.blob), "uri": uri}]}


def _strided(b):
    b.node(mesh=b.mesh(b.accessor(QUAD, stride=20, offset=8), b.accessor(FACES, offset=4)))


def _modes(b):
    ring = np.array([[np.cos(a), 0.1 * a, np.sin(a)] for a in np.linspace(0, 5, 7)], "f4")
    for mode, order in ((4, [0, 2, 1, 3, 4, 6]), (5, [0, 1, 2, 3, 5, 4]), (6, [3, 1, 0, 5, 6])):
        b.node(mesh=b.mesh(b.accessor(ring), b.accessor(np.array(order, "u1")), mode=mode), translation=[0, mode, 0])
    b.node(mesh=b.mesh(b.accessor(ring[:6])), scale=[2, 1, 1])
    b.node(mesh=b.mesh(b.accessor(ring), mode=5), scale=[1, 3, 1])
    b.node(mesh=b.mesh(b.accessor(ring), mode=6), scale=[1, 1, 4])
    for mode in range(4):
        b.node(mesh=b.mesh(b.accessor(1000 * ring), mode=mode))
    b.data["scenes"][0]["nodes"] = list(range(10))


def _tree(b):
    mesh = b.quad()
    b.node(children=[1, 2], rotation=[0.5, 0.5, 0.5, 0.5], translation=[1, 2, 3])
    b.node(mesh=mesh, scale=[-2, 3, -0.5], rotation=[0, 0, 0.6, 0.8])
    b.node(children=[3], matrix=[0, 2, 0, 0, -1, 0, 0, 0, 0, 0.5, 3, 0, 5, 6, 7, 1])
    b.node(mesh=mesh, scale=[1, 1, -4], translation=[0, 0, 9])
    b.node(mesh=mesh, translation=[1000, 0, 0])  # in no scene


def _sparse(b):
    places = np.array([1, 3], "u1")
    based = b.accessor(QUAD, sparse=(places, 2 * QUAD[[1, 3]]))
    bare = b.accessor(None, sparse=(np.array([0, 2, 4], "u4"), QUAD[:3] + np.float32(3), 6))
    b.node(mesh=b.mesh(based, b.accessor(FACES)), children=[1])
    b.node(mesh=b.mesh(bare))


def _quantised(b):
    for i, kind in enumerate(("i1", "u1", "i2", "u2")):
        top = np.iinfo(kind).max
        values = np.array([[-top - 1 if kind[0] == "i" else 0, 0, 1], [top, 5, 2], [3, top, top]], kind)
        for j, normalized in enumerate((True, False)):
            positions = b.accessor(values, normalized=normalized, stride=8)
            b.node(mesh=b.mesh(positions), scale=[0.5, 1, 2], translation=[i, j, 0])
    b.data["scenes"][0]["nodes"] = list(range(8))


def _instanced(b):
    attributes = {
        "TRANSLATION": b.accessor(np.array([[0, 0, -5], [3, 1, -9]], "f4")),
        "ROTATION": b.accessor(np.array([[0, 90, 0, 90], [127, 0, 0, 0]], "i1"), normalized=True),
        "SCALE": b.accessor(np.array([[1, 2, 3], [-1, 1, 0.5]], "f4")),
        "_ID": b.accessor(np.array([7, 8], "u2"), stride=4),
    }
    extension = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    b.node(mesh=b.quad(), extensions=extension, translation=[0, 10, 0], scale=[2, 2, 2], children=[1])
    b.node(mesh=0, extensions={"EXT_mesh_gpu_instancing": {"attributes": {"_ID": attributes["_ID"]}}})


def _hidden(b):
    mesh = b.quad()
    b.node(mesh=mesh, children=[1, 3], extensions={"KHR_node_visibility": {"visible": True}})
    b.node(mesh=mesh, scale=[9, 9, 9], children=[2], extensions={"KHR_node_visibility": {"visible": False}})
    b.node(mesh=mesh, scale=[9, 9, 9], extensions={"KHR_node_visibility": {"visible": True}})
    b.node(mesh=mesh, translation=[0, 1, 0], extensions={"KHR_node_visibility": {}})


def _morphed(b):
    lift = b.accessor(np.array([[0, 1, 0], [0, 2, 0], [0, 3, 0], [0, 4, 0]], "f4"))
    turn = b.accessor(None, sparse=(np.array([2], "u2"), np.array([[64, -128, 127]], "i1"), 4), normalized=True)
    targets = [{"POSITION": lift}, {"POSITION": turn}, {"NORMAL": lift}]
    mesh = b.mesh(b.accessor(QUAD), b.accessor(FACES), targets=targets)
    b.data["meshes"][mesh]["weights"] = [0.5, -2, 1]
    b.node(mesh=mesh, children=[1, 2])
    b.node(mesh=mesh, weights=[0, 1, 0], translation=[5, 0, 0])
    b.node(mesh=b.mesh(b.accessor(QUAD), b.accessor(FACES), targets=targets), translation=[9, 0, 0])  # no weights: 0


def _skinned(b):
    inverse = np.array([np.eye(4), np.eye(4)], "f4")
    inverse[1, 3, :3] = [0, -2, 1]  # column by column: the last row is the translation
    joints = np.array([[0, 1, 9, 0], [1, 0, 0, 0], [0, 1, 1, 0], [1, 1, 0, 0]], "u1")
    # Joint 9, which there is not, has no weight.
    weights = np.array([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0.25, 0.25, 0.5, 0], [1, 0, 0, 0]], "f4")
    attributes = {
        "JOINTS_0": b.accessor(joints), "WEIGHTS_0": b.accessor(weights),
        "JOINTS_1": b.accessor(joints[::-1].astype("u2")),
        "WEIGHTS_1": b.accessor((weights * 255).astype("u1"), normalized=True),
    }  # fmt: skip
    mesh = b.mesh(b.accessor(QUAD), b.accessor(FACES), attributes=attributes)
    b.data["skins"] = [{"joints": [2, 3], "inverseBindMatrices": b.accessor(inverse)}, {"joints": [3, 2]}]
    b.node(children=[1, 2, 4], translation=[0, 1, 0])
    b.node(mesh=mesh, skin=0, translation=[100, 100, 100])  # which a skin does not heed
    b.node(children=[3], rotation=[0, 0.6, 0, 0.8])
    b.node(translation=[0, 2, 0], scale=[1, -1, 3])
    b.node(mesh=mesh, skin=1)


def _bare(b):
    b.node(mesh=b.quad(), children=[1])
    b.data["meshes"].append({"primitives": [{"attributes": {}}, {"attributes": {"POSITION": 0}, "indices": 1}]})
    b.node(mesh=1, translation=[0, 0, 4])


MAKERS = {
    "strides and offsets": _strided, "modes": _modes, "a tree": _tree, "sparse": _sparse, "quantised": _quantised,
    "instanced": _instanced, "hidden": _hidden, "morphed": _morphed, "skinned": _skinned, "no position": _bare,
}  # fmt: skip


def document(name: str) -> dict:
    builder = Builder()
    MAKERS[name](builder)
    return builder.done()


def random_document(seed: int) -> dict:
    """A tree of up to eight nodes with meshes of any mode, type, stride and sparseness."""
    random = np.random.default_rng(seed)
    b = Builder()
    count = int(random.integers(1, 9))
    parents = [int(random.integers(-1, i)) if i else -1 for i in range(count)]
    for i in range(count):
        node = {"translation": random.normal(0, 5, 3).tolist(), "scale": random.uniform(-2, 2, 3).tolist()}
        turn = random.normal(size=4)
        node["rotation"] = (turn / np.linalg.norm(turn)).tolist()
        if random.random() < 0.3:
            matrix = np.eye(4)
            matrix[:, :3] = random.normal(size=(4, 3))
            node = {"matrix": matrix.ravel().tolist()}
        children = [j for j in range(count) if parents[j] == i]
        if children:
            node["children"] = children
        if i == 0 or random.random() < 0.7:
            node["mesh"] = _random_mesh(b, random)
        b.node(**node)
    b.data["scenes"][0]["nodes"] = [i for i in range(count) if parents[i] < 0]
    return b.done()


def _random_mesh(b: Builder, random: np.random.Generator) -> int:
    kind = random.choice(["i1", "u1", "i2", "u2", "f4"])
    vertices = int(random.integers(3, 12))
    if kind == "f4":
        values = random.normal(size=(vertices, 3)).astype("f4")
    else:
        limits = np.iinfo(kind)
        values = random.integers(limits.min, limits.max, (vertices, 3), endpoint=True).astype(kind)
    options = {"normalized": bool(kind != "f4" and random.random() < 0.5)}
    if random.random() < 0.5:
        options["stride"] = int(values.strides[0] + 4 * random.integers(0, 4)) + 3 & ~3
    if random.random() < 0.3:
        places = np.sort(random.choice(vertices, 2, replace=False)).astype("u2")
        options["sparse"] = (places, values[::-1][:2].copy())
    mode = int(random.integers(4, 7))
    corners = 3 * int(random.integers(1, 5)) if mode == 4 else int(random.integers(3, 9))
    indices = b.accessor(random.integers(0, vertices, corners).astype(random.choice(["u1", "u2", "u4"])))
    return b.mesh(b.accessor(values, **options), indices, mode=mode)


VALUES = [
    None, True, -1, 0, 1, 3, 2**31, 10**30, 0.5, 1e308, float("nan"), "", "x", "VEC3", [], [0], [1e308] * 3, {},
    {"a": 1},
]  # fmt: skip


def mutated(data: dict, random: np.random.Generator) -> dict:
    """Some values of a document replaced, moved or taken away."""
    data = copy.deepcopy(data)
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        places = []

        def walk(value, places=places):
            items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
            for key, inner in items:
                if key != "uri":
                    places.append((value, key))
                    walk(inner)

        walk(data)
        holder, key = places[random.integers(len(places))]
        if random.random() < 0.2 and isinstance(holder, dict):
            del holder[key]
        elif random.random() < 0.7 and isinstance(holder[key], int) and not isinstance(holder[key], bool):
            holder[key] += int(random.integers(-3, 4))
        elif random.random() < 0.7 and isinstance(holder[key], float):
            holder[key] *= random.normal()
        else:
            holder[key] = copy.deepcopy(VALUES[random.integers(len(VALUES))])
    return data
