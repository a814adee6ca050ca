"""`warpopt compare` with [cascades]: ways of splitting beside the best, over directions and over a scene's lights."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scene_cases import BOX, strict, toml

import warpopt
from warpopt.app import cli
from warpopt.cascades import splits

FRUSTUM = """[view]
near = 1.0
far = 100.0
half_fov_deg = 30.0
[light]
theta_deg = [0.0, 40.0, 90.0]
[rules]
names = ["lispsm"]
[objective]
metrics = "p"
norms = ["inf", "l2"]
[cascades]
count = 2
overlap = 0.1
beside = ["uniform", "godot", "unity"]
[output]
directory = "out"
figures = true
"""


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def invoke(text: str) -> int:
    Path("compare.toml").write_text(text)
    with pytest.raises(SystemExit) as ended:
        cli.main(["compare", "compare.toml"])
    return ended.value.code


def table() -> list[dict[str, str]]:
    with Path("out/splits.csv").open() as file:
        return list(csv.DictReader(file))


def test_over_a_frustum_every_number_is_the_library_s():
    """In the table, the record and the report; the figure is written; bands need a thick frustum."""
    assert invoke(FRUSTUM) == 0
    theta = np.deg2rad([0.0, 40.0, 90.0])
    view = warpopt.FrustumView(warpopt.ViewFrustum(1.0, 100.0, np.deg2rad(30)), theta)
    rows, report = table(), Path("out/report.md").read_text()
    assert len(rows) == 2 * 4 * 2 * 3
    for norm in ("inf", "l2"):
        objective = warpopt.Objective("p", norm)
        best = np.asarray(warpopt.cascades.plan(view, 2, objective, overlap=0.1).value)
        for name in ("uniform", "godot", "unity"):
            at = (splits.SCHEMES | splits.ENGINES)[name](1.0, 100.0, 2)
            cells = []
            for warp in (True, False):
                own = np.asarray(warpopt.cascades.errors(view, at, objective, overlap=0.1, warp=warp).value)
                told = [r for r in rows if (r["norm"], r["splits"], r["warped"]) == (norm, name, str(warp))]
                np.testing.assert_allclose([float(r["value"]) for r in told], own, rtol=1e-12)
                np.testing.assert_allclose([float(r["over_best"]) for r in told], own / best, rtol=1e-12)
                cells += [f"{(own / best).mean():.3g}", f"{(own / best).max():.3g}"]
            if name == "uniform":
                assert f"| uniform | {' | '.join(cells)} |" in report
    told = strict(Path("out/compare.json"))["cascades"]
    assert [each["norm"] for each in told] == ["inf", "l2"]
    assert told[0]["ways"][0] == {**told[0]["ways"][0], "splits": "best", "over_best": [1.0, 1.0, 1.0]}
    assert "(splits.png)" in report
    assert Path("out/splits.png").stat().st_size > 5000
    assert invoke(FRUSTUM.replace("overlap = 0.1", "overlap = 0.995")) == 2
    assert invoke(FRUSTUM.replace("overlap = 0.1", "price = 1.0")) == 2  # of `warpopt cascades` alone


def test_over_a_scene_each_light_has_its_own():
    lights = "path = [[0.3, -1, -0.2], [0.6, -0.9, 0.3]]"
    more = "[objective]\nmetrics = 'p'\n[rules]\nnames = ['lispsm']\n[cascades]\ncount = 2\nbeside = ['uniform']\n"
    assert invoke(toml(BOX, light=lights, more=more)) == 0
    rows, values = table(), []
    box = warpopt.receivers.ConvexBody.box((-20, 0, -80), (20, 8, -5))
    camera = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), 1.0, 100.0, np.deg2rad(25), 1.777778)
    for direction in ((0.3, -1, -0.2), (0.6, -0.9, 0.3)):
        view = warpopt.SceneView(camera, warpopt.DirectionalLight(direction), box)
        values.append(float(warpopt.cascades.plan(view, 2, warpopt.Objective("p")).value))
    best = [r for r in rows if (r["splits"], r["warped"]) == ("best", "True")]
    np.testing.assert_allclose([float(r["value"]) for r in best], values, rtol=1e-9)
    assert {r["over"] for r in rows if r["splits"] == "uniform"} == {"receivers", "planes"}
    assert "(of the camera planes)" in Path("out/report.md").read_text()
