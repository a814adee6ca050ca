"""`[casters]` of a scene, and the depth's numbers in `scene.json`: against finite differences of the matrix."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest
from gltf_cases import Builder
from scene_cases import BOX, invoke, run, strict, toml

import warpopt
from warpopt.app import cli
from warpopt.app.common.settings import ConfigError, read_config
from warpopt.app.inputs.scene_files import read_scene
from warpopt.app.inputs.scene_values import box_of, under_light, views_of
from warpopt.app.scene.casters import caster_shape
from warpopt.app.scene.depth_numbers import depth_numbers
from warpopt.app.scene.settings import SceneConfig
from warpopt.render.map_depth import DepthCells, MapDepth, depth_cells
from warpopt.render.shadow_matrix import matrix_and_depth

TEXELS = "[objective]\nmetrics = 'p'\nscreen = [1600, 900]\nshadow_map = [1024, 2048]\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def shape_of(receivers: str, more: str):
    Path("scene.toml").write_text(toml(receivers, more=TEXELS + more))
    config = read_config(Path("scene.toml"), [], SceneConfig)
    scene = read_scene(config, Path())
    return config, scene, caster_shape(config.casters, config, scene, Path())


def test_steps_and_bias_are_those_of_the_matrix(folder):
    """By differences at the corners of the receivers, a box that casts too: they have the extremes."""
    config, scene, casters = shape_of(BOX, "")
    (view,) = views_of(config, scene)
    view = under_light(view, 0)
    solution = warpopt.optimal_warp(view)
    matrix, depth = matrix_and_depth(view, solution, casters=box_of(casters))
    cells = depth_cells(depth, solution.footprint, solution.warp.eta, solution.frame.texels)
    own = depth_numbers(depth, jax.device_get(cells), False, True)
    assert own["receivers_share"] > 0.6
    vertices, there = view.receivers.vertices(view.camera)
    points = np.asarray(vertices)[np.asarray(there)] @ scene.cameras[0].rotation + scene.cameras[0].position
    light, matrix = np.asarray(view.light.direction), np.asarray(matrix)

    def depth(points):
        clip = np.c_[points, np.ones(len(points))] @ matrix.T
        return (clip[:, 2] / clip[:, 3] + 1) / 2  # OpenGL's

    rate = (depth(points + 1e-3 * light) - depth(points - 1e-3 * light)) / 2e-3
    for name, count in (("d16", 2**16 - 1), ("d24", 2**24 - 1)):
        steps = own["steps"][name]
        assert steps["smallest"] == pytest.approx(1 / (count * rate.max()), rel=1e-6)
        assert steps["largest"] == pytest.approx(1 / (count * rate.min()), rel=1e-6)
    floats = own["steps"]["d32f"]
    ulps = np.spacing(np.float32(depth(points)) * np.float32(1 - 1e-6)).astype(float)
    assert floats["smallest"] <= (ulps / rate).min() * (1 + 1e-6)
    assert floats["largest"] == pytest.approx((ulps / rate).max(), rel=1e-6)
    # A texel's edges on the light plane: t by the map's width, s by differences.
    along = np.cross(light, np.cross(np.asarray(solution.direction), light))
    clip = np.c_[points, np.ones(len(points))] @ matrix.T
    up = np.c_[points + 1e-3 * along, np.ones(len(points))] @ matrix.T
    side = np.c_[points + 1e-3 * np.cross(light, along), np.ones(len(points))] @ matrix.T
    ds = np.abs(up[:, 1] / up[:, 3] - clip[:, 1] / clip[:, 3]) / 2e-3
    dt = np.abs(side[:, 0] / side[:, 3] - clip[:, 0] / clip[:, 3]) / 2e-3
    texel = np.hypot(1 / (ds * 2048), 1 / (dt * 1024))
    bias = own["bias_at_45_deg"]
    assert bias["smallest"] == pytest.approx(texel.min() / 2, rel=1e-3)
    assert bias["largest"] == pytest.approx(texel.max() / 2, rel=1e-3)
    assert own["slope_scale"] == 1


def test_reversed_buffers_are_fine_far_from_the_light():
    """One group: u from 1/2 to 1, A = 1, span 8."""
    one, half = np.ones(1), np.full(1, 0.5)
    cells = DepthCells(np.ones(1, bool), (one, one), (half, one), (one, one), (one, one))
    depth = MapDepth(*(np.float64(v) for v in (0, -8, 0, -8, 1)), np.bool_(False))
    plain, turned = (depth_numbers(depth, cells, flag, False)["steps"]["d32f"] for flag in (False, True))
    assert plain == {"smallest": 8 * 2.0**-25, "largest": 8 * 2.0**-24}
    assert turned == {"smallest": 8 * 2.0**-149, "largest": 8 * 2.0**-25}


def test_casters_of_their_own_are_read(folder):
    """Points, a box without ends, nodes of the receivers' file and of another; else the scene's own."""
    gltf = "gltf = { file = 'scene.gltf', exclude = 'Tower*' }"
    builder = Builder()
    for name, x in (("Ground", 0.0), ("Tower", 5.0), ("Fence", 9.0)):
        positions = builder.accessor(np.float32([[x, 0, -5], [x + 1, 0, -5], [x, 1, -5]]))
        builder.node(name=name, mesh=builder.mesh(positions))
    builder.data["scenes"][0]["nodes"] = [0, 1, 2]
    (folder / "scene.gltf").write_text(json.dumps(builder.done()))
    assert shape_of(gltf, "")[2].shape == (2, 3, 3)
    assert shape_of(gltf, "[casters.gltf]\n")[2].shape == (3, 3, 3)
    assert shape_of(gltf, "[casters.gltf]\ninclude = 'tower'\n")[2][0, 0, 0] == 5
    assert shape_of(BOX, "[casters.gltf]\nfile = 'scene.gltf'\nexclude = 'ground'\n")[2].shape == (2, 3, 3)
    assert shape_of(BOX, "[casters]\npoints = [[0, 1, 2]]\n")[2].tolist() == [[0, 1, 2]]
    box = shape_of(BOX, "[casters]\nbox = { lower = [-inf, 0, -inf], upper = [inf, 5, inf] }\n")[2]
    assert (box.lower, box.upper) == ((-np.inf, 0, -np.inf), (np.inf, 5, np.inf))
    assert shape_of("whole_frustum = {}", "")[2] is None
    assert shape_of(BOX, "[casters]\ndepth_clamp = true\n")[2] is None
    for more, words in (
        ("[casters.gltf]\n", "casters.gltf.file: missing"),
        (
            "[casters]\nbox = { lower = [0, 0, 0], upper = [1, -1, 1] }\n",
            "casters.box.upper: .*at least the lower corner",
        ),
        ("[casters]\nbox = { lower = [0, nan, 0], upper = [1, 1, 1] }\n", "casters.box.lower: .*three numbers"),
        ("[casters]\npoints = [[0, 0, 0]]\ngltf = { file = 'scene.gltf' }\n", "casters: .*points, gltf"),
        ("[casters.gltf]\nfile = 'none.gltf'\n", "casters.gltf: none.gltf: cannot be read"),
    ):
        with pytest.raises(ConfigError, match=words):
            shape_of(BOX, more)


def test_boxes_without_ends_are_read_by_every_command(folder):
    """As receivers; and run.json has what was asked."""
    endless = "box = { lower = [-inf, 0, -inf], upper = [inf, 8, -5] }"
    record = run(toml(endless, more="[objective]\nmetrics = 'p'\n[casters]\n" + BOX))
    assert record["problems"][0]["eta"] > 0
    assert strict(Path("out/run.json"))["config"]["receivers"]["box"]["lower"] == ["-inf", 0, "-inf"]
    for command in ("compare", "cascades"):
        more = "" if command == "compare" else "[cascades]\ncount = 2\nbeside = ['uniform']\n"
        Path("other.toml").write_text(toml(endless, more=more).replace("'out'", f"'{command}'"))
        with pytest.raises(SystemExit) as ended:
            cli.main([command, "other.toml"])
        assert ended.value.code == 0
        assert strict(Path(command, "run.json"))["config"]["receivers"]["box"]["upper"][0] == "inf"


def test_a_warp_without_a_matrix_is_no_success(folder, capsys):
    """Casters as far as numbers go: said on the terminal and in the report, and the command fails."""
    far = "[casters]\nbox = { lower = [-1e308, -1e308, -1e308], upper = [1e308, 1e308, 1e308] }\n"
    Path("scene.toml").write_text(toml(BOX, more="[objective]\nmetrics = 'p'\n" + far))
    assert invoke("scene.toml") == 1
    words = "1 problem(s) have no matrix: casters: got ones so far before the receivers"
    assert words in " ".join(capsys.readouterr().out.split())
    assert words in Path("out/report.md").read_text()
    (problem,) = strict(Path("out/scene.json"))["problems"]
    assert problem["matrix"] is None
    assert problem["eta"] > 0
