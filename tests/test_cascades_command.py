"""`warpopt cascades` end to end: over a frustum and over a scene."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scene_cases import BOX, ground, toml

import warpopt
from warpopt.app.cascades.rows import Row
from warpopt.app.cascades.screen import cascade_of, errors_of
from warpopt.app.cascades.settings import read_cascades_config
from warpopt.app.cli import main
from warpopt.app.common.error_maps import image_of
from warpopt.app.inputs.scene_files import read_scene
from warpopt.app.inputs.scene_values import buffer_of, under_light, views_of
from warpopt.theory.camera import camera_of

FRUSTUM = """[view]
near = 0.05
far = 100.0
half_fov_deg = 30.0
[light]
theta_deg = 60.0
[output]
directory = "out"
figures = true
"""


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def invoke(text: str, *arguments: str) -> int:
    Path("cascades.toml").write_text(text)
    with pytest.raises(SystemExit) as stop:
        main(["cascades", "cascades.toml", *arguments])
    return stop.value.code


def test_a_frustum_end_to_end(capsys):
    """Godot's sentence, and every number as the library has it."""
    assert invoke(FRUSTUM) == 0
    report = Path("out/report.md").read_text()
    assert "Godot's fractions over the frustum: 72.1 times the best error without warps, 5.26 with" in report
    assert "; with nothing nearer than 4.02 the first cascade would be no longer than the others." in report
    assert "| maps | 1 |" in report
    rows = json.loads(Path("out/cascades.json").read_text())
    view = warpopt.FrustumView(warpopt.ViewFrustum(0.05, 100.0, np.deg2rad(30)), np.deg2rad(60))
    best = warpopt.cascades.plan(view, 4)
    np.testing.assert_allclose(rows[0]["splits"], best.splits)
    assert rows[0]["lower"] == pytest.approx(float(best.lower))
    unreal = next(row for row in rows if row["splits_by"] == "unreal" and not row["warped"])
    own = warpopt.cascades.errors(view, warpopt.cascades.splits.unreal(0.05, 100.0, 4), warp=False)
    assert unreal["over_best"] == pytest.approx(float(own.value / best.value))
    with Path("out/cascades.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 4 * len(rows)
    with Path("out/counts.csv").open() as file:
        counts = {(r["splits"], r["warped"], int(r["maps"])): float(r["over_best"]) for r in csv.DictReader(file)}
    for row in rows:  # the same numbers by another way: one solve for the longest cascade of each
        if row["splits_by"] != "best":
            told = counts[row["splits_by"], str(row["warped"]), 4]
            assert told == pytest.approx(row["over_best"], rel=1e-9)
    assert [k for name, warped, k in counts if (name, warped) == ("godot", "True")] == [1, 2, 4]
    assert counts["logarithmic", "True", 8] == pytest.approx(1)
    totals = warpopt.cascades.count(view)[1]
    bound = warpopt.lower_bound(warpopt.cascades.counts.in_world(view), warpopt.Objective("storage"))
    assert f"| warped | {float(totals[0] / bound):.3g} | {float(totals[1] / bound):.3g} |" in report
    for name in ("lost.png", "along.png", "counts.png", "texels.png"):
        assert f"({name})" in report
        assert Path("out", name).stat().st_size > 5000
    assert "72.1" in capsys.readouterr().out


def test_a_scene_has_matrices_and_both_ranges():
    more = "[objective]\nmetrics = 'pxq'\n[cascades]\ncount = 2\nbeside = ['logarithmic', 'godot']\n"
    assert invoke(toml(BOX, more=more)) == 0
    rows = json.loads(Path("out/cascades.json").read_text())
    assert {row["over"] for row in rows} == {"receivers", "planes"}
    assert np.isfinite(rows[0]["matrices"]).all()
    assert np.shape(rows[0]["matrices"]) == (2, 4, 4)
    assert all(row["over_best"] >= 1 - 1e-3 for row in rows)
    assert "camera's planes" in Path("out/report.md").read_text()


def test_a_scene_says_how_many_maps_are_worth_their_price():
    """As the library counts; without a price it is not computed."""
    more = "[objective]\nmetrics = 'p'\n[cascades]\ncount = 2\nbeside = []\n"
    assert invoke(toml(BOX, more=more)) == 0
    assert not Path("out/texels.csv").exists()
    assert "How many" not in Path("out/report.md").read_text()
    assert invoke(toml(BOX, more=more + "price = 0.25\n").replace("figures = false", "figures = true")) == 0
    config = read_cascades_config(Path("cascades.toml"), [])
    view = under_light(views_of(config, read_scene(config, Path()))[0], 0)
    bound = warpopt.lower_bound(view, warpopt.Objective("storage"))
    with Path("out/texels.csv").open() as file:
        lines = list(csv.DictReader(file))
    report = Path("out/report.md").read_text()
    best = {}
    for warped in (True, False):
        number, texels = warpopt.cascades.count(view, 0.25 * bound, warp=warped)
        best[warped] = number
        told = [float(r["texels_over_bound"]) for r in lines if r["warped"] == str(warped)]
        np.testing.assert_allclose(told, np.asarray(texels) / bound - 0.25 * np.arange(1, 17), rtol=1e-9)
    assert f"Of 1 to 16 maps {best[True]} need the fewest with warps, {best[False]} without." in report
    assert "each map costs 0.25 more" in report
    assert "(texels.png)" in report


PATH = "path = [[0.3, -1, -0.2], [0.6, -0.9, 0.3], [0.9, -0.4, 0.1]]"


def test_every_light_of_a_path_has_its_plan_from_one_program():
    """Each light's rows are those of the light alone; splits at whole steps; no compilation for a further light."""
    more = "[cascades]\ncount = 2\nstep = 1.1\nbeside = ['logarithmic']\n"
    assert invoke(toml(BOX, light="direction = [0.6, -0.9, 0.3]", more=more)) == 0
    alone = json.loads(Path("out/cascades.json").read_text())
    programs = warpopt.cascades.over_scene._solved._cache_size()
    assert invoke(toml(BOX, light=PATH, more=more)) == 0
    assert warpopt.cascades.over_scene._solved._cache_size() == programs
    rows = json.loads(Path("out/cascades.json").read_text())
    assert {row["light"] for row in rows} == {0, 1, 2}
    for one, other in zip(alone, (row for row in rows if row["light"] == 1), strict=True):
        assert {**one, "light": 1} == other
    values = {row["light"]: row["value"] for row in rows if row["splits_by"] == "best" and row["warped"]}
    assert len({round(v, 6) for v in values.values()}) == 3
    places = np.log([row["splits"] for row in rows if row["splits_by"] == "stepped"]) / np.log(1.1)
    np.testing.assert_allclose(places, places.round(), atol=1e-9)
    report = Path("out/report.md").read_text()
    assert f"the error is {min(values.values()):.4g} to {max(values.values()):.4g}" in report
    assert "over 3 lights" in report
    assert "At whole steps of 1.1 they have" in report
    assert "of 2 steps of the light" in report
    assert "No picture of the screen: the receivers are not pixels." in report
    with Path("out/cascades.csv").open() as file:
        assert {line["light"] for line in csv.DictReader(file)} == {"0", "1", "2"}


@pytest.mark.thorough
def test_the_screen_is_drawn_by_cascade():
    """Each pixel in its own map: the largest error of a cascade's pixels is the plan's for it."""
    np.save("depth.npy", ground()[::3, ::3])  # few enough to be taken one by one
    more = "[cascades]\ncount = 3\nbeside = []\n"
    text = toml("depth = { files = ['depth.npy'] }", light=PATH, more=more).replace("figures = false", "figures = true")
    assert invoke(text) == 0
    report = Path("out/report.md").read_text()
    for name in ("path", "screen_camera0_light0", "screen_camera0_light2"):
        assert f"({name}.png)" in report
        assert Path("out", f"{name}.png").stat().st_size > 5000
    assert "No picture" not in report
    config = read_cascades_config(Path("cascades.toml"), [])
    scene = read_scene(config, Path())
    view = under_light(views_of(config, scene)[0], 2)
    camera = scene.cameras[0]
    seen = image_of(camera, np.asarray(buffer_of(scene, 0).eye_depth(camera_of(camera))))
    for warped in (True, False):
        plan = warpopt.cascades.plan(view, 3, warp=warped)
        row = Row("best", "receivers", warped, plan, 0, 2, float(plan.value))
        error, number = errors_of(seen, row, "p"), cascade_of(seen, row)
        assert np.isfinite(error).sum() == np.isfinite(seen.depth).sum()
        largest = [np.nanmax(error[number == k]) for k in range(3)]
        np.testing.assert_allclose(largest, plan.errors, rtol=1e-9)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("[cascades]\ncount = 0\n", "cascades.count"), ("[cascades]\noverlap = 1.0\n", "cascades.overlap"),
        ("[cascades]\nshares = [1.0]\n", "shares: got 1, expected 4"), ("[cascades]\nbeside = ['doom']\n", "beside"),
        ("[cascades]\nstep = 1.0\n", "cascades.step"),
        ("[receivers]\nwhole_frustum = {}\n", "got [view] with a scene"),
    ],
)  # fmt: skip
def test_bad_settings_are_refused_in_a_sentence(capsys, more, words):
    assert invoke(FRUSTUM + more) == 2
    told = capsys.readouterr().err
    assert words in told
    assert "Traceback" not in told
