"""`warpopt scene` end to end, and the readers behind it, each case in a folder of its own."""

import base64
import csv
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import warpopt
from warpopt.app import cli
from warpopt.app.config import read_config
from warpopt.app.error_maps import errors, image_of
from warpopt.app.light_path import light_path
from warpopt.app.scene_config import LightConfig, SceneConfig
from warpopt.app.scene_figures import seen_of
from warpopt.app.scene_input import read_scene
from warpopt.app.scene_solve import solve_scene
from warpopt.scene_files.gltf import read_camera, read_triangles
from warpopt.scene_files.rasterise import rasterise
from warpopt.scene_files.scene_camera import SceneCamera, centred_window, orientation

EXAMPLE = Path(__file__).parents[1] / "configs/landscape.toml"
CAMERA = (
    "position = [0, 2, 0]\nforward = [0, -0.1, -1]\nnear = 1.0\nfar = 100.0\nhalf_fov_deg = 25.0\naspect = 1.777778"
)
HEIGHT, WIDTH = 54, 96


def toml(receivers: str, light: str = "direction = [0.3, -1, -0.2]", camera: str = CAMERA, more: str = "") -> str:
    camera = camera and f"[camera]\n{camera}\n"
    return f"{camera}[light]\n{light}\n[receivers]\n{receivers}\n{more}\n[output]\ndirectory = 'out'\nfigures = false\n"


BOX = "box = { lower = [-20, 0, -80], upper = [20, 8, -5] }"


