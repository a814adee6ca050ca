"""What a glTF file shows, against an independent reader of the specification (`gltf_oracle`)."""

import json
import struct
from pathlib import Path

import gltf_oracle
import numpy as np
import pytest
from gltf_cases import FACES, MAKERS, QUAD, Builder, document, random_document
from hypothesis import given, settings
from hypothesis import strategies as st

from warpopt.scene_files.gltf import read_geometry, read_gltf_camera, read_light
from warpopt.scene_files.rasterise import rasterise

CASES = Path(__file__).parent / "cases"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(data: dict, path: Path = Path("scene.gltf")) -> Path:
    path.write_text(json.dumps(data))
    return path


def agrees(found: np.ndarray, expected: np.ndarray) -> None:
    """Boxes, areas and middles, triangle by triangle; the corners' order may differ by a turn."""
    assert found.shape == expected.shape
    size = np.abs(expected).max()
    # Single precision in the file is exact in both; a chain of transforms rounds by some eps of the largest number.
    near = {"rtol": 1e-12, "atol": 1e-12 * size}
    np.testing.assert_allclose(gltf_oracle.box(found), gltf_oracle.box(expected), **near)
    np.testing.assert_allclose(found.mean(1), expected.mean(1), **near)
    # Heron's formula loses half the digits of a sliver.
    np.testing.assert_allclose(gltf_oracle.areas(found), gltf_oracle.areas(expected), atol=1e-7 * size**2)


@pytest.mark.parametrize("name", MAKERS)
def test_every_kind_is_read_as_the_specification_says(folder, name):
    data = document(name)
    agrees(read_geometry(written(data)).triangles, gltf_oracle.triangles(data))


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_trees_of_random_meshes_agree(tmp_path_factory, seed):
    data = random_document(seed)
    path = written(data, tmp_path_factory.mktemp("random") / "scene.gltf")
    agrees(read_geometry(path).triangles, gltf_oracle.triangles(data))


def test_a_strip_shows_one_side(folder):
    b = Builder()
    b.node(mesh=b.mesh(b.accessor(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]], "f4")), mode=5))
    first, second, third = read_geometry(written(b.done())).triangles
    for a, b, c in (first, second, third):
        np.testing.assert_allclose(np.cross(b - a, c - a), [0, 0, 1])


