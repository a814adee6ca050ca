"""The command line end to end, each case in a folder of its own."""

import ast
import concurrent.futures
import csv
import gc
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import warpopt
from warpopt.app import cli
from warpopt.app.cascades.settings import CascadesConfig
from warpopt.app.common import output
from warpopt.app.common.call_stack import with_room_for_calls
from warpopt.app.common.jax_settings import prepare_jax
from warpopt.app.common.settings import ConfigError, read_config
from warpopt.app.compare.settings import CompareConfig, SceneCompareConfig
from warpopt.app.frames.settings import FramesConfig
from warpopt.app.scene.settings import SceneConfig
from warpopt.app.sweep import run
from warpopt.app.sweep.settings import RunConfig
from warpopt.app.table.settings import TableConfig
from warpopt.bound import BoundMap

CONFIGS = Path(__file__).parents[1] / "configs"
SMALL = """
[view]
near = 1.0
far = 100.0
half_fov_deg = 30.0
[light]
theta_deg = [10.0, 30.0, 60.0, 90.0]
[objective]
metrics = ["p", "q"]
norms = ["inf"]
[output]
directory = "out"
figures = false
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.toml").write_text(SMALL)
    return tmp_path


def invoke(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        cli.main(list(arguments))
    return exit_.value.code


def test_run_writes_a_table_that_reads_back_as_the_library_computes(folder, capsys):
    assert invoke("run", "config.toml") == 0
    assert {p.name for p in (folder / "out").iterdir()} == {"table.csv", "table.npz", "run.json", "report.md"}
    with (folder / "out/table.csv").open() as file:
        rows = list(csv.DictReader(file))
    head = "theta_deg,near,far,half_fov_deg,metric,norm,measure,eta,lambda_over_mu,lambda,value"
    assert list(rows[0])[:11] == head.split(",")
    assert list(rows[0])[11:13] == ["limit", "over_limit"]
    assert len(rows) == 8
    frustum = warpopt.ViewFrustum(1.0, 100.0, np.deg2rad(30.0))
    with np.load(folder / "out/table.npz") as file:
        arrays = dict(file)
    for o, metric in enumerate(("p", "q")):
        theta = np.deg2rad(np.array([10.0, 30.0, 60.0, 90.0]))
        view, objective = warpopt.FrustumView(frustum, theta), warpopt.Objective(metric)
        solution = warpopt.optimal_warp(view, objective)
        mine = [r for r in rows if r["metric"] == metric]
        # Batches of other shapes may round differently in the last place; text and npz may not.
        np.testing.assert_allclose([float(r["eta"]) for r in mine], solution.warp.eta, rtol=4e-15)
        limit = np.asarray(warpopt.lower_bound(view, objective))
        np.testing.assert_allclose([float(r["over_limit"]) for r in mine], solution.value / limit, rtol=1e-14)
        np.testing.assert_array_equal([float(r["limit"]) for r in mine], arrays["limit"][o, 0])
        np.testing.assert_array_equal([float(r["eta"]) for r in mine], arrays["eta"][o, 0])
        np.testing.assert_array_equal([float(r["lambda"]) for r in mine], arrays["lambda"][o, 0])
        ratio = warpopt.error_norm(view, warpopt.rules.lispsm(frustum, theta), objective) / solution.value
        np.testing.assert_allclose([float(r["lispsm"]) for r in mine], ratio, rtol=1e-14)
        psm = list(arrays["rule"]).index("psm")
        np.testing.assert_array_equal([float(r["psm"]) for r in mine], arrays["ratio"][o, psm, 0])
    report = (folder / "out/report.md").read_text()
    assert "The optimum's error is 1.96 to 16.3 times the limit." in report
    assert "None is known" not in report


def test_no_warp_is_inf_and_no_limit_nan_in_csv_and_both_null_in_strict_json(folder):
    assert invoke("run", "config.toml", "--objective.metrics", '["p", "q", "pxq"]') == 0

    def forbidden(constant):
        raise AssertionError(constant)

    record = json.loads((folder / "out/run.json").read_text(), parse_constant=forbidden)
    rows = record["objectives"][1]["tables"][0]["rows"]  # E_q: no warp at 10 degrees
    assert rows[0]["lambda"] is None
    assert rows[0]["no_warp"] is True
    assert rows[3]["no_warp"] is False
    assert rows[3]["lambda"] == pytest.approx(1.0, rel=1e-14)
    assert record["objectives"][1]["outcomes"] == {"tie": 2, "no_warp": 2}
    assert record["dtype"] == "float64"
    table = (folder / "out/table.csv").read_text()
    assert "10.0,1.0,100.0,30.0,q,inf,screen,1.0,inf,inf," in table
    assert [o["no_limit_because"] for o in record["objectives"][:2]] == [None, None]
    assert record["objectives"][2]["no_limit_because"] == "No lower bound is known for a product of E_p and E_q."
    assert {row["over_limit"] for row in record["objectives"][2]["tables"][0]["rows"]} == {None}
    assert table.count("nan,nan,") == 4
    assert "the columns hold nan, for E_pxq in norm inf." in (folder / "out/report.md").read_text()


def test_overrides_of_any_key(folder):
    arguments = ["--view.far", "500", "--output.directory", "else where", "--light.theta-deg", "[45.0]"]
    assert invoke("run", "config.toml", *arguments, "--objective.metrics=p") == 0
    record = json.loads((folder / "else where/run.json").read_text())
    assert record["config"]["view"]["far"] == [500.0]
    assert record["config"]["light"]["theta_deg"] == [45.0]
    assert record["config"]["objective"]["metrics"] == ["p"]


@pytest.mark.parametrize("name", sorted(p.name for p in CONFIGS.glob("*.toml")))
def test_shipped_configs_are_valid_and_say_what_they_answer(name):
    text = (CONFIGS / name).read_text()
    model = (
        FramesConfig
        if "[frames]" in text
        else SceneConfig
        if "[camera]" in text
        else TableConfig
        if "max_regret" in text
        else RunConfig
    )
    if "[rules]" in text:
        model = SceneCompareConfig if "[camera]" in text else CompareConfig
    if "[cascades]" in text:
        model = CascadesConfig
    assert isinstance(read_config(CONFIGS / name, [], model), model)
    first = text.split("\n[")[0]
    assert first.startswith("# ")
    assert "?" in first


def test_every_flaw_is_reported_at_once_with_its_path(folder, capsys):
    (folder / "bad.toml").write_text(
        '[view]\nnear = 1.0\nfar = 0.5\nhalf_fov_deg = [30.0, 95.0]\ncolour = "red"\n'
        '[light]\ntheta_deg = {start = 0.0, stop = 200.0, count = 0}\n[objective]\nmetrics = ["z"]\n'
        'norms = ["l0", 0.5]\n'
    )
    assert invoke("run", "bad.toml") == 2
    message = capsys.readouterr().err
    expected = (
        "view.far", "view.half_fov_deg.1", "view.colour", "light.theta_deg.stop", "light.theta_deg.count",
        "objective.metrics.0", "objective.norms.0", "objective.norms.1", "output",
    )  # fmt: skip
    for path in expected:
        assert f"  {path}:" in message, path
    assert "Traceback" not in message
    assert len(message.splitlines()) <= 2 + len(expected)
    assert list(folder.glob("out*")) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "missing.toml"], "missing.toml"),
        (["run", "config.toml", "--view.far"], "expected --section.key value"),
        (["run", "config.toml", "--view.fra", "3"], "view.fra: unknown key"),
        (["run", "config.toml", "--view", "3"], "view"),
        (["solve", "--near", "1", "--far", "0.5", "--half-fov-deg", "30", "--theta-deg", "60"], "far: got 0.5"),
        (
            ["rules", "--near", "0.1", "--far", "1e308", "--half-fov-deg", "30", "--theta-deg", "60"],
            "far: got 1e+308, expected far/near of at most 1.12e+307",
        ),
        (
            ["solve", "--near", "1", "--far", "inf", "--half-fov-deg", "30", "--theta-deg", "60"],
            "far: got inf, expected a finite number: give the farthest receiver's depth",
        ),
        (["solve", "--near", "nan", "--far", "5", "--half-fov-deg", "30", "--theta-deg", "60"], "near: got nan"),
        (["solve", "--near", "1", "--far", "5", "--half-fov-deg", "30", "--theta-deg", "60", "--x", "1"], "--x"),
        (["rules", "--near", "1", "--far", "5", "--half-fov-deg", "90", "--theta-deg", "60"], "half_fov_deg: got 90"),
    ],
)
def test_bad_input_exits_with_two_and_a_few_lines(folder, capsys, arguments, words):
    assert invoke(*arguments) == 2
    captured = capsys.readouterr()
    message = captured.err + captured.out
    assert words in message
    assert "Traceback" not in message
    assert len(message.splitlines()) <= 8


def test_solve_and_rules_answer_in_json(folder, capsys):
    problem = ["--near", "1", "--far", "100", "--half-fov-deg", "30", "--theta-deg", "90", "--json"]
    assert invoke("solve", *problem) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["lambda"] == pytest.approx(11.0, rel=1e-13)  # n + sqrt(f n)
    assert answer["limit"] == pytest.approx(math.sqrt(3) * math.log(100), rel=1e-13)
    assert answer["over_limit"] == answer["value"] / answer["limit"]
    assert invoke("rules", *problem, "--metric", "p") == 0
    rules = json.loads(capsys.readouterr().out)["rules"]
    assert rules["ssm"]["over_limit"] == pytest.approx(10 * answer["over_limit"], rel=1e-13)
    assert rules.keys() == warpopt.rules.PUBLISHED.keys() | warpopt.rules.ENGINES.keys()
    assert rules["openmw"]["lambda"] == pytest.approx(12.375, rel=1e-12)  # r d / 2
    assert set(rules["tsm_alternative"].values()) == {None, False}  # of theta <= phi alone
    assert invoke("rules", *problem[:-1]) == 0
    printed = capsys.readouterr().out
    assert "E_p, norm inf, measure screen" in printed
    (undefined,) = (line for line in printed.splitlines() if "tsm_alternative" in line)
    assert re.findall(r"[^\s│]+", undefined) == ["tsm_alternative", "-", "-", "-", "-"]
    assert invoke("rules", *problem, "--metric", "q", "--norm", "2") == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["rules"]["psm"]["ratio"] == pytest.approx(1.0, abs=1e-13)
    assert answer["rules"]["ssm"] == {
        "lambda": None, "lambda_over_mu": None, "no_warp": True, "defined": True, "ratio": pytest.approx(10.0),
        "over_limit": None,
    }  # fmt: skip
    assert answer["optimum"]["no_limit_because"] == "No lower bound is known for E_q in L_2."


def test_limit_writes_a_map_that_reads_back(folder, capsys):
    problem = ["--near", "1", "--far", "100", "--half-fov-deg", "30", "--theta-deg", "90"]
    assert invoke("limit", "new/best.csv", "best.json", *problem) == 0
    printed = capsys.readouterr().out
    assert "E_p, norm inf, measure screen: 7.97639" in printed
    assert "2.15 times" in printed
    for name in ("new/best.csv", "best.json"):
        assert BoundMap.load(name).value == pytest.approx(math.sqrt(3) * math.log(100), rel=1e-13)
    (folder / "mine.csv").write_text("1, 2")
    for files, words in (
        ([], "files: got none"),
        (["map.txt"], "files: got map.txt"),
        (["mine.csv"], "mine.csv: got a file that warpopt did not write"),
    ):
        assert invoke("limit", *files, *problem) == 2
        assert words in capsys.readouterr().err
    assert invoke("limit", "axis.csv", *problem, "--theta-deg", "0", "--measure", "axis") == 2
    assert "more than one depth" in capsys.readouterr().err


def test_schema_is_json_and_names_every_section(capsys):
    with pytest.raises(SystemExit):
        cli.main(["schema"])
    assert set(json.loads(capsys.readouterr().out)["properties"]) == {"view", "light", "objective", "output", "compute"}


def test_a_failed_run_leaves_nothing_and_keeps_the_earlier_result(folder, monkeypatch, capsys):
    assert invoke("run", "config.toml") == 0
    before = {p.name: p.read_bytes() for p in (folder / "out").iterdir()}

    def broken(*_):
        raise OSError("disk full")

    monkeypatch.setattr(run, "write_arrays", broken)
    assert invoke("run", "config.toml") == 1
    assert "disk full" in capsys.readouterr().err
    monkeypatch.setattr(run, "write_arrays", interrupted)
    assert invoke("run", "config.toml") == 130
    assert {p.name: p.read_bytes() for p in (folder / "out").iterdir()} == before
    assert sorted(p.name for p in folder.iterdir()) == ["config.toml", "out"]


def interrupted(*_):
    raise KeyboardInterrupt


def test_a_linked_folder_is_replaced_where_it_points_to(folder):
    assert invoke("run", "config.toml") == 0
    (folder / "link").symlink_to(folder / "out")
    assert invoke("run", "config.toml", "--output.directory", "link", "--objective.metrics", "p") == 0
    assert (folder / "link").is_symlink()
    assert json.loads((folder / "out/run.json").read_text())["config"]["objective"]["metrics"] == ["p"]
    assert sorted(p.name for p in folder.iterdir()) == ["config.toml", "link", "out"]


@pytest.mark.parametrize("name", ["view.near", "view.far", "light.theta_deg", "objective.norms", "objective.measure"])
@pytest.mark.parametrize("value", ["[]", "{}", "[[1]]", "true", '"x"', "1979-01-01", "nan"])
def test_a_value_of_the_wrong_kind_is_refused_in_words(folder, capsys, name, value):
    assert invoke("run", "config.toml", f"--{name}", value) == 2
    message = capsys.readouterr().err
    assert f"  {name}" in message
    assert "Traceback" not in message


def test_a_norm_named_twice_is_refused(folder, capsys):
    assert invoke("run", "config.toml", "--objective.norms", '["l2", 2]') == 2
    assert "expected distinct values" in capsys.readouterr().err


def test_a_failed_solve_does_not_pass_for_no_warp(folder, capsys):
    problem = ["--near", "1", "--far", "1e15", "--half-fov-deg", "30", "--theta-deg", "60", "--norm", "l2"]
    assert invoke("solve", *problem, "--json") == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["outcome"] == "not_finite"
    assert answer["no_warp"] is False
    assert answer["eta"] is None
    assert answer["over_limit"] is None
    assert answer["lambda"] is None


def test_a_folder_that_is_no_result_is_refused_and_kept(folder, capsys):
    (folder / "out").mkdir()
    (folder / "out/thesis.txt").write_text("years of work")
    assert invoke("run", "config.toml") == 2
    assert "thesis.txt" in capsys.readouterr().err
    assert (folder / "out/thesis.txt").read_text() == "years of work"


def test_a_result_is_replaced_whole_unless_someone_added_to_it(folder, capsys):
    assert invoke("run", "config.toml", "--output.figures", "true") == 0
    assert invoke("run", "config.toml", "--objective.metrics", "p") == 0
    assert not list((folder / "out").glob("*.png"))
    assert sorted(p.name for p in folder.iterdir()) == ["config.toml", "out"]
    (folder / "out/notes.txt").write_text("mine")
    assert invoke("run", "config.toml") == 2
    assert "notes.txt" in capsys.readouterr().err
    assert (folder / "out/notes.txt").read_text() == "mine"


def test_help_and_refusals_do_not_wait_for_jax():
    code = (
        "import sys, warpopt.app.cli as cli\n"
        "try:\n    cli.main(sys.argv[1:])\n"
        "except SystemExit as e:\n    print('code', e.code)\n"
        "print('jax' in sys.modules)\n"
    )
    refused = [([command, "nowhere.toml"], 2) for command in ("run", "table", "compare")]
    refused.append((["export", "nowhere.toml", "--to", "c"], 2))
    for arguments, code_expected in ((["--help"], 0), *refused):
        result = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
        assert result.stdout.splitlines()[-2:] == [f"code {code_expected}", "False"]


APP = Path(cli.__file__).parent
SHARED = {"common": set(), "inputs": {"common"}, "frusta": {"common"}, "splits": {"common"}}


@pytest.mark.parametrize("room", sorted(path.parent.name for path in APP.glob("*/__init__.py")))
def test_no_command_imports_from_anothers_folder(room):
    """And what is shared knows no command; the whole house's contract is not for the rooms within `app`."""
    allowed = SHARED.get(room, set(SHARED))
    files = list((APP / room).glob("*.py"))
    assert len(files) <= 16
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.level == 2 or (node.module or "").startswith("warpopt.app")):
                module = (node.module or "").removeprefix("warpopt.app").strip(".")
                assert module.partition(".")[0] in allowed, f"{file}: {ast.unparse(node)}"