def ground(near=1.0, far=100.0) -> np.ndarray:
    """Eye depth of the plane y = 0 under the camera of the tests; 0 for the sky."""
    camera = SceneCamera(
        np.array([0, 2.0, 0]), orientation(np.array([0, -0.1, -1]), np.array([0, 1.0, 0]), "right"), near, far,
        centred_window(np.deg2rad(25), 16 / 9),
    )  # fmt: skip
    across, up = camera.slopes(HEIGHT, WIDTH)
    fall = -(camera.rotation[1, 1] * up[:, None] + camera.rotation[2, 1] + 0 * across)
    z = np.where(fall > 0, 2 / np.where(fall > 0, fall, 1), 0)
    return np.where(z < far, z, 0)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def invoke(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        cli.main(["scene", *arguments])
    return exit_.value.code


def run(text: str, *arguments: str) -> dict:
    """What scene.json says of a configuration, strictly read."""
    Path("scene.toml").write_text(text)
    assert invoke("scene.toml", *arguments) == 0
    return strict(Path("out/scene.json"))


def strict(path: Path) -> dict:
    def forbidden(constant):
        raise AssertionError(constant)

    return json.loads(path.read_text(), parse_constant=forbidden)


SMALL = ("--receivers.landscape.width", "96", "--receivers.landscape.cells", "48", "--objective.metrics", "p")


def test_the_worked_example_writes_what_the_library_computes(folder, capsys):
    arguments = [*SMALL, "--light.path.count", "3", "--output.directory", "out"]
    assert invoke(str(EXAMPLE), *arguments) == 0
    record = strict(folder / "out/run.json")
    assert record["files"] == sorted(path.name for path in (folder / "out").iterdir())
    maps = [name for name in record["files"] if name.startswith("error_map")]
    assert len(maps) == 3
    assert "light_path.png" in record["files"]
    for name in maps:
        assert f"({name})" in (folder / "out/report.md").read_text()
    config = read_config(EXAMPLE, arguments, SceneConfig)
    scene = read_scene(config, EXAMPLE.parent)
    camera = scene.cameras[0]
    right_handed = warpopt.Camera(
        camera.position, camera.rotation[2], (0, 1, 0), 1.0, 2000.0, np.deg2rad(26.0), 1920 / 1080
    )
    told = strict(folder / "out/scene.json")
    assert [p["light"] for p in told["problems"]] == [0, 1, 2]
    with (folder / "out/table.csv").open() as file:
        rows = list(csv.DictReader(file))
    problem = told["problems"][1]
    light = warpopt.DirectionalLight(problem["direction"])
    receivers = warpopt.DepthBuffer(scene.depths[0])
    solution = warpopt.scene_warp(
        right_handed, light, receivers, "p", "inf", screen=(1920, 1080), shadow_map=(2048, 2048)
    )
    assert problem["eta"] == pytest.approx(float(solution.warp.eta), rel=1e-9)
    assert float(rows[1]["eta"]) == problem["eta"]
    matrix = warpopt.shadow_matrix(right_handed, light, solution.footprint, solution.warp, casters=scene.casters)
    np.testing.assert_allclose(problem["matrix"], matrix, rtol=1e-6, atol=1e-9)
    # Every caster is in the map's depth range or behind, none before it; all that is seen is inside the map.
    seen = image_of(camera, np.where(scene.depths[0] > 0, scene.depths[0], np.inf))
    hit = np.isfinite(seen.depth)
    points = (seen.depth[..., None] * seen.slopes)[hit] @ camera.rotation + camera.position
    clip = np.c_[points, np.ones(len(points))] @ np.array(problem["matrix"]).T
    assert (clip[:, 3] > 0).all()
    assert (np.abs(clip[:, :3] / clip[:, 3:]) <= 1 + 1e-9).all()


def solved_of(text: str):
    Path("scene.toml").write_text(text)
    config = read_config(Path("scene.toml"), [], SceneConfig)
    scene = read_scene(config, Path())
    (solved,) = solve_scene(config, scene, lambda done: None)
    seen = seen_of(config, scene, solved)
    return solved, *(errors(solved.mapping, seen, solved.metric, warped) for warped in (True, False))


@pytest.mark.parametrize(
    ("receivers", "metric"),
    [
        ("depth = { files = 'ground.npy' }", "p"),
        ("depth = { files = 'ground.npy' }", "max"),
        (BOX, "p"),
        ("planes = { planes = [[0, 1, 0, 0], [0, -1, 0, 8], [0, 0, 1, 80], [0, 0, -1, -5]] }", "pxq"),
        ("whole_frustum = {}", "q"),
    ],
)
def test_the_maps_worst_pixel_is_the_norm(folder, receivers, metric):
    """The norm is the maximum over receivers, or over groups of them; pixels are a sample of what it is over."""
    np.save("ground.npy", ground())
    solved, best, plain = solved_of(toml(receivers, more=f"[objective]\nmetrics = ['{metric}']"))
    for error, key in ((best, "value"), (plain, "unwarped")):
        assert np.nanmax(error) <= solved.row[key] * (1 + 1e-9)
        assert np.nanmax(error) > 0.9 * solved.row[key]
    assert solved.row["value"] <= solved.row["unwarped"]


def test_the_maps_are_the_matrix_s_own_derivatives(folder):
    """Another method: errors from differences of the map's coordinates (t, s), as the matrix of scene.json has them."""
    np.save("ground.npy", ground())
    Path("scene.toml").write_text(toml("depth = { files = 'ground.npy' }"))
    config = read_config(Path("scene.toml"), [], SceneConfig)
    scene = read_scene(config, folder)
    (solved,) = solve_scene(config, scene, lambda done: None)
    seen, mapping, camera = seen_of(config, scene, solved), solved.mapping, scene.cameras[0]
    hit = np.isfinite(seen.depth)
    z, eye = seen.depth[hit], (seen.depth[..., None] * seen.slopes)[hit]

    def coordinate(points: np.ndarray, which: int) -> np.ndarray:
        world = points @ camera.rotation + camera.position
        x, y, _, w = (np.c_[world, np.ones(len(world))] @ np.array(solved.row["matrix"]).T).T
        return ((x, y)[which] / w + 1) / 2

    for metric, axis, which in (("p", mapping.z_axis, 1), ("q", mapping.x_axis, 0)):
        step = 1e-4 * axis
        change = (coordinate(eye + step, which) - coordinate(eye - step, which)) / 2e-4
        expected = mapping.densities[1 - which] / z / np.abs(change)
        np.testing.assert_allclose(errors(mapping, seen, metric, True)[hit], expected, rtol=1e-6)


def test_a_ground_plane_has_a_map_too(folder):
    """A body without thickness, drawn a row thick: the errors are those at its ends, within a row."""
    solved, best, plain = solved_of(toml("box = { lower = [-20, 0, -80], upper = [20, 0, -5] }"))
    assert np.nanmax(best) == pytest.approx(solved.row["value"], rel=0.1)
    assert np.nanmax(plain) == pytest.approx(solved.row["unwarped"], rel=0.1)


def exr(path: Path, depth: np.ndarray) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Z": depth.astype("f4")}).write(str(path))


def test_depth_buffers_agree_in_every_encoding_and_file_format(folder):
    z = ground()
    n, f = 1.0, 100.0
    safe = np.where(z > 0, z, 1)
    np.save("linear.npy", z)
    np.save("standard.npy", np.where(z > 0, f / (f - n) * (1 - n / safe), 1))
    reverse = np.where(z > 0, n / (f - n) * (f / safe - 1), 0)
    np.save("reversed.npy", reverse)
    exr(folder / "reversed.exr", reverse)
    etas = []
    for name, encoding in (("linear", "linear"), ("standard", "standard"), ("reversed", "reversed")):
        files = f"depth = {{ files = ['{name}.npy'], encoding = '{encoding}', size = [96, 54] }}"
        etas.append(run(toml(files))["problems"][0]["eta"])
    etas.append(run(toml("depth = { files = 'reversed.exr', encoding = 'reversed' }"))["problems"][0]["eta"])
    np.testing.assert_allclose(etas, etas[0], rtol=1e-5)


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


def gltf(extra_nodes: list | None = None, lens: dict | None = None, positions=None) -> dict:
    """A quad in y = 0 and a box, both below nodes that move them, and a camera on a boom."""
    quad = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], "f4") if positions is None else positions
    faces = np.array([[0, 1, 2], [0, 2, 3]], "u2")
    blob = quad.tobytes() + faces.tobytes()
    lens = {"yfov": 0.8, "aspectRatio": 16 / 9, "znear": 0.5, "zfar": 200.0} if lens is None else lens
    half = float(np.sqrt(0.5))
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"name": "moved", "translation": [0, 1, -20], "children": [1]},
            {"name": "ground", "mesh": 0, "scale": [30, 1, 18]},
            {"name": "boom", "translation": [0, 5, 0], "rotation": [0, half, 0, half], "children": [3]},
            # 4 along the boom's x, which points to world -z; turned back, so that it looks along -z.
            {"name": "eye", "translation": [4, 0, 0], "rotation": [0, -half, 0, half], "camera": 0},
            *(extra_nodes or []),
        ],
        "cameras": [{"type": "perspective", "perspective": lens}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "count": len(quad), "type": "VEC3",
                "min": quad.min(0).tolist(), "max": quad.max(0).tolist(),
            },
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": quad.nbytes},
            {"buffer": 0, "byteOffset": quad.nbytes, "byteLength": faces.nbytes},
        ],
        "buffers": [{"byteLength": len(blob), "uri": f"data:;base64,{base64.b64encode(blob).decode()}"}],
    }  # fmt: skip