def _glb(data: dict, blob: bytes) -> bytes:
    text = json.dumps(data).encode()
    text += b" " * (-len(text) % 4)
    blob += bytes(-len(blob) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def test_the_three_packings_are_one(folder):
    b = Builder()
    b.node(mesh=b.quad())
    expected = gltf_oracle.triangles(b.done())
    apart = b.data | {"buffers": [{"byteLength": len(b.blob), "uri": "the%20blob.bin"}]}
    Path("the blob.bin").write_bytes(b.blob + b"more")
    agrees(read_geometry(written(apart)).triangles, expected)
    Path("scene.glb").write_bytes(_glb(b.data | {"buffers": [{"byteLength": len(b.blob)}]}, b.blob))
    agrees(read_geometry(Path("scene.glb")).triangles, expected)


def test_without_a_default_scene_the_first_is_shown_and_without_scenes_all(folder):
    data = document("a tree")
    data["scenes"].append({"nodes": [4]})
    expected = gltf_oracle.triangles(data)
    del data["scene"]
    agrees(read_geometry(written(data)).triangles, expected)
    del data["scenes"]
    data["scene"] = 0
    both = read_geometry(written({k: v for k, v in data.items() if k != "scene"})).triangles
    agrees(both, gltf_oracle.triangles(data | {"scenes": [{"nodes": [0, 4]}]}))


def _compressed(b: Builder, positions: np.ndarray, faces: np.ndarray, extension: str) -> None:
    """A quad in meshopt's compression, whose fallback buffer has no bytes."""
    meshopt = pytest.importorskip("meshopt")
    views = [
        (positions, "ATTRIBUTES", {"filter": "NONE"}, positions.shape[1] * positions.itemsize),
        (faces, "TRIANGLES", {}, faces.itemsize),
    ]
    for values, mode, more, stride in views:
        packed = meshopt.encode_gltf_buffer(values, mode)
        held = b.data["bufferViews"][b.view(packed)]
        inner = {"buffer": 0, "byteOffset": held["byteOffset"], "byteLength": held["byteLength"], **more}
        inner |= {"byteStride": stride, "count": len(values), "mode": mode}
        held |= {"buffer": 1, "byteOffset": 0, "byteLength": values.nbytes, "extensions": {extension: inner}}
        if mode == "ATTRIBUTES":
            held["byteStride"] = stride
    b.data["accessors"] = [
        {"bufferView": 0, "componentType": 5126, "count": len(positions), "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": len(faces), "type": "SCALAR"},
    ]
    b.node(mesh=b.mesh(0, 1))


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_compression_is_undone(folder, extension):
    b = Builder()
    _compressed(b, QUAD, FACES, extension)
    data = b.done() | {"extensionsUsed": [extension], "extensionsRequired": [extension]}
    data["buffers"].append({"byteLength": 10_000, "extensions": {extension: {"fallback": True}}})
    plain = Builder()
    plain.node(mesh=plain.quad())
    expected = gltf_oracle.triangles(plain.done())
    found = read_geometry(written(data)).triangles
    # The codec may begin a triangle at another corner.
    agrees(found, expected)


def _draco(b: Builder, **more) -> dict:
    draco = pytest.importorskip("DracoPy")
    packed = draco.encode(QUAD, FACES.reshape(-1, 3).astype("u4"), quantization_bits=16, preserve_order=True)
    extension = {"KHR_draco_mesh_compression": {"bufferView": b.view(packed), "attributes": {"POSITION": 0}}}
    b.data["accessors"] = [
        {"componentType": 5126, "count": 4, "type": "VEC3"}, {"componentType": 5123, "count": 6, "type": "SCALAR"},
    ]  # fmt: skip
    b.node(mesh=b.mesh(0, 1, extensions=extension, **more), translation=[0, 0, -3])
    return b.done() | {"extensionsRequired": list(extension), "extensionsUsed": list(extension)}


def test_meshopt_filters_are_undone(folder):
    """Mantissas of 20 bits: the encoder rounds to 2^-19 of the largest number."""
    meshopt = pytest.importorskip("meshopt")
    b = Builder()
    values = np.random.default_rng(2).uniform(-1, 1, (9, 3)).astype("f4")
    packed = meshopt.encode_gltf_buffer(meshopt.encode_filter_exp(values, 20), "ATTRIBUTES")
    inner = {"buffer": 0, "byteOffset": 0, "byteLength": len(packed), "byteStride": 12, "count": 9}
    held = b.data["bufferViews"][b.view(packed)]
    held["extensions"] = {"EXT_meshopt_compression": inner | {"mode": "ATTRIBUTES", "filter": "EXPONENTIAL"}}
    b.data["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 9, "type": "VEC3"})
    b.node(mesh=b.mesh(0))
    np.testing.assert_allclose(read_geometry(written(b.done())).triangles.reshape(-1, 3), values, atol=2**-19)


def test_what_is_beside_draco_is_preferred(folder):
    """Without loss, and without the package."""
    b = Builder()
    mesh = b.quad()
    extension = {"bufferView": 0, "attributes": {"POSITION": 0}}  # which is no Draco
    b.data["meshes"][mesh]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": extension}
    b.node(mesh=mesh)
    data = b.done() | {"extensionsUsed": ["KHR_draco_mesh_compression"]}
    agrees(read_geometry(written(data)).triangles, gltf_oracle.triangles(data))


@pytest.mark.parametrize("mode", [4, 5])
def test_draco_is_undone(folder, mode):
    """A strip's mode is of what was packed; what comes out is triangles."""
    triangles = read_geometry(written(_draco(Builder(), mode=mode))).triangles
    # 16 bits over a width of 2.
    np.testing.assert_allclose(gltf_oracle.box(triangles), [[-1, 0, -4], [1, 0, -2]], atol=2 / 2**16)
    np.testing.assert_allclose(gltf_oracle.areas(triangles), [2, 2], rtol=1e-4)


def test_what_is_left_out_is_said(folder):
    data = document("modes")
    data["materials"] = [{"name": "leaves", "alphaMode": "MASK"}, {"name": "glass", "alphaMode": "BLEND"}]
    data["meshes"][0]["primitives"][0]["material"] = 0
    data["meshes"][1]["primitives"][0]["material"] = 1
    data["meshes"][3]["primitives"].append({"attributes": {"NORMAL": 0}})
    data["nodes"][2]["extensions"] = {"KHR_node_visibility": {"visible": False}}
    data["nodes"][2]["name"] = "ghost"
    data["extensionsUsed"] = ["KHR_node_visibility", "KHR_texture_transform", "ACME_unheard_of"]
    report = read_geometry(written(data), exclude=["cloud*"]).report
    assert (report.points, report.lines, report.without_position) == (1, 3, 1)
    assert (report.hidden, report.masked, report.blended) == (("ghost",), ("leaves",), ("glass",))
    assert report.unknown_extensions == ("ACME_unheard_of",)
    notes = "; ".join(report.notes())
    for words in ("1 primitive of points", "3 primitives of lines", "without POSITION", "'ghost'", "opaque: 'leaves'"):
        assert words in notes
    assert "no node or material is named like 'cloud*'" in notes
    assert "'ACME_unheard_of'" in notes


def test_nodes_and_materials_are_chosen_by_name(folder):
    b = Builder()
    mesh = b.quad()
    b.data["materials"] = [{"name": "Cloud_01"}]
    b.data["meshes"].append({"primitives": [{**b.data["meshes"][mesh]["primitives"][0], "material": 0}]})
    b.node(name="World", children=[1, 2, 3])
    b.node(name="ground", mesh=mesh)
    b.node(name="SkyDome", children=[4], scale=[900, 900, 900])
    b.node(name="veil", mesh=1, translation=[0, 50, 0])
    b.node(name="half", mesh=mesh)  # below the sky
    path = written(b.done())
    tops = {
        (): 900.0, ("sky*",): 1.0, ("Sky*", "CLOUD*"): 1.0, ("cloud*",): 900.0,
    }  # fmt: skip
    for exclude, top in tops.items():
        found = read_geometry(path, exclude=exclude)
        assert np.abs(found.triangles[..., 0]).max() == top, exclude
        assert len(found.triangles) == 6 - 2 * len(exclude)
    assert read_geometry(path, exclude=["sky*"]).report.excluded == ("half",)
    assert len(read_geometry(path, include=["ground", "cloud*"]).triangles) == 4
    with pytest.raises(ValueError, match=r"got no triangle.*no node or material is named like 'Ground floor'"):
        read_geometry(path, include=["Ground floor"])


def test_files_that_failed_are_read(folder):
    """Each against the same scene written out."""
    for name, other, exclude in (
        ("sparse", "sparse_expanded", ()),
        ("instancing", "instancing_expanded", ()),
        ("sky", "nosky", ["sky*"]),
    ):
        found = read_geometry(CASES / f"{name}.gltf", exclude=exclude).triangles
        agrees(found, gltf_oracle.triangles(json.loads((CASES / f"{other}.gltf").read_text())))
    hidden = read_geometry(CASES / "hidden_node.gltf")
    np.testing.assert_allclose(gltf_oracle.box(hidden.triangles), [[-0.5, 0, -5.5], [0.5, 0, -4.5]])
    assert hidden.report.hidden == ("node 1",)
    assert read_geometry(CASES / "empty_primitive.gltf").report.without_position == 1
    camera = read_gltf_camera(CASES / "poly_camera.gltf")
    assert camera.far == np.inf
    assert camera.aspect is None
    np.testing.assert_allclose(camera.rotation[2], [0, -0.198997, -0.98], atol=1e-6)  # 11.5 degrees down


def test_a_camera_without_far_sees_all(folder):
    """Closed form: the ground y = 0 from -40 to 0 in z under the camera, up to where a ray ends beyond it."""
    camera = read_gltf_camera(CASES / "poly_camera.gltf").scene_camera(1.5)
    depth = rasterise(read_geometry(CASES / "poly_camera.gltf").triangles, camera, 60, 90)
    across, up = camera.slopes(60, 90)
    rays = np.stack([*np.broadcast_arrays(across, up[:, None], 1.0)], -1) @ camera.rotation
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 1] < 0, -3 / rays[..., 1], np.inf)
    with np.errstate(invalid="ignore"):
        x, back = z * rays[..., 0], 4 + z * rays[..., 2]
    hit = np.isfinite(z) & (np.abs(x) < 20) & (back > -40) & (back < 0)
    assert 0.2 < hit.mean() < 0.8
    np.testing.assert_allclose(depth[hit], z[hit], rtol=1e-6)
    assert (depth[~hit] > 0).mean() < 0.02  # the small quad ahead of z = 0, and edges


