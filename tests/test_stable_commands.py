"""Paths of cameras, and stable windows along them, in `warpopt scene` and `warpopt frames`."""

import base64
import csv
import json
from pathlib import Path

import numpy as np
import pytest
from gltf_cases import Builder
from scene_cases import BOX, strict, toml
from scene_cases import invoke as scene_command
from scipy.spatial.transform import Rotation

import warpopt
from warpopt.app.cli import main as command
from warpopt.scene_files.poses import read_gltf_path, read_poses
from warpopt.scene_files.scene_camera import SceneCamera, centred_window, orientation
from warpopt.stable import Action

LENS = SceneCamera(
    np.zeros(3), orientation(np.array([0, 0, -1.0]), np.array([0, 1.0, 0]), "right"), 0.5, 40.0,
    centred_window(0.4, 1.5),
)  # fmt: skip
HEADS = "t,x,y,z,forward_x,forward_y,forward_z"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_poses_are_read_as_they_stand(folder):
    Path("walk.csv").write_text(f"{HEADS},up_x,up_y,up_z\n0,1,2,3,0,0,-2,0,1,0\n1,4,5,6,1,0,0,0,1,1\n")
    one, other = read_poses(Path("walk.csv"), LENS, "right")
    np.testing.assert_allclose([one.position, other.position], [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(one.rotation, [[1, 0, 0], [0, 1, 0], [0, 0, -1]])
    np.testing.assert_allclose(other.rotation, [[0, -np.sqrt(0.5), np.sqrt(0.5)], [0, np.sqrt(0.5), np.sqrt(0.5)],
                                                [1, 0, 0]], atol=1e-12)  # fmt: skip
    assert (one.near, one.far, one.window) == (LENS.near, LENS.far, LENS.window)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "got no row"), (f"{HEADS}\n", "got no row"), ("x,y,z\n1,2,3\n", "got no forward_x"),
        (f"{HEADS}\n0,1,2,3,0,0\n", "line 2: got '0', '0', None"), (f"{HEADS}\n0,1,nan,3,0,0,-1\n", "line 2"),
        (f"{HEADS}\n0,1,2,3,0,0,0\n", "forward of length 0"), (f"{HEADS}\n0,1,2,3,0,1,0\n", "parallel to forward"),
        (f"{HEADS}\n0,1,two,3,0,1,0\n", "'two'"),
    ],
)  # fmt: skip
def test_broken_poses_are_refused(folder, text, words):
    Path("walk.csv").write_text(text)
    with pytest.raises(ValueError, match=r"walk\.csv") as told:
        read_poses(Path("walk.csv"), LENS, "right")
    assert words in str(told.value)


