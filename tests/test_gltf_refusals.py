"""Every way in which a glTF file can be wrong is refused in one sentence with the file, the place and the reason."""

import json
import struct
import sys
from pathlib import Path

import gltf_oracle
import numpy as np
import pytest
from gltf_cases import QUAD, Builder, document

from warpopt.scene_files.gltf import read_geometry, read_gltf_camera, read_light


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def plain() -> dict:
    b = Builder()
    b.node(name="ground", mesh=b.quad())
    return b.done()


def changed(*path, to=None, **values):
    """The plain document with something at a path changed, or taken away if `to` is `...`."""

    def make() -> dict:
        data = plain()
        at = data
        for key in path[:-1]:
            at = at[key]
        if values:
            at[path[-1]].update(values)
        elif to is ...:
            del at[path[-1]]
        else:
            at[path[-1]] = to
        return data

    return make


def of(name: str, *path, **values):
    def make() -> dict:
        data = at = document(name)
        for key in path:
            at = at[key]
        at.update(values)
        return data

    return make


def _without(data: dict, kind: str, index: int, key: str) -> dict:
    del data[kind][index][key]
    return data


PRIMITIVE = ("meshes", 0, "primitives", 0)
INSTANCED = {"EXT_mesh_gpu_instancing": {"attributes": {"_ID": 0}}}
MESHOPT = {"buffer": 0, "byteLength": 40, "byteStride": 12, "count": 4, "mode": "ATTRIBUTES"}
BAD = {
    "version 1": (changed("asset", to={"version": "1.0"}), "got glTF of version 1.0, expected 2.0"),
    "no version": (changed("asset", to={}), "got glTF of version none"),
    "a version to come": (changed("asset", minVersion="2.1"), "minVersion 2.1"),
    "no asset": (changed("asset", to=...), "not glTF"),
    "mode 7": (changed(*PRIMITIVE, mode=7), "node 0 'ground': mesh 0, primitive 0: got mode 7, expected 0 to 6"),
    "index of no node": (changed("scenes", 0, nodes=[5]), "scene 0: got nodes 5, expected one of the file's 1 nodes"),
    "index of no mesh": (
        changed("nodes", 0, mesh=3),
        "node 0 'ground': got mesh 3, expected one of the file's 1 meshes",
    ),
    "index that is half": (changed("nodes", 0, mesh=0.5), "got mesh 0.5, expected an integer from 0"),
    "index that is true": (changed("nodes", 0, mesh=True), "got mesh true, expected an integer"),
    "index of no vertex": (
        changed("accessors", 0, count=3),
        "node 0 'ground': mesh 0, primitive 0: got index 3, expected indices below 3",
    ),
    "a circle": (changed("nodes", 0, children=[0]), "node 0 'ground': got nodes that go in a circle"),
    "two parents": (
        of("a tree", "nodes", 1, children=[3]),
        "node 3: got two parents, node 1 and node 2, expected a tree",
    ),
    "a child as a root": (of("a tree", "scenes", 0, nodes=[0, 1]), "scene 0: got node 1, which is a child"),
    "a root twice": (changed("scenes", 0, nodes=[0, 0]), "expected each of them once"),
    "matrix and scale": (
        changed("nodes", 0, matrix=np.eye(4).ravel().tolist(), scale=[1, 1, 1]),
        "got matrix and scale",
    ),
    "a perspective matrix": (changed("nodes", 0, matrix=[1.0] * 16), "last row is not 0, 0, 0, 1"),
    "a long quaternion": (
        changed("nodes", 0, rotation=[0, 0, 0, 2]),
        "rotation of length 2, expected a unit quaternion",
    ),
    "two numbers": (changed("nodes", 0, scale=[1, 2]), "got scale [1, 2], expected 3 finite numbers"),
    "children that are text": (changed("nodes", 0, children="1"), "expected a list of nodes"),
    "nodes that are none": (changed("nodes", to=3), "the file: got nodes 3, expected a list"),
    "a node that is none": (changed("nodes", to=[7]), "node 0: got 7, expected an object"),
    "no accessor": (changed("accessors", to=[None]), "expected one of the file's 1 accessors"),
    "component type": (
        changed("accessors", 0, componentType=5124),
        "accessor 0: got componentType 5124, expected one of 5120",
    ),
    "a kind": (changed("accessors", 0, type="VEC2"), "accessor 0: got type 'VEC2', expected 'VEC3'"),
    "float indices": (changed("accessors", 1, componentType=5126, count=3), "expected 5121, 5123 or 5125"),
    "count beyond the view": (changed("accessors", 0, count=10**12), "expected at most the 48 of buffer view 0"),
    "an offset beyond the view": (changed("accessors", 0, byteOffset=4), "got 52 bytes, expected at most the 48"),
    "a view's end": (changed("bufferViews", 1, byteLength=13), "buffer view 1: got bytes 48 to 61, expected at most"),
    "a count that is none": (changed("accessors", 0, count=0), "got count 0, expected an integer from 1"),
    "triangles without end": (changed("accessors", 1, count=10**15), "expected at most 50,000,000"),
    "zeros without end": (
        changed("accessors", 0, to={"componentType": 5126, "count": 10**14, "type": "VEC3"}),
        "without a bufferView",
    ),
    "a view beyond its buffer": (
        changed("bufferViews", 0, byteLength=10**12),
        "buffer view 0: got bytes 0 to 1,000,000,000,000",
    ),
    "a stride in an element": (changed("bufferViews", 0, byteStride=4), "got byteStride 4, expected at least 12"),
    "a buffer beyond its data": (
        changed("buffers", 0, byteLength=10**13),
        "buffer 0: got byteLength 10,000,000,000,000, expected at most the 60",
    ),
    "no buffer": (changed("buffers", to=...), "expected one of the file's 0 buffers"),
    "a missing buffer": (changed("buffers", 0, uri="none.bin"), "buffer 0: none.bin: cannot be read: No such file"),
    "a buffer elsewhere": (
        changed("buffers", 0, uri="https://example.org/a.bin"),
        "expected a path relative to the file",
    ),
    "a buffer without a place": (
        changed("buffers", 0, "uri", to=...),
        "got no uri, expected one, as there is no binary chunk",
    ),
    "broken base64": (changed("buffers", 0, uri="data:;base64,AB!C"), "expected valid base64"),
    "corners": (changed("accessors", 1, count=5), "got 5 corners, expected a multiple of 3"),
    "two corners": (of("modes", "accessors", 3, count=2), "got 2 corners, expected at least 3"),
    "sparse index": (
        of("sparse", "accessors", 0, "sparse", "indices", bufferView=0),
        "accessor 0, sparse, indices: got places that do not rise",
    ),
    "sparse count": (of("sparse", "accessors", 0, "sparse", count=9), "got count 9, expected at most the accessor's 4"),
    "sparse signed": (
        of("sparse", "accessors", 0, "sparse", "indices", componentType=5120),
        "expected 5121, 5123 or 5125",
    ),
    "instances of two counts": (of("instanced", "accessors", 0, count=1), "got counts 1, 2, 2, 2, expected equal ones"),
    "instances without end": (
        changed("nodes", 0, extensions={"EXT_mesh_gpu_instancing": {"attributes": {}}}),
        "got attributes {}, expected at least one",
    ),
    "instances of another type": (of("instanced", "accessors", 0, type="VEC4"), "node 0: accessor 0: got type 'VEC4'"),
    "instances on a skin": (of("skinned", "nodes", 1, extensions=INSTANCED), "got instances of a mesh on a skin"),
    "no joints": (of("skinned", "skins", 0, joints=[]), "skin 0: got joints [], expected a list of nodes"),
    "a joint of no skin": (
        of("skinned", "skins", 0, joints=[2]),
        "node 1: mesh 0, primitive 0: got joint 1, expected one of the skin's 1",
    ),
    "matrices of zeros": (lambda: _without(document("skinned"), "accessors", 6, "bufferView"), "not affine"),
    "few matrices": (of("skinned", "skins", 0, joints=[2, 3, 1]), "got 2 inverseBindMatrices, expected 3"),
    "a skin without weights": (changed("nodes", to=[{"mesh": 0, "skin": 0}]), "expected one of the file's 0 skins"),
    "weights": (of("morphed", "nodes", 1, weights=[1]), "got 3 morph targets, expected 1"),
    "targets of other counts": (
        of("morphed", "accessors", 0, count=3),
        "got 3 of POSITION, expected 4, one for each vertex",
    ),
    "visibility": (
        of("hidden", "nodes", 0, "extensions", "KHR_node_visibility", visible=0),
        "got visible 0, expected true or false",
    ),
    "an extension required": (
        changed("extensionsRequired", to=["ACME_bent"]),
        "extensionsRequired 'ACME_bent', which is not read",
    ),
    "an extension that moves": (
        changed("extensionsUsed", to=["AGI_articulations"]),
        "'AGI_articulations', which is not read (its articulations",
    ),
    "extensions that are text": (changed("extensionsRequired", to="KHR_x"), "expected a list of names"),
    "meshopt without end": (
        changed("bufferViews", 0, extensions={"EXT_meshopt_compression": MESHOPT | {"count": 10**9}}),
        "than 40 compressed bytes can hold",
    ),
    "meshopt mode": (
        changed("bufferViews", 0, extensions={"EXT_meshopt_compression": MESHOPT | {"mode": "X"}}),
        "got mode 'X', expected one of ATTRIBUTES",
    ),
    "meshopt data": (
        changed("bufferViews", 0, extensions={"EXT_meshopt_compression": MESHOPT}),
        "data that cannot be decompressed",
    ),
    "Draco data": (
        lambda: (
            changed(
                *PRIMITIVE, extensions={"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
            )()
            | {
                "accessors": [
                    {"componentType": 5126, "count": 4, "type": "VEC3"},
                    {"componentType": 5123, "count": 6, "type": "SCALAR"},
                ]
            }
        ),
        "data that cannot be decompressed, expected Draco",
    ),
}


def told(path: Path) -> str:
    """The refusal of a file, checked for its form."""
    with pytest.raises(ValueError, match="cannot be read as glTF") as error:
        read_geometry(path)
    message = str(error.value)
    assert message.startswith(f"{path}: cannot be read as glTF: ")
    assert "\n" not in message
    assert "Error" not in message
    assert len(message) < 400
    return message


@pytest.mark.parametrize("name", [name for name in BAD if BAD[name][1] is not None])
def test_a_flaw_is_told_in_one_sentence(folder, capfd, name):
    if name.startswith("meshopt"):
        pytest.importorskip("meshopt")
    make, words = BAD[name]
    Path("bad.gltf").write_text(json.dumps(make()))
    assert words in told(Path("bad.gltf"))
    assert capfd.readouterr() == ("", "")


def test_numbers_that_overflow_are_refused_with_their_node(folder):
    b = Builder()
    b.node(name="high", scale=[1e200, 1, 1], children=[1])
    b.node(name="higher", scale=[1e200, 1, 1], mesh=b.quad())
    Path("bad.gltf").write_text(json.dumps(b.done()))
    assert "node 1 'higher': mesh 0, primitive 0: got vertices that are NaN or infinite" in told(Path("bad.gltf"))


def test_morph_weights_that_overflow_are_refused(folder):
    data = document("morphed")
    data["nodes"][1]["weights"] = [1e308, 0, 0]
    Path("bad.gltf").write_text(json.dumps(data))
    assert "node 1: mesh 0, primitive 0: got vertices that are NaN or infinite" in told(Path("bad.gltf"))


def test_a_deep_tree_is_no_burden(folder):
    """A chain of nodes: neither recursion nor a list of names for each."""
    b = Builder()
    for i in range(5000):
        b.node(name="link", translation=[0, 1, 0], children=[i + 1])
    b.node(mesh=b.quad())
    Path("deep.gltf").write_text(json.dumps(b.done()))
    assert read_geometry(Path("deep.gltf"), exclude=["sky"]).triangles[0, 0, 1] == 5000


def test_an_index_that_restarts_a_primitive_is_refused(folder):
    b = Builder()
    b.node(mesh=b.mesh(b.accessor(np.zeros((256, 3), "f4")), b.accessor(np.array([0, 1, 255], "u1"))))
    Path("bad.gltf").write_text(json.dumps(b.done()))
    assert "got index 255, which restarts a primitive" in told(Path("bad.gltf"))


def _glb(version=2, length=None, kind=0x4E4F534A, size=None, content=b'{"asset": {"version": "2.0"}}   ') -> bytes:
    size = len(content) if size is None else size
    length = 20 + len(content) if length is None else length
    return b"glTF" + struct.pack("<IIII", version, length, size, kind) + content


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not glTF"), (b"solid cube", "not glTF"), (b"\xff\xfe{", "not glTF"), (b"[1]", "not glTF"),
        (b'{"asset": {"version": "2.0"},\n "nodes": [}', "not JSON at line 2, column 12"),
        (b'{"a": ' + b"[" * 100_000, "too deep"), (b'{"a": ' + b"9" * 5000 + b"}", "too deep"),
        (b"glTF", "got a .glb of 4 bytes"), (_glb(version=1), "a .glb of version 1, expected 2"),
        (_glb(length=10**9), "expected the 1,000,000,000 that the header promises"),
        (_glb(size=10**9), "a chunk of 1,000,000,000 bytes"),
        (_glb(kind=5), "without a JSON chunk"), (_glb(), "got no triangle"),
    ],
)  # fmt: skip
def test_what_is_no_gltf_is_told(folder, content, words):
    Path("bad.glb").write_bytes(content)
    assert words in told(Path("bad.glb"))


