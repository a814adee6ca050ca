"""What a scene is read from: triangles, glTF, the sun; and every way in which input can be bad."""

import json
import subprocess
import sys
import types
import typing
from pathlib import Path

import numpy as np
import pytest
from scene_cases import BOX, CAMERA, HEIGHT, WIDTH, gltf, ground, invoke, run, toml

from warpopt.app.common.settings import ConfigError, read_config, validated
from warpopt.app.inputs.light_path import light_path
from warpopt.app.inputs.scene_files import read_scene
from warpopt.app.inputs.scene_settings import SceneLight
from warpopt.app.scene.settings import SceneConfig
from warpopt.scene_files.gltf import read_geometry, read_gltf_camera
from warpopt.scene_files.rasterise import rasterise
from warpopt.scene_files.scene_camera import SceneCamera, orientation


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_rasterising_agrees_with_rays_one_by_one():
    """Brute force: every ray against every triangle; some cross the near plane or reach behind the eye."""
    random = np.random.default_rng(5)
    turn = orientation(np.array([0.2, -0.1, -1]), np.array([0.1, 1.0, 0]), "right")
    camera = SceneCamera(np.array([1.0, 2, 3]), turn, 0.5, 30.0, (-0.5, 0.8, -0.3, 0.6))
    centres = random.uniform((-6, -6, -3), (6, 6, 20), (40, 1, 3))
    eye = centres + random.normal(0, 3, (40, 3, 3))
    depth = rasterise(eye @ turn + camera.position, camera, 30, 40)
    across, up = camera.slopes(30, 40)
    expected = np.full((30, 40), np.inf)
    for i, j in np.ndindex(30, 40):
        for a, b, c in eye:
            try:
                z, u, v = np.linalg.solve(np.stack([[across[j], up[i], 1.0], a - b, a - c], 1), a)
            except np.linalg.LinAlgError:
                continue
            if u >= 0 and v >= 0 and u + v <= 1 and 0.5 <= z < 30:
                expected[i, j] = min(expected[i, j], z)
    assert np.isfinite(expected).mean() > 0.3
    np.testing.assert_allclose(depth, np.where(np.isfinite(expected), expected, 0), rtol=1e-9)


def test_rasterising_knows_no_unit():
    """Depths in proportion to the scene, whose products over- and underflow; a near plane of no size to speak of."""
    triangles = np.array([[[-1.0, -1, 2], [1, -1, 2], [0, 1, 3]], [[-3.0, -1, -1], [3, -1, -1], [0, -1, 9]]])

    def drawn(scale: float, near: float) -> np.ndarray:
        camera = SceneCamera(np.zeros(3), np.eye(3), near * scale, 20.0 * scale, (-1.0, 1.0, -1.0, 1.0))
        return rasterise(triangles * scale, camera, 12, 12) / scale

    plain = drawn(1.0, 1e-3)
    assert (plain > 0).mean() > 0.3
    for scale, near in ((1e200, 1e-3), (1e-150, 1e-3), (1.0, 1e-300)):
        np.testing.assert_allclose(drawn(scale, near), plain, rtol=1e-12)