def test_a_view_list_gives_one_table_for_each_value(folder):
    assert invoke("run", "config.toml", "--view.far", "[10, 1000]", "--objective.metrics", "p") == 0
    with np.load(folder / "out/table.npz") as file:
        arrays = dict(file)
    assert arrays["eta"].shape == (1, 2, 4)
    assert arrays["far"].tolist() == [10.0, 1000.0]
    # at pi/2 the optimum of E_p in L-inf is sqrt(n/f)
    np.testing.assert_allclose(arrays["eta"][0, :, 3], [math.sqrt(0.1), math.sqrt(0.001)], rtol=1e-14)


def test_read_config_names_a_broken_file(folder):
    (folder / "broken.toml").write_text("[view\n")
    with pytest.raises(ConfigError, match="not a TOML file"):
        read_config(folder / "broken.toml", [], RunConfig)


def test_what_a_killed_run_left_is_removed_by_the_next(tmp_path):
    """Of processes that are gone, alone: another run of the same output may be at work."""
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left, mine, other = (tmp_path / f".out.{name}.part" for name in (f"{gone.pid}-abc", f"{os.getpid()}-abc", "notes"))
    for folder in (left, mine, other):
        folder.mkdir()
    aside = tmp_path / f".out.{gone.pid}-abd.old"
    aside.mkdir()
    (aside / output.MARK).write_text('{"files": ["run.json"]}')
    with output.whole_folder(tmp_path / "out") as folder:
        assert (tmp_path / "out" / output.MARK).exists()  # put back
        (folder / "new").touch()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([mine.name, other.name, "out"])
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["new"]