def test_gltf_nodes_and_camera_are_honoured(folder):
    Path("scene.gltf").write_text(json.dumps(gltf()))
    points = read_triangles(Path("scene.gltf")).reshape(-1, 3)
    np.testing.assert_allclose([points.min(0), points.max(0)], [[-30, 1, -38], [30, 1, -2]], atol=1e-12)
    camera = read_camera(Path("scene.gltf"), 0, None, None)
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
    triangles = read_triangles(Path("held.gltf"))
    points = triangles[triangles[:, 0, 1] > 4].reshape(-1, 3)  # at the camera's height
    np.testing.assert_allclose([points.min(0), points.max(0)], [[-0.1, 5, -7.2], [0.1, 5, -6.8]], atol=1e-7)


def test_a_binary_gltf_and_a_camera_of_the_configuration(folder):
    import trimesh

    scene = trimesh.Scene()
    move = np.eye(4)
    move[:3, 3] = [0, 1, -30]
    scene.add_geometry(trimesh.creation.box((40, 2, 40)), transform=move)
    scene.export("scene.glb")
    told = run(toml("gltf = { file = 'scene.glb', width = 96 }"))
    assert told["cameras"][0]["position"] == [0, 2, 0]
    assert told["problems"][0]["outcome"] != "empty"


def test_the_sun_over_a_day():
    """Closed forms: noon's elevation is 90 - latitude + declination; at the equinox it rises in the east at six."""
    path = {"latitude_deg": 48.0, "declination_deg": 0.0, "start_hour": 3, "stop_hour": 12, "count": 4}
    steps, lights = light_path(LightConfig.model_validate({"path": path}), "right")
    assert [s.light for s in steps] == [None, None, 0, 1]  # at six it is on the horizon
    assert steps[-1].elevation_deg == pytest.approx(42.0)
    # North is -z, so east is +x, and the noon sun in the south shines to the north.
    assert lights[0][0] < 0
    np.testing.assert_allclose(lights[1], [0, -np.sin(np.deg2rad(42)), -np.cos(np.deg2rad(42))], atol=1e-12)
    _, mirrored = light_path(LightConfig.model_validate({"path": path}), "left")
    assert mirrored[0][0] == -lights[0][0]