def test_the_binary_chunk_is_the_first_buffer_alone(folder):
    data = plain()
    blob = b"\0" * 60
    data["buffers"] = [{"byteLength": 4, "uri": "data:;base64,AAAAAA=="}, {"byteLength": 60}]
    for view in data["bufferViews"]:
        view["buffer"] = 1
    content = json.dumps(data).encode()
    chunk = struct.pack("<II", len(blob), 0x004E4942) + blob
    Path("bad.glb").write_bytes(_glb(length=20 + len(content) + len(chunk), content=content) + chunk)
    assert "buffer 1: got no uri" in told(Path("bad.glb"))


def test_instances_multiply_the_triangles(folder):
    path = Path("many.gltf")
    path.write_text(json.dumps(document("instanced")))
    assert len(read_geometry(path, most_triangles=8).triangles) == 8
    with pytest.raises(ValueError, match=r"node 0: got 4 triangles and more, expected at most 3"):
        read_geometry(path, most_triangles=3)


def test_a_missing_file_stays_an_os_error(folder):
    for read in (read_geometry, read_gltf_camera, read_light):
        with pytest.raises(FileNotFoundError):
            read(Path("none.glb"))


def test_a_missing_library_is_named(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshopt", None)
    data = changed("bufferViews", 0, extensions={"EXT_meshopt_compression": MESHOPT})()
    Path("bad.gltf").write_text(json.dumps(data))
    assert "expected the package meshopt to read it with: pip install 'warpopt[meshopt]'" in told(Path("bad.gltf"))


CAMERAS = {
    "no type": ({}, "got no type"),
    "no lens": ({"type": "perspective"}, "got no perspective"),
    "no near": ({"type": "perspective", "perspective": {"yfov": 1}}, "got no znear"),
    "far before near": (
        {"type": "perspective", "perspective": {"yfov": 1, "znear": 2, "zfar": 1}},
        "expected 0 < znear < zfar",
    ),
    "aspect": ({"type": "perspective", "perspective": {"yfov": 1, "znear": 2, "aspectRatio": 0}}, "a number > 0"),
    "plan without far": (
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0}},
        "expected 0 <= znear",
    ),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_a_broken_camera_is_told(folder, name):
    b = Builder()
    b.data["cameras"] = [CAMERAS[name][0]]
    b.node(camera=0)
    Path("bad.gltf").write_text(json.dumps(b.done()))
    with pytest.raises(ValueError, match="camera 0") as error:
        read_gltf_camera(Path("bad.gltf"))
    assert CAMERAS[name][1] in str(error.value)


def test_a_sheared_camera_is_refused(folder):
    b = Builder()
    b.data["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}]
    b.node(scale=[1, 4, 1], children=[1])
    b.node(camera=0, rotation=[0.6, 0, 0, 0.8])
    Path("bad.gltf").write_text(json.dumps(b.done()))
    with pytest.raises(ValueError, match="node 1: got a camera in a sheared space"):
        read_gltf_camera(Path("bad.gltf"))


def test_the_quad_is_what_the_cases_are_about():
    """The table of flaws starts from a document that is read."""
    assert gltf_oracle.triangles(plain()).shape == (2, 3, 3)
    np.testing.assert_array_equal(gltf_oracle.box(gltf_oracle.triangles(plain())), [QUAD.min(0), QUAD.max(0)])