def test_compiled_programs_are_kept_but_where_that_is_refused(tmp_path):
    """The same answer and nothing on stderr, compiled, read, and anew for cut programs; none is kept if so asked."""
    arguments = ["solve", "--near", "1", "--far", "100", "--half-fov-deg", "30", "--theta-deg", "60", "--json"]
    kept = {**os.environ, "WARPOPT_CACHE": str(tmp_path / "kept")}
    for name in ("JAX_COMPILATION_CACHE_DIR", "TF_CPP_MIN_LOG_LEVEL"):  # the last is what JAX said in this process
        kept.pop(name, None)
    kept["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"  # every program, however fast this machine is

    def answer(*words: str, **variables: str) -> dict:
        command = [sys.executable, "-m", "warpopt.app.cli", *arguments, *words]
        found = subprocess.run(command, env=kept | variables, capture_output=True)
        assert (found.returncode, found.stderr) == (0, b"")
        return json.loads(found.stdout)

    first = answer()
    programs = {path: path.read_bytes() for path in (tmp_path / "kept").rglob("*-cache")}
    assert programs
    assert answer() == first
    assert {path: path.read_bytes() for path in (tmp_path / "kept").rglob("*-cache")} == programs  # none was compiled
    for path, program in programs.items():
        path.write_bytes(program[:-7])
    assert answer() == first
    home = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home")}  # where programs are kept unasked
    assert answer(WARPOPT_CACHE="0", **home) == first
    assert answer("--no-cache", WARPOPT_CACHE=str(tmp_path / "none")) == first
    assert not (tmp_path / "none").exists()
    assert not (tmp_path / "home").exists()


def test_a_misspelt_command_is_told_the_nearest(capsys):
    assert invoke("solv") == 2
    assert "got 'solv'" in capsys.readouterr().err


def test_a_users_settings_of_xla_are_kept(monkeypatch):
    monkeypatch.setenv("WARPOPT_CACHE", "0")
    for name in ("xla_backend_optimization_level", "xla_cpu_parallel_codegen_split_count"):
        monkeypatch.setenv("XLA_FLAGS", f"--{name}=8")
        prepare_jax()
        assert [flag for flag in os.environ["XLA_FLAGS"].split() if name in flag] == [f"--{name}=8"]
        assert len(os.environ["XLA_FLAGS"].split()) >= 2


def test_a_command_leaves_the_garbage_collector_as_it_was(capsys):
    before = gc.get_threshold()
    with pytest.raises(SystemExit):
        cli.main(["schema"])
    assert gc.get_threshold() == before


@pytest.mark.skipif(sys.platform != "linux", reason="counts threads as Linux does")
def test_a_process_of_the_command_line_wastes_no_time():
    """NumPy and SciPy have no threads of their own; no garbage is looked for at the end, but in a caller's process."""
    script = """if True:
        import atexit, gc, os, sys
        atexit.register(lambda: print("frozen", gc.get_freeze_count() > 9999))  # the first is called last
        from warpopt.app import cli
        import numpy, scipy.linalg
        print("threads", len(os.listdir("/proc/self/task")))
        sys.argv[1:] = ["schema"]
        """
    without = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    for call, frozen in (("cli.main()", True), ("cli.main(['schema'])", False)):
        run = [sys.executable, "-c", script + call]
        said = subprocess.run(run, env=without, capture_output=True, text=True, check=True).stdout
        assert said.startswith("threads 1\n")
        assert said.endswith(f"frozen {frozen}\n")


@pytest.mark.skipif(sys.platform != "linux", reason="counts page faults as Linux does")
def test_calls_within_take_no_new_memory():
    """Wherever a loop of calls stands in the stack; without it there are places where each call faults a new page."""
    import resource

    def callee():
        pass

    callee.__code__ = callee.__code__.replace(co_stacksize=100)  # as large a frame as some of JAX's

    def faults(depth):
        if depth:
            return faults(depth - 1)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(500):
            callee()
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    def worst():
        return max(faults(depth) for depth in range(250))

    def on_a_thread(function):
        """Its stack is its own, without the room that tests have."""
        with concurrent.futures.ThreadPoolExecutor(1) as thread:
            return thread.submit(function).result()

    assert on_a_thread(worst) > 400
    assert on_a_thread(with_room_for_calls(worst)) < 50
    assert with_room_for_calls(worst).__name__ == "worst"
