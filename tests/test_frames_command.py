"""`warpopt frames` end to end, on two tiny scenes."""

import csv
import dataclasses
import importlib
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scene_cases import toml

from warpopt.app import cli
from warpopt.app.frames import run as frames_run
from warpopt.app.frames.parts import Parts
from warpopt.app.frames.report import _ratios
from warpopt.app.frames.settings import FramesConfig
from warpopt.app.inputs.scene_files import read_scene
from warpopt.frames import LitScene, measured, see
from warpopt.frames.fits import Fitting
from warpopt.scene_files.made import made_scene

pytest.importorskip("embreex")

WARPS = ["none", "lispsm", "p-inf", "edge", "best"]


def settings(seed: int = 3, warps=WARPS, more: str = "", light: str = "direction = [0.5, -0.8, -0.3]") -> str:
    section = f"[frames]\nwarps = {json.dumps(warps)}\nscreen = [64, 48]\nshadow_map = [64, 64]\n{more}\n"
    return toml(f"made = {{ scene = 'corridor', seed = {seed}, views = 2 }}", light, camera="", more=section)


def invoke(text: str, *arguments: str) -> int:
    Path("frames.toml").write_text(text)
    with pytest.raises(SystemExit) as exit_:
        cli.main(["frames", "frames.toml", *arguments])
    return exit_.value.code


def table(folder: str = "out") -> list[dict[str, str]]:
    with Path(folder, "frames.csv").open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_slice_end_to_end():
    """Table, report, record and pictures; numbers are the library's own, and another seed gives others."""
    assert invoke(settings(), "--output.figures", "true") == 0
    rows = table()
    assert [(row["frame"], row["warp"]) for row in rows] == [(str(k), name) for k in (0, 1) for name in WARPS]
    made = made_scene("corridor", 3)
    scene = LitScene(made.triangles, np.array([0.5, -0.8, -0.3]))
    frame = see(scene, made.camera(1, 64 / 48), 48, 64)
    fitting = Fitting(scene, frame, (64, 64))
    for row in rows[len(WARPS) : -1]:
        fitted = fitting.fitted(row["warp"])
        assert float(row["eta"]) == pytest.approx(fitted.eta, rel=1e-9)
        assert float(row["wrong"]) == measured(frame, fitting.map_of(fitted), seed=1).wrong
        assert float(row["wrong"]) == pytest.approx(float(row["false"]) + float(row["missing"]))
    assert int(rows[-1]["judged"]) == frame.judged.sum()
    counts = [int(rows[-1][key]) for key in ("judged", "away", "grazing", "background")]
    assert sum(counts) == 64 * 48
    record = json.loads(Path("out/run.json").read_text())
    assert record["files"] == sorted(path.name for path in Path("out").iterdir())
    report = Path("out/report.md").read_text()
    for name in record["files"]:
        assert not name.endswith(".png") or f"({name})" in report
    assert {f"frame_000_{name}.png" for name in WARPS} | {"frame_000_scan.png"} <= set(record["files"])
    assert not list(Path().glob(".out*"))
    assert invoke(settings(seed=4), "--output.directory", "other") == 0
    assert [row["wrong"] for row in table("other")] != [row["wrong"] for row in rows]


def test_cascades_stand_beside_single_maps():
    """In the table with each one's eta and the splits, in the report by name, and as pictures of all their maps."""
    name = "2-logarithmic-p-inf"
    assert invoke(settings(warps=["p-inf", name]), "--output.figures", "true", "--receivers.made.views", "1") == 0
    one, several = table()
    assert (one["splits"], several["warp"]) == ("", name)
    splits, etas = ([float(v) for v in several[key].split()] for key in ("splits", "eta"))
    assert (len(splits), len(etas)) == (3, 2)
    assert splits == pytest.approx(np.geomspace(splits[0], splits[2], 3), rel=1e-4)
    assert 0 < float(several["wrong"]) < 1
    report = Path("out/report.md").read_text()
    assert "| 2 cascades, logarithmic splits, E_p, norm inf |" in report
    assert f"(frame_000_{name}.png)" in report
    assert invoke(settings(warps=["3-lispsm-none"])) == 2


def test_a_killed_run_resumes_and_leaves_nothing_half_done(monkeypatch):
    record, seen = frames_run._record, []

    def dies(config, scene, place, lit, parts):
        seen.append(place.number)
        if len(seen) == 2:
            raise KeyboardInterrupt
        return record(config, scene, place, lit, parts)

    monkeypatch.setattr(frames_run, "_record", dies)
    assert invoke(settings(warps=["none", "p-inf"])) == 130
    assert not Path("out").exists()
    assert invoke(settings(warps=["none", "p-inf"])) == 0
    assert seen == [0, 1, 1]
    rows = table()
    assert invoke(settings(warps=["none", "p-inf"]), "--output.directory", "whole") == 0
    assert table("whole") == rows
    assert not list(Path().glob(".out*"))


def test_parts_of_another_light_are_another_run_s():
    """The sun of a path in time moves with settings that are not the frames': the lights themselves are in the key."""
    config = FramesConfig.model_validate(tomllib.loads(settings()))
    scene = read_scene(config, Path(), images=False)
    other = dataclasses.replace(scene, lights=[(0.5, -0.8, -0.31)])
    folders = [Parts(config, each).folder for each in (scene, other, dataclasses.replace(scene))]
    assert folders[0] == folders[2] != folders[1]


