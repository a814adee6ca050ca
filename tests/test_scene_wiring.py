"""Every key of a scene that says how files and cameras are meant, against the same scene said otherwise."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from depth_cases import exr
from scene_cases import BOX, CAMERA, HEIGHT, WIDTH, gltf, ground, invoke, run, toml

from warpopt.app.common.settings import ConfigError, read_config
from warpopt.app.inputs.scene_files import SceneInput, read_scene
from warpopt.app.scene.settings import SceneConfig

ASPECT = WIDTH / HEIGHT
ENDLESS = CAMERA.replace("far = 100.0\n", "")
POSE = "position = [0, 2, 0]\nforward = [0, -0.1, -1]\nnear = 1.0\nfar = 100.0\n"
TOP = np.tan(np.deg2rad(25))
ACROSS = np.rad2deg(np.arctan(TOP * ASPECT))
CENTRED = POSE + f"half_fov_deg = 25.0\naspect = {ASPECT}"
FOCAL = HEIGHT / 2 / TOP


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def scene_of(text: str) -> SceneInput:
    Path("scene.toml").write_text(text)
    return read_scene(read_config(Path("scene.toml"), [], SceneConfig), Path())


def seen(scene: SceneInput, i: int = 0) -> np.ndarray:
    """Eye depth; inf for background, whatever its mark."""
    depth, near = scene.depths[i], scene.cameras[i].near
    shallow = near / scene.cameras[i].far
    if scene.encoding == "linear":
        return np.where((depth > 0) & np.isfinite(depth), depth, np.inf)
    depth = 1 - depth if scene.encoding == "standard" else depth
    return np.where(depth > 0, near / np.where(depth > 0, depth + shallow * (1 - depth), 1), np.inf)


CAMERAS = {
    "far = inf": (ENDLESS + "\nfar = inf", ENDLESS),
    "half_fov_x_deg": (POSE + f"half_fov_x_deg = {ACROSS}\naspect = {ASPECT}", CENTRED),
    "pinhole in the middle": (
        POSE + f"fx = {FOCAL}\nfy = {FOCAL}\ncx = {WIDTH / 2}\ncy = {HEIGHT / 2}\nimage_size = [{WIDTH}, {HEIGHT}]",
        CENTRED,
    ),
    "pinhole off the middle": (  # the window's edges by hand, in pixels from the principal point
        POSE + "fx = 50.0\nfy = 40.0\ncx = 30.0\ncy = 20.0\nimage_size = [96, 54]",
        POSE + f"window = [{-30 / 50}, {66 / 50}, {-34 / 40}, {20 / 40}]",
    ),
    "first_centre": (
        POSE + "fx = 50.0\nfy = 40.0\ncx = 29.5\ncy = 19.5\nimage_size = [96, 54]\nfirst_centre = 0",
        POSE + "fx = 50.0\nfy = 40.0\ncx = 30.0\ncy = 20.0\nimage_size = [96, 54]",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_said_in_two_ways_are_one(name):
    one, other = (scene_of(toml(BOX, camera=camera)).cameras[0] for camera in CAMERAS[name])
    np.testing.assert_allclose(one.window, other.window, rtol=1e-12)
    np.testing.assert_array_equal(one.rotation, other.rotation)
    assert (one.near, one.far) == (other.near, other.far)


def test_a_pinhole_camera_takes_the_size_of_its_image():
    """Of the depth file; pixels need not be square then."""
    np.save("a.npy", ground())
    pinhole = POSE + "fx = 50.0\nfy = 40.0\ncx = 30.0\ncy = 20.0"
    given = scene_of(toml(BOX, camera=pinhole + "\nimage_size = [96, 54]")).cameras[0]
    found = scene_of(toml("depth = { files = 'a.npy' }", camera=pinhole)).cameras[0]
    assert found.window == given.window
    # Numbers of the whole image beside a file of half its size.
    whole = POSE + "fx = 100.0\nfy = 80.0\ncx = 60.0\ncy = 40.0\nimage_size = [192, 108]"
    halved = scene_of(toml("depth = { files = 'a.npy' }", camera=whole)).cameras[0]
    np.testing.assert_allclose(halved.window, given.window, rtol=1e-12)
    screen = "[objective]\nscreen = [96, 54]\nshadow_map = [64, 64]"
    assert scene_of(toml(BOX, camera=pinhole, more=screen)).cameras[0].window == given.window


def files() -> dict[str, tuple[str, str]]:
    """(what is said of depth, the camera), each of which shows the ground as `ground()` has it."""
    z = ground()
    shown = z > 0
    safe = np.where(shown, z, 1)
    camera = scene_of(toml(BOX)).cameras[0]
    across, up = camera.slopes(HEIGHT, WIDTH)
    rays = np.array([[np.linalg.norm([x, y, 1.0]) for x in across] for y in up])
    np.save("plain.npy", z)
    np.save("flipped.npy", z[::-1])
    np.save("ray.npy", z * rays)
    np.save("sky.npy", np.where(shown, z, 150.0))
    np.save("nan.npy", np.where(shown, z, np.nan))
    np.save("millimetres.npy", np.round(1000 * z).astype(np.uint32))
    np.save("standard.npy", np.where(shown, 1 - 1 / safe, 1))
    np.save("reversed.npy", np.where(shown, 1 / safe, 0))
    np.savez("two.npz", other=z * 0, z=z)
    exr("layers.exr", {"front.Z": z.astype("f4"), "back.Z": (2 * z).astype("f4")})
    parts()
    depth = "depth = {{ files = '{}' }}"
    return {
        "rows": ("depth = { files = 'flipped.npy', rows = 'bottom_up' }", CAMERA),
        "distance": ("depth = { files = 'ray.npy', distance = 'ray' }", CAMERA),
        "background": ("depth = { files = 'sky.npy', background = 150.0 }", ENDLESS),
        "far as background": (depth.format("sky.npy"), CAMERA),
        "nan": ("depth = { files = 'nan.npy', nan_is_background = true }", CAMERA),
        "scale": ("depth = { files = 'millimetres.npy', scale = 0.001 }", CAMERA),
        "standard without far": ("depth = { files = 'standard.npy', encoding = 'standard' }", ENDLESS),
        "reversed without far": ("depth = { files = 'reversed.npy', encoding = 'reversed' }", ENDLESS + "\nfar = inf"),
        "key": ("depth = { files = 'two.npz', key = 'z' }", CAMERA),
        "channel": ("depth = { files = 'layers.exr', channel = 'front' }", CAMERA),
        "part by name": ("depth = { files = 'parts.exr', part = 'mine' }", CAMERA),
        "part by number": ("depth = { files = 'parts.exr', part = 1 }", CAMERA),
    }


def parts() -> None:
    import OpenEXR

    z = ground().astype("f4")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    made = [OpenEXR.Part({**header}, {"Z": factor * z}, name) for name, factor in (("other", 3), ("mine", 1))]
    OpenEXR.File(made).write("parts.exr")


def test_depth_said_in_every_way_is_one_scene():
    expected = np.where(ground() > 0, ground(), np.inf)
    for name, (depth, camera) in files().items():
        scene = scene_of(toml(depth, camera=camera))
        # Single precision, or whole millimetres from 1 m.
        rtol = {"scale": 5e-4}.get(name, 1e-12 if "exr" not in depth else 1e-6)
        np.testing.assert_allclose(seen(scene), expected, rtol=rtol, err_msg=name)
        assert scene.notes == [], name


BACK = {"name": "back", "translation": [1, 2, 3], "camera": 1}


def lit(directions: int) -> dict:
    """A file with two cameras, and directional lights that shine along -y and -x."""
    held = gltf(extra_nodes=[BACK])
    held["cameras"].append({"type": "perspective", "name": "second", "perspective": {"yfov": 0.5, "znear": 0.2}})
    half = float(np.sqrt(0.5))
    turns = [[-half, 0, 0, half], [0, half, 0, half]][:directions]
    held["extensions"] = {
        "KHR_lights_punctual": {"lights": [{"type": "directional", "name": f"L{i}"} for i in range(2)]}
    }
    held["extensionsUsed"] = ["KHR_lights_punctual"]
    for i, turn in enumerate(turns):
        node = {"name": f"sun{i}", "rotation": turn, "extensions": {"KHR_lights_punctual": {"light": i}}}
        held["nodes"].append(node)
    held["scenes"][0]["nodes"] = [0, 2, *range(4, len(held["nodes"]))]
    return held


def write(name: str, held: dict) -> None:
    Path(name).write_text(json.dumps(held))


def test_cameras_of_a_file_by_number_and_name():
    write("a.gltf", lit(1))
    of = "gltf = {{ file = 'a.gltf', width = 16{} }}"
    first, by_number, by_node, by_name = (
        scene_of(toml(of.format(key), camera="")).cameras[0]
        for key in ("", ", camera = 1", ", camera = 'back'", ", camera = 'second'")
    )
    assert (first.near, first.far) == (0.5, 200)
    np.testing.assert_allclose(by_number.position, [1, 2, 3])
    assert (by_number.near, by_number.far) == (0.2, np.inf)
    assert by_number.key == by_node.key == by_name.key
    ended = scene_of(toml(of.format(", camera = 1, far = 77.0"), camera="")).cameras[0]
    assert (ended.far, ended.window) == (77, by_number.window)


LIGHTS = {
    ("true", 1): [0, -1, 0],
    ("0", 2): [0, -1, 0],
    ("1", 2): [-1, 0, 0],
    ("'sun1'", 2): [-1, 0, 0],
    ("'L0'", 2): [0, -1, 0],
}


@pytest.mark.parametrize(("which", "count"), LIGHTS)
def test_the_light_of_a_file(which, count):
    write("a.gltf", lit(count))
    found = scene_of(toml("gltf = { file = 'a.gltf', width = 16 }", f"from_file = {which}"))
    expected = scene_of(toml("gltf = { file = 'a.gltf', width = 16 }", f"direction = {LIGHTS[which, count]}"))
    np.testing.assert_allclose(found.lights, expected.lights, atol=1e-7)


def test_what_of_a_file_counts_is_chosen():
    """By nodes and materials; the same without the node."""
    raised = {"name": "Cloud layer", "mesh": 0, "translation": [0, 3, -20], "scale": [30, 1, 18]}
    both = gltf(extra_nodes=[raised])
    both["scenes"][0]["nodes"] = [0, 2, 4]
    write("both.gltf", both)
    write("plain.gltf", gltf())
    plain = scene_of(toml("gltf = { file = 'plain.gltf', width = 32 }"))
    assert plain.notes == []
    whole = scene_of(toml("gltf = { file = 'both.gltf', width = 32 }"))
    assert len(whole.triangles) == 2 * len(plain.triangles)
    for choice, note in (
        ("exclude = 'cloud*'", "both.gltf: excluded: 'Cloud layer'"),
        ("include = ['Moved', 'nothing']", "both.gltf: no node or material is named like 'nothing'"),
    ):
        scene = scene_of(toml(f"gltf = {{ file = 'both.gltf', width = 32, {choice} }}"))
        np.testing.assert_array_equal(scene.depths[0], plain.depths[0])
        np.testing.assert_array_equal(scene.triangles, plain.triangles)
        assert note in scene.notes


REFUSED = {
    "a flag for a camera": ("gltf = { file = 'a.gltf', camera = true }", "", "receivers.gltf.camera"),
    "a flag for a part": ("depth = { files = 'a.npy', part = true }", CAMERA, "receivers.depth.part"),
    "no light": (("gltf = { file = 'a.gltf' }", "from_file = false"), CAMERA, "got False, expected true, the num"),
    "light 1 of one": (("gltf = { file = 'a.gltf' }", "from_file = 1"), CAMERA, "got 1 directional light(s), exp"),
    "two lights": (("gltf = { file = 'two.gltf' }", "from_file = true"), CAMERA, "lights ('sun0', 'sun1')"),
    "a size of no pinhole": (BOX, CAMERA + "\nimage_size = [9, 9]", "got image_size without fx"),
    "a centre of no pinhole": (BOX, CAMERA + "\nfirst_centre = 0", "got first_centre without fx"),
    "the file's camera beside another": ("gltf = { file = 'a.gltf', camera = 1 }", CAMERA, "gltf.camera: got one w"),
    "the file's far beside another": ("gltf = { file = 'a.gltf', far = 9.0 }", CAMERA, "gltf.far: got one with"),
    "text for a number": (BOX, POSE + "fx = 9.0\nfy = 9.0\ncx = '4'\ncy = 4.0", "camera.0.cx"),
    "far before near": (BOX, CAMERA.replace("100.0", "0.5"), "camera.0.far: got 0.5, expected more than near = 1.0"),
    "far NaN": (BOX, CAMERA.replace("100.0", "nan"), "camera.0.far: got nan"),
    "far -inf": (BOX, CAMERA.replace("100.0", "-inf"), "camera.0.far: got -inf"),
    "ray of encoded depth": (
        "depth = { files = 'a.npy', distance = 'ray', encoding = 'reversed' }", CAMERA, "distance: got 'ray', expected",
    ),
    "background below 0": ("depth = { files = 'a.npy', background = -1.0 }", CAMERA, "background: got -1, expected"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_would_be_ignored_or_misread_is_refused(name):
    receivers, camera, words = REFUSED[name]
    receivers, light = receivers if isinstance(receivers, tuple) else (receivers, "direction = [0, -1, 0]")
    write("a.gltf", lit(1))
    write("two.gltf", lit(2))
    np.save("a.npy", ground() / 100)
    with pytest.raises(ConfigError) as error:
        scene_of(toml(receivers, light, camera))
    told = str(error.value)
    assert words in told, told
    assert len(told.splitlines()) <= 3, told


def masked() -> dict:
    """The ground with a material with holes, and a primitive of points."""
    held = gltf()
    held["materials"] = [{"name": "leaves", "alphaMode": "MASK"}]
    held["meshes"][0]["primitives"][0]["material"] = 0
    held["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 0})
    return held


def test_notes_are_told_and_kept(capsys):
    """On the terminal, in scene.json and in the report; a camera without far has a finite matrix and null for far."""
    write("a.gltf", masked())
    told = run(toml("gltf = { file = 'a.gltf', width = 96 }", camera=ENDLESS))
    expected = ["a.gltf: 1 primitive of points left out", "a.gltf: alpha-masked, counted as opaque: 'leaves'"]
    assert told["notes"] == expected
    terminal, report = capsys.readouterr().out, Path("out/report.md").read_text()
    for note in expected:
        assert note in terminal
        assert note in report
    assert told["cameras"][0]["far"] is None
    assert np.isfinite(told["problems"][0]["matrix"]).all()
    ended = run(toml("gltf = { file = 'a.gltf', width = 96 }", camera=CAMERA.replace("100.0", "1e7")))
    assert ended["cameras"][0]["far"] == 1e7
    np.testing.assert_allclose(told["problems"][0]["matrix"], ended["problems"][0]["matrix"], rtol=1e-9, atol=1e-12)


def test_an_image_of_background_says_why(capsys):
    """34,816 values in another unit than far's."""
    depth = np.full((136, 256), 4000.0)
    depth[3, 5] = 3290.0
    np.save("far.npy", depth)
    camera = POSE.replace("100.0", "500.0") + f"half_fov_deg = 25.0\naspect = {256 / 136}"
    told = run(toml("depth = { files = 'far.npy' }", camera=camera))
    sentence = "all 34,816 values are at or beyond far = 500; the smallest is 3,290: units?"
    assert told["notes"] == [f"far.npy: {sentence}"]
    assert sentence in capsys.readouterr().out
    assert sentence in Path("out/report.md").read_text()
    assert told["problems"][0]["outcome"] == "empty"
    assert told["problems"][0]["matrix"] is None
    seen_now = scene_of(toml("depth = { files = 'far.npy', scale = 0.001 }", camera=camera))
    assert seen_now.notes == []
    assert np.isfinite(seen_now.depths[0]).all()