def animated(interpolation: str, values: dict[str, np.ndarray], times=(0.0, 1.0), **more) -> Path:
    """A camera below a node that moves."""
    made = Builder()
    made.data["nodes"] = [{"name": "rig", "children": [1]}, {"camera": 0, "translation": [0, 1, 0]}]
    made.data["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.5, "zfar": 40.0}}]
    given = made.accessor(np.array(times, "f4"))
    samplers, channels = [], []
    for key, keys in values.items():
        samplers.append({"input": given, "output": made.accessor(np.array(keys, "f4")), "interpolation": interpolation})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": 0, "path": key}})
    made.data["animations"] = [{"name": "walk", "samplers": samplers, "channels": channels}]
    made.data.pop("meshes")
    for key, value in more.items():
        made.data[key] = value
    content = base64.b64encode(made.blob).decode()
    made.data["buffers"] = [{
        "byteLength": len(made.blob), "uri": "data:application/octet-stream;base64," + content,
    }]  # fmt: skip
    Path("moving.gltf").write_text(json.dumps(made.data))
    return Path("moving.gltf")


TURN = np.stack([[0, 0, 0, 1], Rotation.from_euler("y", 90, degrees=True).as_quat()])


def test_a_gltf_camera_follows_its_animation(folder):
    """The world transform of its node at each time: translation and rotation of the node above it, and its own place.
    Linear rotations go at a constant rate, splines by Hermite's formula."""
    path = animated("LINEAR", {"translation": [[0, 0, 0], [4, 0, 0]], "rotation": TURN})
    found = read_gltf_path(path, 0, "walk", 4.0)
    assert len(found) == 5
    for k, camera in enumerate(found):
        np.testing.assert_allclose(camera.position, [k, 1, 0], atol=1e-6)
        angle = np.pi / 2 * k / 4
        np.testing.assert_allclose(camera.rotation[2], [-np.sin(angle), 0, -np.cos(angle)], atol=1e-6)
    path = animated("STEP", {"translation": [[0, 0, 0], [4, 0, 0]]})
    assert [camera.position[0] for camera in read_gltf_path(path, 0, 0, 2.0)] == [0, 0, 4]
    # Tangents of a parabola, t^2 over two seconds: a spline has it exactly.
    spline = [[0, 0, 0], [0, 0, 0], [0, 0, 0], [4, 0, 0], [4, 0, 0], [0, 0, 0]]
    path = animated("CUBICSPLINE", {"translation": spline}, (0.0, 2.0))
    places = [camera.position[0] for camera in read_gltf_path(path, 0, 0, 4.0)]
    np.testing.assert_allclose(places, (np.arange(9) / 4) ** 2, atol=1e-6)


@pytest.mark.parametrize(
    ("interpolation", "values", "times", "which", "words"),
    [
        ("LINEAR", {"translation": [[0, 0, 0], [4, 0, 0]]}, (0, 1), "run", "got 0 animations 'run' of 1 ('walk')"),
        ("LINEAR", {"translation": [[0, 0, 0], [4, 0, 0]]}, (0, 1), 3, "got 0 animations 3"),
        ("LINEAR", {"translation": [[0, 0, 0]]}, (0, 1), 0, "got 1 values for 2 times, expected 2"),
        ("LINEAR", {"translation": [[0, 0, 0], [4, 0, 0]]}, (1, 0), 0, "times that do not increase"),
        ("CUBIC", {"translation": [[0, 0, 0], [4, 0, 0]]}, (0, 1), 0, "interpolation"),
        ("LINEAR", {"rotation": [[0, 0, 0, 1], [0, 0, 0, 0]]}, (0, 1), 0, "rotation of length 0"),
        ("LINEAR", {}, (0, 1), 0, "no channel that moves a node"),
    ],
)  # fmt: skip
def test_broken_animations_are_refused(folder, interpolation, values, times, which, words):
    path = animated(interpolation, values, times)
    with pytest.raises(ValueError, match=r"moving\.gltf: cannot be read as glTF") as told:
        read_gltf_path(path, 0, which, 30.0)
    assert words in str(told.value)


CORNERS = (-20, 0, -80), (20, 8, -5)  # of the box of the shared cases
PIXELS = "[objective]\nmetrics = ['storage']\nscreen = [640, 480]\nshadow_map = [512, 512]\n"


def invoke(text: str, *arguments: str) -> int:
    Path("scene.toml").write_text(text)
    return scene_command("scene.toml", *arguments)


@pytest.mark.thorough
def test_a_window_follows_the_light_s_path(folder):
    """The rows are the library's updates, the matrices in the file's convention."""
    path = "path = [[0.2, -1, -0.3], [0.2, -1, -0.3], [0.205, -1, -0.3], [3, -0.1, -0.3]]"
    text = toml(BOX, light=path, more=PIXELS + "[stable]\n")
    assert invoke(text, "--output.figures", "false") == 0
    rows = strict(folder / "out/scene.json")["window"]
    with (folder / "out/window.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["action"] for row in table] == [row["action"] for row in rows]
    assert [row["action"] for row in rows[:3]] == ["FIRST", "KEPT", "SCROLLED"]
    assert rows[3]["action"] == "REFITTED"
    window = warpopt.StableWindow(objective=warpopt.Objective("storage"), warp_direction="view", screen=(640, 480),
                                  shadow_map=(512, 512))  # fmt: skip
    state = window.start()
    scene = strict(folder / "out/scene.json")
    seen = scene["cameras"][0]
    camera = warpopt.Camera.off_centre(
        seen["position"], seen["forward"], seen["up"], seen["near"], seen["far"], tuple(seen["window"])
    )
    corners = np.stack(np.meshgrid(*zip(*CORNERS, strict=True)), -1).reshape(-1, 3)
    for row in rows:
        update, state = window.update(
            state, camera, warpopt.DirectionalLight(scene["lights"][row["light"]]),
            warpopt.receivers.ConvexBody.box(*CORNERS), casters=corners,
        )  # fmt: skip
        assert Action(int(update.action)).name == row["action"]
        np.testing.assert_allclose(row["matrix"], update.matrix, rtol=1e-6, atol=1e-9)
    assert "## The stable window" in (folder / "out/report.md").read_text()


def test_a_window_follows_the_camera_s_path(folder):
    Path("walk.csv").write_text(HEADS + "\n" + "".join(f"{k},{0.01 * k},2,0,0,0,-1\n" for k in range(4)))
    text = toml(BOX, more=PIXELS + "[camera_path]\nfile = 'walk.csv'\n[stable]\n")
    assert invoke(text, "--output.figures", "false") == 0
    told = strict(folder / "out/scene.json")
    assert [row["camera"] for row in told["window"]] == [0, 1, 2, 3]
    assert [row["action"] for row in told["window"]][:2] == ["FIRST", "KEPT"]
    two = "path = [[0.2, -1, -0.3], [0.2, -1, -0.4]]"
    text = toml(BOX, light=two, more=PIXELS + "[camera_path]\nfile = 'walk.csv'\n[stable]\n")
    assert invoke(text) == 2


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("[stable]\n", "expected objective.screen and objective.shadow_map"),
        (PIXELS + "[stable]\nmargin = 0\n", "stable.margin"),
        (PIXELS + "[camera_path]\nfile = 'none.csv'\n", "camera_path.file: none.csv: cannot be read"),
        ("[camera_path]\nanimation = 0\n", "camera_path.animation: expected receivers.gltf"),
        ("[camera_path]\n", "expected exactly one of file, animation"),
        ("[camera_path]\nfile = 'a.csv'\nrate = 30.0\n", "got rate with file"),
    ],
)
def test_bad_settings_are_refused_in_a_sentence(folder, capsys, more, words):
    assert invoke(toml(BOX, more=more)) == 2
    told = capsys.readouterr().err
    assert words in told
    assert "Traceback" not in told


