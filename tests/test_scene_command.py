"""`warpopt scene` end to end, each case in a folder of its own."""

import csv
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scene_cases import BOX, CAMERA, HEIGHT, WIDTH, ground, invoke, run, strict, toml

import warpopt
from warpopt.app import cli
from warpopt.app.common.error_maps import errors, image_of
from warpopt.app.common.settings import read_config
from warpopt.app.inputs.scene_files import read_scene
from warpopt.app.scene.figures import seen_of
from warpopt.app.scene.report import scene_report
from warpopt.app.scene.settings import SceneConfig
from warpopt.app.scene.solve import solve_scene
from warpopt.receivers import DepthBuffer
from warpopt.theory.camera import camera_of

EXAMPLE = Path(__file__).parents[1] / "configs/landscape.toml"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


SMALL = ("--receivers.landscape.width", "96", "--receivers.landscape.cells", "48", "--objective.metrics", "p")


def test_the_worked_example_writes_what_the_library_computes(folder, capsys):
    arguments = [*SMALL, "--light.path.count", "2", "--output.directory", "out"]
    assert invoke(str(EXAMPLE), *arguments) == 0
    record = strict(folder / "out/run.json")
    assert record["files"] == sorted(path.name for path in (folder / "out").iterdir())
    maps = [name for name in record["files"] if name.startswith("error_map")]
    assert len(maps) == 2
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
    assert [p["light"] for p in told["problems"]] == [0, 1]
    with (folder / "out/table.csv").open() as file:
        rows = list(csv.DictReader(file))
    problem = told["problems"][1]
    light = warpopt.DirectionalLight(problem["direction"])
    view = warpopt.SceneView(
        right_handed, light, DepthBuffer(scene.depths[0]), screen=(1920, 1080), shadow_map=(2048, 2048)
    )
    solution = warpopt.optimal_warp(view)
    assert problem["eta"] == pytest.approx(float(solution.warp.eta), rel=1e-9)
    assert float(rows[1]["eta"]) == problem["eta"]
    assert problem["limit"] == pytest.approx(warpopt.lower_bound(view), rel=1e-9)
    assert float(rows[1]["over_limit"]) == problem["over_limit"] == problem["value"] / problem["limit"]
    report = (folder / "out/report.md").read_text()
    assert re.search(r"The optimum's error is [\d.]+ to [\d.]+ times the limit", report)
    assert "*Error at each pixel, light 0, E_p, norm inf" in report  # of the only camera
    assert problem["depth"]["receivers_share"] > 0.6
    assert 0 < problem["depth"]["steps"]["d24"]["smallest"] < problem["depth"]["steps"]["d16"]["smallest"] < 1
    matrix = warpopt.shadow_matrix(view, solution, casters=scene.triangles)
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
    (solved,) = solve_scene(config, scene, None, lambda done: None)
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
@pytest.mark.thorough("depth = { files = 'ground.npy' }-max")
def test_the_maps_worst_pixel_is_the_norm(folder, receivers, metric):
    """The norm is the maximum over receivers, or over groups of them; pixels are a sample of what it is over."""
    np.save("ground.npy", ground())
    solved, best, plain = solved_of(toml(receivers, more=f"[objective]\nmetrics = ['{metric}']"))
    for error, key in ((best, "value"), (plain, "unwarped")):
        assert np.nanmax(error) <= solved.row[key] * (1 + 1e-9)
        assert np.nanmax(error) > 0.9 * solved.row[key]
    assert solved.row["value"] <= solved.row["unwarped"]
    if metric == "pxq":
        assert solved.row["limit"] is None
        assert solved.row["no_limit_because"].startswith("No lower bound is known for ")
    else:
        assert 1 / 1.08 < solved.row["over_limit"] < 20


def test_the_maps_are_the_matrix_s_own_derivatives(folder):
    """Another method: errors from differences of the map's coordinates (t, s), as the matrix of scene.json has them."""
    np.save("ground.npy", ground())
    Path("scene.toml").write_text(toml("depth = { files = 'ground.npy' }"))
    config = read_config(Path("scene.toml"), [], SceneConfig)
    scene = read_scene(config, folder)
    (solved,) = solve_scene(config, scene, None, lambda done: None)
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
    cases = {f"{name}.npy": toml(f"depth = {{ files = ['{name}.npy'], encoding = '{name}', size = [96, 54] }}")
             for name in ("linear", "standard", "reversed")}  # fmt: skip
    cases["reversed.exr"] = toml("depth = { files = 'reversed.exr', encoding = 'reversed' }")
    for text in cases.values():
        Path("scene.toml").write_text(text)
        scene = read_scene(read_config(Path("scene.toml"), [], SceneConfig), folder)
        depth = DepthBuffer(scene.depths[0], scene.encoding).eye_depth(camera_of(scene.cameras[0]))
        np.testing.assert_allclose(depth, np.where(z > 0, z, np.inf), rtol=1e-5)  # a file of single precision
    # Each encoding is another program: the command itself for two of them.
    etas = [run(cases[name])["problems"][0]["eta"] for name in ("linear.npy", "reversed.exr")]
    np.testing.assert_allclose(etas, etas[0], rtol=1e-5)


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
    assert run(text, "--camera.near", "2")["cameras"][0]["near"] == 2
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
    told = run(
        toml("whole_frustum = {}", light="direction = [0, -0.1, -1]", more="[objective]\nmetrics = ['q']"),
        "--output.convention", "direct3d", "--output.reversed-z", "true",
    )  # fmt: skip
    problem = told["problems"][0]
    assert problem["outcome"] == "no_warp"
    assert problem["no_warp"] is True
    assert problem["lambda"] is None
    assert problem["margin"] <= 0
    matrix = np.array(problem["matrix"])
    np.testing.assert_allclose(matrix[:3, 3], 0)  # row vectors: w = 1 for every point
    assert told["convention"] == {"name": "direct3d", "reversed_z": True, "vectors": "row"}
    assert np.array([0, -0.1, -1]) @ matrix[:3, 2] < 0  # reversed: the depth falls along the light


def test_schema_of_scene(capsys):
    with pytest.raises(SystemExit):
        cli.main(["schema", "--of", "scene"])
    schema = json.loads(capsys.readouterr().out)
    assert {"camera", "light", "receivers", "objective", "output"} <= set(schema["properties"])


@pytest.mark.parametrize("by", ["uniform", "depth", "edges"])
def test_the_report_says_which_pixels_count(folder, by):
    """With a mask lit pixels only; but edges count on both sides, and all pixels where the mask has none."""
    np.save("ground.npy", ground())
    np.save("lit.npy", np.ones((HEIGHT, WIDTH), bool))
    Path("scene.toml").write_text(
        toml("depth = { files = 'ground.npy' }", more=f"[weights]\nby = '{by}'\nlit = 'lit.npy'\n")
    )
    config = read_config(Path("scene.toml"), [], SceneConfig)
    report = scene_report(config, read_scene(config, folder), [], [], [])
    (told,) = (part for part in report.split("\n") if "In means, " in part)
    assert ("lit pixels only" in told) == (by != "edges")
