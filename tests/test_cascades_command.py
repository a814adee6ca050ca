"""`warpopt cascades` end to end: over a frustum and over a scene."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scene_cases import BOX, toml

import warpopt
from warpopt.app.cli import main

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
    assert "they would be balanced if nothing were nearer than 4." in report
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
    for name in ("lost.png", "along.png"):
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


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("[cascades]\ncount = 0\n", "cascades.count"), ("[cascades]\noverlap = 1.0\n", "cascades.overlap"),
        ("[cascades]\nshares = [1.0]\n", "shares: got 1, expected 4"), ("[cascades]\nbeside = ['doom']\n", "beside"),
        ("[receivers]\nwhole_frustum = {}\n", "got [view] with a scene"),
    ],
)  # fmt: skip
def test_bad_settings_are_refused_in_a_sentence(capsys, more, words):
    assert invoke(FRUSTUM + more) == 2
    told = capsys.readouterr().err
    assert words in told
    assert "Traceback" not in told