def test_equal_cameras_and_lights_are_solved_once(folder):
    cameras = f"[[camera]]\n{CAMERA}\n[[camera]]\n{CAMERA}\n"
    light = "path = [[0.3, -1, -0.2], [0, -1, 0], [0.6, -2, -0.4], [-0.0, -3, 0]]"
    told = run(cameras + toml(BOX, light=light, camera=""))
    assert told["camera_of"] == [0, 0]
    assert [step["light"] for step in told["steps"]] == [0, 1, 0, 1]
    assert [(p["camera"], p["light"], p["metric"]) for p in told["problems"]] == [(0, 0, "p"), (0, 1, "p")]


def test_a_view_matrix_is_the_camera_that_it_is_of(folder):
    common = "near = 1.0\nfar = 100.0\nhalf_fov_deg = 25.0\n"
    flat = "position = [1, 2, 3]\ntarget = [1, 2, -3]\n" + common
    matrix = "view_matrix = [[1, 0, 0, -1], [0, 1, 0, -2], [0, 0, 1, -3], [0, 0, 0, 1]]\n" + common
    one, other = (run(toml(BOX, camera=camera))["problems"][0] for camera in (flat, matrix))
    assert one["eta"] == other["eta"]
    assert one["matrix"] == other["matrix"]
    # Far from the world's origin too, and with the few digits that a program prints.
    turned = "view_matrix = [[0.8, 0, 0.60001, -1e6], [0, 1, 0, 0], [-0.6, 0, 0.8, 2e6], [0, 0, 0, 1]]\n" + common
    camera = SceneConfig.model_validate(tomllib.loads(toml(BOX, camera=turned))).camera[0].scene_camera("right", 1)
    np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(camera.position, [2e6, 0, -1e6], rtol=1e-4)


def test_overrides_reach_the_only_camera(folder, capsys):
    text = toml(BOX, light="path = [[0, -1, 0]]").replace("[camera]", "[[camera]]")
    assert run(text, "--camera.near", "2", "--output.reversed-z", "true")["cameras"][0]["near"] == 2
    Path("scene.toml").write_text(f"[[camera]]\n{CAMERA}\n" + text)
    assert invoke("scene.toml", "--camera.near", "2") == 2
    assert "got 2 tables [[camera]], expected one" in capsys.readouterr().err


def test_nothing_seen_is_an_outcome(folder):
    np.save("sky.npy", np.zeros((HEIGHT, WIDTH)))
    problem = run(toml("depth = { files = 'sky.npy' }"), "--output.figures", "true")["problems"][0]
    assert problem["outcome"] == "empty"
    assert problem["matrix"] is None
    assert "nothing needs a shadow map" in problem["no_matrix_because"]
    assert problem["value"] == 0
    assert not list(folder.glob("out/*.png"))


def test_a_night_without_sun_is_a_result(folder, capsys):
    told = run(toml(BOX, light="path = { latitude_deg = 80.0, declination_deg = -23.0, count = 5 }"))
    assert told["problems"] == []
    assert "below the horizon" in capsys.readouterr().out


def test_a_warp_that_cannot_help_is_told_with_its_margin(folder):
    problem = run(
        toml("whole_frustum = {}", light="direction = [0, -0.1, -1]", more="[objective]\nmetrics = ['q']"),
        "--output.convention", "direct3d",
    )["problems"][0]  # fmt: skip
    assert problem["outcome"] == "no_warp"
    assert problem["no_warp"] is True
    assert problem["lambda"] is None
    assert problem["margin"] <= 0
    np.testing.assert_allclose(np.array(problem["matrix"])[:3, 3], 0)  # row vectors: w = 1 for every point


