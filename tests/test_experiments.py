"""A short slice of each experiment: that it runs, and that what it must find holds."""

import csv
import dataclasses
import importlib
import json
import math
import re
import shutil
import sys
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
import twin

EXPERIMENTS = Path(__file__).parents[1] / "experiments"


@pytest.fixture
def script(monkeypatch):
    """A script as a module: the slices share what is imported and compiled."""
    monkeypatch.setattr(sys, "path", [str(EXPERIMENTS), *sys.path])
    return importlib.import_module


@pytest.fixture
def main(script):
    """Run a script's `main` in this process."""

    def run(name: str, *arguments: str) -> None:
        assert not script(name).main(list(arguments))

    return run


@pytest.mark.thorough
def test_stability_meets_every_target_on_a_slice(tmp_path, main):
    arguments = ["--draws", "100", "--references", "3", "--points", "5", "--objectives", "1", "--processes", "1"]
    main("stability", *arguments, "--directory", str(tmp_path))
    summary = json.loads((tmp_path / "stability.json").read_text())
    assert summary["defects"] == []
    for dtype in ("float64", "float32"):
        assert summary["worst"][dtype]["not_finite"] == 0
        assert summary["worst"][dtype]["norm_ulp"] > 0  # something was compared
    with (tmp_path / "worst.csv").open() as file:
        row = next(csv.DictReader(file))
    assert float.fromhex(row["near"]) > 0
    assert (tmp_path / "heat_map.png").stat().st_size > 10_000


@pytest.mark.thorough
def test_runtime_vs_error_runs_and_orders_the_methods(tmp_path, main):
    main("runtime_vs_error", "--short", "--directory", str(tmp_path))
    with (tmp_path / "methods.csv").open() as file:
        rows = {(r["method"], r["effort"]): r for r in csv.DictReader(file)}
    ours = float(rows["warpopt", ""]["eta_error_worst"])
    # 200 eps: well conditioned interior optima of f/n <= 1e4; SciPy's search on values cannot pass sqrt(eps)
    assert ours < 200 * np.finfo(float).eps
    scipy_rows = [r for (method, _), r in rows.items() if method.startswith("SciPy minimize_scalar")]
    assert all(float(r["eta_error_worst"]) > 100 * ours for r in scipy_rows)
    targets = json.loads((tmp_path / "summary.json").read_text())["targets"]
    assert all(math.isfinite(t["measured"]) for name, t in targets.items() if "screen" in name)
    assert (tmp_path / "runtime_vs_error.png").stat().st_size > 10_000


@pytest.mark.thorough
def test_what_is_not_asked_for_is_measured(tmp_path, main):
    """The script runs, and writes its table into a page without touching the rest."""
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- only what is asked -->\nold\n<!-- end only what is asked -->\nafter\n")
    main("only_what_is_asked", "--short", "--directory", str(tmp_path), "--page", str(page))
    savings = json.loads((tmp_path / "savings.json").read_text())["savings"]
    assert all(s["without"] > 0 and s["with"] > 0 for s in savings)
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert all(s["saving"] in text for s in savings)


@pytest.mark.thorough
def test_scene_receivers_are_measured(tmp_path, main):
    """It runs; the histogram's warp is never better than the buffer's own, and far better than none."""
    main("scene_receivers", "--short", "--directory", str(tmp_path))
    summary = json.loads((tmp_path / "receivers.json").read_text())
    assert all(row["ms"] > 0 for row in summary["buffer"] + summary["bodies"])
    for row in summary["histogram_regret"]:
        assert -1e-9 < row["histogram"] < row["no warp"]