def _seen(b: Builder) -> None:
    b.data["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.5}},
        {"type": "orthographic", "name": "plan", "orthographic": {"xmag": 4, "ymag": -2, "znear": 0, "zfar": 9}},
    ]
    b.node(name="boom", translation=[0, 5, 0], rotation=[0, np.sqrt(0.5), 0, np.sqrt(0.5)], children=[1, 2])
    b.node(name="eye", translation=[4, 0, 0], scale=[2, 3, 4], camera=0)
    b.node(name="above", rotation=[-np.sqrt(0.5), 0, 0, np.sqrt(0.5)], camera=1)


def test_cameras_by_name_and_index(folder):
    b = Builder()
    _seen(b)
    path = written(b.done())
    eye = read_gltf_camera(path, "eye")
    assert eye.kind == "perspective"
    assert (eye.near, eye.far, eye.half_fov, eye.aspect) == (0.5, np.inf, 0.4, None)
    # The boom turns x to -z and -z to -x; the camera's own scale does not count.
    np.testing.assert_allclose(eye.position, [0, 5, -4], atol=1e-12)
    np.testing.assert_allclose(eye.rotation, [[0, 0, -1], [0, 1, 0], [-1, 0, 0]], atol=1e-12)
    assert eye.scene_camera(2.0).aspect == pytest.approx(2.0)
    b.data["nodes"][1]["scale"] = [-2, 3, 4]  # a mirror keeps its hand
    mirrored = read_gltf_camera(written(b.done()), "eye").rotation
    np.testing.assert_allclose(mirrored, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-12)
    plan = read_gltf_camera(path, "plan")
    assert read_gltf_camera(path, 1).name == plan.name == "above"
    assert (plan.kind, plan.half_size, plan.aspect, plan.half_fov) == ("orthographic", (4, 2), 2, None)
    np.testing.assert_allclose(plan.rotation[2], [0, -1, 0], atol=1e-12)
    seen = plan.scene_camera(1.0)  # its near plane passes through it: moved back by its depth
    assert (seen.is_orthographic, seen.window, seen.near, seen.far) == (True, (-4, 4, -2, 2), 9, 18)
    np.testing.assert_allclose(seen.position, plan.position + np.array([0, 9, 0]), atol=1e-12)
    for which, words in (("eyes", r"got 0 cameras named 'eyes' of 2 \('eye', 'above'\)"), (2, "index 2")):
        with pytest.raises(ValueError, match=words):
            read_gltf_camera(path, which)