@pytest.mark.thorough
def test_frames_go_along_the_cameras_of_a_table(folder):
    """A sphere and a window, with a figure and what refits flip. A window that warps: the experiment's slice."""
    rows = "".join(f"{k},{0.02 * k},1.7,{-20 - 0.05 * k},0.1,-0.1,1\n" for k in range(3))
    Path("walk.csv").write_text(HEADS + "\n" + rows)
    frames = (
        "[frames]\nwarps = ['none']\nscreen = [48, 32]\nshadow_map = [64, 64]\n"
        "path = { kind = 'cameras', methods = ['sphere', 'window-none'] }\n"
    )
    more = "[camera_path]\nfile = 'walk.csv'\n" + frames
    text = toml("made = { scene = 'corridor', seed = 31 }", "direction = [0.5, -0.8, -0.35]", more=more)
    text = text.replace("figures = false", "figures = true")
    Path("frames.toml").write_text(text)
    with pytest.raises(SystemExit) as stop:
        command(["frames", "frames.toml"])
    assert stop.value.code in (0, 1)
    with (folder / "out/flicker.csv").open() as file:
        told = {row["method"]: row for row in csv.DictReader(file)}
    assert list(told) == ["sphere", "window-none"]
    assert [told[name]["refits"] for name in ("sphere", "window-none")] == ["", "0"]
    assert all(row["frames"] == "3" for row in told.values())
    assert float(told["window-none"]["flicker"]) == 0
    assert "(flicker.png)" in (folder / "out/report.md").read_text()
    assert (folder / "out/flicker.png").stat().st_size > 1000
    Path("frames.toml").write_text(text.replace("kind = 'cameras'", "kind = 'walk'"))
    with pytest.raises(SystemExit) as stop:
        command(["frames", "frames.toml"])
    assert stop.value.code == 2