@pytest.mark.thorough
def test_means_over_a_buffer_are_timed(tmp_path, main, script, monkeypatch):
    few = script("runtime_of_means").OBJECTIVES[:1]  # E_p in L2: each takes seconds to compile
    monkeypatch.setattr(script("runtime_of_means"), "OBJECTIVES", few)
    main("runtime_of_means", "--height", "90", "--repetitions", "1", "--directory", str(tmp_path))
    with (tmp_path / "runtime_of_means.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["weights"] for row in rows} == {"uniform", "edges"}
    assert all(float(row["over_p_l2"]) == 1 for row in rows)


@pytest.mark.thorough
def test_sizes_of_tables_are_measured(tmp_path, main):
    page = tmp_path / "page.md"
    page.write_text("<!-- table sizes -->\n<!-- end table sizes -->\n")
    main("table_sizes", "--short", "--directory", str(tmp_path), "--page", str(page))
    (row,) = json.loads((tmp_path / "sizes.json").read_text())["tables"]
    assert row["knots a row"] * 8 == row["bytes"]
    assert float(row["largest regret"]) <= 1e-3
    assert row["plain entries"] > 3 * row["knots a row"]  # that is what kinks as knots are for
    assert f"| {row['bytes']} |" in page.read_text()


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not on this machine: apt-get install gcc")
@pytest.mark.thorough
def test_look_ups_are_timed_beside_lispsm(tmp_path, main):
    """The program compiles and runs, and the page gets its table; how long it takes decides nothing here."""
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- lookup speed -->\n<!-- end lookup speed -->\nafter\n")
    main("lookup_speed", "--short", "--directory", str(tmp_path), "--readme", str(page))
    times = json.loads((tmp_path / "speed.json").read_text())["ns"]["gcc"]
    assert len(times) == 7
    assert all(0 < ns < 1e6 for ns in times.values())
    assert all(f" {name} |" in page.read_text() for name in times)


@pytest.mark.parametrize(("metric", "order"), [("p", 2.0), ("pxq", 1.0), ("q", math.inf)])
def test_the_experiments_reference_agrees_with_raw_geometry(script, metric, order):
    """reference.py shares the derivation with the package; the twin shares nothing. To 30 digits of 50."""
    alpha, beta = {"p": (1, 0), "q": (0, 1), "pxq": (1, 1)}[metric]
    view = (1.0, 40.0, 0.6, 1.1)
    problem, scene = script("reference").Problem(*view, metric, order, "screen"), twin.Scene(*view)
    for eta in (mp.mpf("0.02"), mp.mpf("0.3")):
        lam = scene.lam(eta)
        if math.isinf(order):
            exact = scene.supremum(alpha, beta, lam)
        else:
            exact = twin.PowerMean(scene, alpha, beta, int(order), "screen")(lam)
        assert abs(problem.norm(eta) / exact - 1) < mp.mpf(10) ** -30


@pytest.mark.thorough
def test_objective_pictures_show_what_was_minimised(tmp_path, script):
    """Each warp is the best by its own error at worst; docs/objectives.md says what the maps show."""
    pictures = script("objective_pictures")
    view = pictures.View(short=False)
    choices = [view.choice("none", warped=False), view.choice("p", "p"), view.choice("q", "q")]
    for metric, best in (("p", 1), ("q", 2)):
        worst = [choice.worst(metric) for choice in choices]
        assert worst[best] == min(worst)
        assert worst[0] > 3 * worst[best]
    _, p, q = choices
    page = (EXPERIMENTS.parent / "docs" / "objectives.md").read_text(encoding="utf-8")
    assert f"In the foreground $E_q$ remains {p.worst('q'):.2g}." in page
    assert f"the worst pixel as good as can be ({p.worst('p'):.2g})" in page
    assert f"the ridge has {q.worst('p'):.2g} pixels per texel" in page
    assert f"nearer than {view.seen.depth.min() // 1:.0f} times the near distance" in page  # near is 1
    pictures.picture(choices, ("p",), curves=True).savefig(tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def test_gallery_pictures_keep_their_pixels(tmp_path, script):
    from PIL import Image

    gallery = script("gallery")
    with pytest.raises(SystemExit):
        gallery.main(["--runs", str(tmp_path), "--directory", str(tmp_path)])
    drawing = np.zeros((20, 30, 3), np.uint8)
    drawing[5:, 10:] = (213, 94, 0)
    for source, _ in gallery.PICTURES.values():
        (tmp_path / source).parent.mkdir(exist_ok=True)
        Image.fromarray(drawing).save(tmp_path / source)
    gallery.main(["--runs", str(tmp_path), "--directory", str(tmp_path)])
    for name in gallery.PICTURES:
        assert np.array_equal(np.asarray(Image.open(tmp_path / name).convert("RGB")), drawing), name


@pytest.mark.thorough
def test_scenes_with_flaws_are_read_right_or_refused(tmp_path, script):
    """60 of the experiment's 2,000; and its oracle sees what is wrong: another eta, another depth."""
    fuzz = script("fuzz_scenes")
    ends, defects = fuzz.fuzz(3000, 60, tmp_path)
    assert defects == []
    assert ends["solved"] >= 8
    assert ends["refused"] >= 8


@pytest.mark.thorough
def test_the_fuzz_s_oracles_see_what_is_wrong(tmp_path, script, monkeypatch):
    fuzz = script("fuzz_scenes")

    def shows_something(seed: int) -> bool:
        return fuzz.attempt(seed, tmp_path) == "solved" and 5 < np.nanmax(np.load(tmp_path / "a.npy")) < 100

    seed = next(s for s in range(1, 400, 2) if shows_something(s))
    optimal = fuzz.warpopt.optimal_warp

    def off(view, objective, **options):
        found = optimal(view, objective, **options)
        return dataclasses.replace(found, value=found.value * 1.5)

    monkeypatch.setattr(fuzz.warpopt, "optimal_warp", off)
    with pytest.raises(fuzz.Defect, match="E_p was reported as"):
        fuzz.attempt(seed, tmp_path)
    monkeypatch.setattr(fuzz.warpopt, "optimal_warp", optimal)
    read = fuzz.read_scene

    def wrong(config, folder):
        scene = read(config, folder)
        return dataclasses.replace(scene, depths=[depth * 1.01 for depth in scene.depths])

    monkeypatch.setattr(fuzz, "read_scene", wrong)
    with pytest.raises(fuzz.Defect, match="read as"):
        fuzz.attempt(seed, tmp_path)


def test_every_mutation_has_its_place(script):
    """The text that it changes is there, once, and so are its tests; whether they notice takes the whole script."""
    mutations = script("mutations")
    assert len(mutations.MUTATIONS) >= 40
    for mutation in mutations.MUTATIONS:
        assert (EXPERIMENTS.parent / "src" / "warpopt" / mutation.file).read_text("utf-8").count(mutation.old) == 1
        assert mutation.new != mutation.old
        assert all((EXPERIMENTS.parent / f"tests/test_{name}.py").exists() for name in mutation.tests.split())


@pytest.mark.thorough
def test_pixels_are_measured_and_written_into_pages(tmp_path, main, script, monkeypatch):
    """A small frame of each real model: every table is there, and a second call resumes."""
    pytest.importorskip("embreex")
    monkeypatch.setattr(script("pixels"), "OBJECTIVES", ("p-inf", "edge", "band"))  # each takes seconds to compile
    monkeypatch.setattr(script("pixels"), "ENGINE", ("none", "lispsm", "p-inf"))
    few = dict(list(script("pixels").READINGS.items())[::6])  # without a bias, by depth, and filtered
    monkeypatch.setattr(script("pixels"), "READINGS", few)
    monkeypatch.setattr(script("pixels"), "SIZES", (512, 1024))
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- pixels -->\nold\n<!-- end pixels -->\nafter\n")
    arguments = ["--short", "--directory", str(tmp_path), "--page", str(page), "--readme", str(page)]
    main("pixels", "--short", "--directory", str(tmp_path), "--page", str(page))
    records = json.loads((tmp_path / "pixels.json").read_text())
    frames = [frame for each in records.values() for frame in each]
    assert {frame["scene"] for frame in frames} == {"hand.glb", "controller.glb"}
    assert len(frames) == 2
    for frame in frames:
        assert frame["footprint"] < 1e-3  # the bar; it holds to rounding
        assert frame["fine"] < frame["error"]["none"]["wrong"] + 1 / frame["judged"]
        assert len(frame["scan"]) == len(frame["objective"]["edge"])
    acne = [frame["readings"]["nearest, no bias"]["none"][0] for frame in frames if "readings" in frame]
    assert len(acne) == 2  # the first frame of each model
    assert min(acne) > 0.1
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    for heading in ("Goals", "Wins and losses", "Biases and filters"):
        assert f"### {heading}" in text
    before = (tmp_path / "pixels.json").stat().st_mtime_ns
    main("pixels", *arguments)
    assert (tmp_path / "pixels.json").stat().st_mtime_ns == before
    assert "edge-weighted against no warp" in page.read_text()


@pytest.mark.thorough
def test_flicker_is_measured(tmp_path, main):
    """A snapped sphere does not flicker while walking, nor does a window that keeps; a fit each frame does."""
    pytest.importorskip("embreex")
    main("flicker", "--short", "--directory", str(tmp_path), "--images", str(tmp_path))
    (told,) = json.loads((tmp_path / "flicker.json").read_text()).values()
    assert told["sphere"]["flipped"] == 0
    assert told["none"]["flipped"] + told["lispsm"]["flipped"] > 0
    assert told["window-p-inf"]["between"] == 0
    assert "snapped" in (tmp_path / "flicker.md").read_text()
    for name in ("flicker.gif", "stability.png"):
        assert (tmp_path / name).stat().st_size > 1000
    main("flicker", "--short", "--cascades", "--directory", str(tmp_path / "several"))
    (told,) = json.loads((tmp_path / "several/flicker.json").read_text()).values()
    assert told["2-logarithmic-sphere"]["flipped"] < 0.2 * told["none"]["flipped"]  # points that change their cascade
    assert told["window-2-logarithmic-none"]["between"] < 0.2 * told["none"]["flipped"]


@pytest.mark.thorough
def test_a_window_that_keeps_costs_a_pass(tmp_path, main, capsys):
    main("window_cost", "--short", "--directory", str(tmp_path))
    told = json.loads((tmp_path / "window_cost.json").read_text())
    assert told["state_bytes"] < 1024
    assert 0 < told["ratios"]["keeps"] < 10  # the bar is for a whole frame on an idle machine
    assert "an update that keeps" in capsys.readouterr().out


@pytest.mark.thorough
def test_plans_are_timed_beside_one_solve(tmp_path, main, capsys):
    main("cascade_cost", "--short", "--directory", str(tmp_path))
    told = json.loads((tmp_path / "cascade_cost.json").read_text())
    assert set(told) == {"frusta, p", "frusta, pxq", "pixels, p", "pixels, storage"}
    assert all(0 < ratio < 1000 for ratio in told.values())  # the bars are for full sizes on an idle machine
    assert "times one optimal_warp" in capsys.readouterr().out


@pytest.mark.thorough
def test_figure_3_is_drawn(tmp_path, main, capsys):
    pytest.importorskip("embreex")
    main("figure3", "--short", "--image", str(tmp_path / "figure3.png"))
    assert (tmp_path / "figure3.png").stat().st_size > 10_000
    assert len(re.findall(r"% wrong", capsys.readouterr().out)) == 12


@pytest.mark.thorough
def test_directions_are_searched_exhaustively(tmp_path, main, script, monkeypatch):
    """Two frames and 60 directions: the search is within 0.5 % of their least."""
    pytest.importorskip("embreex")
    directions = script("directions")
    monkeypatch.setattr(directions, "OBJECTIVES", {"storage": directions.OBJECTIVES["storage"]})
    monkeypatch.setattr(directions, "GIVEN", ("view",))
    page = tmp_path / "page.md"
    page.write_text("<!-- directions -->\n<!-- end directions -->\n")
    main("directions", "--short", "--directory", str(tmp_path), "--page", str(page))
    records = json.loads((tmp_path / "directions.json").read_text())
    assert len(records) == 2
    for each in records:
        assert each["values"]["storage"]["best"] <= 1.005 * each["least"]["storage"]
        assert each["minima"]["storage"] >= 1
    assert "| storage | 2 of 2 |" in page.read_text()


@pytest.mark.thorough
def test_turned_warps_are_measured_in_pixels(tmp_path, main, script, monkeypatch):
    """One small frame: a turned and shaped warp beside the others, and a second call that measures nothing again."""
    pytest.importorskip("embreex")
    turned = script("pixels_turned")
    for name, value in (("TURNED", ("shaped-edge",)), ("GOALS", {"edge": 0.8}), ("RULES", ("none",))):
        monkeypatch.setattr(turned, name, value)
    monkeypatch.setattr(turned, "STRAIGHT", ("none", "lispsm", "p-inf", "edge", "band"))
    main("pixels_turned", "--short", "--directory", str(tmp_path))
    before = (tmp_path / "turned.json").stat().st_mtime_ns
    main("pixels_turned", "--short", "--directory", str(tmp_path))
    assert (tmp_path / "turned.json").stat().st_mtime_ns == before
    assert "edge-weighted, turned, best aspect" in (tmp_path / "tables.md").read_text()


@pytest.mark.thorough
def test_cascades_are_measured_in_pixels(tmp_path, main, script, monkeypatch):
    """One small frame: some cascades beside single maps, and a second call that measures nothing again."""
    pytest.importorskip("embreex")
    several = script("pixels_cascades")
    for name, value in (("ONE", ("none", "p-inf")), ("COUNTS", (2,)), ("WARPS", ("none", "p-inf"))):
        monkeypatch.setattr(several, name, value)
    monkeypatch.setattr(several, "SPLITS", {"logarithmic": "logarithmic", "godot": "Godot's"})
    monkeypatch.setattr(several, "GOALS", (("2-logarithmic-p-inf", "2-logarithmic-none", 0.97),))
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- cascades -->\nold\n<!-- end cascades -->\n")
    main("pixels_cascades", "--short", "--directory", str(tmp_path))
    kept = json.loads((tmp_path / "cascades.json").read_text())
    ((frame,),) = kept.values()
    assert set(frame["error"]) == {"none", "p-inf", "2-logarithmic-sphere"} | {
        f"2-{splits}-{warp}" for splits in ("logarithmic", "godot") for warp in ("none", "p-inf")
    }
    assert 0 < frame["error"]["2-logarithmic-none"] < 1
    before = (tmp_path / "cascades.json").stat().st_mtime_ns
    main("pixels_cascades", "--short", "--directory", str(tmp_path), "--page", str(page))
    assert (tmp_path / "cascades.json").stat().st_mtime_ns == before
    assert "| 2 | Godot's |" in page.read_text()


@pytest.mark.thorough
def test_the_script_for_a_gpu_runs_on_a_cpu(tmp_path, main):
    """Its table; and that an animation on the device compiles once and sends nothing to or from the host."""
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- gpu -->\nold\n<!-- end gpu -->\nafter\n")
    main("gpu", "--short", "--directory", str(tmp_path), "--page", str(page))
    told = json.loads((tmp_path / "gpu.json").read_text())
    assert told["animation"]["compilations after the first"] == 0
    assert told["animation"]["least eta"] < told["animation"]["largest eta"]  # the frames are not one frame
    (buffer,) = told["buffers"]
    assert buffer["eta off the CPU's"] == 0  # it is the CPU's
    assert {row["objective"] for row in told["batches"]} == {"E_p, norm inf", "E_p, norm l2"}
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text


PROGRAM = """HloModule jit_solve

%body (a: f32[3]) -> f32[3] {
  ROOT %twice = f32[3]{0} add(%a, %a)
}

ENTRY %main.4 (x: f32[3]) -> (f32[3], f32[]) {
  %x = f32[3]{0} parameter(0)
  %loop_add_fusion = f32[3]{0} fusion(%x), kind=kLoop, calls=%body
  %sum = (f32[], pred[]) fusion(%loop_add_fusion), kind=kInput, calls=%body
  %first = f32[] get-tuple-element(%sum), index=0
  %copy.1 = f32[3]{0} copy(%loop_add_fusion)
  ROOT %both = (f32[3]{0}, f32[]) tuple(%copy.1, %first)
}
"""


BATCH = """HloModule jit_solve

%fused_add (a: f32[2,3], b: f32[3]) -> (f32[3], pred[3]) {
  %a = f32[2,3]{1,0} parameter(0)
}

%region_0.1 (arg_tuple.1: (s32[], f32[2,3], f32[2,3])) -> (s32[], f32[2,3], f32[2,3]) {
  %arg_tuple.1 = (s32[], f32[2,3]{1,0}, /*index=2*/f32[2,3]{1,0}) parameter(0)
  %get-tuple-element.1 = f32[2,3]{1,0} get-tuple-element(%arg_tuple.1), index=1
  %get-tuple-element.2 = f32[2,3]{1,0} get-tuple-element(%arg_tuple.1), index=2
  %made = f32[2,3]{1,0} constant({...})
  %loop_add_fusion = (f32[3]{0}, pred[3]{0}) fusion(%get-tuple-element.1, %made), kind=kLoop, calls=%fused_add
  %get-tuple-element.3 = f32[3]{0} get-tuple-element(%loop_add_fusion), index=0
  %loop_dynamic_update_slice_fusion = f32[2,3]{1,0} fusion(%get-tuple-element.3), kind=kLoop, calls=%fused_put
  ROOT %tuple.1 = (f32[2,3]{1,0}) tuple(%loop_dynamic_update_slice_fusion)
}
"""


def test_kernels_are_counted_or_it_is_said_why_not(script, capsys, tmp_path):
    """By hand. JAX's plugin for GPUs is no dependency of the tests."""
    counted = script("gpu_kernels")
    assert counted.kernels_of(PROGRAM) == 3
    with pytest.raises(ValueError, match="got while in its entry"):
        counted.kernels_of(PROGRAM.replace("copy(", "while("))
    # Of 6 problems in 2 pieces: a sum reads 12 bytes and writes 4 and 1 of each, and 4 are put into their place.
    assert counted.bytes_of(BATCH) == 12 + 5 + 4 + 4
    if counted.main(["--short", "--directory", str(tmp_path)]) == 0:
        found = json.loads((tmp_path / "kernels.json").read_text())
        ((_, _, count),) = found["kernels"]
        assert 10 < count < 100
        for _, moved, least in found["batches"]:
            assert least * 0.99 < moved < 100 * least
    else:
        assert "cannot compile for an H100 here" in capsys.readouterr().err
        assert not any(tmp_path.iterdir())


def test_compilations_are_counted(script):
    import jax

    with script("gpu").compilations() as compiled:
        jax.jit(lambda v: v * 3 - 1)(1.5)
    assert compiled