def test_depths_before_the_near_plane_are_reported():
    """Kilometres, or a reversed buffer that is read as linear: a number, and a note beside it."""
    np.save("km.npy", np.full((9, 16), 0.05))
    camera = POSE + f"half_fov_deg = 25.0\naspect = {16 / 9}"
    assert scene_of(toml("depth = { files = 'km.npy' }", camera=camera)).notes == [
        "km.npy: 144 of 144 values are nearer than near = 1: units or encoding?"
    ]


def test_a_box_before_a_camera_without_far(capsys):
    told, ended = (run(toml(BOX, camera=camera)) for camera in (ENDLESS, CAMERA))
    assert told["cameras"][0]["far"] is None
    assert told["problems"][0]["eta"] == pytest.approx(ended["problems"][0]["eta"], rel=1e-9)
    Path("scene.toml").write_text(toml("whole_frustum = {}", camera=ENDLESS))
    capsys.readouterr()
    assert invoke("scene.toml") == 2
    assert "camera.far: missing or inf, expected a far plane with receivers.whole_frustum" in capsys.readouterr().err


def test_a_file_of_data_is_read_by_name():
    """A buffer beside the file, with a name that a URI must escape."""
    held = gltf()
    content = base64.b64decode(held["buffers"][0]["uri"].split(",")[1])
    Path("a b.bin").write_bytes(content)
    held["buffers"][0]["uri"] = "a%20b.bin"
    write("a.gltf", held)
    write("plain.gltf", gltf())
    one, other = (scene_of(toml(f"gltf = {{ file = '{name}.gltf', width = 16 }}")) for name in ("a", "plain"))
    np.testing.assert_array_equal(one.triangles, other.triangles)