def test_gltf_nodes_and_camera_are_honoured(folder):
    Path("scene.gltf").write_text(json.dumps(gltf()))
    points = read_geometry(Path("scene.gltf")).triangles.reshape(-1, 3)
    np.testing.assert_allclose([points.min(0), points.max(0)], [[-30, 1, -38], [30, 1, -2]], atol=1e-12)
    camera = read_gltf_camera(Path("scene.gltf")).scene_camera(1.0)
    np.testing.assert_allclose(camera.position, [0, 5, -4], atol=1e-12)
    np.testing.assert_allclose(camera.rotation, [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-12)
    text = toml("gltf = { file = 'scene.gltf', width = 96 }", camera="")
    told = run(text)
    assert told["cameras"][0]["far"] == 200.0
    assert told["problems"][0]["outcome"] == "tie"
    # The ground is 4 below the eye: z = 4 / -(y/z), from z = -4 to -38.
    depth = read_scene(read_config(Path("scene.toml"), [], SceneConfig), folder).depths[0]
    across, up = camera.slopes(HEIGHT, WIDTH)
    z = 4 / np.where(up < 0, -up, np.nan)[:, None] + 0 * across
    hit = (z < 34) & (np.abs(z * across) < 30)
    assert hit.mean() > 0.2
    np.testing.assert_allclose(depth, np.where(hit, z, 0), rtol=1e-6)


def test_what_hangs_on_a_camera_is_read(folder):
    held = gltf(extra_nodes=[{"mesh": 0, "translation": [0, 0, -3], "scale": [0.1, 1, 0.2]}])
    held["nodes"][3]["children"] = [4]
    Path("held.gltf").write_text(json.dumps(held))
    triangles = read_geometry(Path("held.gltf")).triangles
    points = triangles[triangles[:, 0, 1] > 4].reshape(-1, 3)  # at the camera's height
    np.testing.assert_allclose([points.min(0), points.max(0)], [[-0.1, 5, -7.2], [0.1, 5, -6.8]], atol=1e-7)


def test_the_sun_over_a_day():
    """Closed forms: noon's elevation is 90 - latitude + declination; at the equinox it rises in the east at six."""
    path = {"latitude_deg": 48.0, "declination_deg": 0.0, "start_hour": 3, "stop_hour": 12, "count": 4}
    steps, lights = light_path(SceneLight.model_validate({"path": path}), "right")
    assert [s.light for s in steps] == [None, None, 0, 1]  # at six it is on the horizon
    assert steps[-1].elevation_deg == pytest.approx(42.0)
    # North is -z, so east is +x, and the noon sun in the south shines to the north.
    assert lights[0][0] < 0
    np.testing.assert_allclose(lights[1], [0, -np.sin(np.deg2rad(42)), -np.cos(np.deg2rad(42))], atol=1e-12)
    _, mirrored = light_path(SceneLight.model_validate({"path": path}), "left")
    assert mirrored[0][0] == -lights[0][0]


def test_a_missing_reader_is_named_with_the_extra(folder, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    packed = gltf()
    packed["accessors"][0].pop("bufferView")
    draco = {"bufferView": 0, "attributes": {"POSITION": 0}}
    packed["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": draco}
    Path("scene.gltf").write_text(json.dumps(packed))
    Path("a.exr").write_bytes(bytes.fromhex("762f3101") + bytes(20))
    for receivers in ("gltf = { file = 'scene.gltf' }", "depth = { files = 'a.exr' }"):
        Path("scene.toml").write_text(toml(receivers))
        assert invoke("scene.toml") == 2
        assert "pip install 'warpopt[scene]'" in capsys.readouterr().err


def test_files_are_refused_without_waiting_for_jax(folder):
    Path("scene.toml").write_text(toml("depth = { files = 'none.npy' }"))
    code = (
        "import sys, warpopt.app.cli as cli\n"
        "try:\n    cli.main(['scene', 'scene.toml'])\n"
        "except SystemExit as e:\n    print(e.code, 'jax' in sys.modules)\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout == "2 False\n"


def with_view(matrix: str) -> str:
    return toml(BOX, camera=f"view_matrix = {matrix}\nnear = 1.0\nfar = 9.0\nhalf_fov_deg = 20.0")


def depth_of(name: str) -> str:
    return toml(f"depth = {{ files = '{name}' }}")


BAD = {
    "singular view matrix": (
        with_view("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]"),
        ["camera.0.view_matrix: got", "not singular"],
    ),
    "scaled view matrix": (
        with_view("[[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"),
        ["camera.0.view_matrix: got", "expected a rigid"],
    ),
    "zero light": (toml(BOX, light="direction = [0, 0, 0]"), ["light.direction: got [0, 0, 0], expected a vector"]),
    "NaN light": (toml(BOX, light="direction = [nan, 0, 0]"), ["light.direction: got [nan, 0, 0], expected", "finite"]),
    "zero light on a path": (
        toml(BOX, light="path = [[0, -1, 0], [0, 0, 0]]"), ["light.path.1: got [0, 0, 0], expected a vector"],
    ),
    "two lights": (toml(BOX, light="direction = [0, -1, 0]\npath = [[0, -1, 0]]"), ["light", "exactly one of"]),
    "up along the view": (toml(BOX, camera=CAMERA + "\nup = [0, 0.1, 1]"), ["camera.0", "not parallel"]),
    "no camera": (toml(BOX, camera=""), ["camera: missing"]),
    "two kinds of receivers": (toml(BOX + "\nwhole_frustum = {}"), ["receivers", "exactly one of"]),
    "box inside out": (toml("box = { lower = [0, 0, 0], upper = [1, -1, 1] }"), ["receivers.box.upper", "lower"]),
    "max in l2": (toml(BOX, more="[objective]\nmetrics = ['max']\nnorms = ['l2']"), ["got a mean of 'max' with box"]),
    "screen alone": (toml(BOX, more="[objective]\nscreen = [100, 50]"), ["screen and shadow_map"]),
    "unknown key": (toml("box = { lower = [0, 0, 0], uper = [1, 1, 1] }"), ["receivers.box.uper: unknown key"]),
    "missing depth": (depth_of("none.npy"), ["receivers.depth.files.0", "none.npy", "cannot be read"]),
    "depth of wrong aspect": (depth_of("square.npy"), ["got 20 x 20 pixels, expected width / height = 1.77778"]),
    "depth of wrong size": (
        toml("depth = { files = 'good.npy', size = [64, 36] }"), ["got 96 x 54 pixels, expected 64 x 36"],
    ),
    "NaN depth": (depth_of("nan.npy"), ["nan.npy: got NaN in row 3, column 5 (1 of 5,184", "expected numbers"]),
    "integers without a scale": (depth_of("millimetres.npy"), ["got integers (uint16)", "0.001 for millimetres"]),
    "depth out of range": (
        toml("depth = { files = 'good.npy', encoding = 'reversed' }"), ["expected numbers in [0, 1]", "'reversed'"],
    ),
    "depth with channels": (depth_of("rgb.npy"), ["got an array of shape (54, 96, 3), expected (height, width)"]),
    "pickled depth": (depth_of("pickle.npy"), ["cannot be read as .npy"]),
    "no depth file": (depth_of("text.npy"), ["text.npy: "]),
    "broken OpenEXR": (depth_of("broken.exr"), ["cannot be read as OpenEXR"]),
    "two depth files for one camera": (
        toml("depth = { files = ['good.npy', 'good.npy'] }"), ["got 2 for 1 camera(s), expected one for each"],
    ),
    "missing glTF": (toml("gltf = { file = 'none.glb' }"), ["receivers.gltf.file", "none.glb", "cannot be read"]),
    "empty glTF": (toml("gltf = { file = 'empty.gltf' }"), ["empty.gltf", "got no triangle, expected"]),
    "no glTF": (toml("gltf = { file = 'text.npy' }"), ["not glTF", "expected .gltf or .glb"]),
    "broken glTF": (toml("gltf = { file = 'broken.gltf' }"), ["broken.gltf: cannot be read as glTF"]),
    "glTF of NaN": (toml("gltf = { file = 'nan.gltf' }"), ["nan.gltf: ", "got vertices that are NaN or infinite"]),
    "glTF without camera": (
        toml("gltf = { file = 'empty.gltf' }", camera=""), ["got 0 camera(s)", "receivers.gltf.camera"],
    ),
    "far of the file's camera too near": (
        toml("gltf = { file = 'endless.gltf', far = 0.1 }", camera=""), ["got far 0.1, expected more than 0.5"],
    ),
    "whole frustum without far": (
        toml("whole_frustum = {}", camera=CAMERA.replace("far = ", "#")), ["camera.far: missing or inf"],
    ),
    "planes without end": (
        toml("planes = { planes = [[0, 1, 0, 0]] }", camera=CAMERA.replace("far = ", "#")),
        ["receivers, seen by camera.0: ", "unbounded body"],
    ),
    "pinhole without cy": (
        toml(BOX, camera="position = [0, 1, 0]\nforward = [0, 0, -1]\nnear = 1.0\nfx = 10.0\nfy = 10.0\ncx = 4.0"),
        ["camera.0", "got a pinhole camera without cy, expected fx, fy, cx and cy"],
    ),
    "pinhole of no image": (
        toml(BOX, camera=CAMERA.partition("half_fov")[0] + "fx = 9.0\nfy = 9.0\ncx = 4.0\ncy = 4.0"),
        ["camera.0: image_size: missing"],
    ),
    "two fields of view": (toml(BOX, camera=CAMERA + "\nhalf_fov_x_deg = 20.0"), ["camera.0", "exactly one of"]),
    "measure of pixels": (
        toml("depth = { files = 'good.npy' }", more="[objective]\nmeasure = 'volume'"),
        ["objective.measure: got 'volume' with depth", "the pixels have weights"],
    ),
    "axis of a box": (toml(BOX, more="[objective]\nmeasure = 'axis'"), ["got 'axis' with box"]),
    "eye axis of no matrix": (
        toml(BOX, camera=CAMERA + "\nlooks_along = '+z'"), ["camera.0: got looks_along without view_matrix, expected"],
    ),
    "up beside a matrix": (
        with_view("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\nup = [0, 1, 0]"),
        ["camera.0: got up with view_matrix, expected one or the other"],
    ),
    "true as a slope": (
        toml(BOX, camera=CAMERA.partition("half_fov")[0] + "window = [-1, true, -1, 1]"),
        ["camera.0.window.1: got True, expected a valid number"],
    ),
    "text as a slope": (
        toml(BOX, camera=CAMERA.partition("half_fov")[0] + "window = ['-1', 1, -1, 1]"),
        ["camera.0.window.0: got '-1', expected a valid number"],
    ),
    "true as a width": (toml("landscape = { width = true }"), ["landscape.width: got True, expected a valid integer"]),
    "true as pixels": (
        toml(BOX, more="[objective]\nscreen = [true, 9]\nshadow_map = [9, 9]"), ["objective.screen.0: got True"],
    ),
    "text as a flag": (
        toml("depth = { files = 'good.npy', nan_is_background = 'yes' }"), ["got 'yes', expected true or false"],
    ),
    "light of no file": (toml(BOX, light="from_file = true"), ["light.from_file: got one without receivers.gltf"]),
    "no light in the file": (
        toml("gltf = { file = 'endless.gltf' }", light="from_file = true"), ["got no directional light"],
    ),
}  # fmt: skip


def kinds_of(annotation: typing.Any) -> set[typing.Any]:
    """What a field may be: the types of a union, and the tables of a list."""
    if typing.get_origin(annotation) is typing.Annotated:
        return kinds_of(typing.get_args(annotation)[0])
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return set().union(*map(kinds_of, typing.get_args(annotation)))
    tables = typing.get_origin(annotation) is list and kinds_of(typing.get_args(annotation)[0])
    return tables if tables and all(hasattr(kind, "model_fields") for kind in tables) else {annotation}


def scalars_of(model: typing.Any) -> dict[str, set[typing.Any]]:
    """The fields of a configuration and of the tables in it that hold a number or a flag, by their path."""
    found = {}
    for name, field in model.model_fields.items():
        kinds = kinds_of(field.annotation)
        found |= {name: kinds} if kinds & {int, float, bool} and str not in kinds else {}
        for kind in kinds:
            found |= (
                {f"{name}.{inner}": v for inner, v in scalars_of(kind).items()} if hasattr(kind, "model_fields") else {}
            )
    return found


@pytest.mark.parametrize("path", scalars_of(SceneConfig))
def test_no_number_is_true_or_text_and_no_flag_is_a_number(path):
    """Every field of a scene, as it is declared. Killed: a table that is not strict."""
    *tables, key = path.split(".")
    kinds = scalars_of(SceneConfig)[path]
    for wrong in ("1", True) if bool not in kinds else ("yes", 1):
        data = {key: wrong}
        for table in reversed(tables):
            data = {table: data}
        with pytest.raises(ConfigError) as error:
            validated(SceneConfig, data, "scene")
        assert f"{key}: got {wrong!r}, expected" in str(error.value)


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_told_and_nothing_is_written(folder, capsys, name):
    good = ground()
    np.save("good.npy", good)
    np.save("square.npy", np.ones((20, 20)))
    np.save("rgb.npy", np.ones((54, 96, 3)))
    np.save("pickle.npy", np.array([{}, 1], object), allow_pickle=True)
    np.save("millimetres.npy", (1000 * good).astype(np.uint16))
    bad = good.copy()
    bad[3, 5] = np.nan
    np.save("nan.npy", bad)
    Path("text.npy").write_text("no array")
    Path("broken.exr").write_bytes(bytes.fromhex("762f3101") + bytes(20))
    Path("empty.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "scene": 0}))
    broken = gltf()
    broken["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 7
    Path("broken.gltf").write_text(json.dumps(broken))
    endless = gltf(lens={"yfov": 0.8, "znear": 0.5})
    Path("endless.gltf").write_text(json.dumps(endless))
    hole = gltf(positions=np.array([[-1, 0, -1], [-1, np.nan, 1], [1, 0, 1], [1, 0, -1]], "f4"))
    for accessor in hole["accessors"]:
        accessor.pop("min", None)
        accessor.pop("max", None)
    Path("nan.gltf").write_text(json.dumps(hole))
    text, words = BAD[name]
    Path("scene.toml").write_text(text)
    before = {path.name for path in folder.iterdir()}
    assert invoke("scene.toml") == 2
    message = capsys.readouterr().err
    for word in words:
        assert word in message, message
    assert "Traceback" not in message
    assert len(message.splitlines()) <= 4, message
    assert {path.name for path in folder.iterdir()} == before


def test_without_an_objective_what_is_known_decides():
    """A mask's edges; over pixels alone the band by depth; a norm or a metric that is given, or a body, as always."""
    plain = {"camera": {}, "light": {}, "output": {}}
    mask = {"weights": {"lit": "mask.png"}}
    cases = (
        ({"receivers": {"depth": {}}}, mask, ("edge", "edges")),
        ({"receivers": {"depth": {}}}, {}, ("band", "depth")),
        ({"receivers": {"made": {}}}, {"weights": {"by": "uniform"}}, ("band", "uniform")),
        ({"receivers": {"depth": {}}}, {"objective": {"norms": "inf"}}, (None, None)),
        ({"receivers": {"box": {}}}, {}, (None, None)),
    )
    for receivers, more, (metric, by) in cases:
        found = SceneConfig._by_what_is_known(plain | receivers | more)
        assert found.get("objective", {}).get("metrics") == metric
        assert found.get("weights", {}).get("by") == by