def test_the_directional_light_travels_along_its_nodes_minus_z(folder):
    b = Builder()
    lights = [{"type": "point"}, {"type": "directional", "name": "sun"}, {"type": "directional", "name": "moon"}]
    b.data["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    half = np.sqrt(0.5)
    lit = [{"KHR_lights_punctual": {"light": i}} for i in range(3)]
    b.node(children=[1, 2, 3], scale=[1, 5, 1])
    b.node(extensions=lit[0])
    b.node(extensions=lit[1], rotation=[-half, 0, 0, half], name="day")
    b.node(extensions=lit[2] | {"KHR_node_visibility": {"visible": False}})
    np.testing.assert_allclose(read_light(written(b.done())), [0, -1, 0], atol=1e-12)
    del b.data["nodes"][3]["extensions"]["KHR_node_visibility"]
    path = written(b.done())
    with pytest.raises(ValueError, match=r"got 2 directional lights \('day', 'moon'\), expected one, or a choice"):
        read_light(path)
    np.testing.assert_allclose(read_light(path, "moon"), [0, 0, -1], atol=1e-12)
    assert read_light(path, "sun") == read_light(path, "day") == read_light(path, 0)
    b.data["scenes"][0]["nodes"] = []
    with pytest.raises(ValueError, match="got no directional light"):
        read_light(written(b.done()))