def test_files_are_refused_without_waiting_for_jax(folder):
    Path("scene.toml").write_text(toml("depth = { files = 'none.npy' }"))
    code = (
        "import sys, warpopt.app.cli as cli\n"
        "try:\n    cli.main(['scene', 'scene.toml'])\n"
        "except SystemExit as e:\n    print(e.code, 'jax' in sys.modules)\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout == "2 False\n"


def test_schema_of_scene(capsys):
    cli.main(["schema", "--of", "scene"])
    schema = json.loads(capsys.readouterr().out)
    assert {"camera", "light", "receivers", "objective", "output"} <= set(schema["properties"])


def test_a_missing_reader_is_named_with_the_extra(folder, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    Path("scene.gltf").write_text(json.dumps(gltf()))
    Path("a.exr").write_bytes(bytes.fromhex("762f3101") + bytes(20))
    for receivers in ("gltf = { file = 'scene.gltf' }", "depth = { files = 'a.exr' }"):
        Path("scene.toml").write_text(toml(receivers))
        assert invoke("scene.toml") == 2
        assert "pip install 'warpopt[scene]'" in capsys.readouterr().err


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
    "max in l2": (toml(BOX, more="[objective]\nmetrics = ['max']\nnorms = ['l2']"), ["only 'inf' with metric 'max'"]),
    "screen alone": (toml(BOX, more="[objective]\nscreen = [100, 50]"), ["screen and shadow_map"]),
    "unknown key": (toml("box = { lower = [0, 0, 0], uper = [1, 1, 1] }"), ["receivers.box.uper: unknown key"]),
    "missing depth": (depth_of("none.npy"), ["receivers.depth.files.0", "none.npy", "cannot be read"]),
    "depth of wrong aspect": (depth_of("square.npy"), ["got 20 x 20 pixels, expected width / height = 1.77778"]),
    "depth of wrong size": (
        toml("depth = { files = 'good.npy', size = [64, 36] }"), ["got 96 x 54 pixels, expected 64 x 36"],
    ),
    "NaN depth": (depth_of("nan.npy"), ["got NaN in row 3, column 5 (1 of 5184", "expected finite depths"]),
    "infinite depth": (depth_of("inf.npy"), ["got infinity in row 3, column 5", "expected finite depths"]),
    "depth out of range": (
        toml("depth = { files = 'good.npy', encoding = 'reversed' }"), ["expected numbers in [0, 1]", "'reversed'"],
    ),
    "depth with channels": (depth_of("rgb.npy"), ["got an array of shape (54, 96, 3), expected (height, width)"]),
    "pickled depth": (depth_of("pickle.npy"), ["cannot be read as .npy"]),
    "no depth file": (depth_of("text.npy"), ["neither .npy nor OpenEXR"]),
    "broken OpenEXR": (depth_of("broken.exr"), ["cannot be read as OpenEXR"]),
    "two depth files for one camera": (
        toml("depth = { files = ['good.npy', 'good.npy'] }"), ["got 2 for 1 camera(s), expected one for each"],
    ),
    "missing glTF": (toml("gltf = { file = 'none.glb' }"), ["receivers.gltf.file", "none.glb", "cannot be read"]),
    "empty glTF": (toml("gltf = { file = 'empty.gltf' }"), ["empty.gltf", "got no triangle, expected"]),
    "no glTF": (toml("gltf = { file = 'text.npy' }"), ["not glTF", "expected .gltf or .glb"]),
    "broken glTF": (toml("gltf = { file = 'broken.gltf' }"), ["broken.gltf: cannot be read as glTF"]),
    "glTF of NaN": (toml("gltf = { file = 'nan.gltf' }"), ["nan.gltf: got vertices that are NaN or infinite"]),
    "glTF without camera": (toml("gltf = { file = 'empty.gltf' }", camera=""), ["got 0 camera(s)", "[camera] section"]),
    "glTF camera without far": (toml("gltf = { file = 'endless.gltf' }", camera=""), ["zfar", "receivers.gltf.far"]),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_told_and_nothing_is_written(folder, capsys, name):
    good = ground()
    np.save("good.npy", good)
    np.save("square.npy", np.ones((20, 20)))
    np.save("rgb.npy", np.ones((54, 96, 3)))
    np.save("pickle.npy", np.array([{}, 1], object), allow_pickle=True)
    for value, file in ((np.nan, "nan.npy"), (np.inf, "inf.npy")):
        bad = good.copy()
        bad[3, 5] = value
        np.save(file, bad)
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