def test_a_frame_without_a_wrong_pixel_is_not_lost_from_ratios():
    """It counts as half of the least error; frames without an error do not count."""
    one, other = np.array([0.0, 0.02, np.nan, 0.04]), np.array([0.01, 0.01, 0.01, 0.0])
    np.testing.assert_allclose(_ratios(one, other), [0.5, 2, 8])
    np.testing.assert_allclose(_ratios(np.zeros(2), np.zeros(2)), 1)


def refuses(*_):
    raise OSError("disk full")


def test_a_part_that_is_cut_is_computed_again(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(frames_run, "_write_table", refuses)
        assert invoke(settings(warps=["none"])) == 1
    (part,) = Path().glob(".out*.parts/frame_000.json")
    part.write_text(part.read_text()[:-9])
    assert invoke(settings(warps=["none"])) == 0
    assert len(table()) == 2


def test_frames_without_an_error_are_counted_and_said(capsys):
    """From below and from the side: no shadowed pixel, or none that is judged."""
    text = settings(warps=["none", "p-inf"]).replace(", views = 2 }", " }")
    up = "[camera]\nposition = [0, 2, -20]\nforward = [0, 1, 0.1]\nnear = 0.1\nfar = 200.0\nhalf_fov_deg = 20.0\n"
    assert invoke(up + text) == 1
    told = capsys.readouterr().err
    assert "warpopt: frames: got 1 without a defined error (" in told
    assert told.endswith("nothing was measured\n")
    (row, _) = table()
    assert row["excluded"] in ("only background", "no surface faces the light", "no shadow", "no lit pixel")
    assert row["wrong"] == ""
    assert "Excluded, because their error is undefined: 1 with" in Path("out/report.md").read_text()


def test_a_path_is_measured_for_every_method():
    """A snapped sphere never flickers while walking; a warp fitted each frame flickers as much as it is wrong."""
    path = "path = { kind = 'walk', count = 4, methods = ['none', 'held-p-inf', 'sphere'] }"
    assert invoke(settings(warps=["none"], more=path), "--output.figures", "true") == 0
    with Path("out/flicker.csv").open() as file:
        rows = {row["method"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["none", "held-p-inf", "sphere"]
    assert float(rows["sphere"]["flicker"]) == 0
    assert float(rows["held-p-inf"]["flicker"]) == 0  # four frames in one fit
    assert float(rows["none"]["flicker"]) > 0.2 * float(rows["none"]["static"])
    assert all(row["frames"] == "4" for row in rows.values())
    with Image.open("out/path_none.gif") as moving:
        assert moving.n_frames > 1
    assert "(path_none.gif)" in Path("out/report.md").read_text()


@pytest.mark.parametrize(("text", "words"), [
    (settings(warps=["lispms"]), "frames.warps.0: got 'lispms', expected 'none', 'best', a rule"),
    (settings(warps=["p-0.5"]), "frames.warps.0"),
    (settings(more="path = { kind = 'walk', methods = ['held-sphere'] }"), "expected 'sphere' or 'sphere-receivers'"),
    (settings(more="path = { kind = 'walk', methods = ['lispms'] }"), "with or without 'held-' before it"),
    (settings(more="fit = 'camera'"), "frames.fit"),
    (settings(more="path = { kind = 'walk', methods = ['best'] }"), "a warp that does not need the truth"),
    (settings(more="[objective]\nmetrics = ['p']"), "objective: got one, expected objectives by name in frames.warps"),
    (toml("box = { lower = [0, 0, -9], upper = [1, 1, -8] }", more="[frames]"), "got box without a shadow caster"),
    (settings().replace("corridor", "desert"), "receivers.made.scene"),
])  # fmt: skip
def test_bad_settings_are_refused_in_a_sentence(text, words, capsys):
    assert invoke(text) == 2
    told = capsys.readouterr().err
    assert words in told
    assert "Traceback" not in told
    assert not Path("out").exists()


def test_a_scene_without_a_caster_or_a_sun_is_refused(capsys):
    gltf = str(Path(__file__).parent / "cases/instancing.gltf")
    camera = "position = [0, 2, 9]\nforward = [0, 0, -1]\nnear = 0.1\nfar = 50.0\nhalf_fov_deg = 20.0"
    assert invoke(toml(f"gltf = {{ file = '{gltf}', include = 'nothing' }}", camera=camera, more="[frames]")) == 2
    assert "receivers.gltf.file: " in (told := capsys.readouterr().err)
    assert "got no triangle" in told
    night = "path = { kind = 'sun', latitude_deg = 80.0, day = 355, count = 2 }"
    assert invoke(settings(light=night)) == 2
    assert "light: got a sun that is below the horizon all the time" in capsys.readouterr().err


def test_a_missing_ray_caster_is_told_with_the_command_that_installs_it(monkeypatch, capsys):
    real = importlib.import_module

    def absent(name, *rest):
        if name.startswith("embreex"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", absent)
    assert invoke(settings()) == 2
    assert capsys.readouterr().err == (
        "warpopt: rays: got no embreex, expected the package that casts them: pip install 'warpopt[frames]'\n"
    )
